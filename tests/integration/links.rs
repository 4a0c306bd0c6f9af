//! Links whose other end is gone without a word: both sides find it, the client resumes and nothing is lost
//! or doubled; and an OPTIMIZED that was lost with a link is reported again.
//!
//! Probes are configured to be quick; the tests wait for what happens, not for time.

use std::io::{BufRead, BufReader};
use std::process::Stdio;
use std::sync::{Arc, Mutex};
use std::time::Duration;

use covis::client::{
    Client, ClientError, Credentials, LinkOptions, RetryPolicy, SessionOptions, Token, WatchOptions,
};
use covis::service::{KeepAlive, Server, ServerConfig};
use covis::wire::v1;
use tonic::Code;

use crate::cli_support::{Ran, Running, Workspace, golden};
use crate::common::{TestServer, camera, keyframe, occupy, run};
use crate::process::Process;
use crate::proxy::Proxy;

/// Long enough for a busy machine, short enough for a test.
const QUICK: Duration = Duration::from_millis(300);

fn patient() -> SessionOptions {
    let delay = Duration::from_millis(1);
    let max_attempts = u32::MAX;
    let retry = RetryPolicy {
        max_attempts,
        first_delay: delay,
        longest_delay: delay,
        ..RetryPolicy::default()
    };
    SessionOptions { retry, ..SessionOptions::default() }
}

async fn over(proxy: &Proxy, link: LinkOptions) -> Client {
    Client::connect_over(&proxy.url(), &Credentials::default(), link).await.unwrap()
}

/// A link that is probed often.
fn probing() -> LinkOptions {
    LinkOptions { keep_alive: QUICK, keep_alive_timeout: QUICK, ..LinkOptions::default() }
}

async fn direct(server: &TestServer) -> Client {
    Client::connect(&format!("http://{}", server.running.local_addr())).await.unwrap()
}

#[test]
fn a_client_finds_a_link_that_is_half_open_and_resumes() {
    run(async {
        let server = TestServer::start().await;
        server.create_map("room").await;
        let proxy = Proxy::to(server.running.local_addr()).await;
        let mut session =
            over(&proxy, probing()).await.ingest("room", "robot", patient()).await.unwrap();
        session.send(camera(0)).await.unwrap();
        session.send(keyframe(0)).await.unwrap();
        session.flush().await.unwrap();
        proxy.freeze();
        for id in 1..8 {
            session.send(keyframe(id)).await.unwrap();
        }
        let report = session.finish().await.unwrap();
        assert_eq!((report.sent, report.acknowledged, report.rejected), (9, 9, 0));
        assert!(report.reconnects >= 1);
        let map = direct(&server).await.get_map("room").await.unwrap();
        assert_eq!(map.counts.unwrap().keyframe_count, 8);
        assert_eq!(map.clients[0].next_sequence, 10);
    });
}

#[test]
fn a_watch_over_a_link_that_is_half_open_goes_on() {
    run(async {
        let server = TestServer::start().await;
        server.create_map("room").await;
        let proxy = Proxy::to(server.running.local_addr()).await;
        let options = WatchOptions { retry: patient().retry, ..WatchOptions::default() };
        let mut watch = over(&proxy, probing()).await.watch("room", options).await.unwrap();
        watch.next().await.unwrap();
        proxy.freeze();
        server.build_map("room", 3).await;
        while watch.mirror().keyframes.len() < 3 {
            watch.next().await.unwrap();
        }
    });
}

#[test]
fn a_server_ends_the_streams_of_a_client_that_is_gone() {
    run(async {
        let keep_alive = KeepAlive { interval: QUICK, timeout: QUICK, ..KeepAlive::default() };
        let server = TestServer::with(|config| config.keep_alive = keep_alive).await;
        server.create_map("room").await;
        let proxy = Proxy::to(server.running.local_addr()).await;
        let client = over(&proxy, LinkOptions::default()).await;
        let mut gone = client.ingest("room", "robot", patient()).await.unwrap();
        gone.send(camera(0)).await.unwrap();
        gone.flush().await.unwrap();
        proxy.freeze();
        proxy.given_up(1).await;
        let mut next = direct(&server).await.ingest("room", "robot", patient()).await.unwrap();
        assert_eq!((next.opened().epoch, next.next_sequence()), (2, 2));
        next.send(keyframe(0)).await.unwrap();
        assert_eq!(next.finish().await.unwrap().acknowledged, 1);
    });
}

#[test]
fn a_call_over_a_link_that_is_half_open_ends_by_its_deadline() {
    run(async {
        let server = TestServer::start().await;
        let proxy = Proxy::to(server.running.local_addr()).await;
        let link = LinkOptions { deadline: QUICK, ..LinkOptions::default() };
        let client = over(&proxy, link).await;
        client.server_info().await.unwrap();
        proxy.freeze();
        let error = client.server_info().await.unwrap_err();
        assert!(matches!(error.code(), Some(Code::Cancelled | Code::DeadlineExceeded)), "{error}");
    });
}

#[test]
fn an_optimized_that_was_lost_with_the_link_is_told_by_the_next_one() {
    run(async {
        let server = TestServer::start().await;
        server.create_map("room").await;
        let proxy = Proxy::to(server.running.local_addr()).await;
        let client = over(&proxy, LinkOptions::default()).await;
        let told = Arc::new(Mutex::new(Vec::new()));
        let acks = Arc::clone(&told);
        let options = patient().on_ack(move |ack| {
            if ack.status() == v1::AckStatus::Optimized {
                acks.lock().unwrap().push(ack.sequence);
            }
        });
        let mut session = client.ingest("room", "robot", options).await.unwrap();
        session.send(camera(0)).await.unwrap();
        session.send(keyframe(0)).await.unwrap();
        session.send(keyframe(1)).await.unwrap();
        session.optimized(3).await.unwrap();
        let busy = occupy(&server).await;
        session.send(keyframe(2)).await.unwrap();
        session.flush().await.unwrap();
        // The solve ends while nothing comes through to the client.
        proxy.hold(true);
        let watcher = direct(&server).await;
        let mut watch = watcher.watch("room", WatchOptions::default()).await.unwrap();
        let before = watch.next().await.unwrap().revision;
        drop(busy);
        watch.reach(before + 1).await.unwrap();
        proxy.cut();
        proxy.hold(false);
        session.optimized(4).await.unwrap();
        let report = session.finish().await.unwrap();
        assert_eq!((report.acknowledged, report.duplicates, report.optimized_through), (4, 0, 4));
        assert_eq!(told.lock().unwrap().last(), Some(&4));
    });
}

#[test]
fn a_client_repeats_calls_that_a_server_did_not_begin_and_those_that_change_nothing() {
    run(async {
        let listener = tokio::net::TcpListener::bind("127.0.0.1:0").await.unwrap();
        let address = listener.local_addr().unwrap();
        let starting = Server::listen(listener, ServerConfig::default()).await.unwrap();
        let proxy = Proxy::to(address).await;
        let link = LinkOptions { retry: patient().retry, ..LinkOptions::default() };
        let client = over(&proxy, link).await;
        let once = client.with_retry(RetryPolicy::once());
        let error = once.create_map("room", None).await.unwrap_err();
        assert_eq!(error.reason().as_deref(), Some("STARTING"));
        let (created, running) = tokio::join!(client.create_map("room", None), starting.open());
        assert_eq!(created.unwrap().map_id, "room");
        // What fails last is what the call ends with.
        proxy.close();
        proxy.cut();
        let error = once.get_map("room").await.unwrap_err();
        assert!(matches!(error, ClientError::Rpc { rpc: "GetMap", .. }), "{error}");
        let error = client.delete_map("room").await.unwrap_err();
        assert!(matches!(error, ClientError::Rpc { rpc: "DeleteMap", .. }), "{error}");
        let back = async {
            once.get_map("room").await.unwrap_err();
            proxy.open();
        };
        let (map, ()) = tokio::join!(client.get_map("room"), back);
        assert_eq!(map.unwrap().map_id, "room");
        running.unwrap().shutdown().await;
    });
}

/// A command that says when it tries again, and waits for a minute.
fn waiting(workspace: &Workspace, url: &str, arguments: &[&str]) -> Process {
    let mut command = workspace.command();
    command.args(["--log", "off,covis_client::retry=debug"]).args(arguments);
    command.args(["--server", url, "--server-wait", "60"]);
    Process::spawn(command.stdout(Stdio::piped()).stderr(Stdio::piped()))
}

/// Why a command tries again.
fn tried(child: &mut Process) -> String {
    let mut log = BufReader::new(child.stderr.take().unwrap()).lines();
    let tried = log.find_map(|line| line.ok().filter(|line| line.contains("trying again")));
    // What else it says must not fill the pipe.
    std::thread::spawn(move || log.count());
    tried.unwrap()
}

#[test]
fn commands_wait_for_a_server_that_is_not_there_yet() {
    let workspace = Workspace::new();
    let folder = workspace.path("maps");
    let mut server = Running::start(&workspace, &folder);
    server.kill();
    let file = golden("twins/window-6-80.txt");
    let replay = ["replay", file.to_str().unwrap(), "--map", "twin"];
    let commands = [&replay[..], &["map", "list"], &["job", "list"]];
    let mut children = commands.map(|arguments| waiting(&workspace, &server.url, arguments));
    for child in &mut children {
        assert!(tried(child).contains("no server answers"));
    }
    let _server = server.again(&workspace, &folder);
    for child in children {
        let ran = Ran::of(child.output());
        assert_eq!(ran.code, Some(0), "{}", ran.stdout);
    }
}

#[test]
fn a_command_waits_for_a_server_that_still_opens_its_maps() {
    run(async {
        let workspace = Workspace::new();
        let listener = tokio::net::TcpListener::bind("127.0.0.1:0").await.unwrap();
        let url = format!("http://{}", listener.local_addr().unwrap());
        let starting = Server::listen(listener, ServerConfig::default()).await.unwrap();
        let at_once = format!("map list --server-wait 0 --server {url}");
        let (workspace, ran) = blocking(move || {
            let ran = workspace.run(&at_once, &[]);
            (workspace, ran)
        })
        .await;
        ran.expect_failure(&["the server still opens its maps"]);
        assert!(!ran.stderr.contains("waited"), "{}", ran.stderr);
        let briefly = format!("map list --server-wait 1 --server {url}");
        let (workspace, ran) = blocking(move || {
            let ran = workspace.run(&briefly, &[]);
            (workspace, ran)
        })
        .await;
        let waited = format!("waited 1 s for {url} to be ready");
        ran.expect_failure(&[&waited, "the server still opens its maps"]);
        let child = blocking(move || {
            let mut child = waiting(&workspace, &url, &["map", "list"]);
            assert!(tried(&mut child).contains("still opens its maps"));
            (workspace, child)
        });
        let (_workspace, child) = child.await;
        let running = starting.open().await.unwrap();
        let ran = blocking(move || Ran::of(child.output())).await;
        assert_eq!((ran.code, ran.stdout.as_str()), (Some(0), "no maps\n"));
        running.shutdown().await;
    });
}

async fn blocking<T: Send + 'static>(work: impl FnOnce() -> T + Send + 'static) -> T {
    tokio::task::spawn_blocking(work).await.unwrap()
}

#[test]
fn bad_credentials_are_not_tried_again() {
    run(async {
        let token = Some(Token::new("secret"));
        let credentials = Credentials { token, ..Credentials::default() };
        let calls = Mutex::new(0);
        let connect = || {
            *calls.lock().unwrap() += 1;
            Client::connect_with("http://robot.example:1", &credentials)
        };
        patient().retry.run(connect).await.unwrap_err();
        assert_eq!(*calls.lock().unwrap(), 1);
    });
}
