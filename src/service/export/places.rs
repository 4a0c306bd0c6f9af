//! How many exports are read at once, by tenant and in all: each holds a snapshot of a map. A place is
//! given back when it is dropped. Nothing here knows formats.

use std::collections::BTreeMap;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use crate::service::convert::count;
use crate::service::engine::{EngineError, tenant_of};
use crate::service::error::ServiceError;

/// Most exports of a server at once.
const MOST: usize = 64;
/// Most exports of a tenant at once.
const MOST_OF_TENANT: usize = 32;

/// The exports of a server that are being read, by tenant.
#[derive(Clone, Debug, Default)]
pub(in crate::service) struct Exports(Arc<Mutex<BTreeMap<String, usize>>>);

/// An export's place; dropping it gives it back.
#[derive(Debug)]
pub(in crate::service) struct Place {
    exports: Exports,
    tenant: String,
}

impl Exports {
    /// Takes a place for an export of `map`, named as the engine names it.
    ///
    /// # Errors
    /// [`EngineError::TenantCeiling`], [`ServiceError::ServerLimit`].
    pub(in crate::service) fn begin(&self, map: &str) -> Result<Place, ServiceError> {
        let tenant = tenant_of(map).to_owned();
        let mut counts = self.lock();
        if counts.get(&tenant).is_some_and(|&now| now >= MOST_OF_TENANT) {
            let (limit, maximum) = ("tenant_max_export_count", count(MOST_OF_TENANT));
            return Err(EngineError::TenantCeiling { limit, maximum }.into());
        }
        if counts.values().sum::<usize>() >= MOST {
            let (limit, maximum) = ("max_export_count", count(MOST));
            return Err(ServiceError::ServerLimit { limit, maximum });
        }
        *counts.entry(tenant.clone()).or_default() += 1;
        drop(counts);
        Ok(Place { exports: self.clone(), tenant })
    }

    fn lock(&self) -> MutexGuard<'_, BTreeMap<String, usize>> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl Drop for Place {
    fn drop(&mut self) {
        let mut counts = self.exports.lock();
        if let Some(count) = counts.get_mut(&self.tenant) {
            *count -= 1;
            if *count == 0 {
                counts.remove(&self.tenant);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn exports_at_once_are_counted_by_tenant_and_server() {
        let exports = Exports::default();
        let take = |map: &str, most| -> Vec<Place> {
            (0..most).map(|_| exports.begin(map).unwrap()).collect()
        };
        let mut first = take("acme.a", MOST_OF_TENANT);
        let limit = "tenant_max_export_count";
        let maximum = count(MOST_OF_TENANT);
        let full = EngineError::TenantCeiling { limit, maximum };
        assert_eq!(exports.begin("acme.b").unwrap_err(), ServiceError::Engine(full));
        let _others = take("other.a", MOST - MOST_OF_TENANT);
        let (limit, maximum) = ("max_export_count", count(MOST));
        let full = ServiceError::ServerLimit { limit, maximum };
        assert_eq!(exports.begin("third.a").unwrap_err(), full);
        first.pop();
        let _place = exports.begin("third.a").unwrap();
        drop(first);
        assert!(exports.begin("acme.b").is_ok());
    }
}
