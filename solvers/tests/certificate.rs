//! The chordal optimum with its proof: real graphs that SE-Sync certifies, local minima escaped, and
//! no claim where there is none.

use covis_solvers::certificate::{Certificate, IsotropicPrecision, certify};
use covis_solvers::factors::RelativePose;
use covis_solvers::geometry::{LieGroup, RigidMotion, Se2, Se3};
use covis_solvers::information::Information;
use covis_solvers::initialization::{chordal, odometry};
use covis_solvers::io::g2o::G2oGraph;
use covis_solvers::price::Limits;
use covis_solvers::problem::{PoseGraph, SolveError};
use nalgebra::{Vector3, Vector6};

use super::pose_graph::graphs::{Recipe, make};
use crate::io::data::data;

/// The chordal cost from its definition.
fn cost<G: RigidMotion<D, N>, const D: usize, const N: usize>(graph: &PoseGraph<G, N>) -> f64 {
    let term = |edge: &RelativePose<G, N>| {
        let precision = IsotropicPrecision::of::<D, N>(&edge.information);
        let (i, j) = (&graph.poses[edge.i], &graph.poses[edge.j]);
        let rotation = j.rotation_matrix() - i.rotation_matrix() * edge.i_from_j.rotation_matrix();
        let translation =
            j.translation() - i.translation() - i.rotation_matrix() * edge.i_from_j.translation();
        precision.rotation * rotation.norm_squared()
            + precision.translation * translation.norm_squared()
    };
    graph.edges.iter().map(term).sum()
}

fn run<G: RigidMotion<D, N>, const D: usize, const N: usize>(
    mut graph: PoseGraph<G, N>,
) -> Certificate {
    chordal(&mut graph, Limits::NONE).unwrap();
    let certificate = certify(&mut graph, Limits::NONE).unwrap();
    let found = cost(&graph);
    // The quadratic form subtracts large numbers: parking-garage loses nine digits.
    assert!((certificate.cost / found - 1.0).abs() < 1e-6, "{} {found}", certificate.cost);
    certificate
}

#[test]
fn graphs_that_se_sync_certifies_are_certified() {
    for (name, expected, digits) in [
        ("sphere2500", 1687.0, 0.5),
        ("torus3D", 24227.0, 0.5),
        ("parking-garage", 1.263, 5e-4),
        ("city10000", 638.6, 0.05),
        ("CSAIL", 31.70, 5e-3),
        ("intel", 52.35, 5e-3),
    ] {
        let Some(path) = data(&format!("pose_graph/{name}.g2o")) else { return };

        let certificate = match G2oGraph::read(&path).unwrap() {
            G2oGraph::Se2(file) => run(file.to_pose_graph().unwrap()),
            G2oGraph::Se3(file) => run(file.to_pose_graph().unwrap()),
        };
        assert!(certificate.certified, "{name}: {certificate:?}");
        assert!((certificate.cost - expected).abs() <= digits, "{name}: {certificate:?}");
        assert_eq!(certificate.lifts, 0, "{name}");
    }
}

#[test]
fn small_graphs_are_certified_in_the_plane_and_in_space() {
    let recipe = Recipe { seed: 8, poses: 40, measurement_sigma: 0.05, start_sigma: 0.0 };
    let (graph, _) = make::<Se2, 3>(recipe);
    assert!(run(graph).certified);
    let (graph, _) = make::<Se3, 6>(recipe);
    assert!(run(graph).certified);
}

/// A ring of `count` exact steps, its poses wound once more than they are measured.
fn wound_ring<G: RigidMotion<D, N>, const D: usize, const N: usize>(
    count: usize,
    step: &G,
    wound: &G,
    information: Information<N>,
) -> PoseGraph<G, N> {
    let mut graph = PoseGraph::new();
    let mut pose = G::identity();
    for k in 0..count {
        graph.push_pose(k as i64, pose);
        pose = pose.compose(wound);
        let j = (k + 1) % count;
        graph.edges.push(RelativePose { i: k, j, i_from_j: *step, information, loss: None });
    }
    graph
}

#[test]
fn a_local_minimum_is_seen_and_left() {
    // A rotation all the way round is a stationary winding of an identity ring.
    let count = 24;
    let turn = std::f64::consts::TAU / count as f64;
    let information = Information::from_sigmas(&Vector3::new(10.0, 10.0, 0.1)).unwrap();
    let wound = Se2::from_xy_angle(0.0, 0.0, turn);
    let mut graph = wound_ring(count, &Se2::identity(), &wound, information);
    let before = cost(&graph);
    let certificate = certify(&mut graph, Limits::NONE).unwrap();
    assert!(certificate.lifts > 0);
    assert!(certificate.certified, "{certificate:?}");
    assert!(certificate.cost < 1e-6 * before, "{before} {certificate:?}");
}

#[test]
fn rings_in_space_are_unwound_at_any_size() {
    // Positions that drifted beside rotations once hid the way out, at sizes that rounding chose.
    let information = Information::from_sigmas(&Vector6::repeat(0.1)).unwrap();
    for count in [12, 16, 20, 23, 24, 25, 36, 60] {
        let turn = std::f64::consts::TAU / count as f64;
        let wound = Se3::exp(&Vector6::new(0.0, 0.0, 0.0, 0.0, 0.0, turn));
        let mut graph = wound_ring(count, &Se3::identity(), &wound, information);
        let before = cost(&graph);
        let certificate = certify(&mut graph, Limits::NONE).unwrap();
        assert!(certificate.certified, "{count}: {certificate:?}");
        assert!(certificate.cost < 1e-6 * before, "{count}: {before} {certificate:?}");
    }
}

#[test]
fn the_gauge_stays_and_several_are_refused() {
    let recipe = Recipe { seed: 9, poses: 30, measurement_sigma: 0.05, start_sigma: 0.1 };
    let (mut graph, _) = make::<Se3, 6>(recipe);
    graph.constant.fill(false);
    graph.constant[7] = true;
    let held = graph.poses[7];
    odometry(&mut graph).unwrap();
    certify(&mut graph, Limits::NONE).unwrap();
    assert_eq!(graph.poses[7], held);
    graph.constant[8] = true;
    let error = certify(&mut graph, Limits::NONE).unwrap_err();
    assert!(matches!(error, SolveError::InvalidOption { field: "certify", .. }));
}
