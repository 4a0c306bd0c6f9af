//! `covis solve bundle --blocks`: real worker processes, one of them killed, and wrong usage.

use std::io::{Read, Write};
use std::path::{Path, PathBuf};

use covis_solvers::testing::skip;
use serde_json::Value;

use crate::cli_support::{Workspace, close, data, golden, number};
use crate::process::{self, Process, Signal};

/// What a pipe of Linux takes until somebody reads.
const PIPE_BYTES: usize = 1 << 16;

fn twin() -> PathBuf {
    golden("twins/window-6-80.txt")
}

#[test]
fn blocks_reach_the_single_solves_cost_and_the_report_says_who_did_what() {
    let workspace = Workspace::new();
    let (out, scratch) = (workspace.path("out.txt"), workspace.path("scratch"));
    fs_err::create_dir(&scratch).unwrap();
    let whole = workspace.json("solve bundle {} --json --fix-intrinsics", &[&twin()]);
    let arguments = "solve bundle {} --json --fix-intrinsics --blocks 2 --workers 2 --worker-memory-mib 0 --scratch {} --out {}";
    let split = workspace.json(arguments, &[&twin(), &scratch, &out]);
    assert!(close(number(&split, "final_cost"), number(&whole, "final_cost"), 1e-8));
    assert!(whole.get("split").is_none());
    let told = &split["split"];
    let observations = told["blocks"].as_array().unwrap().iter().map(|b| &b["observations"]);
    let sum: u64 = observations.map(|n| n.as_u64().unwrap()).sum();
    assert_eq!(split["observations"], sum);
    for worker in told["workers"].as_array().unwrap() {
        assert_eq!(worker["restarts"], 0);
        assert!(!cfg!(target_os = "linux") || worker["peak_bytes"].as_u64().unwrap() > 1 << 20);
    }
    for phase in ["partition", "write", "load", "cost", "eliminate", "step", "coordinator"] {
        assert!(told["seconds"][phase].as_f64().unwrap() >= 0.0, "{phase}");
    }
    assert_eq!(fs_err::read_dir(&scratch).unwrap().count(), 0, "the scratch file is gone");
    // As many workers as blocks, or any other number: the same file.
    let other = workspace.path("other.txt");
    let arguments = "solve bundle {} --json --fix-intrinsics --blocks 2 --workers 1 --out {}";
    let one: Value = workspace.json(arguments, &[&twin(), &other]);
    assert_eq!(one["final_cost"], split["final_cost"]);
    assert_eq!(fs_err::read(&out).unwrap(), fs_err::read(&other).unwrap());
}

#[test]
fn a_worker_that_is_killed_is_started_anew_and_the_file_is_the_same() {
    let Some(input) = data("bal/ladybug-49-7776.txt") else { return };
    if !Path::new("/proc/self/task").exists() {
        return skip("no /proc to find a worker in");
    }
    let workspace = Workspace::new();
    let (undisturbed, disturbed) = (workspace.path("a.txt"), workspace.path("b.txt"));
    let arguments = "solve bundle {} --json --max-iterations 20 --blocks 4 --workers 2 --out {}";
    workspace.json(arguments, &[&input, &undisturbed]);
    // A pipe with room for a few lines: the solve waits in its first steps until somebody reads.
    let (mut output, mut full) = std::io::pipe().unwrap();
    full.write_all(&vec![b'\n'; PIPE_BYTES - 400]).unwrap();
    let mut command = workspace.command();
    command.args(["solve", "bundle"]).arg(&input);
    command.args(["--max-iterations", "20", "--blocks", "4", "--workers", "2", "--out"]);
    let mut child = Process::spawn(command.arg(&disturbed).stdout(full));
    // Its copy of the pipe's end would keep the reader waiting.
    drop(command);
    let workers = loop {
        let workers = children(child.id());
        if workers.len() == 2 {
            break workers;
        }
        assert!(child.try_wait().unwrap().is_none(), "it ended without two workers");
        std::thread::yield_now();
    };
    process::send(workers[1], Signal::KILL);
    let mut told = String::new();
    output.read_to_string(&mut told).unwrap();
    assert!(child.wait().unwrap().success());
    assert!(told.contains("1 restarted"), "{told}");
    assert!(fs_err::read(&undisturbed).unwrap() == fs_err::read(&disturbed).unwrap());
}

/// The processes that any thread of a process started, ascending.
fn children(process: u32) -> Vec<u32> {
    let mut found = Vec::new();
    for task in fs_err::read_dir(format!("/proc/{process}/task")).unwrap() {
        let list =
            fs_err::read_to_string(task.unwrap().path().join("children")).unwrap_or_default();
        found.extend(list.split_whitespace().map(|id| id.parse::<u32>().unwrap()));
    }
    found.sort_unstable();
    found
}

#[test]
fn wrong_usage_is_reported() {
    let workspace = Workspace::new();
    for arguments in [
        "solve bundle {} --blocks 0",
        "solve bundle {} --workers 2",
        "solve bundle {} --blocks 2 --linear-solver dense-schur",
    ] {
        let ran = workspace.run(arguments, &[&twin()]);
        assert_eq!(ran.code, Some(2), "{arguments}: {}", ran.stderr);
    }
    let nowhere = workspace.path("nowhere");
    let ran = workspace.run("solve bundle {} --blocks 2 --scratch {}", &[&twin(), &nowhere]);
    assert_eq!(ran.code, Some(1));
    assert!(ran.stderr.contains("nowhere"), "{}", ran.stderr);
}
