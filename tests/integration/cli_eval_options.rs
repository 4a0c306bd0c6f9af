//! `covis eval ape|rpe` with its alignments, pose relations and deltas against the records of evo, to 1e-9;
//! several estimates at once; and the options that it refuses.
//!
//! `python3 tests/golden/record.py sweeps` makes the records. Those of the twins are complete, those of real
//! data are skipped where the data is absent.

use std::path::{Path, PathBuf};

use fs_err as fs;
use serde_json::Value;

use crate::cli_support::{Workspace, data, golden, golden_json, number};

const TRUTH: &str = "twins/mono-truth.txt";
const ESTIMATE: &str = "twins/mono-estimate.txt";

/// Whether two figures agree to 1e-9, relative above 1.
fn agree(ours: f64, theirs: f64) -> bool {
    (ours - theirs).abs() <= 1e-9 * theirs.abs().max(1.0)
}

/// Runs a case of a sweep with one relation, and compares all that is of this relation.
fn check(record: &Value, case: &Value, relation: &str, paths: [&Path; 2]) {
    let text = |key: &str| case[key].as_str().unwrap();
    let arguments = format!("{} {{}} {{}} --json --pose-relation {relation}", text("arguments"));
    let report = Workspace::new().json(&arguments, &paths);
    assert_eq!(report["pose_relation"], relation);
    let (names, theirs) = (&record["figures"], &case["relations"][relation]);
    assert_eq!(names.as_array().unwrap().len(), 8);
    for (index, name) in names.as_array().unwrap().iter().enumerate() {
        let name = name.as_str().unwrap();
        let (ours, theirs) = (number(&report, name), theirs[index].as_f64().unwrap());
        assert!(agree(ours, theirs), "{arguments}: {name} {ours}, not {theirs}");
    }
    if let Some(scale) = case["scale"].as_f64() {
        assert!(agree(number(&report["alignment"], "scale"), scale), "{arguments}: {report}");
    }
}

/// Both files of a record, where they are there, and whether they are the project's own.
fn files(record: &Value) -> Option<([PathBuf; 2], bool)> {
    let names = ["truth", "estimate"].map(|key| record[key].as_str().unwrap());
    let twins = names.map(|name| golden("twins").join(name));
    if twins.iter().all(|path| path.exists()) {
        return Some((twins, true));
    }
    let [truth, estimate] = names.map(|name| data(&format!("trajectories/{name}")));
    Some(([truth?, estimate?], false))
}

/// Runs the cases of a sweep.
fn check_sweep(name: &str, count: usize) {
    let record = golden_json(&format!("evo_sweeps/{name}.json"));
    let cases = record["cases"].as_array().unwrap();
    assert_eq!(cases.len(), count, "{name}");
    let Some((paths, is_small)) = files(&record) else { return };
    for (index, case) in cases.iter().enumerate() {
        let relations: Vec<&String> = case["relations"].as_object().unwrap().keys().collect();
        // Of long trajectories one relation a case, each in its turn.
        let turn = index % relations.len();
        let chosen = if is_small { 0..relations.len() } else { turn..turn + 1 };
        for relation in &relations[chosen] {
            check(&record, case, relation, [&paths[0], &paths[1]]);
        }
    }
}

// Each alone, so that they run beside each other: a case is a run of the program.
#[test]
fn the_sweep_of_evo_over_a_walk_is_met() {
    check_sweep("walk", 50);
}

#[test]
fn the_sweep_of_evo_over_one_camera_is_met() {
    check_sweep("mono", 50);
}

#[test]
fn the_sweep_of_evo_over_fr2_desk_is_met() {
    check_sweep("fr2_desk_ORB", 21);
}

#[test]
fn the_sweep_of_evo_over_fr1_xyz_is_met() {
    check_sweep("freiburg1_xyz-rgbdslam", 21);
}

#[test]
fn what_is_asked_for_stands_first() {
    let (truth, estimate) = (golden(TRUTH), golden(ESTIMATE));
    let paths: [&Path; 2] = [&truth, &estimate];
    let workspace = Workspace::new();
    let table = |arguments: &str, parts: &[&str]| {
        let ran = workspace.run(&format!("eval {arguments} {{}} {{}}"), &paths);
        assert_eq!(ran.code, Some(0), "{}", ran.stderr);
        for part in parts {
            assert!(ran.stdout.contains(part), "`{part}` in {}", ran.stdout);
        }
        ran.stderr
    };
    table(
        "ape --align sim3 --n-to-align 20",
        &["absolute pose error, Sim(3) aligned by the first 20 poses\n", ", scale 2.569227\n"],
    );
    table("ape --align scale", &["pose error, scale corrected\n", "scale 2.338855"]);
    table("ape --align none", &["pose error, not aligned\n", "translation (m)  rotation (deg)\n"]);
    table("ape --align origin", &["pose error, origin aligned\n"]);
    table("ape --pose-relation angle_deg", &["  rotation (deg)   translation (m)\n"]);
    table(
        "rpe --delta 0.5 --delta-unit m --all-pairs --pairs-from-reference",
        &["relative pose error over 0.5 m of path, all pairs, pairs of the truth\n"],
    );
    table("rpe --delta 15 --delta-unit d", &["relative pose error over 15 deg of rotation\n"]);
    table(
        "rpe --delta 5 --pose-relation full",
        &["over 5 matched poses\n", "full transformation   translation (m)  rotation (deg)\n"],
    );
    table("rpe --delta-s 1 --align sim3", &["over 1 s, Sim(3) aligned\n", "scale 2.338855"]);
    // The truth rests: 6 pairs have nothing that the error could be a share of.
    let warned = table(
        "rpe --pose-relation point_distance_error_ratio",
        &["  distance ratio (%)   translation (m)  rotation (deg)\n"],
    );
    assert!(warned.contains("6 pairs without a true motion are left out"), "{warned}");
}

#[test]
fn several_estimates_are_rows_of_one_table_and_a_list_in_json() {
    let (truth, estimate) = (golden(TRUTH), golden(ESTIMATE));
    let workspace = Workspace::new();
    let mut lines: Vec<String> =
        fs::read_to_string(&estimate).unwrap().lines().map(str::to_owned).collect();
    lines.truncate(50);
    workspace.file("short.txt", &lines.join("\n"));
    fs::copy(&estimate, workspace.path("whole.txt")).unwrap();
    for metric in ["ape --align sim3", "rpe --align sim3 --delta 0.5 --delta-unit m", "ape"] {
        let one =
            |name: &str| workspace.json(&format!("eval {metric} {{}} {name} --json"), &[&truth]);
        let arguments = format!("eval {metric} {{}} whole.txt short.txt");
        let several = workspace.json(&format!("{arguments} --json"), &[&truth]);
        let list = several["estimates"].as_array().unwrap();
        assert_eq!(list.len(), 2);
        for (entry, name) in list.iter().zip(["whole.txt", "short.txt"]) {
            assert_eq!(entry["estimate"], name);
            // All that the object of one estimate says is here or beside the list.
            for (key, value) in one(name).as_object().unwrap() {
                let found = entry.get(key).or_else(|| several.get(key));
                assert_eq!(found, Some(value), "{metric}: {key}");
            }
        }
        let ran = workspace.run(&format!("{arguments} --report report.html"), &[&truth]);
        assert_eq!(ran.code, Some(0), "{}", ran.stderr);
        assert_eq!(ran.stdout.contains("  scale\n"), metric.contains("sim3"), "{}", ran.stdout);
        let html = fs::read_to_string(workspace.path("report.html")).unwrap();
        for (entry, name) in list.iter().zip(["whole.txt", "short.txt"]) {
            let row = ran.stdout.lines().find(|line| line.starts_with(name)).unwrap();
            assert!(row.contains(&format!("{:.6}", number(entry, "rmse"))), "{row}");
            assert!(html.contains(&format!("<h2>{name}</h2>")), "{metric}: {name}");
            assert!(html.contains(&covis::report::number(number(entry, "rmse"))), "{name}");
        }
        // Trajectories are drawn together where they lie in one frame.
        assert_eq!(html.contains("Estimates from above"), metric.starts_with("ape"), "{metric}");
        assert!(html.contains("line s0") && html.contains("line s1"));
        assert!(!html.contains("NaN"));
    }
    // What cannot be compared is named, and there is no table of the rest.
    workspace.file("early.txt", "1.0 0 0 0 0 0 0 1\n2.0 0 0 1 0 0 0 1\n");
    let ran = workspace.run("eval ape {} whole.txt early.txt", &[&truth]);
    ran.expect_failure(&["mono-truth.txt and early.txt", "no timestamps"]);
    assert_eq!(ran.stdout, "");
}

#[test]
fn options_without_a_meaning_are_refused_by_their_names() {
    let (truth, estimate) = (golden(TRUTH), golden(ESTIMATE));
    let workspace = Workspace::new();
    let fails = |arguments: &str, parts: &[&str]| {
        let ran = workspace.run(&format!("eval {arguments} {{}} {{}}"), &[&truth, &estimate]);
        ran.expect_failure(parts);
    };
    let named = ["mono-truth.txt", "mono-estimate.txt"];
    fails("ape --n-to-align 2", &[named[0], named[1], "2 matched positions do not determine"]);
    fails("ape --align none --n-to-align 9", &["--n-to-align is for --align se3, sim3 or scale"]);
    fails("rpe --n-to-align 9", &["--n-to-align is for --align se3, sim3 or scale"]);
    fails("rpe --delta 1.5", &[named[1], "a delta of 1.5 poses must be a whole number"]);
    fails("rpe --delta 181 --delta-unit d", &["a delta of 181 deg must be at most 180"]);
    fails("rpe --delta 4 --delta-unit r", &["a delta of 4 rad must be at most pi"]);
    fails("rpe --delta 900 --delta-unit m", &[named[1], "a delta of 900 m apart"]);
    let still: String = (0..4).map(|k| format!("{k} 0 0 0 0 0 0 1\n")).collect();
    let still = workspace.file("still.txt", &still);
    let ratio = "eval rpe {} {} --pose-relation point_distance_error_ratio";
    workspace
        .run(ratio, &[&still, &still])
        .expect_failure(&["still.txt", "between the poses of no"]);
    for arguments in [
        "ape a b --n-to-align 0",
        "ape a b --n-to-align=-1",
        "ape a b --align affine",
        "ape a b --pose-relation point_distance_error_ratio",
        "ape a b --delta 2",
        "rpe a b --delta 0",
        "rpe a b --delta nan",
        "rpe a b --delta-unit s",
        "rpe a b --delta-tol 0.1",
        "rpe a b --all-pairs --delta-tol=-0.1",
        "rpe a b --per-second --delta 2",
        "rpe a b --delta-s 1 --all-pairs",
        "rpe a b --delta-s 1 --pairs-from-reference",
    ] {
        let ran = workspace.run(&format!("eval {arguments}"), &[]);
        assert_eq!(ran.code, Some(2), "{arguments}: {}", ran.stderr);
    }
}
