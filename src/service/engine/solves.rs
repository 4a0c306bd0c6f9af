//! Starts, supersedes and applies solves; a map runs one at a time.
//!
//! Order: loop closures first, then a requested optimization (in lock-step it waits for the
//! windows), then windows. A loop closure or an optimization supersedes a window that is being
//! solved: the window's result is dropped, and it is solved again from the newer state. A window is
//! built on another thread while the engine waits, so that a local solve holds no snapshot and
//! causes no copy of the map.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

use covis_solvers::{bundle_adjustment, optimizer};
use tokio::sync::oneshot;

use super::actor::Actor;
use super::optimize::Job;
use super::pool::{SolvePanicked, answered};
use super::work::{
    Outcome, Solution, cancel_flag, solve_loop, solve_map, solve_map_graph, solve_window,
};
use super::{EngineError, Estimate, OptimizeOutcome, OptimizeProblem, SolveReport};
use crate::map::{
    Change, EntityId, Map, SolveKind, SwitchedOff, applied, choose_window, local_problem,
};

/// The solve that runs.
pub(super) struct Running {
    id: i64,
    kind: SolveKind,
    /// Whether it was requested.
    is_job: bool,
    /// The triggers that it covers.
    triggers: Vec<u64>,
    superseded: bool,
    pub(super) cancel: Arc<AtomicBool>,
    answer: oneshot::Receiver<Result<Outcome, SolvePanicked>>,
}

impl Running {
    /// Resolves when the running solve has ended; never if none runs.
    pub(super) async fn ended(running: &mut Option<Self>) -> Result<Outcome, SolvePanicked> {
        match running {
            Some(running) => answered((&mut running.answer).await),
            None => std::future::pending().await,
        }
    }
}

impl Actor {
    /// Starts the next solve, if none runs and one is due.
    pub(super) async fn start_solves(&mut self) {
        while self.running.is_none() {
            let loops = self.schedule.loops();
            if !loops.is_empty() {
                self.start_loop(loops);
            } else if self.job.is_some() && (!self.is_lock_step() || self.schedule.is_empty()) {
                self.start_job();
            } else if let Some(keyframe) = self.schedule.next_window() {
                self.start_window(keyframe).await;
            } else {
                return;
            }
        }
    }

    fn start_loop(&mut self, triggers: Vec<u64>) {
        let (map, ceiling) = (Arc::clone(&self.map), self.config.ceiling());
        let max_iterations = optimizer::Options::default().max_iterations;
        let estimate = Estimate::of_map(map.usage(), max_iterations, &ceiling);
        self.launch(SolveKind::PoseGraph, estimate, triggers, cancel_flag(), move |cancel| {
            solve_loop(map, ceiling, cancel)
        });
    }

    fn start_job(&mut self) {
        if let Some(job) = self.job.take_if(|job| job.is_canceled()) {
            return job.answer(Err(EngineError::Cancelled { map: self.shared.name.clone() }));
        }
        let Some(job) = &self.job else { return };
        let _entered = job.span.clone().entered();
        let (mut options, rows, cancel) = (job.options, job.rows.clone(), Arc::clone(&job.cancel));
        options.optimizer.ceiling = self.config.ceiling();
        let map = Arc::clone(&self.map);
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
                self.launch(SolveKind::PoseGraph, estimate, loops, cancel, move |cancel| {
                    solve_map_graph(map, &options, certify, &rows, cancel)
                });
            }
        }
        if let Some(running) = &mut self.running {
            running.is_job = true;
        }
    }

    async fn start_window(&mut self, keyframe: EntityId) {
        let max_iterations = self.map.policy().max_local_iterations;
        let ceiling = self.config.ceiling();
        let built = self.compute(move |map| {
            let window = choose_window(map, keyframe);
            let problem = local_problem(map, &window);
            let estimate = problem.is_solvable().then(|| {
                let bound = bundle_adjustment::price_bound(&problem.problem);
                Estimate::new(bound, max_iterations, &ceiling)
            });
            (window.free, problem, estimate)
        });
        let (free, problem, estimate) = built.await;
        let triggers = self.schedule.within(keyframe, &free);
        let Some(estimate) = estimate else {
            return self.acknowledge(&triggers, 0, &SolveReport::Nothing);
        };
        self.launch(SolveKind::LocalBundle, estimate, triggers, cancel_flag(), move |cancel| {
            solve_window(problem, max_iterations, ceiling, cancel)
        });
    }

    fn launch(
        &mut self,
        kind: SolveKind,
        estimate: Estimate,
        triggers: Vec<u64>,
        cancel: Arc<AtomicBool>,
        work: impl FnOnce(&Arc<AtomicBool>) -> Outcome + Send + 'static,
    ) {
        self.last_solve_id += 1;
        let id = self.last_solve_id;
        let span = tracing::debug_span!("solve", map = %self.shared.name, solve = id, ?kind);
        let queued = self.shared.meters.solve(kind);
        let panics = self.config.panics_in_solve();
        let flag = Arc::clone(&cancel);
        let answer = self.pool.start(&self.shared.account, estimate, move || {
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

    /// Accepts or refuses a request to optimize the map.
    pub(super) fn optimize(&mut self, job: Job) {
        if let Err(error) = self.check_open() {
            return job.answer(Err(error));
        }
        if self.job.is_some() {
            let map = self.shared.name.clone();
            return job.answer(Err(EngineError::OptimizationRunning { map }));
        }
        self.job = Some(job);
        if !self.is_lock_step() {
            self.supersede_window();
        }
    }

    /// Handles the end of the running solve.
    pub(super) async fn solved(&mut self, outcome: Result<Outcome, SolvePanicked>) {
        let Some(running) = self.running.take() else { return };
        let outcome = match self.shared.meters.solve_panicked(outcome) {
            Ok(outcome) => outcome,
            Err(panicked) => {
                self.poisoned(&panicked.message);
                return;
            }
        };
        if running.superseded {
            self.shared.meters.superseded.increment();
            return;
        }
        if running.is_job {
            return self.job_ended(running, outcome).await;
        }
        let report = match outcome {
            Ok(Some(solution)) => {
                let Ok(solution) = self.apply(&running, solution).await else { return };
                SolveReport::Solved(Arc::new(solution.certificate))
            }
            Ok(None) => SolveReport::Nothing,
            Err(error) => SolveReport::Failed { error },
        };
        let id = if matches!(report, SolveReport::Nothing) { 0 } else { running.id };
        self.acknowledge(&running.triggers, id, &report);
    }

    async fn job_ended(&mut self, running: Running, outcome: Outcome) {
        let map = self.shared.name.clone();
        // The job is kept while its result is applied, so that a bug there ends the job with an
        // error.
        let canceled = self.job.as_ref().is_none_or(Job::is_canceled);
        let answer = match outcome {
            _ if canceled => Err(EngineError::Cancelled { map }),
            Err(error) => Err(EngineError::Solve(error)),
            Ok(None) => Err(EngineError::NothingToSolve { map }),
            Ok(Some(solution)) => match self.apply(&running, solution).await {
                Err(error) => Err(error),
                Ok(solution) => {
                    let certificate = Arc::new(solution.certificate);
                    let report = SolveReport::Solved(Arc::clone(&certificate));
                    self.acknowledge(&running.triggers, running.id, &report);
                    let revision = self.map.revision();
                    Ok(OptimizeOutcome {
                        certificate,
                        revision,
                        solve_id: running.id,
                        counts: solution.counts,
                        proof: solution.proof,
                        switched_off: switched_off(&self.map),
                    })
                }
            },
        };
        if let Some(job) = self.job.take() {
            job.answer(answer);
        }
    }

    /// Commits a solution as the map's newest revision. If that fails, the streams end.
    async fn apply(
        &mut self,
        running: &Running,
        solution: Solution,
    ) -> Result<Solution, EngineError> {
        let summary = &solution.certificate.solve;
        if !summary.final_cost.is_finite() {
            // The map keeps its estimates; the certificate reports the numerical failure.
            return Ok(solution);
        }
        let covered = self.schedule.preview(&running.triggers);
        let (kind, costs) = (running.kind, (summary.initial_cost, summary.final_cost));
        let moved = self.compute(move |map| {
            (applied(map, solution.moved.solved(), kind, covered, costs), solution)
        });
        let (solve, solution) = moved.await;
        let committed = self.commit(None, Change::SolveApplied { solve }).await;
        if let Err(error) = &committed {
            tracing::warn!(%error, solve = running.id, "a solve could not be applied");
            self.streams.end_all(error);
            self.schedule.clear();
        }
        committed.map(|_position| solution)
    }

    /// Closes triggers and sends the OPTIMIZED acks that this completes.
    fn acknowledge(&mut self, triggers: &[u64], solve_id: i64, report: &SolveReport) {
        let revision = self.map.revision();
        for (client, sequence) in self.schedule.close(triggers) {
            self.streams.optimized(client, sequence, revision, solve_id, report.clone());
        }
    }
}

/// The constraints that are switched off, sorted by client name, then id.
fn switched_off(map: &Map) -> Vec<(String, i64, SwitchedOff)> {
    let named = map.switched_off().iter().map(|(id, &off)| {
        let client = map.client(id.client).map(|client| client.name.clone());
        (client.unwrap_or_default(), id.id, off)
    });
    let mut named: Vec<_> = named.collect();
    named.sort_by(|a, b| (&a.0, a.1).cmp(&(&b.0, b.1)));
    named
}
