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

use super::actor::Actor;
use super::handle::Shared;
use super::pool::{Ended, Slot, SolverPool};
use super::solve::{OptimizeOptions, Outcome, Solution, solve_map};
use super::window_solve::{WindowOptions, solve_window};
use super::{EngineError, Estimate, Fault};
use crate::map::{
    AppliedSolve, Change, Comparison, Constraint, EntityId, Map, Reach, SolveKind, SwitchedOff,
    find_duplicates, region_problem,
};

/// Closures that are compared at once, on the threads that there are; the journal then has them.
const COMPARED_AT_ONCE: usize = 16;

/// Closures that are compared before an adjustment that is due has its turn, where they keep coming.
const MOST_COMPARED: usize = 128;

/// Iterations of an adjustment of the whole map. The next closure starts another one, and a requested
/// optimization continues until it converges.
const MOST_ITERATIONS: usize = 20;

/// What a background task made.
pub(super) enum Done {
    Compared(Vec<Comparison>),
    Adjusted(Box<Outcome>),
}

/// The keyframes that closures moved or join; `None` where that is not known, and the whole counts.
type Region = Option<BTreeSet<EntityId>>;

/// The task that runs.
#[derive(Default)]
pub(super) struct Task {
    /// What it adjusts; `Some` of no keyframes where it compares.
    region: Region,
    /// Whether a pose graph ended since it began: its own adjustment is still due.
    is_overtaken: bool,
}

/// The background tasks of a map, one at a time.
pub(super) struct Background {
    shared: Arc<Shared>,
    pub(super) work: Slot<Done, Task>,
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
    pub(super) fn new(shared: &Arc<Shared>, pool: &Arc<SolverPool>) -> Self {
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

    /// Notes what a change that is in the journal makes due or stale; `map` is the map before it.
    pub(super) fn changed(&mut self, map: &Map, change: &Change) {
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
                | Change::PolicySet { .. }
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
    fn dropped(&mut self, task: Task) {
        match task.region {
            Some(own) => self.extend_region(own),
            None => self.region = None,
        }
    }

    /// A change could not be journaled: what is due waits until the journal takes another one.
    fn wait_for_journal(&mut self) {
        (self.may_be_due, self.waits_for_journal) = (false, true);
    }

    /// Starts the next task, if one is due. `may_adjust` says whether that may be an adjustment.
    fn start(&mut self, map: &Arc<Map>, is_lock_step: bool, may_adjust: bool) {
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
    fn has_nothing_to_adjust(&self, map: &Map) -> bool {
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
        let leaves_room = self.solving.leaves_room(is_lock_step);
        if leaves_room && !is_lock_step && self.background.has_nothing_to_adjust(&self.map) {
            self.background.may_be_due = false;
            self.commit_in_background(Change::SolveApplied {
                solve: AppliedSolve::unchanged(SolveKind::Global),
            })
            .await;
        } else if (leaves_room || !is_lock_step) && !searches {
            self.background.start(&self.map, is_lock_step, leaves_room);
        }
    }

    /// Handles the end of the background task.
    pub(super) async fn background_ended(&mut self, (task, ended): (Task, Ended<Done>)) {
        self.background.may_be_due = true;
        let done = match ended {
            Ended::Made(done) => done,
            Ended::Dropped => return self.background.dropped(task),
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
                Change::DuplicatesFound { comparisons }
            }
            Done::Adjusted(outcome) => match self.adjustment(&task, *outcome).await {
                Some(change) => change,
                None => return self.background.dropped(task),
            },
        };
        if !self.commit_in_background(change).await {
            self.background.dropped(task);
        }
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
    async fn adjustment(&mut self, task: &Task, outcome: Outcome) -> Option<Change> {
        let solution = outcome.unwrap_or_else(|error| {
            let map = &self.shared.name;
            tracing::warn!(%error, %map, "the map could not be adjusted after a closure");
            None
        });
        let is_sound = |solution: &Solution| {
            solution.refused.is_none() && solution.certificate.solve.final_cost.is_finite()
        };
        let Some(Solution { moved, certificate, .. }) = solution.filter(is_sound) else {
            self.background.gave_up = true;
            return None;
        };
        // It moves what the window holds.
        self.solving.supersede_window();
        let costs = (certificate.solve.initial_cost, certificate.solve.final_cost);
        let (kind, reach) = (SolveKind::Global, Reach::Noticeable { if_contradicted: false });
        let solve = self.result(moved, kind, Vec::new(), costs, reach).await.ok();
        self.background.gave_up |= solve.is_none();
        let mut solve = solve?;
        if task.is_overtaken || self.map.uncompared_closures().next().is_some() {
            // What the pose graph moved, or a comparison will join, is still to be adjusted.
            solve.kind = SolveKind::LocalBundle;
        }
        Some(Change::SolveApplied { solve })
    }
}
