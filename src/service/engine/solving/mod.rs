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

pub(crate) mod after_closures;
pub(crate) mod rebuild;
pub(crate) mod schedule;
pub(crate) mod whole;
pub(crate) mod window;

use std::panic::resume_unwind;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

use covis_solvers::{bundle_adjustment, optimizer};

use crate::map::{EntityId, Map, RequestId, SolveKind, choose_window, local_problem};
use crate::service::engine::context::MapContext;
use crate::service::engine::outcome::{OptimizeRequest, Outcome};
use crate::service::engine::pool::{Ended, Slot, SolverPool};
use crate::service::engine::solving::schedule::Schedule;
use crate::service::engine::solving::whole::solve_whole;
use crate::service::engine::solving::window::{WindowOptions, solve_window};
use crate::service::engine::{
    EngineError, Estimate, Fault, OptimizeOptions, OptimizeOutcome, OptimizeProblem, SolveStep,
};

/// Windows of which one finds how uncertain odometry is: they overlap, and it takes as long as an iteration.
const LEARN_EVERY: i64 = 8;

/// The solve that runs.
pub(crate) struct Running {
    pub(crate) id: i64,
    pub(crate) kind: SolveKind,
    /// Whether it was requested.
    pub(crate) is_job: bool,
    /// Whether it moves the map also where loop closures do not contradict it.
    pub(crate) moves: bool,
    /// The triggers that it covers.
    pub(crate) triggers: Vec<u64>,
}

/// The solves of a map.
pub(crate) struct Solving {
    shared: Arc<MapContext>,
    pool: Arc<SolverPool>,
    pub(crate) schedule: Schedule,
    window: Slot<Outcome, Running>,
    /// A pose graph or a requested optimization.
    whole: Slot<Outcome, Running>,
    /// The solve of the whole that has ended while a window runs.
    ended: Option<(Running, Ended<Outcome>)>,
    /// The optimization that waits or runs.
    job: Option<OptimizeRequest>,
    last_id: i64,
    /// Whether a pose graph ran since the last window.
    prior_went: bool,
    /// Whether more than loop closures asks for a pose graph: edits, or fixes.
    graph_moves: bool,
}

impl Solving {
    /// `last_id` is the number of the map's last solve.
    pub(crate) fn new(shared: &Arc<MapContext>, pool: &Arc<SolverPool>, last_id: i64) -> Self {
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
    pub(crate) fn is_idle(&self) -> bool {
        let is_free = self.window.is_free() && self.is_whole_free();
        is_free && self.schedule.is_empty() && self.job.is_none()
    }

    /// Whether no pose graph and no requested optimization runs or is to be applied.
    fn is_whole_free(&self) -> bool {
        self.whole.is_free() && self.ended.is_none()
    }

    /// Whether a requested optimization waits or runs.
    pub(crate) fn has_job(&self) -> bool {
        self.job.is_some()
    }

    /// Whether an adjustment may start: one that began before a pose graph or a requested optimization ends
    /// would correct once more what that corrects. In lock-step everything else comes first.
    pub(crate) fn leaves_room(&self, is_lock_step: bool) -> bool {
        match is_lock_step {
            true => self.is_idle(),
            false => self.is_whole_free() && self.job.is_none(),
        }
    }

    /// Resolves with a solve whose result may be applied; never if none runs.
    pub(crate) async fn ended(&mut self) -> (Running, Ended<Outcome>) {
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
    pub(crate) async fn start_next(
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
        let (holds, canceled) =
            (self.shared.config.injects(Fault::HoldReconstruction), Arc::clone(&cancel));
        self.start_whole(map, options, true, cancel, move |step| {
            let is_held = holds && matches!(step, SolveStep::Reconstruction(_));
            // The receiver is gone when the caller went away; the solve is then canceled.
            let _gone = steps.send(step);
            while is_held && !canceled.load(Ordering::Relaxed) {
                std::thread::sleep(Duration::from_millis(1));
            }
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
            let window = choose_window(map, &centers, &waiting);
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

    /// The result of a solve was dropped: what asked for it still does.
    pub(crate) fn dropped(&mut self, running: &Running) {
        self.graph_moves |= running.moves;
    }

    /// More than a loop closure asks for a pose graph.
    pub(crate) fn ask_for_motion(&mut self) {
        self.graph_moves = true;
    }

    /// Drops the result of a window that is being solved; the window is solved again later.
    pub(crate) fn supersede_window(&mut self) {
        self.window.cancel();
    }

    /// Accepts a request to optimize the map, unless there is one already.
    pub(crate) fn request(&mut self, job: OptimizeRequest) {
        if self.job.is_some() {
            let map = self.shared.name.clone();
            return job.answer(Err(EngineError::OptimizationRunning { map }));
        }
        self.job = Some(job);
    }

    /// Whether the requested optimization may take effect: it was not canceled, and from here on
    /// nobody can.
    pub(crate) fn commits_job(&self) -> bool {
        let job = self.job.as_ref();
        job.is_some_and(|job| !job.is_canceled() && job.cancellation.commit())
    }

    /// What asked for a solve.
    pub(crate) fn request_of(&self, running: &Running) -> Option<RequestId> {
        self.job.as_ref().filter(|_| running.is_job)?.request
    }

    /// Answers the requested optimization, which has ended.
    pub(crate) fn answer_job(&mut self, answer: Result<OptimizeOutcome, EngineError>) {
        if let Some(job) = self.job.take() {
            job.answer(answer);
        }
    }

    /// Drops the results of the running solves and ends a requested optimization with `error`. The
    /// items that they cover wait for later ones.
    pub(crate) fn pause(&mut self, error: &EngineError) {
        self.window.cancel();
        self.whole.cancel();
        self.ended = None;
        self.answer_job(Err(error.clone()));
    }

    /// Cancels every running or waiting solve.
    pub(crate) fn cancel(&mut self, error: &EngineError) {
        self.window.forget();
        self.whole.forget();
        self.ended = None;
        self.answer_job(Err(error.clone()));
        self.schedule.clear();
    }
}
