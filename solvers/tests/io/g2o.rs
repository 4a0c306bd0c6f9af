//! g2o: numbers survive, edges-only files are known as such, bad lines are named.

use std::path::Path;

use covis_solvers::evaluation::pose_graph_cost;
use covis_solvers::geometry::{LieGroup, Se2, Se3};
use covis_solvers::io::IoError;
use covis_solvers::io::g2o::{
    ChangedLines, G2oChanges, G2oGraph, G2oReading, G2oSe2, G2oSe3, Indefinite,
};

use super::data::data;
use super::refused;

const SE2: &str = "# a comment\nVERTEX_SE2 7 0 0 0\n\nVERTEX_SE2 3 1 0.5 0.25\nFIX 3\n\
    EDGE_SE2 7 3 1.1 0.4 0.2 2 0.1 0 3 0 4\n";
const SE3: &str = "VERTEX_SE3:QUAT 0 0 0 0 0 0 0 1\nVERTEX_SE3:QUAT 1 1 2 3 0 0.6 0 0.8\n\
    EDGE_SE3:QUAT 0 1 1 2 3 0 0.6001 0 0.8 1 0 0 0 0 0 2 0 0 0 0 3 0 0 0 4 0 0 5 0 6\n";

pub(super) fn parse(text: &str) -> Result<G2oGraph, IoError> {
    G2oGraph::parse(text.as_bytes(), Path::new("graph.g2o"))
}

/// A file, and what its reader changed.
fn changed(text: &str, indefinite: Indefinite) -> Result<(G2oGraph, G2oChanges), IoError> {
    let reading = G2oReading { indefinite, skip_unknown: false };
    G2oGraph::parse_with(text.as_bytes(), Path::new("graph.g2o"), reading)
}

pub(crate) fn se2() -> G2oSe2 {
    match parse(SE2).unwrap() {
        G2oGraph::Se2(file) => file,
        G2oGraph::Se3(_) => panic!("read as 3D"),
    }
}

pub(crate) fn se3() -> G2oSe3 {
    match parse(SE3).unwrap() {
        G2oGraph::Se3(file) => file,
        G2oGraph::Se2(_) => panic!("read as 2D"),
    }
}

#[test]
fn reads_a_2d_graph() {
    let file = se2();
    let graph = file.to_pose_graph().unwrap();
    assert_eq!(
        (graph.ids.as_slice(), graph.constant.as_slice()),
        (&[7, 3][..], &[false, true][..])
    );
    let edge = &graph.edges[0];
    assert_eq!((edge.i, edge.j), (0, 1));
    assert_eq!(edge.i_from_j, Se2::from_xy_angle(1.1, 0.4, 0.2));
    let matrix = edge.information.matrix();
    assert_eq!((matrix[(0, 0)], matrix[(1, 0)], matrix[(0, 1)]), (2.0, 0.1, 0.1));
    assert_eq!((matrix[(1, 1)], matrix[(2, 2)]), (3.0, 4.0));
}

#[test]
fn reads_a_3d_graph_and_normalizes_only_its_problem() {
    let file = se3();
    assert_eq!(file.edges[0].i_from_j[4], 0.6001, "the file keeps its numbers");
    let graph = file.to_pose_graph().unwrap();
    let edge = &graph.edges[0];
    assert!((edge.i_from_j.rotation.quaternion().norm() - 1.0).abs() < 1e-15);
    let diagonal: Vec<f64> = edge.information.matrix().diagonal().iter().copied().collect();
    assert_eq!(diagonal, [1.0, 2.0, 3.0, 4.0, 5.0, 6.0]);
    let turned = graph.poses[1].rotation.rotate(&nalgebra::Vector3::x());
    assert!((turned - nalgebra::Vector3::new(0.28, 0.0, -0.96)).norm() < 1e-15);
}

#[test]
fn written_files_read_back_equal() {
    for graph in [G2oGraph::Se2(se2()), G2oGraph::Se3(se3())] {
        assert_eq!(G2oGraph::parse(&graph.to_bytes(), Path::new("copy")).unwrap(), graph);
    }
    for name in ["sphere2500", "parking-garage", "M3500", "intel", "CSAIL", "kitti_00"] {
        let Some(path) = data(&format!("pose_graph/{name}.g2o")) else { return };
        let graph = G2oGraph::read(&path).unwrap();
        let folder = tempfile::tempdir().unwrap();
        let copy = folder.path().join("copy.g2o");
        graph.write(&copy).unwrap();
        assert_eq!(G2oGraph::read(&copy).unwrap(), graph, "{name}");
        assert_eq!(graph.has_vertices(), !["CSAIL", "kitti_00"].contains(&name), "{name}");
    }
}

#[test]
fn parameters_that_no_record_uses_are_skipped() {
    let line = "PARAMS_CAMERACALIB 0 0 0 0 0 0 0 1 500 500 320 240\n";
    assert_eq!(parse(&format!("{line}{SE3}")).unwrap(), parse(SE3).unwrap());
    assert_eq!(parse(&format!("{SE2}{line}")).unwrap(), parse(SE2).unwrap());
    let offset = "PARAMS_SE3OFFSET 0 0 0 0 0 0 0 1\n";
    assert_eq!(parse(&format!("{SE2}{offset}")).unwrap(), parse(SE2).unwrap());
    let used = format!("{line}{SE3}EDGE_PROJECT_DEPTH 0 1 0 1 2 3 1 0 0 1 0 1\n");
    refused(parse(&used), &["line 5", "unknown tag `EDGE_PROJECT_DEPTH`"]);
    refused(parse(line), &["no vertex or edge"]);
}

#[test]
fn lines_that_end_in_cr_alone_are_told() {
    refused(parse(&SE2.replace('\n', "\r")), &["graph.g2o: the lines end in CR only"]);
    assert_eq!(parse(&SE2.replace('\n', "\r\n")).unwrap(), parse(SE2).unwrap());
}

#[test]
fn a_file_of_edges_only_takes_its_ids_from_them() {
    let text = "EDGE_SE2 30 -2 1 0 0 1 0 0 1 0 1\n\nEDGE_SE2 5 30 1 0 0 1 0 0 1 0 1\n    \n";
    let G2oGraph::Se2(mut file) = parse(text).unwrap() else { panic!("read as 3D") };
    assert!(!file.has_vertices());
    let mut graph = file.to_pose_graph().unwrap();
    assert_eq!(graph.ids, [-2, 5, 30]);
    assert!(graph.poses.iter().all(|p| *p == Se2::identity()));
    graph.poses[1] = Se2::from_xy_angle(1.0, 2.0, 0.5);
    file.update_from(&graph).unwrap();
    assert_eq!(file.vertices[1].id, 5);
    assert_eq!(file.vertices[1].pose[..2], [1.0, 2.0]);
    assert_eq!(file.to_pose_graph().unwrap().ids, graph.ids);
}

#[test]
fn a_solved_graph_keeps_the_files_objective() {
    let mut file = se3();
    let mut graph = file.to_pose_graph().unwrap();
    let tangent = nalgebra::SVector::from([0.1, -0.2, 0.3, 0.4, 0.5, -0.6]);
    graph.poses[1] = graph.poses[1].plus(&tangent);
    file.update_from(&graph).unwrap();
    let edges = se3().edges;
    assert_eq!(file.edges, edges);
    let (a, b) = (pose_graph_cost(&graph), pose_graph_cost(&file.to_pose_graph().unwrap()));
    assert!((a.total - b.total).abs() <= 1e-14 * a.total);
    let exported = G2oSe3::from_pose_graph(&graph).unwrap().to_pose_graph().unwrap();
    assert!((pose_graph_cost(&exported).total - a.total).abs() <= 1e-14 * a.total);
    graph.edges[0].j = 9;
    refused(G2oSe3::from_pose_graph(&graph), &["edge", "pose is 9", "there are 2"]);
    graph.ids[0] = 77;
    refused(file.update_from(&graph), &["vertex 77"]);
}

#[test]
fn bad_lines_are_refused_by_line_and_field() {
    let edge = "EDGE_SE2 7 3 1.1 0.4 0.2 2 0.1 0 3 0 4";
    let with = |new: &str| SE2.replace(edge, new);
    let quaternion = |q: &str| format!("VERTEX_SE3:QUAT 0 0 0 0 {q}\n");
    let two_bad = format!(
        "{SE2}EDGE_SE2 3 7 0 0 0 1 2 0 1 0 1\nEDGE_SE2 3 7 0 0 0 0 0 0 1 0 1\n\
         EDGE_SE2 3 7 0 0 0 -1 0 0 1 0 1\n"
    );
    let table: &[(String, &[&str])] = &[
        (String::new(), &["graph.g2o", "no vertex or edge"]),
        ("VERTEX_CAM 1 2 3\n".into(), &["line 1", "unknown tag `VERTEX_CAM`"]),
        (SE2.replace("0.25", ""), &["line 4", "pose[2] is missing"]),
        (SE2.replace("0.25", "0.25 9"), &["line 4", "unexpected `9`"]),
        (SE2.replace("0.25", "NaN"), &["line 4", "pose[2] is not finite"]),
        (SE2.replace("SE2 3 1", "SE2 7 1"), &["line 4", "vertex 7 occurs twice"]),
        (SE2.replace("SE2 3 1", "SE2 x 1"), &["line 4", "vertex id", "`x`"]),
        (SE2.replace("FIX 3", "FIX 4"), &["line 5", "vertex 4 does not exist"]),
        (SE2.replace("FIX 3", "FIX"), &["line 5", "vertex id is missing"]),
        (with("EDGE_SE2 7 8 1 0 0 1 0 0 1 0 1"), &["line 6", "vertex 8 does not exist"]),
        (with("EDGE_SE2 7 7 1 0 0 1 0 0 1 0"), &["line 6", "information[5] is missing"]),
        (with("EDGE_SE2 7 3 1 0 0 1 0 0 1 0"), &["line 6", "information[5] is missing"]),
        (with("EDGE_SE2 7 3 1 0 inf 1 0 0 1 0 1"), &["line 6", "measurement[2] is not finite"]),
        (with(SE3.lines().next().unwrap()), &["line 6", "VERTEX_SE3:QUAT", "2D"]),
        (two_bad, &["line 7", "edge 3 to 7", "indefinite", "-1.000e0", "2 such"]),
        (quaternion("0 0 0 0"), &["line 1", "norm 0"]),
        (quaternion("0 0 0 inf"), &["line 1", "pose[6] is not finite"]),
    ];
    for (text, parts) in table {
        refused(parse(text), parts);
    }
}

#[test]
fn a_quaternion_far_from_norm_1_is_normalized_and_told() {
    let zero = "VERTEX_SE3:QUAT 0 0 0 0 0 0 0 0\n";
    refused(parse(zero), &["line 1", "norm 0"]);
    let vertex =
        |q: &str| format!("VERTEX_SE3:QUAT 0 0 0 0 0 0 0 1\nVERTEX_SE3:QUAT 1 5 6 7 {q}\n");
    for q in ["0 1.2 0 1.6", "0 1.2e200 0 1.6e200", "0 0.6e-200 0 0.8e-200", "0 6e-310 0 8e-310"] {
        let (graph, changes) = changed(&vertex(q), Indefinite::Refuse).unwrap();
        assert_eq!(changes.normalized, Some(ChangedLines { count: 1, first_line: 2 }), "{q}");
        let G2oGraph::Se3(file) = &graph else { panic!("read as 2D") };
        let pose = file.vertices[1].pose;
        assert!((pose[4] - 0.6).abs() < 1e-13 && (pose[6] - 0.8).abs() < 1e-13, "{pose:?}");
        assert_eq!((pose[0], pose[1], pose[2]), (5.0, 6.0, 7.0));
        assert!(file.to_pose_graph().is_ok());
        // Written and read again, there is nothing left to change.
        let again = String::from_utf8(graph.to_bytes()).unwrap();
        assert_eq!(changed(&again, Indefinite::Refuse).unwrap(), (graph, G2oChanges::default()));
    }
    let (graph, changes) = changed(&vertex("0 0 0 1.0009"), Indefinite::Refuse).unwrap();
    assert_eq!(changes, G2oChanges::default());
    let G2oGraph::Se3(file) = &graph else { panic!("read as 2D") };
    assert_eq!(file.vertices[1].pose[6], 1.0009, "the file keeps its numbers");
    let edge = SE3.replace("0 0.6001 0 0.8", "0 1.2 0 1.6");
    let two = format!("{edge}{}", edge.lines().last().unwrap());
    let (graph, changes) = changed(&two, Indefinite::Refuse).unwrap();
    assert_eq!(changes.normalized, Some(ChangedLines { count: 2, first_line: 3 }));
    let G2oGraph::Se3(file) = &graph else { panic!("read as 2D") };
    let scaled = pose_graph_cost(&file.to_pose_graph().unwrap()).total;
    assert!((file.edges[0].i_from_j[4] - 0.6).abs() < 1e-15 && scaled < 1e-28);
}

#[test]
fn an_edge_from_a_vertex_to_itself_is_left_out_and_told() {
    let text = SE2.replace("EDGE", "EDGE_SE2 3 3 1 0 0 1 0 0 1 0 1\nEDGE");
    let text = format!("{text}EDGE_SE2 7 7 0 0 0 -1 0 0 1 0 1\n");
    let (graph, changes) = changed(&text, Indefinite::Refuse).unwrap();
    let self_edges = Some(ChangedLines { count: 2, first_line: 6 });
    assert_eq!(changes, G2oChanges { self_edges, ..G2oChanges::default() });
    assert_eq!(graph, parse(SE2).unwrap());
    refused(parse("EDGE_SE2 3 3 1 0 0 1 0 0 1 0 1\n"), &["no vertex or edge"]);
}

#[test]
fn a_graph_filled_by_hand_is_checked_too() {
    let mut file = se3();
    file.edges[0].i_from_j[3..].copy_from_slice(&[0.0; 4]);
    refused(file.to_pose_graph(), &["edge", "record 0", "norm 0"]);
    let mut file = se2();
    file.edges[0].j = file.edges[0].i;
    refused(file.to_pose_graph(), &["edge", "record 0", "connects vertex 7 to itself"]);
    let mut file = se2();
    file.edges[0].information[0] = -1.0;
    refused(file.to_pose_graph(), &["record 0", "edge 7 to 3", "indefinite", "-1.0", "1 such"]);
    let mut file = se2();
    file.edges[0].information[0] = f64::NAN;
    refused(file.to_pose_graph(), &["record 0", "information is not finite"]);
    let mut file = se2();
    file.edges[0].j = 99;
    refused(file.to_pose_graph(), &["vertex 99 does not exist"]);
    let pose: Se3 = se3().to_pose_graph().unwrap().poses[1];
    assert!(pose.is_finite());
}

#[test]
fn singular_information_matrices_are_read_as_they_stand() {
    for information in ["0 0 0 0 0 0", "4 2 0 1 0 0", "1 0 0 1 0 -1e-13", "9 3 6 1 2 4"] {
        let text = format!("EDGE_SE2 0 1 1 0 0 {information}\n");
        let (graph, changes) = changed(&text, Indefinite::Repair).unwrap();
        let unchanged = (parse(&text).unwrap(), G2oChanges::default());
        assert_eq!(unchanged, (graph.clone(), changes), "{information}");
        let G2oGraph::Se2(file) = graph else { panic!("read as 3D") };
        let numbers: Vec<f64> = information.split(' ').map(|n| n.parse().unwrap()).collect();
        assert_eq!(file.edges[0].information[..], numbers);
        let matrix = *file.to_pose_graph().unwrap().edges[0].information.matrix();
        let far = (matrix[(0, 1)] - numbers[1]).abs() + (matrix[(1, 2)] - numbers[4]).abs();
        assert!(far < 1e-13 && matrix[(2, 2)] >= 0.0, "{matrix}");
    }
}

#[test]
fn indefinite_information_matrices_are_repaired_where_asked() {
    let bad = format!("{SE2}EDGE_SE2 3 7 0 0 0 1 2 0 1 0 5\nEDGE_SE2 7 3 0 0 0 2 0 0 -3 0 1\n");
    let (graph, changes) = changed(&bad, Indefinite::Repair).unwrap();
    let repaired = changes.repaired.unwrap();
    assert_eq!((repaired.count, repaired.first_line, repaired.i, repaired.j), (2, 7, 3, 7));
    assert!((repaired.smallest_eigenvalue + 1.0).abs() < 1e-14);
    let G2oGraph::Se2(file) = &graph else { panic!("read as 3D") };
    assert_eq!(file.edges[0], se2().edges[0], "what is right stays");
    for (edge, expected) in
        [(1, [1.5, 1.5, 0.0, 1.5, 0.0, 5.0]), (2, [2.0, 0.0, 0.0, 0.0, 0.0, 1.0])]
    {
        let far = file.edges[edge].information.iter().zip(&expected).map(|(a, b)| (a - b).abs());
        assert!(far.sum::<f64>() < 1e-14, "{:?}", file.edges[edge]);
    }
    // Written and read again, there is nothing left to repair.
    assert_eq!(G2oGraph::parse(&graph.to_bytes(), Path::new("copy")).unwrap(), graph);
}

/// Sums of entries near the largest number overflow; a repair must not write what is no number.
#[test]
fn what_was_repaired_needs_no_repair_whatever_its_scales() {
    let large = "5".repeat(130);
    let information = format!("1 9 0 0 0 0 1 {large} 0 0 0 1 0 0 7 1 2 0 0 0 0");
    let text = format!("EDGE_SE3:QUAT 0 7 1 2 3 0 0 0.6 0.8 {information}\n");
    let path = Path::new("graph.g2o");
    let (graph, changes) = changed(&text, Indefinite::Repair).unwrap();
    assert_eq!(changes.repaired.unwrap().count, 1);
    assert_eq!(G2oGraph::parse(&graph.to_bytes(), path).unwrap(), graph);
}

#[test]
fn a_repair_of_the_largest_numbers_is_finite_or_refused() {
    for information in ["1e30 18e300 -1e-308 1e308 5e-324 1e308", "0 1.7e308 0 1.7e308 0 1"] {
        let text = format!("EDGE_SE2 0 1 1 0 0.1 {information}\n");
        match changed(&text, Indefinite::Repair) {
            Ok((graph, _)) => {
                assert_eq!(G2oGraph::parse(&graph.to_bytes(), Path::new("")).unwrap(), graph)
            }
            Err(error) => assert!(matches!(error, IoError::NotFinite { .. }), "{error}"),
        }
    }
}

#[test]
fn unknown_tags_are_skipped_and_counted_where_asked() {
    let text = SE2.replace("FIX", "ROBOTLASER1 1 2 3\nROBOTLASER1 4\nVERTEX_CAM 1\nFIX");
    refused(parse(&text), &["line 5", "unknown tag `ROBOTLASER1`"]);
    let reading = G2oReading { skip_unknown: true, ..G2oReading::default() };
    let (graph, changes) =
        G2oGraph::parse_with(text.as_bytes(), Path::new("graph.g2o"), reading).unwrap();
    assert_eq!(graph, parse(SE2).unwrap());
    let skipped = [
        ("ROBOTLASER1".to_owned(), ChangedLines { count: 2, first_line: 5 }),
        ("VERTEX_CAM".to_owned(), ChangedLines { count: 1, first_line: 7 }),
    ];
    assert_eq!(changes.skipped, skipped);
}

#[test]
fn toro_is_read_with_its_own_order_of_information_and_its_own_angles() {
    let text =
        "VERTEX2 7 0 0 0\nVERTEX2 3 1 0.5 0.25\nEDGE2 7 3 1.1 0.4 0.2 11 12 22 33 0.13 0.23\n";
    let G2oGraph::Se2(file) = parse(text).unwrap() else { panic!("read as 3D") };
    assert_eq!(
        file.vertices,
        [7, 3].map(|id| *se2().vertices.iter().find(|v| v.id == id).unwrap())
    );
    assert_eq!(file.edges[0].information, [11.0, 12.0, 0.13, 22.0, 0.23, 33.0]);
    assert_eq!(file.edges[0].i_from_j, [1.1, 0.4, 0.2]);
    let text = "VERTEX3 0 0 0 0 0 0 0\nVERTEX3 1 1 2 3 0.3 -0.5 1.2\n\
        EDGE3 0 1 1 2 3 0.3 -0.5 1.2 1 0 0 0 0 0 2 0 0 0 0 3 0 0 0 4 0 0 5 0 6\n";
    let G2oGraph::Se3(file) = parse(text).unwrap() else { panic!("read as 2D") };
    let pose: Se3 = file.to_pose_graph().unwrap().poses[1];
    let turn = |axis: [f64; 3], angle: f64| {
        let [x, y, z] = axis.map(|a| a * angle);
        Se3::exp(&nalgebra::SVector::from([0.0, 0.0, 0.0, x, y, z]))
    };
    let turned = turn([0.0, 0.0, 1.0], 1.2)
        .compose(&turn([0.0, 1.0, 0.0], -0.5))
        .compose(&turn([1.0, 0.0, 0.0], 0.3));
    assert!((turned.rotation.matrix() - pose.rotation.matrix()).norm() < 1e-14);
    assert_eq!(file.edges[0].i_from_j, file.vertices[1].pose);
    assert_eq!(file.edges[0].information, se3().edges[0].information);
    // It is written as g2o.
    let written = String::from_utf8(file.to_bytes()).unwrap();
    assert!(
        written.starts_with("VERTEX_SE3:QUAT 0 ")
            && parse(&written).unwrap() == G2oGraph::Se3(file)
    );
    refused(parse("EDGE2 0 1 1 0 0 1 0 1 1 0\n"), &["line 1", "information[5] is missing"]);
    refused(parse("VERTEX3 0 0 0 0 0 0\n"), &["line 1", "pose[5] is missing"]);
    // g2o's order in TORO's lines has no such matrix.
    refused(parse("EDGE2 0 1 1 0 0 3 0 0 3 0 5\n"), &["line 1", "indefinite"]);
}
