//! The chordal start: exact on exact measurements, whatever the poses were, and close to the optimum
//! on real graphs.

use covis_solvers::evaluation::{ReferencePose, pose_graph_cost};
use covis_solvers::geometry::{LieGroup, RigidMotion, Se2, Se3};
use covis_solvers::information::Information;
use covis_solvers::initialization::{IsotropicPrecision, chordal};
use covis_solvers::io::g2o::G2oGraph;
use covis_solvers::price::Limits;
use covis_solvers::problem::{PoseGraph, SolveError};
use nalgebra::{Vector3, Vector6};

use super::graphs::{Recipe, distance, make, optimize};
use crate::io::data::data;

const NOISELESS: Recipe = Recipe { seed: 5, poses: 60, measurement_sigma: 0.0, start_sigma: 5.0 };

fn rebuilds_truth<G: RigidMotion<D, N>, const D: usize, const N: usize>() {
    let (mut graph, truth) = make::<G, N>(NOISELESS);
    for edge in graph.edges.iter_mut().step_by(2) {
        (edge.i, edge.j) = (edge.j, edge.i);
        edge.i_from_j = edge.i_from_j.inverse();
    }
    // A second gauge, an edge between two constants, one of a pose with itself.
    graph.poses[20] = truth[20];
    graph.constant[20] = true;
    graph.edges.push(graph.edges[3]);
    let last = graph.edges.len() - 1;
    (graph.edges[last].i, graph.edges[last].j) = (7, 7);
    chordal(&mut graph, Limits::NONE).unwrap();
    assert!(distance(&graph.poses, &truth) < 1e-9, "{}", distance(&graph.poses, &truth));
}

#[test]
fn exact_measurements_give_the_truth() {
    rebuilds_truth::<Se2, 2, 3>();
    rebuilds_truth::<Se3, 3, 6>();
}

#[test]
fn without_a_constant_pose_the_lowest_id_stays() {
    let (mut graph, truth) = make::<Se3, 6>(NOISELESS);
    graph.constant[0] = false;
    chordal(&mut graph, Limits::NONE).unwrap();
    assert!(distance(&graph.poses, &truth) < 1e-9);
    assert!(!graph.constant.contains(&true));
}

#[test]
fn the_start_of_poses_that_move_does_not_matter() {
    let noisy = Recipe { measurement_sigma: 0.1, ..NOISELESS };
    let (mut graph, _) = make::<Se3, 6>(noisy);
    let mut other = graph.clone();
    other.poses[1..].fill(Se3::identity());
    chordal(&mut graph, Limits::NONE).unwrap();
    chordal(&mut other, Limits::NONE).unwrap();
    assert_eq!(graph.poses, other.poses);
}

#[test]
fn precisions_are_those_of_se_sync() {
    let sigmas = Vector6::new(0.1, 0.2, 0.3, 0.01, 0.02, 0.04);
    let information = Information::from_sigmas(&sigmas).unwrap();
    let fitted = IsotropicPrecision::of::<3, 6>(&information);
    assert!((fitted.translation - 3.0 / 0.14).abs() < 1e-10);
    assert!((fitted.rotation - 3.0 / (2.0 * 0.0021)).abs() < 1e-8);
    let information = Information::from_sigmas(&Vector3::new(0.1, 0.2, 0.5)).unwrap();
    let fitted = IsotropicPrecision::of::<2, 3>(&information);
    assert!((fitted.translation - 2.0 / 0.05).abs() < 1e-10);
    assert!((fitted.rotation - 4.0).abs() < 1e-12);
}

#[test]
fn a_graph_in_two_pieces_is_refused_and_left_alone() {
    let (mut graph, _) = make::<Se2, 3>(NOISELESS);
    graph.push_pose(1000, Se2::identity());
    let before = graph.clone();
    assert!(matches!(chordal(&mut graph, Limits::NONE), Err(SolveError::Disconnected { .. })));
    assert_eq!(graph, before);
}

/// Accepted steps from the chordal start until the cost is within 0.1 % of the optimum.
fn steps_to_optimum<G: RigidMotion<D, N> + ReferencePose<N>, const D: usize, const N: usize>(
    mut graph: PoseGraph<G, N>,
    optimum: f64,
) -> usize {
    graph.fix_lowest_id();
    let gauge = graph.poses[0];
    chordal(&mut graph, Limits::NONE).unwrap();
    assert_eq!(graph.poses[0], gauge);
    let summary = optimize(&mut graph);
    let cost = pose_graph_cost(&graph).total;
    assert!((cost / optimum - 1.0).abs() < 1e-6, "{cost}");
    summary.iterations.iter().filter(|row| row.accepted && row.cost > 1.001 * optimum).count()
}

#[test]
fn real_graphs_start_two_steps_from_their_optimum() {
    // torus3D ends near 29,950 from the poses of its file; kitti_00 and CSAIL are edges only.
    for (name, optimum) in [
        ("sphere2500", 675.7009629),
        ("torus3D", 12117.63688),
        ("parking-garage", 0.6341923996),
        ("M3500", 68.95743912),
        ("intel", 22.50211654),
        ("kitti_00", 49.16106911),
        ("CSAIL", 20.27544167),
    ] {
        let Some(path) = data(&format!("pose_graph/{name}.g2o")) else { return };
        let steps = match G2oGraph::read(&path).unwrap() {
            G2oGraph::Se2(file) => steps_to_optimum(file.to_pose_graph().unwrap(), optimum),
            G2oGraph::Se3(file) => steps_to_optimum(file.to_pose_graph().unwrap(), optimum),
        };
        assert!(steps <= 2, "{name}: {steps}");
    }
}
