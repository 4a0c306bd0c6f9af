//! Durability: the map's journal, its DURABLE acks and its snapshots.
//!
//! The engine does not wait for fsync: an event is appended, applied and acknowledged as RECEIVED.
//! Its DURABLE ack waits here until the journal reports that the event is on disk. Watchers get no
//! change that a crash could still undo (`MapHandle::durable`). When the journal fails, events that are
//! applied but not durable get no DURABLE ack.

pub(crate) mod history;

use std::collections::{BTreeMap, VecDeque};
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::Arc;
use std::time::UNIX_EPOCH;

use futures_util::FutureExt;
use futures_util::future::BoxFuture;
use tokio::sync::watch;
use tokio::task::JoinHandle;

use self::history::Moment;
use crate::map::{ClientIndex, Event, Map};
use crate::service::engine::context::MapContext;
use crate::service::engine::events::Permit;
use crate::service::engine::pool::{SolverPool, panic_message};
use crate::service::engine::{Ack, AckStatus, PastState, Reservation, Resource, StreamEvent};
use crate::store::{Epoch, Flushed, Position, Store, StoreError};

/// Number of events after which a failed snapshot is tried again.
const RETRY_EVENTS: i64 = 1000;

/// The journal of a map, and what waits for it.
pub(crate) struct Journal {
    shared: Arc<MapContext>,
    /// The store's epoch, which fences other writers.
    epoch: Epoch,
    /// Bytes of the journal that wait for the disk.
    bytes: Reservation,
    flushed: watch::Receiver<Flushed>,
    /// Whether the journal reports no more; then nothing further becomes durable.
    closed: bool,
    /// Outstanding DURABLE acks.
    waiting: VecDeque<(ClientIndex, Ack, Permit)>,
    /// Revision of the last complete snapshot; 0 without one.
    kept: i64,
    /// Writes a snapshot and returns the revision of the last complete one.
    snapshot: Option<JoinHandle<i64>>,
    /// The next snapshot is not written before this revision.
    not_before: i64,
}

impl Journal {
    /// `kept` is the revision of the snapshot that the map was loaded from.
    pub(crate) fn new(shared: &Arc<MapContext>, epoch: Epoch, kept: i64) -> Self {
        Self {
            shared: Arc::clone(shared),
            epoch,
            bytes: shared.account.reserve_existing(Resource::JournalBytes, 0),
            flushed: shared.flushed.clone(),
            closed: false,
            waiting: VecDeque::new(),
            kept,
            snapshot: None,
            not_before: 0,
        }
    }

    /// Appends an event to the journal. A large one is encoded on another thread, unless the
    /// journal has no room at the moment.
    pub(crate) async fn append(
        &mut self,
        event: Arc<Event>,
        is_large: bool,
        pool: &SolverPool,
    ) -> Result<Position, StoreError> {
        let (shared, epoch) = (Arc::clone(&self.shared), self.epoch);
        let sequence = sequence_of(event.revision - 1);
        let position = if is_large {
            let mut append = async move {
                shared.store.append(&shared.name, epoch, sequence, vec![event]).await
            }
            .boxed();
            let begun = pool.compute(move || ((&mut append).now_or_never(), append)).await;
            match begun {
                (Some(appended), _) => appended?,
                (None, append) => append.await?,
            }
        } else {
            shared.store.append(&shared.name, epoch, sequence, vec![event]).await?
        };
        self.bytes.count(position.waiting_bytes);
        Ok(position)
    }

    /// Whether every DURABLE ack was sent.
    pub(crate) fn all_acks_sent(&self) -> bool {
        self.waiting.is_empty()
    }

    /// Acknowledges an item once the journal is durable up to `revision`.
    pub(crate) fn acknowledge_when_durable(
        &mut self,
        client: ClientIndex,
        sequence: i64,
        revision: i64,
        permit: Permit,
    ) {
        let ack = Ack { sequence, revision, status: AckStatus::Durable };
        // Waiting acks are sent first. If this event is durable, theirs are too, and `progress`
        // wakes for them.
        if self.reaches(revision) && self.waiting.is_empty() {
            permit.is_durable();
            permit.send(StreamEvent::Ack(ack));
        } else if !self.closed {
            self.waiting.push_back((client, ack, permit));
        }
    }

    /// Whether the journal is durable up to `revision`.
    fn reaches(&self, revision: i64) -> bool {
        self.flushed.borrow().through >= sequence_of(revision)
    }

    /// Resolves when the journal has made progress or failed.
    pub(crate) async fn progress(&mut self) {
        if self.closed {
            return std::future::pending().await;
        }
        if self.flushed.changed().await.is_err() {
            self.closed = true;
            self.waiting.clear();
        }
    }

    /// Sends the acks that are due for a map at `revision`: for each client the last one, which
    /// covers all before it. Returns the error of a journal that has failed.
    pub(crate) fn acknowledge(&mut self, revision: i64) -> Option<StoreError> {
        if self.reaches(revision) {
            self.bytes.count(0);
        }
        let Flushed { through, failed, unavailable: _ } = self.flushed.borrow_and_update().clone();
        let mut last = BTreeMap::new();
        while let Some((client, ack, permit)) =
            self.waiting.pop_front_if(|(_, ack, _)| sequence_of(ack.revision) <= through)
        {
            permit.is_durable();
            last.insert(client, (ack, permit));
        }
        for (ack, permit) in last.into_values() {
            permit.send(StreamEvent::Ack(ack));
        }
        if failed.is_some() {
            self.waiting.clear();
        }
        failed
    }

    /// Drops the DURABLE acks of streams that are ended.
    pub(crate) fn drop_acks(&mut self) {
        self.waiting.clear();
    }

    /// Starts a snapshot of the map as it is, unless one is being written.
    pub(crate) fn keep_snapshot(&mut self, map: &Arc<Map>) {
        let revision = map.revision();
        match self.snapshot.take() {
            Some(running) if !running.is_finished() => {
                self.snapshot = Some(running);
                return;
            }
            Some(ended) => {
                if let Some(Ok(kept)) = ended.now_or_never() {
                    self.kept = kept;
                }
            }
            None => {}
        }
        if revision < self.not_before {
            return;
        }
        self.not_before = revision.saturating_add(RETRY_EVENTS);
        let (shared, epoch, map) = (Arc::clone(&self.shared), self.epoch, Arc::clone(map));
        let kept = self.kept;
        self.snapshot = Some(tokio::spawn(async move {
            let store = &shared.store;
            if let Err(error) = store.put_snapshot(&shared.name, epoch, map).await {
                tracing::warn!(%error, "no snapshot was written, the journal continues to grow");
                return kept;
            }
            // The previous snapshot is kept, with all events after it.
            if let Err(error) = store.truncate(&shared.name, epoch, sequence_of(kept) + 1).await {
                tracing::warn!(%error, "the journal was not truncated");
            }
            tracing::debug!(revision, "snapshot written");
            revision
        }));
    }

    /// Keeps a snapshot of the map as it was, unless there is a later one. It is done when the disk has it and
    /// it was read back.
    pub(crate) fn snapshot_of(&self, map: Arc<Map>) -> BoxFuture<'static, Result<(), StoreError>> {
        let (shared, epoch) = (Arc::clone(&self.shared), self.epoch);
        async move { shared.store.put_snapshot(&shared.name, epoch, map).await }.boxed()
    }

    /// Starts to keep a snapshot of the map as it is and to drop the journal before it.
    pub(crate) fn drop_journal(&self, map: &Arc<Map>) -> JoinHandle<Result<(), StoreError>> {
        let (shared, epoch, map) = (Arc::clone(&self.shared), self.epoch, Arc::clone(map));
        tokio::spawn(async move {
            let (store, through) = (&shared.store, sequence_of(map.revision()));
            store.put_snapshot(&shared.name, epoch, map).await?;
            store.truncate(&shared.name, epoch, through + 1).await
        })
    }

    /// The map at `revision`, replayed from the journal; `None` if it cannot be.
    pub(crate) async fn restored(&self, revision: i64) -> Option<Map> {
        let (store, name) = (&*self.shared.store, &self.shared.name);
        let (moment, newest) = (Moment::Revision(revision), PastState { revision, time_ns: 0 });
        history::map_at(store, name, moment, newest, |_map| Ok(())).await.ok()
    }
}

/// The newest snapshot of a map, or an empty map, and the events after it.
///
/// # Errors
/// [`StoreError`].
pub(crate) async fn stored(
    store: &dyn Store,
    name: &str,
) -> Result<(Map, Vec<Arc<Event>>), StoreError> {
    let snapshot = store.get_snapshot(name).await?;
    let map = snapshot.map(Arc::unwrap_or_clone).unwrap_or_default();
    let events = store.read(name, sequence_of(map.revision())).await?;
    Ok((map, events))
}

/// The event at which a replay ended.
pub(crate) struct Stopped {
    sequence: u64,
    kind: &'static str,
    reason: String,
}

impl Stopped {
    /// Why the map takes no changes.
    pub(crate) fn of(&self, map: &str) -> StoreError {
        let Self { sequence, kind, reason } = self;
        let (map, reason) = (map.to_owned(), reason.clone());
        StoreError::Unfit { map, sequence: *sequence, kind, reason }
    }
}

/// Applies events one by one until one is refused or panics; the second value then says which, and why.
pub(crate) fn replay<'a>(
    mut map: Map,
    events: impl Iterator<Item = &'a Event>,
) -> (Map, Option<Stopped>) {
    for event in events {
        // A refused event changes nothing; only a panic may leave an event half applied.
        let reason = match catch_unwind(AssertUnwindSafe(|| map.apply(event))) {
            Ok(Ok(())) => continue,
            Ok(Err(error)) => error.to_string(),
            Err(panic) => panic_message(panic.as_ref()),
        };
        let (sequence, kind) = (sequence_of(event.revision), event.change.name());
        return (map, Some(Stopped { sequence, kind, reason }));
    }
    (map, None)
}

/// The sequence of a revision in the journal; 0 before the first event.
pub(crate) fn sequence_of(revision: i64) -> u64 {
    u64::try_from(revision).unwrap_or(0)
}

/// Nanoseconds since 1970 by the store's clock; 0 for earlier times.
pub(crate) fn unix_time_ns(store: &dyn Store) -> i64 {
    let since = store.now().duration_since(UNIX_EPOCH).unwrap_or_default();
    i64::try_from(since.as_nanos()).unwrap_or(i64::MAX)
}
