//! What a solve must find, and what must not change it.

use covis_solvers::factors::RelativePose;
use covis_solvers::geometry::{LieGroup, Se2, Se3, Sim3, So2, So3};
use covis_solvers::information::Information;
use covis_solvers::loss::Loss;
use covis_solvers::optimizer::{Method, ignore_iterations};
use covis_solvers::pose_graph::solve;
use covis_solvers::problem::PoseGraph;
use covis_solvers::testing::random::{element, seeded};
use nalgebra::{Vector2, Vector3};
use rand::seq::SliceRandom;

use super::graphs::{Recipe, distance, make, optimize, tight};

const NOISELESS: Recipe = Recipe { seed: 1, poses: 60, measurement_sigma: 0.0, start_sigma: 0.1 };
const NOISY: Recipe = Recipe { seed: 2, poses: 80, measurement_sigma: 0.05, start_sigma: 0.1 };

fn recovers_truth<G: LieGroup<N>, const N: usize>() {
    let (mut graph, truth) = make::<G, N>(NOISELESS);
    let summary = optimize(&mut graph);
    assert!(summary.termination.is_converged(), "{}", summary.termination);
    assert!(summary.initial_cost > 10.0 && summary.final_cost < 1e-20, "{summary:?}");
    assert!(distance(&graph.poses, &truth) < 1e-9);
}

#[test]
fn noiseless_measurements_give_the_truth_back() {
    recovers_truth::<Se2, 3>();
    recovers_truth::<Se3, 6>();
    recovers_truth::<Sim3, 7>();
}

fn methods_agree<G: LieGroup<N>, const N: usize>() {
    let (mut by_lm, _) = make::<G, N>(NOISY);
    let mut by_gn = by_lm.clone();
    let lm = optimize(&mut by_lm);
    let mut options = tight();
    options.optimizer.method = Method::GaussNewton;
    let gn = solve(&mut by_gn, &options, &mut ignore_iterations).unwrap();
    assert!(gn.termination.is_converged() && lm.termination.is_converged());
    assert!(lm.final_cost > 1e-3);
    assert!((gn.final_cost / lm.final_cost - 1.0).abs() < 1e-10);
    assert!(distance(&by_gn.poses, &by_lm.poses) < 1e-5);
    assert!(gn.iterations.iter().all(|row| row.damping == 0.0));
}

#[test]
fn gauss_newton_and_levenberg_marquardt_find_the_same_optimum() {
    methods_agree::<Se2, 3>();
    methods_agree::<Se3, 6>();
    methods_agree::<Sim3, 7>();
}

#[test]
fn the_order_of_poses_and_edges_does_not_matter() {
    let (mut graph, _) = make::<Se3, 6>(NOISY);
    let mut order: Vec<usize> = (0..graph.poses.len()).collect();
    let mut rng = seeded(7);
    order.shuffle(&mut rng);
    let mut shuffled = PoseGraph::new();
    let mut index_of = vec![0; order.len()];
    for &k in &order {
        index_of[k] = shuffled.push_pose(graph.ids[k], graph.poses[k]);
        shuffled.constant[index_of[k]] = graph.constant[k];
    }
    shuffled.edges = graph.edges.clone();
    for edge in &mut shuffled.edges {
        (edge.i, edge.j) = (index_of[edge.i], index_of[edge.j]);
    }
    shuffled.edges.shuffle(&mut rng);
    let (a, b) = (optimize(&mut graph), optimize(&mut shuffled));
    assert!((a.final_cost / b.final_cost - 1.0).abs() < 1e-11);
    let back: Vec<Se3> = index_of.iter().map(|&k| shuffled.poses[k]).collect();
    assert!(distance(&graph.poses, &back) < 1e-5);
}

#[test]
fn moving_the_world_moves_the_result_and_keeps_the_cost() {
    let (mut graph, _) = make::<Se3, 6>(NOISY);
    let moved_from_world: Se3 = element(&mut seeded(8), 2.0);
    let mut moved = graph.clone();
    for pose in &mut moved.poses {
        *pose = moved_from_world.compose(pose);
    }
    let (a, b) = (optimize(&mut graph), optimize(&mut moved));
    assert!((a.initial_cost / b.initial_cost - 1.0).abs() < 1e-11);
    assert!((a.final_cost / b.final_cost - 1.0).abs() < 1e-11);
    let expected: Vec<Se3> = graph.poses.iter().map(|p| moved_from_world.compose(p)).collect();
    assert!(distance(&moved.poses, &expected) < 1e-5);
}

#[test]
fn the_number_of_threads_does_not_change_a_bit() {
    let recipe = Recipe { poses: 700, ..NOISY };
    let run = |threads: usize| {
        let (mut graph, _) = make::<Se3, 6>(recipe);
        graph.loss = Loss::Huber(2.0);
        let mut options = tight();
        options.optimizer.threads = Some(threads);
        let summary = solve(&mut graph, &options, &mut ignore_iterations).unwrap();
        assert_eq!(summary.threads, threads);
        let bits: Vec<u64> = graph
            .poses
            .iter()
            .flat_map(|pose| {
                let q = pose.rotation.quaternion().coords;
                let t = pose.translation;
                [q.x, q.y, q.z, q.w, t.x, t.y, t.z].map(f64::to_bits)
            })
            .chain(summary.iterations.iter().map(|row| row.cost.to_bits()))
            .collect();
        bits
    };
    let one = run(1);
    assert_eq!(one, run(2));
    assert_eq!(one, run(4));
}

#[test]
fn an_edge_given_twice_counts_double() {
    let (mut twice, _) = make::<Se2, 3>(NOISY);
    let mut doubled = twice.clone();
    for k in [0, 5, 17] {
        let edge = twice.edges[k];
        twice.edges.push(edge);
        let information = Information::new(&(edge.information.matrix() * 2.0)).unwrap();
        doubled.edges[k] = RelativePose { information, ..edge };
    }
    let (a, b) = (optimize(&mut twice), optimize(&mut doubled));
    assert!((a.final_cost / b.final_cost - 1.0).abs() < 1e-10);
    assert!(distance(&twice.poses, &doubled.poses) < 1e-5);
}

#[test]
fn an_edge_of_a_pose_with_itself_adds_only_its_cost() {
    let (mut plain, _) = make::<Se2, 3>(NOISY);
    let mut with_self = plain.clone();
    let edge = with_self.edges[3];
    with_self.edges.push(RelativePose { i: 9, j: 9, ..edge });
    let constant = 0.5 * edge.information.squared_norm(&edge.i_from_j.inverse().log());
    let (a, b) = (optimize(&mut plain), optimize(&mut with_self));
    assert!((a.final_cost + constant - b.final_cost).abs() < 1e-9 * b.final_cost);
    assert!(distance(&plain.poses, &with_self.poses) < 1e-4);
}

#[test]
fn half_turns_are_measured_and_reached() {
    let half_turn = Se2::new(So2::from_angle(std::f64::consts::PI), Vector2::new(1.0, 2.0));
    let mut graph = PoseGraph::<Se2, 3>::new();
    let (i, j) = (graph.push_pose(0, Se2::identity()), graph.push_pose(1, Se2::identity()));
    let information = Information::identity();
    graph.edges.push(RelativePose { i, j, i_from_j: half_turn, information, loss: None });
    assert!(optimize(&mut graph).final_cost < 1e-20);
    assert!(graph.poses[1].minus(&half_turn).norm() < 1e-9);

    for axis in [Vector3::x(), Vector3::y(), Vector3::new(0.6, 0.0, -0.8)] {
        let rotation = So3::exp(&(axis * std::f64::consts::PI));
        let half_turn = Se3::new(rotation, Vector3::new(1.0, -2.0, 0.5));
        let mut graph = PoseGraph::<Se3, 6>::new();
        let (i, j) = (graph.push_pose(0, Se3::identity()), graph.push_pose(1, Se3::identity()));
        let information = Information::identity();
        graph.edges.push(RelativePose { i, j, i_from_j: half_turn, information, loss: None });
        let summary = optimize(&mut graph);
        assert!(summary.final_cost < 1e-20, "{axis}: {summary:?}");
        assert!(graph.poses[1].minus(&half_turn).norm() < 1e-9);
    }
}

#[test]
fn robust_losses_lower_the_influence_of_a_wrong_closure() {
    let error = |loss: Loss| {
        let recipe = Recipe { measurement_sigma: 0.01, start_sigma: 0.02, ..NOISY };
        let (mut graph, truth) = make::<Se2, 3>(recipe);
        let right = truth[5].inverse().compose(&truth[70]);
        let wrong = right.compose(&Se2::from_xy_angle(3.0, -2.0, 0.7));
        graph.edges.push(RelativePose { i: 5, j: 70, i_from_j: wrong, ..graph.edges[0] });
        graph.loss = loss;
        let summary = optimize(&mut graph);
        assert!(summary.termination.is_converged(), "{loss:?}: {}", summary.termination);
        distance(&graph.poses, &truth)
    };
    let plain = error(Loss::Trivial);
    let huber = error(Loss::Huber(0.5));
    let cauchy = error(Loss::Cauchy(0.5));
    let geman_mcclure = error(Loss::GemanMcClure(1.0));
    assert!(huber < 0.5 * plain, "{huber} {plain}");
    assert!(cauchy < 0.1 * plain, "{cauchy} {plain}");
    assert!(geman_mcclure < 0.1 * plain, "{geman_mcclure} {plain}");
}
