//! The handle of a map: what callers hold, and what they share with the engine.
//!
//! A handle sends requests and awaits the answers; it never changes the map itself. Once an
//! item is acknowledged, every later snapshot contains it.

pub(crate) mod compacting;
pub(crate) mod stream;
pub(crate) mod watch;

use std::fmt;
use std::future::ready;
use std::sync::Arc;

use covis_solvers::interrupt::Interrupt;
use futures_util::FutureExt;
use futures_util::future::BoxFuture;
use tokio::sync::{mpsc, oneshot};
use tracing::Span;

use crate::loop_closing::{Localization, QueryView, localize};
use crate::map::{GraphPairs, GraphProblem, Map, RequestId, measured_graph};
use crate::service::engine::actor::{Actor, Request};
use crate::service::engine::context::MapContext;
use crate::service::engine::error::report_bug;
use crate::service::engine::events::Queued;
use crate::service::engine::journal::sequence_of;
use crate::service::engine::merged_name::MergedName;
use crate::service::engine::outcome::OptimizeRequest;
use crate::service::engine::places::UnknownType;
use crate::service::engine::{
    Account, Cancellation, EngineError, IngestStream, MapInfo, MapUpdate, OptimizeOptions,
    OptimizeOutcome, SolveStep, Watch,
};
use crate::store::{Flushed, StoreError};

/// A handle of a map. It is cheap to clone and may outlive the map; calls then return an error.
#[derive(Clone)]
pub struct MapHandle {
    pub(crate) shared: Arc<MapContext>,
    pub(crate) items: mpsc::Sender<Queued>,
    pub(crate) requests: mpsc::Sender<Request>,
    /// The name by which the map was found, where that is the name of a map that became part of it.
    pub(crate) merged: Option<Arc<MergedName>>,
}

impl fmt::Debug for MapHandle {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("MapHandle").field("name", &self.shared.name).finish_non_exhaustive()
    }
}

impl MapHandle {
    /// The map's name.
    pub fn name(&self) -> &str {
        &self.shared.name
    }

    /// Differs from the uid of a later map with the same name; empty if the map could not be
    /// opened.
    pub fn uid(&self) -> &str {
        &self.shared.uid
    }

    /// The uid that clients of an ingest stream know: of a map that became part of this one, whose name
    /// the caller used, it is that map's own, because all that it acknowledged is here.
    pub fn ingest_uid(&self) -> &str {
        self.merged.as_ref().map_or(&self.shared.uid, |merged| &merged.uid)
    }

    /// The resources that the map holds, and their limits.
    pub fn account(&self) -> &Arc<Account> {
        &self.shared.account
    }

    /// The map with its state.
    ///
    /// # Errors
    /// [`EngineError::MapNotFound`] when it was deleted, [`EngineError::ShuttingDown`],
    /// [`EngineError::Store`] when it could not be opened.
    pub async fn info(&self) -> Result<MapInfo, EngineError> {
        match &self.shared.unopened {
            Some(error) => Err(error.clone()),
            None => self.listed().await,
        }
    }

    /// As [`MapHandle::info`], for lists: a map that could not be opened is listed as poisoned,
    /// empty and without a uid.
    ///
    /// # Errors
    /// [`EngineError::MapNotFound`] when it was deleted, [`EngineError::ShuttingDown`].
    pub async fn listed(&self) -> Result<MapInfo, EngineError> {
        self.call(|actor| ready(actor.info()).boxed()).await
    }

    /// The map as it is now.
    ///
    /// # Errors
    /// As [`MapHandle::info`].
    pub async fn snapshot(&self) -> Result<Arc<Map>, EngineError> {
        Ok(self.info().await?.snapshot)
    }

    /// Opens an ingest stream for `client` and fences its older stream. Epoch 0 means the next
    /// epoch.
    ///
    /// # Errors
    /// [`EngineError::EpochFenced`] when `epoch` is not newer than the client's newest,
    /// [`EngineError::TooLarge`] when no epoch could follow it, [`EngineError::MapLimit`],
    /// [`EngineError::TenantLimit`] and [`EngineError::ServerLimit`] when there is no room for the
    /// stream or its client, [`EngineError::Poisoned`], and as [`MapHandle::info`].
    pub async fn open_stream(
        &self,
        client: String,
        epoch: i64,
        lock_step: bool,
    ) -> Result<IngestStream, EngineError> {
        let merged = self.merged.clone();
        let open = self.call(move |actor| {
            async move { actor.open_stream(client, epoch, lock_step, merged.as_deref()).await }
                .boxed()
        });
        Ok(IngestStream::new(self.clone(), open.await??))
    }

    /// Watches the map, from the full state or from a revision that the caller holds.
    ///
    /// # Errors
    /// [`EngineError::RevisionAhead`] when the map has not reached `from_revision`, and as
    /// [`MapHandle::info`].
    pub async fn watch(&self, from_revision: Option<i64>) -> Result<Watch, EngineError> {
        if let Some(error) = &self.shared.unopened {
            return Err(error.clone());
        }
        let merged = self.merged.clone();
        let opened =
            self.call(move |actor| ready(actor.watch(from_revision, merged.as_deref())).boxed());
        let mut watch = Watch::new(self.clone(), opened.await??);
        if let Some(revision) = from_revision {
            watch.resume_from(revision).await;
        }
        Ok(watch)
    }

    /// Waits until the journal is durable up to `revision`, so that no crash can undo what a reader
    /// was sent. Returns at once if the store makes nothing durable, and with an error if the disk
    /// is full.
    pub(crate) async fn durable(&self, revision: i64) -> Result<(), EngineError> {
        self.durable_unless(revision, Flushed::trouble).await
    }

    /// As [`MapHandle::durable`], but waits for a disk that is full.
    pub(crate) async fn durable_at_last(&self, revision: i64) -> Result<(), EngineError> {
        self.durable_unless(revision, |flushed| flushed.failed.as_ref()).await
    }

    async fn durable_unless(
        &self,
        revision: i64,
        trouble: impl Fn(&Flushed) -> Option<&StoreError>,
    ) -> Result<(), EngineError> {
        let sequence = sequence_of(revision);
        let mut flushed = self.shared.flushed.clone();
        let ended = |f: &Flushed| f.through >= sequence || trouble(f).is_some();
        let reached = flushed.wait_for(ended).await.ok().filter(|f| f.through < sequence);
        match reached.and_then(|flushed| trouble(&flushed).cloned()) {
            Some(error) => {
                let ended = self.shared.ended.get().cloned();
                Err(ended.unwrap_or(EngineError::Store(error)))
            }
            None => Ok(()),
        }
    }

    /// The pose graph of `map`, a snapshot of this map, as a solve of it begins; `None` when
    /// `interrupt` is due before all pairs of keyframes are measured. Blocks its thread, and uses the
    /// others of its thread pool.
    pub fn pose_graph(&self, map: &Map, interrupt: &Interrupt) -> Option<GraphProblem> {
        let pairs = GraphPairs::of(map);
        let motions = self.shared.pairs.complete(map, &pairs, interrupt);
        let is_whole = !interrupt.is_due();
        is_whole.then(|| measured_graph(map, map.policy().gauge, &pairs, &motions))
    }

    /// Brings the index of places up to `map`, a snapshot of this map, by a piece that takes a tenth of a
    /// second at most. Whether nothing is left to do, which is so too where the interrupt is due. Blocks its
    /// thread.
    pub fn index_places(&self, map: &Map, interrupt: &Interrupt) -> bool {
        !map.policy().place_recognition || self.shared.places.advance(map, interrupt)
    }

    /// The place of a view in `map`, a snapshot of this map. The index must be up to the map
    /// ([`MapHandle::index_places`]). Blocks its thread.
    ///
    /// # Errors
    /// [`EngineError::NoPlaceRecognition`], and [`EngineError::Bug`] where the view has more descriptors
    /// than a keyframe may have.
    pub fn localize(
        &self,
        map: &Map,
        view: &QueryView<'_>,
        interrupt: &Interrupt,
    ) -> Result<Localization, EngineError> {
        if !map.policy().place_recognition {
            return Err(EngineError::NoPlaceRecognition { map: self.shared.name.clone() });
        }
        let found = self.shared.places.candidates(map, view, interrupt, &|_| false);
        let found = found.map_err(|error| report_bug(&error.to_string()))?;
        Ok(localize(map, view, &found, interrupt))
    }

    /// The type of a view's descriptors, where keyframes of the map have descriptors, none of this type.
    pub fn unknown_descriptor_type(&self, view: &QueryView<'_>) -> Option<UnknownType> {
        self.shared.places.unknown_type(view)
    }

    /// Optimizes the whole map. Sends each step to `steps` and applies the result as one revision.
    /// Dropping the future or the receiver of `steps` cancels the solve, and nothing is applied.
    ///
    /// # Errors
    /// [`EngineError::OptimizationRunning`], [`EngineError::Poisoned`],
    /// [`EngineError::NothingToSolve`], [`EngineError::Solve`] when the problem cannot be solved as
    /// posed, [`EngineError::Cancelled`], [`EngineError::Bug`], and as [`MapHandle::info`].
    pub async fn optimize(
        &self,
        options: OptimizeOptions,
        steps: mpsc::UnboundedSender<SolveStep>,
    ) -> Result<OptimizeOutcome, EngineError> {
        self.solve_unless(Arc::default(), None, options, steps).await
    }

    /// As [`MapHandle::optimize`]; `cancellation` decides whether the result is applied. The event that
    /// applies it names `request` ([`Map::last_request`]), and no crash can undo it when this returns.
    ///
    /// # Errors
    /// As [`MapHandle::optimize`], and [`EngineError::Store`].
    pub async fn optimize_unless(
        &self,
        cancellation: Arc<Cancellation>,
        request: RequestId,
        options: OptimizeOptions,
        steps: mpsc::UnboundedSender<SolveStep>,
    ) -> Result<OptimizeOutcome, EngineError> {
        let outcome = self.solve_unless(cancellation, Some(request), options, steps).await?;
        self.durable_at_last(outcome.revision).await?;
        Ok(outcome)
    }

    async fn solve_unless(
        &self,
        cancellation: Arc<Cancellation>,
        request: Option<RequestId>,
        options: OptimizeOptions,
        steps: mpsc::UnboundedSender<SolveStep>,
    ) -> Result<OptimizeOutcome, EngineError> {
        self.shared.config.check_calls()?;
        self.shared.check_served()?;
        let (reply, mut answer) = oneshot::channel();
        let mut guard = CancelOnDrop(Some(Arc::clone(&cancellation)));
        let canceled = Arc::clone(&cancellation);
        let readers = steps.clone();
        let span = Span::current();
        let job = OptimizeRequest { options, steps, cancellation, request, span, reply };
        self.send(|actor| {
            actor.optimize(job);
            ready(()).boxed()
        })
        .await?;
        let outcome = tokio::select! {
            biased;
            outcome = &mut answer => outcome,
            () = readers.closed() => {
                canceled.abandon();
                answer.await
            }
        };
        // The caller may ask again with the same cancellation.
        guard.0 = None;
        outcome.unwrap_or_else(|_lost| Err(self.end_error()))
    }

    /// Changes name, policy or state of the map as one event, and returns when no crash can undo
    /// it. Freezing ends the map's streams and its solves; the items whose solves it ends are
    /// solved once the map is open again.
    ///
    /// # Errors
    /// [`EngineError::RevisionMismatch`] when the map is not at the expected revision,
    /// [`EngineError::Poisoned`], and as [`MapHandle::info`].
    pub async fn update(&self, update: MapUpdate) -> Result<MapInfo, EngineError> {
        let info = self.call(|actor| actor.update(update).boxed()).await??;
        self.durable(info.snapshot.revision()).await?;
        Ok(info)
    }

    /// Why the engine does not answer.
    pub(crate) fn end_error(&self) -> EngineError {
        self.shared.ended.get().cloned().unwrap_or(EngineError::ShuttingDown)
    }

    async fn send(
        &self,
        request: impl for<'a> FnOnce(&'a mut Actor) -> BoxFuture<'a, ()> + Send + 'static,
    ) -> Result<(), EngineError> {
        self.requests.send(Box::new(request)).await.map_err(|_closed| self.end_error())
    }

    /// Ends the engine; returns when it has ended.
    pub(crate) async fn stop(&self) {
        let (running, ended) = oneshot::channel();
        let closed = self.send(|actor| {
            actor.close(running);
            ready(()).boxed()
        });
        if closed.await.is_ok() {
            // The engine drops the sender when it has ended.
            let _ended = ended.await;
        }
    }

    /// Lets the engine run `work`, and returns what it answers.
    pub(crate) async fn call<T: Send + 'static>(
        &self,
        work: impl for<'a> FnOnce(&'a mut Actor) -> BoxFuture<'a, T> + Send + 'static,
    ) -> Result<T, EngineError> {
        self.shared.config.check_calls()?;
        self.shared.check_served()?;
        let (reply, answer) = oneshot::channel();
        self.send(|actor| {
            // A caller that went away needs no answer.
            work(actor).map(|result| drop(reply.send(result))).boxed()
        })
        .await?;
        answer.await.map_err(|_lost| self.end_error())
    }
}

/// Cancels an optimization when its caller drops the future.
struct CancelOnDrop(Option<Arc<Cancellation>>);

impl Drop for CancelOnDrop {
    fn drop(&mut self) {
        if let Some(cancellation) = &self.0 {
            cancellation.abandon();
        }
    }
}
