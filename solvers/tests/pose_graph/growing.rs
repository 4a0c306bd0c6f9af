//! Pose graphs that grow: the optimum after each update, whatever came in whichever order.

use covis_solvers::evaluation::{ReferencePose, pose_graph_cost};
use covis_solvers::factors::RelativePose;
use covis_solvers::geometry::{LieGroup, RigidMotion, Se2, Se3};
use covis_solvers::information::Information;
use covis_solvers::io::g2o::G2oGraph;
use covis_solvers::optimizer::ignore_iterations;
use covis_solvers::pose_graph::{GrowingPoseGraph, Options, solve};
use covis_solvers::problem::{PoseGraph, SolveError};
use covis_solvers::testing::random::{normal_vector, seeded};
use nalgebra::{SVector, Vector3};

use crate::io::data::data;

/// Laps of a circle with noise; each place is seen again one lap later.
fn laps<G: RigidMotion<D, N>, const D: usize, const N: usize>(
    step: &SVector<f64, N>,
    lap: usize,
) -> PoseGraph<G, N> {
    let mut rng = seeded(7);
    let information = Information::from_sigmas(&SVector::repeat(0.03)).unwrap();
    let mut graph = PoseGraph::new();
    let mut truth = vec![G::identity()];
    graph.push_pose(0, G::identity());
    for j in 1..4 * lap {
        truth.push(truth[j - 1].plus(step));
        graph.push_pose(j as i64, G::identity());
        for i in [Some(j - 1), j.checked_sub(lap)].into_iter().flatten() {
            let i_from_j = truth[i].inverse().compose(&truth[j]);
            let i_from_j = i_from_j.plus(&normal_vector(&mut rng, 0.03));
            graph.edges.push(RelativePose { i, j, i_from_j, information, loss: None });
        }
    }
    graph
}

/// The optimum that the batch solver finds from the estimate.
fn batch_cost<G: RigidMotion<D, N> + ReferencePose<N>, const D: usize, const N: usize>(
    growing: &GrowingPoseGraph<G, D, N>,
) -> f64 {
    let mut graph = growing.graph().clone();
    solve(&mut graph, &Options::default(), &mut ignore_iterations).unwrap();
    pose_graph_cost(&graph).total
}

/// Feeds poses in id order, each with its edges to earlier ones, and calls `check` after each.
pub(crate) fn feed<G: RigidMotion<D, N>, const D: usize, const N: usize>(
    graph: &PoseGraph<G, N>,
    mut check: impl FnMut(&GrowingPoseGraph<G, D, N>, usize),
) -> GrowingPoseGraph<G, D, N> {
    let mut order: Vec<usize> = (0..graph.ids.len()).collect();
    order.sort_by_key(|&pose| graph.ids[pose]);
    let mut rank = vec![0; order.len()];
    for (k, &pose) in order.iter().enumerate() {
        rank[pose] = k;
    }
    let mut due = vec![Vec::new(); order.len()];
    for edge in &graph.edges {
        let (i, j) = (rank[edge.i], rank[edge.j]);
        due[i.max(j)].push(RelativePose { i, j, ..*edge });
    }
    let mut growing = GrowingPoseGraph::new(graph.ids[order[0]], graph.poses[order[0]]);
    for k in 1..order.len() {
        growing.push_pose(graph.ids[order[k]]).unwrap();
        for edge in &due[k] {
            growing.push_edge(*edge).unwrap();
        }
        growing.update().unwrap();
        check(&growing, k);
    }
    growing
}

fn assert_near_optimum<G: RigidMotion<D, N> + ReferencePose<N>, const D: usize, const N: usize>(
    growing: &GrowingPoseGraph<G, D, N>,
    what: &str,
) {
    let (cost, batch) = (growing.cost(), batch_cost(growing));
    assert!(cost <= 1.01 * batch + 1e-12, "{what}: {cost} where the batch solver has {batch}");
}

#[test]
fn every_update_in_the_plane_is_at_the_optimum() {
    let graph = laps::<Se2, 2, 3>(&Vector3::new(0.5, 0.0, 0.15), 42);
    feed(&graph, |growing, k| assert_near_optimum(growing, &format!("pose {k}")));
}

#[test]
fn every_update_in_space_is_at_the_optimum() {
    let step = SVector::<f64, 6>::from([0.4, 0.02, 0.0, 0.01, 0.02, 0.2]);
    let graph = laps::<Se3, 3, 6>(&step, 31);
    feed(&graph, |growing, k| assert_near_optimum(growing, &format!("pose {k}")));
}

#[test]
fn poses_tied_by_one_edge_cost_nothing_and_follow() {
    let step = SVector::<f64, 6>::from([0.4, 0.02, 0.0, 0.01, 0.02, 0.2]);
    let mut graph = laps::<Se3, 3, 6>(&step, 20);
    // A side branch of three poses at pose 25, which closures will move.
    let information = graph.edges[0].information;
    let i_from_j = Se3::exp(&step);
    for (i, j) in [(25, 1000), (1000, 1001), (1001, 1002)] {
        let index = |id: i64| graph.ids.iter().position(|&other| other == id).unwrap();
        let at = if j == 1000 { i as usize } else { index(i) };
        let new = graph.push_pose(j, Se3::identity());
        graph.edges.push(RelativePose { i: at, j: new, i_from_j, information, loss: None });
    }
    let growing = feed(&graph, |_, _| {});
    let at = |id: i64| growing.graph().poses[growing.index_of(id).unwrap()];
    let expected = at(25).compose(&i_from_j).compose(&i_from_j).compose(&i_from_j);
    assert!(at(1002).minus(&expected).norm() < 1e-12);
}

#[test]
fn an_odometry_update_does_no_elimination() {
    let mut growing = GrowingPoseGraph::<Se2, 2, 3>::new(0, Se2::identity());
    let information = Information::identity();
    for k in 0..100 {
        let j = growing.push_pose(k + 1).unwrap();
        let i_from_j = Se2::from_xy_angle(1.0, 0.0, 0.1);
        growing.push_edge(RelativePose { i: j - 1, j, i_from_j, information, loss: None }).unwrap();
        assert_eq!(growing.update().unwrap().eliminated, 0);
    }
    assert!(growing.cost() < 1e-20);
}

#[test]
fn pieces_wait_until_an_edge_ties_them() {
    let graph = laps::<Se2, 2, 3>(&Vector3::new(0.5, 0.0, 0.15), 30);
    let mut growing = GrowingPoseGraph::new(0, graph.poses[0]);
    for &id in &graph.ids[1..] {
        growing.push_pose(id).unwrap();
    }
    // All edges but those of pose 0: nothing ties the rest to it.
    let (first, rest): (Vec<_>, Vec<_>) = graph.edges.iter().partition(|edge| edge.i == 0);
    for &edge in &rest {
        growing.push_edge(edge).unwrap();
    }
    growing.update().unwrap();
    assert!(!growing.is_placed(1) && growing.cost() == 0.0);
    for edge in first {
        growing.push_edge(edge).unwrap();
    }
    growing.update().unwrap();
    assert!((0..graph.ids.len()).all(|pose| growing.is_placed(pose)));
    assert_near_optimum(&growing, "the whole graph at once");
}

#[test]
fn what_cannot_be_added_is_refused_and_harms_nothing() {
    let mut growing = GrowingPoseGraph::<Se2, 2, 3>::new(5, Se2::identity());
    let information = Information::identity();
    let edge = |i, j, x| {
        let i_from_j = Se2::from_xy_angle(x, 0.0, 0.0);
        RelativePose { i, j, i_from_j, information, loss: None }
    };
    assert_eq!(growing.push_pose(5), Err(SolveError::DuplicateId { what: "pose", id: 5 }));
    growing.push_pose(6).unwrap();
    let out_of_range = growing.push_edge(edge(0, 2, 1.0));
    assert!(matches!(out_of_range, Err(SolveError::IndexOutOfRange { value: 2, .. })));
    let not_finite = growing.push_edge(edge(0, 1, f64::NAN));
    assert!(matches!(not_finite, Err(SolveError::NotFinite { what: "edge", .. })));
    // An edge of a pose with itself has a constant cost.
    growing.push_edge(edge(1, 1, 2.0)).unwrap();
    growing.push_edge(edge(0, 1, 1.0)).unwrap();
    growing.push_edge(edge(1, 0, -3.0)).unwrap();
    growing.update().unwrap();
    assert!((growing.graph().poses[1].translation.x - 2.0).abs() < 1e-9);
    assert!((growing.cost() - 3.0).abs() < 1e-9);
}

#[test]
fn files_are_at_the_optimum_at_each_hundredth_pose() {
    fn check<G: RigidMotion<D, N> + ReferencePose<N>, const D: usize, const N: usize>(
        name: &str,
        graph: &PoseGraph<G, N>,
        best: f64,
    ) {
        let growing = feed(graph, |growing, k| {
            if k % 100 == 0 {
                assert_near_optimum(growing, &format!("{name}, pose {k}"));
            }
        });
        let cost = growing.cost();
        assert!(cost < 1.005 * best, "{name} ends at {cost}");
    }
    for (name, best) in [
        ("CSAIL", 20.27544167),
        ("intel", 22.50211654),
        ("kitti_00", 49.16106911),
        ("M3500", 68.95743912),
        ("parking-garage", 0.6341923996),
    ] {
        let Some(path) = data(&format!("pose_graph/{name}.g2o")) else { return };
        match G2oGraph::read(&path).unwrap() {
            G2oGraph::Se2(file) => check(name, &file.to_pose_graph().unwrap(), best),
            G2oGraph::Se3(file) => check(name, &file.to_pose_graph().unwrap(), best),
        }
    }
}
