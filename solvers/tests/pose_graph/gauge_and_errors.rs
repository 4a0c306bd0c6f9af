//! Gauge, cancellation, and the problems that cannot be solved as posed.

use std::time::Duration;

use covis_solvers::factors::RelativePose;
use covis_solvers::geometry::{LieGroup, Se2, Se3};
use covis_solvers::loss::Loss;
use covis_solvers::optimizer::{Control, Method, Termination, ignore_iterations};
use covis_solvers::pose_graph::{Options, solve};
use covis_solvers::problem::{PoseGraph, SolveError};

use super::graphs::{Recipe, make, optimize};

const RECIPE: Recipe = Recipe { seed: 4, poses: 40, measurement_sigma: 0.05, start_sigma: 0.1 };

fn error_of(graph: &PoseGraph<Se2, 3>) -> SolveError {
    solve(&mut graph.clone(), &Options::default(), &mut ignore_iterations).unwrap_err()
}

#[test]
fn the_lowest_id_is_held_where_nothing_is_constant() {
    let (mut graph, _) = make::<Se3, 6>(RECIPE);
    graph.constant[0] = false;
    graph.ids[7] = -5;
    let before = graph.poses[7];
    let summary = optimize(&mut graph);
    assert!(summary.termination.is_converged());
    assert_eq!(graph.poses[7], before);
    let constant: Vec<usize> = (0..40).filter(|&k| graph.constant[k]).collect();
    assert_eq!(constant, [7]);
}

#[test]
fn constant_poses_stay_and_may_be_several() {
    let (mut graph, truth) = make::<Se2, 3>(RECIPE);
    for k in [13, 14, 30] {
        graph.constant[k] = true;
        graph.poses[k] = truth[k];
    }
    let summary = optimize(&mut graph);
    assert!(summary.termination.is_converged() && summary.final_cost < summary.initial_cost);
    for k in [0, 13, 14, 30] {
        assert_eq!(graph.poses[k], truth[k]);
    }
    graph.constant.fill(true);
    assert!(matches!(error_of(&graph), SolveError::Empty(_)));
}

#[test]
fn a_graph_in_pieces_is_refused_with_their_names() {
    let (mut graph, _) = make::<Se2, 3>(RECIPE);
    graph.edges.retain(|edge| (edge.i < 25) == (edge.j < 25));
    let lonely = graph.push_pose(-3, Se2::identity());
    assert_eq!(lonely, 40);
    let error = error_of(&graph);
    assert_eq!(
        error.to_string(),
        "the graph is in 3 pieces: vertex -3; 25 vertices from 10 to 82; 15 vertices from 85 to 127"
    );
    // Poses that are all constant hang together: each piece has its gauge.
    for k in [0, 25, 40] {
        graph.constant[k] = true;
    }
    assert!(optimize(&mut graph).termination.is_converged());
}

#[test]
fn errors_name_what_is_wrong() {
    let (graph, _) = make::<Se2, 3>(RECIPE);

    let mut bad = graph.clone();
    bad.poses[5].translation.x = f64::NAN;
    assert_eq!(error_of(&bad), SolveError::NotFinite { what: "pose", index: 25 });

    let mut bad = graph.clone();
    bad.edges[3].i_from_j.translation.y = f64::INFINITY;
    assert_eq!(error_of(&bad), SolveError::NotFinite { what: "edge", index: 3 });

    let mut bad = graph.clone();
    bad.poses[5].translation.x = 1e200;
    // Its square overflows in the edge from pose 4, the sixth.
    assert_eq!(error_of(&bad), SolveError::ResidualNotFinite { factor: "edge", index: 5 });

    let mut bad = graph.clone();
    bad.edges[2] = RelativePose { j: 99, ..bad.edges[2] };
    assert!(matches!(error_of(&bad), SolveError::IndexOutOfRange { index: 2, value: 99, .. }));

    let mut bad = graph.clone();
    bad.ids[4] = bad.ids[9];
    assert!(matches!(error_of(&bad), SolveError::DuplicateId { id: 37, .. }));

    let mut bad = graph.clone();
    bad.loss = Loss::Huber(-1.0);
    assert!(matches!(error_of(&bad), SolveError::InvalidOption { field: "loss", .. }));

    assert!(matches!(error_of(&PoseGraph::new()), SolveError::Empty(_)));
    let mut options = Options::default();
    options.optimizer.threads = Some(0);
    let error = solve(&mut graph.clone(), &options, &mut ignore_iterations).unwrap_err();
    assert!(matches!(error, SolveError::InvalidOption { field: "threads", .. }));
}

#[test]
fn the_observer_sees_every_row_and_may_cancel() {
    let (mut graph, _) = make::<Se3, 6>(RECIPE);
    let start = graph.poses.clone();
    let mut seen = Vec::new();
    let mut cancel_at_start = |row: &_| {
        seen.push(*row);
        Control::Cancel
    };
    let summary = solve(&mut graph, &Options::default(), &mut cancel_at_start).unwrap();
    assert_eq!(summary.termination, Termination::Cancelled);
    assert_eq!((seen.len(), summary.iterations.len()), (1, 1));
    assert_eq!(graph.poses, start);
    assert_eq!(summary.final_cost, summary.initial_cost);

    let mut options = Options::default();
    options.optimizer.deadline = Some(Duration::ZERO);
    let summary = solve(&mut graph, &options, &mut ignore_iterations).unwrap();
    assert_eq!(summary.termination, Termination::Deadline);

    options.optimizer.deadline = None;
    options.optimizer.max_iterations = 2;
    let summary = solve(&mut graph, &options, &mut ignore_iterations).unwrap();
    assert_eq!(summary.termination, Termination::MaxIterations);
    assert_eq!(summary.iterations.len(), 3);
}

#[test]
fn a_step_that_does_not_help_is_taken_back_to_the_bit() {
    let mut options = Options::default();
    options.optimizer.method = Method::GaussNewton;
    let mut stalled = 0;
    for seed in 0..20 {
        let (mut graph, _) = make::<Se3, 6>(Recipe { seed, start_sigma: 1.5, ..RECIPE });
        let start = graph.poses.clone();
        let summary = solve(&mut graph, &options, &mut ignore_iterations).unwrap();
        if summary.iterations.len() == 2 && !summary.iterations[1].accepted {
            stalled += 1;
            assert_eq!(summary.termination, Termination::Stalled);
            assert_eq!(summary.final_cost, summary.initial_cost);
            assert_eq!(graph.poses, start);
        }
    }
    assert!(stalled > 0, "no seed made the first Gauss-Newton step fail");
}
