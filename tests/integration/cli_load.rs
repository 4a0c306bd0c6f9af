//! `covis load`: what it measures, and that it leaves nothing behind.

use std::io::{BufRead, BufReader};
use std::process::Stdio;

use crate::cli_support::{Ran, Running, Workspace, number};
use crate::process::Process;
#[cfg(unix)]
use crate::process::Signal;

fn maps(workspace: &Workspace, server: &Running) -> Vec<String> {
    let maps = workspace.json(&format!("map list --json --server {}", server.url), &[]);
    let names = maps.as_array().unwrap().iter();
    names.map(|map| map["map"].as_str().unwrap().to_owned()).collect()
}

#[test]
fn every_keyframe_of_a_load_is_acknowledged_and_corrected_and_the_maps_are_deleted() {
    let workspace = Workspace::new();
    let server = Running::start(&workspace, &workspace.path("data"));
    let on = format!("--server {}", server.url);
    workspace.file("walk.tum", "1 0 0 0 0 0 0 1\n");
    workspace.json(&format!("map import mine walk.tum --json {on}"), &[]);
    let load = "load --maps 3 --rate 20 --seconds 0.5 --observations 60 --maps-per-connection 2";
    let report = workspace.json(&format!("{load} --json {on}"), &[]);
    assert_eq!(number(&report, "sent"), 30.0, "{report}");
    for count in ["refused", "unanswered", "failed_solves"] {
        assert_eq!(number(&report, count), 0.0, "{report}");
    }
    for level in ["received", "durable", "corrected"] {
        assert_eq!(number(&report[level], "count"), 30.0, "{report}");
        assert!(number(&report[level], "p50_ms") <= number(&report[level], "p99_ms"), "{report}");
    }
    assert!(number(&report["solve"], "count") > 0.0, "{report}");
    assert_eq!(maps(&workspace, &server), ["mine"], "a user's map stays, the load's are gone");
}

#[test]
fn a_server_in_memory_is_loaded_without_durable_acks() {
    let workspace = Workspace::new();
    let mut command = workspace.command();
    command.args(["serve", "--listen", "127.0.0.1:0", "--in-memory", "--threads", "1"]);
    let mut child = Process::spawn(command.stdout(Stdio::piped()).stderr(Stdio::null()));
    let mut line = String::new();
    BufReader::new(child.stdout.take().unwrap()).read_line(&mut line).unwrap();
    let url = line.trim().strip_prefix("listening on ").unwrap();
    let ran = workspace.run(
        &format!("load --maps 1 --rate 20 --seconds 0.2 --observations 60 --server {url}"),
        &[],
    );
    assert_eq!(ran.code, Some(0), "{}", ran.stderr);
    let durable = ran.stdout.lines().find(|line| line.contains("DURABLE")).unwrap();
    assert!(durable.split_whitespace().skip(3).eq(["0", "-", "-", "-"]), "{durable}");
}

#[cfg(unix)]
#[test]
fn an_interrupted_load_deletes_its_maps() {
    let workspace = Workspace::new();
    let server = Running::start(&workspace, &workspace.path("data"));
    let mut command = workspace.command();
    let arguments =
        ["--log", "warn", "load", "--maps", "2", "--rate", "5", "--seconds", "600", "--server"];
    command.args(arguments).arg(&server.url).stdout(Stdio::piped()).stderr(Stdio::piped());
    let child = Process::spawn(&mut command);
    // Both maps are there once it sends.
    while maps(&workspace, &server).len() < 2 {
        std::thread::yield_now();
    }
    child.signal(Signal::INT);
    let ran = Ran::of(child.output());
    ran.expect_failure(&["interrupt", "the maps of the load are deleted"]);
    assert!(maps(&workspace, &server).is_empty());
}
