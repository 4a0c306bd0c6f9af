//! `covis solve` with files of other programs: OpenMVG's is solved, and what covis does not read is refused
//! by its name.

use crate::cli_support::{Workspace, close, golden, number};

#[test]
fn formats_of_other_programs_are_refused_by_name() {
    let workspace = Workspace::new();
    workspace.file("sfm_data.bin", "\u{1}\u{3}\0\0\0\0\0\0\u{0}0.3\n");
    let ran = workspace.run("solve sfm_data.bin", &[]);
    let named = "OpenMVG's sfm_data.bin, which covis does not read";
    ran.expect_failure(&["sfm_data.bin", named]);
    workspace.file("drive.bag", "#ROSBAG V2.0\nE\n");
    let named = "`rosbags-convert --src drive.bag --dst FOLDER` makes one of ROS 2 from it";
    for command in ["run drive.bag", "eval ape drive.bag:/tf drive.bag", "convert drive.bag a.txt"]
    {
        workspace.run(command, &[]).expect_failure(&["drive.bag: a bag of ROS 1", named]);
    }
    let ran = workspace.run("solve drive.bag", &[]);
    ran.expect_failure(&["drive.bag", "a bag of ROS 1, which covis does not read"]);
}

#[test]
fn a_file_of_openmvg_is_solved_and_written_as_a_colmap_model() {
    let workspace = Workspace::new();
    let input = golden("twins/room-openmvg.json");
    let ran = workspace.run("solve {} --json --out model", &[&input]);
    let report: serde_json::Value = serde_json::from_str(&ran.stdout).unwrap();
    for warned in ["1 views without a pose", "1 observations in such views", "1 control points"] {
        assert!(ran.stderr.contains(warned), "{}", ran.stderr);
    }
    assert_eq!((&report["format"], &report["poses"]), (&"openmvg".into(), &6.into()));
    // 180 observations with 0.3 px of noise in each of their two coordinates, less 36 + 90 + 31 unknowns
    // that absorb a part of it.
    let cost = number(&report, "final_cost");
    assert!(cost > 5.0 && cost < 0.5 * 360.0 * 0.09, "{cost}");
    assert!(number(&report, "initial_cost") > 10.0 * cost);
    let solved = workspace.json("solve bundle model --json", &[]);
    assert!(close(number(&solved, "initial_cost"), cost, 1e-9), "{solved}");
    workspace
        .run("--log error convert {} other.json", &[&input])
        .expect_failure(&["other.json", "covis reads openmvg but cannot write it"]);
    workspace
        .run("eval ape {} {}", &[&golden("twins/walk-truth.txt"), &input])
        .expect_failure(&["is not a trajectory but OpenMVG's sfm_data.json (openmvg)"]);
}
