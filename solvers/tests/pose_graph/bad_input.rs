//! Graphs that are wrong, singular or contradictory: each ends in a named diagnosis or a right answer.
//!
//! Files are given as text, so that what a user would write is what is tested; groups and files of
//! 3D are covered where the plane hides something.

use std::f64::consts::PI;
use std::path::Path;

use covis_solvers::evaluation::pose_graph_cost;
use covis_solvers::factors::RelativePose;
use covis_solvers::geometry::{LieGroup, Se2, Se3, Sim3, So3};
use covis_solvers::information::Information;
use covis_solvers::initialization::{Start, initialize};
use covis_solvers::io::IoError;
use covis_solvers::io::g2o::G2oGraph;
use covis_solvers::loss::Loss;
use covis_solvers::optimizer::{Method, SolveSummary, Termination, ignore_iterations};
use covis_solvers::pose_graph::{Options, Undetermined, solve, undetermined};
use covis_solvers::price::Limits;
use covis_solvers::problem::{PoseGraph, SolveError};
use covis_solvers::testing::random::{element, normal_vector, seeded, unit_vector};
use nalgebra::{SMatrix, SVector, Vector3};

use super::graphs::{Recipe, distance, make};

const METHODS: [Method; 2] = [Method::LevenbergMarquardt, Method::GaussNewton];
const EXACT: Recipe = Recipe { seed: 3, poses: 30, measurement_sigma: 0.0, start_sigma: 0.05 };

fn read(text: &str) -> Result<PoseGraph<Se2, 3>, IoError> {
    match G2oGraph::parse(text.as_bytes(), Path::new("graph.g2o"))? {
        G2oGraph::Se2(file) => file.to_pose_graph(),
        G2oGraph::Se3(_) => panic!("a 2D file was read as 3D"),
    }
}

/// Solves with `method`; whatever comes out has to be finite and no worse than the start.
fn solved<G, const N: usize>(graph: &mut PoseGraph<G, N>, method: Method) -> SolveSummary
where
    G: LieGroup<N>,
{
    let mut options = Options::default();
    options.optimizer.method = method;
    let summary = solve(graph, &options, &mut ignore_iterations).unwrap();
    assert!(graph.poses.iter().all(|pose| pose.is_finite()), "{method:?}");
    assert!(summary.final_cost <= summary.initial_cost, "{method:?}: {summary:?}");
    summary
}

fn ids<const N: usize>(open: &[Undetermined<N>]) -> Vec<i64> {
    open.iter().map(|pose| pose.id).collect()
}

/// Replaces the information of the edges for which `of` gives a matrix.
fn inform<G: LieGroup<N>, const N: usize>(
    graph: &mut PoseGraph<G, N>,
    of: impl Fn(&RelativePose<G, N>) -> Option<SMatrix<f64, N, N>>,
) {
    for edge in &mut graph.edges {
        if let Some(matrix) = of(edge) {
            edge.information = Information::semidefinite(&matrix).unwrap();
        }
    }
}

/// An exact graph with one more pose, tied by one edge with the information matrix `omega`.
fn with_leaf<G: LieGroup<N>, const N: usize>(
    omega: &SMatrix<f64, N, N>,
) -> (PoseGraph<G, N>, Vec<G>) {
    let (mut graph, mut truth) = make::<G, N>(EXACT);
    let mut rng = seeded(17);
    let i_from_j: G = element(&mut rng, 0.5);
    truth.push(truth[12].compose(&i_from_j));
    let start = truth[truth.len() - 1].plus(&normal_vector(&mut rng, 0.1));
    let j = graph.push_pose(-7, start);
    let information = Information::semidefinite(omega).unwrap();
    graph.edges.push(RelativePose { i: 12, j, i_from_j, information, loss: None });
    (graph, truth)
}

/// A random matrix of some rank whose null space follows no axis.
fn of_rank<const N: usize>(rank: usize, scale: f64) -> SMatrix<f64, N, N> {
    let mut rng = seeded(rank as u64);
    (0..rank).fold(SMatrix::zeros(), |sum, _| {
        let v: SVector<f64, N> = normal_vector(&mut rng, 1.0);
        sum + v * v.transpose() * scale
    })
}

fn a_leaf_of_some_rank<G: LieGroup<N>, const N: usize>() {
    let mut stalled = 0;
    for rank in 0..=N {
        for scale in [1e-8, 1.0, 1e8] {
            for method in METHODS {
                let (mut graph, truth) = with_leaf::<G, N>(&of_rank(rank, scale));
                let start = graph.poses[truth.len() - 1];
                let summary = solved(&mut graph, method);
                let end = (summary.termination, summary.final_cost);
                let case = format!("rank {rank} of {N}, {scale:e}, {method:?}: {end:?}");
                if method == Method::GaussNewton && summary.termination == Termination::Stalled {
                    stalled += 1;
                    continue;
                }
                // Residuals without information cancel in rᵀΩr to rounding, where steps end.
                let is_zero = summary.final_cost < 1e-15 * scale;
                assert!(summary.termination.is_converged() || is_zero, "{case}");
                assert!(summary.final_cost < 1e-12 * scale.max(1.0), "{case}");
                let last = truth.len() - 1;
                // A thousandth of a standard deviation.
                assert!(distance(&graph.poses[..last], &truth[..last]) < 1e-3, "{case}");
                assert!(graph.poses[last].minus(&start).norm() < 2.0, "{case}: went far");
                let open = undetermined(&graph).unwrap();
                let directions = open.first().map_or(0, |pose| pose.directions.len());
                assert_eq!(
                    (directions, ids(&open).len()),
                    (N - rank, usize::from(rank < N)),
                    "{case}"
                );
                if let Some(pose) = open.first() {
                    assert_eq!(pose.id, -7, "{case}");
                    // Moving along them is free.
                    let before = pose_cost(&graph);
                    for direction in &pose.directions {
                        assert!((direction.norm() - 1.0).abs() < 1e-12);
                        let mut moved = graph.clone();
                        moved.poses[last] = moved.poses[last].plus(&(direction * 1e-4));
                        let rise = pose_cost(&moved) - before;
                        assert!(rise < 1e-13 * scale, "{case}: costs {rise:e}");
                    }
                }
            }
        }
    }
    assert!(stalled <= N + 1, "Gauss-Newton stalled in {stalled} of {} cases", 3 * (N + 1));
}

fn pose_cost<G: LieGroup<N>, const N: usize>(graph: &PoseGraph<G, N>) -> f64 {
    let of = |edge: &RelativePose<G, N>| {
        let residual = edge.residual(&graph.poses[edge.i], &graph.poses[edge.j]);
        0.5 * edge.information.squared_norm(&residual)
    };
    graph.edges.iter().map(of).sum()
}

#[test]
fn a_singular_information_matrix_on_the_only_edge_to_a_pose() {
    a_leaf_of_some_rank::<Se2, 3>();
    a_leaf_of_some_rank::<Se3, 6>();
    a_leaf_of_some_rank::<Sim3, 7>();
}

#[test]
fn a_pose_without_rotation_information_is_named_with_its_axes() {
    let omega = SMatrix::from_diagonal(&SVector::from([4.0, 4.0, 4.0, 0.0, 0.0, 0.0]));
    for method in METHODS {
        let (mut graph, truth) = with_leaf::<Se3, 6>(&omega);
        assert!(solved(&mut graph, method).termination.is_converged());
        let off = graph.poses[30].translation - truth[30].translation;
        assert!(off.norm() < 1e-6, "{method:?}: its position is known, and {off} off");
        let open = undetermined(&graph).unwrap();
        let axes = (3..6).map(|axis| SVector::from_fn(|k, _| f64::from(u8::from(k == axis))));
        assert_eq!(open, [Undetermined { id: -7, directions: axes.collect() }]);
    }
}

#[test]
fn what_hangs_on_a_hinge_is_named_with_it() {
    let full = "1 0 0 1 0 1";
    let text = format!(
        "EDGE_SE2 0 1 1 0 0.1 {full}\nEDGE_SE2 1 2 1 0 0.1 1 0 0 1 0 0\n\
         EDGE_SE2 2 3 1 0 0.1 {full}\nEDGE_SE2 3 4 1 0 0.1 {full}\n"
    );
    for method in METHODS {
        let mut graph = read(&text).unwrap();
        initialize(&mut graph, Start::Auto, false, Limits::NONE).unwrap();
        let summary = solved(&mut graph, method);
        assert!(summary.termination.is_converged() && summary.final_cost < 1e-18, "{summary:?}");
        let open = undetermined(&graph).unwrap();
        assert_eq!(ids(&open), [2, 3, 4], "{method:?}");
        assert!((open[0].directions[0] - Vector3::z()).norm() < 1e-9, "{:?}", open[0]);
        // The others turn about it.
        assert!(open.iter().all(|pose| pose.directions.len() == 1));
        assert!(open[1].directions[0][1].abs() > 0.5, "{:?}", open[1]);
    }
}

#[test]
fn edges_that_are_singular_each_may_determine_a_pose_together() {
    let (first, second) = ("1 0 0 1 0 0", "0 0 0 0 0 9");
    let text = format!(
        "EDGE_SE2 0 1 1 0 0.1 {first}\nEDGE_SE2 0 1 5 5 0.5 {second}\n\
         EDGE_SE2 2 1 0 2 0.2 {second}\nEDGE_SE2 2 1 1 1 9 {first}\nEDGE_SE2 3 2 1 1 1 0 0 0 0 0 0\n\
         EDGE_SE2 2 3 1 0 0 1 0 0 1 0 1\n"
    );
    for method in METHODS {
        let mut graph = read(&text).unwrap();
        let summary = solved(&mut graph, method);
        assert!(summary.termination.is_converged(), "{method:?}: {}", summary.termination);
        assert!(summary.final_cost < 1e-15, "{method:?}: {:e}", summary.final_cost);
        assert!((graph.poses[1].rotation.angle() - 0.5).abs() < 1e-7, "{method:?}");
        assert!((graph.poses[2].rotation.angle() - 0.3).abs() < 1e-7, "{method:?}");
        assert_eq!(undetermined(&graph).unwrap(), [], "{method:?}");
    }
}

#[test]
fn a_graph_of_positions_only_leaves_every_rotation_open() {
    for method in METHODS {
        let (mut graph, _) = make::<Se3, 6>(Recipe { poses: 300, ..EXACT });
        let omega = SMatrix::from_diagonal(&SVector::from([1.0, 1.0, 1.0, 0.0, 0.0, 0.0]));
        inform(&mut graph, |_| Some(omega));
        let summary = solved(&mut graph, method);
        assert_ne!(summary.termination, Termination::NumericalFailure, "{method:?}");
        // Full steps are Gauss-Newton's own risk where little is known.
        let limit = if method == Method::GaussNewton { 1e-3 } else { 1e-9 };
        let (before, after) = (summary.initial_cost, summary.final_cost);
        assert!(
            after < limit * before,
            "{method:?}: {before:e} to {after:e}, {}",
            summary.termination
        );
        let open = undetermined(&graph).unwrap();
        assert_eq!(open.len(), 299, "{method:?}: all but the one that is held");
    }
}

#[test]
fn definite_graphs_are_not_suspected_however_long_or_uneven() {
    // An open chain is floppy: its end has a covariance that grows with the cube of its length.
    let chain: String = (0..3000)
        .map(|k| format!("EDGE_SE2 {k} {} 1 0 0.01 1e4 0 0 1e-4 0 1e10\n", k + 1))
        .collect();
    let mut graph = read(&chain).unwrap();
    initialize(&mut graph, Start::SpanningTree, false, Limits::NONE).unwrap();
    assert_eq!(undetermined(&graph).unwrap(), []);
    let (graph, _) = make::<Sim3, 7>(EXACT);
    assert_eq!(undetermined(&graph).unwrap(), []);
}

#[test]
fn losses_that_cut_an_edge_off_leave_what_hung_on_it() {
    let (mut graph, truth) = make::<Se2, 3>(EXACT);
    let far = truth[12].plus(&Vector3::new(50.0, 0.0, 0.0));
    let j = graph.push_pose(-7, far);
    let edge = graph.edges[0];
    graph.edges.push(RelativePose { i: 12, j, i_from_j: Se2::identity(), ..edge });
    graph.loss = Loss::Tukey(5.0);
    // H is zero at that pose, so that Gauss-Newton has no full step and takes damped ones.
    let summary = solved(&mut graph, Method::GaussNewton);
    assert!(summary.termination.is_converged(), "{}", summary.termination);
    assert!(summary.iterations.iter().any(|row| row.damping > 0.0));
    assert_eq!(graph.poses[j], far);
    assert!(distance(&graph.poses[..j], &truth) < 1e-5);
    let open = undetermined(&graph).unwrap();
    assert_eq!((ids(&open), open[0].directions.len()), (vec![-7], 3));
}

#[test]
fn contradicting_half_turns_end_finite() {
    // Between the two measurements the logarithm jumps; either side is a minimum.
    let text = "VERTEX_SE2 0 0 0 0\nVERTEX_SE2 1 1 0 3.14159265358979312\n\
        EDGE_SE2 0 1 1 0 1.5707963267948966 1 0 0 1 0 1\n\
        EDGE_SE2 0 1 1 0 -1.5707963267948966 1 0 0 1 0 1\n";
    for method in METHODS {
        let mut graph = read(text).unwrap();
        let summary = solved(&mut graph, method);
        assert_ne!(summary.termination, Termination::NumericalFailure, "{method:?}");
        assert!((summary.final_cost / pose_graph_cost(&graph).total - 1.0).abs() < 1e-9);
    }
}

#[test]
fn starts_half_a_turn_off_reach_the_truth_or_say_that_they_stalled() {
    let mut rng = seeded(5);
    let mut reached = 0;
    for _ in 0..20 {
        let (mut graph, truth) = make::<Se3, 6>(Recipe { start_sigma: 0.0, ..EXACT });
        let half_turn = So3::exp(&(unit_vector(&mut rng) * PI));
        graph.poses[29] = graph.poses[29].compose(&Se3::new(half_turn, Vector3::zeros()));
        for method in METHODS {
            let mut graph = graph.clone();
            let summary = solved(&mut graph, method);
            let is_truth = summary.final_cost < 1e-12;
            reached += usize::from(is_truth);
            assert!(
                !is_truth || distance(&graph.poses, &truth) < 1e-5,
                "{method:?}: {}",
                summary.termination
            );
            assert_ne!(summary.termination, Termination::NumericalFailure, "{method:?}");
        }
    }
    assert!(reached >= 20, "only {reached} of 40 came back");
}

#[test]
fn files_that_no_solver_could_solve_are_refused_by_name() {
    let edge = "EDGE_SE2 0 1 1 0 0 1 0 0 1 0 1\n";
    let table: [(String, &[&str]); 11] = [
        (String::new(), &["graph.g2o", "no vertex or edge"]),
        ("\n# nothing\n\n".into(), &["graph.g2o", "no vertex or edge"]),
        ("VERTEX_SE2 0 0 0 0\nVERTEX_SE2 1 1 0 0\n".into(), &["the graph has no edges"]),
        (format!("VERTEX_SE2 0 0 0 0\n{edge}"), &["line 2", "vertex 1 does not exist"]),
        (format!("{edge}FIX 9\n"), &["line 2", "vertex 9 does not exist"]),
        (
            format!("{edge}EDGE_SE2 1 2 nan 0 0 1 0 0 1 0 1\n"),
            &["line 2", "measurement[0]", "finite"],
        ),
        (
            format!("{edge}EDGE_SE2 1 2 0 0 0 1 0 0 inf 0 1\n"),
            &["line 2", "information[3]", "finite"],
        ),
        (
            format!("{edge}EDGE_SE2 1 2 1e999 0 0 1 0 0 1 0 1\n"),
            &["line 2", "measurement[0]", "finite"],
        ),
        (
            format!("{edge}EDGE_SE2 1 2 0 0 0 1 0 0 1 0 -1\n"),
            &["line 2", "edge 1 to 2", "indefinite"],
        ),
        (
            format!("{edge}EDGE_SE2 7 8 0 0 0 1 0 0 1 0 1\n"),
            &["2 pieces", "2 vertices from 7 to 8"],
        ),
        (
            format!("VERTEX_SE2 5 0 0 0\nVERTEX_SE2 0 0 0 0\nVERTEX_SE2 1 0 0 0\n{edge}"),
            &["2 pieces", "vertex 5"],
        ),
    ];
    for (text, parts) in table {
        let message = match read(&text) {
            Err(error) => error.to_string(),
            Ok(mut graph) => solve(&mut graph, &Options::default(), &mut ignore_iterations)
                .map_or_else(
                    |error| error.to_string(),
                    |end| panic!("{text}: {}", end.termination),
                ),
        };
        for part in parts {
            assert!(message.contains(part), "`{part}` in `{message}` of\n{text}");
        }
    }
}

#[test]
fn the_diagnosis_refuses_what_a_solve_refuses() {
    let (mut graph, _) = make::<Se2, 3>(EXACT);
    graph.poses[3].translation.x = f64::NAN;
    assert!(matches!(undetermined(&graph), Err(SolveError::NotFinite { .. })));
    let (mut graph, _) = make::<Se2, 3>(EXACT);
    graph.constant.fill(true);
    inform(&mut graph, |_| Some(SMatrix::zeros()));
    assert_eq!(undetermined(&graph), Ok(Vec::new()), "what is held is not open");
}
