//! The spanning tree: exact on exact measurements, breadth-first from the constants.

use covis_solvers::factors::RelativePose;
use covis_solvers::geometry::{LieGroup, Se2, Se3, Sim3};
use covis_solvers::information::Information;
use covis_solvers::initialization::{Start, initialize, odometry, spanning_tree};
use covis_solvers::io::g2o::G2oGraph;
use covis_solvers::price::Limits;
use covis_solvers::problem::{PoseGraph, SolveError};

use super::graphs::{Recipe, distance, make, optimize};
use crate::io::data::data;

const NOISELESS: Recipe = Recipe { seed: 3, poses: 50, measurement_sigma: 0.0, start_sigma: 5.0 };

fn rebuilds_truth<G: LieGroup<N>, const N: usize>() {
    let (mut graph, truth) = make::<G, N>(NOISELESS);
    // Every other edge the other way round; two constants.
    for edge in graph.edges.iter_mut().step_by(2) {
        (edge.i, edge.j) = (edge.j, edge.i);
        edge.i_from_j = edge.i_from_j.inverse();
    }
    graph.poses[20] = truth[20];
    graph.constant[20] = true;
    let before = graph.poses[20];
    spanning_tree(&mut graph).unwrap();
    assert!(distance(&graph.poses, &truth) < 1e-10);
    assert_eq!(graph.poses[20], before);
}

#[test]
fn exact_measurements_give_the_truth() {
    rebuilds_truth::<Se2, 3>();
    rebuilds_truth::<Se3, 6>();
    rebuilds_truth::<Sim3, 7>();
}

/// A graph of identities with edges (i, j, x): x meters ahead.
fn line(ids: &[i64], edges: &[(usize, usize, f64)]) -> PoseGraph<Se2, 3> {
    let mut graph = PoseGraph::new();
    for &id in ids {
        graph.push_pose(id, Se2::identity());
    }
    for &(i, j, x) in edges {
        let i_from_j = Se2::from_xy_angle(x, 0.0, 0.0);
        graph.edges.push(RelativePose {
            i,
            j,
            i_from_j,
            information: Information::identity(),
            loss: None,
        });
    }
    graph
}

fn spanned(mut graph: PoseGraph<Se2, 3>) -> Vec<f64> {
    spanning_tree(&mut graph).unwrap();
    graph.poses.iter().map(|pose| pose.translation.x).collect()
}

#[test]
fn starts_at_the_lowest_id_and_takes_the_shortest_way() {
    // Stored as ids 2, 0, 1, 3; the closure 0-3 is shorter than the way along 1 and 2, and of
    // the two equal ways to 2 the one from the lower id counts.
    let mut graph = line(&[2, 0, 1, 3], &[(0, 3, 1.0), (2, 0, 1.0), (1, 2, 1.0), (3, 1, -100.0)]);
    graph.poses[1] = Se2::from_xy_angle(10.0, 0.0, 0.0);
    assert_eq!(spanned(graph), [12.0, 10.0, 11.0, 110.0]);
}

#[test]
fn of_equal_ways_the_nearest_ids_count_and_of_parallel_edges_the_first() {
    // Pose 3 is two edges from 0 by way of 1 (gap 2) and of 2 (gap 1).
    let edges = [(1, 3, 500.0), (0, 1, 1.0), (0, 1, 7.0), (0, 2, 2.0), (2, 3, 1.0), (2, 3, 9.0)];
    assert_eq!(spanned(line(&[0, 1, 2, 3], &edges)), [0.0, 1.0, 2.0, 3.0]);
    let mut reordered = edges;
    reordered.rotate_left(4);
    assert_eq!(spanned(line(&[0, 1, 2, 3], &reordered)), [0.0, 1.0, 2.0, 3.0]);
}

#[test]
fn an_unfortunate_start_is_replaced_by_one_that_leads_to_the_optimum() {
    // From the odometry of its file this graph ends near 29950, as with Ceres and GTSAM.
    let Some(path) = data("pose_graph/torus3D.g2o") else { return };
    let G2oGraph::Se3(file) = G2oGraph::read(&path).unwrap() else { panic!("not a 3D graph") };
    let mut graph = file.to_pose_graph().unwrap();
    spanning_tree(&mut graph).unwrap();
    let cost = optimize(&mut graph).final_cost;
    assert!((cost / 12117.63688 - 1.0).abs() < 1e-6, "{cost}");
}

#[test]
fn refuses_a_graph_in_two_pieces() {
    let mut graph = line(&[0, 1, 2, 3], &[(0, 1, 1.0), (2, 3, 1.0)]);
    let before = graph.clone();
    let SolveError::Disconnected { pieces } = spanning_tree(&mut graph).unwrap_err() else {
        panic!("another error");
    };
    assert_eq!(pieces.len(), 2);
    assert_eq!(graph, before);
}

#[test]
fn odometry_leaves_closures_out_where_it_reaches() {
    // The closure 0-3 is shorter, but false; pose 9 hangs on a closure alone.
    let edges = [(0, 3, 50.0), (0, 1, 1.0), (1, 2, 1.0), (2, 3, 1.0), (1, 4, 7.0)];
    let mut graph = line(&[0, 1, 2, 3, 9], &edges);
    odometry(&mut graph).unwrap();
    let x: Vec<f64> = graph.poses.iter().map(|pose| pose.translation.x).collect();
    assert_eq!(x, [0.0, 1.0, 2.0, 3.0, 8.0]);
}

#[test]
fn auto_takes_the_start_of_lower_cost_and_says_which() {
    let recipe = Recipe { measurement_sigma: 0.02, ..NOISELESS };
    let (mut graph, _) = make::<Se3, 6>(recipe);
    assert_eq!(initialize(&mut graph, Start::Auto, true, Limits::NONE).unwrap(), Start::Chordal);
    optimize(&mut graph);
    let optimum = graph.poses.clone();
    assert_eq!(initialize(&mut graph, Start::Auto, true, Limits::NONE).unwrap(), Start::Given);
    assert_eq!(graph.poses, optimum);
    assert_eq!(initialize(&mut graph, Start::Auto, false, Limits::NONE).unwrap(), Start::Chordal);
    let error = initialize(&mut graph, Start::Given, false, Limits::NONE).unwrap_err();
    assert!(matches!(error, SolveError::InvalidOption { field: "init", .. }), "{error}");
}
