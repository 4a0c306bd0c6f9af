//! Sim(3): a monocular loop whose scale drifts, closed by what was seen before.

use covis_solvers::factors::RelativePose;
use covis_solvers::geometry::{LieGroup, Sim3, So3};
use covis_solvers::information::Information;
use covis_solvers::initialization::spanning_tree;
use covis_solvers::optimizer::ignore_iterations;
use covis_solvers::pose_graph::{Options, solve};
use covis_solvers::problem::PoseGraph;
use covis_solvers::testing::random::{normal_vector, seeded};
use nalgebra::{SMatrix, SVector, Vector3};

use super::graphs::{distance, optimize};

/// Keyframes on three laps of a circle of 10 m radius.
const KEYFRAMES: usize = 180;
const LAP: usize = 60;

/// What each odometry step gains in scale: 1.01^180 ≈ 6.
const DRIFT: f64 = 0.01;

fn truth() -> Vec<Sim3> {
    let pose = |k: usize| {
        let angle = std::f64::consts::TAU * k as f64 / LAP as f64;
        let position = Vector3::new(10.0 * angle.cos(), 10.0 * angle.sin(), 0.3 * angle);
        Sim3::new(So3::exp(&Vector3::new(0.0, 0.0, angle)), position, 1.0)
    };
    (0..KEYFRAMES).map(pose).collect()
}

fn information(sigmas: [f64; 7]) -> Information<7> {
    Information::from_sigmas(&SVector::from(sigmas)).unwrap()
}

/// Odometry whose scale drifts, then closures to the lap before, every `spacing` keyframes; poses
/// are the odometry strung together.
fn drifting_loop(spacing: usize) -> (PoseGraph<Sim3, 7>, Vec<Sim3>) {
    let (truth, mut rng) = (truth(), seeded(11));
    let mut graph = PoseGraph::new();
    let mut pose = truth[0];
    for k in 0..KEYFRAMES {
        if k > 0 {
            let mut error: SVector<f64, 7> = normal_vector(&mut rng, 1e-3);
            error[6] += DRIFT;
            let i_from_j = truth[k - 1].inverse().compose(&truth[k]).plus(&error);
            pose = pose.compose(&i_from_j);
            let information = information([0.02, 0.02, 0.02, 0.005, 0.005, 0.005, 0.01]);
            graph.edges.push(RelativePose { i: k - 1, j: k, i_from_j, information, loss: None });
        }
        graph.push_pose(k as i64, pose);
    }
    for k in (LAP..KEYFRAMES).step_by(spacing) {
        let i_from_j = truth[k - LAP].inverse().compose(&truth[k]);
        let information = information([1e-3; 7]);
        graph.edges.push(RelativePose { i: k - LAP, j: k, i_from_j, information, loss: None });
    }
    (graph, truth)
}

/// Root mean square of the positions' errors, m.
fn error(graph: &PoseGraph<Sim3, 7>, truth: &[Sim3]) -> f64 {
    let squared =
        graph.poses.iter().zip(truth).map(|(a, b)| (a.translation - b.translation).norm_squared());
    (squared.sum::<f64>() / truth.len() as f64).sqrt()
}

#[test]
fn closing_a_loop_takes_the_drift_of_scale_out() {
    let (mut graph, truth) = drifting_loop(1);
    let before = error(&graph, &truth);
    let summary = optimize(&mut graph);
    assert!(summary.termination.is_converged(), "{}", summary.termination);
    assert!(summary.iterations.len() <= 25, "{} steps", summary.iterations.len());
    let after = error(&graph, &truth);
    assert!(before > 10.0 && after < 0.05 * before, "{before} m before, {after} m after");
    let scales = graph.poses.iter().map(|pose| (pose.scale - 1.0).abs());
    assert!(scales.fold(0.0, f64::max) < 0.5, "started near 6");
}

#[test]
fn exact_closures_and_odometry_give_the_truth_back_from_any_scale() {
    let (mut graph, truth) = drifting_loop(7);
    for edge in &mut graph.edges {
        edge.i_from_j = truth[edge.i].inverse().compose(&truth[edge.j]);
    }
    let summary = optimize(&mut graph);
    assert!(summary.final_cost < 1e-18 * summary.initial_cost, "{summary:?}");
    assert!(distance(&graph.poses, &truth) < 1e-6);
    spanning_tree(&mut graph).unwrap();
    assert!(distance(&graph.poses, &truth) < 1e-9);
}

#[test]
fn the_minimum_is_one_by_the_gradient_and_by_its_neighbors() {
    let (mut graph, _) = drifting_loop(5);
    let summary = optimize(&mut graph);
    let cost = |graph: &PoseGraph<Sim3, 7>| {
        let of = |edge: &RelativePose<Sim3, 7>| {
            let residual = edge.residual(&graph.poses[edge.i], &graph.poses[edge.j]);
            0.5 * residual.dot(&(edge.information.matrix() * residual))
        };
        graph.edges.iter().map(of).sum::<f64>()
    };
    assert!((cost(&graph) / summary.final_cost - 1.0).abs() < 1e-12);
    for k in [1, 40, 90, 179] {
        for axis in 0..7 {
            for sign in [-1.0, 1.0] {
                let mut moved = graph.clone();
                let delta = SMatrix::from_fn(|row, _| if row == axis { sign * 1e-4 } else { 0.0 });
                moved.poses[k] = moved.poses[k].plus(&delta);
                assert!(cost(&moved) > cost(&graph), "pose {k}, axis {axis}");
            }
        }
    }
}

#[test]
fn the_number_of_threads_does_not_change_a_bit_of_similarities() {
    let run = |threads: usize| {
        let (mut graph, _) = drifting_loop(1);
        let mut options = Options::default();
        options.optimizer.threads = Some(threads);
        let summary = solve(&mut graph, &options, &mut ignore_iterations).unwrap();
        let numbers = graph.poses.iter().flat_map(|pose| {
            let q = pose.rotation.quaternion().coords;
            let t = pose.translation;
            [q.x, q.y, q.z, q.w, t.x, t.y, t.z, pose.scale].map(f64::to_bits)
        });
        numbers.chain([summary.final_cost.to_bits()]).collect::<Vec<u64>>()
    };
    let one = run(1);
    assert_eq!(one, run(2));
    assert_eq!(one, run(4));
}
