//! pyfg files with ranges against GTSAM's records of them: costs, and variables here and there.
//!
//! Plaza1 (Djugash, Hamner and Roth 2009) is odometry and ranges to four beacons; this file writes it as a
//! pyfg file and leaves it in the folder of cargo for `tests/golden/record.py ranges`.

use std::fmt::Write as _;
use std::path::{Path, PathBuf};

use covis_solvers::evaluation::{ReferencePose, pose_graph_cost};
use covis_solvers::geometry::{LieGroup, Se2};
use covis_solvers::io::pyfg::{PyfgGraph, PyfgName};
use covis_solvers::optimizer::ignore_iterations;
use covis_solvers::pose_graph::{solve, undetermined};
use covis_solvers::problem::PoseGraph;
use serde_json::Value;

use super::graphs::tight;
use crate::io::data::data;

fn golden(relative: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../tests/golden").join(relative)
}

/// Solves a graph and compares it with GTSAM's record of the file; the solved graph.
fn compare<G: ReferencePose<N>, const N: usize>(
    name: &str,
    mut graph: PoseGraph<G, N>,
) -> PoseGraph<G, N> {
    let record = std::fs::read(golden(&format!("gtsam/{name}-file-start.json"))).unwrap();
    let record: Value = serde_json::from_slice(&record).unwrap();
    let number = |field: &str| record[field].as_f64().unwrap();
    let before = pose_graph_cost(&graph).total;
    assert!((before / number("initial_cost") - 1.0).abs() < 1e-9, "{name}: {before}");
    let mut options = tight();
    options.optimizer.max_iterations = 200;
    let summary = solve(&mut graph, &options, &mut ignore_iterations).unwrap();
    assert!(summary.termination.is_converged(), "{name}: {:?}", summary.termination);
    let after = pose_graph_cost(&graph);
    let off = after.total / number("final_cost") - 1.0;
    assert!(off.abs() < 1e-9, "{name}: {} is off by {off:e}", after.total);
    assert_eq!(after.range.count, graph.ranges.len());
    assert_eq!(undetermined(&graph).unwrap(), []);
    let poses = record["poses"].as_object().unwrap();
    assert!(poses.len() >= 4);
    for (name, expected) in poses {
        let id = name.parse::<PyfgName>().unwrap().id();
        let of = |ids: &[i64]| ids.iter().position(|&other| other == id);
        let found = match of(&graph.ids) {
            Some(pose) => graph.poses[pose].act(&nalgebra::Vector3::zeros()),
            None => graph.landmarks.positions[of(&graph.landmarks.ids).unwrap()],
        };
        let space = if N == 3 { 2 } else { 3 };
        for axis in 0..space {
            let expected = expected[axis].as_f64().unwrap();
            assert!((found[axis] - expected).abs() < 1e-4, "{name}: {found} {expected}");
        }
    }
    graph
}

fn read(path: &Path) -> PyfgGraph {
    PyfgGraph::read(path, false).unwrap().0
}

#[test]
fn two_robots_with_ranges_cost_what_gtsam_says() {
    let PyfgGraph::Se2(file) = read(&golden("twins/fleet-2d.pyfg")) else { panic!("read as 3D") };
    let solved = compare("fleet-2d", file.to_pose_graph().unwrap());
    assert_eq!(solved.constant.iter().filter(|&&constant| constant).count(), 1);
    let PyfgGraph::Se3(file) = read(&golden("twins/fleet-3d.pyfg")) else { panic!("read as 2D") };
    let solved = compare("fleet-3d", file.to_pose_graph().unwrap());
    assert!(!solved.constant.contains(&true), "priors hold it");
}

/// Rows of numbers.
fn rows<const K: usize>(path: &Path) -> Vec<[f64; K]> {
    let text = std::fs::read_to_string(path).unwrap();
    let row = |line: &str| {
        let numbers: Vec<f64> = line.split_whitespace().map(|n| n.parse().unwrap()).collect();
        *numbers.first_chunk().unwrap()
    };
    text.lines().filter(|line| !line.trim().is_empty()).map(row).collect()
}

/// Plaza1: chained odometry, ranges without their scale, beacons off their places by 1 m to 2 m.
fn plaza(file: impl Fn(&str) -> PathBuf) -> String {
    let odometry = rows::<3>(&file("DR"));
    let [t0, x, y, heading] = rows::<4>(&file("GT"))[0];
    let mut text = String::new();
    let mut pose = Se2::from_xy_angle(x, y, heading);
    let mut times = vec![t0];
    let mut put_pose = |k: usize, time: f64, pose: &Se2| {
        let (t, angle) = (pose.translation, pose.rotation.angle());
        writeln!(text, "VERTEX_SE2 {time:?} A{k} {:?} {:?} {angle:?}", t.x, t.y).unwrap();
    };
    put_pose(0, t0, &pose);
    for (k, &[time, distance, turn]) in (1..).zip(&odometry) {
        pose = pose.compose(&Se2::from_xy_angle(distance, 0.0, turn));
        put_pose(k, time, &pose);
        times.push(time);
    }
    let beacons = rows::<3>(&file("TL"));
    let shifts = [[1.5, -1.0], [-1.0, 2.0], [1.0, 1.0], [-2.0, 0.5]];
    for ([node, x, y], [dx, dy]) in beacons.iter().zip(shifts) {
        writeln!(text, "VERTEX_XY L{node:.0} {:?} {:?}", x + dx, y + dy).unwrap();
    }
    let covariance = "0.0025 0.0 0.0 0.0001 0.0 0.0004";
    for (k, [time, distance, turn]) in (1..).zip(&odometry) {
        let ends = format!("A{} A{k}", k - 1);
        writeln!(text, "EDGE_SE2 {time:?} {ends} {distance:?} 0.0 {turn:?} {covariance}").unwrap();
    }
    for [time, _, node, range] in rows::<4>(&file("TD")) {
        // The last pose that is not later.
        let pose = times.partition_point(|&other| other <= time).max(1) - 1;
        let (distance, variance) = (range / 1.069, 0.54 * 0.54);
        writeln!(text, "EDGE_RANGE {time:?} A{pose} L{node:.0} {distance:?} {variance:?}").unwrap();
    }
    text
}

#[test]
fn plaza_costs_what_gtsam_says() {
    let names = ["DR", "GT", "TL", "TD"];
    let file = |name: &str| data(&format!("range/Plaza1_{name}.txt"));
    if !names.iter().all(|name| file(name).is_some()) {
        return;
    }
    let text = plaza(|name| file(name).unwrap());
    let path = Path::new(env!("CARGO_TARGET_TMPDIR")).join("plaza1.pyfg");
    std::fs::create_dir_all(path.parent().unwrap()).unwrap();
    std::fs::write(&path, text).unwrap();
    let PyfgGraph::Se2(mut file) = read(&path) else { panic!("read as 3D") };
    let graph = file.to_pose_graph().unwrap();
    assert_eq!((graph.poses.len(), graph.ranges.len()), (9658, 3529));
    let solved = compare("plaza1", graph);
    file.update_from(&solved).unwrap();
    let again = PyfgGraph::parse(&file.to_bytes(), &path, false).unwrap().0;
    assert_eq!(again, PyfgGraph::Se2(file));
}
