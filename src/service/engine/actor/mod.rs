//! The task that owns a map: its loop, which hands events from one part to another.
//!
//! The parts are [`Ingest`], [`Journal`], [`Solving`], [`Recognition`], [`Background`] and [`Watching`]; each
//! owns its state, and none knows another. Each step handles one of these, in this order of priority: a
//! request, the end of a solve, the end of a search for places, the end of a background task, progress of the
//! journal, an item. After a request, the others have priority for one step, so that constant requests of
//! readers cannot block writers. In lock-step the task accepts no item while a solve, a search or a background
//! task runs or waits.
//!
//! The journal accepts an event before the event changes the map, and makes it durable while the
//! task continues. Steps run under `catch_unwind`: a panic poisons only this map. If it may have left
//! an event half applied, the map is replayed from the journal. A panic in a solve, a search or a background
//! task that runs on the pool has touched a copy alone, and costs no more than that work.

mod closures;
mod commit;
mod items;
pub(crate) mod merging;
mod requests;
mod searches;
mod settled;
mod solves;
pub(crate) mod update;

use std::panic::AssertUnwindSafe;
use std::sync::Arc;
use std::sync::atomic::Ordering;

use futures_util::FutureExt;
use futures_util::future::BoxFuture;
use tokio::sync::{mpsc, oneshot};
use tracing::Instrument;

use crate::map::{ClientIndex, Map};
use crate::service::engine::context::MapContext;
use crate::service::engine::error::report_bug;
use crate::service::engine::ingest::Ingest;
use crate::service::engine::journal::Journal;
use crate::service::engine::pool::{SolvePanicked, panic_message};
use crate::service::engine::recognition::Recognition;
use crate::service::engine::solving::Solving;
use crate::service::engine::solving::after_closures::Background;
use crate::service::engine::watching::Watching;
use crate::service::engine::{EngineError, MapState, Reservation, SolverPool};
use crate::store::StoreError;

/// Most entities of an item or an event that are handled on the task's own thread; a fold takes
/// about 0.4 µs for each, and the check of an item half of that. Larger ones are handled on a
/// blocking thread. After this many the task lets others run.
pub(crate) const SMALL: usize = 512;

/// The cost of a step besides that of its entities, in entities.
pub(crate) const STEP: usize = 16;

/// What a handle asks of the engine, besides items: work for the map's task. Requests have their own
/// queue and overtake items, so that a reader never waits behind a busy stream.
pub(crate) type Request = Box<dyn for<'a> FnOnce(&'a mut Actor) -> BoxFuture<'a, ()> + Send>;

/// A map and its only writer.
pub(crate) struct Actor {
    pub(crate) shared: Arc<MapContext>,
    pub(crate) pool: Arc<SolverPool>,
    /// Counts the map in the account of its tenant until it is dropped.
    pub(crate) _reservation: Reservation,
    pub(crate) map: Arc<Map>,
    /// The revision before the event that is being applied. While it is set, a panic may leave an
    /// event half applied.
    pub(crate) applying: Option<i64>,
    pub(crate) ingest: Ingest,
    pub(crate) journal: Journal,
    pub(crate) solving: Solving,
    pub(crate) recognition: Recognition,
    pub(crate) background: Background,
    pub(crate) watching: Watching,
    pub(crate) requests: mpsc::Receiver<Request>,
    /// Whether the items whose solves were outstanding when the map was opened or imported are not
    /// triggered yet.
    pub(crate) has_pending_solves: bool,
    /// Whether the map was settled after the last step.
    pub(crate) is_settled: bool,
    /// Entities that were handled since the task let others run.
    pub(crate) handled: usize,
    /// Whether the last step answered a request.
    pub(crate) answered: bool,
    /// Dropped when the engine ends, which wakes whoever waits for that. Not empty once it was asked to
    /// stop.
    pub(crate) closing: Vec<oneshot::Sender<()>>,
}

impl Actor {
    /// Runs until the map is deleted or the server shuts down.
    pub(crate) async fn run(mut self) {
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
            let is_done = is_solved && self.journal.all_acks_sent();
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
            () = self.journal.progress() => self.flushed(),
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

    /// Takes no more items, and ends once all that is queued is done. `running` is dropped then.
    pub(crate) fn close(&mut self, running: oneshot::Sender<()>) {
        self.ingest.close();
        self.closing.push(running);
    }

    /// Lets the engine end after this step.
    fn end_with(&self, reason: EngineError) {
        self.shared.ended.get_or_init(|| reason);
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
    pub(crate) fn is_held(&self) -> bool {
        self.map.is_frozen() || self.is_moving() || self.shared.check_served().is_err()
    }

    /// Refuses every change of a poisoned, moving or ending map.
    pub(crate) fn check_changeable(&self) -> Result<(), EngineError> {
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
    pub(crate) fn check_open(&self) -> Result<(), EngineError> {
        self.check_changeable()?;
        if self.map.is_frozen() {
            return Err(EngineError::Frozen { map: self.shared.name.clone() });
        }
        Ok(())
    }

    /// Acknowledges what has become durable. If the journal has failed, the map accepts no further
    /// changes; if another server has the map, the engine ends; if one may have it, streams end and the
    /// map waits.
    fn flushed(&mut self) {
        self.recognition.changed();
        let Some(error) = self.journal.acknowledge(self.map.revision()) else {
            if let Err(error) = self.shared.check_served() {
                self.pause(&error);
                self.journal.drop_acks();
                self.watching.wake();
            }
            return;
        };
        let error = EngineError::Store(error);
        if let EngineError::Store(StoreError::OwnedElsewhere { .. }) = error {
            tracing::warn!(%error, "this server no longer serves the map");
            self.end_with(error.clone());
        } else {
            tracing::error!(%error, "the map no longer takes changes");
        }
        self.shared.set_damaged(&error);
        self.end(&error);
    }

    /// Computes something from the map on another thread. The engine awaits the result; its thread
    /// is not blocked.
    pub(crate) async fn compute<R: Send + 'static>(
        &self,
        work: impl FnOnce(&Map) -> R + Send + 'static,
    ) -> R {
        self.pool.compute_from(&self.map, work).await
    }

    /// As [`Actor::compute`], for what a solve needs or makes.
    ///
    /// # Errors
    /// [`EngineError::Bug`]: it panicked. The map was only read and goes on.
    pub(crate) async fn attempt<R: Send + 'static>(
        &self,
        work: impl FnOnce(&Map) -> R + Send + 'static,
    ) -> Result<R, EngineError> {
        let made = self.pool.attempt(&self.map, work).await;
        made.map_err(|panicked| self.lost(&panicked))
    }

    /// Reports that work on the pool panicked. It has read a copy of the map, so that the map goes on
    /// without what the work would have made.
    pub(crate) fn lost(&self, panicked: &SolvePanicked) -> EngineError {
        self.shared.meters.solve_panics.increment();
        report_bug(&panicked.message)
    }

    /// Poisons the map: ends streams and solves, and returns the bug that was reported.
    pub(crate) fn poison(&mut self, details: &str) -> EngineError {
        let bug = report_bug(details);
        self.shared.poison();
        self.ingest.count(&self.map);
        self.end(&bug);
        bug
    }

    /// Ends streams and drops what runs. The items whose solves it ends are solved once the map takes
    /// changes again.
    pub(crate) fn pause(&mut self, error: &EngineError) {
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
