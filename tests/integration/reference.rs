//! The reference benchmark's Python (`benches/reference`) against covis: scenes, costs, the report.
//!
//! The Python is numpy's and shares no code with covis, so that a cost on which both agree is right.
//! `COVIS_TEST_PYTHON` names an interpreter, `python3` is the default. Where it or numpy is absent a test
//! says so and returns.

use std::path::{Path, PathBuf};
use std::process::{Command, Output};

use covis_solvers::evaluation::bundle_cost;
use covis_solvers::io::bal::BalFile;
use covis_solvers::testing::skip;
use serde_json::Value;

use crate::cli_support::{Ran, Workspace, close, number};

/// Runs a script of `benches/reference` in `folder`; `None`, and a line, without Python and numpy.
fn script(name: &str, folder: &Path, arguments: &[&str]) -> Option<Ran> {
    let named = std::env::var_os("COVIS_TEST_PYTHON");
    let interpreter = named.unwrap_or_else(|| "python3".into());
    let python = |first: &[&str], rest: &[&str]| -> std::io::Result<Output> {
        let mut command = Command::new(&interpreter);
        for (name, _) in std::env::vars_os() {
            if name.to_string_lossy().starts_with("COVIS_") {
                command.env_remove(name);
            }
        }
        command.args(first).args(rest).current_dir(folder).output()
    };
    if !python(&["-c", "import numpy"], &[]).is_ok_and(|found| found.status.success()) {
        skip(&format!("no {} with numpy ({name})", interpreter.display()));
        return None;
    }
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("benches/reference").join(name);
    Some(Ran::of(python(&["-B", path.to_str().unwrap()], arguments).unwrap()))
}

/// A small scene of `kind` in the workspace.
fn scene(workspace: &Workspace, kind: &str, arguments: &[&str]) -> Option<PathBuf> {
    let path = workspace.path("scene.txt");
    let words = [&[kind, path.to_str().unwrap()], arguments].concat();
    let ran = script("scenes.py", path.parent().unwrap(), &words)?;
    assert_eq!(ran.code, Some(0), "{}", ran.stderr);
    Some(path)
}

#[test]
fn numpy_and_the_evaluator_agree_on_the_cost_of_a_scene() {
    let window = ["--cameras", "5", "--landmarks", "60", "--track", "4"];
    let street = ["--cameras", "90", "--laps", "2", "--landmarks-per-camera", "4"];
    for (kind, arguments) in [("window", &window[..]), ("street", &street[..])] {
        let workspace = Workspace::new();
        let Some(path) = scene(&workspace, kind, arguments) else { return };
        let ran = script("bal.py", path.parent().unwrap(), &[path.to_str().unwrap()]).unwrap();
        let facts: Value = serde_json::from_str(&ran.stdout).unwrap();
        let problem = BalFile::read(&path).unwrap().to_problem();
        let (found, cost) = (number(&facts, "cost"), bundle_cost(&problem).total);
        assert!(close(found, cost, 1e-12), "{kind}: {found} by numpy, {cost} by the evaluator");
        assert_eq!(facts["observations"], problem.observation_count());
        assert_eq!(facts["behind_camera"], problem.behind_camera_count());
    }
}

// The comparison reads the child's memory and the processor as Linux tells them.
#[cfg(target_os = "linux")]
#[test]
fn the_comparison_accepts_covis_and_refuses_what_is_not_a_solve() {
    let workspace = Workspace::new();
    let window = ["--cameras", "5", "--landmarks", "60", "--track", "4"];
    let Some(path) = scene(&workspace, "window", &window) else { return };
    let report = workspace.path("report.json");
    let (file, json) = (path.to_str().unwrap(), report.to_str().unwrap());
    let compare = |covis: &str| {
        let words = [file, "--solvers", "covis", "--threads", "1", "--rounds", "2", "--no-plot"];
        let words = [&words[..], &["--fix-intrinsics", "--covis", covis, "--json", json]].concat();
        script("compare.py", path.parent().unwrap(), &words).unwrap()
    };
    let ran = compare(env!("CARGO_BIN_EXE_covis"));
    assert_eq!(ran.code, Some(0), "{}{}", ran.stdout, ran.stderr);
    assert!(ran.stdout.contains("| scene | covis | 1 |"), "{}", ran.stdout);
    let record: Value = serde_json::from_slice(&fs_err::read(&report).unwrap()).unwrap();
    let summary = &record["files"][0]["summaries"][0];
    assert!(number(summary, "final") < 0.1 * number(summary, "start"), "{summary}");
    assert!(number(summary, "peak_memory_mb") > 1.0, "{summary}");

    let ran = compare("/bin/echo");
    assert_eq!(ran.code, Some(1), "{}", ran.stdout);
    assert!(ran.stdout.contains("no JSON document of a solve"), "{}", ran.stdout);
}
