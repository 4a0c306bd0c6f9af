//! pyfg files by command: solved, written back with names and times, converted, refused.
//!
//! What they cost is held by the tests of the solvers; these hold what a user gets.

use covis_solvers::io::pyfg::PyfgGraph;
use covis_solvers::io::trajectory::Trajectory;

use crate::cli_support::{Workspace, close, golden, golden_json, number};

/// One robot, a landmark and what was measured between them; names and times that must survive.
const SMALL: &str = "VERTEX_SE2 1403636579.763555584 A0 0 0 0\nVERTEX_SE2 1403636580.50 A1 1.2 0.1 0\n\
    VERTEX_SE2 1403636581.0 A2 2.1 0 0\nVERTEX_XY L3 1 2.2\nEDGE_SE2 0 A0 A1 1 0 0 0.01 0 0 0.01 0 0.01\n\
    EDGE_SE2 0 A1 A2 1 0 0 0.01 0 0 0.01 0 0.01\nEDGE_SE2_XY 0 A1 L3 0 2 0.01 0 0.01\n";

const RANGES: &str = "EDGE_RANGE 0 A0 L3 2.2 0.04\nEDGE_RANGE 0 A2 L3 2.3 0.04\n";

#[test]
fn a_pyfg_file_is_solved_and_written_back_with_names_and_times() {
    let workspace = Workspace::new();
    for name in ["fleet-2d", "fleet-3d"] {
        let (input, out) =
            (golden("twins").join(format!("{name}.pyfg")), workspace.path(&format!("{name}.pfg")));
        let report = workspace.json("solve {} --json --out {}", &[&input, &out]);
        let record = golden_json(&format!("gtsam/{name}-file-start.json"));
        assert!(close(number(&report, "final_cost"), number(&record, "final_cost"), 1e-8));
        assert_eq!(number(&report, "ranges"), 131.0, "{report}");
        let head = |text: &str| -> Vec<String> {
            let line = |line: &str| line.split(' ').take(3).collect::<Vec<_>>().join(" ");
            text.lines().filter(|line| line.starts_with("VERTEX_SE")).map(line).collect()
        };
        let texts = [&input, &out].map(|path| fs_err::read_to_string(path).unwrap());
        assert_eq!(head(&texts[0]), head(&texts[1]));
        assert_eq!(texts[0].lines().count(), texts[1].lines().count());
        let again = workspace.json("solve pose-graph {} --json --init given", &[&out]);
        let (first, second) = (number(&report, "final_cost"), number(&again, "initial_cost"));
        assert!(close(first, second, 1e-9), "{first} {second}");
    }
    let text = workspace.run("solve {}", &[&golden("twins").join("fleet-2d.pyfg")]).stdout;
    for part in ["gauge: vertex A0 fixed", "131 ranges", "range"] {
        assert!(text.contains(part), "`{part}` in {text}");
    }
}

#[test]
fn landmarks_without_a_pose_are_solved_and_named_as_free() {
    let workspace = Workspace::new();
    let text = "VERTEX_XY L0 11 19\nVERTEX_XY L1 11 22\nEDGE_RANGE 0.0 L0 L1 2.0 1.0\n";
    let (input, out) = (workspace.file("range.pyfg", text), workspace.path("out.pyfg"));
    let report = workspace.json("solve {} --json --out {}", &[&input, &out]);
    assert!(number(&report, "final_cost") < 1e-12, "{report}");
    let text = workspace.run("solve {}", &[&input]).stdout;
    assert!(text.contains("gauge: free, nothing holds the graph\n"), "{text}");
    let open: Vec<_> = report["undetermined"].as_array().unwrap().iter().collect();
    assert_eq!((&open[0]["id"], &open[1]["id"]), (&"L0".into(), &"L1".into()));
    let read = PyfgGraph::read(&out, false).unwrap().0;
    let PyfgGraph::Se2(file) = read else { panic!("read as 3D") };
    let [a, b] = &file.landmarks[..] else { panic!("two landmarks") };
    assert!((a.position[0] - 11.0).abs() < 1e-6 && (b.position[1] - a.position[1] - 2.0) < 1e-6);
}

#[test]
fn pieces_and_lines_are_refused_by_name() {
    let workspace = Workspace::new();
    let apart = format!(
        "{SMALL}VERTEX_SE2 1 B4 0 0 0\nVERTEX_SE2 2 B5 1 0 0\n\
        EDGE_SE2 0 B4 B5 1 0 0 1 0 0 1 0 1\n"
    );
    let input = workspace.file("apart.pyfg", &apart);
    workspace.run("solve {}", &[&input]).expect_failure(&[
        "apart.pyfg",
        "2 pieces",
        "from A0 to A2",
        "from B4 to B5",
    ]);
    let unknown = workspace.file("unknown.pyfg", &format!("{SMALL}EDGE_NEW 1\n"));
    workspace.run("solve {}", &[&unknown]).expect_failure(&[
        "unknown.pyfg, line 8",
        "EDGE_NEW",
        "--skip-unknown",
    ]);
    let report = workspace.json("solve {} --skip-unknown --json", &[&unknown]);
    assert_eq!(number(&report["skipped"]["EDGE_NEW"], "first_line"), 8.0);
    let ranges = workspace.file("ranges.pyfg", &format!("{SMALL}{RANGES}"));
    for (options, parts) in [
        ("--repair-information", ["--repair-information", "covariances"]),
        ("--incremental", ["--incremental", "ranges"]),
        ("--robust gnc-tls", ["robust", "ranges"]),
        ("--robust gnc-tls --trusted A0,A2", ["--trusted A0,A2", "no edge connects"]),
    ] {
        workspace.run(&format!("solve {{}} {options}"), &[&ranges]).expect_failure(&parts);
    }
}

#[test]
fn a_robot_becomes_a_trajectory_by_the_times_of_its_poses() {
    let workspace = Workspace::new();
    workspace.file("small.pyfg", &format!("{SMALL}{RANGES}"));
    let told = workspace.json("convert small.pyfg path.txt --json", &[]);
    assert_eq!((&told["from"], &told["poses"]), (&"pyfg".into(), &3.into()));
    assert!(told.get("times").is_none(), "{told}");
    let path = Trajectory::read(&workspace.path("path.txt")).unwrap();
    assert_eq!(path.timestamps, [1403636579.7635556, 1403636580.5, 1403636581.0]);
    assert_eq!(path.world_from_body[1].translation.y, 0.1);

    let fleet = golden("twins").join("fleet-3d.pyfg");
    let out = workspace.path("fleet.txt");
    workspace.run("convert {} {}", &[&fleet, &out]).expect_failure(&["robots A, B", "--robot"]);
    workspace
        .run("convert {} {} --robot C", &[&fleet, &out])
        .expect_failure(&["--robot C", "A, B"]);
    let told = workspace.json("convert {} {} --robot B --json", &[&fleet, &out]);
    assert_eq!(told["poses"], 30);
    assert_eq!(Trajectory::read(&out).unwrap().len(), 30);
    let picture = workspace.path("fleet.ply");
    workspace.run("convert {} {} --robot B", &[&fleet, &picture]).expect_failure(&["--robot"]);
    workspace.json("convert {} {} --json", &[&fleet, &picture]);
    let head = fs_err::read(&picture).unwrap();
    assert!(String::from_utf8_lossy(&head[..200]).contains("element vertex 65\n"));

    let still = "VERTEX_SE2 0.0 A0 0 0 0\nVERTEX_SE2 0.0 A1 1 0 0\n";
    workspace.file("still.pyfg", still);
    workspace.run("convert still.pyfg still.txt", &[]).expect_failure(&[
        "still.pyfg",
        "times do not rise",
        "A1",
        "--to kitti",
    ]);
    workspace.json("convert still.pyfg still.kitti --json", &[]);
    workspace.file("a.g2o", "VERTEX_SE2 0 0 0 0\n");
    workspace.run("convert a.g2o b.txt --robot A", &[]).expect_failure(&["--robot", "a.g2o"]);
}

#[test]
fn g2o_and_pyfg_become_each_other_where_the_content_fits() {
    let workspace = Workspace::new();
    workspace.file("small.pyfg", SMALL);
    workspace.json("convert small.pyfg small.g2o --json", &[]);
    workspace.json("convert small.g2o back.pyfg --json", &[]);
    let costs = ["small.pyfg", "small.g2o", "back.pyfg"].map(|name| {
        let report = workspace.json(&format!("solve {name} --json --init given"), &[]);
        (number(&report, "initial_cost"), number(&report, "final_cost"))
    });
    for (before, after) in costs {
        assert!(close(before, costs[0].0, 1e-12) && close(after, costs[0].1, 1e-9), "{costs:?}");
    }
    let back = fs_err::read_to_string(workspace.path("back.pyfg")).unwrap();
    assert!(back.contains("VERTEX_SE2 2 A2 ") && back.contains("VERTEX_XY L3 "), "{back}");
    workspace.file("ranges.pyfg", &format!("{SMALL}{RANGES}"));
    workspace
        .run("convert ranges.pyfg ranges.g2o", &[])
        .expect_failure(&["range, record 0", "g2o has no ranges"]);
    workspace.run("convert ranges.pyfg model --to bal", &[]).expect_failure(&["bal", "pyfg"]);
}
