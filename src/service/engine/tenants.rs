//! Tenants: what all maps of one hold together, and how much they may.
//!
//! A map called `tenant.name` belongs to `tenant`, one without a dot to the default tenant, whose
//! name is empty. Engines book what their maps hold; maps and streams are booked by tokens that
//! give themselves back when they are dropped. Nothing here knows how a tenant is recognized.

use std::collections::BTreeMap;
use std::fmt;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError, RwLock};

use super::EngineError;
use crate::map::{Ceilings, Passed, Usage};

/// Between tenant and name; neither part holds one.
pub const SEPARATOR: char = '.';

/// The tenant of the map called `map`; empty for the default tenant.
#[must_use]
pub fn tenant_of(map: &str) -> &str {
    map.split_once(SEPARATOR).map_or("", |(tenant, _)| tenant)
}

/// Limits of a tenant; `None` is unlimited.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct TenantCeilings {
    /// Of all its maps together.
    pub held: Ceilings,
    /// Maps.
    pub max_maps: Option<u64>,
    /// Ingest and watch streams that are open at once.
    pub max_streams: Option<u64>,
    /// Solves that run at once.
    pub max_solves: Option<u64>,
    /// Calls for solves that wait for their turn.
    pub max_waiting_solves: Option<u64>,
}

/// Who owns maps, and what they hold.
pub struct Tenant {
    name: String,
    ceilings: RwLock<TenantCeilings>,
    held: Mutex<Usage>,
    maps: Arc<AtomicU64>,
    streams: Arc<AtomicU64>,
}

impl fmt::Debug for Tenant {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Tenant").field("name", &self.name).finish_non_exhaustive()
    }
}

/// A map or stream of a tenant, for as long as it lives.
#[derive(Debug)]
pub struct Booked(Arc<AtomicU64>);

impl Drop for Booked {
    fn drop(&mut self) {
        self.0.fetch_sub(1, Ordering::AcqRel);
    }
}

impl Tenant {
    fn new(name: &str, ceilings: TenantCeilings) -> Self {
        Self {
            name: name.to_owned(),
            ceilings: RwLock::new(ceilings),
            held: Mutex::default(),
            maps: Arc::default(),
            streams: Arc::default(),
        }
    }

    /// Its name; empty for the default tenant.
    #[must_use]
    pub fn name(&self) -> &str {
        &self.name
    }

    /// How much it may hold.
    #[must_use]
    pub fn ceilings(&self) -> TenantCeilings {
        *self.ceilings.read().unwrap_or_else(PoisonError::into_inner)
    }

    /// What its maps hold.
    #[must_use]
    pub fn held(&self) -> Usage {
        *self.lock()
    }

    /// Which ceiling `growth` would pass.
    pub(super) fn passed(&self, growth: Usage) -> Option<Passed> {
        self.ceilings().held.passed(self.held(), growth)
    }

    /// A map that held `before` holds `now`.
    pub(super) fn book(&self, before: Usage, now: Usage) {
        let mut held = self.lock();
        *held = *held - before + now;
    }

    /// Takes a place for a new map.
    pub(super) fn book_map(&self) -> Result<Booked, EngineError> {
        self.take(&self.maps, self.ceilings().max_maps, "tenant_max_map_count")
    }

    /// Takes a place for a map that exists, whatever the ceiling is by now.
    pub(super) fn book_existing_map(&self) -> Booked {
        self.maps.fetch_add(1, Ordering::AcqRel);
        Booked(Arc::clone(&self.maps))
    }

    /// Takes a place for a stream.
    ///
    /// # Errors
    /// [`EngineError::TenantCeiling`].
    pub fn book_stream(&self) -> Result<Booked, EngineError> {
        let maximum = self.ceilings().max_streams;
        self.take(&self.streams, maximum, "tenant_max_stream_count")
    }

    fn take(
        &self,
        count: &Arc<AtomicU64>,
        maximum: Option<u64>,
        limit: &'static str,
    ) -> Result<Booked, EngineError> {
        let more = |count: u64| match maximum {
            Some(maximum) if count >= maximum => None,
            _ => Some(count + 1),
        };
        match count.fetch_update(Ordering::AcqRel, Ordering::Acquire, more) {
            Ok(_before) => Ok(Booked(Arc::clone(count))),
            Err(_full) => {
                let maximum = i64::try_from(maximum.unwrap_or(0)).unwrap_or(i64::MAX);
                Err(EngineError::TenantCeiling { limit, maximum })
            }
        }
    }

    fn lock(&self) -> MutexGuard<'_, Usage> {
        self.held.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// All tenants that were heard of. Cheap to clone.
#[derive(Clone, Debug, Default)]
pub struct Tenants(Arc<Mutex<Known>>);

#[derive(Debug, Default)]
struct Known {
    tenants: BTreeMap<String, Arc<Tenant>>,
    /// Those of every tenant without its own.
    common: TenantCeilings,
    own: BTreeMap<String, TenantCeilings>,
}

impl Tenants {
    /// Tenants that all may hold as much as `common` says, but for those in `own`.
    #[must_use]
    pub fn new(common: TenantCeilings, own: BTreeMap<String, TenantCeilings>) -> Self {
        Self(Arc::new(Mutex::new(Known { tenants: BTreeMap::new(), common, own })))
    }

    /// From now on `own` holds; what is held already stays.
    pub fn set(&self, own: BTreeMap<String, TenantCeilings>) {
        let mut known = self.lock();
        known.own = own;
        for tenant in known.tenants.values() {
            let ceilings = known.own.get(&tenant.name).copied().unwrap_or(known.common);
            *tenant.ceilings.write().unwrap_or_else(PoisonError::into_inner) = ceilings;
        }
    }

    /// The tenant called `name`.
    #[must_use]
    pub fn get(&self, name: &str) -> Arc<Tenant> {
        let mut known = self.lock();
        if let Some(tenant) = known.tenants.get(name) {
            return Arc::clone(tenant);
        }
        let ceilings = known.own.get(name).copied().unwrap_or(known.common);
        let tenant = Arc::new(Tenant::new(name, ceilings));
        known.tenants.insert(name.to_owned(), Arc::clone(&tenant));
        tenant
    }

    /// The tenant of the map called `map`.
    #[must_use]
    pub fn of_map(&self, map: &str) -> Arc<Tenant> {
        self.get(tenant_of(map))
    }

    fn lock(&self) -> MutexGuard<'_, Known> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn usage(keyframes: u64) -> Usage {
        Usage { keyframes, ..Usage::default() }
    }

    #[test]
    fn what_maps_hold_adds_up_and_is_given_back() {
        let held = Ceilings { max_keyframes: Some(10), ..Ceilings::default() };
        let tenants =
            Tenants::new(TenantCeilings { held, ..TenantCeilings::default() }, BTreeMap::new());
        let tenant = tenants.of_map("acme.a");
        assert!(Arc::ptr_eq(&tenant, &tenants.of_map("acme.b")));
        assert_eq!(tenants.of_map("house").name(), "");
        tenant.book(usage(0), usage(4));
        tenant.book(usage(0), usage(5));
        assert_eq!(tenant.passed(usage(1)), None);
        assert_eq!(tenant.passed(usage(2)).map(|p| p.maximum), Some(10));
        tenant.book(usage(5), usage(0));
        assert_eq!(tenant.held(), usage(4));
        assert_eq!(tenants.get("other").passed(usage(10)), None);
    }

    #[test]
    fn places_are_given_back_by_dropping_them() {
        let own = TenantCeilings { max_streams: Some(2), ..TenantCeilings::default() };
        let tenants = Tenants::new(TenantCeilings::default(), BTreeMap::new());
        let tenant = tenants.get("acme");
        tenants.set(BTreeMap::from([("acme".to_owned(), own)]));
        let first = tenant.book_stream().unwrap();
        let _second = tenant.book_stream().unwrap();
        let full = EngineError::TenantCeiling { limit: "tenant_max_stream_count", maximum: 2 };
        assert_eq!(tenant.book_stream().unwrap_err(), full);
        drop(first);
        tenant.book_stream().unwrap();
        let many: Vec<_> = (0..9).map(|_| tenants.get("b").book_stream()).collect();
        assert!(many.iter().all(Result::is_ok), "without a ceiling there is none");
    }
}
