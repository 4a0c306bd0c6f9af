//! pyfg files: what is read, what is written back, g2o, refusals.

use std::path::Path;

use covis_solvers::evaluation::pose_graph_cost;
use covis_solvers::factors::{RangeEnd, Sighting};
use covis_solvers::io::IoError;
use covis_solvers::io::g2o::{G2oGraph, G2oSe2};
use covis_solvers::io::pyfg::{ChangedLines, PyfgGraph, PyfgName, PyfgSe2, PyfgSe3};
use covis_solvers::testing::random::{element, normal_vector, seeded, uniform_vector};
use nalgebra::Vector3;

use super::refused;

const PLANE: &str = "\
    VERTEX_SE2 1403636579.763555584 A0 0.5 0 0\n\
    VERTEX_SE2 2.50 A1 1 0 0.1\n\
    VERTEX_SE2 2 B7 3 1 -3.1\n\
    VERTEX_XY L0 11.0 19.0\n\
    VERTEX_XY L3 1 2\n\
    VERTEX_SE2:PRIOR 0 B7 3 1 -3 0.1 0.02 0 0.2 0 0.04\n\
    VERTEX_XY:PRIOR 0 L3 1.5 2 0.5 0.1 0.25\n\
    EDGE_SE2 0 A0 A1 1.0 0.0 0.0 1.0 0.5 -0.0 2.0 -0.0 4.0\n\
    EDGE_SE2_XY 1.50 A1 L3 0.1 2 0.1 0.01 0.4\n\
    EDGE_RANGE 0 A1 L0 21.470910554 4\n\
    EDGE_RANGE 0 L0 L3 2 1\n\
    EDGE_RANGE 0 B7 A0 2 0.25\n";

const SPACE: &str = "\
    VERTEX_SE3:QUAT 0 A0 0 0 0 0 0 0 1\n\
    VERTEX_SE3:QUAT 1 A1 1 2 3 0.5 0.5 0.5 0.5\n\
    VERTEX_XYZ L1 1 2 3\n\
    VERTEX_XYZ:PRIOR 2 L1 1 2 4 1 0.1 0.2 2 0.3 3\n\
    VERTEX_SE3:QUAT:PRIOR 1 A0 0 0 0 0 0 0 1 1 0 0 0 0 0 2 0 0 0 0 3 0 0 0 4 0 0 5 0 6\n\
    EDGE_SE3:QUAT 1 A0 A1 1 2 3 0 0 0.6 0.8 1 0.5 0 0 0 0 1 0 0 0 0 1 0 0 0 1 0 0 1 0 0.5\n\
    EDGE_SE3_XYZ 1 A1 L1 1 2 3 1 0 0 1 0 1\n\
    EDGE_RANGE 0 A0 A1 3.7 0.01\n";

fn parse(text: &str) -> Result<PyfgGraph, IoError> {
    PyfgGraph::parse(text.as_bytes(), Path::new("graph.pyfg"), false).map(|(file, _)| file)
}

fn plane(text: &str) -> PyfgSe2 {
    let PyfgGraph::Se2(file) = parse(text).unwrap() else { panic!("read as 3D") };
    file
}

fn space(text: &str) -> PyfgSe3 {
    let PyfgGraph::Se3(file) = parse(text).unwrap() else { panic!("read as 2D") };
    file
}

fn id(name: &str) -> i64 {
    name.parse::<PyfgName>().unwrap().id()
}

#[test]
fn covariances_and_variances_become_information() {
    let graph = plane(PLANE).to_pose_graph().unwrap();
    assert_eq!(graph.ids, ["A0", "A1", "B7"].map(id));
    assert_eq!(graph.landmarks.ids, ["L0", "L3"].map(id));
    // The inverse of (1, 0.5; 0.5, 2) is (2, -0.5; -0.5, 1) / 1.75.
    let omega = graph.edges[0].information.matrix();
    for (at, expected) in
        [((0, 0), 2.0 / 1.75), ((0, 1), -0.5 / 1.75), ((1, 1), 1.0 / 1.75), ((2, 2), 0.25)]
    {
        assert!((omega[at] - expected).abs() < 1e-15, "{at:?} {omega}");
    }
    let [survey, seen] = graph.landmarks.measurements[..] else { panic!("two") };
    assert_eq!((survey.pose, seen.pose), (None, Some(1)));
    assert_eq!(seen.sighting, Sighting::Position(Vector3::new(0.1, 2.0, 0.0)));
    assert!((seen.information.matrix()[(1, 1)] - 0.1 / (0.04 - 0.0001)).abs() < 1e-12);
    assert_eq!(seen.information.matrix()[(2, 2)], 0.0);
    let ends: Vec<_> = graph.ranges.iter().map(|range| range.ends).collect();
    let (pose, landmark) = (RangeEnd::Pose, RangeEnd::Landmark);
    assert_eq!(ends, [[pose(1), landmark(0)], [landmark(0), landmark(1)], [pose(2), pose(0)],]);
    assert_eq!((graph.ranges[0].distance_m, graph.ranges[0].precision), (21.470910554, 0.25));
    assert!(!graph.constant.contains(&true), "priors hold it");
    let graph = space(SPACE).to_pose_graph().unwrap();
    let omega = graph.edges[0].information.matrix();
    assert!(
        (omega[(0, 1)] + 0.5 / 0.75).abs() < 1e-15 && (omega[(5, 5)] - 2.0).abs() < 1e-15,
        "{omega}"
    );
    let prior = graph.pose_priors[0].information.matrix();
    assert!((prior[(3, 3)] - 0.25).abs() < 1e-15, "translation first: {prior}");
}

#[test]
fn what_is_written_is_read_back_with_names_and_times() {
    for text in [PLANE, SPACE] {
        let file = parse(text).unwrap();
        let written = file.to_bytes();
        assert_eq!(parse(std::str::from_utf8(&written).unwrap()).unwrap(), file);
        assert_eq!(written.split(|&byte| byte == b'\n').count(), text.lines().count() + 1);
    }
    let written = String::from_utf8(parse(PLANE).unwrap().to_bytes()).unwrap();
    for part in ["VERTEX_SE2 1403636579.763555584 A0 ", "VERTEX_SE2 2.50 A1 ", "_XY 1.50 A1 L3 "] {
        assert!(written.contains(part), "{part} in {written}");
    }
}

#[test]
fn a_solved_graph_goes_back_into_its_file() {
    let mut file = plane(PLANE);
    let mut graph = file.to_pose_graph().unwrap();
    graph.poses[1].translation.x = 1.25;
    graph.landmarks.positions[1].y = 2.5;
    file.update_from(&graph).unwrap();
    assert_eq!((file.poses[1].pose[0], file.landmarks[1].position), (1.25, [1.0, 2.5, 0.0]));
    assert_eq!((file.ranges.len(), file.edges[0].covariance[1]), (3, 0.5));
    graph.landmarks.push(7, Vector3::zeros());
    refused(file.update_from(&graph), &["landmarks", "has 3", "2"]);
}

#[test]
fn without_priors_the_first_pose_of_the_file_is_held() {
    let text = "VERTEX_SE2 0 B3 0 0 0\nVERTEX_SE2 1 A0 1 0 0\nEDGE_SE2 0 A0 B3 1 0 0 1 0 0 1 0 1\n";
    assert_eq!(plane(text).to_pose_graph().unwrap().constant, [true, false]);
    assert_eq!(plane(text).robots(), ['A', 'B']);
    let alone = "VERTEX_XY L0 11 19\nVERTEX_XY L1 11 21\nEDGE_RANGE 0.0 L0 L1 2.0 1.0\n";
    let graph = plane(alone).to_pose_graph().unwrap();
    assert_eq!((graph.poses.len(), graph.landmarks.len(), graph.ranges.len()), (0, 2, 1));
    graph.validate().unwrap();
}

#[test]
fn records_may_come_before_the_vertices_that_they_name() {
    let mut lines: Vec<&str> = PLANE.lines().collect();
    lines.reverse();
    let file = plane(&lines.join("\n"));
    assert_eq!((file.poses.len(), file.ranges.len()), (3, 3));
}

#[test]
fn a_graph_without_ranges_goes_through_g2o_at_the_same_cost() {
    for text in [PLANE, SPACE] {
        let without: String = text
            .lines()
            .filter(|l| !l.starts_with("EDGE_RANGE"))
            .map(|l| format!("{l}\n"))
            .collect();
        let file = parse(&without).unwrap();
        let g2o = file.to_g2o().unwrap();
        let again = PyfgGraph::from_g2o(&g2o).unwrap();
        let cost = |file: &PyfgGraph| match file {
            PyfgGraph::Se2(file) => pose_graph_cost(&file.to_pose_graph().unwrap()).total,
            PyfgGraph::Se3(file) => pose_graph_cost(&file.to_pose_graph().unwrap()).total,
        };
        assert!((cost(&again) / cost(&file) - 1.0).abs() < 1e-12);
        assert_eq!(G2oGraph::parse(&g2o.to_bytes(), Path::new("g2o")).unwrap(), g2o);
        refused(parse(text).unwrap().to_g2o(), &["range, record 0", "g2o has no ranges"]);
    }
}

fn of_g2o(text: &str) -> Result<PyfgGraph, IoError> {
    PyfgGraph::from_g2o(&G2oGraph::parse(text.as_bytes(), Path::new("g")).unwrap())
}

#[test]
fn a_g2o_file_gets_names_or_is_refused_for_what_pyfg_lacks() {
    let head = "VERTEX_SE2 4 0 0 0\nVERTEX_SE2 7 1 0 0\nEDGE_SE2 4 7 1 0 0 4 0 0 1 0 1\n";
    let PyfgGraph::Se2(file) = of_g2o(&format!("{head}FIX 4\n")).unwrap() else { panic!("3D") };
    let names: Vec<_> =
        file.poses.iter().map(|pose| format!("{} {}", pose.time, pose.name)).collect();
    assert_eq!(names, ["4 A4", "7 A7"]);
    assert_eq!(file.edges[0].covariance, [0.25, 0.0, 0.0, 1.0, 0.0, 1.0]);
    let bearing = "VERTEX_XY 9 1 1\nEDGE_BEARING_SE2_XY 4 9 0.5 10\n";
    for (more, parts) in [
        ("FIX 7\n", &["pose, record 1", "no fixed variables"][..]),
        ("EDGE_PRIOR_SE2_XY 4 1 2 1 0 1\n", &["no priors on positions of poses"]),
        ("EDGE_SE2 4 7 1 0 0 1 0 0 1 0 0\n", &["edge, record 1", "no inverse"]),
        ("VERTEX_SE2 -1 0 0 0\n", &["pose, record 2", "numbers from 0"]),
        (bearing, &["measurement of a landmark, record 0", "no bearings"]),
    ] {
        refused(of_g2o(&format!("{head}{more}")), parts);
    }
    refused(of_g2o("EDGE_SE2 4 7 1 0 0 4 0 0 1 0 1\n"), &["no vertex"]);
    assert_eq!(G2oSe2::default().vertices.len(), 0);
}

#[test]
fn what_is_wrong_in_a_line_is_named() {
    let plane = |from: &str, to: &str| PLANE.replacen(from, to, 1);
    let table: &[(String, &[&str])] = &[
        (plane("2.50 A1", "2.50 A0"), &["line 2", "vertex A0 occurs twice"]),
        (plane("XY L0", "XY A0"), &["line 4", "vertex A0 occurs twice"]),
        (plane("2.50 A1", "now A1"), &["line 2", "time cannot be `now`"]),
        (plane("2.50 A1", "inf A1"), &["line 2", "time cannot be `inf`"]),
        (plane("2.50 A1", "2.50 A01"), &["line 2", "name cannot be `A01`"]),
        (plane("2.50 A1", "2.50 17"), &["line 2", "name cannot be `17`"]),
        (plane("L0 11.0 19.0", "L0 11.0"), &["line 4", "position[1] is missing"]),
        (plane("L0 11.0 19.0", "L0 11.0 nan"), &["line 4", "position[1] is not finite"]),
        (plane("0 B7 3 1", "0 B8 3 1"), &["line 6", "pose B8 does not exist"]),
        (plane("0.1 0.02 0 0.2", "0.1 0.2 0 0.2"), &["line 6", "covariance", "definite"]),
        (plane("0 L3 1.5", "0 A1 1.5"), &["line 7", "landmark A1 does not exist"]),
        (plane("0.5 0.1 0.25", "0 0 0.25"), &["line 7", "covariance", "close to zero"]),
        (plane("A0 A1 1.0", "A0 L0 1.0"), &["line 8", "pose L0 does not exist"]),
        (plane("A0 A1 1.0", "A1 A1 1.0"), &["line 8", "name A1 is at both ends"]),
        (plane("A1 L3 0.1", "L0 L3 0.1"), &["line 9", "pose L0 does not exist"]),
        (plane("10554 4", "10554 0"), &["line 10", "variance", "positive"]),
        (plane("10554 4", "10554 1e-320"), &["line 10", "variance", "close to zero"]),
        (plane("10554 4", "10554 4 4"), &["line 10", "unexpected `4`"]),
        (plane("A1 L0 21", "A1 L9 21"), &["line 10", "pose or landmark L9 does not exist"]),
        (plane("L0 L3 2 1", "L3 L3 2 1"), &["line 11", "name L3 is at both ends"]),
        (format!("{PLANE}VERTEX_XYZ L9 1 2 3"), &["line 13", "VERTEX_XYZ", "2D"]),
        (format!("{PLANE}EDGE_NEW 1"), &["line 13", "unknown tag `EDGE_NEW`"]),
        (SPACE.replace("0.5 0.5 0.5 0.5", "0.5 0.5 0.5 0.9"), &["line 2", "quaternion", "norm"]),
        ("EDGE_RANGE 0 A0 L0 1 1\n".to_owned(), &["no vertex"]),
        (String::new(), &["no vertex"]),
    ];
    for (text, parts) in table {
        refused(parse(text), parts);
    }
    let text = format!("{PLANE}EDGE_NEW 1\nEDGE_NEW 2\n");
    let read = PyfgGraph::parse(text.as_bytes(), Path::new("graph.pyfg"), true).unwrap();
    assert_eq!(read.1, [("EDGE_NEW".to_owned(), ChangedLines { count: 2, first_line: 13 })]);
}

#[test]
fn any_graph_of_names_is_written_and_read_at_the_same_cost() {
    use covis_solvers::factors::{LandmarkMeasurement, Range, RelativePose};
    use covis_solvers::geometry::{LieGroup, Se3};
    use covis_solvers::information::Information;
    use covis_solvers::problem::PoseGraph;
    let mut rng = seeded(12);
    for _ in 0..20 {
        let mut graph = PoseGraph::<Se3, 6>::new();
        for k in 0..6 {
            graph.push_pose(id(&format!("C{k}")), element(&mut rng, 1.0));
        }
        graph.constant[0] = true;
        let landmark = graph.landmarks.push(id("L5"), uniform_vector(&mut rng, 5.0));
        for k in 1..6 {
            let i_from_j: Se3 = element(&mut rng, 1.0);
            let a = nalgebra::Matrix6::from_fn(|_, _| normal_vector::<1>(&mut rng, 1.0)[0]);
            let information =
                Information::new(&(a * a.transpose() + nalgebra::Matrix6::identity())).unwrap();
            graph.edges.push(RelativePose { i: k - 1, j: k, i_from_j, information, loss: None });
            let ends = [RangeEnd::Landmark(landmark), RangeEnd::Pose(k)];
            let precision = 1.0 + normal_vector::<1>(&mut rng, 1.0)[0].abs();
            graph.ranges.push(Range { ends, distance_m: 3.0, precision, loss: None });
            let a = nalgebra::Matrix3::from_fn(|_, _| normal_vector::<1>(&mut rng, 1.0)[0]);
            let information =
                Information::new(&(a * a.transpose() + nalgebra::Matrix3::identity())).unwrap();
            graph.landmarks.measurements.push(LandmarkMeasurement {
                pose: Some(k),
                landmark,
                sighting: Sighting::Position(normal_vector(&mut rng, 2.0)),
                information,
                loss: None,
            });
        }
        let file = PyfgSe3::from_pose_graph(&graph).unwrap();
        let read = PyfgGraph::parse(&file.to_bytes(), Path::new("made"), false).unwrap().0;
        assert_eq!(read, PyfgGraph::Se3(file.clone()));
        let again = file.to_pose_graph().unwrap();
        assert_eq!((&again.ids, &again.constant), (&graph.ids, &graph.constant));
        let (a, b) = (pose_graph_cost(&graph).total, pose_graph_cost(&again).total);
        assert!((a / b - 1.0).abs() < 1e-11, "{a} {b}");
        assert!(again.poses[3].minus(&graph.poses[3]).norm() < 1e-14);
    }
}
