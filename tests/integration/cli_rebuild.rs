//! `covis solve bundle --rebuild` end to end: a file's poses and points are no start.

use covis_solvers::geometry::{LieGroup, Se3};
use covis_solvers::io::bal::BalFile;
use nalgebra::Vector3;
use serde_json::Value;

use crate::cli_solve::check_rows;
use crate::cli_support::{Workspace, close, golden, golden_json, number};

#[test]
fn a_file_is_rebuilt_from_its_observations() {
    let workspace = Workspace::new();
    let window = golden("twins/window-6-80.txt");
    let known = number(&golden_json("ceres/window-6-80-full.json"), "final_cost");
    // Poses and points of the file are no start: with all of them at zero it is rebuilt the same.
    let mut empty = BalFile::read(&window).unwrap();
    let mut problem = empty.to_problem();
    problem.poses.fill(Se3::identity());
    problem.landmarks.fill(Vector3::zeros());
    empty.update_from(&problem).unwrap();
    let blank = workspace.path("blank.txt");
    empty.write(&blank).unwrap();
    let mut costs = Vec::new();
    for input in [&window, &blank] {
        let out = workspace.path("out.txt");
        let report =
            workspace.json("solve bundle {} --rebuild --force --json --out {}", &[input, &out]);
        let rebuilt = &report["rebuilt"];
        assert_eq!((&rebuilt["keyframes"], &rebuilt["placed"]), (&6.into(), &6.into()), "{report}");
        assert_eq!(rebuilt["unplaced"], Value::Array(Vec::new()));
        let dropped = number(rebuilt, "dropped_observations");
        assert!(dropped <= 18.0, "{dropped} of 362");
        let cost = number(&report, "final_cost");
        assert!(cost <= known * (1.0 + 1e-3), "{cost} and {known}");
        assert_eq!(number(&report, "observations") + dropped, 362.0);
        assert_eq!(BalFile::read(&out).unwrap().to_problem().poses.len(), 6);
        costs.push(cost);
        check_rows(&report);
    }
    assert!(close(costs[0], costs[1], 1e-9), "{costs:?}");
    let ran = workspace.run("solve bundle {} --rebuild", &[&window]);
    assert_eq!(ran.code, Some(0), "{}", ran.stderr);
    for part in
        ["relative poses: ", "positions: ", "rebuilt: 6 of 6 keyframes", "view graph: 15 pairs"]
    {
        assert!(ran.stdout.contains(part), "{part} in {}", ran.stdout);
    }
    // Three landmarks tie no two cameras together.
    let few = "2 3 6\n0 0 1 1\n0 1 2 2\n0 2 3 3\n1 0 1 1\n1 1 2 2\n1 2 3 3\n".to_owned()
        + &"0 0 0 0 0 0 500 0 0 ".repeat(2)
        + &"1 1 -5 ".repeat(3);
    let few = workspace.file("few.txt", &few);
    workspace.run("solve bundle {} --rebuild", &[&few]).expect_failure(&[
        "no keyframe could be placed",
        "0: it shares at most 3 landmarks with another keyframe, 8 are needed",
    ]);
}
