//! The body of a pose-graph solve of a map, run on the pool.
//!
//! Verdicts on loop closures are stored in the problem and become part of the event. The stages are
//! those of [`covis_solvers::graph_optimization`].

use std::sync::Arc;

use covis_solvers::graph_optimization::{Judging, Options, optimize};
use covis_solvers::initialization::Start;
use covis_solvers::interrupt::Interrupt;
use covis_solvers::loss::Loss;
use covis_solvers::optimizer::{self, ignore_iterations};
use covis_solvers::problem::SolveError;

use super::work::{Moved, Outcome, Solution};
use super::{GaugeKind, OptimizeCounts, SolveCertificate, SolverKind};
use crate::map::{Map, SwitchedOff, loop_problem};

/// How a pose graph is optimized.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct GraphSettings {
    pub(super) optimizer: optimizer::Options,
    /// `None` uses the policy's.
    pub(super) constraint_loss: Option<Loss>,
    pub(super) certify: bool,
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
    let optimizer = settings.optimizer;
    let judging = robustness.kernel.map(|kernel| {
        let off = problem.closures.iter().filter(|closure| closure.switched_off.is_some());
        Judging {
            kernel,
            threshold: robustness.threshold,
            trusted: problem.trusted(),
            switched_off: Some(off.map(|closure| closure.edge).collect()),
        }
    });
    let options =
        Options { start: Start::Given, judging, certify: settings.certify, costs: true, optimizer };
    let rows = &mut ignore_iterations;
    let solved = match optimize(&mut problem.graph, true, &options, interrupt, rows) {
        Ok(solved) => solved,
        Err(SolveError::Empty(_)) => return Ok(None),
        Err(error) => return Err(error),
    };
    let verdicts = solved.judged.map(|judged| judged.closures).unwrap_or_default();
    for closure in &mut problem.closures {
        let place = verdicts.binary_search_by_key(&closure.edge, |verdict| verdict.edge);
        // A closure without a verdict links consecutive keyframes.
        let verdict = place.ok().and_then(|place| verdicts.get(place));
        let off = verdict.filter(|verdict| verdict.is_switched_off && verdict.chi2.is_finite());
        closure.switched_off =
            off.map(|verdict| SwitchedOff { chi2: verdict.chi2, weight: verdict.weight });
    }
    let fixed_poses = problem.graph.constant.iter().filter(|&&c| c).count();
    let certificate = SolveCertificate {
        solve: solved.solve,
        method: optimizer.method,
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
