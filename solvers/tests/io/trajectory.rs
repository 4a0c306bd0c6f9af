//! Trajectories: round trips in each format, bad lines named.

use std::path::Path;

use covis_solvers::geometry::{LieGroup, Se3};
use covis_solvers::io::IoError;
use covis_solvers::io::format::Format;
use covis_solvers::io::trajectory::{Trajectory, TrajectoryFormat, read_times};
use proptest::prelude::*;

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
        ("#\n1 2 3 4 0 0 0 1 5\n", &["line 2", "unexpected `5`"]),
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

fn parse_as(text: &str, format: TrajectoryFormat) -> Result<Trajectory, IoError> {
    Trajectory::parse_as(text.as_bytes(), Path::new("t.txt"), format)
}

#[test]
fn kitti_and_euroc_are_read_where_they_stand() {
    let kitti = "1 0 0 5 0 0 -1 6 0 1 0 7\n\n1 0 0 0 0 1 0 0 0 0 1 0\n";
    let read = parse_as(kitti, TrajectoryFormat::Kitti).unwrap();
    assert_eq!(read.timestamps, [0.0, 1.0], "rows are numbered");
    let moved = read.world_from_body[0].transform(&nalgebra::Vector3::new(0.0, 0.0, 1.0));
    assert!((moved - nalgebra::Vector3::new(5.0, 5.0, 7.0)).norm() < 1e-15, "{moved}");
    let euroc = "#timestamp [ns], p_x [m]\n1403636580838555648, 1,-2 ,3,0.8,0,0.6,0,0.1,nan,x\r\n";
    let read = parse_as(euroc, TrajectoryFormat::Euroc).unwrap();
    assert_eq!(read.timestamps, [1403636580.8385556]);
    assert_eq!(read.world_from_body[0].translation, nalgebra::Vector3::new(1.0, -2.0, 3.0));
    assert_eq!(read.world_from_body[0].rotation.quaternion().j, 0.6);
    let written = String::from_utf8(read.to_bytes_as(TrajectoryFormat::Euroc).unwrap()).unwrap();
    assert!(written.contains("\n1403636580838555648,1.0,-2.0,3.0,0.8,0.0,0.6,0.0\n"), "{written}");
    for (text, format) in [(kitti, TrajectoryFormat::Kitti), (euroc, TrajectoryFormat::Euroc)] {
        assert_eq!(TrajectoryFormat::of_bytes(text.as_bytes()), format);
    }
}

#[test]
fn bad_lines_of_kitti_and_euroc_are_refused_by_line_and_field() {
    let (kitti, euroc) = (TrajectoryFormat::Kitti, TrajectoryFormat::Euroc);
    let table: &[(TrajectoryFormat, &str, &[&str])] = &[
        (kitti, "1 0 0 5 0 0 -1 6 0 1 0\n", &["t.txt, line 1", "row 2[3] is missing"]),
        (kitti, "#\n1 0 0 5 0 0 -1 6 0 1 0 7 8\n", &["line 2", "unexpected `8`"]),
        (kitti, "1 0 0 5 0 0 1 6 0 1 0 7\n", &["line 1", "not a rigid motion"]),
        (kitti, "1 0 0 x 0 0 -1 6 0 1 0 7\n", &["line 1", "row 0[3]", "`x`"]),
        (euroc, "1,2,3\n", &["line 1", "position[2] is missing"]),
        (euroc, "1,2,,3,1,0,0,0\n", &["line 1", "position[1] cannot be ``"]),
        (euroc, "#\n1,2,3,4,0,0,0,0\n", &["line 2", "norm 0"]),
        (euroc, "1,2,inf,4,1,0,0,0\n", &["line 1", "position[1] is not finite"]),
    ];
    for (format, text, parts) in table {
        refused(parse_as(text, *format), parts);
    }
    let mut late = Trajectory::default();
    late.push(1e10, Se3::identity());
    refused(late.to_bytes_as(euroc), &["pose 0", "nanoseconds"]);
}

#[test]
fn times_beside_a_kitti_file_are_one_a_line() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("times.txt");
    fs_err::write(&path, "0.000000e+00\n1.037e-01\n").unwrap();
    assert_eq!(read_times(&path).unwrap(), [0.0, 0.1037]);
    fs_err::write(&path, "0 1\n").unwrap();
    refused(read_times(&path), &["times.txt, line 1", "unexpected `1`"]);
}

/// Poses in TUM's columns, each number between `separator`s.
fn table(separator: &str, times: &[&str]) -> String {
    let rows = times.iter().map(|t| {
        let numbers = [*t, "1", "2", "3", "0.1", "0.2", "0.3", "0.9273618495495704"];
        numbers.join(separator)
    });
    rows.collect::<Vec<_>>().join("\n")
}

#[test]
fn a_comma_makes_no_file_euroc() {
    let seconds = ["1305031102.175304", "1305031102.275304"];
    let plain = parse(&table(" ", &seconds)).unwrap();
    for separator in [",", ", ", " , "] {
        for head in ["", "#timestamp,tx,ty,tz,qx,qy,qz,qw\n"] {
            let text = format!("{head}{}\n", table(separator, &seconds));
            for name in ["a.txt", "a.csv", "a.tum", "a"] {
                let format = Format::of_file(Path::new(name), text.as_bytes());
                assert_eq!(format, Format::Trajectory(TrajectoryFormat::Tum), "{name}: {text}");
            }
            assert_eq!(parse(&text).unwrap(), plain, "{text}");
            refused(parse_as(&text, TrajectoryFormat::Euroc), &["t.txt, line", "looks like a TUM"]);
        }
    }
}

#[test]
fn the_times_of_a_table_tell_its_format_then_its_header() {
    use TrajectoryFormat::{Euroc, Tum};
    let told = |head: &str, times: &[&str]| {
        TrajectoryFormat::of_bytes(format!("{head}{}", table(",", times)).as_bytes())
    };
    assert_eq!(told("", &["1403636580838555648"]), Euroc);
    assert_eq!(told("", &["1403636580838555648.000000"]), Euroc, "whole, with a point");
    assert_eq!(told("", &["0", "50000000", "100000000"]), Euroc, "from 0, at 20 Hz");
    assert_eq!(told("", &["0", "1", "2"]), Tum, "whole seconds");
    assert_eq!(told("", &["0", "0.05", "0.1"]), Tum);
    assert_eq!(told("# timestamp [ns]\n", &["0", "1"]), Euroc);
    assert_eq!(told("#timestamp [s]\n", &["0", "20000"]), Tum);
    assert_eq!(told("#t, x, y, z, q_RS_w [], q_RS_x []\n", &["7"]), Euroc);
    assert_eq!(told("#t, x, y, z, qx, qy, qz, qw\n", &["7"]), Tum);
    assert_eq!(told("", &["7"]), Euroc, "nothing tells");
}

#[test]
fn a_quaternion_that_the_header_orders_otherwise_is_refused() {
    let ns = ["1403636580838555648"];
    let x_first = format!("#time [ns],tx,ty,tz,qx,qy,qz,qw\n{}", table(",", &ns));
    refused(parse_as(&x_first, TrajectoryFormat::Euroc), &["t.txt", "x, y, z, w", "EuRoC's is w"]);
    for separator in [",", " "] {
        let names = ["#time", "tx", "ty", "tz", "qw", "qx", "qy", "qz"].join(separator);
        let w_first = format!("{names}\n{}", table(separator, &["1.5"]));
        refused(parse(&w_first), &["t.txt", "w, x, y, z", "TUM's is x, y, z, w"]);
    }
}

#[test]
fn a_file_of_another_form_is_refused_as_what_it_is() {
    let (kitti, tum) = ("1 0 0 5 0 0 -1 6 0 1 0 7\n", "1.5 1 2 3 0 0 0 1\n");
    refused(parse(kitti), &["line 1", "12 numbers", "looks like KITTI"]);
    refused(parse(&format!("{tum}{kitti}")), &["line 2", "12 numbers"]);
    refused(parse_as(tum, TrajectoryFormat::Kitti), &["line 1", "8 numbers", "looks like a TUM"]);
    for format in [TrajectoryFormat::Tum, TrajectoryFormat::Kitti, TrajectoryFormat::Euroc] {
        for text in ["# t\r1.5 1 2 3 0 0 0 1\r", "1.5 1 2 3 0 0 0 1\r2.5 1 2 3 0 0 0 1"] {
            refused(parse_as(text, format), &["t.txt: the lines end in CR only"]);
        }
        let gzip = Trajectory::parse_as(b"\x1f\x8b\x08,", Path::new("t.gz"), format);
        refused(gzip, &["t.gz", "compressed (gzip)", "gunzip t.gz"]);
        for (text, what) in [("", "is empty"), (" \n", "is empty"), ("# t\n", "only comments")] {
            let read = Trajectory::parse_poses_as(text.as_bytes(), Path::new("t.txt"), format);
            refused(read, &["t.txt: there is no pose", what]);
            assert!(parse_as(text, format).unwrap().is_empty());
        }
    }
    assert_eq!(parse("1.5 1 2 3 0 0 0 1\r").unwrap().len(), 1, "one line");
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 4096, failure_persistence: None, ..Default::default() })]

    #[test]
    fn nanoseconds_of_this_century_come_back_within_their_spacing(
        nanoseconds in (1i64 << 30) * 1_000_000_000..(1i64 << 31) * 1_000_000_000,
    ) {
        let euroc = format!("{nanoseconds},1,2,3,1,0,0,0\n");
        let read = parse_as(&euroc, TrajectoryFormat::Euroc).unwrap();
        let through_tum = parse(&String::from_utf8(read.to_bytes()).unwrap()).unwrap();
        let written = through_tum.to_bytes_as(TrajectoryFormat::Euroc).unwrap();
        let row = String::from_utf8(written).unwrap().lines().nth(1).unwrap().to_owned();
        let back: i64 = row.split(',').next().unwrap().parse().unwrap();
        prop_assert!((back - nanoseconds).abs() < 240, "{} is {} off", back, back - nanoseconds);
        if nanoseconds % 256 == 0 {
            prop_assert_eq!(back, nanoseconds);
        }
    }
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 256, failure_persistence: None, ..Default::default() })]

    #[test]
    fn poses_survive_every_format(
        tangents in prop::collection::vec(prop::array::uniform6(-3.0..3.0f64), 0..5),
        begin_ns in 0..(1i64 << 55),
    ) {
        let mut given = Trajectory::default();
        for (k, tangent) in tangents.iter().enumerate() {
            // EuRoC's own times are multiples of 256 ns.
            let nanoseconds = (begin_ns + k as i64 * 50_000_000) / 256 * 256;
            given.push(nanoseconds as f64 / 1e9, Se3::exp(&(*tangent).into()));
        }
        let path = Path::new("copy");
        for format in [TrajectoryFormat::Tum, TrajectoryFormat::Kitti, TrajectoryFormat::Euroc] {
            let bytes = given.to_bytes_as(format).unwrap();
            let read = Trajectory::parse_as(&bytes, path, format).unwrap();
            if format.has_times() {
                prop_assert_eq!(&read.timestamps, &given.timestamps);
            }
            prop_assert_eq!(read.len(), given.len());
            for (a, b) in read.world_from_body.iter().zip(&given.world_from_body) {
                prop_assert_eq!(a.translation, b.translation);
                let turn = a.rotation.inverse().compose(&b.rotation).log().norm();
                prop_assert!(turn < 1e-14, "{}", turn);
            }
        }
    }
}
