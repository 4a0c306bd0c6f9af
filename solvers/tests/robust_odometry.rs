//! Closures that only the odometry can judge: a true one pulls, a false one bends nothing, and one that
//! is held back counts as soon as another agrees with it.

use covis_solvers::factors::RelativePose;
use covis_solvers::geometry::{LieGroup, Se3};
use covis_solvers::information::Information;
use covis_solvers::initialization::Start;
use covis_solvers::interrupt::Interrupt;
use covis_solvers::optimizer::ignore_iterations;
use covis_solvers::pose_graph::Options;
use covis_solvers::problem::PoseGraph;
use covis_solvers::robust::{Judging, Kernel, RobustSummary, solve};
use nalgebra::Vector6;

const KERNELS: [Kernel; 2] = [Kernel::TruncatedLeastSquares, Kernel::GemanMcClure];

fn information(sigma: f64) -> Information<6> {
    Information::from_sigmas(&Vector6::repeat(sigma)).unwrap()
}

/// Two laps of 30 poses over a circle, measured step by step where they are.
fn map() -> PoseGraph<Se3, 6> {
    let turn = std::f64::consts::TAU / 30.0;
    let step = Vector6::new(1.0, 0.0, 0.0, 0.0, 0.0, turn);
    let mut graph = PoseGraph::new();
    let mut pose = Se3::identity();
    for id in 0..60 {
        graph.push_pose(id, pose);
        pose = pose.plus(&step);
    }
    for i in 0..59 {
        let i_from_j = graph.poses[i].inverse().compose(&graph.poses[i + 1]);
        graph.edges.push(RelativePose {
            i,
            j: i + 1,
            i_from_j,
            information: information(0.02),
            loss: None,
        });
    }
    graph
}

/// Adds a closure that is off by `error` in x of pose j; returns its edge.
fn close(graph: &mut PoseGraph<Se3, 6>, i: usize, j: usize, error: f64) -> usize {
    let off = Vector6::new(error, 0.0, 0.0, 0.0, 0.0, 0.0);
    let i_from_j = graph.poses[i].inverse().compose(&graph.poses[j].plus(&off));
    graph.edges.push(RelativePose { i, j, i_from_j, information: information(0.01), loss: None });
    graph.edges.len() - 1
}

fn off(summary: &RobustSummary) -> Vec<usize> {
    let off = summary.closures.iter().filter(|verdict| verdict.is_switched_off);
    off.map(|verdict| verdict.edge).collect()
}

fn solve_from(start: Start, graph: &mut PoseGraph<Se3, 6>, kernel: Kernel) -> RobustSummary {
    let judging = Judging { trust_odometry: true, ..Judging::new(kernel) };
    let (options, interrupt) = (Options::default(), &Interrupt::NEVER);
    solve(graph, start, true, &judging, &options, interrupt, &mut ignore_iterations).unwrap()
}

fn run(graph: &mut PoseGraph<Se3, 6>, kernel: Kernel) -> RobustSummary {
    let summary = solve_from(Start::Auto, graph, kernel);
    assert!(summary.solve.termination.is_converged(), "{summary:?}");
    summary
}

/// The largest motion of a pose.
fn bent(a: &PoseGraph<Se3, 6>, b: &PoseGraph<Se3, 6>) -> f64 {
    let pairs = a.poses.iter().zip(&b.poses);
    pairs.map(|(a, b)| a.minus(b).norm()).fold(0.0, f64::max)
}

#[test]
fn a_true_closure_that_the_odometry_explains_pulls() {
    for kernel in KERNELS {
        let mut graph = map();
        let drifted = graph.clone();
        // Of 30 steps with σ = 0.02 m and rad each.
        close(&mut graph, 5, 35, 0.3);
        let summary = run(&mut graph, kernel);
        assert!(off(&summary).is_empty(), "{summary:?}");
        assert!(bent(&graph, &drifted) > 0.2);
    }
}

#[test]
fn a_lone_closure_that_the_odometry_does_not_explain_bends_nothing_and_is_provisional() {
    for kernel in KERNELS {
        for error in [6.0, -15.0] {
            let mut graph = map();
            let edge = close(&mut graph, 5, 12, error);
            let before = graph.clone();
            let summary = run(&mut graph, kernel);
            assert_eq!(off(&summary), [edge], "{kernel:?} {error}");
            assert!(summary.closures[0].is_provisional && summary.closures[0].chi2 > 1000.0);
            if kernel == Kernel::TruncatedLeastSquares {
                assert_eq!(summary.closures[0].weight, 0.0);
                assert!(bent(&graph, &before) < 1e-9, "{}", bent(&graph, &before));
            }
        }
    }
}

#[test]
fn a_second_look_that_agrees_frees_what_was_held_back() {
    let mut graph = map();
    close(&mut graph, 5, 12, 3.0);
    close(&mut graph, 6, 13, 3.0);
    let summary = run(&mut graph, Kernel::TruncatedLeastSquares);
    // A step of odometry turns what the two measure against each other by 12 degrees.
    assert!(summary.closures.iter().all(|verdict| !verdict.is_provisional), "{summary:?}");
}

#[test]
fn a_lone_closure_counts_where_others_bring_the_trajectory_to_it() {
    let mut graph = map();
    // A lap that others close, off by more than the odometry explains; a lone one between its halves.
    for i in 0..8 {
        close(&mut graph, i, i + 30, 1.5);
    }
    let mut closed = graph.clone();
    run(&mut closed, Kernel::TruncatedLeastSquares);
    let i_from_j = closed.poses[15].inverse().compose(&closed.poses[50]);
    graph.edges.push(RelativePose {
        i: 15,
        j: 50,
        i_from_j,
        information: information(0.01),
        loss: None,
    });
    let summary = run(&mut graph, Kernel::TruncatedLeastSquares);
    let lone = summary.closures.last().unwrap();
    assert!(!lone.is_supported && !lone.is_switched_off, "{lone:?}");
}

#[test]
fn a_false_closure_among_true_ones_is_the_one_that_goes() {
    for kernel in KERNELS {
        let mut graph = map();
        for i in 0..10 {
            close(&mut graph, i, i + 30, 0.0);
        }
        let before = graph.clone();
        let edge = close(&mut graph, 3, 20, 8.0);
        let summary = run(&mut graph, kernel);
        assert_eq!(off(&summary), [edge], "{kernel:?}");
        assert!(bent(&graph, &before) < 0.05, "{}", bent(&graph, &before));
    }
}

#[test]
fn verdicts_do_not_depend_on_where_the_poses_are() {
    let mut graph = map();
    for i in 0..6 {
        close(&mut graph, i, i + 30, 0.2);
    }
    close(&mut graph, 3, 20, 8.0);
    let mut moved = graph.clone();
    for (k, pose) in moved.poses.iter_mut().enumerate().skip(1) {
        *pose = pose.plus(&Vector6::repeat(0.01 * k as f64));
    }
    let kernel = Kernel::TruncatedLeastSquares;
    let [a, b] =
        [&mut graph, &mut moved].map(|graph| solve_from(Start::Odometry, graph, kernel).closures);
    assert_eq!(a, b);
}
