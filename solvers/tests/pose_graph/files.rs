//! Graphs of files against GTSAM's records of them in `tests/golden`: costs, and poses here and there.
//!
//! GTSAM stops where a step gains less than 1e-9 of the cost; covis may be lower. Poses are compared
//! in the frame of the first one, which GTSAM holds by a prior only. Every cost is checked by the
//! independent evaluator. Public files are looked for in `../shared/data`.

use std::path::{Path, PathBuf};

use covis_solvers::evaluation::{ReferencePose, pose_graph_cost};
use covis_solvers::geometry::RigidMotion;
use covis_solvers::initialization::{Start, initialize};
use covis_solvers::io::g2o::{G2oGraph, G2oPose};
use covis_solvers::optimizer::{Method, SolveSummary, ignore_iterations};
use covis_solvers::pose_graph::{Options, solve, undetermined};
use covis_solvers::price::Limits;
use covis_solvers::problem::PoseGraph;
use serde_json::Value;

use crate::io::data::data;

/// Graphs, and the start of GTSAM's record. From the file's own start torus3D ends elsewhere.
const GOLDENS: [(&str, &str); 13] = [
    ("sphere2500", "file"),
    ("parking-garage", "file"),
    ("torus3D", "chordal"),
    ("smallGrid3D", "file"),
    ("tinyGrid3D", "file"),
    ("M3500", "file"),
    ("city10000", "file"),
    ("intel", "file"),
    ("kitti_00", "odometry"),
    ("CSAIL", "odometry"),
    ("sphere-200", "file"),
    ("grid-200", "file"),
    ("grid-100-edges", "odometry"),
];

/// What may lie between the poses: a share of the graph's extent, and radians.
const POSE_TOLERANCE: f64 = 1e-5;

/// What a solve of a file came to.
struct Solved {
    summary: SolveSummary,
    /// Largest distance from the record's poses, as a share of the extent, and angle in radians.
    distance: (f64, f64),
}

fn golden(relative: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../tests/golden").join(relative)
}

/// The project's own graphs are always there.
fn graph_file(name: &str) -> Option<PathBuf> {
    let twin = golden(&format!("twins/{name}.g2o"));
    if twin.exists() { Some(twin) } else { data(&format!("pose_graph/{name}.g2o")) }
}

fn record(name: &str, start: &str) -> Value {
    let path = golden(&format!("gtsam/{name}-{start}-start.json"));
    serde_json::from_slice(&std::fs::read(path).unwrap()).unwrap()
}

/// Largest distance of `graph` from a record's poses.
fn distance<G, const D: usize, const N: usize, const P: usize>(
    graph: &PoseGraph<G, N>,
    record: &Value,
) -> (f64, f64)
where
    G: RigidMotion<D, N> + G2oPose<N, P>,
{
    let expected = record["poses"].as_object().unwrap().iter().map(|(id, numbers)| {
        let numbers: Vec<f64> = serde_json::from_value(numbers.clone()).unwrap();
        let numbers: [f64; P] = numbers.try_into().unwrap();
        (id.parse::<i64>().unwrap(), G::from_numbers(&numbers).unwrap())
    });
    let expected: Vec<(i64, G)> = expected.collect();
    let find = |id: i64| graph.poses[graph.ids.iter().position(|&other| other == id).unwrap()];
    let &(first_id, first) = expected.iter().min_by_key(|(id, _)| *id).unwrap();
    let record_from_graph = first.compose(&find(first_id).inverse());
    let origin = find(first_id).translation();
    let lengths = graph.poses.iter().map(|pose| (pose.translation() - origin).norm());
    let extent = lengths.fold(0.0, f64::max);
    expected.iter().fold((0.0, 0.0), |(far, turned), (id, pose)| {
        let off = pose.minus(&record_from_graph.compose(&find(*id)));
        (f64::max(far, off.rows(0, D).norm() / extent), f64::max(turned, off.rows(D, N - D).norm()))
    })
}

fn run<G, const D: usize, const N: usize, const P: usize>(
    mut graph: PoseGraph<G, N>,
    (start, has_vertices): (Start, bool),
    options: &Options,
    record: &Value,
) -> Solved
where
    G: RigidMotion<D, N> + G2oPose<N, P> + ReferencePose<N>,
{
    initialize(&mut graph, start, has_vertices, Limits::NONE).unwrap();
    let before = pose_graph_cost(&graph).total;
    let summary = solve(&mut graph, options, &mut ignore_iterations).unwrap();
    let after = pose_graph_cost(&graph).total;
    assert!((summary.initial_cost / before - 1.0).abs() < 1e-9);
    assert!((summary.final_cost / after - 1.0).abs() < 1e-9);
    assert_eq!(undetermined(&graph).unwrap(), []);
    Solved { distance: distance(&graph, record), summary }
}

/// `None` where the data is absent.
fn solve_file(name: &str, start: Start, options: &Options, record: &Value) -> Option<Solved> {
    let file = G2oGraph::read(&graph_file(name)?).unwrap();
    let start = match file.has_vertices() {
        false if start == Start::Given => (Start::SpanningTree, false),
        has_vertices => (start, has_vertices),
    };
    Some(match file {
        G2oGraph::Se2(file) => run(file.to_pose_graph().unwrap(), start, options, record),
        G2oGraph::Se3(file) => run(file.to_pose_graph().unwrap(), start, options, record),
    })
}

/// From the start that a solve takes by itself, and from the file's.
fn reaches_the_records(method: Method) {
    let mut options = Options::default();
    options.optimizer.method = method;
    for (name, peers_start) in GOLDENS {
        let record = record(name, peers_start);
        let reference = record["final_cost"].as_f64().unwrap();
        for start in [Start::Auto, Start::Given] {
            if start == Start::Given && peers_start == "chordal" {
                continue;
            }
            let Some(solved) = solve_file(name, start, &options, &record) else { continue };
            let (summary, (far, turned)) = (solved.summary, solved.distance);
            let case = format!("{name}, {start:?}: {}", summary.termination);
            let ratio = summary.final_cost / reference - 1.0;
            assert!(ratio <= 1e-6, "{case}: {:.10e}, {ratio:e} above", summary.final_cost);
            assert!(
                far <= POSE_TOLERANCE && turned <= POSE_TOLERANCE,
                "{case}: {far:e} {turned:e}"
            );
            if method == Method::LevenbergMarquardt {
                assert!(summary.termination.is_converged(), "{case}");
                assert!(summary.iterations.len() <= 21, "{case}: {}", summary.iterations.len());
            }
        }
    }
}

#[test]
fn levenberg_marquardt_reaches_gtsams_records() {
    reaches_the_records(Method::LevenbergMarquardt);
}

#[test]
fn gauss_newton_reaches_the_same_records() {
    reaches_the_records(Method::GaussNewton);
}

#[test]
fn small_grids_converge_alike_with_much_and_little_damping() {
    for name in ["tinyGrid3D", "smallGrid3D"] {
        let record = record(name, "file");
        for damping in [1e-10, 1e-6, 1e-3] {
            let mut options = Options::default();
            options.optimizer.initial_damping = damping;
            let Some(solved) = solve_file(name, Start::Given, &options, &record) else { return };
            assert!(solved.summary.termination.is_converged());
            let ratio = solved.summary.final_cost / record["final_cost"].as_f64().unwrap();
            assert!((ratio - 1.0).abs() < 1e-6, "{name} {damping:e}: {ratio}");
        }
    }
}
