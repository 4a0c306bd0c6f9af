//! Priors in pose graphs: Jacobians, optimum and gauge, losses of single factors, refusals.

use covis_solvers::evaluation::pose_graph_cost;
use covis_solvers::factors::{PosePrior, PositionPrior};
use covis_solvers::geometry::{LieGroup, RigidMotion, Se2, Se3, Sim3};
use covis_solvers::information::Information;
use covis_solvers::initialization::align_to_priors;
use covis_solvers::loss::Loss;
use covis_solvers::optimizer::ignore_iterations;
use covis_solvers::pose_graph::{Options, position_covariances, solve, undetermined};
use covis_solvers::problem::{PoseGraph, SolveError};
use covis_solvers::testing::assert_jacobian;
use covis_solvers::testing::random::{element, normal_vector, seeded, uniform_vector};
use nalgebra::Vector3;

use super::graphs::{Recipe, distance, information, make, optimize};

const RECIPE: Recipe = Recipe { seed: 21, poses: 40, measurement_sigma: 0.0, start_sigma: 0.1 };

/// A prior that `truth` meets exactly; in the plane the lever arm lies in it.
fn fix<G: LieGroup<N>, const N: usize>(
    truth: &[G],
    pose: usize,
    arm: Vector3<f64>,
) -> PositionPrior {
    PositionPrior {
        pose,
        position_in_world: truth[pose].act(&arm),
        point_in_camera: arm,
        information: information(&mut seeded(pose as u64)),
        loss: Loss::Trivial,
    }
}

fn whole<G: LieGroup<N>, const N: usize>(truth: &[G], pose: usize) -> PosePrior<G, N> {
    let information = information(&mut seeded(pose as u64));
    PosePrior { pose, world_from_camera: truth[pose], information, loss: Loss::Trivial }
}

fn sweep<G: LieGroup<N>, const N: usize>(seed: u64) {
    let mut rng = seeded(seed);
    for size in [0.0, 1e-6, 0.1, 1.0, 30.0] {
        for _ in 0..20 {
            let pose: G = element(&mut rng, 0.8);
            let prior = PositionPrior {
                pose: 0,
                position_in_world: normal_vector(&mut rng, 5.0),
                point_in_camera: uniform_vector(&mut rng, size),
                information: Information::identity(),
                loss: Loss::Trivial,
            };
            let (residual, d_pose) = prior.linearize(&pose);
            assert_eq!(residual, prior.residual(&pose));
            assert_jacobian("position", |d| prior.residual(&pose.plus(d)), &d_pose, 1e-7);
            let error = uniform_vector(&mut rng, size.min(1.0));
            let measured = pose.plus(&error);
            let prior = PosePrior {
                pose: 0,
                world_from_camera: measured,
                information: Information::<N>::identity(),
                loss: Loss::Trivial,
            };
            let (residual, d_pose) = prior.linearize(&pose);
            assert!((residual + error).norm() < 1e-9);
            assert_jacobian("pose", |d| prior.linearize(&pose.plus(d)).0, &d_pose, 1e-7);
        }
    }
}

#[test]
fn the_jacobians_of_priors_with_a_lever_arm_are_exact() {
    sweep::<Se2, 3>(1);
    sweep::<Se3, 6>(2);
    sweep::<Sim3, 7>(3);
}

/// A graph without a held pose whose priors and edges agree with `truth`.
fn with_fixes<G: LieGroup<N>, const N: usize>(height: f64) -> (PoseGraph<G, N>, Vec<G>) {
    let (mut graph, truth) = make::<G, N>(RECIPE);
    graph.constant[0] = false;
    let arm = Vector3::new(0.3, -0.2, height);
    graph.position_priors = [2, 17, 30, 39].map(|pose| fix(&truth, pose, arm)).to_vec();
    graph.poses[0] = truth[0].plus(&normal_vector(&mut seeded(5), 0.1));
    (graph, truth)
}

#[test]
fn three_positions_determine_a_graph_without_a_held_pose() {
    let (mut graph, truth) = with_fixes::<Se3, 6>(1.1);
    assert!(graph.is_rigid() && undetermined(&graph).unwrap().is_empty());
    let summary = optimize(&mut graph);
    assert!(summary.termination.is_converged());
    assert!(!graph.constant.contains(&true));
    assert!(distance(&graph.poses, &truth) < 1e-6, "{}", distance(&graph.poses, &truth));
    let (mut graph, truth) = with_fixes::<Se2, 3>(0.0);
    optimize(&mut graph);
    assert!(distance(&graph.poses, &truth) < 1e-6);
}

#[test]
fn one_pose_prior_determines_a_graph() {
    let (mut graph, truth) = make::<Se3, 6>(RECIPE);
    graph.constant[0] = false;
    graph.pose_priors.push(whole(&truth, 9));
    assert!(graph.is_rigid());
    optimize(&mut graph);
    assert!(distance(&graph.poses, &truth) < 1e-6);
}

#[test]
fn what_positions_leave_open_is_named_and_stays() {
    let (mut graph, _) = with_fixes::<Se3, 6>(0.0);
    graph.position_priors.truncate(1);
    assert!(!graph.is_rigid());
    let open = undetermined(&graph).unwrap();
    assert_eq!(open.len(), graph.poses.len());
    // Around the one fix the graph may turn: three directions.
    assert!(open.iter().all(|pose| pose.directions.len() == 3), "{open:?}");
    let summary = optimize(&mut graph);
    assert!(summary.termination.is_converged());
    assert!(graph.position_priors[0].chi2(&graph.poses[2]) < 1e-9);
    assert!(pose_graph_cost(&graph).total < 1e-9);
}

#[test]
fn a_prior_ties_a_piece_to_the_world() {
    let (mut graph, truth) = with_fixes::<Se3, 6>(0.5);
    graph.edges.retain(|edge| (edge.i < 20) == (edge.j < 20));
    // The first piece has two fixes and a pose, the second two fixes and a pose.
    graph.pose_priors = vec![whole(&truth, 5), whole(&truth, 25)];
    optimize(&mut graph);
    assert!(distance(&graph.poses, &truth) < 1e-6);
    graph.pose_priors.clear();
    graph.position_priors.retain(|prior| prior.pose < 20);
    let error = solve(&mut graph, &Options::default(), &mut ignore_iterations).unwrap_err();
    assert!(matches!(error, SolveError::Disconnected { .. }), "{error}");
}

#[test]
fn the_evaluator_agrees_with_the_solver_about_priors_and_their_losses() {
    let (mut graph, truth) = with_fixes::<Se3, 6>(0.7);
    graph.pose_priors = vec![whole(&truth, 5)];
    let losses = [Loss::Huber(0.1), Loss::Cauchy(0.2), Loss::GemanMcClure(0.3), Loss::Tukey(4.0)];
    for (prior, loss) in graph.position_priors.iter_mut().zip(losses) {
        prior.loss = loss;
        prior.position_in_world.x += 0.5;
    }
    graph.pose_priors[0].loss = Loss::Huber(0.05);
    graph.edges[3].loss = Some(Loss::Cauchy(0.01));
    graph.loss = Loss::Huber(0.5);
    let before = pose_graph_cost(&graph);
    let summary = optimize(&mut graph);
    let after = pose_graph_cost(&graph);
    assert!((before.total / summary.initial_cost - 1.0).abs() < 1e-9);
    assert!((after.total / summary.final_cost - 1.0).abs() < 1e-9);
    assert!(after.total < before.total);
    assert_eq!((after.position_prior.count, after.pose_prior.count), (4, 1));
    // A stationary point: moving any pose by a little gains nothing.
    for pose in 0..graph.poses.len() {
        for axis in 0..6 {
            for sign in [-1.0, 1.0] {
                let mut moved = graph.clone();
                let mut step = nalgebra::SVector::<f64, 6>::zeros();
                step[axis] = sign * 1e-3;
                moved.poses[pose] = moved.poses[pose].plus(&step);
                assert!(pose_graph_cost(&moved).total > after.total);
            }
        }
    }
}

#[test]
fn the_loss_of_one_edge_replaces_that_of_the_graph() {
    let (mut graph, truth) = make::<Se3, 6>(RECIPE);
    let wrong = graph.edges[8].i_from_j.plus(&nalgebra::SVector::repeat(0.5));
    let edge = covis_solvers::factors::RelativePose { i_from_j: wrong, ..graph.edges[8] };
    graph.edges.push(edge);
    let mut plain = graph.clone();
    optimize(&mut plain);
    graph.edges.last_mut().unwrap().loss = Some(Loss::Tukey(1e-3));
    optimize(&mut graph);
    assert!(distance(&graph.poses, &truth) < 1e-4);
    assert!(distance(&plain.poses, &truth) > 1e-2);
}

#[test]
fn priors_that_cannot_be_solved_are_named() {
    let (good, truth) = with_fixes::<Se3, 6>(0.0);
    let error = |change: &dyn Fn(&mut PoseGraph<Se3, 6>)| {
        let mut graph = good.clone();
        change(&mut graph);
        solve(&mut graph, &Options::default(), &mut ignore_iterations).unwrap_err().to_string()
    };
    let range = error(&|graph| graph.position_priors[1].pose = 99);
    assert_eq!(range, "position prior 1: pose 99 does not exist (there are 40)");
    let finite = error(&|graph| graph.position_priors[2].point_in_camera.y = f64::NAN);
    assert_eq!(finite, "position prior 2 is not finite");
    let width = error(&|graph| graph.position_priors[0].loss = Loss::Huber(-1.0));
    assert_eq!(width, "position prior 0: the width of its loss must be finite and positive");
    let edge = error(&|graph| graph.edges[7].loss = Some(Loss::Tukey(0.0)));
    assert_eq!(edge, "edge 7: the width of its loss must be finite and positive");
    let pose = error(&|graph| {
        let mut prior = whole(&truth, 3);
        prior.world_from_camera.translation.z = f64::INFINITY;
        graph.pose_priors.push(prior);
    });
    assert_eq!(pose, "pose prior 0 is not finite");
}

#[test]
fn a_lone_pose_with_a_prior_is_a_graph() {
    let mut graph = PoseGraph::<Se3, 6>::new();
    graph.push_pose(7, Se3::identity());
    let target = Se3::exp(&nalgebra::Vector6::new(1.0, 2.0, 3.0, 0.1, 0.2, 0.3));
    graph.pose_priors.push(whole(&[target], 0));
    optimize(&mut graph);
    assert!(distance(&graph.poses, &[target]) < 1e-9);
}

fn aligned<G: RigidMotion<D, N>, const D: usize, const N: usize>(seed: u64, height: f64) {
    let (mut graph, truth) = with_fixes::<G, N>(height);
    graph.poses.clone_from(&truth);
    let more = [4, 8, 12, 20, 25, 33];
    let arm = Vector3::new(-0.1, 0.4, height);
    graph.position_priors.extend(more.map(|pose| fix(&truth, pose, arm)));
    // Two of ten are false.
    graph.position_priors[4].position_in_world.x += 20.0;
    graph.position_priors[7].position_in_world.y -= 30.0;
    let own: G = element(&mut seeded(seed), 3.0);
    for pose in &mut graph.poses {
        *pose = own.compose(pose);
    }
    assert!(align_to_priors(&mut graph));
    assert!(distance(&graph.poses, &truth) < 1e-2, "{}", distance(&graph.poses, &truth));
    let before = graph.poses.clone();
    align_to_priors(&mut graph);
    assert!(distance(&graph.poses, &before) < 1e-2);
}

#[test]
fn a_graph_in_a_frame_of_its_own_is_brought_to_its_fixes() {
    for seed in 0..8 {
        aligned::<Se3, 3, 6>(seed, 0.8);
        aligned::<Se2, 2, 3>(seed, 0.0);
    }
}

#[test]
fn covariances_of_points_are_those_of_the_dense_inverse() {
    let (graph, _) = with_fixes::<Se3, 6>(0.4);
    let counts = [true, false, true, true];
    let found = position_covariances(&graph, &counts, &Default::default()).unwrap();
    let poses = graph.poses.len();
    let mut h = nalgebra::DMatrix::<f64>::zeros(6 * poses, 6 * poses);
    for edge in &graph.edges {
        let pair = edge.linearize(&graph.poses[edge.i], &graph.poses[edge.j]);
        let sides = [(edge.i, pair.d_i), (edge.j, pair.d_j)];
        for (a, d_a) in &sides {
            for (b, d_b) in &sides {
                let mut block = h.fixed_view_mut::<6, 6>(6 * a, 6 * b);
                block += d_a.transpose() * edge.information.matrix() * d_b;
            }
        }
    }
    for (prior, _) in graph.position_priors.iter().zip(counts).filter(|(_, counts)| *counts) {
        let (_, d) = prior.linearize(&graph.poses[prior.pose]);
        let mut block = h.fixed_view_mut::<6, 6>(6 * prior.pose, 6 * prior.pose);
        block += d.transpose() * prior.information.matrix() * d;
    }
    let inverse = h.try_inverse().unwrap();
    for (prior, found) in graph.position_priors.iter().zip(found) {
        let (_, d) = prior.linearize(&graph.poses[prior.pose]);
        let block = inverse.fixed_view::<6, 6>(6 * prior.pose, 6 * prior.pose);
        let expected = d * block * d.transpose();
        let found = found.unwrap();
        assert!((found - expected).norm() < 1e-6 * expected.norm(), "{found} {expected}");
    }
}

#[test]
fn one_fix_shifts_a_graph_and_two_turn_it_as_little_as_they_must() {
    let (graph, truth) = with_fixes::<Se3, 6>(0.8);
    for count in [1, 2] {
        let mut graph = graph.clone();
        graph.position_priors.truncate(count);
        let own: Se3 = element(&mut seeded(4), 3.0);
        graph.poses = truth.iter().map(|pose| own.compose(pose)).collect();
        assert!(align_to_priors(&mut graph));
        let met = |prior: &PositionPrior| prior.chi2(&graph.poses[prior.pose]) < 1e-9;
        assert!(graph.position_priors.iter().all(met));
        let turn = |k: usize| graph.poses[k].rotation.minus(&own.compose(&truth[k]).rotation);
        assert_eq!(turn(0).norm() < 1e-9, count == 1);
        // The shape is as it was.
        let apart = |a: &[Se3]| a[0].inverse().compose(&a[39]);
        assert!(apart(&graph.poses).minus(&apart(&truth)).norm() < 1e-9);
    }
}
