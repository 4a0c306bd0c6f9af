//! Accounts: the only place that counts what each map, each tenant and the server hold.
//!
//! Above a map's account is its tenant's, and above that the server's. A reservation in an account
//! is also made in the accounts above it: in all or in none. Limits are checked when something is
//! reserved. A [`Reservation`] is released when it is dropped, so that nothing stays counted after
//! a canceled call. [`HeldEntities`] counts the entities of a map. This module does not know how a
//! tenant is identified.

use std::collections::BTreeMap;
use std::fmt;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, PoisonError, RwLock};

mod resource;
#[cfg(test)]
mod tests;

use super::EngineError;
use crate::map::{Counted, Exceeded, Usage};
use crate::sync::Mutex;
use resource::{Owner, name_of};

pub use resource::{AccountLimits, AccountRow, Resource, limit_name};

/// Separates the tenant and the name of a map; neither part contains it.
pub const SEPARATOR: char = '.';

/// The tenant of the map called `map`; empty for the default tenant.
#[must_use]
pub fn tenant_of(map: &str) -> &str {
    map.split_once(SEPARATOR).map_or("", |(tenant, _)| tenant)
}

/// The resources that a map, a tenant or the server holds, and their limits.
pub struct Account {
    owner: Owner,
    /// Name of the map in the engine, or of the tenant.
    name: String,
    above: Option<Arc<Account>>,
    limits: RwLock<AccountLimits>,
    entities: Mutex<Usage>,
    held: [AtomicU64; Resource::ALL.len()],
}

impl fmt::Debug for Account {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Account")
            .field("owner", &self.owner)
            .field("name", &self.name)
            .finish_non_exhaustive()
    }
}

impl Account {
    fn new(
        owner: Owner,
        name: &str,
        above: Option<&Arc<Self>>,
        limits: AccountLimits,
    ) -> Arc<Self> {
        Arc::new(Self {
            owner,
            name: name.to_owned(),
            above: above.cloned(),
            limits: RwLock::new(limits),
            entities: Mutex::default(),
            held: Default::default(),
        })
    }

    /// Name of the map or the tenant; empty for the default tenant and for the server.
    pub fn name(&self) -> &str {
        &self.name
    }

    /// The tenant's name, for the account of a tenant or of its map; empty for the default tenant.
    pub fn tenant(&self) -> &str {
        match self.owner {
            Owner::Map => tenant_of(&self.name),
            Owner::Tenant | Owner::Server => &self.name,
        }
    }

    /// Its limits.
    pub fn limits(&self) -> AccountLimits {
        *self.limits.read().unwrap_or_else(PoisonError::into_inner)
    }

    /// Sets the limits. What is held already is kept.
    fn set_limits(&self, limits: AccountLimits) {
        *self.limits.write().unwrap_or_else(PoisonError::into_inner) = limits;
    }

    /// How much of a resource it holds.
    pub fn held(&self, resource: Resource) -> u64 {
        self.held[resource as usize].load(Ordering::Acquire)
    }

    /// The entities of its maps.
    pub fn entities(&self) -> Usage {
        *self.entities.lock()
    }

    /// Reserves `amount` of a resource here and in the accounts above.
    ///
    /// # Errors
    /// [`EngineError::MapLimit`], [`EngineError::TenantLimit`] or [`EngineError::ServerLimit`]
    /// of the first account whose limit would be exceeded; then nothing is reserved.
    pub fn reserve(
        self: &Arc<Self>,
        resource: Resource,
        amount: u64,
    ) -> Result<Reservation, EngineError> {
        let mut reservation = self.reserve_existing(resource, 0);
        reservation.resize(amount)?;
        Ok(reservation)
    }

    /// Reserves what exists already, even above the limits.
    #[must_use]
    pub fn reserve_existing(self: &Arc<Self>, resource: Resource, amount: u64) -> Reservation {
        let mut reservation = Reservation { account: Arc::clone(self), resource, amount: 0 };
        reservation.count(amount);
        reservation
    }

    fn take(&self, resource: Resource, amount: u64) -> Result<(), EngineError> {
        for account in self.chain() {
            let maximum = account.limits().of(resource);
            let more = |held: u64| {
                let held = held.checked_add(amount)?;
                maximum.is_none_or(|maximum| held <= maximum).then_some(held)
            };
            let held = &account.held[resource as usize];
            if held.fetch_update(Ordering::AcqRel, Ordering::Acquire, more).is_err() {
                let taken = self.chain().take_while(|taken| !std::ptr::eq(*taken, account));
                taken.for_each(|taken| taken.give_back(resource, amount));
                let limit = account.owner.limit_of(resource);
                return Err(account.full(limit, maximum.unwrap_or(u64::MAX)));
            }
        }
        Ok(())
    }

    fn give_back(&self, resource: Resource, amount: u64) {
        self.held[resource as usize].fetch_sub(amount, Ordering::AcqRel);
    }

    /// This account and those above it.
    fn chain(&self) -> impl Iterator<Item = &Self> {
        std::iter::successors(Some(self), |account| account.above.as_deref())
    }

    /// The error that names a limit of this account.
    pub(super) fn full(&self, limit: &'static str, maximum: u64) -> EngineError {
        let maximum = i64::try_from(maximum).unwrap_or(i64::MAX);
        match self.owner {
            Owner::Map => EngineError::MapLimit { map: self.name.clone(), limit, maximum },
            Owner::Tenant => EngineError::TenantLimit { limit, maximum },
            Owner::Server => EngineError::ServerLimit { limit, maximum },
        }
    }

    /// The error of a limit of entities that would be exceeded.
    pub(super) fn exceeded(&self, Exceeded { counted, maximum }: Exceeded) -> EngineError {
        self.full(self.owner.limit_of_counted(counted), maximum)
    }

    /// Everything that is counted, by name: how much the account holds, and the lowest limit among
    /// its own and those of the accounts above it.
    pub fn rows(&self) -> Vec<AccountRow> {
        let lowest = |limit: &dyn Fn(&AccountLimits) -> Option<u64>| {
            self.chain().filter_map(|account| limit(&account.limits())).min()
        };
        // The pool alone knows which solves run.
        let reserved = Resource::ALL.into_iter().filter(|&resource| resource != Resource::Solves);
        let resources = reserved.map(|resource| AccountRow {
            name: resource.name(),
            held: self.held(resource),
            limit: lowest(&|limits| limits.of(resource)),
        });
        let entities = self.entities();
        let counts = Counted::ALL.map(|counted| AccountRow {
            name: name_of(counted),
            held: entities.of(counted),
            limit: lowest(&|limits| limits.held.of(counted)),
        });
        resources.chain(counts).collect()
    }
}

/// An amount of a resource that is reserved in an account until this is dropped.
#[derive(Debug)]
pub struct Reservation {
    account: Arc<Account>,
    resource: Resource,
    amount: u64,
}

impl Reservation {
    /// The reserved amount.
    pub fn amount(&self) -> u64 {
        self.amount
    }

    /// Changes the amount, for example when a file grows or a chunk was sent.
    ///
    /// # Errors
    /// As [`Account::reserve`], for the additional amount; the reservation is then unchanged.
    pub fn resize(&mut self, amount: u64) -> Result<(), EngineError> {
        match amount.checked_sub(self.amount) {
            Some(more) => self.account.take(self.resource, more)?,
            None => self.give_back(self.amount - amount),
        }
        self.amount = amount;
        Ok(())
    }

    /// Sets the amount without checking limits, where it is known only afterwards.
    pub fn count(&mut self, amount: u64) {
        match amount.checked_sub(self.amount) {
            Some(more) => self.account.chain().for_each(|account| {
                account.held[self.resource as usize].fetch_add(more, Ordering::AcqRel);
            }),
            None => self.give_back(self.amount - amount),
        }
        self.amount = amount;
    }

    fn give_back(&self, amount: u64) {
        self.account.chain().for_each(|account| account.give_back(self.resource, amount));
    }
}

impl Drop for Reservation {
    fn drop(&mut self) {
        self.give_back(self.amount);
    }
}

/// The entities of one map, counted in its account and those above it until this is dropped.
#[derive(Debug)]
pub(super) struct HeldEntities {
    account: Arc<Account>,
    counted: Usage,
}

impl HeldEntities {
    /// The entities of an existing map, even above the limits.
    pub(super) fn existing(account: &Arc<Account>, usage: Usage) -> Self {
        let mut held = Self { account: Arc::clone(account), counted: Usage::default() };
        held.update(usage);
        held
    }

    /// Reserves what a change of the map would add. Checks the limits of the accounts above the
    /// map's; the caller checks the map's own limits, because it may make room.
    ///
    /// # Errors
    /// [`EngineError::TenantLimit`], [`EngineError::ServerLimit`]; then nothing is reserved.
    pub(super) fn grow(&mut self, growth: Usage) -> Result<(), EngineError> {
        for account in self.account.chain() {
            let limits = account.limits().held;
            let mut entities = account.entities.lock();
            let exceeded =
                limits.exceeded(*entities, growth).filter(|_| account.owner != Owner::Map);
            if let Some(exceeded) = exceeded {
                drop(entities);
                let taken = self.account.chain().take_while(|taken| !std::ptr::eq(*taken, account));
                taken.for_each(|taken| {
                    let mut entities = taken.entities.lock();
                    *entities = *entities - growth;
                });
                return Err(account.exceeded(exceeded));
            }
            *entities = *entities + growth;
        }
        self.counted = self.counted + growth;
        Ok(())
    }

    /// Whether all accounts have room for `growth`.
    pub(super) fn have_room(&self, growth: Usage) -> bool {
        self.account
            .chain()
            .all(|account| account.limits().held.exceeded(account.entities(), growth).is_none())
    }

    /// Sets the map's entities to `now`, after a change was applied or has failed.
    pub(super) fn update(&mut self, now: Usage) {
        for account in self.account.chain() {
            let mut entities = account.entities.lock();
            *entities = *entities - self.counted + now;
        }
        self.counted = now;
    }
}

impl Drop for HeldEntities {
    fn drop(&mut self) {
        self.update(Usage::default());
    }
}

/// The accounts of a server and of all tenants seen so far. Cheap to clone.
#[derive(Clone, Debug)]
pub struct Accounts {
    server: Arc<Account>,
    known: Arc<Mutex<AccountTable>>,
}

#[derive(Debug, Default)]
struct AccountTable {
    tenants: BTreeMap<String, Arc<Account>>,
    /// Limits of every tenant that has no limits of its own.
    common: AccountLimits,
    own: BTreeMap<String, AccountLimits>,
    /// Limits of every map.
    maps: AccountLimits,
}

impl Default for Accounts {
    fn default() -> Self {
        Self::new(AccountLimits::default(), AccountLimits::default(), AccountLimits::default())
    }
}

impl Accounts {
    /// Accounts with the limits of the server, of each tenant and of each map.
    #[must_use]
    pub fn new(server: AccountLimits, tenant: AccountLimits, map: AccountLimits) -> Self {
        let known = AccountTable { common: tenant, maps: map, ..AccountTable::default() };
        Self {
            server: Account::new(Owner::Server, "", None, server),
            known: Arc::new(Mutex::new(known)),
        }
    }

    /// Sets the limits of the tenants in `own`; all other tenants have the common limits. What is
    /// held already is kept.
    pub fn set_tenants(&self, own: BTreeMap<String, AccountLimits>) {
        let mut known = self.known.lock();
        known.own = own;
        for (name, tenant) in &known.tenants {
            tenant.set_limits(known.own.get(name).copied().unwrap_or(known.common));
        }
    }

    /// The account of the server.
    pub fn server(&self) -> &Arc<Account> {
        &self.server
    }

    /// The account of the tenant called `name`.
    pub fn tenant(&self, name: &str) -> Arc<Account> {
        let mut known = self.known.lock();
        if let Some(tenant) = known.tenants.get(name) {
            return Arc::clone(tenant);
        }
        let limits = known.own.get(name).copied().unwrap_or(known.common);
        let tenant = Account::new(Owner::Tenant, name, Some(&self.server), limits);
        known.tenants.insert(name.to_owned(), Arc::clone(&tenant));
        tenant
    }

    /// A new account for the map called `map`, below its tenant's. It exists as long as the map's
    /// engine runs.
    pub(super) fn of_map(&self, map: &str) -> Arc<Account> {
        let tenant = self.tenant(tenant_of(map));
        let limits = self.known.lock().maps;
        Account::new(Owner::Map, map, Some(&tenant), limits)
    }
}
