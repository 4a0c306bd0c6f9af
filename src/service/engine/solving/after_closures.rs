//! What follows a loop closure in the background, while items are accepted and windows are solved.
//!
//! The places that accepted closures join are compared, so that landmarks that are one point share
//! their observations; then what the closures moved is adjusted with what is around it, or the whole map
//! where that is small or nearly all moved. Windows and pose graphs go on beside it: what they moved
//! meanwhile goes along (`map/src/meanwhile.rs`). A pose graph that moves far or judges otherwise, and a
//! requested optimization, make what runs here stale: it is canceled and starts again from the newer
//! state. A window that runs when an adjustment is applied is solved again. What is due is part of the
//! map, except for what moved: after a restart the whole is adjusted. In lock-step the background has its
//! turn when nothing else does, adjusts the whole, and the next item waits for it.

use std::collections::BTreeSet;
use std::sync::Arc;

use covis_solvers::interrupt::Interrupt;
use covis_solvers::optimizer;
use rayon::prelude::*;

use crate::map::{
    AppliedSolve, Change, Comparison, Constraint, EntityId, Map, SolveKind, SwitchedOff,
    find_duplicates, region_problem,
};
use crate::service::engine::context::MapContext;
use crate::service::engine::outcome::{OptimizeOptions, Outcome};
use crate::service::engine::pool::{Slot, SolverPool};
use crate::service::engine::solving::whole::solve_map;
use crate::service::engine::solving::window::{WindowOptions, solve_window};
use crate::service::engine::{Estimate, Fault};

/// Closures that are compared at once, on the threads that there are; the journal then has them.
const COMPARED_AT_ONCE: usize = 16;

/// Closures that are compared before an adjustment that is due has its turn, where they keep coming.
const MOST_COMPARED: usize = 128;

/// Iterations of an adjustment of the whole map. The next closure starts another one, and a requested
/// optimization continues until it converges.
const MOST_ITERATIONS: usize = 20;

/// What a background task made.
pub(crate) enum Done {
    Compared(Vec<Comparison>),
    Adjusted(Box<Outcome>),
}

/// The keyframes that closures moved or join; `None` where that is not known, and the whole counts.
type Region = Option<BTreeSet<EntityId>>;

/// The task that runs.
#[derive(Default)]
pub(crate) struct Task {
    /// What it adjusts; `Some` of no keyframes where it compares.
    region: Region,
    /// Whether a pose graph ended since it began: its own adjustment is still due.
    pub(crate) is_overtaken: bool,
}

/// The background tasks of a map, one at a time.
pub(crate) struct Background {
    shared: Arc<MapContext>,
    pub(crate) work: Slot<Done, Task>,
    /// Whether something may be due. To know takes a pass over the constraints.
    may_be_due: bool,
    /// Whether the journal has refused a change and has taken none since.
    waits_for_journal: bool,
    /// Whether the whole map could not be adjusted since the last pose graph.
    gave_up: bool,
    /// Whether a task has panicked: the next would most likely panic too, and none starts until the map is
    /// opened anew.
    is_off: bool,
    /// What is to be adjusted.
    region: Region,
    /// Closures that were compared since the last adjustment.
    compared: usize,
}

impl Background {
    pub(crate) fn new(shared: &Arc<MapContext>, pool: &Arc<SolverPool>) -> Self {
        Self {
            shared: Arc::clone(shared),
            work: Slot::new(pool, &shared.account),
            may_be_due: true,
            waits_for_journal: false,
            gave_up: false,
            is_off: false,
            region: None,
            compared: 0,
        }
    }

    /// Whether a task may start: none runs, and something may be due.
    pub(crate) fn may_start(&self) -> bool {
        self.work.is_free() && self.may_be_due
    }

    /// Whether no task starts any more.
    pub(crate) fn is_off(&self) -> bool {
        self.is_off
    }

    /// A task has panicked: no other one starts.
    pub(crate) fn turn_off(&mut self) {
        self.is_off = true;
    }

    /// A task has ended: the next may be due.
    pub(crate) fn ended(&mut self) {
        self.may_be_due = true;
    }

    /// Nothing is due until the map changes.
    pub(crate) fn rest(&mut self) {
        self.may_be_due = false;
    }

    /// The whole map cannot be adjusted until the next pose graph.
    pub(crate) fn give_up(&mut self) {
        self.gave_up = true;
    }

    /// Whether nothing runs or is due.
    pub(crate) fn is_idle(&self) -> bool {
        self.work.is_free() && !self.may_be_due
    }

    /// Whether something runs or is due, for readers. Takes a pass over the constraints where something
    /// may be due.
    pub(crate) fn is_pending(&self, map: &Map) -> bool {
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

    /// Notes what a change that is in the journal makes due or stale; `map` is the map before it.
    pub(crate) fn changed(&mut self, map: &Map, change: &Change) {
        if let Change::SolveApplied { solve } = change
            && solve.kind != SolveKind::LocalBundle
        {
            (self.may_be_due, self.gave_up) = (true, false);
            self.overtaken(map, solve);
        }
        self.extend_region(ends(map, change));
        if matches!(change, Change::MapMerged { .. }) {
            // What came brings what was due for it.
            self.region = None;
        }
        let makes_due = matches!(
            change,
            Change::ConstraintRevoked { .. }
                | Change::KeyframeRemoved { .. }
                | Change::DuplicatesSplit { .. }
                | Change::MapMerged { .. }
                | Change::MapTakenOut { .. }
                | Change::MapUpdated { .. }
        );
        self.may_be_due |= makes_due || std::mem::take(&mut self.waits_for_journal);
    }

    /// A pose graph or a solve of the whole ended beside what runs here.
    fn overtaken(&mut self, map: &Map, solve: &AppliedSolve) {
        let Some(task) = self.work.running() else { return };
        let is_solved = |id| task.region.as_ref().is_none_or(|own| own.contains(&id));
        let is_new = |&(id, _): &(EntityId, SwitchedOff)| !map.switched_off().contains_key(&id);
        let is_judged = !solve.switched_on.is_empty() || solve.switched_off.iter().any(is_new);
        let is_whole = solve.kind == SolveKind::Global;
        if is_whole || is_judged || map.moves_far(solve, is_solved) {
            self.work.cancel();
        } else {
            task.is_overtaken = true;
        }
    }

    fn extend_region(&mut self, keyframes: impl IntoIterator<Item = EntityId>) {
        if let Some(region) = &mut self.region {
            region.extend(keyframes);
        }
    }

    /// A task was dropped: what it was to adjust still is.
    pub(crate) fn dropped(&mut self, task: Task) {
        match task.region {
            Some(own) => self.extend_region(own),
            None => self.region = None,
        }
    }

    /// A change could not be journaled: what is due waits until the journal takes another one.
    pub(crate) fn wait_for_journal(&mut self) {
        (self.may_be_due, self.waits_for_journal) = (false, true);
    }

    /// Starts the next task, if one is due. `may_adjust` says whether that may be an adjustment.
    pub(crate) fn start(&mut self, map: &Arc<Map>, is_lock_step: bool, may_adjust: bool) {
        self.may_be_due = false;
        if self.is_off || !map.policy().closure_adjustment {
            return;
        }
        let is_adjustment_due = map.is_adjustment_due() && !self.gave_up;
        let has_moved = self.region.as_ref().is_none_or(|region| !region.is_empty());
        let has_turn = has_moved && self.compared >= MOST_COMPARED && !is_lock_step;
        let goes_first = is_adjustment_due && may_adjust && has_turn;
        let closures: Vec<EntityId> = match goes_first {
            true => Vec::new(),
            false => map.uncompared_closures().take(COMPARED_AT_ONCE).collect(),
        };
        if !closures.is_empty() {
            self.compared += closures.len();
            self.start_comparison(Arc::clone(map), closures);
        } else if is_adjustment_due && may_adjust {
            self.compared = 0;
            self.start_adjustment(Arc::clone(map), is_lock_step);
        }
    }

    /// Whether an adjustment is due of which nothing is left: no closure moved or joined anything since the last.
    pub(crate) fn has_nothing_to_adjust(&self, map: &Map) -> bool {
        let is_empty = self.region.as_ref().is_some_and(BTreeSet::is_empty);
        is_empty && self.is_due(map) && map.uncompared_closures().next().is_none()
    }

    /// Adjusts what closures moved, or the whole map.
    fn start_adjustment(&mut self, map: Arc<Map>, is_lock_step: bool) {
        let ceiling = self.shared.config.ceiling();
        let max_iterations = MOST_ITERATIONS;
        let whole = Estimate::of_map(map.usage(), max_iterations, &ceiling);
        let region = self.region.replace(BTreeSet::new());
        // Lock-step gives the same bits with and without a restart, which forgets what moved.
        let region = region.filter(|_| !whole.is_small() && !is_lock_step);
        let span = tracing::debug_span!("adjust", map = %self.shared.name, part = region.as_ref().map(BTreeSet::len));
        let queued = self.shared.meters.solve(SolveKind::Global);
        let task = Task { region: region.clone(), is_overtaken: false };
        let meters = Arc::clone(&self.shared.meters);
        self.work.start(task, whole, Arc::default(), move |cancel| {
            let _entered = span.entered();
            let solve = || match region.and_then(|region| region_problem(&map, &region)) {
                Some(problem) => {
                    drop(map);
                    let options = WindowOptions { max_iterations, ceiling, learns: false };
                    solve_window(problem, &options, cancel, &mut |why| meters.disbelieve(why))
                }
                None => {
                    let optimizer = optimizer::Options {
                        max_iterations,
                        ceiling,
                        ..optimizer::Options::default()
                    };
                    let options = OptimizeOptions { optimizer, ..OptimizeOptions::default() };
                    solve_map(map, &options, &mut |_row| {}, cancel)
                }
            };
            Done::Adjusted(Box::new(queued.solve(solve)))
        });
    }

    fn start_comparison(&mut self, map: Arc<Map>, closures: Vec<EntityId>) {
        let panics = self.shared.config.injects(Fault::PanicInBackground);
        let task = Task { region: Some(BTreeSet::new()), is_overtaken: false };
        self.work.start(task, Estimate::LONG, Arc::default(), move |cancel| {
            if panics {
                std::panic::panic_any("staged by a test");
            }
            let interrupt = Interrupt::NEVER.or_when(Arc::clone(cancel));
            let find = |&closure: &EntityId| find_duplicates(&map, closure, &interrupt);
            Done::Compared(closures.par_iter().filter_map(find).collect())
        });
    }
}

/// The keyframes that a change moves as a pose graph does, or that are ends of a closure in it.
fn ends(map: &Map, change: &Change) -> Vec<EntityId> {
    let both = |constraint: &Constraint| [constraint.keyframe_i, constraint.keyframe_j];
    if let Change::SolveApplied { solve } = change
        && solve.kind == SolveKind::PoseGraph
    {
        solve.poses.iter().map(|&(id, _)| id).collect()
    } else if let Change::ConstraintAdded { constraint, .. } = change
        && constraint.is_closure()
    {
        both(constraint).to_vec()
    } else if let Change::PlacesSearched { closures, .. } = change {
        closures.iter().flat_map(|(_, constraint)| both(constraint)).collect()
    } else if let Change::DuplicatesFound { comparisons } = change {
        let joined = comparisons.iter().filter(|comparison| !comparison.pairs.is_empty());
        let closures = joined.filter_map(|joined| map.constraints().get(&joined.closure));
        closures.flat_map(both).collect()
    } else {
        Vec::new()
    }
}
