//! Log lines of the real binary: one JSON object each where that is asked for, with the spans' fields,
//! and never a secret, whatever the level.

use std::io::{BufRead, BufReader, Read};
use std::process::{Command, Stdio};
use std::thread::JoinHandle;

use covis::client::{Client, Credentials, SessionOptions, Token};
use serde_json::Value;
use sha2::{Digest, Sha256};
use v1::ingest_request::Item;

use covis::wire::v1;

use crate::cli_support::Workspace;
use crate::common::{camera, keyframe, run};
use crate::process::Process;
#[cfg(unix)]
use crate::process::Signal;
use crate::rpc_access::tokens_toml;
use crate::tls::Authority;

/// A server whose log is read to its end, however much it is.
struct Logged {
    child: Process,
    /// What it told on standard output.
    told: Vec<String>,
    log: Option<JoinHandle<String>>,
}

impl Logged {
    fn start(mut command: Command, lines: usize) -> Self {
        let mut child = Process::spawn(command.stdout(Stdio::piped()).stderr(Stdio::piped()));
        let mut stderr = child.stderr.take().unwrap();
        let log = std::thread::spawn(move || {
            let mut log = String::new();
            stderr.read_to_string(&mut log).unwrap();
            log
        });
        let told = BufReader::new(child.stdout.take().unwrap()).lines();
        let told = told.take(lines).map(Result::unwrap).collect();
        Self { child, told, log: Some(log) }
    }

    fn url(&self) -> &str {
        self.told[0].strip_prefix("listening on ").unwrap()
    }

    /// Ends the server and returns its log.
    fn end(mut self) -> String {
        self.child.signal(Signal::TERM);
        assert_eq!(self.child.wait().unwrap().code(), Some(0));
        self.log.take().unwrap().join().unwrap()
    }
}

/// The objects of a log.
#[track_caller]
fn objects(log: &str) -> Vec<Value> {
    let parse = |line: &str| serde_json::from_str(line).unwrap_or_else(|e| panic!("{e}: {line}"));
    log.lines().map(parse).collect()
}

fn serve(workspace: &Workspace, arguments: &[&str]) -> Command {
    let mut command = workspace.command();
    command.args(["serve", "--in-memory", "--listen", "127.0.0.1:0", "--threads", "1"]);
    command.args(arguments);
    command
}

#[cfg(unix)]
#[test]
fn at_the_lowest_level_json_lines_tell_of_maps_and_solves_and_of_no_secret() {
    let workspace = Workspace::new();
    let authority = Authority::new();
    let (certificate, key) = authority.issue("127.0.0.1");
    workspace.file("cert.pem", &certificate);
    workspace.file("key.pem", &key);
    workspace.file("tokens.toml", &tokens_toml(&[("robot", "acme", "admin")]));
    let files = ["--tls-cert", "cert.pem", "--tls-key", "key.pem", "--tokens", "tokens.toml"];
    let mut command = serve(&workspace, &files);
    command.args(["--log", "trace", "--log-format", "json"]);
    let server = Logged::start(command, 2);
    let known = |token: &str| Credentials {
        ca_pem: Some(authority.pem.clone().into_bytes()),
        token: Some(Token::new(token)),
        ..Credentials::default()
    };
    run(async {
        let client = Client::connect_with(server.url(), &known("secret-of-robot")).await.unwrap();
        client.create_map("house", None).await.unwrap();
        let mut session = client.ingest("house", "robot", SessionOptions::default()).await.unwrap();
        session.send(Item::Camera(camera(0))).await.unwrap();
        for id in 0..3 {
            session.send(Item::Keyframe(keyframe(id))).await.unwrap();
        }
        session.finish().await.unwrap();
        let stranger = Client::connect_with(server.url(), &known("secret-of-nobody")).await;
        stranger.unwrap().list_maps().await.unwrap_err();
    });
    server.child.signal(Signal::HUP);
    let log = server.end();

    let objects = objects(&log);
    for line in &objects {
        for key in ["timestamp", "level", "target"] {
            assert!(line[key].is_string(), "no {key} in {line}");
        }
    }
    let has = |name: &str, fields: &[&str]| {
        objects.iter().any(|line| {
            let spans = line["spans"].as_array();
            spans.into_iter().flatten().any(|span| {
                span["name"] == name && fields.iter().all(|field| !span[field].is_null())
            })
        })
    };
    assert!(has("map", &["map"]), "no line of a map");
    assert!(has("solve", &["map", "solve", "kind"]), "no line of a solve");
    assert!(has("rpc", &["rpc"]), "no line of a call");
    assert!(objects.iter().any(|line| line["message"] == "map created"));
    let digest = |token: &str| -> String {
        Sha256::digest(token).iter().map(|byte| format!("{byte:02x}")).collect()
    };
    let mut secrets: Vec<String> = key.lines().map(str::to_owned).collect();
    for token in ["secret-of-robot", "secret-of-nobody"] {
        secrets.extend([token.to_owned(), digest(token)]);
        // As a list of bytes, which is how buffers are told.
        secrets.push(format!("{:?}", token.as_bytes()).trim_matches(['[', ']']).to_owned());
    }
    for secret in secrets.iter().filter(|secret| !secret.starts_with("-----")) {
        let place = log.lines().find(|line| line.contains(secret));
        assert!(place.is_none(), "`{secret}` in {place:?}");
    }
}

#[cfg(unix)]
#[test]
fn a_panic_is_an_object_too_and_text_stays_the_default() {
    let workspace = Workspace::new();
    let mut command = serve(&workspace, &["--metrics-listen", "127.0.0.1:0"]);
    command.env("COVIS_LOG_FORMAT", "json").env("COVIS_TEST_FAULT", "rpc:ListMaps");
    let server = Logged::start(command, 3);
    let metrics = server.told[2].strip_prefix("metrics on http://127.0.0.1:").unwrap();
    let port: u16 = metrics.strip_suffix("/metrics").unwrap().parse().unwrap();
    std::net::TcpStream::connect(("127.0.0.1", port)).unwrap();
    run(async {
        let client = Client::connect(server.url()).await.unwrap();
        client.list_maps().await.unwrap_err();
    });
    let objects = objects(&server.end());
    let panicked = objects.iter().find(|line| {
        let message = line["message"].as_str().unwrap_or_default();
        message.contains("panic: the fault that a test asked for")
    });
    assert_eq!(panicked.unwrap()["level"], "ERROR");

    let server = Logged::start(serve(&workspace, &[]), 2);
    let log = server.end();
    assert!(log.contains("INFO") && !log.contains('{'), "{log}");
}
