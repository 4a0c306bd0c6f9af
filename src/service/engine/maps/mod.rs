//! All maps of a server.
//!
//! The store decides which names are in use; the table holds the running engines. A creation or
//! deletion runs to its end in its own task, even if its caller stops waiting: cut off halfway, it
//! would leave a name that is neither free nor a map. It claims its name from its first step to its
//! last: another change of the same name waits, so that two never run in the store at once. Dropping
//! a claim leaves the name as it was last set, so that a name stays usable after a panic.

pub(crate) mod copying;
pub(crate) mod counts;
pub(crate) mod importing;
pub(crate) mod merging;
mod opening;
mod sharing;

use std::collections::BTreeMap;
use std::fmt;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicI64, Ordering};
use std::time::Duration;

use futures_util::FutureExt;
use tokio::sync::{Semaphore, watch};
use tracing::Instrument;

use crate::map::{Change, Event, Map, MapPolicy};
use crate::service::engine::error::report_bug;
use crate::service::engine::handle::watch::READERS;
use crate::service::engine::journal::{stored, unix_time_ns};
use crate::service::engine::maps::opening::Start;
use crate::service::engine::{
    Account, EngineConfig, EngineError, EngineMeters, MapCounts, MapHandle, MapInfo, Reservation,
    Resource, SolverPool, tenant_of,
};
use crate::store::{Durability, Epoch, Store, StoreError};
use crate::sync::Mutex;

/// All maps of a server. Cheap to clone.
#[derive(Clone)]
pub struct Maps {
    pub(crate) inner: Arc<Inner>,
}

pub(crate) struct Inner {
    pub(crate) store: Arc<dyn Store>,
    pub(crate) pool: Arc<SolverPool>,
    pub(crate) config: EngineConfig,
    pub(crate) meters: Arc<EngineMeters>,
    pub(crate) table: Table,
    pub(crate) closing: AtomicBool,
    /// Limits how many watchers read journals at once.
    pub(crate) history: Arc<Semaphore>,
    /// The last creation time. Creation times increase strictly, because uids are computed from
    /// them.
    pub(crate) last_create_time_ns: AtomicI64,
}

impl fmt::Debug for Maps {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Maps").field("config", &self.inner.config).finish_non_exhaustive()
    }
}

impl Maps {
    /// The maps of a store, none of them open yet.
    #[must_use]
    pub fn new(store: Arc<dyn Store>, pool: Arc<SolverPool>, config: EngineConfig) -> Self {
        let inner = Inner {
            store,
            pool,
            config,
            meters: Arc::default(),
            table: Table::default(),
            closing: AtomicBool::new(false),
            history: Arc::new(Semaphore::new(READERS)),
            last_create_time_ns: AtomicI64::new(0),
        };
        Self { inner: Arc::new(inner) }
    }

    /// The maps of a store; opens all of them.
    ///
    /// # Errors
    /// As [`Maps::load`].
    pub async fn open(
        store: Arc<dyn Store>,
        pool: Arc<SolverPool>,
        config: EngineConfig,
    ) -> Result<Self, EngineError> {
        let maps = Self::new(store, pool, config);
        maps.load().await?;
        Ok(maps)
    }

    /// Opens every map that the store holds. Needs a tokio runtime, as every call here. A map that
    /// cannot be opened answers calls with the reason and does not delay the others. If the system
    /// had no file descriptors left, it is opened later.
    ///
    /// # Errors
    /// [`EngineError::Store`] when the store cannot be read.
    pub async fn load(&self) -> Result<(), EngineError> {
        for name in self.inner.store.list_maps().await? {
            self.reopen(name).await;
        }
        for map in self.list() {
            self.lead_merged(&map).await;
        }
        Ok(())
    }

    /// Creates a map. Dropping the future does not undo or stop a creation that has begun.
    ///
    /// # Errors
    /// [`EngineError::MapExists`], [`EngineError::TenantLimit`], [`EngineError::ServerLimit`],
    /// [`EngineError::ShuttingDown`], [`EngineError::Store`].
    pub async fn create(
        &self,
        name: &str,
        display_name: &str,
        policy: MapPolicy,
    ) -> Result<MapInfo, EngineError> {
        self.look_elsewhere(name).await?;
        let claim = self.claim(name).await?;
        if let Some(handle) = claim.map().cloned() {
            drop(claim);
            // The caller relies on the map as its creator does, so that it must be durable.
            handle.durable(1).await?;
            return Err(EngineError::MapExists { map: name.to_owned() });
        }
        let (create_time_ns, display_name) = (self.create_time_ns(), display_name.to_owned());
        let change = Change::Created { policy, create_time_ns, display_name };
        let event = Event { revision: 1, time_ns: create_time_ns, cause: None, change };
        let mut map = Map::new();
        if let Err(error) = map.apply(&event) {
            return Err(EngineError::Journal { map: name.to_owned(), error });
        }
        let maps = self.clone();
        run_to_end(async move { maps.create_claimed(claim, map, Some(event)).await }).await
    }

    /// Creates a map whose name is claimed and free: with its first event, or without one with the
    /// content that it has.
    pub(crate) async fn create_claimed(
        &self,
        claim: Claim,
        map: Map,
        first: Option<Event>,
    ) -> Result<MapInfo, EngineError> {
        let (store, name) = (&self.inner.store, claim.name().to_owned());
        // Reserved before the map is created; released if the creation fails.
        let reservation = self.tenant(&name).reserve(Resource::Maps, 1)?;
        let (map, is_empty) = (Arc::new(map), first.is_some());
        let epoch = self.create_stored(&name, (!is_empty).then_some(&map)).await?;
        if let Some(event) = first
            && let Err(error) = store.append(&name, epoch, 0, vec![Arc::new(event)]).await
        {
            // A map without its first event could never be opened.
            store.delete_map(&name).await?;
            return Err(error.into());
        }
        let flushed = store.follow(&name).await?;
        let snapshot = if is_empty { 0 } else { map.revision() };
        let start = Start::open(name, epoch, Arc::unwrap_or_clone(map), snapshot, flushed);
        self.start_created(claim, start, reservation).await
    }

    /// The account of the tenant of the map called `name`.
    pub(crate) fn tenant(&self, name: &str) -> Arc<Account> {
        self.inner.pool.accounts().tenant(tenant_of(name))
    }

    /// Creates a map in the store, empty or with content. An empty one without an engine is what a failed
    /// creation left and could not undo; nothing else is deleted.
    async fn create_stored(
        &self,
        name: &str,
        content: Option<&Arc<Map>>,
    ) -> Result<Epoch, EngineError> {
        let store = &self.inner.store;
        let create = async || store.create_map(name, content.cloned()).await;
        match create().await {
            Err(StoreError::MapExists { .. }) => {
                let (map, events) = stored(&**store, name).await?;
                if map.revision() > 0 || !events.is_empty() {
                    return Err(EngineError::MapExists { map: name.to_owned() });
                }
                store.delete_map(name).await?;
                Ok(create().await?)
            }
            epoch => Ok(epoch?),
        }
    }

    /// Starts the engine of a map that the store just created.
    async fn start_created(
        &self,
        mut claim: Claim,
        start: Start,
        reservation: Reservation,
    ) -> Result<MapInfo, EngineError> {
        let revision = start.map.revision();
        let handle = self.spawn(start, reservation);
        // The creation is answered only when no crash can undo it.
        if let Err(error) = handle.durable(revision).await {
            // If the creation cannot be undone, the name keeps a map that reports why it accepts
            // nothing.
            let undone = handle.call(|actor| actor.delete().boxed()).await.flatten();
            claim.set(undone.is_err().then_some(handle));
            return Err(error);
        }
        claim.set(Some(handle.clone()));
        // Callers find the map from here on.
        drop(claim);
        tracing::info!(map = handle.name(), "map created");
        handle.info().await
    }

    /// The map called `name`.
    ///
    /// # Errors
    /// [`EngineError::MapNotFound`].
    pub fn get(&self, name: &str) -> Result<MapHandle, EngineError> {
        self.inner.config.check_calls()?;
        let handle = self.inner.table.get(name);
        handle.ok_or_else(|| EngineError::MapNotFound { map: name.to_owned() })
    }

    /// The maps by name.
    pub fn list(&self) -> Vec<MapHandle> {
        self.inner.table.list()
    }

    /// Deletes a map with its journal; its streams and watchers end. Dropping the future does not stop
    /// a deletion that has begun.
    ///
    /// # Errors
    /// [`EngineError::MapNotFound`], [`EngineError::ShuttingDown`], [`EngineError::Store`].
    pub async fn delete(&self, name: &str) -> Result<(), EngineError> {
        self.look_elsewhere(name).await?;
        let mut claim = self.claim(name).await?;
        let Some(handle) = claim.map().cloned() else {
            return Err(EngineError::MapNotFound { map: name.to_owned() });
        };
        if handle.merged.is_some() {
            let (map, into) = (name.to_owned(), handle.name().to_owned());
            return Err(EngineError::MergedAway { map, into });
        }
        let maps = self.clone();
        run_to_end(async move {
            let deleted = handle.snapshot().await;
            handle.call(|actor| actor.delete().boxed()).await??;
            claim.set(None);
            drop(claim);
            maps.inner.table.forget(|map| map.merged.is_some() && map.is_same_map(&handle));
            if let Ok(deleted) = deleted {
                maps.release_merged(&deleted).await;
            }
            tracing::info!(map = handle.name(), "map deleted");
            Ok(())
        })
        .await
    }

    /// Claims a name for a change.
    pub(crate) async fn claim(&self, name: &str) -> Result<Claim, EngineError> {
        self.inner.config.check_calls()?;
        let claim = self.inner.table.claim(name).await;
        if self.inner.closing.load(Ordering::Acquire) {
            return Err(EngineError::ShuttingDown);
        }
        Ok(claim)
    }

    /// Which failures acknowledged items survive.
    pub fn durability(&self) -> Durability {
        self.inner.store.durability()
    }

    /// The meters of the engines.
    pub fn meters(&self) -> &Arc<EngineMeters> {
        &self.inner.meters
    }

    /// The maps and their queues as they are now.
    pub fn counts(&self) -> MapCounts {
        let mut counts = MapCounts::default();
        for handle in self.list() {
            let capacity = handle.items.max_capacity();
            let queued = capacity - handle.items.capacity().min(capacity);
            counts.add(&handle.shared, queued, capacity);
        }
        counts
    }

    /// The threads of the solves.
    pub fn pool(&self) -> &Arc<SolverPool> {
        &self.inner.pool
    }

    /// Finishes queued items and the solves that they start, then stops the engines and closes the
    /// store. Streams end with [`EngineError::ShuttingDown`]. Work that is not finished within
    /// `budget` is dropped; events that were accepted by then are made durable in any case.
    pub async fn shutdown(&self, budget: Duration) {
        self.inner.closing.store(true, Ordering::Release);
        let ends = async {
            // A map that is being created must have its engine first.
            self.inner.table.idle().await;
            let ends = self.list().into_iter().map(|handle| async move { handle.stop().await });
            futures_util::future::join_all(ends).await;
        };
        if tokio::time::timeout(budget, ends).await.is_err() {
            tracing::warn!("solves were still running, their results are dropped");
        }
        self.inner.store.close().await;
    }

    pub(crate) fn create_time_ns(&self) -> i64 {
        let now = unix_time_ns(&*self.inner.store);
        let last = &self.inner.last_create_time_ns;
        let later = |last: i64| Some(now.max(last.saturating_add(1)));
        match last.fetch_update(Ordering::AcqRel, Ordering::Acquire, later) {
            Ok(last) | Err(last) => now.max(last.saturating_add(1)),
        }
    }
}

/// Runs a change of a map in its own task, so that it continues if its caller stops waiting.
pub(crate) async fn run_to_end<T: Send + 'static>(
    change: impl Future<Output = Result<T, EngineError>> + Send + 'static,
) -> Result<T, EngineError> {
    match tokio::spawn(change.in_current_span().boxed()).await {
        Ok(outcome) => outcome,
        Err(error) if error.is_panic() => Err(report_bug(&format!("a change of a map: {error}"))),
        Err(_canceled) => Err(EngineError::ShuttingDown),
    }
}

/// The maps by name. Clones share the table.
#[derive(Clone, Default)]
pub(crate) struct Table(Arc<Mutex<BTreeMap<String, Entry>>>);

/// A name that is in use.
struct Entry {
    /// The map that callers find; `None` while it is being created.
    map: Option<MapHandle>,
    /// Closed when the change of the name has ended; `None` where it is not being changed.
    change: Option<watch::Receiver<()>>,
}

impl Table {
    /// The map called `name`; a map that is being deleted is found until its deletion has ended.
    pub(crate) fn get(&self, name: &str) -> Option<MapHandle> {
        self.0.lock().get(name).and_then(|entry| entry.map.clone())
    }

    /// The maps by name, each once.
    pub(crate) fn list(&self) -> Vec<MapHandle> {
        let maps = self.0.lock();
        let maps = maps.values().filter_map(|entry| entry.map.clone());
        maps.filter(|map| map.merged.is_none()).collect()
    }

    /// Names that lead to one map lead to another one.
    pub(crate) fn redirect(&self, from: &MapHandle, to: &MapHandle) {
        let mut entries = self.0.lock();
        let leading = entries.values_mut().filter_map(|entry| entry.map.as_mut());
        for map in leading.filter(|map| map.merged.is_some() && map.is_same_map(from)) {
            *map = map.redirected(to);
        }
    }

    /// Frees the names of maps that are no more: whose engine has ended by itself, or that led to one
    /// that is deleted.
    pub(crate) fn forget(&self, is_gone: impl Fn(&MapHandle) -> bool) {
        self.0.lock().retain(|_, entry| {
            entry.map.take_if(|map| is_gone(map));
            entry.map.is_some() || entry.change.is_some()
        });
    }

    /// Adds a map that was found in the store.
    pub(crate) fn insert(&self, map: MapHandle) {
        self.0.lock().insert(map.name().to_owned(), Entry { map: Some(map), change: None });
    }

    /// Claims a name for a change, once no other change of it runs.
    pub(crate) async fn claim(&self, name: &str) -> Claim {
        loop {
            let mut running = match self.try_claim(name) {
                Ok(claim) => return claim,
                Err(running) => running,
            };
            // The sender sends no value: it is dropped at the end of the change.
            let _ended = running.changed().await;
        }
    }

    /// Claims a name, or returns a receiver that closes when the running change has ended.
    fn try_claim(&self, name: &str) -> Result<Claim, watch::Receiver<()>> {
        let mut entries = self.0.lock();
        let map = match entries.get(name) {
            Some(Entry { change: Some(running), .. }) => return Err(running.clone()),
            Some(Entry { map, .. }) => map.clone(),
            None => None,
        };
        let (ended, change) = watch::channel(());
        entries.insert(name.to_owned(), Entry { map: map.clone(), change: Some(change) });
        let (table, name) = (self.clone(), name.to_owned());
        Ok(Claim { table, name, map, set: None, _ended: ended })
    }

    /// Resolves when no name is being changed.
    pub(crate) async fn idle(&self) {
        loop {
            let running = self.0.lock().values().find_map(|entry| entry.change.clone());
            let Some(mut running) = running else { return };
            let _ended = running.changed().await;
        }
    }
}

/// The claim of one change to a name; dropping it ends the change.
pub(crate) struct Claim {
    table: Table,
    name: String,
    /// The map that had the name when it was claimed.
    map: Option<MapHandle>,
    /// The map that has the name when the change ends, where the change sets one.
    set: Option<Option<MapHandle>>,
    _ended: watch::Sender<()>,
}

impl Claim {
    /// The name.
    pub(crate) fn name(&self) -> &str {
        &self.name
    }

    /// The map that had the name when it was claimed.
    pub(crate) fn map(&self) -> Option<&MapHandle> {
        self.map.as_ref()
    }

    /// Sets the map that has the name when the change ends; `None` makes the name free.
    pub(crate) fn set(&mut self, map: Option<MapHandle>) {
        self.set = Some(map);
    }
}

impl Drop for Claim {
    fn drop(&mut self) {
        let mut entries = self.table.0.lock();
        let Some(entry) = entries.get_mut(&self.name) else { return };
        entry.change = None;
        if let Some(map) = self.set.take() {
            entry.map = map;
        }
        if entry.map.is_none() {
            entries.remove(&self.name);
        }
    }
}
