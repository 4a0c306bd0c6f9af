//! `SolvePoseGraph`: from the request to the answer, on a thread of the solver pool. Without a
//! marked vertex the one with the lowest id is fixed; costs come from the evaluator. With `robust`
//! the costs use the weights of the edges.

use covis_solvers::geometry::{Se2, Se3};
use covis_solvers::graph_optimization::{self, GraphPose, Judging, Optimized, optimize};
use covis_solvers::initialization::Start;
use covis_solvers::interrupt::Interrupt;
use covis_solvers::loss::Loss;
use covis_solvers::optimizer::{Options, ignore_iterations};
use covis_solvers::pose_graph;
use covis_solvers::problem::PoseGraph;
use covis_solvers::robust::{ClosureVerdict, Kernel};

use super::convert::geometry::{to_rigid_transform, to_rigid_transform2};
use super::convert::problem::{GraphToSolve, graph_se2, graph_se3};
use super::convert::solve::{
    Systems, add_costs, loss, options, robustness, to_chordal_certificate, to_iterations,
    to_summary,
};
use super::convert::{Path, Violations, convert, count, small};
use super::engine::Estimate;
use super::error::ServiceError;
use super::optimization_service::SolveBudget;
use crate::map::{ClosureRobustness, Reason};
use crate::wire::v1;
use v1::solve_pose_graph_request::Graph as WireGraph;
use v1::solve_pose_graph_response::Graph as SolvedGraph;

/// A request in the solver's terms.
pub(super) struct Input {
    graph: AnyGraph,
    settings: Settings,
}

/// How a graph is solved.
#[derive(Clone, Copy)]
struct Settings {
    options: Options,
    robust: ClosureRobustness,
    certify: bool,
    include_iterations: bool,
}

/// A graph of either group.
enum AnyGraph {
    Se3(GraphToSolve<Se3, 6>),
    Se2(GraphToSolve<Se2, 3>),
}

impl Input {
    /// The expected cost of its solve.
    pub(super) fn estimate(&self) -> Estimate {
        let optimizer = &self.settings.options;
        let bound = match &self.graph {
            AnyGraph::Se3(input) => pose_graph::price_bound(&input.graph),
            AnyGraph::Se2(input) => pose_graph::price_bound(&input.graph),
        };
        Estimate::new(bound, optimizer.max_iterations, &optimizer.ceiling)
    }
}

/// Reads a request.
pub(super) fn input(
    request: v1::SolvePoseGraphRequest,
    budget: &SolveBudget,
) -> Result<Input, ServiceError> {
    Ok(convert(|out| {
        let graph_loss = loss(Path::root("loss"), request.loss.as_ref(), out);
        let systems = Systems::PoseGraph;
        let options = options(request.options.as_ref(), systems, budget.threads, None, out);
        let at = Path::root("robust");
        let robust = robustness(at, request.robust.as_ref(), ClosureRobustness::NONE, out);
        let graph_loss = graph_loss?.unwrap_or(Loss::Trivial);
        let robust = robust?;
        let graph = match &request.graph {
            None => out.missing(Path::root("graph")),
            Some(WireGraph::Se3(graph)) => {
                let graph = graph_se3(graph, graph_loss, request.start, out);
                graph.map(|graph| AnyGraph::Se3(adapted(graph, &request, robust.kernel, out)))
            }
            Some(WireGraph::Se2(graph)) => {
                let graph = graph_se2(graph, graph_loss, request.start, out);
                graph.map(|graph| AnyGraph::Se2(adapted(graph, &request, robust.kernel, out)))
            }
        };
        let (certify, include_iterations) = (request.certify, request.include_iterations);
        let options = Options { ceiling: budget.ceiling, ..options?.optimizer };
        let settings = Settings { options, robust, certify, include_iterations };
        Some(Input { graph: graph?, settings })
    })?)
}

/// The graph with the start that the rest of the request makes the default.
fn adapted<G, const N: usize>(
    mut input: GraphToSolve<G, N>,
    request: &v1::SolvePoseGraphRequest,
    kernel: Option<Kernel>,
    out: &mut Violations,
) -> GraphToSolve<G, N> {
    if request.certify && input.graph.constant.iter().filter(|&&constant| constant).count() > 1 {
        let text = "a graph with several fixed vertices cannot be certified";
        let _: Option<()> = out.report(Path::root("certify"), Reason::Inconsistent, text);
    }
    if request.start == i32::from(v1::PoseGraphStart::Unspecified) {
        match kernel {
            Some(_) => input.start = Start::Auto,
            None if request.certify => input.start = Start::Chordal,
            None => {}
        }
    }
    input
}

/// Solves the graph.
pub(super) fn run(
    input: Input,
    interrupt: &Interrupt,
) -> Result<v1::SolvePoseGraphResponse, ServiceError> {
    let Input { graph, settings } = input;
    let (graph, mut answer) = match graph {
        AnyGraph::Se3(graph) => {
            let (graph, answer) = answer("se3", graph, &settings, interrupt)?;
            let vertices = vertices(&graph).map(|(id, pose, fixed)| v1::PoseGraphVertexSe3 {
                id,
                world_from_vertex: Some(to_rigid_transform(pose)),
                fixed,
            });
            let vertices = vertices.collect();
            (SolvedGraph::Se3(v1::PoseGraphSe3 { vertices, edges: Vec::new() }), answer)
        }
        AnyGraph::Se2(graph) => {
            let (graph, answer) = answer("se2", graph, &settings, interrupt)?;
            let vertices = vertices(&graph).map(|(id, pose, fixed)| v1::PoseGraphVertexSe2 {
                id,
                world_from_vertex: Some(to_rigid_transform2(pose)),
                fixed,
            });
            let vertices = vertices.collect();
            (SolvedGraph::Se2(v1::PoseGraphSe2 { vertices, edges: Vec::new() }), answer)
        }
    };
    answer.graph = Some(graph);
    Ok(answer)
}

/// The certificate of a graph's solve; `marked` where fixed vertices were given.
pub(super) fn to_graph_summary<G, const N: usize>(
    graph: &PoseGraph<G, N>,
    solved: &Optimized,
    options: &Options,
    marked: bool,
) -> v1::SolveSummary {
    let mut summary = to_summary(&solved.solve, options.method);
    add_costs(&mut summary, &solved.before, &solved.after);
    summary.linear_solver = v1::LinearSolver::SparseCholesky.into();
    let gauge = match (marked, graph.constant.contains(&true)) {
        (true, _) => v1::Gauge::FixedPoses,
        (false, true) => v1::Gauge::FirstKeyframeFixed,
        (false, false) => v1::Gauge::Priors,
    };
    summary.gauge = gauge.into();
    let free = graph.constant.iter().filter(|&&constant| !constant).count();
    summary.free_pose_count = count(free);
    summary.fixed_pose_count = count(graph.constant.len() - free);
    summary
}

fn vertices<G, const N: usize>(graph: &PoseGraph<G, N>) -> impl Iterator<Item = (i64, &G, bool)> {
    let vertices = graph.ids.iter().zip(&graph.poses).zip(&graph.constant);
    vertices.map(|((&id, pose), &fixed)| (id, pose, fixed))
}

fn answer<G: GraphPose<D, N>, const D: usize, const N: usize>(
    field: &'static str,
    input: GraphToSolve<G, N>,
    settings: &Settings,
    interrupt: &Interrupt,
) -> Result<(PoseGraph<G, N>, v1::SolvePoseGraphResponse), ServiceError> {
    let GraphToSolve { mut graph, start, has_poses, trusted } = input;
    let marked = graph.constant.contains(&true);
    let ClosureRobustness { kernel, threshold } = settings.robust;
    let judging =
        kernel.map(|kernel| Judging { kernel, threshold, trusted, trust_odometry: false });
    let (certify, optimizer) = (settings.certify, settings.options);
    let options = graph_optimization::Options {
        start,
        judging,
        positions: None,
        certify,
        costs: true,
        optimizer,
    };
    let solved = optimize(&mut graph, has_poses, &options, interrupt, &mut ignore_iterations);
    let solved = solved.map_err(|error| ServiceError::Unsolvable { field, error })?;
    let summary = to_graph_summary(&graph, &solved, &settings.options, marked);
    let closures = solved.judged.iter().flat_map(|judged| &judged.closures);
    let off = closures.filter(|verdict| verdict.is_switched_off).map(|verdict| {
        let ClosureVerdict { chi2, weight, is_provisional: provisional, .. } = *verdict;
        let switched_off = Some(v1::SwitchedOff { chi2, weight, provisional });
        v1::SwitchedOffEdge { edge_index: small(verdict.edge), switched_off }
    });
    let answer = v1::SolvePoseGraphResponse {
        graph: None,
        summary: Some(summary),
        iterations: to_iterations(&solved.solve, settings.include_iterations),
        switched_off_edges: off.collect(),
        chordal_certificate: solved.proof.as_ref().map(to_chordal_certificate),
    };
    Ok((graph, answer))
}
