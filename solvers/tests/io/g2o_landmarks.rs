//! g2o: landmarks, sensor offsets and priors survive reading and writing,
//! and cost what the file says.

use std::path::Path;

use covis_solvers::evaluation::pose_graph_cost;
use covis_solvers::factors::{Range, RangeEnd};
use covis_solvers::geometry::{LieGroup, Se3};
use covis_solvers::io::g2o::{G2oGraph, G2oPose, G2oSe2, G2oSe3};

use super::g2o::parse;
use super::refused;

pub(crate) const PLANE: &str = "VERTEX_SE2 7 0 0 0\nVERTEX_SE2 3 1 0.5 0.25\nVERTEX_XY 40 2 3\nFIX 40 7\n\
    EDGE_SE2 7 3 1.1 0.4 0.2 2 0.1 0 3 0 4\nEDGE_SE2_XY 3 40 1.5 2 4 1 9\n\
    EDGE_BEARING_SE2_XY 7 40 0.9 100\nEDGE_PRIOR_SE2 3 1 0.5 0.2 2 0.1 0 3 0 4\n\
    EDGE_PRIOR_SE2_XY 7 0.1 0.2 4 1 9\nEDGE_PRIOR_SE2_XY 40 2.1 3.2 4 1 9\n";
pub(crate) const SOLID: &str = "PARAMS_SE3OFFSET 5 0.1 0.2 0.3 0 0.6 0 0.8\nVERTEX_SE3:QUAT 0 0 0 0 0 0 0 1\n\
    VERTEX_SE3:QUAT 1 1 2 3 0 0.6 0 0.8\nVERTEX_TRACKXYZ 9 4 5 6\n\
    EDGE_SE3:QUAT 0 1 1 2 3 0 0.6 0 0.8 1 0 0 0 0 0 2 0 0 0 0 3 0 0 0 4 0 0 5 0 6\n\
    EDGE_SE3_TRACKXYZ 1 9 5 1 2 3 4 1 0 5 1 6\n\
    EDGE_SE3_PRIOR 0 5 0 0 1 0 0.6 0 0.8 1 0 0 0 0 0 2 0 0 0 0 3 0 0 0 4 0 0 5 0 6\n\
    EDGE_SE3_XYZ_PRIOR 1 5 1 2 3 4 1 0 5 1 6\nEDGE_POINTXYZ_PRIOR 9 4 5 6 4 1 0 5 1 6\n";

#[test]
fn landmarks_priors_and_offsets_read_back_as_they_were_written() {
    for text in [PLANE, SOLID] {
        let graph = parse(text).unwrap();
        let written = String::from_utf8(graph.to_bytes()).unwrap();
        assert_eq!(parse(&written).unwrap(), graph);
        let tags = |text: &str| {
            let mut tags: Vec<String> =
                text.lines().map(|line| line.split(' ').next().unwrap().to_owned()).collect();
            tags.sort_unstable();
            tags.dedup();
            tags
        };
        assert_eq!(tags(&written), tags(text));
    }
    let alias = PLANE.replace("EDGE_PRIOR_SE2 ", "EDGE_SE2_PRIOR ");
    assert_eq!(parse(&alias).unwrap(), parse(PLANE).unwrap());
}

#[test]
fn fixed_landmarks_and_priors_become_factors() {
    let G2oGraph::Se2(file) = parse(PLANE).unwrap() else { panic!("read as 3D") };
    let graph = file.to_pose_graph().unwrap();
    assert_eq!(
        (&graph.constant[..], &graph.landmarks.constant[..]),
        (&[true, false][..], &[true][..])
    );
    // Two sightings, and the prior of the landmark itself.
    let poses: Vec<_> = graph.landmarks.measurements.iter().map(|m| m.pose).collect();
    assert_eq!(poses, [Some(1), Some(0), None]);
    let omega = graph.landmarks.measurements[0].information.matrix();
    assert_eq!((omega[(0, 0)], omega[(1, 0)], omega[(1, 1)], omega[(2, 2)]), (4.0, 1.0, 9.0, 0.0));
    assert_eq!((graph.pose_priors.len(), graph.position_priors.len()), (1, 1));
    graph.validate().unwrap();
}

/// What a sensor measures costs as much as the file says, whatever its place on the pose.
#[test]
fn an_offset_of_a_sensor_changes_no_cost() {
    let G2oGraph::Se3(file) = parse(SOLID).unwrap() else { panic!("read as 2D") };
    let graph = file.to_pose_graph().unwrap();
    let sensor = Se3::from_numbers(&file.offsets[0].pose_from_sensor).unwrap();
    let symmetric = |upper: &[f64]| {
        let size = if upper.len() == 6 { 3 } else { 6 };
        let mut matrix = nalgebra::DMatrix::<f64>::zeros(size, size);
        let at = (0..size).flat_map(|r| (r..size).map(move |c| (r, c)));
        at.zip(upper).for_each(|((r, c), &x)| {
            matrix[(r, c)] = x;
            matrix[(c, r)] = x;
        });
        matrix
    };
    let seen = sensor
        .inverse()
        .compose(&graph.poses[1].inverse())
        .act(&nalgebra::Vector3::new(4.0, 5.0, 6.0));
    let residual = seen - nalgebra::Vector3::new(1.0, 2.0, 3.0);
    let expected =
        (residual.transpose() * symmetric(&file.sightings[0].information) * residual)[(0, 0)];
    let found = graph.landmarks.chi2(&graph.landmarks.measurements[0], &graph.poses);
    assert!((found / expected - 1.0).abs() < 1e-13, "{found} {expected}");
    let measured = Se3::from_numbers(&file.pose_priors[0].world_from_sensor).unwrap();
    let residual = graph.poses[0].compose(&sensor).minus(&measured);
    let expected =
        (residual.transpose() * symmetric(&file.pose_priors[0].information) * residual)[(0, 0)];
    let found = graph.pose_priors[0].chi2(&graph.poses[0]);
    assert!((found / expected - 1.0).abs() < 1e-13, "{found} {expected}");
}

#[test]
fn a_graph_with_landmarks_and_priors_becomes_a_file_of_the_same_cost() {
    for text in [PLANE, SOLID] {
        let (a, b) = match parse(text).unwrap() {
            G2oGraph::Se2(file) => {
                let graph = file.to_pose_graph().unwrap();
                let made = G2oSe2::from_pose_graph(&graph).unwrap();
                let again = G2oGraph::parse(&made.to_bytes(), Path::new("made")).unwrap();
                assert_eq!(again, G2oGraph::Se2(made.clone()));
                (pose_graph_cost(&graph), pose_graph_cost(&made.to_pose_graph().unwrap()))
            }
            G2oGraph::Se3(file) => {
                let mut graph = file.to_pose_graph().unwrap();
                let made = G2oSe3::from_pose_graph(&graph).unwrap();
                let again = G2oGraph::parse(&made.to_bytes(), Path::new("made")).unwrap();
                assert_eq!(again, G2oGraph::Se3(made.clone()));
                let costs =
                    (pose_graph_cost(&graph), pose_graph_cost(&made.to_pose_graph().unwrap()));
                let ends = [RangeEnd::Pose(0), RangeEnd::Pose(1)];
                let (distance_m, precision, loss) = (3.0, 1.0, None);
                graph.ranges.push(Range { ends, distance_m, precision, loss });
                let refusal = G2oSe3::from_pose_graph(&graph);
                refused(refusal, &["range", "record 0", "no ranges"]);
                costs
            }
        };
        assert!(a.landmark.count > 0 && a.position_prior.count > 0 && a.pose_prior.count > 0);
        assert_eq!(a.landmark.count, b.landmark.count);
        assert!((a.total / b.total - 1.0).abs() < 1e-13, "{} {}", a.total, b.total);
    }
}

#[test]
fn a_solved_graph_takes_its_landmarks_to_the_file() {
    let G2oGraph::Se2(mut file) = parse(PLANE).unwrap() else { panic!("read as 3D") };
    let mut graph = file.to_pose_graph().unwrap();
    graph.landmarks.positions[0].y = 8.5;
    file.update_from(&graph).unwrap();
    assert_eq!(file.points[0].position, [2.0, 8.5, 0.0]);
    assert_eq!(file.sightings.len(), 2);
    graph.landmarks.ids[0] = 41;
    refused(file.update_from(&graph), &["vertex 41"]);
}

#[test]
fn a_file_without_vertices_has_the_landmarks_that_it_measures_by_position() {
    let text = "EDGE_SE2 0 1 1 0 0 1 0 0 1 0 1\nEDGE_SE2_XY 1 40 1 2 1 0 1\n";
    let G2oGraph::Se2(mut file) = parse(text).unwrap() else { panic!("read as 3D") };
    let graph = file.to_pose_graph().unwrap();
    assert_eq!((&graph.ids[..], &graph.landmarks.ids[..]), (&[0, 1][..], &[40][..]));
    file.update_from(&graph).unwrap();
    assert_eq!((file.vertices.len(), file.points.len()), (2, 1));
    let bearing = text.replace("EDGE_SE2_XY 1 40 1 2 1 0 1", "EDGE_BEARING_SE2_XY 1 40 1 2");
    refused(parse(&bearing), &["line 2", "landmark 40 does not exist"]);
    let both = text.replace("1 40", "1 0");
    refused(parse(&both), &["line 2", "vertex 0 occurs twice"]);
}

#[test]
fn lines_of_landmarks_and_priors_are_refused_by_line_and_field() {
    let plane = |from: &str, to: &str| PLANE.replace(from, to);
    let solid = |from: &str, to: &str| SOLID.replace(from, to);
    let table: &[(String, &[&str])] = &[
        (plane("XY 40 2 3", "XY 3 2 3"), &["line 3", "vertex 3 occurs twice"]),
        (plane("XY 40 2 3", "XY 40 2"), &["line 3", "position[1] is missing"]),
        (plane("FIX 40 7", "FIX 41"), &["line 4", "vertex 41 does not exist"]),
        (plane("SE2_XY 3 40", "SE2_XY 3 7"), &["line 6", "landmark 7 does not exist"]),
        (plane("SE2_XY 3 40", "SE2_XY 40 40"), &["line 6", "pose 40 does not exist"]),
        (plane("1.5 2 4 1 9", "1.5 2 4 7 9"), &["line 6", "edge 3 to 40", "indefinite"]),
        (plane("0.9 100", "0.9 -1"), &["line 7", "indefinite", "-1.0"]),
        (plane("0.9 100", "0.9 x"), &["line 7", "information[0]", "`x`"]),
        (plane("SE2_XY 7 0.1", "SE2_XY 8 0.1"), &["line 9", "vertex 8 does not exist"]),
        (solid("TRACKXYZ 1 9 5", "TRACKXYZ 1 9 6"), &["line 6", "parameter 6 does not exist"]),
        (solid("PRIOR 0 5", "PRIOR 0 4"), &["line 7", "parameter 4 does not exist"]),
        (solid("PRIOR 0 5", "PRIOR 9 5"), &["line 7", "pose 9 does not exist"]),
        (
            format!("{SOLID}{}", SOLID.lines().next().unwrap()),
            &["line 10", "parameter 5 occurs twice"],
        ),
        (format!("{PLANE}VERTEX_TRACKXYZ 50 1 2 3"), &["line 11", "VERTEX_TRACKXYZ", "2D"]),
    ];
    for (text, parts) in table {
        refused(parse(text), parts);
    }
}
