//! `covis replay` against a server that is killed: resumes, loses and doubles nothing, gives up when
//! it was told to, and says how far it came. Real binaries on both sides.

use std::path::Path;
use std::process::Stdio;

use covis::client::{Client, WatchOptions};
use serde_json::Value;

use crate::cli_support::{Ran, Running, Workspace, golden};
use crate::common::run;
use crate::process::Process;
#[cfg(unix)]
use crate::process::Signal;

/// Starts a replay of six keyframes onto the map "twin".
fn replay(workspace: &Workspace, url: &str, more: &[&str]) -> Process {
    let mut command = workspace.command();
    command.args(["--log", "error", "replay"]).arg(golden("twins/window-6-80.txt"));
    command.args(["--server", url, "--map", "twin", "--json"]).args(more);
    Process::spawn(command.stdout(Stdio::piped()).stderr(Stdio::piped()))
}

fn ended(child: Process) -> Ran {
    Ran::of(child.output())
}

/// Waits until the map holds so many keyframes durably.
fn hold(url: &str, keyframes: usize) {
    run(async {
        let client = Client::connect(url).await.unwrap();
        // The replay makes the map.
        while client.find_map("twin").await.unwrap().is_none() {
            tokio::task::yield_now().await;
        }
        let mut watch = client.watch("twin", WatchOptions::default()).await.unwrap();
        while watch.mirror().keyframes.len() < keyframes {
            watch.next().await.unwrap();
        }
    });
}

/// What the server says of the map.
fn show(workspace: &Workspace, url: &str) -> Value {
    workspace.json(&format!("map show twin --json --server {url}"), &[])
}

fn undisturbed(workspace: &Workspace, folder: &Path) -> (Value, Value) {
    let server = Running::start(workspace, folder);
    let ran = ended(replay(workspace, &server.url, &[]));
    assert_eq!(ran.code, Some(0), "{}", ran.stderr);
    (serde_json::from_str(&ran.stdout).unwrap(), show(workspace, &server.url))
}

#[test]
fn a_replay_survives_kills_of_the_server_and_ends_with_the_same_map() {
    let workspace = Workspace::new();
    let (expected, map) = undisturbed(&workspace, &workspace.path("calm"));
    for level in ["received", "durable", "optimized"] {
        assert_eq!(expected[level], 6, "{expected}");
    }
    let folder = workspace.path("shaken");
    let mut server = Running::start(&workspace, &folder);
    let child = replay(&workspace, &server.url, &["--rate", "4", "--reconnect-for", "60"]);
    for keyframes in [1, 3, 4] {
        hold(&server.url, keyframes);
        server.kill();
        server = server.again(&workspace, &folder);
    }
    let ran = ended(child);
    assert_eq!(ran.code, Some(0), "{}", ran.stderr);
    let json: Value = serde_json::from_str(&ran.stdout).unwrap();
    assert_eq!(json, expected);
    let shaken = show(&workspace, &server.url);
    for key in ["keyframes", "landmarks", "observations", "constraints", "cameras"] {
        assert_eq!(shaken[key], map[key], "{key}");
    }
    for key in ["keyframe_ids_digest", "state_hash"] {
        assert_eq!(shaken[key], map[key], "{key}");
        assert_eq!(map[key].as_str().unwrap().len(), 64, "{key}");
    }
    // A stream that is opened again is an event.
    assert!(shaken["revision"].as_i64() > map["revision"].as_i64());
    assert_eq!(shaken["clients"][0]["next_sequence"], map["clients"][0]["next_sequence"]);
}

#[test]
fn a_replay_gives_up_when_it_was_told_to_and_says_how_far_it_came() {
    let workspace = Workspace::new();
    let folder = workspace.path("maps");
    let mut server = Running::start(&workspace, &folder);
    let child = replay(&workspace, &server.url, &["--rate", "4", "--reconnect-for", "0.2"]);
    hold(&server.url, 2);
    server.kill();
    let ran = ended(child);
    assert_eq!(ran.code, Some(1), "{}", ran.stderr);
    assert!(ran.stderr.starts_with("error: gave up after"), "{}", ran.stderr);
    let json: Value = serde_json::from_str(&ran.stdout).unwrap();
    let level = |key: &str| json[key].as_u64().unwrap();
    assert!(level("durable") <= level("received") && level("received") <= 6, "{json}");
    assert!(level("sent") >= 1 && json.get("cost_after").is_none(), "{json}");
    let wrong = workspace.run("replay x --rate 0", &[]);
    assert_eq!(wrong.code, Some(2), "{}", wrong.stderr);
}

#[test]
fn a_replay_that_gave_up_leaves_its_items_to_the_next_one() {
    let workspace = Workspace::new();
    let (expected, map) = undisturbed(&workspace, &workspace.path("calm"));
    let folder = workspace.path("maps");
    let mut server = Running::start(&workspace, &folder);
    let spill = workspace.path("spill");
    let spill_dir = ["--spill-dir", spill.to_str().unwrap()];
    let more = [&spill_dir[..], &["--rate", "4", "--reconnect-for", "1"]].concat();
    let child = replay(&workspace, &server.url, &more);
    hold(&server.url, 2);
    server.kill();
    let ran = ended(child);
    assert_eq!(ran.code, Some(1), "{}", ran.stderr);
    assert!(spill.join("twin.window-6-80.spill").exists());
    server = server.again(&workspace, &folder);
    let ran = ended(replay(&workspace, &server.url, &[&spill_dir[..], &["--append"]].concat()));
    assert_eq!(ran.code, Some(0), "{}", ran.stderr);
    let json: Value = serde_json::from_str(&ran.stdout).unwrap();
    for key in ["sent", "acknowledged", "rejected", "received", "durable", "optimized"] {
        assert_eq!(json[key], expected[key], "{key}: {json}");
    }
    assert_eq!(show(&workspace, &server.url)["state_hash"], map["state_hash"]);
    assert!(!spill.join("twin.window-6-80.spill").exists());
}

#[cfg(unix)]
#[test]
fn a_replay_that_is_terminated_says_how_far_it_came() {
    let workspace = Workspace::new();
    let server = Running::start(&workspace, &workspace.path("maps"));
    let child = replay(&workspace, &server.url, &["--rate", "0.01"]);
    hold(&server.url, 1);
    child.signal(Signal::TERM);
    let ran = ended(child);
    assert_eq!((ran.code, ran.stderr.as_str()), (Some(1), "error: SIGTERM\n"));
    let json: Value = serde_json::from_str(&ran.stdout).unwrap();
    assert_eq!((&json["sent"], &json["rejected"]), (&2.into(), &0.into()), "{json}");
}
