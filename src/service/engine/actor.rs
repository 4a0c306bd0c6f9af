//! The task that owns a map: its loop, which hands events from one part to another.
//!
//! The parts are [`Ingest`], [`Durability`], [`Solving`], [`Recognition`], [`Background`] and
//! [`Watching`]; each owns its state, and none knows another. Each step handles one of these, in this
//! order of priority: a request, the end of a solve, the end of a search for places, the end
//! of a background task, progress of the journal, an item. After a request, the others have priority for one step, so that constant requests of readers cannot block writers. In lock-step
//! the task accepts no item while a solve, a search or a background task runs or waits.
//!
//! The journal accepts an event before the event changes the map, and makes it durable while the
//! task continues. Steps run under `catch_unwind`: a panic poisons only this map. If it may have left
//! an event half applied, the map is replayed from the journal. A panic in a solve, a search or a background
//! task that runs on the pool has touched a copy alone, and costs no more than that work.

use std::panic::{AssertUnwindSafe, catch_unwind, resume_unwind};
use std::sync::Arc;
use std::sync::atomic::Ordering;

use futures_util::FutureExt;
use tokio::sync::{mpsc, oneshot};
use tracing::Instrument;

use super::background::Background;
use super::durability::{Durability, unix_time_ns};
use super::error::report_bug;
use super::handle::{Request, Shared};
use super::ingest::Ingest;
use super::pool::{SolvePanicked, panic_message};
use super::recognition::Recognition;
use super::solve::Job;
use super::solving::Solving;
use super::touched::{Touched, size_of_change};
use super::watching::Watching;
use super::{
    EngineError, Fault, IngestStream, MapHandle, MapInfo, MapState, Opened, Reservation, Resource,
    SolverPool, Watch,
};
use crate::map::{Cause, Change, ClientIndex, Event, Map};
use crate::store::{Position, StoreError};

/// Most entities of an item or an event that are handled on the task's own thread; a fold takes
/// about 0.4 µs for each, and the check of an item half of that. Larger ones are handled on a
/// blocking thread. After this many the task lets others run.
pub(super) const SMALL: usize = 512;

/// The cost of a step besides that of its entities, in entities.
pub(super) const STEP: usize = 16;

/// A leaf of the map that a reader holds too is copied when it changes: so many times the work.
const COPIED: usize = 4;

/// A map and its only writer.
pub(super) struct Actor {
    pub(super) shared: Arc<Shared>,
    pub(super) pool: Arc<SolverPool>,
    /// Counts the map in the account of its tenant until it is dropped.
    pub(super) _reservation: Reservation,
    pub(super) map: Arc<Map>,
    /// The revision before the event that is being applied. While it is set, a panic may leave an
    /// event half applied.
    pub(super) applying: Option<i64>,
    pub(super) ingest: Ingest,
    pub(super) durability: Durability,
    pub(super) solving: Solving,
    pub(super) recognition: Recognition,
    pub(super) background: Background,
    pub(super) watching: Watching,
    pub(super) requests: mpsc::Receiver<Request>,
    /// Whether the items whose solves were outstanding when the map was opened or imported are not
    /// triggered yet.
    pub(super) has_pending_solves: bool,
    /// Whether the map was settled after the last step.
    pub(super) is_settled: bool,
    /// Entities that were handled since the task let others run.
    pub(super) handled: usize,
    /// Whether the last step answered a request.
    pub(super) answered: bool,
    /// Dropped when the engine ends, which tells whoever waits for that. Not empty once it was asked to
    /// stop.
    pub(super) closing: Vec<oneshot::Sender<()>>,
}

impl Actor {
    /// Runs until the map is deleted or the server shuts down.
    pub(super) async fn run(mut self) {
        loop {
            if let Err(panic) = AssertUnwindSafe(self.step()).catch_unwind().await {
                self.shared.meters.engine_panics.increment();
                self.restore(&panic_message(panic.as_ref())).await;
            }
            if self.shared.ended.get().is_some() {
                break;
            }
            // The items of a frozen map wait for it to be opened.
            let is_solved = self.solving.is_idle() || self.is_held();
            let is_done = is_solved && self.durability.all_acks_sent();
            if !self.closing.is_empty() && self.ingest.is_drained() && is_done {
                break;
            }
            if self.handled > SMALL {
                self.handled = 0;
                tokio::task::yield_now().await;
            }
        }
        let error = self.shared.ended.get_or_init(|| EngineError::ShuttingDown).clone();
        self.solving.cancel(&error);
        self.recognition.work.cancel();
        self.background.work.cancel();
        self.ingest.end_all(&error);
        self.pool.discard(self.map);
    }

    async fn step(&mut self) {
        if self.has_pending_solves && !self.is_held() {
            self.has_pending_solves = false;
            for (client, pending) in self.map.pending_solves() {
                self.trigger(client, pending).await;
            }
            self.start_solves().await;
        }
        // After a restart.
        self.start_recognition();
        self.start_background().await;
        let is_idle = self.solving.is_idle() && self.is_background_idle();
        let takes_items = is_idle || !self.ingest.is_lock_step();
        let takes_items = takes_items || self.is_held();
        let answered = std::mem::take(&mut self.answered);
        tokio::select! {
            biased;
            request = self.requests.recv(), if !answered => match request {
                Some(request) => {
                    self.answered = true;
                    request(self).await;
                }
                // No handle is left.
                None => self.end_with(EngineError::ShuttingDown),
            },
            outcome = self.solving.ended() => self.solved(outcome).await,
            found = self.recognition.work.ended() => self.recognition_ended(found).await,
            done = self.background.work.ended() => self.background_ended(done).await,
            () = self.durability.progress() => self.flushed(),
            item = self.ingest.next(), if takes_items => {
                if let Some(item) = item {
                    let parent = &item.span;
                    let span = tracing::debug_span!(parent: parent, "item", map = %self.shared.name);
                    self.take(item).instrument(span).await;
                }
            }
            // Nothing else is ready: the next step may answer a request again.
            () = std::future::ready(()), if answered => {}
        }
        self.start_solves().await;
        self.start_recognition();
        self.start_background().await;
        // In lock-step a stream ends with all that its items started.
        let is_done =
            self.is_background_idle() && !self.solving.schedule.is_waiting(ClientIndex::SERVER);
        let waits = self.ingest.is_lock_step() && !is_done;
        self.ingest.close_finished(|client| waits || self.solving.schedule.is_waiting(client));
        self.note_settled();
    }

    /// Deletes the map in the store; then the engine ends.
    pub(super) async fn delete(&mut self) -> Result<(), EngineError> {
        let map = self.shared.name.clone();
        self.shared.store.delete_map(&map).await?;
        self.end_with(match self.is_moving() {
            true => EngineError::Moving { map },
            false => EngineError::MapNotFound { map },
        });
        Ok(())
    }

    /// Takes no more items, and ends once all that is queued is done. `running` is dropped then.
    pub(super) fn close(&mut self, running: oneshot::Sender<()>) {
        self.ingest.close();
        self.closing.push(running);
    }

    /// Lets the engine end after this step.
    fn end_with(&self, reason: EngineError) {
        self.shared.ended.get_or_init(|| reason);
    }

    /// The map as its readers see it.
    pub(super) fn info(&self) -> MapInfo {
        MapInfo {
            name: self.shared.name.clone(),
            uid: self.shared.uid.clone(),
            snapshot: Arc::clone(&self.map),
            state: self.state(),
            trouble: self.shared.check_open().err(),
            pending: self.pending_work(),
        }
    }

    /// Whether the map accepts changes.
    fn state(&self) -> MapState {
        match self.shared.state() {
            MapState::Open if self.map.is_frozen() => MapState::Frozen,
            state @ (MapState::Open | MapState::Frozen | MapState::Poisoned) => state,
        }
    }

    /// Whether another map takes its content, or has it.
    fn is_moving(&self) -> bool {
        self.shared.moving.load(Ordering::Relaxed)
    }

    /// Whether it takes no items and starts no solves: it is frozen by request, or moving, or another
    /// server may have it.
    pub(super) fn is_held(&self) -> bool {
        self.map.is_frozen() || self.is_moving() || self.shared.check_served().is_err()
    }

    /// Refuses every change of a poisoned, moving or ending map.
    pub(super) fn check_changeable(&self) -> Result<(), EngineError> {
        if !self.closing.is_empty() {
            return Err(EngineError::ShuttingDown);
        }
        self.shared.check_open()?;
        match self.is_moving() {
            true => Err(EngineError::Moving { map: self.shared.name.clone() }),
            false => Ok(()),
        }
    }

    /// Refuses streams and solves of a map that is not open.
    pub(super) fn check_open(&self) -> Result<(), EngineError> {
        self.check_changeable()?;
        if self.map.is_frozen() {
            return Err(EngineError::Frozen { map: self.shared.name.clone() });
        }
        Ok(())
    }

    pub(super) async fn open_stream(
        &mut self,
        client: String,
        epoch: i64,
        lock_step: bool,
        handle: MapHandle,
    ) -> Result<IngestStream, EngineError> {
        let name = self.named_here(client, &handle)?;
        self.check_open()?;
        let (opening, epoch, reservation) = self.ingest.opening(&self.map, &name, epoch)?;
        while !self.make_room(&opening).await? {}
        if let Some(client) = self.map.client_named(&name) {
            self.ingest.fence(client, &name, epoch);
        }
        if let Err(error) = self.commit(None, opening).await {
            self.ingest.count(&self.map);
            return Err(error);
        }
        let Some(client) = self.map.client_named(&name) else {
            return Err(report_bug("an opened client is not in the map"));
        };
        tracing::debug!(client = name, epoch, "stream opened");
        let next_sequence = self.map.client(client).map_or(1, |c| c.next_sequence);
        let first_open = self.solving.schedule.first_open(client);
        let opened = Opened {
            client,
            next_sequence,
            optimized_sequence: first_open.unwrap_or(next_sequence) - 1,
            epoch,
            revision: self.map.revision(),
            lock_step: lock_step || self.shared.config.lock_step,
        };
        Ok(self.ingest.open(opened, &self.map, handle, reservation))
    }

    /// Takes constant time: the watcher reads the journal in its own task.
    pub(super) fn watch(
        &self,
        from_revision: Option<i64>,
        handle: MapHandle,
    ) -> Result<Watch, EngineError> {
        // Where clients have other names here, their old ones may be those of others.
        if let Some(merged) = handle.merged_in(&self.map)?
            && !merged.renamed(&self.map).is_empty()
        {
            let (map, into) = (merged.name.clone(), self.shared.name.clone());
            return Err(EngineError::MergedAway { map, into });
        }
        let account = &self.shared.account;
        let watcher = account.reserve(Resource::Watchers, 1)?;
        let reservations = [watcher, account.reserve(Resource::Streams, 1)?];
        let newest = self.map.revision();
        if let Some(revision) = from_revision.filter(|&revision| revision > newest) {
            let map = self.shared.name.clone();
            return Err(EngineError::RevisionAhead { map, revision, newest });
        }
        let (log, signal) = self.watching.open(newest);
        Ok(Watch::new(handle, &self.map, self.state(), log, signal, reservations))
    }

    /// Accepts or refuses a request to optimize the map.
    pub(super) fn optimize(&mut self, job: Job) {
        match self.check_open() {
            Ok(()) => self.solving.request(job),
            Err(error) => job.answer(Err(error)),
        }
    }

    /// Acknowledges what has become durable. If the journal has failed, the map accepts no further
    /// changes; if another server has the map, the engine ends; if one may have it, streams end and the
    /// map waits.
    fn flushed(&mut self) {
        self.recognition.changed();
        let Some(error) = self.durability.acknowledge(self.map.revision()) else {
            if let Err(error) = self.shared.check_served() {
                self.pause(&error);
                self.durability.drop_acks();
                self.watching.wake();
            }
            return;
        };
        let error = EngineError::Store(error);
        if let EngineError::Store(StoreError::OwnedElsewhere { .. }) = error {
            tracing::warn!(%error, "this server serves the map no longer");
            self.end_with(error.clone());
        } else {
            tracing::error!(%error, "the map takes no changes any more");
        }
        self.shared.set_damaged(&error);
        self.end(&error);
    }

    /// Computes something from the map on another thread. The engine awaits the result; its thread
    /// is not blocked.
    pub(super) async fn compute<R: Send + 'static>(
        &self,
        work: impl FnOnce(&Map) -> R + Send + 'static,
    ) -> R {
        self.pool.compute_from(&self.map, work).await
    }

    /// As [`Actor::compute`], for what a solve needs or makes.
    ///
    /// # Errors
    /// [`EngineError::Bug`]: it panicked. The map was only read and goes on.
    pub(super) async fn attempt<R: Send + 'static>(
        &self,
        work: impl FnOnce(&Map) -> R + Send + 'static,
    ) -> Result<R, EngineError> {
        let made = self.pool.attempt(&self.map, work).await;
        made.map_err(|panicked| self.lost(&panicked))
    }

    /// Journals and applies one change.
    ///
    /// # Errors
    /// [`EngineError::Store`], and [`EngineError::Refused`] where the event does not fit the map or could
    /// not be read again. Nothing was changed.
    pub(super) async fn commit(
        &mut self,
        cause: Option<Cause>,
        change: Change,
    ) -> Result<Position, EngineError> {
        let revision = self.map.revision();
        let time_ns = unix_time_ns(&*self.shared.store);
        let size = size_of_change(&change);
        self.handled += size;
        let copies = if Arc::strong_count(&self.map) > 1 { COPIED } else { 1 };
        let is_large = size > SMALL / copies;
        let event = Arc::new(Event { revision: revision + 1, time_ns, cause, change });
        let (checked, is_watched) = (Arc::clone(&event), self.watching.is_watched());
        let pairs = Arc::clone(&self.shared.pairs);
        let check = move |map: &Map| {
            let fits = map.fits(&checked);
            if fits.is_ok() {
                pairs.note(map, &checked.change, checked.revision);
            }
            let touched = (is_watched && fits.is_ok()).then(|| Touched::by(&checked.change, map));
            fits.map(|()| touched)
        };
        let fits = if is_large { self.compute(check).await } else { check(&self.map) };
        let touched = match fits {
            Ok(touched) => touched,
            Err(error) => {
                return Err(self.refuse(&event.change, event.cause.is_some(), error.to_string()));
            }
        };
        let appended = self.durability.append(Arc::clone(&event), is_large, &self.pool).await;
        let position = appended.map_err(|error| {
            if let StoreError::NotReadable { reason, .. } = error {
                return self.refuse(&event.change, event.cause.is_some(), reason);
            }
            EngineError::Store(error)
        })?;
        self.recognition.changed();
        self.background.changed(&self.map, &event.change);
        self.applying = Some(revision);
        if self.shared.config.injects(Fault::PanicInEngine) && event.cause.is_some() {
            std::panic::panic_any("staged by a test");
        }
        if let Some(touched) = touched {
            self.watching.tell(touched, &self.map);
        }
        if is_large {
            let mut map = std::mem::take(&mut self.map);
            let fold = move || {
                let fold = AssertUnwindSafe(|| Arc::make_mut(&mut map).fold(&event));
                (catch_unwind(fold), map)
            };
            let folded;
            (folded, self.map) = self.pool.compute(fold).await;
            folded.unwrap_or_else(|panic| resume_unwind(panic));
        } else {
            Arc::make_mut(&mut self.map).fold(&event);
        }
        self.applying = None;
        if let Some(excess) = self.shared.places.take_excess(&self.map) {
            self.pool.discard(excess);
        }
        self.ingest.count(&self.map);
        self.watching.wake();
        if position.snapshot_due {
            self.durability.keep_snapshot(&self.map);
        }
        Ok(position)
    }

    /// Counts and reports an event that is not possible. Clients are checked before, so that it is a bug or a
    /// result that overflowed.
    pub(super) fn refuse(&self, change: &Change, is_item: bool, reason: String) -> EngineError {
        self.shared.meters.refuse(change, is_item);
        let (map, change) = (self.shared.name.clone(), change.name());
        tracing::error!(map, change, reason, "a change is not possible and is refused");
        EngineError::Refused { map, change, reason }
    }

    /// Poisons the map after a panic. If the panic may have left an event half applied, restores
    /// the map.
    async fn restore(&mut self, panic: &str) {
        self.poison(panic);
        let Some(revision) = self.applying.take() else { return };
        if let Some(map) = self.durability.restored(revision).await {
            self.map = Arc::new(map);
        }
        self.watching.wake();
    }

    /// Reports that work on the pool panicked. It has read a copy of the map, so that the map goes on
    /// without what the work would have made.
    pub(super) fn lost(&self, panicked: &SolvePanicked) -> EngineError {
        self.shared.meters.solve_panics.increment();
        report_bug(&panicked.message)
    }

    /// Poisons the map: ends streams and solves, and returns the bug that was reported.
    pub(super) fn poison(&mut self, details: &str) -> EngineError {
        let bug = report_bug(details);
        self.shared.poison();
        self.ingest.count(&self.map);
        self.end(&bug);
        bug
    }

    /// Ends streams and drops what runs. The items whose solves it ends are solved once the map takes
    /// changes again.
    pub(super) fn pause(&mut self, error: &EngineError) {
        self.solving.pause(error);
        self.recognition.work.cancel();
        self.background.work.cancel();
        self.ingest.end_all(error);
    }

    /// Ends solves and streams, and wakes the watchers.
    fn end(&mut self, error: &EngineError) {
        self.solving.cancel(error);
        self.recognition.work.cancel();
        self.background.work.cancel();
        self.ingest.end_all(error);
        self.watching.wake();
    }
}
