//! The body of a pose-graph solve, run on the pool: closures judged, poses moved, and where it is
//! asked for a proof of the chordal optimum.
//!
//! Verdicts go into the problem, from where they become part of the event. Costs are those of the
//! edges that count.

use std::sync::Arc;
use std::time::Instant;

use covis_solvers::certificate::{Certificate, certify_within};
use covis_solvers::evaluation::{CostReport, FactorCost, pose_graph_cost};
use covis_solvers::initialization::Start;
use covis_solvers::interrupt::Interrupt;
use covis_solvers::loss::Loss;
use covis_solvers::optimizer::{self, SolveSummary, ignore_iterations};
use covis_solvers::pose_graph::{self, Options};
use covis_solvers::price::Limits;
use covis_solvers::problem::SolveError;
use covis_solvers::robust;

use super::work::{Moved, Outcome, Solution};
use super::{GaugeKind, OptimizeCounts, SolveCertificate, SolverKind};
use crate::map::{ClosureRobustness, GraphProblem, Map, SwitchedOff, loop_problem};

/// How a pose graph is optimized.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct GraphSettings {
    pub(super) optimizer: optimizer::Options,
    /// `None` takes the policy's.
    pub(super) constraint_loss: Option<Loss>,
    pub(super) certify: bool,
}

/// What is proved of the chordal cost where the last solve started.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ChordalProof {
    /// The proof.
    pub certificate: Certificate,
    /// How long it took.
    pub seconds: f64,
}

/// Pose-graph optimization, until `interrupt` is due.
pub(super) fn solve_graph(
    map: Arc<Map>,
    settings: &GraphSettings,
    interrupt: &Interrupt,
) -> Outcome {
    let mut problem = loop_problem(&map);
    let robustness = map.policy().loop_closure_robustness;
    drop(map);
    if !problem.is_solvable() {
        return Ok(None);
    }
    if let Some(loss) = settings.constraint_loss {
        problem.graph.loss = loss;
    }
    let options = Options { optimizer: settings.optimizer };
    let begin = Instant::now();
    let solved = match judge(&mut problem, robustness, &options, interrupt) {
        Ok(Judged { solve, kept }) if settings.certify => {
            drop(solve);
            prove(&mut problem, kept, &options, begin, interrupt)?
        }
        Ok(Judged { solve, kept }) => {
            let after = pose_graph_cost(&kept.graph);
            Solved { before: at_start(&solve, &after), solve, after, proof: None }
        }
        Err(SolveError::Empty(_)) => return Ok(None),
        Err(error) => return Err(error),
    };
    let fixed_poses = problem.graph.constant.iter().filter(|&&c| c).count();
    let certificate = SolveCertificate {
        solve: solved.solve,
        method: options.optimizer.method,
        linear_solver: SolverKind::SparseCholesky,
        before: solved.before,
        after: solved.after,
        gauge: GaugeKind::FirstKeyframeFixed,
        free_poses: problem.graph.poses.len() - fixed_poses,
        fixed_poses,
        free_landmarks: 0,
    };
    let counts = OptimizeCounts {
        keyframes: problem.keyframes.len(),
        constraints: problem.graph.edges.len(),
        ..OptimizeCounts::default()
    };
    let moved = Moved::Graph(Box::new(problem));
    Ok(Some(Solution { moved, certificate, counts, proof: solved.proof }))
}

struct Judged {
    solve: SolveSummary,
    /// The edges that count, at their weights.
    kept: GraphProblem,
}

struct Solved {
    solve: SolveSummary,
    before: CostReport,
    after: CostReport,
    proof: Option<ChordalProof>,
}

/// Solves over the closures that are found true and leaves the verdicts in the problem.
fn judge(
    problem: &mut GraphProblem,
    robustness: ClosureRobustness,
    options: &Options,
    interrupt: &Interrupt,
) -> Result<Judged, SolveError> {
    let Some(kernel) = robustness.kernel else {
        problem.closures.iter_mut().for_each(|closure| closure.switched_off = None);
        let solve = pose_graph::solve_until(
            &mut problem.graph,
            options,
            interrupt,
            &mut ignore_iterations,
        )?;
        return Ok(Judged { solve, kept: problem.clone() });
    };
    let robust = robust::Options {
        kernel,
        threshold: robustness.threshold,
        start: Start::Given,
        trusted: problem.trusted(),
        pose_graph: *options,
    };
    let off = problem.closures.iter().filter(|closure| closure.switched_off.is_some());
    let off: Vec<usize> = off.map(|closure| closure.edge).collect();
    let summary =
        robust::update_until(&mut problem.graph, &off, &robust, interrupt, &mut ignore_iterations)?;
    let kept = problem.weighted(&summary.closures);
    for closure in &mut problem.closures {
        let place = summary.closures.binary_search_by_key(&closure.edge, |verdict| verdict.edge);
        // One that is not judged ties consecutive keyframes.
        let verdict = place.ok().and_then(|place| summary.closures.get(place));
        let off = verdict.filter(|verdict| verdict.is_switched_off && verdict.chi2.is_finite());
        closure.switched_off =
            off.map(|verdict| SwitchedOff { chi2: verdict.chi2, weight: verdict.weight });
    }
    Ok(Judged { solve: summary.solve, kept })
}

/// Moves to the chordal optimum of the edges that count, proves it, and solves from there.
fn prove(
    problem: &mut GraphProblem,
    mut kept: GraphProblem,
    options: &Options,
    begin: Instant,
    interrupt: &Interrupt,
) -> Result<Solved, SolveError> {
    let start = Instant::now();
    let limits = Limits { ceiling: options.optimizer.ceiling, interrupt };
    let proof = match certify_within(&mut kept.graph, limits) {
        // There is no time for a proof: the best state is the answer.
        Err(SolveError::Interrupted) => None,
        certified => {
            let certificate = certified?;
            Some(ChordalProof { certificate, seconds: start.elapsed().as_secs_f64() })
        }
    };
    let before = pose_graph_cost(&kept.graph);
    let passed = begin.elapsed();
    let deadline = options.optimizer.deadline.map(|deadline| deadline.saturating_sub(passed));
    let options = Options { optimizer: optimizer::Options { deadline, ..options.optimizer } };
    let mut solve =
        pose_graph::solve_until(&mut kept.graph, &options, interrupt, &mut ignore_iterations)?;
    solve.solve_seconds += passed.as_secs_f64();
    solve.iterations.iter_mut().for_each(|row| row.seconds += passed.as_secs_f64());
    let after = pose_graph_cost(&kept.graph);
    problem.graph.poses = kept.graph.poses;
    let graph = &problem.graph;
    for closure in &mut problem.closures {
        if let (Some(off), Some(edge)) = (&mut closure.switched_off, graph.edges.get(closure.edge))
        {
            off.chi2 = edge.chi2(&graph.poses[edge.i], &graph.poses[edge.j]);
        }
    }
    Ok(Solved { solve, before, after, proof })
}

/// The costs where the last solve started: its poses are gone, but they are of one kind.
fn at_start(solve: &SolveSummary, after: &CostReport) -> CostReport {
    let relative_pose = FactorCost { cost: solve.initial_cost, ..after.relative_pose };
    CostReport { total: solve.initial_cost, relative_pose, ..*after }
}
