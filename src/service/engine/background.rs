//! What follows a loop closure in the background, while items are accepted and windows are solved.
//!
//! The places that accepted closures join are compared, so that landmarks that are one point share
//! their observations; then a window around each such place is adjusted, then the whole map. A pose
//! graph or a requested optimization makes what runs here stale: it is canceled and starts again from
//! the newer state. Windows that run when an adjustment is applied are solved again. What is due is
//! part of the map, except for the windows, which the whole covers: a restart continues with it. In
//! lock-step it runs when nothing else does, and the next item waits for it.

use std::collections::VecDeque;
use std::sync::Arc;
use std::sync::atomic::AtomicBool;

use covis_solvers::interrupt::Interrupt;
use covis_solvers::optimizer;
use rayon::prelude::*;

use super::actor::Actor;
use super::handle::Shared;
use super::pool::{Ended, Slot, SolverPool};
use super::solve::{OptimizeOptions, Outcome, Solution, solve_map};
use super::window_solve::{WindowOptions, solve_window};
use super::{EngineError, Estimate, Fault};
use crate::map::{
    Change, Comparison, EntityId, Map, SolveKind, choose_window, find_duplicates, local_problem,
};

/// Closures that are compared at once, on the threads that there are; the journal then has them.
const COMPARED_AT_ONCE: usize = 16;

/// Iterations of an adjustment of the whole map. The next closure starts another one, and a requested
/// optimization continues until it converges.
const MOST_ITERATIONS: usize = 20;

/// What a background task made.
pub(super) enum Done {
    Compared(Vec<Comparison>),
    Adjusted(SolveKind, Box<Outcome>),
}

/// The background tasks of a map, one at a time.
pub(super) struct Background {
    shared: Arc<Shared>,
    pub(super) work: Slot<Done>,
    /// Whether something may be due. To know takes a pass over the constraints.
    may_be_due: bool,
    /// Whether the journal has refused a change and has taken none since.
    waits_for_journal: bool,
    /// Whether the whole map could not be adjusted since the last pose graph.
    gave_up: bool,
    /// Whether a task has panicked: the next would most likely panic too, and none starts until the map is
    /// opened anew.
    is_off: bool,
    /// The keyframes of closures whose surroundings are to be adjusted.
    seams: VecDeque<[EntityId; 2]>,
}

impl Background {
    pub(super) fn new(shared: &Arc<Shared>, pool: &Arc<SolverPool>) -> Self {
        let (work, seams) = (Slot::new(pool, &shared.account), VecDeque::new());
        let (may_be_due, waits_for_journal, gave_up, is_off) = (true, false, false, false);
        let shared = Arc::clone(shared);
        Self { shared, work, may_be_due, waits_for_journal, gave_up, is_off, seams }
    }

    /// Whether nothing runs or is due.
    pub(super) fn is_idle(&self) -> bool {
        self.work.is_free() && !self.may_be_due
    }

    /// Whether something runs or is due, for readers. Takes a pass over the constraints where something
    /// may be due.
    pub(super) fn is_pending(&self, map: &Map) -> bool {
        let may_be_due = self.may_be_due || self.waits_for_journal;
        !self.work.is_free() || (may_be_due && self.is_due(map))
    }

    /// Whether places are to be compared or the map is to be adjusted.
    fn is_due(&self, map: &Map) -> bool {
        let is_adjustment_due = map.is_adjustment_due() && !self.gave_up;
        !self.is_off
            && map.policy().closure_adjustment
            && (is_adjustment_due || map.uncompared_closures().next().is_some())
    }

    /// Notes what a change that is in the journal makes due or stale.
    pub(super) fn changed(&mut self, change: &Change) {
        if let Change::SolveApplied { solve } = change
            && solve.kind != SolveKind::LocalBundle
        {
            (self.may_be_due, self.gave_up) = (true, false);
            self.work.cancel();
        }
        let makes_due = matches!(
            change,
            Change::ConstraintRevoked { .. }
                | Change::KeyframeRemoved { .. }
                | Change::DuplicatesSplit { .. }
                | Change::MapMerged { .. }
                | Change::MapTakenOut { .. }
                | Change::PolicySet { .. }
                | Change::MapUpdated { .. }
        );
        self.may_be_due |= makes_due || std::mem::take(&mut self.waits_for_journal);
    }

    /// A change could not be journaled: what is due waits until the journal takes another one.
    fn wait_for_journal(&mut self) {
        (self.may_be_due, self.waits_for_journal) = (false, true);
    }

    /// Starts the next task, if one is due.
    fn start(&mut self, map: &Arc<Map>, is_lock_step: bool) {
        self.may_be_due = false;
        if self.is_off || !map.policy().closure_adjustment {
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
            return self.start_seam(Arc::clone(map), ends, whole);
        }
        if map.is_adjustment_due() && !self.gave_up {
            let options = OptimizeOptions { optimizer: options, ..OptimizeOptions::default() };
            let map = Arc::clone(map);
            self.launch(whole, SolveKind::Global, move |cancel| {
                solve_map(map, &options, &mut |_row| {}, cancel)
            });
        }
    }

    fn start_comparison(&mut self, map: Arc<Map>, closures: Vec<EntityId>) {
        let panics = self.shared.config.injects(Fault::PanicInBackground);
        self.work.start((), Estimate::LONG, Arc::default(), move |cancel| {
            if panics {
                std::panic::panic_any("staged by a test");
            }
            let interrupt = Interrupt::NEVER.or_when(Arc::clone(cancel));
            let find = |&closure: &EntityId| find_duplicates(&map, closure, &interrupt);
            Done::Compared(closures.par_iter().filter_map(find).collect())
        });
    }

    /// Adjusts the window around both keyframes of a closure, which takes less than the whole map.
    fn start_seam(&mut self, map: Arc<Map>, ends: [EntityId; 2], whole: Estimate) {
        let max_iterations = map.policy().max_local_iterations;
        let ceiling = self.shared.config.ceiling();
        let meters = Arc::clone(&self.shared.meters);
        self.launch(whole, SolveKind::LocalBundle, move |cancel| {
            let problem = local_problem(&map, &choose_window(&map, &ends));
            drop(map);
            let options = WindowOptions { max_iterations, ceiling, learns: false };
            solve_window(problem, &options, cancel, &mut |why| meters.disbelieve(why))
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
        self.work.start((), estimate, Arc::default(), move |cancel| {
            let _entered = span.entered();
            Done::Adjusted(kind, Box::new(queued.solve(|| work(cancel))))
        });
    }

    /// Keeps the places of closures that joined something, for their windows.
    fn joined(&mut self, map: &Map, comparisons: &[Comparison]) {
        let joined = comparisons.iter().filter(|comparison| !comparison.pairs.is_empty());
        let ends = joined.filter_map(|comparison| {
            let constraint = map.constraints().get(&comparison.closure)?;
            Some([constraint.keyframe_i, constraint.keyframe_j])
        });
        self.seams.extend(ends);
    }
}

impl Actor {
    /// Whether nothing runs in the background, or what is due there has to wait.
    pub(super) fn is_background_idle(&self) -> bool {
        let is_idle = self.recognition.is_idle(&self.map) && self.background.is_idle();
        is_idle || !self.closing.is_empty() || self.is_held()
    }

    /// Starts the next background task, if one is due.
    pub(super) async fn start_background(&mut self) {
        let may_start = self.background.work.is_free() && self.background.may_be_due;
        if !may_start || self.check_open().is_err() {
            return;
        }
        let has_duplicates = !self.background.is_off && !self.map.duplicates().is_empty();
        let split = match has_duplicates {
            true => self.attempt(Map::false_duplicates).await,
            false => Ok(Default::default()),
        };
        self.background.is_off |= split.is_err();
        if let Ok((closures, landmarks)) = split
            && !closures.is_empty()
        {
            let split = Change::DuplicatesSplit { closures, landmarks };
            if !self.commit_in_background(split).await {
                return;
            }
        }
        let is_lock_step = self.ingest.is_lock_step();
        let searches = is_lock_step && !self.recognition.is_idle(&self.map);
        if self.solving.leaves_room(is_lock_step) && !searches {
            self.background.start(&self.map, is_lock_step);
        }
    }

    /// Handles the end of the background task.
    pub(super) async fn background_ended(&mut self, ((), ended): ((), Ended<Done>)) {
        self.background.may_be_due = true;
        let done = match ended {
            Ended::Made(done) => done,
            Ended::Dropped => return,
            Ended::Panicked { panicked, .. } => {
                self.lost(&panicked);
                self.background.is_off = true;
                return;
            }
        };
        let change = match done {
            Done::Compared(mut comparisons) => {
                comparisons.retain_mut(|comparison| self.map.keeps(comparison));
                if comparisons.is_empty() {
                    return;
                }
                self.background.joined(&self.map, &comparisons);
                Change::DuplicatesFound { comparisons }
            }
            Done::Adjusted(kind, outcome) => match self.adjustment(kind, *outcome).await {
                Some(change) => change,
                None => return,
            },
        };
        self.commit_in_background(change).await;
    }

    /// Commits a change for which no client waits. Where the journal does not take it, nothing is lost:
    /// what is due is found again. An adjustment whose result is not possible is not tried again before the
    /// next pose graph. Returns whether it is committed.
    async fn commit_in_background(&mut self, change: Change) -> bool {
        let is_whole = matches!(
            &change,
            Change::SolveApplied { solve } if solve.kind == SolveKind::Global
        );
        let committed = self.commit(None, change).await;
        if let Err(error) = &committed {
            self.background.gave_up |= is_whole && matches!(error, EngineError::Refused { .. });
            let map = &self.shared.name;
            tracing::warn!(%error, %map, "what follows a loop closure waits for the journal");
            self.background.wait_for_journal();
        }
        committed.is_ok()
    }

    /// The change that an adjustment in the background makes, if there is one.
    async fn adjustment(&mut self, kind: SolveKind, outcome: Outcome) -> Option<Change> {
        let solution = outcome.unwrap_or_else(|error| {
            let map = &self.shared.name;
            tracing::warn!(%error, %map, ?kind, "the map could not be adjusted after a closure");
            None
        });
        let is_sound = |solution: &Solution| {
            solution.refused.is_none() && solution.certificate.solve.final_cost.is_finite()
        };
        let Some(Solution { moved, certificate, .. }) = solution.filter(is_sound) else {
            self.background.gave_up |= kind == SolveKind::Global;
            return None;
        };
        // It moves what the window holds.
        self.solving.supersede_window();
        let costs = (certificate.solve.initial_cost, certificate.solve.final_cost);
        let solve = self.result(moved, kind, Vec::new(), costs).await.ok();
        self.background.gave_up |= solve.is_none() && kind == SolveKind::Global;
        Some(Change::SolveApplied { solve: solve? })
    }
}
