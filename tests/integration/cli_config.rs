//! Configuration through the real binary, and `covis serve` from start to signal.
//!
//! `solve --json` tells how many threads it was given, `serve` where it listens: that is how the
//! tests see which source won.

use std::io::{BufRead, BufReader};
use std::process::{Command, Stdio};

use serde_json::Value;

use crate::cli_support::{Ran, Workspace, golden};
use crate::process::Process;
#[cfg(unix)]
use crate::process::Signal;

/// Solves a small problem in `workspace` and returns the run.
fn solve(workspace: &Workspace, flags: &[&str], variables: &[(&str, &str)]) -> Ran {
    let mut command = workspace.command();
    command.args(["solve", "bundle", "--json", "--max-iterations", "1"]).args(flags);
    command.arg(golden("twins/window-6-80.txt")).envs(variables.iter().copied());
    Ran::of(command.output().unwrap())
}

fn threads(ran: &Ran) -> u64 {
    assert_eq!(ran.code, Some(0), "{}", ran.stderr);
    serde_json::from_str::<Value>(&ran.stdout).unwrap()["threads"].as_u64().unwrap()
}

#[test]
fn flags_win_over_environment_over_file() {
    let workspace = Workspace::new();
    workspace.file("covis.toml", "threads = 5\n");
    workspace.file("other.toml", "threads = 6\n");
    let variable = [("COVIS_THREADS", "4")];
    assert_eq!(threads(&solve(&workspace, &[], &[])), 5);
    assert_eq!(threads(&solve(&workspace, &["--config", "other.toml"], &[])), 6);
    assert_eq!(threads(&solve(&workspace, &[], &[("COVIS_CONFIG", "other.toml")])), 6);
    assert_eq!(threads(&solve(&workspace, &[], &variable)), 4);
    assert_eq!(threads(&solve(&workspace, &["--threads", "3"], &variable)), 3);
}

#[test]
fn an_unknown_variable_warns_on_standard_error_only() {
    let workspace = Workspace::new();
    let ran = solve(&workspace, &["--threads", "1"], &[("COVIS_THREDS", "4")]);
    assert_eq!(threads(&ran), 1);
    assert!(ran.stderr.contains("WARN") && ran.stderr.contains("COVIS_THREDS"), "{}", ran.stderr);
    let ran = solve(&workspace, &[], &[("COVIS_TEST_ANYTHING", "4"), ("OTHER_THREDS", "4")]);
    assert_eq!((ran.code, ran.stderr.as_str()), (Some(0), ""));
}

#[test]
fn what_cannot_be_read_is_a_failure_with_one_line() {
    let workspace = Workspace::new();
    workspace.file("covis.toml", "threads = 2\n\nthreds = 5\n");
    solve(&workspace, &[], &[]).expect_failure(&["covis.toml, line 3", "threds"]);
    workspace.file("covis.toml", "threads = true\n");
    solve(&workspace, &[], &[]).expect_failure(&["covis.toml, line 1", "threads = true"]);
    workspace.file("covis.toml", "");
    solve(&workspace, &["--config", "none.toml"], &[]).expect_failure(&["none.toml"]);
    solve(&workspace, &[], &[("COVIS_THREADS", "x")]).expect_failure(&["COVIS_THREADS", "`x`"]);
    solve(&workspace, &["--threads", "0"], &[]).expect_failure(&["threads", "at least 1"]);
    solve(&workspace, &["--log", "loud"], &[]).expect_failure(&["log"]);
    let ran = solve(&workspace, &["--log-format", "xml"], &[]);
    assert_eq!(ran.code, Some(2), "{}", ran.stderr);
    solve(&workspace, &[], &[("COVIS_LOG_FORMAT", "xml")]).expect_failure(&["text or json"]);
    solve(&workspace, &[], &[("COVIS_METRICS_LISTEN", "9")]).expect_failure(&["metrics_listen"]);
    solve(&workspace, &[], &[("COVIS_DRAIN_BUDGET", "-1")]).expect_failure(&["DRAIN_BUDGET"]);
}

#[test]
fn a_collector_is_for_serve_alone() {
    let workspace = Workspace::new();
    let ran = workspace.run("serve --in-memory --otlp-endpoint nowhere:at:all", &[]);
    ran.expect_failure(&["exporting spans", "nowhere:at:all"]);
    // Other commands export nothing, and do not ask whether they could.
    let variable = [("COVIS_OTLP_ENDPOINT", "nowhere:at:all")];
    assert_eq!(solve(&workspace, &["--threads", "1"], &variable).code, Some(0));
}

#[test]
fn a_reader_that_leaves_early_is_no_failure() {
    let workspace = Workspace::new();
    let mut command = workspace.command();
    command.args(["solve", "bundle"]).arg(golden("twins/window-6-80.txt"));
    let mut child = Process::spawn(command.stdout(Stdio::piped()).stderr(Stdio::piped()));
    // The pipe's only reader goes away at once; most lines find nobody.
    drop(child.stdout.take());
    let ran = Ran::of(child.output());
    assert_eq!((ran.code, ran.stderr.as_str()), (Some(0), ""));
}

/// Starts a server and reads the address that it tells.
fn serve(command: &mut Command) -> (Process, String) {
    let mut running = Process::spawn(command.stdout(Stdio::piped()).stderr(Stdio::null()));
    let mut line = String::new();
    BufReader::new(running.stdout.take().unwrap()).read_line(&mut line).unwrap();
    let address = line.trim().strip_prefix("listening on http://");
    let address = address.unwrap_or_else(|| panic!("`{line}`")).to_owned();
    (running, address)
}

#[test]
fn serve_tells_its_address_and_takes_connections() {
    let workspace = Workspace::new();
    workspace.file("covis.toml", "listen = \"127.0.0.1:0\"\n");
    let (_running, address) = serve(workspace.command().args(["serve", "--in-memory"]));
    assert!(address.starts_with("127.0.0.1:") && !address.ends_with(":0"), "{address}");
    std::net::TcpStream::connect(&address).unwrap();
    // The address is taken now: a second server says so.
    let ran = workspace.run(&format!("serve --in-memory --listen {address}"), &[]);
    ran.expect_failure(&["cannot listen on", &address]);
}

#[test]
fn a_server_reports_the_instruction_set_that_it_was_made_to_use() {
    let workspace = Workspace::new();
    let mut command = workspace.command();
    command.args(["serve", "--in-memory", "--listen", "127.0.0.1:0"]).env("COVIS_SIMD", "scalar");
    let (_running, address) = serve(&mut command);
    crate::common::run(async {
        let client = covis_client::Client::connect(&format!("http://{address}")).await.unwrap();
        assert_eq!(client.server_info().await.unwrap().simd_class, "scalar");
    });
}

#[cfg(unix)]
#[test]
fn both_signals_end_the_server_with_success() {
    for signal in [Signal::TERM, Signal::INT] {
        let workspace = Workspace::new();
        let (mut running, _) =
            serve(workspace.command().args(["serve", "--in-memory", "--listen", "127.0.0.1:0"]));
        running.signal(signal);
        assert_eq!(running.wait().unwrap().code(), Some(0), "{signal:?}");
    }
}
