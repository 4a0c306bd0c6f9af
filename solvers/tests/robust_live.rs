//! One closure more in a solved map: a true one pulls, a false one bends nothing, and a verdict may
//! be taken back.

use covis_solvers::factors::RelativePose;
use covis_solvers::geometry::{LieGroup, Se3};
use covis_solvers::information::Information;
use covis_solvers::optimizer::{Control, Termination, ignore_iterations};
use covis_solvers::problem::PoseGraph;
use covis_solvers::robust::{Kernel, Options, RobustSummary, update};
use nalgebra::Vector6;

const KERNELS: [Kernel; 2] = [Kernel::TruncatedLeastSquares, Kernel::GemanMcClure];

fn information(sigma: f64) -> Information<6> {
    Information::from_sigmas(&Vector6::repeat(sigma)).unwrap()
}

/// Two laps of 30 poses over a circle, tied step by step where they are.
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

fn run(graph: &mut PoseGraph<Se3, 6>, before: &[usize], kernel: Kernel) -> RobustSummary {
    let summary = update(graph, before, &Options::new(kernel), &mut ignore_iterations).unwrap();
    assert!(summary.solve.termination.is_converged(), "{summary:?}");
    summary
}

/// The largest motion of a pose.
fn bent(a: &PoseGraph<Se3, 6>, b: &PoseGraph<Se3, 6>) -> f64 {
    let pairs = a.poses.iter().zip(&b.poses);
    pairs.map(|(a, b)| a.minus(b).norm()).fold(0.0, f64::max)
}

#[test]
fn a_true_closure_pulls_and_costs_one_solve() {
    for kernel in KERNELS {
        let mut graph = map();
        let drifted = graph.clone();
        // Drift of 1 % of the way: twice what the odometry's noise explains, a little at each step.
        let edge = close(&mut graph, 5, 35, 0.3);
        let summary = run(&mut graph, &[], kernel);
        assert_eq!((off(&summary), summary.solves), (vec![], 1));
        assert!(summary.closures[0].chi2 < 16.8);
        assert!(bent(&graph, &drifted) > 0.2);
        assert_eq!(summary.closures[0].edge, edge);
    }
}

#[test]
fn a_lone_false_closure_bends_nothing() {
    for kernel in KERNELS {
        for error in [6.0, -15.0] {
            let mut graph = map();
            let edge = close(&mut graph, 5, 12, error);
            let before = graph.clone();
            let summary = run(&mut graph, &[], kernel);
            assert_eq!(off(&summary), [edge], "{kernel:?} {error}");
            assert!(summary.closures[0].chi2 > 1000.0);
            if kernel == Kernel::TruncatedLeastSquares {
                assert_eq!(summary.closures[0].weight, 0.0);
                assert!(bent(&graph, &before) < 1e-9, "{}", bent(&graph, &before));
            }
        }
    }
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
        let summary = run(&mut graph, &[], kernel);
        assert_eq!(off(&summary), [edge], "{kernel:?}");
        assert!(bent(&graph, &before) < 0.05, "{}", bent(&graph, &before));
        // Left out from the start, it costs nothing later, and new closures are judged without it.
        close(&mut graph, 12, 42, 0.1);
        let summary = run(&mut graph, &[edge], kernel);
        assert_eq!((off(&summary), summary.solves), (vec![edge], 1), "{kernel:?}");
    }
}

#[test]
fn a_verdict_is_taken_back_where_the_closure_fits_after_all() {
    let mut graph = map();
    let edge = close(&mut graph, 5, 35, 0.02);
    let summary = run(&mut graph, &[edge], Kernel::TruncatedLeastSquares);
    assert_eq!((off(&summary), summary.closures[0].weight), (vec![], 1.0));
    // Neighbors that support each other come back together, although the drift hides them.
    let mut graph = map();
    let edges: Vec<usize> = (5..9).map(|i| close(&mut graph, i, i + 30, 0.3)).collect();
    let summary = run(&mut graph, &edges, Kernel::TruncatedLeastSquares);
    assert!(off(&summary).is_empty(), "{:?}", summary.closures);
}

#[test]
fn a_canceled_update_ends_at_once() {
    let mut graph = map();
    close(&mut graph, 5, 12, 8.0);
    let mut rows = 0;
    let summary = update(&mut graph, &[], &Options::new(Kernel::GemanMcClure), &mut |_row| {
        rows += 1;
        Control::Cancel
    });
    assert_eq!(summary.unwrap().solve.termination, Termination::Cancelled);
    assert_eq!(rows, 1);
}
