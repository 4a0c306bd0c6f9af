//! `SolvePoseGraph`: from the request to the answer, on a thread of the solver pool.
//! Without a marked vertex the one with the lowest id is held; costs come from the evaluator.

use std::time::Duration;

use covis_solvers::evaluation::{ReferencePose, pose_graph_cost};
use covis_solvers::geometry::{RigidMotion, Se2, Se3};
use covis_solvers::initialization::initialize;
use covis_solvers::loss::Loss;
use covis_solvers::optimizer::{Observer, Options};
use covis_solvers::pose_graph;
use covis_solvers::problem::PoseGraph;

use super::convert::certificate::add_costs;
use super::convert::geometry::{to_rigid_transform, to_rigid_transform2};
use super::convert::problem::{GraphToSolve, graph_se2, graph_se3};
use super::convert::solve::{Systems, loss, options, to_iterations, to_summary};
use super::convert::{Path, convert, count};
use super::error::ServiceError;
use crate::wire::v1;
use v1::solve_pose_graph_request::Graph as WireGraph;
use v1::solve_pose_graph_response::Graph as SolvedGraph;

/// A request in the solver's terms.
pub(super) struct Input {
    graph: AnyGraph,
    options: Options,
    include_iterations: bool,
}

/// A graph of either group.
enum AnyGraph {
    Se3(GraphToSolve<Se3, 6>),
    Se2(GraphToSolve<Se2, 3>),
}

/// Reads a request.
pub(super) fn input(
    request: v1::SolvePoseGraphRequest,
    threads: usize,
    time: Option<Duration>,
) -> Result<Input, ServiceError> {
    let input = convert(|out| {
        let graph_loss = loss(Path::root("loss"), request.loss.as_ref(), out);
        let options = options(request.options.as_ref(), Systems::PoseGraph, threads, time, out);
        let graph_loss = graph_loss?.unwrap_or(Loss::Trivial);
        let graph = match &request.graph {
            None => out.missing(Path::root("graph")),
            Some(WireGraph::Se3(graph)) => {
                graph_se3(graph, graph_loss, request.start, out).map(AnyGraph::Se3)
            }
            Some(WireGraph::Se2(graph)) => {
                graph_se2(graph, graph_loss, request.start, out).map(AnyGraph::Se2)
            }
        };
        let options = options?.optimizer;
        Some(Input { graph: graph?, options, include_iterations: request.include_iterations })
    })?;
    Ok(input)
}

/// Solves the graph.
pub(super) fn run(
    input: Input,
    observer: &mut Observer<'_>,
) -> Result<v1::SolvePoseGraphResponse, ServiceError> {
    let Input { graph, options, include_iterations } = input;
    let (graph, mut answer) = match graph {
        AnyGraph::Se3(graph) => {
            let (graph, answer) = solve("se3", graph, options, include_iterations, observer)?;
            let vertices = vertices(&graph).map(|(id, pose, fixed)| v1::PoseGraphVertexSe3 {
                id,
                world_from_vertex: Some(to_rigid_transform(pose)),
                fixed,
            });
            let vertices = vertices.collect();
            (SolvedGraph::Se3(v1::PoseGraphSe3 { vertices, edges: Vec::new() }), answer)
        }
        AnyGraph::Se2(graph) => {
            let (graph, answer) = solve("se2", graph, options, include_iterations, observer)?;
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

fn vertices<G, const N: usize>(graph: &PoseGraph<G, N>) -> impl Iterator<Item = (i64, &G, bool)> {
    let vertices = graph.ids.iter().zip(&graph.poses).zip(&graph.constant);
    vertices.map(|((&id, pose), &fixed)| (id, pose, fixed))
}

fn solve<G: ReferencePose<N> + RigidMotion<D, N>, const D: usize, const N: usize>(
    field: &'static str,
    input: GraphToSolve<G, N>,
    optimizer: Options,
    include_iterations: bool,
    observer: &mut Observer<'_>,
) -> Result<(PoseGraph<G, N>, v1::SolvePoseGraphResponse), ServiceError> {
    let unsolvable = |error| ServiceError::Unsolvable { field, error };
    let mut graph = input.graph;
    let marked = graph.constant.contains(&true);
    if !marked {
        graph.fix_lowest_id();
    }
    initialize(&mut graph, input.start, input.has_poses).map_err(unsolvable)?;
    let before = pose_graph_cost(&graph);
    let options = pose_graph::Options { optimizer };
    let solved = pose_graph::solve(&mut graph, &options, observer).map_err(unsolvable)?;
    let mut summary = to_summary(&solved, optimizer.method);
    add_costs(&mut summary, &before, &pose_graph_cost(&graph));
    summary.linear_solver = v1::LinearSolver::SparseCholesky.into();
    let gauge = if marked { v1::Gauge::FixedPoses } else { v1::Gauge::FirstKeyframeFixed };
    summary.gauge = gauge.into();
    let free = graph.constant.iter().filter(|&&constant| !constant).count();
    summary.free_pose_count = count(free);
    summary.fixed_pose_count = count(graph.constant.len() - free);
    let iterations = to_iterations(&solved, include_iterations);
    let answer = v1::SolvePoseGraphResponse { graph: None, summary: Some(summary), iterations };
    Ok((graph, answer))
}
