//! `covis eval ape|rpe` against the records of evo and of TUM's script, to 1e-9, and what it refuses.

use std::path::{Path, PathBuf};

use serde_json::Value;

use crate::cli_support::{Workspace, data, golden, golden_json, number};

const STATISTICS: [&str; 7] = ["rmse", "mean", "median", "std", "min", "max", "sse"];

fn trajectory(name: &str) -> Option<PathBuf> {
    let twin = golden("twins").join(name);
    if twin.exists() { Some(twin) } else { data(&format!("trajectories/{name}")) }
}

fn check_record(name: &str) {
    let record = golden_json(&format!("evo/{name}"));
    let text = |key: &str| record[key].as_str().unwrap().to_owned();
    let (truth, estimate) = (trajectory(&text("truth")), trajectory(&text("estimate")));
    let (Some(truth), Some(estimate)) = (truth, estimate) else { return };
    let arguments = format!("eval {} {{}} {{}} --json", text("metric"));
    let report = Workspace::new().json(&arguments, &[&truth, &estimate]);
    let key = match text("pose_relation").as_str() {
        "trans_part" => "translation_m",
        "angle_deg" => "angle_deg",
        _ => "rotation_part",
    };
    for (ours, theirs) in [
        (&report["pairs"], &record["matched_pairs"]),
        (&report["truth_poses"], &record["truth_poses"]),
        (&report["estimate_poses"], &record["estimate_poses"]),
        (&report[key]["values"], &record["values"]),
    ] {
        assert_eq!(ours, theirs, "{name}");
    }
    for statistic in STATISTICS {
        let ours = number(&report[key], statistic);
        let theirs = number(&record["statistics"], statistic);
        assert!(
            (ours - theirs).abs() <= 1e-9 * theirs.abs().max(1.0),
            "{name}: {statistic} {ours}"
        );
    }
    check_alignment(&report, &record);
}

fn check_alignment(report: &Value, record: &Value) {
    let flat = |record: &Value| -> Vec<f64> {
        let alignment = &record["alignment"];
        let rows = alignment["rotation"].as_array().into_iter().flatten();
        let entries = rows.flat_map(|row| row.as_array().unwrap());
        let translation = alignment["translation"].as_array().into_iter().flatten();
        entries.chain(translation).map(|v| v.as_f64().unwrap()).collect()
    };
    let (ours, theirs) = (flat(report), flat(record));
    assert_eq!(ours.len(), theirs.len());
    assert!(ours.iter().zip(&theirs).all(|(a, b)| (a - b).abs() <= 1e-9), "{ours:?} {theirs:?}");
}

/// The names of the records in a folder of goldens.
fn records(folder: &str) -> Vec<String> {
    let mut names: Vec<String> = fs_err::read_dir(golden(folder))
        .unwrap()
        .map(|entry| entry.unwrap().file_name().into_string().unwrap())
        .filter(|name| name.ends_with(".json"))
        .collect();
    names.sort();
    names
}

#[test]
fn every_record_of_evo_is_met() {
    let names = records("evo");
    assert!(names.len() >= 24, "{names:?}");
    names.iter().for_each(|name| check_record(name));
}

#[test]
fn every_record_of_the_tum_script_is_met() {
    let names = records("tum");
    assert!(names.len() >= 6, "{names:?}");
    for name in names {
        let record = golden_json(&format!("tum/{name}"));
        let file = |key: &str| trajectory(record[key].as_str().unwrap());
        let (Some(truth), Some(estimate)) = (file("truth"), file("estimate")) else { continue };
        let delta = number(&record, "delta_s");
        let over = |arguments: &str| {
            let arguments = format!("eval rpe {{}} {{}} --json {arguments}");
            Workspace::new().json(&arguments, &[&truth, &estimate])
        };
        let report = over(&format!("--delta-s {delta}"));
        for key in ["delta_s", "pairs"] {
            assert_eq!(report[key], record[key], "{name}: {key}");
        }
        for part in ["translation_m", "angle_deg"] {
            for statistic in STATISTICS.iter().filter(|&&statistic| statistic != "sse") {
                let (ours, theirs) =
                    (number(&report[part], statistic), number(&record[part], statistic));
                assert!((ours - theirs).abs() <= 1e-9, "{name}: {part} {statistic} {ours}");
            }
        }
        if delta == 1.0 {
            assert_eq!(over("--per-second"), report, "{name}");
        }
    }
}

#[test]
fn a_person_gets_a_table_and_a_wider_limit_matches_more() {
    let (truth, estimate) = (golden("twins/walk-truth.txt"), golden("twins/walk-estimate.txt"));
    let workspace = Workspace::new();
    let paths: [&Path; 2] = [&truth, &estimate];
    let ran = workspace.run("eval ape {} {}", &paths);
    assert_eq!((ran.code, ran.stderr.as_str()), (Some(0), ""));
    for part in ["47 pairs", "rmse", "0.015223", "0.643942"] {
        assert!(ran.stdout.contains(part), "`{part}` in {}", ran.stdout);
    }
    let ran = workspace.run("eval rpe {} {} --per-second", &paths);
    for part in ["relative pose error over 1 s", "45 pairs", "0.038954", "1.074284"] {
        assert!(ran.stdout.contains(part), "`{part}` in {}", ran.stdout);
    }
    let pairs = |limit: &str| {
        let arguments = format!("eval rpe {{}} {{}} --json --max-time-difference {limit}");
        workspace.json(&arguments, &paths)["pairs"].as_u64().unwrap()
    };
    assert!(pairs("0.002") < 47 && pairs("0.02") > 47);
}

#[test]
fn bad_input_is_a_failure_that_names_the_place() {
    let workspace = Workspace::new();
    let good = golden("twins/walk-truth.txt");
    let short = workspace.file("short.txt", "# t x y z\n1.0 0 0 0 0 0 0 1\n2.0 0 0\n");
    workspace.run("eval ape {} {}", &[&good, &short]).expect_failure(&["short.txt, line 3"]);
    let zero = workspace.file("zero.txt", "1.0 0 0 0 0 0 0 0\n");
    workspace.run("eval ape {} {}", &[&zero, &good]).expect_failure(&["zero.txt, line 1"]);
    let early = workspace.file("early.txt", "1.0 0 0 0 0 0 0 1\n2.0 0 0 1 0 0 0 1\n");
    let ran = workspace.run("eval rpe {} {}", &[&good, &early]);
    ran.expect_failure(&["walk-truth.txt", "early.txt", "0.01 s"]);
    let ran = workspace.run("eval ape {} {}", &[&early, &early]);
    ran.expect_failure(&["do not determine a rotation"]);
    let ran = workspace.run("eval rpe {} {} --per-second", &[&good, &early]);
    ran.expect_failure(&["walk-truth.txt", "early.txt", "1 matched poses"]);
    let ran = workspace.run("eval rpe {} {} --delta-s 60", &[&good, &good]);
    ran.expect_failure(&["0 pairs of poses are 60 s apart"]);
    for arguments in [
        "eval",
        "eval ape a",
        "eval ape a b --max-time-difference=-1",
        "eval ape a b --per-second",
        "eval rpe a b --delta-s 0",
        "eval rpe a b --delta-s nan",
        "eval rpe a b --delta-s 1 --per-second",
        "eval rpe a b --per-second --max-time-difference 0.1",
    ] {
        assert_eq!(workspace.run(arguments, &[]).code, Some(2), "{arguments}");
    }
}
