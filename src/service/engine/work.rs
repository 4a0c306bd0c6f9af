//! The bodies of solves, which run on the pool: they take a problem and return it with moved values
//! and a certificate.
//!
//! Nothing here uses the engine's state. A canceled solve ends within its iteration, and the engine
//! drops its result. A snapshot is dropped as soon as its problem is built, because the engine
//! copies a map that is still shared.

use std::sync::Arc;
use std::sync::atomic::AtomicBool;
use std::time::Instant;

use covis_solvers::bundle_adjustment::{self, LinearSolver};
use covis_solvers::evaluation::bundle_cost;
use covis_solvers::graph_optimization::Proof;
use covis_solvers::interrupt::Interrupt;
use covis_solvers::optimizer::{self, Control, IterationSummary, ignore_iterations};
use covis_solvers::price::Ceiling;
use covis_solvers::problem::SolveError;
use tokio::sync::mpsc;

use super::pose_graph::{GraphSettings, solve_graph};
use super::{GaugeKind, OptimizeCounts, OptimizeOptions, SolveCertificate, SolverKind};
use crate::map::{GlobalOptions, GraphProblem, Map, MapProblem, Solved, global_problem};

/// A problem whose values were moved.
pub(super) enum Moved {
    Bundle(Box<MapProblem>),
    Graph(Box<GraphProblem>),
}

impl Moved {
    pub(super) fn solved(&self) -> Solved<'_> {
        match self {
            Self::Bundle(problem) => Solved::Bundle(problem),
            Self::Graph(problem) => Solved::Graph(problem),
        }
    }
}

/// The result of a solve.
pub(super) struct Solution {
    pub(super) moved: Moved,
    pub(super) certificate: SolveCertificate,
    pub(super) counts: OptimizeCounts,
    pub(super) proof: Option<Proof>,
}

/// `Ok(None)` when there was nothing to solve.
pub(super) type Outcome = Result<Option<Solution>, SolveError>;

/// Bundle adjustment of a window.
pub(super) fn solve_window(
    problem: MapProblem,
    max_iterations: usize,
    ceiling: Ceiling,
    cancel: &Arc<AtomicBool>,
) -> Outcome {
    let optimizer = optimizer::Options { max_iterations, ceiling, ..optimizer::Options::default() };
    let options = bundle_adjustment::Options {
        optimizer,
        linear_solver: LinearSolver::Auto,
        ..bundle_adjustment::Options::default()
    };
    let gauge = match () {
        () if problem.problem.constant_poses.contains(&true) => GaugeKind::FixedPoses,
        () if !problem.problem.pose_priors.is_empty() => GaugeKind::Priors,
        () => GaugeKind::Free,
    };
    solve_bundle(problem, &options, gauge, &interrupt(None, cancel), &mut ignore_iterations)
}

/// Bundle adjustment of the whole map.
pub(super) fn solve_map(
    map: Arc<Map>,
    options: &OptimizeOptions,
    rows: &mpsc::UnboundedSender<IterationSummary>,
    cancel: &Arc<AtomicBool>,
) -> Outcome {
    let fix_first_keyframe = match options.gauge {
        GaugeKind::FirstKeyframeFixed | GaugeKind::FixedPoses => true,
        GaugeKind::Free | GaugeKind::Priors => false,
    };
    let loss = options.observation_loss.unwrap_or(map.policy().observation_loss);
    let global = GlobalOptions { loss, fix_intrinsics: true, fix_first_keyframe };
    let mut problem = global_problem(&map, &global);
    drop(map);
    if let Some(loss) = options.constraint_loss {
        problem.problem.relative_pose_loss = loss;
    }
    let bundle = bundle_adjustment::Options {
        optimizer: options.optimizer,
        linear_solver: options.linear_solver,
        ..bundle_adjustment::Options::default()
    };
    let interrupt = interrupt(options.deadline, cancel);
    solve_bundle(problem, &bundle, options.gauge, &interrupt, &mut |row| {
        // The receiver is gone when the caller went away; the solve is then canceled.
        let _gone = rows.send(*row);
        Control::Continue
    })
}

/// Pose-graph optimization after a loop closure.
pub(super) fn solve_loop(map: Arc<Map>, ceiling: Ceiling, cancel: &Arc<AtomicBool>) -> Outcome {
    let optimizer = optimizer::Options { ceiling, ..optimizer::Options::default() };
    let settings = GraphSettings { optimizer, ..GraphSettings::default() };
    solve_graph(map, &settings, &interrupt(None, cancel))
}

/// Pose-graph optimization on request; `rows` gets the iterations of the last solve.
pub(super) fn solve_map_graph(
    map: Arc<Map>,
    options: &OptimizeOptions,
    certify: bool,
    rows: &mpsc::UnboundedSender<IterationSummary>,
    cancel: &Arc<AtomicBool>,
) -> Outcome {
    let OptimizeOptions { optimizer, constraint_loss, .. } = *options;
    let settings = GraphSettings { optimizer, constraint_loss, certify };
    let outcome = solve_graph(map, &settings, &interrupt(options.deadline, cancel));
    if let Ok(Some(solution)) = &outcome {
        for row in &solution.certificate.solve.iterations {
            let _gone = rows.send(*row);
        }
    }
    outcome
}

fn solve_bundle(
    mut problem: MapProblem,
    options: &bundle_adjustment::Options,
    gauge: GaugeKind,
    interrupt: &Interrupt,
    observer: &mut optimizer::Observer<'_>,
) -> Outcome {
    if !problem.is_solvable() {
        return Ok(None);
    }
    let before = bundle_cost(&problem.problem);
    let summary =
        match bundle_adjustment::solve_until(&mut problem.problem, options, interrupt, observer) {
            Ok(summary) => summary,
            Err(SolveError::Empty(_)) => return Ok(None),
            Err(error) => return Err(error),
        };
    let bundle = &problem.problem;
    let fixed_poses = bundle.constant_poses.iter().filter(|&&c| c).count();
    let certificate = SolveCertificate {
        solve: summary.solve,
        method: options.optimizer.method,
        linear_solver: SolverKind::Schur(summary.linear_solver),
        before,
        after: bundle_cost(bundle),
        gauge,
        free_poses: bundle.poses.len() - fixed_poses,
        fixed_poses,
        free_landmarks: bundle.constant_landmarks.iter().filter(|&&c| !c).count(),
    };
    let counts = OptimizeCounts {
        cameras: problem.cameras.len(),
        keyframes: problem.keyframes.len(),
        landmarks: problem.landmarks.len(),
        observations: bundle.observation_count(),
        constraints: bundle.relative_poses.len()
            + bundle.pose_priors.len()
            + bundle.position_priors.len(),
    };
    let moved = Moved::Bundle(Box::new(problem));
    Ok(Some(Solution { moved, certificate, counts, proof: None }))
}

/// Ends a solve within its iterations: at the deadline or when it is canceled.
fn interrupt(deadline: Option<Instant>, cancel: &Arc<AtomicBool>) -> Interrupt {
    Interrupt::at(deadline).or_when(Arc::clone(cancel))
}

/// A new cancel flag.
pub(super) fn cancel_flag() -> Arc<AtomicBool> {
    Arc::new(AtomicBool::new(false))
}
