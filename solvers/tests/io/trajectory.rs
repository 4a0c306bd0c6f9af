//! TUM trajectories: exact round trips, bad lines named.

use std::path::Path;

use covis_solvers::io::IoError;
use covis_solvers::io::trajectory::Trajectory;

use super::data::data;
use super::refused;

fn parse(text: &str) -> Result<Trajectory, IoError> {
    Trajectory::parse(text.as_bytes(), Path::new("t.txt"))
}

#[test]
fn reads_and_writes_every_digit() {
    let text = "# head\n\n1311868164.363181 1 -2 3e-7 0 0.6 0 0.8\r\n  1311868164.4 0 0 0 0 0 0 -1";
    let trajectory = parse(text).unwrap();
    assert_eq!(trajectory.timestamps, [1311868164.363181, 1311868164.4]);
    assert_eq!(trajectory.world_from_body[0].translation, nalgebra::Vector3::new(1.0, -2.0, 3e-7));
    assert_eq!(trajectory.world_from_body[0].rotation.quaternion().j, 0.6);
    let bytes = trajectory.to_bytes();
    assert!(String::from_utf8_lossy(&bytes).contains("\n1311868164.363181 1.0 -2.0 3e-7 0.0 0.6 "));
    assert_eq!(Trajectory::parse(&bytes, Path::new("copy")).unwrap(), trajectory);
    assert!(parse("# nothing\n").unwrap().is_empty());
}

#[test]
fn real_trajectories_survive() {
    for (name, count) in [("fr2_desk_ORB", 2893), ("freiburg1_xyz-groundtruth", 3000)] {
        let Some(path) = data(&format!("trajectories/{name}.txt")) else { return };
        let trajectory = Trajectory::read(&path).unwrap();
        assert_eq!(trajectory.len(), count, "{name}");
        let folder = tempfile::tempdir().unwrap();
        let copy = folder.path().join("copy.txt");
        trajectory.write(&copy).unwrap();
        assert_eq!(Trajectory::read(&copy).unwrap(), trajectory, "{name}");
    }
}

#[test]
fn bad_lines_are_refused_by_line_and_field() {
    let table: &[(&str, &[&str])] = &[
        ("1 2 3\n", &["t.txt, line 1", "translation[2] is missing"]),
        ("#\n1 2 3 4 0 0 0 1 5\n", &["line 2", "`5` follows"]),
        ("1 2 3 4 0 0 0 0\n", &["line 1", "norm 0"]),
        ("1 2 3 4 0 0 1 1\n", &["line 1", "norm 1.41"]),
        ("1 2 nan 4 0 0 0 1\n", &["line 1", "translation[1] is not finite"]),
        ("inf 2 3 4 0 0 0 1\n", &["line 1", "timestamp is not finite"]),
        ("1 2 3 4 0 0 0 1\n1,2 3\n", &["line 2", "timestamp", "`1,2`"]),
    ];
    for (text, parts) in table {
        refused(parse(text), parts);
    }
}
