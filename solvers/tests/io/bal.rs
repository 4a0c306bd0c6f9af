//! BAL: numbers survive, conventions are converted there and back, bad files are named.

use std::path::Path;

use covis_solvers::evaluation::bundle_cost;
use covis_solvers::geometry::{Camera, KannalaBrandt};
use covis_solvers::io::bal::{BalFile, BalObservation};

use super::data::data;
use super::refused;

const SMALL: &str = "1 2 3\n0 0 1.5 -2\n0 1 3 4e0\n0 0 0.1 0.2\n\
    0.1\n0.2\n0.3\n1\n2\n3\n500\n-0.1\n0.01\n1 2 -3\n4\n5 6\n";

pub(crate) fn small() -> BalFile {
    parse(SMALL).unwrap()
}

fn parse(text: &str) -> Result<BalFile, covis_solvers::io::IoError> {
    BalFile::parse(text.as_bytes(), Path::new("small.txt"))
}

#[test]
fn reads_the_numbers_where_they_stand() {
    let file = small();
    assert_eq!(file.cameras, [[0.1, 0.2, 0.3, 1.0, 2.0, 3.0, 500.0, -0.1, 0.01]]);
    assert_eq!(file.points, [[1.0, 2.0, -3.0], [4.0, 5.0, 6.0]]);
    assert_eq!(file.observations[1], BalObservation { camera: 0, point: 1, u: 3.0, v: 4.0 });
    let crlf = SMALL.replace('\n', "\r\n");
    assert_eq!(parse(&crlf).unwrap(), file);
}

#[test]
fn written_files_read_back_equal() {
    let mut file = small();
    file.cameras[0][0] = 0.1 + 0.2;
    file.points[0] = [f64::MIN_POSITIVE, 5e-324, -f64::MAX];
    assert_eq!(BalFile::parse(&file.to_bytes(), Path::new("copy")).unwrap(), file);
    for name in ["ladybug-49-7776", "trafalgar-21-11315", "dubrovnik-3-7"] {
        let Some(path) = data(&format!("bal/{name}.txt")) else { return };
        let file = BalFile::read(&path).unwrap();
        let folder = tempfile::tempdir().unwrap();
        let copy = folder.path().join("copy.txt");
        file.write(&copy).unwrap();
        assert_eq!(BalFile::read(&copy).unwrap(), file);
    }
}

#[test]
fn axes_are_flipped_on_import() {
    // A camera at the origin looks down -z; the point is right of and above its axis, so the
    // measured u and v are positive in BAL and v is negative (rows grow downwards) in covis.
    let text = "1 1 1\n0 0 5 10\n0 0 0 0 0 0 100 0 0 0.1 0.2 -2";
    let problem = parse(text).unwrap().to_problem();
    let point_in_camera = problem.poses[0].inverse_transform(&problem.landmarks[0]);
    assert!((point_in_camera - nalgebra::Vector3::new(0.1, -0.2, 2.0)).norm() < 1e-15);
    assert_eq!(problem.landmarks[0].z, -2.0, "the world stays as it is");
    assert_eq!(problem.reprojections.pixels[0], nalgebra::Vector2::new(5.0, -10.0));
    assert!(bundle_cost(&problem).total < 1e-24);
    assert_eq!(problem.behind_camera_count(), 0);
}

#[test]
fn conversion_there_and_back_keeps_numbers_and_cost() {
    let mut files = vec![small()];
    if let Some(path) = data("bal/ladybug-49-7776.txt") {
        files.push(BalFile::read(&path).unwrap());
    }
    for file in files {
        let problem = file.to_problem();
        let mut copy = file.clone();
        copy.update_from(&problem).unwrap();
        for (a, b) in copy.cameras.iter().flatten().zip(file.cameras.iter().flatten()) {
            assert!((a - b).abs() <= 1e-13 * (1.0 + b.abs()), "{a} {b}");
        }
        assert_eq!(copy.points, file.points);
        assert_eq!(copy.observations, file.observations);
        let (before, after) = (bundle_cost(&problem), bundle_cost(&copy.to_problem()));
        assert!((before.total - after.total).abs() <= 1e-11 * before.total);
    }
}

#[test]
fn update_refuses_another_problem() {
    let mut file = small();
    let mut problem = file.to_problem();
    problem.landmarks.pop();
    refused(file.update_from(&problem), &["landmarks", "has 1", "file 2"]);
    let mut problem = file.to_problem();
    let (fx, fy, cx, cy) = (1.0, 1.0, 0.0, 0.0);
    problem.cameras[0] =
        Camera::Fisheye(KannalaBrandt { fx, fy, cx, cy, k1: 0.0, k2: 0.0, k3: 0.0, k4: 0.0 });
    refused(file.update_from(&problem), &["camera 0", "Fisheye"]);
    assert_eq!(file, small());
}

#[test]
fn bad_files_are_refused_by_line_and_field() {
    let table: &[(String, &[&str])] = &[
        (String::new(), &["small.txt, line 1", "camera count", "missing"]),
        ("1 2".into(), &["line 1", "observation count", "missing"]),
        ("1 -2 3".into(), &["line 1", "point count", "`-2`"]),
        ("1 2 4000000000\n0 0 1 2\n".into(), &["observation count", "4000000000", "at most 1"]),
        ("900000 2 1\n0 0 1 2\n0 0 0 0 0 0".into(), &["camera count says 900000"]),
        ("0 4294967295 0\n".into(), &["point count says 4294967295", "at most 0"]),
        (SMALL.replace("0 1 3 4e0", "1 1 3 4e0"), &["line 3", "observation 1 camera is 1"]),
        (SMALL.replace("0 1 3 4e0", "0 2 3 4e0"), &["line 3", "observation 1 point is 2"]),
        (SMALL.replace("0 1 3 4e0", "0 1 3 4e0x"), &["line 3", "observation 1 v", "`4e0x`"]),
        (SMALL.replace("4e0", "nan"), &["line 3", "observation 1 v is not finite"]),
        (SMALL.replace("500", "1e999"), &["line 11", "camera 0[6] is not finite"]),
        (SMALL.replace("5 6", "5 -inf"), &["line 16", "point 1[2] is not finite"]),
        (SMALL.replace("4\n5 6\n", "4\n5\n"), &["line 17", "point 1[2] is missing"]),
        (format!("{SMALL}\n7 8\n"), &["line 18", "unexpected `7`"]),
        (SMALL.replace("500", "\u{1}\u{2}"), &["line 11", "camera 0[6]", "`??`"]),
    ];
    for (text, parts) in table {
        refused(parse(text), parts);
    }
    refused(BalFile::read(Path::new("no/such/file")), &["no/such/file", "cannot be read"]);
}
