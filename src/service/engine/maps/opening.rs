//! Opens maps: loads them from the store and starts their engines.
//!
//! A map whose journal is damaged or cannot be replayed opens poisoned at the last revision that
//! can be replayed, so that it can be read and exported. A map that cannot be opened answers calls
//! with the reason; if the system lacked resources, it is tried again. It does not delay the other
//! maps. Nothing is repaired here: that is done by the store, or by `covis doctor`.

use std::sync::atomic::AtomicBool;
use std::sync::{Arc, OnceLock};
use std::time::Duration;

use tokio::sync::{mpsc, watch};
use tracing::Instrument;

use crate::map::Map;
use crate::service::engine::actor::Actor;
use crate::service::engine::context::{Condition, MapContext};
use crate::service::engine::error::report_bug;
use crate::service::engine::ingest::Ingest;
use crate::service::engine::journal::{Journal, replay, sequence_of, stored};
use crate::service::engine::maps::Inner;
use crate::service::engine::merged_name::uid;
use crate::service::engine::recognition::Recognition;
use crate::service::engine::solving::Solving;
use crate::service::engine::solving::after_closures::Background;
use crate::service::engine::watching::Watching;
use crate::service::engine::{EngineError, MapHandle, Maps, Reservation, Resource};
use crate::store::{self, Epoch, Flushed, StoreError};
use crate::sync::Mutex;

/// Most requests that wait; the engine answers them at once.
const REQUEST_QUEUE: usize = 64;
/// Delay until a map is opened again after the system lacked resources. It doubles with each
/// attempt, up to [`LONGEST_OPENING`].
const FIRST_OPENING: Duration = Duration::from_millis(100);
const LONGEST_OPENING: Duration = Duration::from_secs(5);

/// The state that an engine starts from.
pub(crate) struct Start {
    pub(crate) name: String,
    pub(crate) epoch: Epoch,
    pub(crate) map: Map,
    pub(crate) condition: Condition,
    /// Why it could not be opened.
    pub(crate) unopened: Option<EngineError>,
    /// Revision of the snapshot that it was loaded from.
    pub(crate) snapshot: i64,
    pub(crate) flushed: watch::Receiver<Flushed>,
}

impl Start {
    /// A map that accepts changes; `snapshot` is the revision of the snapshot that the store has of it.
    pub(crate) fn open(
        name: String,
        epoch: Epoch,
        map: Map,
        snapshot: i64,
        flushed: watch::Receiver<Flushed>,
    ) -> Self {
        let (condition, unopened) = (Condition::Open, None);
        Self { name, epoch, map, condition, unopened, snapshot, flushed }
    }
}

impl Maps {
    /// Opens a map that the store holds.
    pub(crate) async fn reopen(&self, name: String) {
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
                    condition: Condition::Damaged(error.clone()),
                    unopened: Some(error),
                    snapshot: 0,
                    flushed: watch::channel(Flushed::default()).1,
                }
            }
        };
        self.inner.table.insert(self.spawn_existing(start));
    }

    /// Starts the engine of an existing map, even above the limits.
    pub(crate) fn spawn_existing(&self, start: Start) -> MapHandle {
        let reservation = self.tenant(&start.name).reserve_existing(Resource::Maps, 1);
        self.spawn(start, reservation)
    }

    /// Tries to open a map until the system has the resources, the map is deleted, or opening fails
    /// for another reason.
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
                let opened = start.map(|start| maps.spawn_existing(start));
                claim.set(opened.clone());
                drop(claim);
                if let Some(opened) = opened {
                    maps.lead_merged(&opened).await;
                }
                tracing::info!(map = name, "a map could finally be opened");
                return;
            }
        });
    }

    /// Loads a map; `None` for a map whose creation was never answered.
    pub(crate) async fn load_map(&self, name: &str) -> Result<Option<Start>, StoreError> {
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
        let reached = sequence_of(map.revision());
        let Flushed { through, failed, unavailable } = flushed.borrow().clone();
        // Events that could not be written to the disk yet are newer than what is durable.
        let is_written = failed.is_none() && unavailable.is_none();
        let is_short = store.durability() != store::Durability::Memory
            && (reached < through || (is_written && reached != through));
        if let Some(stopped) = &stopped {
            tracing::error!(map = name, error = %stopped.of(name), "a journal does not replay");
        } else if is_short && lost.is_none() {
            report_bug(&format!("map {name:?} replays to {reached} of {through} events"));
        }
        let refusal = lost
            .map(|damage| StoreError::Damaged { map: name.to_owned(), damage })
            .or(stopped.map(|stopped| stopped.of(name)))
            .or(failed)
            .map(EngineError::Store);
        let condition = match refusal {
            Some(refusal) => Condition::Damaged(refusal),
            None if is_short => Condition::Poisoned,
            None => Condition::Open,
        };
        let start = Start::open(name.to_owned(), epoch, map, snapshot, flushed);
        Ok(Some(Start { condition, ..start }))
    }

    /// Starts the engine of a map.
    pub(crate) fn spawn(&self, start: Start, reservation: Reservation) -> MapHandle {
        let Inner { store, pool, config, .. } = &*self.inner;
        let (item_queue, items) = mpsc::channel(config.queue_capacity.max(1));
        let (request_queue, requests) = mpsc::channel(REQUEST_QUEUE);
        let shared = Arc::new(MapContext {
            uid: match start.unopened {
                Some(_) => String::new(),
                None => uid(&start.name, start.map.create_time_ns()),
            },
            account: pool.accounts().of_map(&start.name),
            name: start.name,
            config: *config,
            meters: Arc::clone(&self.inner.meters),
            condition: Mutex::new(start.condition),
            frozen: AtomicBool::new(start.map.is_frozen()),
            moving: AtomicBool::new(false),
            store: Arc::clone(store),
            history: Arc::clone(&self.inner.history),
            pairs: Arc::default(),
            places: Arc::default(),
            flushed: start.flushed,
            ended: OnceLock::new(),
            unopened: start.unopened,
        });
        let span = tracing::info_span!("map", map = %shared.name);
        let actor = Actor {
            shared: Arc::clone(&shared),
            pool: Arc::clone(pool),
            _reservation: reservation,
            ingest: Ingest::new(&shared, items, &start.map),
            journal: Journal::new(&shared, start.epoch, start.snapshot),
            solving: Solving::new(&shared, pool, start.map.solve_count()),
            recognition: Recognition::new(&shared, pool),
            background: Background::new(&shared, pool),
            watching: Watching::default(),
            map: Arc::new(start.map),
            applying: None,
            requests,
            has_pending_solves: shared.check_open().is_ok(),
            is_settled: false,
            handled: 0,
            answered: false,
            closing: Vec::new(),
        };
        let meters = Arc::clone(&shared.meters);
        let running = meters.measure(actor.run()).instrument(span);
        let (maps, ended) = (Arc::downgrade(&self.inner), Arc::downgrade(&shared));
        tokio::spawn(async move {
            running.await;
            if let (Some(maps), Some(ended)) = (maps.upgrade(), ended.upgrade())
                && ended.is_elsewhere()
            {
                maps.table.forget(|map| Arc::ptr_eq(&map.shared, &ended));
            }
        });
        MapHandle { shared, items: item_queue, requests: request_queue, merged: None }
    }
}
