//! One solve of a map: what is asked for, the body that runs on the pool, its certificate.
//!
//! A body takes a problem or a snapshot and returns moved values with a certificate; it uses nothing
//! of the engine's state. Costs before and after come from the solver crate's independent evaluator,
//! not from the solver. A canceled solve ends within its iteration, and the engine drops its result.
//! A snapshot is dropped as soon as its problem is built, because the engine copies a map that is
//! still shared. The stages of a pose graph are those of [`covis_solvers::graph_optimization`]; its
//! verdicts on loop closures are stored in the problem and become part of the event.

use std::sync::Arc;
use std::sync::atomic::AtomicBool;
use std::time::Instant;

use covis_solvers::bundle_adjustment;
use covis_solvers::evaluation::bundle_cost;
use covis_solvers::graph_optimization::{self, Judging, optimize};
use covis_solvers::initialization::Start;
use covis_solvers::interrupt::Interrupt;
use covis_solvers::optimizer::{self, Control, SolveSummary, ignore_iterations};
use covis_solvers::problem::SolveError;
use covis_solvers::robust::{PositionJudging, VarianceFactors};

use crate::map::{
    ClientIndex, GlobalOptions, GraphPairs, Map, MapProblem, SwitchedOff, global_problem,
    is_valid_camera, measured_graph,
};
use crate::service::engine::measured_pairs::MeasuredPairs;
use crate::service::engine::outcome::{
    ClosureCounts, Moved, OptimizeCounts, OptimizeOptions, OptimizeProblem, Outcome, Solution,
    SolveCertificate, SolveStep, SolverKind, Tell,
};
use crate::service::engine::solving::rebuild::rebuild_map;

/// A solve of the whole map, of the kind that `options` name.
pub(crate) fn solve_whole(
    map: Arc<Map>,
    pairs: &MeasuredPairs,
    options: &OptimizeOptions,
    tell: &mut Tell<'_>,
    cancel: &Arc<AtomicBool>,
) -> Outcome {
    match options.problem {
        OptimizeProblem::Full => solve_map(map, options, tell, cancel),
        OptimizeProblem::Rebuild => rebuild_map(map, options, tell, cancel),
        OptimizeProblem::PoseGraph { certify } => {
            let outcome = solve_graph(map, pairs, options, certify, cancel);
            if let Ok(Some(solution)) = &outcome {
                let rows = &solution.certificate.solve.iterations;
                rows.iter().for_each(|row| tell(SolveStep::Iteration(*row)));
            }
            outcome
        }
    }
}

/// Bundle adjustment of the whole map.
pub(crate) fn solve_map(
    map: Arc<Map>,
    options: &OptimizeOptions,
    tell: &mut Tell<'_>,
    cancel: &Arc<AtomicBool>,
) -> Outcome {
    let gauge = options.gauge.unwrap_or(map.policy().gauge);
    let loss = options.observation_loss.unwrap_or(map.policy().observation_loss);
    let global = GlobalOptions { loss, fix_intrinsics: !options.refine_intrinsics, gauge };
    let mut problem = global_problem(&map, &global);
    drop(map);
    problem.gauge = options.gauge;
    if let Some(loss) = options.constraint_loss {
        problem.problem.relative_pose_loss = loss;
    }
    solve_bundle(problem, options, cancel, &mut |row| {
        tell(SolveStep::Iteration(*row));
        Control::Continue
    })
}

/// Bundle adjustment.
pub(crate) fn solve_bundle(
    mut problem: MapProblem,
    options: &OptimizeOptions,
    cancel: &Arc<AtomicBool>,
    observer: &mut optimizer::Observer<'_>,
) -> Outcome {
    if !problem.is_solvable() {
        return Ok(None);
    }
    let bundle = &mut problem.problem;
    let before = bundle_cost(bundle);
    let OptimizeOptions { optimizer, linear_solver, deadline, .. } = *options;
    let options = bundle_adjustment::Options { optimizer, linear_solver, ..Default::default() };
    let interrupt = interrupt(deadline, cancel);
    let summary = match bundle_adjustment::solve_until(bundle, &options, &interrupt, observer) {
        Ok(summary) => summary,
        Err(SolveError::Empty(_)) => return Ok(None),
        Err(error) => return Err(error),
    };
    if let Some(index) = bundle.cameras.iter().position(|camera| !is_valid_camera(camera)) {
        // The views do not determine its intrinsics.
        let id = problem.cameras.get(index).map_or(0, |camera| camera.id);
        return Err(SolveError::Singular { what: "intrinsics of camera", id });
    }
    let fixed_poses = bundle.constant_poses.iter().filter(|&&c| c).count();
    let certificate = SolveCertificate {
        solve: summary.solve,
        method: optimizer.method,
        linear_solver: SolverKind::Schur(summary.linear_solver),
        before,
        after: bundle_cost(bundle),
        gauge: problem.frame,
        free_poses: bundle.poses.len() - fixed_poses,
        fixed_poses,
        free_landmarks: bundle.constant_landmarks.iter().filter(|&&c| !c).count(),
        closures: None,
        held: Vec::new(),
    };
    let counts = OptimizeCounts::of(&problem);
    let moved = Moved::Bundle(Box::new(problem));
    Ok(Some(Solution { moved, certificate, counts, proof: None, rebuilt: None, refused: None }))
}

/// Ends a solve within its iterations: at the deadline or when it is canceled.
pub(crate) fn interrupt(deadline: Option<Instant>, cancel: &Arc<AtomicBool>) -> Interrupt {
    Interrupt::at(deadline).or_when(Arc::clone(cancel))
}

/// Pose-graph optimization.
fn solve_graph(
    map: Arc<Map>,
    pairs: &MeasuredPairs,
    options: &OptimizeOptions,
    certify: bool,
    cancel: &Arc<AtomicBool>,
) -> Outcome {
    let OptimizeOptions { optimizer, constraint_loss, deadline, .. } = *options;
    let interrupt = interrupt(deadline, cancel);
    let gauge = options.gauge.unwrap_or(map.policy().gauge);
    let graph_pairs = GraphPairs::of(&map);
    let motions = pairs.complete(&map, &graph_pairs, &interrupt);
    let mut problem = measured_graph(&map, gauge, &graph_pairs, &motions);
    drop((graph_pairs, motions));
    problem.gauge = options.gauge;
    let robustness = map.policy().loop_closure_robustness;
    let named = |(client, &factors): (&ClientIndex, &VarianceFactors)| {
        Some((map.client(*client)?.name.clone(), factors))
    };
    let mut factors: Vec<_> = problem.factors.iter().filter_map(named).collect();
    factors.sort_unstable_by(|a, b| a.0.cmp(&b.0));
    drop(map);
    if !problem.is_solvable() {
        return Ok(None);
    }
    if let Some(loss) = constraint_loss {
        problem.graph.loss = loss;
    }
    let judging = robustness.kernel.map(|kernel| Judging {
        kernel,
        threshold: robustness.threshold,
        trusted: problem.trusted(),
        trust_odometry: true,
    });
    // Fixes are judged where closures are, always at their own quantile.
    let positions = robustness.kernel.map(|_| PositionJudging::default());
    // What is switched off is a function of what was measured: the present estimates, which earlier
    // solves made, are no part of it.
    let judges = judging.is_some();
    let start = if judges { Start::Odometry } else { Start::Given };
    let options =
        graph_optimization::Options { start, judging, positions, certify, costs: true, optimizer };
    let rows = &mut ignore_iterations;
    let solved = match optimize(&mut problem.graph, true, &options, &interrupt, rows) {
        Ok(solved) => solved,
        Err(SolveError::Empty(_)) => return Ok(None),
        Err(error) => return Err(error),
    };
    let verdicts = solved.judged.map(|judged| judged.closures).unwrap_or_default();
    for closure in &mut problem.closures {
        let index = verdicts.binary_search_by_key(&closure.edge, |verdict| verdict.edge);
        // A closure without a verdict links consecutive keyframes.
        let verdict = index.ok().and_then(|index| verdicts.get(index));
        let off = verdict.filter(|verdict| verdict.is_switched_off && verdict.chi2.is_finite());
        closure.switched_off = off.map(|verdict| SwitchedOff {
            chi2: verdict.chi2,
            weight: verdict.weight,
            is_provisional: verdict.is_provisional,
        });
    }
    problem.positions.iter_mut().for_each(|position| position.switched_off = None);
    for (position, verdict) in problem.positions.iter_mut().zip(&solved.positions) {
        let is_off = verdict.is_switched_off && verdict.chi2.is_finite();
        let off = SwitchedOff { chi2: verdict.chi2, weight: 0.0, is_provisional: false };
        position.switched_off = is_off.then_some(off);
    }
    // What positions say of odometry counts on top of what closures say.
    for (_, factors) in &mut factors {
        factors.odometry *= solved.edge_variance_factor;
    }
    let off = || problem.closures.iter().filter_map(|closure| closure.switched_off);
    let closures = judges.then(|| ClosureCounts {
        judged: problem.closures.len(),
        switched_off: off().count(),
        provisional: off().filter(|off| off.is_provisional).count(),
        factors,
    });
    let fixed_poses = problem.graph.constant.iter().filter(|&&c| c).count();
    let gauge = problem.frame(gauge);
    let certificate = SolveCertificate {
        closures: closures.filter(|closures| closures.judged > 0),
        // What was before is the map, and not a start that the judging of closures made of its odometry.
        solve: SolveSummary { initial_cost: solved.before.total, ..solved.solve },
        method: optimizer.method,
        linear_solver: SolverKind::SparseCholesky,
        before: solved.before,
        after: solved.after,
        gauge,
        free_poses: problem.graph.poses.len() - fixed_poses,
        fixed_poses,
        free_landmarks: 0,
        held: Vec::new(),
    };
    let counts = OptimizeCounts {
        keyframes: problem.keyframes.len(),
        constraints: problem.graph.edges.len()
            + problem.graph.pose_priors.len()
            + problem.graph.position_priors.len(),
        ..OptimizeCounts::default()
    };
    let moved = Moved::Graph(Box::new(problem));
    Ok(Some(Solution {
        moved,
        certificate,
        counts,
        proof: solved.proof,
        rebuilt: None,
        refused: None,
    }))
}
