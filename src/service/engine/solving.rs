//! Solving: which items wait for which solve, and the solve that runs. A map runs one at a time.
//!
//! A trigger is an item that starts a solve: a window around keyframes, or a pose graph. Several
//! triggers may be covered by one solve. A client's items are optimized up to sequence s once none
//! of its triggers up to s is open: OPTIMIZED acks are cumulative.
//!
//! Priors wait for a pose graph as loop closures do, but let one window go first: a receiver's fixes
//! may come faster than pose graphs are solved, and all that wait are covered by one solve.
//!
//! Order: loop closures first, then a requested optimization (in lock-step it waits for the
//! windows), then windows. Within a batch the newest window is solved first, and a batch is finished
//! before the next begins, so that no window starves. A loop closure or an optimization supersedes a
//! window that is being solved: its result is dropped, and it is solved again from the newer state.
//! A window is built on another thread while the engine waits, so that a local solve holds no
//! snapshot and causes no copy of the map.

use std::collections::{BTreeMap, BTreeSet};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

use covis_solvers::{bundle_adjustment, optimizer};
use tokio::sync::oneshot;

use super::handle::Shared;
use super::measured_pairs::MeasuredPairs;
use super::pool::{SolvePanicked, SolverPool, answered};
use super::solve::{Job, Outcome, solve_loop, solve_map, solve_map_graph, solve_window};
use super::{EngineError, Estimate, Fault, OptimizeOutcome, OptimizeProblem};
use crate::map::{ClientIndex, EntityId, Map, SolveKind, choose_window_of, local_problem};

/// The solve that runs.
pub(super) struct Running {
    pub(super) id: i64,
    pub(super) kind: SolveKind,
    /// Whether it was requested.
    pub(super) is_job: bool,
    /// The triggers that it covers.
    pub(super) triggers: Vec<u64>,
    superseded: bool,
    cancel: Arc<AtomicBool>,
    answer: oneshot::Receiver<Result<Outcome, SolvePanicked>>,
}

/// The solves of a map.
pub(super) struct Solving {
    shared: Arc<Shared>,
    pool: Arc<SolverPool>,
    pairs: Arc<MeasuredPairs>,
    pub(super) schedule: Schedule,
    running: Option<Running>,
    /// The optimization that waits or runs.
    job: Option<Job>,
    last_id: i64,
    /// Whether a pose graph ran since the last window.
    prior_went: bool,
}

impl Solving {
    /// `last_id` is the number of the map's last solve.
    pub(super) fn new(shared: &Arc<Shared>, pool: &Arc<SolverPool>, last_id: i64) -> Self {
        let (shared, pool) = (Arc::clone(shared), Arc::clone(pool));
        let (pairs, schedule) = (Arc::default(), Schedule::default());
        let (running, job, prior_went) = (None, None, false);
        Self { shared, pool, pairs, schedule, running, job, last_id, prior_went }
    }

    /// What was measured between keyframes.
    pub(super) fn pairs(&self) -> &Arc<MeasuredPairs> {
        &self.pairs
    }

    /// Whether no solve runs or waits.
    pub(super) fn is_idle(&self) -> bool {
        self.running.is_none() && self.schedule.is_empty() && self.job.is_none()
    }

    /// Whether a background task may start: what it does would be stale after a pose graph or a
    /// requested optimization. In lock-step everything else comes first.
    pub(super) fn leaves_room(&self, is_lock_step: bool) -> bool {
        let runs_window =
            self.running.as_ref().is_none_or(|running| running.kind == SolveKind::LocalBundle);
        let waits = self.schedule.has_loop() || self.schedule.has_prior() || self.job.is_some();
        if is_lock_step { self.is_idle() } else { runs_window && !waits }
    }

    /// Starts the next solve, if none runs and one is due. Returns triggers for which there turned
    /// out to be nothing to solve; then another solve may be due.
    pub(super) async fn start_next(
        &mut self,
        map: &Arc<Map>,
        is_lock_step: bool,
    ) -> Option<Vec<u64>> {
        while self.running.is_none() {
            let is_due = self.schedule.has_loop()
                || (self.schedule.has_prior() && !(self.prior_went && self.schedule.has_window()));
            if is_due {
                self.prior_went = true;
                let loops = self.schedule.loops();
                self.start_loop(map, loops);
            } else if self.job.is_some() && (!is_lock_step || self.schedule.is_empty()) {
                self.start_job(map);
            } else {
                let keyframes = self.schedule.next_window()?;
                self.prior_went = false;
                let nothing = self.start_window(map, keyframes).await;
                if nothing.is_some() {
                    return nothing;
                }
            }
        }
        None
    }

    fn start_loop(&mut self, map: &Arc<Map>, triggers: Vec<u64>) {
        let (map, ceiling) = (Arc::clone(map), self.shared.config.ceiling());
        let max_iterations = optimizer::Options::default().max_iterations;
        let estimate = Estimate::of_map(map.usage(), max_iterations, &ceiling);
        let pairs = Arc::clone(&self.pairs);
        self.launch(SolveKind::PoseGraph, estimate, triggers, None, move |cancel| {
            solve_loop(map, &pairs, ceiling, cancel)
        });
    }

    fn start_job(&mut self, map: &Arc<Map>) {
        if let Some(job) = self.job.take_if(|job| job.is_canceled()) {
            return job.answer(Err(EngineError::Cancelled { map: self.shared.name.clone() }));
        }
        let Some(job) = &self.job else { return };
        let _entered = job.span.clone().entered();
        let (mut options, rows) = (job.options, job.rows.clone());
        let cancel = Some(Arc::clone(&job.cancel));
        options.optimizer.ceiling = self.shared.config.ceiling();
        let map = Arc::clone(map);
        let optimizer = &options.optimizer;
        let estimate = Estimate::of_map(map.usage(), optimizer.max_iterations, &optimizer.ceiling);
        match options.problem {
            OptimizeProblem::Full => {
                let triggers = self.schedule.all();
                self.launch(SolveKind::Global, estimate, triggers, cancel, move |cancel| {
                    solve_map(map, &options, &rows, cancel)
                });
            }
            OptimizeProblem::PoseGraph { certify } => {
                // Covers no windows: a pose graph moves no landmark relative to its keyframes.
                let loops = self.schedule.loops();
                let pairs = Arc::clone(&self.pairs);
                self.launch(SolveKind::PoseGraph, estimate, loops, cancel, move |cancel| {
                    solve_map_graph(map, &pairs, &options, certify, &rows, cancel)
                });
            }
        }
        if let Some(running) = &mut self.running {
            running.is_job = true;
        }
    }

    /// Returns the window's triggers if there is nothing to solve.
    async fn start_window(
        &mut self,
        map: &Arc<Map>,
        keyframes: Arc<[EntityId]>,
    ) -> Option<Vec<u64>> {
        let centers = Arc::clone(&keyframes);
        let max_iterations = map.policy().max_local_iterations;
        let ceiling = self.shared.config.ceiling();
        let pairs = Arc::clone(&self.pairs);
        let built = self.pool.compute_from(map, move |map| {
            // The pairs of an edit are measured by the pose graph that needs them.
            let unmeasured = match *centers {
                [keyframe] => pairs.unmeasured_near(map, keyframe),
                _ => Vec::new(),
            };
            let window = choose_window_of(map, &centers);
            let problem = local_problem(map, &window);
            let estimate = problem.is_solvable().then(|| {
                let bound = bundle_adjustment::price_bound(&problem.problem);
                Estimate::new(bound, max_iterations, &ceiling)
            });
            (window.free, problem, estimate, unmeasured)
        });
        let (free, problem, estimate, unmeasured) = built.await;
        let triggers = self.schedule.within(&keyframes, &free);
        let Some(estimate) = estimate else { return Some(triggers) };
        let pairs = Arc::clone(&self.pairs);
        self.launch(SolveKind::LocalBundle, estimate, triggers, None, move |cancel| {
            pairs.measure(unmeasured);
            solve_window(problem, max_iterations, ceiling, cancel)
        });
        None
    }

    fn launch(
        &mut self,
        kind: SolveKind,
        estimate: Estimate,
        triggers: Vec<u64>,
        cancel: Option<Arc<AtomicBool>>,
        work: impl FnOnce(&Arc<AtomicBool>) -> Outcome + Send + 'static,
    ) {
        self.last_id += 1;
        let (id, shared) = (self.last_id, &self.shared);
        let span = tracing::debug_span!("solve", map = %shared.name, solve = id, ?kind);
        let queued = shared.meters.solve(kind);
        let panics = shared.config.injects(Fault::PanicInSolve);
        let cancel = cancel.unwrap_or_default();
        let flag = Arc::clone(&cancel);
        let answer = self.pool.start(&shared.account, estimate, move || {
            let _entered = span.entered();
            let started = queued.started();
            if panics {
                std::panic::panic_any("staged by a test");
            }
            started.ended(work(&flag))
        });
        let (is_job, superseded) = (false, false);
        self.running = Some(Running { id, kind, is_job, triggers, superseded, cancel, answer });
    }

    /// Drops the result of a window that is being solved; the window is solved again later.
    pub(super) fn supersede_window(&mut self) {
        if let Some(running) = &mut self.running
            && running.kind == SolveKind::LocalBundle
        {
            running.superseded = true;
            running.cancel.store(true, Ordering::Relaxed);
        }
    }

    /// Accepts a request to optimize the map, unless there is one already.
    pub(super) fn request(&mut self, job: Job, is_lock_step: bool) {
        if self.job.is_some() {
            let map = self.shared.name.clone();
            return job.answer(Err(EngineError::OptimizationRunning { map }));
        }
        self.job = Some(job);
        if !is_lock_step {
            self.supersede_window();
        }
    }

    /// Resolves when the running solve has ended; never if none runs.
    pub(super) async fn ended(&mut self) -> Result<Outcome, SolvePanicked> {
        match &mut self.running {
            Some(running) => answered((&mut running.answer).await),
            None => std::future::pending().await,
        }
    }

    /// The solve that has ended with `outcome`; `None` if its result is dropped.
    ///
    /// # Errors
    /// [`SolvePanicked`].
    pub(super) fn take_ended(
        &mut self,
        outcome: Result<Outcome, SolvePanicked>,
    ) -> Result<Option<(Running, Outcome)>, SolvePanicked> {
        let Some(running) = self.running.take() else { return Ok(None) };
        let outcome = outcome.inspect_err(|_| self.shared.meters.solve_panics.increment())?;
        if running.superseded {
            self.shared.meters.superseded.increment();
            self.pool.discard(outcome);
            return Ok(None);
        }
        Ok(Some((running, outcome)))
    }

    /// Whether the caller of the requested optimization went away.
    pub(super) fn is_job_canceled(&self) -> bool {
        self.job.as_ref().is_none_or(Job::is_canceled)
    }

    /// Answers the requested optimization, which has ended.
    pub(super) fn answer_job(&mut self, answer: Result<OptimizeOutcome, EngineError>) {
        if let Some(job) = self.job.take() {
            job.answer(answer);
        }
    }

    /// Drops the results of the running solve and ends a requested optimization with `error`. The
    /// items that the running solve covers wait for a later one.
    pub(super) fn pause(&mut self, error: &EngineError) {
        if let Some(running) = &mut self.running {
            running.superseded = true;
            running.cancel.store(true, Ordering::Relaxed);
        }
        self.answer_job(Err(error.clone()));
    }

    /// Cancels every running or waiting solve.
    pub(super) fn cancel(&mut self, error: &EngineError) {
        if let Some(running) = self.running.take() {
            running.cancel.store(true, Ordering::Relaxed);
        }
        self.answer_job(Err(error.clone()));
        self.schedule.clear();
    }
}

/// The solve that a trigger starts.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) enum Task {
    /// Local bundle adjustment around keyframes: a new one, or those that an edit concerns.
    Window(Arc<[EntityId]>),
    /// Pose-graph optimization.
    Loop,
    /// Pose-graph optimization that may wait for a window.
    Prior,
}

impl Task {
    /// Local bundle adjustment around one keyframe.
    pub(super) fn around(keyframe: EntityId) -> Self {
        Self::Window(Arc::new([keyframe]))
    }
}

#[derive(Clone, Debug)]
struct Trigger {
    client: ClientIndex,
    sequence: i64,
    task: Task,
}

/// The open triggers in the order of their arrival.
#[derive(Debug, Default)]
pub(super) struct Schedule {
    open: BTreeMap<u64, Trigger>,
    next_arrival: u64,
    /// Triggers that arrived before this one belong to the current batch.
    batch_end: u64,
    /// Triggers that are done but wait for an earlier one of their client.
    done: BTreeMap<ClientIndex, BTreeSet<i64>>,
}

impl Schedule {
    /// Adds a trigger.
    pub(super) fn push(&mut self, client: ClientIndex, sequence: i64, task: Task) {
        self.open.insert(self.next_arrival, Trigger { client, sequence, task });
        self.next_arrival += 1;
    }

    /// Adds a trigger for which there is nothing to solve and returns the client's new mark, if no
    /// earlier trigger is open.
    pub(super) fn push_done(&mut self, client: ClientIndex, sequence: i64) -> Option<i64> {
        self.done.entry(client).or_default().insert(sequence);
        self.advance(client)
    }

    pub(super) fn is_empty(&self) -> bool {
        self.open.is_empty()
    }

    /// Whether an ack for the client is still to come.
    pub(super) fn is_waiting(&self, client: ClientIndex) -> bool {
        self.open.values().any(|t| t.client == client)
    }

    /// The client's first sequence that waits for a solve.
    pub(super) fn first_open(&self, client: ClientIndex) -> Option<i64> {
        self.open.values().filter(|t| t.client == client).map(|t| t.sequence).min()
    }

    /// Removes all triggers, because nothing more will be solved.
    pub(super) fn clear(&mut self) {
        self.open.clear();
        self.done.clear();
    }

    /// Every open trigger.
    pub(super) fn all(&self) -> Vec<u64> {
        self.open.keys().copied().collect()
    }

    /// The open loop closures and priors: one pose graph covers them all.
    pub(super) fn loops(&self) -> Vec<u64> {
        let is_loop = |task: &Task| matches!(task, Task::Loop | Task::Prior);
        self.open.iter().filter(|(_, t)| is_loop(&t.task)).map(|(&a, _)| a).collect()
    }

    /// Whether a loop closure is open.
    fn has_loop(&self) -> bool {
        self.open.values().any(|trigger| trigger.task == Task::Loop)
    }

    /// Whether a prior is open.
    fn has_prior(&self) -> bool {
        self.open.values().any(|trigger| trigger.task == Task::Prior)
    }

    /// Whether a window is open.
    fn has_window(&self) -> bool {
        self.open.values().any(|trigger| matches!(trigger.task, Task::Window(_)))
    }

    /// The keyframes whose window is next: those of the newest trigger of the batch.
    pub(super) fn next_window(&mut self) -> Option<Arc<[EntityId]>> {
        let newest = |end: u64| {
            self.open.range(..end).rev().find_map(|(_, trigger)| match &trigger.task {
                Task::Window(keyframes) => Some(Arc::clone(keyframes)),
                Task::Loop | Task::Prior => None,
            })
        };
        if let Some(keyframes) = newest(self.batch_end) {
            return Some(keyframes);
        }
        self.batch_end = self.next_arrival;
        newest(self.batch_end)
    }

    /// The open triggers whose keyframes are all among `centers` or `free`, which is sorted.
    pub(super) fn within(&self, centers: &[EntityId], free: &[EntityId]) -> Vec<u64> {
        let covered = |id: &EntityId| free.binary_search(id).is_ok() || centers.contains(id);
        let covers = |task: &Task| match task {
            Task::Window(keyframes) => keyframes.iter().all(covered),
            Task::Loop | Task::Prior => false,
        };
        self.open.iter().filter(|(_, t)| covers(&t.task)).map(|(&arrival, _)| arrival).collect()
    }

    /// The marks that closing these triggers would reach, by client.
    pub(super) fn preview(&self, arrivals: &[u64]) -> Vec<(ClientIndex, i64)> {
        let closed: BTreeSet<u64> = arrivals.iter().copied().collect();
        let mut reached: BTreeMap<ClientIndex, BTreeSet<i64>> = BTreeMap::new();
        for trigger in arrivals.iter().filter_map(|a| self.open.get(a)) {
            reached
                .entry(trigger.client)
                .or_insert_with(|| self.done.get(&trigger.client).cloned().unwrap_or_default())
                .insert(trigger.sequence);
        }
        reached
            .into_iter()
            .filter_map(|(client, done)| {
                let open = self.open.iter().filter(|(a, _)| !closed.contains(a));
                let open = open.filter(|(_, t)| t.client == client).map(|(_, t)| t.sequence);
                Some((client, mark(&done, open.min())?))
            })
            .collect()
    }

    /// Closes triggers and returns the new marks.
    pub(super) fn close(&mut self, arrivals: &[u64]) -> Vec<(ClientIndex, i64)> {
        let mut clients = BTreeSet::new();
        for arrival in arrivals {
            if let Some(trigger) = self.open.remove(arrival) {
                self.done.entry(trigger.client).or_default().insert(trigger.sequence);
                clients.insert(trigger.client);
            }
        }
        clients.into_iter().filter_map(|c| Some((c, self.advance(c)?))).collect()
    }

    fn advance(&mut self, client: ClientIndex) -> Option<i64> {
        let open = self.first_open(client);
        let done = self.done.get_mut(&client)?;
        let mark = mark(done, open)?;
        done.retain(|&sequence| sequence > mark);
        if done.is_empty() {
            self.done.remove(&client);
        }
        Some(mark)
    }
}

/// The last sequence that is done before the first open one.
fn mark(done: &BTreeSet<i64>, first_open: Option<i64>) -> Option<i64> {
    let before = first_open.unwrap_or(i64::MAX);
    done.range(..before).next_back().copied()
}

#[cfg(test)]
mod tests {
    use super::*;

    const A: ClientIndex = ClientIndex(0);
    const B: ClientIndex = ClientIndex(1);

    fn keyframe(client: ClientIndex, id: i64) -> EntityId {
        EntityId::new(client, id)
    }

    #[test]
    fn marks_wait_for_earlier_triggers_of_the_same_client() {
        let mut schedule = Schedule::default();
        schedule.push(A, 3, Task::around(keyframe(A, 0)));
        schedule.push(A, 5, Task::Loop);
        schedule.push(B, 1, Task::around(keyframe(B, 0)));
        let loops = schedule.loops();
        assert_eq!(schedule.preview(&loops), []);
        assert_eq!(schedule.close(&loops), []);
        assert_eq!(schedule.push_done(A, 6), None);
        assert_eq!(schedule.push_done(B, 2), None);
        let rest = schedule.all();
        assert_eq!(schedule.preview(&rest), [(A, 6), (B, 2)]);
        assert_eq!(schedule.close(&rest), [(A, 6), (B, 2)]);
        assert!(schedule.is_empty() && !schedule.is_waiting(A));
        assert_eq!(schedule.push_done(A, 7), Some(7));
    }

    #[test]
    fn a_batch_is_worked_off_newest_first_before_later_arrivals() {
        let mut schedule = Schedule::default();
        for id in 0..3 {
            schedule.push(A, id + 1, Task::around(keyframe(A, id)));
        }
        assert_eq!(schedule.next_window().as_deref(), Some(&[keyframe(A, 2)][..]));
        let covered = schedule.within(&[keyframe(A, 2)], &[keyframe(A, 1)]);
        assert_eq!(schedule.close(&covered), []);
        schedule.push(A, 9, Task::around(keyframe(A, 9)));
        assert_eq!(schedule.next_window().as_deref(), Some(&[keyframe(A, 0)][..]));
        let covered = schedule.within(&[keyframe(A, 0)], &[]);
        assert_eq!(schedule.close(&covered), [(A, 3)]);
        assert_eq!(schedule.next_window().as_deref(), Some(&[keyframe(A, 9)][..]));
    }

    #[test]
    fn a_window_covers_an_edit_whose_keyframes_are_all_in_it() {
        let mut schedule = Schedule::default();
        let group: Vec<EntityId> = (0..3).map(|id| keyframe(A, id)).collect();
        schedule.push(A, 1, Task::Window(group.clone().into()));
        // The pose graph of the same item.
        schedule.push(A, 1, Task::Loop);
        schedule.push(A, 2, Task::around(keyframe(A, 1)));
        assert_eq!(schedule.within(&group[1..2], &group[..2]), [2], "one of three is not in it");
        assert_eq!(schedule.within(&group, &[]), [0, 2]);
        let loops = schedule.loops();
        assert_eq!(schedule.close(&loops), [], "the item waits for its window too");
        assert_eq!(schedule.close(&[0, 2]), [(A, 2)]);
    }
}
