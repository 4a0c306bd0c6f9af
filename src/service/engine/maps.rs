//! All maps of a server.
//!
//! The store decides which names are taken; the table holds the engines that run. A creation or
//! deletion that has begun runs to its end in a task of its own, whoever still waits for it: cut off
//! halfway it would leave a name that is neither free nor a map. A map whose journal is damaged or does
//! not replay opens poisoned at the last revision that does, so that it can be read and exported; the
//! others are not held up by it.

use std::fmt;
use std::sync::atomic::{AtomicBool, AtomicI64, Ordering};
use std::sync::{Arc, OnceLock};
use std::time::Duration;

use sha2::{Digest as _, Sha256};
use tokio::sync::{Semaphore, mpsc, watch};
use tracing::Instrument;

use super::account::HeldEntities;
use super::actor::{Actor, report_bug};
use super::durable::{DurableAcks, Snapshots};
use super::handle::{Control, Shared};
use super::history;
use super::items::{Unsolved, unsolved};
use super::journal::{replay, stored, unix_time_ns};
use super::meters::ConditionCell;
use super::schedule::Schedule;
use super::streams::Streams;
use super::table::{Claim, Table};
use super::watch::Watchers;
use super::{
    EngineConfig, EngineError, EngineMeters, MapCounts, MapHandle, MapInfo, MapState, Reservation,
    Resource, SolverPool, tenant_of,
};
use crate::map::{Change, Event, Map, MapPolicy};
use crate::store::{Durability, Epoch, Flushed, Store, StoreError};

/// Control messages that wait; the engine answers them at once.
const CONTROL_QUEUE: usize = 64;

/// All maps of a server. Cheap to clone.
#[derive(Clone)]
pub struct Maps {
    inner: Arc<Inner>,
}

struct Inner {
    store: Arc<dyn Store>,
    pool: Arc<SolverPool>,
    config: EngineConfig,
    meters: Arc<EngineMeters>,
    table: Table,
    closing: AtomicBool,
    /// The turns of watchers who read a journal.
    history: Arc<Semaphore>,
    /// Creation times rise strictly, because uids are made of them.
    last_create_time_ns: AtomicI64,
}

impl fmt::Debug for Maps {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Maps").field("config", &self.inner.config).finish_non_exhaustive()
    }
}

/// When a map for which the system had nothing left is opened again: after this time, then each time
/// twice as long, up to the longest.
const FIRST_OPENING: Duration = Duration::from_millis(100);
const LONGEST_OPENING: Duration = Duration::from_secs(5);

/// What an engine starts from.
struct Start {
    name: String,
    epoch: Epoch,
    map: Map,
    state: MapState,
    refusal: Option<EngineError>,
    /// Why it could not be opened.
    unopened: Option<EngineError>,
    /// Revision of the snapshot that it was made from.
    snapshot: i64,
    unsolved: Vec<Unsolved>,
    flushed: watch::Receiver<Flushed>,
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
            history: Arc::new(Semaphore::new(history::READERS)),
            last_create_time_ns: AtomicI64::new(0),
        };
        Self { inner: Arc::new(inner) }
    }

    /// The maps of a store, open.
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
    /// cannot be opened answers with the reason and holds up no other. Where the system had no
    /// descriptors for it, it is opened later.
    ///
    /// # Errors
    /// [`EngineError::Store`] when the store cannot be read.
    pub async fn load(&self) -> Result<(), EngineError> {
        for name in self.inner.store.list_maps().await? {
            self.reopen(name).await;
        }
        Ok(())
    }

    async fn reopen(&self, name: String) {
        let start = match self.load_map(&name).await {
            Ok(Some(start)) => start,
            Ok(None) => return,
            Err(error) => {
                tracing::error!(map = name, %error, "a map cannot be opened");
                if let StoreError::Unavailable { .. } = error {
                    self.open_later(name.clone());
                }
                let error = EngineError::Store(error);
                Start {
                    name,
                    epoch: Epoch::default(),
                    map: Map::new(),
                    state: MapState::Poisoned,
                    refusal: Some(error.clone()),
                    unopened: Some(error),
                    snapshot: 0,
                    unsolved: Vec::new(),
                    flushed: watch::channel(Flushed::default()).1,
                }
            }
        };
        self.inner.table.insert(self.spawn_existing(start));
    }

    /// The engine of a map that exists: ceilings close none.
    fn spawn_existing(&self, start: Start) -> MapHandle {
        let tenant = self.inner.pool.accounts().tenant(tenant_of(&start.name));
        self.spawn(start, tenant.reserve_existing(Resource::Maps, 1))
    }

    /// Tries to open a map until the system has what it takes, the map is deleted, or it fails for
    /// another reason.
    fn open_later(&self, name: String) {
        let maps = self.clone();
        tokio::spawn(async move {
            let mut wait = FIRST_OPENING;
            loop {
                tokio::time::sleep(wait).await;
                wait = (2 * wait).min(LONGEST_OPENING);
                let Ok(mut claim) = maps.claim(&name).await else { return };
                let unopened = claim.map().filter(|map| map.shared.unopened.is_some()).cloned();
                let Some(unopened) = unopened else { return };
                let start = match maps.load_map(&name).await {
                    Err(StoreError::Unavailable { .. }) => continue,
                    Err(error) => {
                        tracing::error!(map = name, %error, "a map cannot be opened");
                        return;
                    }
                    Ok(start) => start,
                };
                unopened.stop().await;
                claim.set(start.map(|start| maps.spawn_existing(start)));
                tracing::info!(map = name, "a map could be opened at last");
                return;
            }
        });
    }

    /// Brings a map back; `None` for one whose creation was never answered.
    async fn load_map(&self, name: &str) -> Result<Option<Start>, StoreError> {
        let store = &self.inner.store;
        let epoch = store.acquire(name).await?;
        let (map, events) = stored(&**store, name).await?;
        let damage = store.damage(name).await?;
        let snapshot = map.revision();
        if snapshot == 0 && events.is_empty() && damage.is_empty() {
            tracing::warn!(map = name, "a map without events is removed");
            store.delete_map(name).await?;
            return Ok(None);
        }
        let (map, stopped) = replay(map, events.iter().map(AsRef::as_ref));
        for damage in &damage {
            tracing::error!(map = name, %damage, "damage on disk");
        }
        let flushed = store.follow(name).await?;
        let lost = damage.into_iter().find(|damage| damage.lost.is_some());
        let reached = u64::try_from(map.revision()).unwrap_or(0);
        let Flushed { through, failed, unavailable } = flushed.borrow().clone();
        // What could not be brought to the disk yet lies ahead of what is durable.
        let is_settled = failed.is_none() && unavailable.is_none();
        let is_short = store.durability() != Durability::Memory
            && (reached < through || (is_settled && reached != through));
        let refusal = lost
            .map(|damage| StoreError::Damaged { map: name.to_owned(), damage })
            .or(failed)
            .map(EngineError::Store);
        let state = match &stopped {
            Some(details) => {
                report_bug(&format!("map {name:?} does not replay: {details}"));
                MapState::Poisoned
            }
            None if is_short => {
                report_bug(&format!("map {name:?} replays to {reached} of {through} events"));
                MapState::Poisoned
            }
            None if refusal.is_some() => MapState::Poisoned,
            None => MapState::Open,
        };
        let unsolved = match state {
            MapState::Open => unsolved(&map, &events),
            MapState::Poisoned => Vec::new(),
        };
        Ok(Some(Start {
            name: name.to_owned(),
            epoch,
            map,
            state,
            refusal,
            unopened: None,
            snapshot,
            unsolved,
            flushed,
        }))
    }

    /// Creates a map. Dropping the future does not undo or stop a creation that has begun.
    ///
    /// # Errors
    /// [`EngineError::MapExists`], [`EngineError::TenantCeiling`], [`EngineError::ServerCeiling`],
    /// [`EngineError::ShuttingDown`], [`EngineError::Store`].
    pub async fn create(
        &self,
        name: &str,
        display_name: &str,
        policy: MapPolicy,
    ) -> Result<MapInfo, EngineError> {
        let claim = self.claim(name).await?;
        if let Some(handle) = claim.map().cloned() {
            drop(claim);
            // Whoever is told that it exists relies on it as its creator does.
            handle.durable(1).await?;
            return Err(EngineError::MapExists { map: name.to_owned() });
        }
        let (maps, display_name) = (self.clone(), display_name.to_owned());
        run_to_end(async move { maps.create_claimed(claim, display_name, policy).await }).await
    }

    /// Creates a map whose name is claimed, and free.
    async fn create_claimed(
        &self,
        mut claim: Claim,
        display_name: String,
        policy: MapPolicy,
    ) -> Result<MapInfo, EngineError> {
        let (store, name) = (&self.inner.store, claim.name().to_owned());
        // Held while the map is being created; given back if that fails.
        let tenant = self.inner.pool.accounts().tenant(tenant_of(&name));
        let place = tenant.reserve(Resource::Maps, 1)?;
        let epoch = match store.create_map(&name).await {
            // No engine has it: it is what a creation left that failed and could not be undone.
            Err(StoreError::MapExists { .. }) => {
                store.delete_map(&name).await?;
                store.create_map(&name).await?
            }
            epoch => epoch?,
        };
        let create_time_ns = self.create_time_ns();
        let change = Change::Created { policy, create_time_ns, display_name };
        let event = Event { revision: 1, time_ns: create_time_ns, cause: None, change };
        let mut map = Map::new();
        if let Err(error) = map.apply(&event) {
            return Err(EngineError::Journal { map: name, error });
        }
        if let Err(error) = store.append(&name, epoch, 0, vec![Arc::new(event)]).await {
            // A map without its first event could never be opened.
            store.delete_map(&name).await?;
            return Err(error.into());
        }
        let flushed = store.follow(&name).await?;
        let start = Start {
            name,
            epoch,
            map,
            state: MapState::Open,
            refusal: None,
            unopened: None,
            snapshot: 0,
            unsolved: Vec::new(),
            flushed,
        };
        let handle = self.spawn(start, place);
        // A map is answered only when no crash takes it back.
        if let Err(error) = handle.durable(1).await {
            // Where it cannot be undone, the name stands for a map that tells why it takes nothing.
            let undone = handle.call(|reply| Control::Delete { reply }).await.flatten();
            claim.set(undone.is_err().then_some(handle));
            return Err(error);
        }
        claim.set(Some(handle.clone()));
        // Callers find it from here on.
        drop(claim);
        tracing::info!(map = handle.name(), "map created");
        handle.info().await
    }

    /// The map called `name`.
    ///
    /// # Errors
    /// [`EngineError::MapNotFound`].
    pub fn get(&self, name: &str) -> Result<MapHandle, EngineError> {
        self.check_fault()?;
        let handle = self.inner.table.get(name);
        handle.ok_or_else(|| EngineError::MapNotFound { map: name.to_owned() })
    }

    /// The maps by name.
    #[must_use]
    pub fn list(&self) -> Vec<MapHandle> {
        self.inner.table.list()
    }

    /// Deletes a map with its journal; its streams and watchers end. Dropping the future does not stop
    /// a deletion that has begun.
    ///
    /// # Errors
    /// [`EngineError::MapNotFound`], [`EngineError::ShuttingDown`], [`EngineError::Store`].
    pub async fn delete(&self, name: &str) -> Result<(), EngineError> {
        let mut claim = self.claim(name).await?;
        let Some(handle) = claim.map().cloned() else {
            return Err(EngineError::MapNotFound { map: name.to_owned() });
        };
        run_to_end(async move {
            handle.call(|reply| Control::Delete { reply }).await??;
            claim.set(None);
            drop(claim);
            tracing::info!(map = handle.name(), "map deleted");
            Ok(())
        })
        .await
    }

    /// Claims a name for a change.
    async fn claim(&self, name: &str) -> Result<Claim, EngineError> {
        self.check_fault()?;
        let claim = self.inner.table.claim(name).await;
        if self.inner.closing.load(Ordering::Acquire) {
            return Err(EngineError::ShuttingDown);
        }
        Ok(claim)
    }

    /// What acknowledged items withstand.
    #[must_use]
    pub fn durability(&self) -> Durability {
        self.inner.store.durability()
    }

    /// What the engines count.
    #[must_use]
    pub fn meters(&self) -> &Arc<EngineMeters> {
        &self.inner.meters
    }

    /// The maps and their queues as they are now.
    #[must_use]
    pub fn counts(&self) -> MapCounts {
        let mut counts = MapCounts::default();
        for handle in self.list() {
            counts.add(&handle);
        }
        counts
    }

    /// The threads of the solves.
    #[must_use]
    pub fn pool(&self) -> &Arc<SolverPool> {
        &self.inner.pool
    }

    /// Finishes queued items and the solves that they start, then stops the engines and closes the
    /// store. Streams end with [`EngineError::ShuttingDown`]. What is not finished within `budget` is
    /// dropped; what was accepted by then is made durable in any case.
    pub async fn shutdown(&self, budget: Duration) {
        self.inner.closing.store(true, Ordering::Release);
        let ends = async {
            // A map that is being created gets its engine first.
            self.inner.table.idle().await;
            let ends = self.list().into_iter().map(|handle| async move { handle.stop().await });
            futures_util::future::join_all(ends).await;
        };
        if tokio::time::timeout(budget, ends).await.is_err() {
            tracing::warn!("solves were still running, their results are dropped");
        }
        self.inner.store.close().await;
    }

    fn spawn(&self, start: Start, place: Reservation) -> MapHandle {
        let Inner { store, pool, config, .. } = &*self.inner;
        let (item_queue, items) = mpsc::channel(config.queue_capacity.max(1));
        let (control_queue, control) = mpsc::channel(CONTROL_QUEUE);
        let shared = Arc::new(Shared {
            uid: match start.unopened {
                Some(_) => String::new(),
                None => uid(&start.name, start.map.create_time_ns()),
            },
            account: pool.accounts().of_map(&start.name),
            name: start.name,
            config: *config,
            meters: Arc::clone(&self.inner.meters),
            condition: ConditionCell::new(start.state, start.refusal.is_some()),
            store: Arc::clone(store),
            history: Arc::clone(&self.inner.history),
            flushed: start.flushed.clone(),
            ended: OnceLock::new(),
            unopened: start.unopened,
        });
        let span = tracing::info_span!("map", map = %shared.name);
        let actor = Actor {
            shared: Arc::clone(&shared),
            config: *config,
            store: Arc::clone(store),
            pool: Arc::clone(pool),
            _place: place,
            entities: HeldEntities::existing(&shared.account, start.map.usage()),
            journal: shared.account.reserve_existing(Resource::JournalBytes, 0),
            store_epoch: start.epoch,
            last_solve_id: start.map.solve_count(),
            map: Arc::new(start.map),
            state: start.state,
            refusal: start.refusal,
            durable: DurableAcks::new(start.flushed),
            snapshots: Snapshots::new(start.snapshot),
            applying: None,
            items,
            control,
            streams: Streams::default(),
            watchers: Watchers::new(),
            schedule: Schedule::default(),
            running: None,
            job: None,
            unsolved: start.unsolved,
            drained: false,
            answered: false,
            closing: Vec::new(),
        };
        tokio::spawn(actor.run().instrument(span));
        MapHandle { shared, items: item_queue, control: control_queue }
    }

    fn create_time_ns(&self) -> i64 {
        let now = unix_time_ns();
        let last = &self.inner.last_create_time_ns;
        let later = |last: i64| Some(now.max(last.saturating_add(1)));
        match last.fetch_update(Ordering::AcqRel, Ordering::Acquire, later) {
            Ok(last) | Err(last) => now.max(last.saturating_add(1)),
        }
    }

    fn check_fault(&self) -> Result<(), EngineError> {
        if self.inner.config.fails_calls() {
            return Err(report_bug("staged by a test"));
        }
        Ok(())
    }
}

/// Runs a change of a map in a task of its own: a caller that stops waiting does not cut it off.
async fn run_to_end<T: Send + 'static>(
    change: impl Future<Output = Result<T, EngineError>> + Send + 'static,
) -> Result<T, EngineError> {
    match tokio::spawn(change.in_current_span()).await {
        Ok(outcome) => outcome,
        Err(error) if error.is_panic() => Err(report_bug(&format!("a change of a map: {error}"))),
        Err(_canceled) => Err(EngineError::ShuttingDown),
    }
}

/// Half a SHA-256 of name and creation time, in hex: the same after a restart, another for a map
/// that was deleted and made again.
fn uid(name: &str, create_time_ns: i64) -> String {
    let mut hash = Sha256::new();
    hash.update(create_time_ns.to_le_bytes());
    hash.update(name.as_bytes());
    hash.finalize().iter().take(16).map(|byte| format!("{byte:02x}")).collect()
}
