//! False loop closures: found, switched off, and without effect on the result.

use std::collections::BTreeSet;

use covis_solvers::factors::RelativePose;
use covis_solvers::geometry::{LieGroup, RigidMotion, Se2, Se3};
use covis_solvers::information::Information;
use covis_solvers::initialization::Start;
use covis_solvers::interrupt::Interrupt;
use covis_solvers::io::g2o::G2oGraph;
use covis_solvers::optimizer::ignore_iterations;
use covis_solvers::pose_graph::Options;
use covis_solvers::problem::{PoseGraph, SolveError};
use covis_solvers::robust::{self, Judging, Kernel, RobustSummary};
use covis_solvers::testing::random::{element, normal_vector, seeded};
use nalgebra::{SVector, Vector3};
use rand::RngExt;

use crate::io::data::data;

fn solve<G: RigidMotion<D, N>, const D: usize, const N: usize>(
    graph: &mut PoseGraph<G, N>,
    has_poses: bool,
    judging: &Judging,
) -> Result<RobustSummary, SolveError> {
    let (options, interrupt) = (Options::default(), &Interrupt::NEVER);
    let observer = &mut ignore_iterations;
    robust::solve(graph, Start::Auto, has_poses, judging, &options, interrupt, observer)
}

/// Laps of a circle, each place seen again in every lap; the last `false_closures` edges are false.
fn laps<G: RigidMotion<D, N>, const D: usize, const N: usize>(
    step: &SVector<f64, N>,
    false_closures: usize,
    seed: u64,
) -> (PoseGraph<G, N>, Vec<G>) {
    const LAP: usize = 40;
    let mut rng = seeded(seed);
    let sigma = SVector::<f64, N>::repeat(0.02);
    let information = Information::from_sigmas(&sigma).unwrap();
    let mut truth = vec![G::identity()];
    for k in 1..4 * LAP {
        truth.push(truth[k - 1].plus(step));
    }
    let mut graph = PoseGraph::new();
    for (id, _) in truth.iter().enumerate() {
        graph.push_pose(id as i64, G::identity());
    }
    let pairs = (1..truth.len()).map(|j| (j - 1, j));
    let closures = (LAP..truth.len()).map(|j| (j - LAP, j));
    for (i, j) in pairs.chain(closures) {
        let noise = normal_vector(&mut rng, 0.02);
        let i_from_j = truth[i].inverse().compose(&truth[j]).plus(&noise);
        graph.edges.push(RelativePose { i, j, i_from_j, information, loss: None });
    }
    while graph.edges.len() < truth.len() - 1 + 3 * LAP + false_closures {
        let (i, j) = (rng.random_range(0..truth.len()), rng.random_range(0..truth.len()));
        if i.abs_diff(j) > 5 {
            let i_from_j = element(&mut rng, 2.0);
            graph.edges.push(RelativePose { i, j, i_from_j, information, loss: None });
        }
    }
    (graph, truth)
}

fn finds_the_false_ones<G: RigidMotion<D, N>, const D: usize, const N: usize>(
    step: &SVector<f64, N>,
    kernel: Kernel,
) {
    let (mut graph, truth) = laps::<G, D, N>(step, 120, 3);
    let first_false = graph.edges.len() - 120;
    let summary = solve(&mut graph, false, &Judging::new(kernel)).unwrap();
    assert!(summary.solve.termination.is_converged());
    assert_eq!(summary.start, Start::Chordal);
    assert_eq!(summary.closures.len(), 240);
    let wrong: Vec<_> =
        summary.closures.iter().filter(|v| v.is_switched_off != (v.edge >= first_false)).collect();
    assert!(wrong.iter().all(|v| v.edge < first_false), "a false closure is kept: {wrong:?}");
    assert!(wrong.len() <= 3, "true closures are switched off: {wrong:?}");
    // Where the plain optimum over the true edges is.
    let mut clean = PoseGraph { poses: truth, ..graph.clone() };
    clean.edges.truncate(first_false);
    plain(&mut clean);
    let pairs = graph.poses.iter().zip(&clean.poses);
    let worst = pairs.map(|(a, b)| a.minus(b).norm()).fold(0.0, f64::max);
    assert!(worst < 0.1, "{worst}");
}

/// Solves without robustness; returns the cost.
fn plain<G: LieGroup<N>, const N: usize>(graph: &mut PoseGraph<G, N>) -> f64 {
    covis_solvers::pose_graph::solve(graph, &Options::default(), &mut ignore_iterations)
        .unwrap()
        .final_cost
}

#[test]
fn false_closures_are_found_in_the_plane_and_in_space() {
    let turn = std::f64::consts::TAU / 40.0;
    for kernel in [Kernel::TruncatedLeastSquares, Kernel::GemanMcClure] {
        finds_the_false_ones::<Se2, 2, 3>(&Vector3::new(1.0, 0.0, turn), kernel);
        let step = SVector::from([1.0, 0.0, 0.0, 0.0, 0.0, turn]);
        finds_the_false_ones::<Se3, 3, 6>(&step, kernel);
    }
}

#[test]
fn without_false_closures_all_are_kept_and_the_result_is_the_plain_one() {
    let step = Vector3::new(1.0, 0.0, std::f64::consts::TAU / 40.0);
    let (mut graph, truth) = laps::<Se2, 2, 3>(&step, 0, 4);
    let mut clean = PoseGraph { poses: truth, ..graph.clone() };
    let judging = Judging { threshold: Some(40.0), ..Judging::new(Kernel::TruncatedLeastSquares) };
    let summary = solve(&mut graph, false, &judging).unwrap();
    assert!(summary.closures.iter().all(|v| v.weight == 1.0 && !v.is_switched_off));
    let (cost, reference) = (summary.solve.final_cost, plain(&mut clean));
    assert!((cost / reference - 1.0).abs() < 1e-8, "{cost} {reference}");
}

#[test]
fn a_closure_that_alone_ties_two_parts_together_is_judged_without_tearing_the_graph() {
    let step = Vector3::new(1.0, 0.0, 0.1);
    let (mut graph, _) = laps::<Se2, 2, 3>(&step, 0, 5);
    // Without the step from 79 to 80 the laps hang together by closures only.
    graph.edges.retain(|edge| (edge.i, edge.j) != (79, 80));
    let judging = Judging::new(Kernel::TruncatedLeastSquares);
    let summary = solve(&mut graph, false, &judging).unwrap();
    assert!(summary.solve.final_cost.is_finite());
    assert!(graph.poses.iter().all(LieGroup::is_finite));
}

#[test]
fn trusted_closures_are_not_judged_and_a_threshold_must_be_a_number() {
    let step = Vector3::new(1.0, 0.0, 0.1);
    let (mut graph, _) = laps::<Se2, 2, 3>(&step, 5, 6);
    let last = graph.edges.len() - 1;
    let judging = Judging { trusted: vec![last], ..Judging::new(Kernel::TruncatedLeastSquares) };
    let summary = solve(&mut graph, false, &judging).unwrap();
    assert!(summary.closures.iter().all(|v| v.edge != last));
    for threshold in [0.0, -1.0, f64::NAN, f64::INFINITY] {
        let judging = Judging { threshold: Some(threshold), ..Judging::new(Kernel::GemanMcClure) };
        let error = solve(&mut graph, false, &judging).unwrap_err();
        assert!(matches!(error, SolveError::InvalidOption { field: "threshold", .. }));
    }
}

/// The sphere whose edges past the first 4949 hold 2499 false closures.
fn sphere(kernel: Kernel) -> Option<(RobustSummary, PoseGraph<Se3, 6>, PoseGraph<Se3, 6>)> {
    let read = |name: &str| {
        let G2oGraph::Se3(file) = G2oGraph::read(&data(name)?).unwrap() else {
            panic!("not a graph in space")
        };
        Some(file.to_pose_graph().unwrap())
    };
    let mut clean = read("pose_graph/sphere2500.g2o")?;
    let mut graph = read("pose_graph/sphere2500_outliers.g2o")?;
    plain(&mut clean);
    let summary = solve(&mut graph, true, &Judging::new(kernel)).unwrap();
    Some((summary, graph, clean))
}

#[test]
fn half_of_the_closures_of_a_sphere_may_be_false() {
    let Some((summary, graph, clean)) = sphere(Kernel::TruncatedLeastSquares) else { return };
    let is_true = |edge: usize| {
        let e = &graph.edges[edge];
        clean.edges.iter().any(|c| (c.i, c.j) == (e.i, e.j))
    };
    let mut counts = [[0; 2]; 2];
    for verdict in &summary.closures {
        counts[usize::from(is_true(verdict.edge))][usize::from(!verdict.is_switched_off)] += 1;
    }
    assert_eq!(counts[0][1], 0, "false closures are kept");
    assert!(counts[1][1] * 100 >= 98 * (counts[1][0] + counts[1][1]), "{counts:?}");
    assert!(summary.solve.final_cost <= 1.05 * 675.70, "{}", summary.solve.final_cost);
    // Both hold the first pose where the file has it, so that no alignment is needed.
    let extent = clean.poses.iter().map(|p| p.translation.norm()).fold(0.0, f64::max);
    let squares: f64 = graph
        .poses
        .iter()
        .zip(&clean.poses)
        .map(|(a, b)| (a.translation - b.translation).norm_squared())
        .sum();
    let rmse = (squares / graph.poses.len() as f64).sqrt();
    assert!(rmse <= 0.005 * extent, "{rmse} of {extent}");
}

#[test]
fn more_false_closures_do_not_change_the_verdicts_on_those_of_a_recording() {
    let Some(path) = data("pose_graph/bicocca25b_bow_0.15.g2o") else { return };
    let G2oGraph::Se2(file) = G2oGraph::read(&path).unwrap() else {
        panic!("not a graph in the plane")
    };
    let mut graph = file.to_pose_graph().unwrap();
    let given = graph.edges.len();
    let off = |mut graph: PoseGraph<Se2, 3>| -> BTreeSet<usize> {
        let judging = Judging::new(Kernel::TruncatedLeastSquares);
        let summary = solve(&mut graph, true, &judging).unwrap();
        assert!(summary.solve.termination.is_converged());
        let off = summary.closures.iter().filter(|verdict| verdict.is_switched_off);
        off.map(|verdict| verdict.edge).collect()
    };
    let before = off(graph.clone());
    let is_closure = |edge: &&RelativePose<Se2, 3>| edge.i.abs_diff(edge.j) > 1;
    let closures: Vec<_> = graph.edges.iter().filter(is_closure).copied().collect();
    // Motions of closures between poses where they do not hold.
    let mut rng = seeded(1);
    while graph.edges.len() < given + 200 {
        let closure = closures[rng.random_range(0..closures.len())];
        let [i, j] = [(); 2].map(|()| rng.random_range(0..graph.poses.len()));
        if i + 20 < j {
            graph.edges.push(RelativePose { i, j, ..closure });
        }
    }
    let after = off(graph);
    assert!((given..given + 200).all(|edge| after.contains(&edge)), "a false closure is kept");
    let changed = after.range(..given).copied().collect::<BTreeSet<_>>();
    let changed = changed.symmetric_difference(&before).count();
    assert!(100 * changed <= closures.len(), "{changed} of {} changed", closures.len());
}

/// Σ χ² of the odometry and of what the kernel makes of the closures, halved.
fn objective(graph: &PoseGraph<Se2, 3>, kernel: Kernel, threshold: f64) -> f64 {
    let of = |edge: &RelativePose<Se2, 3>| {
        let chi2 = edge.chi2(&graph.poses[edge.i], &graph.poses[edge.j]);
        match kernel {
            _ if edge.i.abs_diff(edge.j) == 1 => chi2,
            Kernel::TruncatedLeastSquares => chi2.min(threshold),
            Kernel::GemanMcClure => chi2 * threshold / (chi2 + threshold),
        }
    };
    0.5 * graph.edges.iter().map(of).sum::<f64>()
}

#[test]
fn true_closures_stay_although_the_odometry_has_drifted_far_from_them() {
    let Some(path) = data("pose_graph/MIT.g2o") else { return };
    let G2oGraph::Se2(file) = G2oGraph::read(&path).unwrap() else {
        panic!("not a graph in the plane")
    };
    // The plain optimum, at which every closure fits, has 20.60347.
    for (kernel, best) in [(Kernel::TruncatedLeastSquares, 20.6035), (Kernel::GemanMcClure, 20.445)]
    {
        let mut graph = file.to_pose_graph().unwrap();
        let summary = solve(&mut graph, true, &Judging::new(kernel)).unwrap();
        assert!(summary.solve.termination.is_converged());
        assert_eq!(summary.start, Start::Chordal);
        let off = summary.closures.iter().filter(|verdict| verdict.is_switched_off).count();
        assert_eq!((off, summary.closures.len()), (0, 20), "{kernel:?}");
        let cost = objective(&graph, kernel, summary.threshold);
        assert!(cost < best, "{kernel:?}: {cost}");
    }
}
