//! What a solve takes is known before it is begun, and its time ends it within an iteration.

use std::time::Duration;

use covis_solvers::bundle_adjustment;
use covis_solvers::factors::Reprojection;
use covis_solvers::geometry::{Camera, LieGroup, PinholeRadialTangential, Se2, Se3};
use covis_solvers::optimizer::{self, Termination, ignore_iterations};
use covis_solvers::pose_graph::{self, Options};
use covis_solvers::price::{Ceiling, Resource, TooExpensive};
use covis_solvers::problem::{BundleProblem, PoseGraph, SolveError};
use covis_solvers::testing::random::seeded;
use nalgebra::{Vector2, Vector3};

use crate::pose_graph::graphs::{Recipe, edge, make};

/// Odometry and edges between any two poses: large fill in every order.
fn random_graph(poses: usize, extra: usize) -> PoseGraph<Se2, 3> {
    let recipe = Recipe { seed: 7, poses, measurement_sigma: 0.01, start_sigma: 0.1 };
    let (mut graph, truth) = make::<Se2, 3>(recipe);
    let mut rng = seeded(8);
    let mut state = 12345_usize;
    let mut next = || {
        state =
            state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (state >> 33) % poses
    };
    for _ in 0..extra {
        let (i, j) = (next(), next());
        if i != j {
            let added = edge(&mut rng, &truth, (i, j), 0.01);
            graph.edges.push(added);
        }
    }
    graph
}

fn solve(
    graph: &mut PoseGraph<Se2, 3>,
    optimizer: optimizer::Options,
) -> Result<Termination, SolveError> {
    let options = Options { optimizer };
    pose_graph::solve(graph, &options, &mut ignore_iterations).map(|summary| summary.termination)
}

#[test]
fn a_graph_with_large_fill_is_refused_before_it_is_begun() {
    let mut graph = random_graph(3000, 9000);
    let mut within = |bytes: u64| {
        let ceiling = Ceiling { bytes: Some(bytes), ..Ceiling::NONE };
        let options = optimizer::Options { ceiling, ..optimizer::Options::default() };
        solve(&mut graph, options)
    };
    let refused = within(0);
    let Err(SolveError::TooExpensive(TooExpensive { estimate, .. })) = refused else {
        panic!("{refused:?}")
    };
    let half = TooExpensive { resource: Resource::Bytes, estimate, limit: estimate / 2 };
    assert_eq!(within(estimate / 2), Err(half.into()));
}

#[test]
fn time_that_is_over_leaves_the_start() {
    let mut graph = random_graph(3000, 9000);
    let before = graph.poses.clone();
    let options =
        optimizer::Options { deadline: Some(Duration::ZERO), ..optimizer::Options::default() };
    assert_eq!(solve(&mut graph, options), Ok(Termination::Deadline));
    assert!(before.iter().zip(&graph.poses).all(|(a, b)| a.log() == b.log()));
}

#[test]
fn views_that_only_hold_a_landmark_make_no_pairs() {
    let mut problem = BundleProblem::default();
    let zero = [0.0; 5];
    let [k1, k2, k3, p1, p2] = zero;
    let lens =
        PinholeRadialTangential { fx: 500.0, fy: 500.0, cx: 0.0, cy: 0.0, k1, k2, k3, p1, p2 };
    problem.push_camera(Camera::Pinhole(lens), true);
    problem.push_landmark(Vector3::new(0.0, 0.0, 5.0));
    for pose in 0..100 {
        problem.push_pose(Se3::identity());
        let seen = Reprojection { pixel: Vector2::zeros(), sigma_px: 1.0, depth_m: None };
        problem.push_observation(pose, 0, 0, seen);
    }
    let all_free = bundle_adjustment::price_bound(&problem);
    problem.constant_poses[2..].fill(true);
    let two_free = bundle_adjustment::price_bound(&problem);
    assert!(two_free.flops_per_iteration < 0.05 * all_free.flops_per_iteration);
    // Intrinsics that are free tie all of them again.
    problem.constant_cameras.fill(false);
    let tied = bundle_adjustment::price_bound(&problem);
    assert!(tied.flops_per_iteration > 20.0 * two_free.flops_per_iteration);
}
