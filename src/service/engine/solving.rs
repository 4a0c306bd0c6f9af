//! Starting and ending solves. A map runs one window and one solve of the whole at a time; one may cover
//! several triggers of [`Schedule`].
//!
//! Priors wait for a pose graph as loop closures do, but let one window go first: a receiver's fixes
//! may come faster than pose graphs are solved, and all that wait are covered by one solve.
//!
//! Windows run beside a pose graph or a requested optimization, so that none waits for the whole map; in
//! lock-step one solve runs at a time, and a requested optimization waits for the windows. What ends while
//! a window runs is applied behind it, before the next one starts: no result is given up, and what windows
//! moved meanwhile goes along with it (`map/src/meanwhile.rs`).
//! A window is built on another thread while the engine waits, so that a local solve holds no
//! snapshot and causes no copy of the map.

use std::panic::resume_unwind;
use std::sync::Arc;
use std::sync::atomic::AtomicBool;

use covis_solvers::{bundle_adjustment, optimizer};

use super::actor::Actor;
use super::handle::Shared;
use super::pool::{Ended, Slot, SolverPool};
use super::results::switched_off;
use super::schedule::Schedule;
use super::solve::{Job, Outcome, Solution, solve_whole};
use super::window_solve::{WindowOptions, solve_window};
use super::{
    EngineError, Estimate, Fault, OptimizeOptions, OptimizeOutcome, OptimizeProblem, SolveReport,
    SolveStep,
};
use crate::map::{
    Change, EntityId, Map, Reach, RequestId, SolveKind, choose_window_while, local_problem,
};

/// Windows of which one finds how uncertain odometry is: they overlap, and it takes as long as an iteration.
const LEARN_EVERY: i64 = 8;

/// The solve that runs.
pub(super) struct Running {
    pub(super) id: i64,
    pub(super) kind: SolveKind,
    /// Whether it was requested.
    pub(super) is_job: bool,
    /// Whether it moves the map also where loop closures do not contradict it.
    moves: bool,
    /// The triggers that it covers.
    pub(super) triggers: Vec<u64>,
}

/// The solves of a map.
pub(super) struct Solving {
    shared: Arc<Shared>,
    pool: Arc<SolverPool>,
    pub(super) schedule: Schedule,
    window: Slot<Outcome, Running>,
    /// A pose graph or a requested optimization.
    whole: Slot<Outcome, Running>,
    /// The solve of the whole that has ended while a window runs.
    ended: Option<(Running, Ended<Outcome>)>,
    /// The optimization that waits or runs.
    job: Option<Job>,
    last_id: i64,
    /// Whether a pose graph ran since the last window.
    prior_went: bool,
    /// Whether more than loop closures asks for a pose graph: edits, or fixes.
    graph_moves: bool,
}

impl Solving {
    /// `last_id` is the number of the map's last solve.
    pub(super) fn new(shared: &Arc<Shared>, pool: &Arc<SolverPool>, last_id: i64) -> Self {
        let slot = || Slot::new(pool, &shared.account);
        Self {
            shared: Arc::clone(shared),
            pool: Arc::clone(pool),
            schedule: Schedule::default(),
            window: slot(),
            whole: slot(),
            ended: None,
            job: None,
            last_id,
            prior_went: false,
            graph_moves: false,
        }
    }

    /// Whether no solve runs or waits.
    pub(super) fn is_idle(&self) -> bool {
        let is_free = self.window.is_free() && self.is_whole_free();
        is_free && self.schedule.is_empty() && self.job.is_none()
    }

    /// Whether no pose graph and no requested optimization runs or is to be applied.
    fn is_whole_free(&self) -> bool {
        self.whole.is_free() && self.ended.is_none()
    }

    /// Whether a requested optimization waits or runs.
    pub(super) fn has_job(&self) -> bool {
        self.job.is_some()
    }

    /// Whether an adjustment may start: one that began before a pose graph or a requested optimization ends
    /// would correct once more what that corrects. In lock-step everything else comes first.
    pub(super) fn leaves_room(&self, is_lock_step: bool) -> bool {
        match is_lock_step {
            true => self.is_idle(),
            false => self.is_whole_free() && self.job.is_none(),
        }
    }

    /// Resolves with a solve whose result may be applied; never if none runs.
    pub(super) async fn ended(&mut self) -> (Running, Ended<Outcome>) {
        loop {
            if self.window.is_free()
                && let Some(ended) = self.ended.take()
            {
                return ended;
            }
            tokio::select! {
                biased;
                ended = self.window.ended() => return ended,
                ended = self.whole.ended() => self.ended = Some(ended),
            }
        }
    }

    /// Starts the solves that are due and may run. Returns triggers for which there turned out to be nothing
    /// to solve; then another solve may be due.
    pub(super) async fn start_next(
        &mut self,
        map: &Arc<Map>,
        is_lock_step: bool,
    ) -> Option<Vec<u64>> {
        loop {
            let may_start = self.is_whole_free() && (!is_lock_step || self.window.is_free());
            let is_job_due = self.job.is_some() && (!is_lock_step || self.schedule.is_empty());
            if may_start && self.schedule.is_pose_graph_due(self.prior_went) {
                self.prior_went = true;
                let ceiling = self.shared.config.ceiling();
                let optimizer = optimizer::Options { ceiling, ..optimizer::Options::default() };
                let problem = OptimizeProblem::PoseGraph { certify: false };
                let options = OptimizeOptions { optimizer, problem, ..Default::default() };
                self.start_whole(map, options, false, Arc::default(), |_step| {});
            } else if may_start && is_job_due {
                self.start_job(map);
            } else {
                let waits = self.ended.is_some() || (is_lock_step && !self.is_whole_free());
                if waits || !self.window.is_free() {
                    return None;
                }
                let keyframes = self.schedule.next_window()?;
                self.prior_went = false;
                let nothing = self.start_window(map, keyframes).await;
                if nothing.is_some() {
                    return nothing;
                }
            }
        }
    }

    fn start_job(&mut self, map: &Arc<Map>) {
        if let Some(job) = self.job.take_if(|job| job.is_canceled()) {
            return job.answer(Err(EngineError::Cancelled { map: self.shared.name.clone() }));
        }
        let Some(job) = &self.job else { return };
        let _entered = job.span.clone().entered();
        let (mut options, steps) = (job.options, job.steps.clone());
        let cancel = Arc::clone(job.cancellation.flag());
        options.optimizer.ceiling = self.shared.config.ceiling();
        self.start_whole(map, options, true, cancel, move |step| {
            // The receiver is gone when the caller went away; the solve is then canceled.
            let _gone = steps.send(step);
        });
    }

    /// Starts a solve of the whole map, which tells its steps to `tell`.
    fn start_whole(
        &mut self,
        map: &Arc<Map>,
        options: OptimizeOptions,
        is_job: bool,
        cancel: Arc<AtomicBool>,
        mut tell: impl FnMut(SolveStep) + Send + 'static,
    ) {
        let (kind, triggers) = match options.problem {
            OptimizeProblem::Full | OptimizeProblem::Rebuild => {
                (SolveKind::Global, self.schedule.all())
            }
            // Covers no windows: a pose graph moves no landmark relative to its keyframes.
            OptimizeProblem::PoseGraph { .. } => {
                (SolveKind::PoseGraph, self.schedule.pose_graph_triggers())
            }
        };
        let optimizer = &options.optimizer;
        let estimate = Estimate::of_map(map.usage(), optimizer.max_iterations, &optimizer.ceiling);
        let (map, pairs) = (Arc::clone(map), Arc::clone(&self.shared.pairs));
        self.launch(kind, is_job, triggers, estimate, cancel, move |cancel| {
            solve_whole(map, &pairs, &options, &mut tell, cancel)
        });
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
        let pairs = Arc::clone(&self.shared.pairs);
        let waiting = self.schedule.waiting();
        let panics = self.shared.config.injects(Fault::PanicInWindow);
        let built = self.pool.attempt(map, move |map| {
            if panics {
                std::panic::panic_any("staged by a test");
            }
            // The pairs of an edit are measured by the pose graph that needs them.
            let unmeasured = match *centers {
                [keyframe] => pairs.unmeasured_near(map, keyframe),
                _ => Vec::new(),
            };
            let window = choose_window_while(map, &centers, &waiting);
            let problem = local_problem(map, &window);
            let estimate = problem.is_solvable().then(|| {
                let bound = bundle_adjustment::price_bound(&problem.problem);
                Estimate::new(bound, max_iterations, &ceiling)
            });
            (window.free, problem, estimate, unmeasured)
        });
        let (free, problem, estimate, unmeasured) = match built.await {
            Ok(built) => built,
            Err(panicked) => {
                // It ends as a solve that panics does.
                let (triggers, cancel) = (self.schedule.within(&keyframes, &[]), Arc::default());
                let kind = SolveKind::LocalBundle;
                self.launch(kind, false, triggers, Estimate::LONG, cancel, move |_cancel| {
                    resume_unwind(Box::new(panicked.message))
                });
                return None;
            }
        };
        let triggers = self.schedule.within(&keyframes, &free);
        let Some(estimate) = estimate else { return Some(triggers) };
        let pairs = Arc::clone(&self.shared.pairs);
        let cancel = Arc::default();
        let learns = (map.solve_count() + 1) % LEARN_EVERY == 0;
        let options = WindowOptions { max_iterations, ceiling, learns };
        let meters = Arc::clone(&self.shared.meters);
        self.launch(SolveKind::LocalBundle, false, triggers, estimate, cancel, move |cancel| {
            pairs.measure(unmeasured);
            solve_window(problem, &options, cancel, &mut |why| meters.disbelieve(why))
        });
        None
    }

    fn launch(
        &mut self,
        kind: SolveKind,
        is_job: bool,
        triggers: Vec<u64>,
        estimate: Estimate,
        cancel: Arc<AtomicBool>,
        work: impl FnOnce(&Arc<AtomicBool>) -> Outcome + Send + 'static,
    ) {
        self.last_id += 1;
        let (id, shared) = (self.last_id, &self.shared);
        let span = tracing::debug_span!("solve", map = %shared.name, solve = id, ?kind);
        let queued = shared.meters.solve(kind);
        let panics = shared.config.injects(Fault::PanicInSolve);
        let is_graph = kind == SolveKind::PoseGraph;
        let moves = is_graph && std::mem::take(&mut self.graph_moves);
        let running = Running { id, kind, is_job, moves, triggers };
        let slot = match kind {
            SolveKind::LocalBundle => &mut self.window,
            SolveKind::PoseGraph | SolveKind::Global => &mut self.whole,
        };
        slot.start(running, estimate, cancel, move |cancel| {
            let _entered = span.entered();
            queued.solve(|| {
                if panics {
                    std::panic::panic_any("staged by a test");
                }
                work(cancel)
            })
        });
    }

    /// More than a loop closure asks for a pose graph.
    pub(super) fn ask_for_motion(&mut self) {
        self.graph_moves = true;
    }

    /// Drops the result of a window that is being solved; the window is solved again later.
    pub(super) fn supersede_window(&mut self) {
        self.window.cancel();
    }

    /// Accepts a request to optimize the map, unless there is one already.
    pub(super) fn request(&mut self, job: Job) {
        if self.job.is_some() {
            let map = self.shared.name.clone();
            return job.answer(Err(EngineError::OptimizationRunning { map }));
        }
        self.job = Some(job);
    }

    /// Whether the requested optimization may take effect: it was not canceled, and from here on
    /// nobody can.
    fn commits_job(&self) -> bool {
        let job = self.job.as_ref();
        job.is_some_and(|job| !job.is_canceled() && job.cancellation.commit())
    }

    /// What asked for a solve.
    fn request_of(&self, running: &Running) -> Option<RequestId> {
        self.job.as_ref().filter(|_| running.is_job)?.request
    }

    /// Answers the requested optimization, which has ended.
    pub(super) fn answer_job(&mut self, answer: Result<OptimizeOutcome, EngineError>) {
        if let Some(job) = self.job.take() {
            job.answer(answer);
        }
    }

    /// Drops the results of the running solves and ends a requested optimization with `error`. The
    /// items that they cover wait for later ones.
    pub(super) fn pause(&mut self, error: &EngineError) {
        self.window.cancel();
        self.whole.cancel();
        self.ended = None;
        self.answer_job(Err(error.clone()));
    }

    /// Cancels every running or waiting solve.
    pub(super) fn cancel(&mut self, error: &EngineError) {
        self.window.forget();
        self.whole.forget();
        self.ended = None;
        self.answer_job(Err(error.clone()));
        self.schedule.clear();
    }
}

impl Actor {
    /// Starts the solves that are due and may run.
    pub(super) async fn start_solves(&mut self) {
        if self.is_held() {
            return;
        }
        let is_lock_step = self.ingest.is_lock_step();
        while let Some(triggers) = self.solving.start_next(&self.map, is_lock_step).await {
            self.optimized(&triggers, 0, &SolveReport::Nothing);
        }
    }

    /// Closes triggers and sends the OPTIMIZED acks that this completes.
    fn optimized(&mut self, triggers: &[u64], solve_id: i64, report: &SolveReport) {
        let schedule = &mut self.solving.schedule;
        let marks = schedule.close(triggers);
        let followed = |(client, sequence)| (client, sequence, schedule.is_waiting(client));
        let marks: Vec<_> = marks.into_iter().map(followed).collect();
        self.ingest.acknowledge_optimized(marks, self.map.revision(), solve_id, report);
    }

    /// Handles the end of a solve.
    pub(super) async fn solved(&mut self, (running, ended): (Running, Ended<Outcome>)) {
        let outcome = match ended {
            Ended::Made(outcome) => outcome,
            Ended::Dropped => {
                self.solving.graph_moves |= running.moves;
                return self.shared.meters.superseded.increment();
            }
            Ended::Panicked { panicked, is_stale } => {
                let bug = self.lost(&panicked);
                if is_stale {
                    return self.shared.meters.superseded.increment();
                }
                // What a request covers besides is solved by the map's own solves.
                return match running.is_job {
                    true => self.solving.answer_job(Err(bug)),
                    false => {
                        let report = SolveReport::Lost { bug };
                        self.optimized(&running.triggers, running.id, &report);
                    }
                };
            }
        };
        let (id, map) = (running.id, self.shared.name.clone());
        let answer = match (outcome, running.is_job) {
            (outcome, true) if !self.solving.commits_job() => {
                self.pool.discard(outcome);
                Err(EngineError::Cancelled { map })
            }
            (Err(error), true) => Err(EngineError::Solve(error)),
            (Ok(None), true) => Err(EngineError::NothingToSolve { map }),
            (Err(error), false) => {
                return self.optimized(&running.triggers, id, &SolveReport::Failed { error });
            }
            (Ok(None), false) => {
                return self.optimized(&running.triggers, 0, &SolveReport::Nothing);
            }
            // The job is kept while its result is applied, so that a bug there ends it with an
            // error.
            (Ok(Some(solution)), _) => self.apply(&running, solution).await,
        };
        if running.kind == SolveKind::PoseGraph {
            // Before the next pose graph: where closures keep coming, there is no other gap.
            self.start_background().await;
        }
        if running.is_job {
            self.solving.answer_job(answer);
        }
    }

    /// Commits a solution as the map's newest revision and acknowledges it. A result that is not possible
    /// is acknowledged as refused; if the journal fails, the streams end.
    async fn apply(
        &mut self,
        running: &Running,
        solution: Solution,
    ) -> Result<OptimizeOutcome, EngineError> {
        let Solution { moved, mut certificate, counts, proof, rebuilt, refused } = solution;
        if let Some(why) = refused {
            self.pool.discard(moved);
            let reason = format!("the window has no plausible result: {why}");
            let report = SolveReport::Refused { reason: reason.clone() };
            self.optimized(&running.triggers, running.id, &report);
            let (map, change) = (self.shared.name.clone(), "solve_applied");
            return Err(EngineError::Refused { map, change, reason });
        }
        certificate.held = self.held(&moved);
        let costs = (certificate.solve.initial_cost, certificate.solve.final_cost);
        if costs.1.is_finite() {
            let covered = self.solving.schedule.preview(&running.triggers);
            let reach = match running.kind {
                SolveKind::PoseGraph if !running.is_job => {
                    Reach::Noticeable { if_contradicted: !running.moves }
                }
                SolveKind::PoseGraph | SolveKind::LocalBundle | SolveKind::Global => Reach::All,
            };
            let result = self.result(moved, running.kind, covered, costs, reach).await;
            let applied = match result {
                Ok(mut solve) => {
                    solve.request = self.solving.request_of(running);
                    if self.shared.config.injects(Fault::ImpossibleResult) {
                        let poses = solve.poses.iter_mut();
                        poses.for_each(|(_, pose)| pose.translation.x = f64::INFINITY);
                    }
                    self.commit(None, Change::SolveApplied { solve }).await
                }
                Err(error) => Err(error),
            };
            if let Err(error) = applied {
                if let EngineError::Refused { reason, .. } = &error {
                    let report = SolveReport::Refused { reason: reason.clone() };
                    self.optimized(&running.triggers, running.id, &report);
                    return Err(error);
                }
                if let EngineError::Bug { .. } = error {
                    let report = SolveReport::Lost { bug: error.clone() };
                    self.optimized(&running.triggers, running.id, &report);
                    return Err(error);
                }
                tracing::warn!(%error, solve = running.id, "a solve could not be applied");
                self.ingest.end_all(&error);
                self.solving.schedule.clear();
                return Err(error);
            }
        } else {
            // The map keeps its estimates; the certificate reports the numerical failure.
            self.pool.discard(moved);
        }
        let certificate = Arc::new(certificate);
        let report = SolveReport::Solved(Arc::clone(&certificate));
        self.optimized(&running.triggers, running.id, &report);
        let switched_off = match running.is_job {
            true => self.compute(switched_off).await,
            false => Vec::new(),
        };
        let (revision, solve_id) = (self.map.revision(), running.id);
        Ok(OptimizeOutcome {
            certificate,
            revision,
            solve_id,
            counts,
            proof,
            switched_off,
            rebuilt,
        })
    }
}
