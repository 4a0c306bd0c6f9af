//! What follows a loop closure in the background, while items and windows go on.
//!
//! The places that accepted closures join are compared, so that landmarks that are one point share
//! their observations; then a window around each such place is adjusted, then the whole map. A pose
//! graph or a requested optimization makes what runs here stale: it is canceled and starts again from
//! the newer state. Windows that run when an adjustment is applied are solved again. What is due is
//! part of the map, except for the windows, which the whole covers: a restart goes on with it. In
//! lock-step it runs when nothing else does, and the next item waits for it.

use std::collections::VecDeque;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

use covis_solvers::optimizer;
use rayon::prelude::*;
use tokio::sync::{mpsc, oneshot};

use super::Estimate;
use super::actor::Actor;
use super::handle::Shared;
use super::pool::{SolvePanicked, SolverPool, answered};
use super::solve::{OptimizeOptions, Outcome, Solution, solve_map, solve_window};
use crate::map::{
    Change, Comparison, EntityId, Map, SolveKind, applied, choose_window_of, find_duplicates,
    local_problem,
};

/// Closures that are compared at once: some ten milliseconds each.
const COMPARED_AT_ONCE: usize = 16;

/// Iterations of an adjustment of the whole map. The next closure starts another one, and a requested
/// optimization goes on until it converges.
const MOST_ITERATIONS: usize = 20;

/// What a background task made.
pub(super) enum Done {
    Compared(Vec<Comparison>),
    Adjusted(SolveKind, Box<Outcome>),
}

struct Running {
    is_stale: bool,
    cancel: Arc<AtomicBool>,
    answer: oneshot::Receiver<Result<Done, SolvePanicked>>,
}

/// The background tasks of a map, one at a time.
pub(super) struct Background {
    shared: Arc<Shared>,
    pool: Arc<SolverPool>,
    running: Option<Running>,
    /// Whether something may be due. To know takes a pass over the constraints.
    may_be_due: bool,
    /// Whether the whole map could not be adjusted since the last pose graph.
    gave_up: bool,
    /// The keyframes of closures whose surroundings are to be adjusted.
    seams: VecDeque<[EntityId; 2]>,
}

impl Background {
    pub(super) fn new(shared: &Arc<Shared>, pool: &Arc<SolverPool>) -> Self {
        let (shared, pool) = (Arc::clone(shared), Arc::clone(pool));
        let (running, seams) = (None, VecDeque::new());
        Self { shared, pool, running, may_be_due: true, gave_up: false, seams }
    }

    /// Whether nothing runs or is due.
    pub(super) fn is_idle(&self) -> bool {
        self.running.is_none() && !self.may_be_due
    }

    /// Whether a task may have to start.
    pub(super) fn may_start(&self) -> bool {
        self.running.is_none() && self.may_be_due
    }

    /// Notes what a change of the map makes due or stale.
    pub(super) fn changed(&mut self, change: &Change) {
        match change {
            Change::SolveApplied { solve } => match solve.kind {
                SolveKind::LocalBundle => {}
                SolveKind::PoseGraph | SolveKind::Global => {
                    (self.may_be_due, self.gave_up) = (true, false);
                    self.cancel();
                }
            },
            Change::ConstraintRevoked { .. }
            | Change::KeyframeRemoved { .. }
            | Change::DuplicatesSplit { .. }
            | Change::PolicySet { .. }
            | Change::MapUpdated { .. } => self.may_be_due = true,
            Change::Created { .. }
            | Change::ClientOpened { .. }
            | Change::CameraSet { .. }
            | Change::KeyframeAdded { .. }
            | Change::LandmarksAdded { .. }
            | Change::ObservationsAdded { .. }
            | Change::ConstraintAdded { .. }
            | Change::PriorAdded { .. }
            | Change::LandmarksTriangulated { .. }
            | Change::ObservationsRemoved { .. }
            | Change::LandmarksFused { .. }
            | Change::DuplicatesFound { .. }
            | Change::LandmarksRemoved { .. }
            | Change::KeyframeRetired { .. }
            | Change::ItemRepeated => {}
        }
    }

    /// Cancels what runs; its result is dropped.
    pub(super) fn cancel(&mut self) {
        if let Some(running) = &mut self.running {
            running.is_stale = true;
            running.cancel.store(true, Ordering::Relaxed);
            self.may_be_due = true;
        }
    }

    /// Starts the next task, if one is due and none runs.
    pub(super) fn start(&mut self, map: &Arc<Map>, is_lock_step: bool) {
        if self.running.is_some() {
            return;
        }
        self.may_be_due = false;
        if !map.policy().closure_adjustment {
            return;
        }
        let closures: Vec<EntityId> = map.uncompared_closures().take(COMPARED_AT_ONCE).collect();
        if !closures.is_empty() {
            return self.start_comparison(Arc::clone(map), closures);
        }
        let ceiling = self.shared.config.ceiling();
        let max_iterations = MOST_ITERATIONS;
        let options =
            optimizer::Options { max_iterations, ceiling, ..optimizer::Options::default() };
        let whole = Estimate::of_map(map.usage(), max_iterations, &ceiling);
        // A restart forgets the seams, and lock-step gives the same bits with and without one.
        if whole.is_small() || is_lock_step {
            self.seams.clear();
        }
        if let Some(ends) = self.seams.pop_front() {
            return self.start_seam(Arc::clone(map), ends);
        }
        if map.is_adjustment_due() && !self.gave_up {
            let options = OptimizeOptions { optimizer: options, ..OptimizeOptions::default() };
            let map = Arc::clone(map);
            self.launch(whole, SolveKind::Global, move |cancel| {
                // Nobody reads the iterations.
                let (rows, _) = mpsc::unbounded_channel();
                solve_map(map, &options, &rows, cancel)
            });
        }
    }

    fn start_comparison(&mut self, map: Arc<Map>, closures: Vec<EntityId>) {
        let answer = self.pool.start(&self.shared.account, Estimate::SMALL, move || {
            let found = closures.par_iter().filter_map(|&closure| find_duplicates(&map, closure));
            Done::Compared(found.collect())
        });
        self.running = Some(Running { is_stale: false, cancel: Arc::default(), answer });
    }

    /// Adjusts the window around both keyframes of a closure.
    fn start_seam(&mut self, map: Arc<Map>, ends: [EntityId; 2]) {
        let max_iterations = map.policy().max_local_iterations;
        let ceiling = self.shared.config.ceiling();
        self.launch(Estimate::SMALL, SolveKind::LocalBundle, move |cancel| {
            let problem = local_problem(&map, &choose_window_of(&map, &ends));
            drop(map);
            solve_window(problem, max_iterations, ceiling, cancel)
        });
    }

    fn launch(
        &mut self,
        estimate: Estimate,
        kind: SolveKind,
        work: impl FnOnce(&Arc<AtomicBool>) -> Outcome + Send + 'static,
    ) {
        let span = tracing::debug_span!("adjust", map = %self.shared.name, ?kind);
        let queued = self.shared.meters.solve(kind);
        let cancel = Arc::<AtomicBool>::default();
        let flag = Arc::clone(&cancel);
        let answer = self.pool.start(&self.shared.account, estimate, move || {
            let _entered = span.entered();
            Done::Adjusted(kind, Box::new(queued.started().ended(work(&flag))))
        });
        self.running = Some(Running { is_stale: false, cancel, answer });
    }

    /// Resolves when the running task has ended; never if none runs.
    pub(super) async fn ended(&mut self) -> Result<Done, SolvePanicked> {
        match &mut self.running {
            Some(running) => answered((&mut running.answer).await),
            None => std::future::pending().await,
        }
    }

    /// What the task that has ended made, if it is still wanted.
    ///
    /// # Errors
    /// [`SolvePanicked`].
    pub(super) fn take_ended(
        &mut self,
        done: Result<Done, SolvePanicked>,
    ) -> Result<Option<Done>, SolvePanicked> {
        let is_stale = self.running.take().is_none_or(|running| running.is_stale);
        self.may_be_due = true;
        let done = done.inspect_err(|_| self.shared.meters.solve_panics.increment())?;
        if is_stale {
            self.pool.discard(done);
            return Ok(None);
        }
        Ok(Some(done))
    }

    /// Keeps the places of closures that joined something, for their windows.
    pub(super) fn joined(&mut self, map: &Map, comparisons: &[Comparison]) {
        let joined = comparisons.iter().filter(|comparison| !comparison.pairs.is_empty());
        let ends = joined.filter_map(|comparison| {
            let constraint = map.constraints().get(&comparison.closure)?;
            Some([constraint.keyframe_i, constraint.keyframe_j])
        });
        self.seams.extend(ends);
    }

    /// The whole map cannot be adjusted as it is.
    pub(super) fn give_up(&mut self) {
        self.gave_up = true;
    }
}

impl Actor {
    /// Whether nothing runs in the background, or what is due there has to wait.
    pub(super) fn is_background_idle(&self) -> bool {
        self.background.is_idle() || !self.closing.is_empty() || self.map.is_frozen()
    }

    /// Starts the next background task, if one is due.
    pub(super) async fn start_background(&mut self) {
        let is_held_back = self.map.is_frozen()
            || !self.closing.is_empty()
            || self.check_changeable().is_err()
            || !self.background.may_start();
        if is_held_back {
            return;
        }
        if !self.map.duplicates().is_empty()
            && let (closures, landmarks) = self.compute(Map::false_duplicates).await
            && !closures.is_empty()
        {
            // A failure ended the map's streams already.
            let _ended = self.commit(None, Change::DuplicatesSplit { closures, landmarks }).await;
        }
        let is_lock_step = self.ingest.is_lock_step();
        if self.solving.leaves_room(is_lock_step) {
            self.background.start(&self.map, is_lock_step);
        }
    }

    /// Handles the end of the background task.
    pub(super) async fn background_ended(&mut self, done: Result<Done, SolvePanicked>) {
        let change = match self.background.take_ended(done) {
            Ok(None) => return,
            Err(panicked) => {
                self.poison(&panicked.message);
                return;
            }
            Ok(Some(Done::Compared(mut comparisons))) => {
                comparisons.retain_mut(|comparison| self.map.keeps(comparison));
                self.background.joined(&self.map, &comparisons);
                Change::DuplicatesFound { comparisons }
            }
            Ok(Some(Done::Adjusted(kind, outcome))) => {
                match self.adjustment(kind, *outcome).await {
                    Some(change) => change,
                    None => return,
                }
            }
        };
        if let Err(error) = self.commit(None, change).await {
            self.ingest.end_all(&error);
        }
    }

    /// The change that an adjustment in the background makes, if there is one.
    async fn adjustment(&mut self, kind: SolveKind, outcome: Outcome) -> Option<Change> {
        let solution = outcome.unwrap_or_else(|error| {
            let map = &self.shared.name;
            tracing::warn!(%error, %map, ?kind, "the map could not be adjusted after a closure");
            None
        });
        let is_finite = |solution: &Solution| solution.certificate.solve.final_cost.is_finite();
        let Some(Solution { moved, certificate, .. }) = solution.filter(is_finite) else {
            if kind == SolveKind::Global {
                self.background.give_up();
            }
            return None;
        };
        // It moves what the window holds.
        self.solving.supersede_window();
        let costs = (certificate.solve.initial_cost, certificate.solve.final_cost);
        let solve = move |map: &Map| applied(map, moved.solved(), kind, Vec::new(), costs);
        Some(Change::SolveApplied { solve: self.compute(solve).await })
    }
}
