//! Connections without a token, or without use: they hold neither places nor memory for long, and whoever
//! has a token gets in.

use std::process::Command;
use std::time::{Duration, Instant};

use covis::client::{Client, Credentials, SessionOptions, Token};
use covis::service::{ConnectionLimits, ServerConfig};
use covis::wire::v1;
use covis_solvers::testing::skip;
use tempfile::NamedTempFile;
use tokio::io::{AsyncReadExt, AsyncWriteExt};
use tokio::net::TcpStream;
use tokio::task::JoinSet;
use tonic::Code;
use tonic::transport::Endpoint;
use tonic_health::pb::HealthCheckRequest;
use tonic_health::pb::health_client::HealthClient;
use v1::map_service_client::MapServiceClient;

use crate::cli_support::{Port, Running, Workspace};
use crate::common::{Stream, TestServer, camera, check_retry, check_status, run};
use crate::rpc_access::tokens_toml;

const PREFACE: &[u8] = b"PRI * HTTP/2.0\r\n\r\nSM\r\n\r\n";
const LIST_MAPS: &str = "/covis.v1.MapService/ListMaps";
const CHECK: &str = "/grpc.health.v1.Health/Check";
/// Types of frames.
const DATA: u8 = 0;
const HEADERS: u8 = 1;
const SETTINGS: u8 = 4;
const GO_AWAY: u8 = 7;
const END_HEADERS: u8 = 4;

/// A frame of HTTP/2.
fn frame(kind: u8, flags: u8, stream: u32, payload: &[u8]) -> Vec<u8> {
    let length = u32::try_from(payload.len()).unwrap().to_be_bytes();
    let mut bytes = length[1..].to_vec();
    bytes.extend([kind, flags]);
    bytes.extend(stream.to_be_bytes());
    bytes.extend(payload);
    bytes
}

/// The headers of a gRPC call on stream 1.
fn headers(path: &str) -> Vec<u8> {
    // POST and http are in the static table; all else is spelled out.
    let mut block = vec![0x83, 0x86, 0x04, u8::try_from(path.len()).unwrap()];
    block.extend(path.as_bytes());
    for (name, value) in [("content-type", "application/grpc"), ("te", "trailers")] {
        for text in [name, value] {
            block.extend((name == text).then_some(0));
            block.push(u8::try_from(text.len()).unwrap());
            block.extend(text.as_bytes());
        }
    }
    frame(HEADERS, END_HEADERS, 1, &block)
}

/// A message of 100 bytes of which three are there.
fn half_a_message() -> Vec<u8> {
    frame(DATA, 0, 1, &[0, 0, 0, 0, 100, 10, 98, 0])
}

/// Preface and settings, then these frames.
fn greeting(frames: &[Vec<u8>]) -> Vec<u8> {
    [PREFACE, &frame(SETTINGS, 0, 0, &[]), &frames.concat()].concat()
}

async fn raw(server: &TestServer, bytes: &[u8]) -> TcpStream {
    let mut socket = TcpStream::connect(server.running.local_addr()).await.unwrap();
    socket.write_all(bytes).await.unwrap();
    socket
}

/// Reads until the server ends the connection, however it does.
async fn read_to_end(mut socket: TcpStream) -> Vec<u8> {
    let mut bytes = Vec::new();
    let _ended = socket.read_to_end(&mut bytes).await;
    bytes
}

/// Types and streams of the frames in `bytes`.
fn kinds(mut bytes: &[u8]) -> Vec<(u8, u32)> {
    let mut kinds = Vec::new();
    while let [a, b, c, kind, _, s, t, u, v, rest @ ..] = bytes {
        kinds.push((*kind, u32::from_be_bytes([*s, *t, *u, *v])));
        bytes = rest.get(u32::from_be_bytes([0, *a, *b, *c]) as usize..).unwrap_or_default();
    }
    kinds
}

fn limited(limits: ConnectionLimits) -> impl FnOnce(&mut ServerConfig) {
    move |config| config.connections = limits
}

/// A server that knows the token of "robot"; the file must live as long as it.
async fn guarded(limits: ConnectionLimits) -> (TestServer, NamedTempFile) {
    let tokens = NamedTempFile::new().unwrap();
    fs_err::write(tokens.path(), tokens_toml(&[("robot", "acme", "admin")])).unwrap();
    let path = tokens.path().to_owned();
    let server = TestServer::with(|config| {
        config.tokens = Some(path);
        config.connections = limits;
    })
    .await;
    (server, tokens)
}

async fn robot_lists_maps(server: &TestServer) {
    let url = format!("http://{}", server.running.local_addr());
    let token = Some(Token::new("secret-of-robot"));
    let credentials = Credentials { token, ..Credentials::default() };
    let client = Client::connect_with(&url, &credentials).await.unwrap();
    assert!(client.list_maps().await.unwrap().is_empty());
}

#[test]
fn strangers_in_every_place_do_not_keep_a_robot_out() {
    run(async {
        let limits = ConnectionLimits {
            max_connections: 8,
            max_strangers: 4,
            stranger_time: Duration::from_secs(3600),
            ..ConnectionLimits::default()
        };
        let (server, _tokens) = guarded(limits).await;
        let mut strangers = Vec::new();
        for _ in 0..20 {
            strangers.push(raw(&server, &greeting(&[headers(CHECK), half_a_message()])).await);
        }
        robot_lists_maps(&server).await;
        // The first ones made room.
        for stranger in strangers.drain(..16) {
            read_to_end(stranger).await;
        }
    });
}

/// A process of its own, whose descriptors are soon used up.
#[cfg(unix)]
#[test]
fn strangers_leave_descriptors_for_maps() {
    let workspace = Workspace::new();
    let own = workspace.command();
    let mut command = Command::new("sh");
    command.args(["-c", "ulimit -n 64 && exec \"$0\" \"$@\""]).arg(own.get_program());
    own.get_envs().for_each(|(name, _)| {
        command.env_remove(name);
    });
    let server = Running::spawn(command, Port::reserve(), &workspace.path("maps"), &[]);
    run(async {
        let address = server.url.strip_prefix("http://").unwrap();
        let mut strangers = Vec::new();
        for _ in 0..200 {
            strangers.push(TcpStream::connect(address).await);
        }
        let client = Client::connect(&server.url).await.unwrap();
        for map in ["room", "hall"] {
            client.create_map(map, None).await.unwrap();
            let options = SessionOptions::default();
            let mut session = client.ingest(map, "robot", options).await.unwrap();
            session.send(camera(0)).await.unwrap();
            assert_eq!(session.finish().await.unwrap().acknowledged, 1);
        }
    });
}

#[test]
fn ten_thousand_idle_strangers_do_not_keep_a_robot_out() {
    const STRANGERS: usize = 10_000;
    // Of each connection both ends are in this process.
    let limits = fs_err::read_to_string("/proc/self/limits").unwrap_or_default();
    let line = limits.lines().find_map(|line| line.strip_prefix("Max open files"));
    let files: usize = line
        .and_then(|line| line.split_whitespace().next())
        .and_then(|files| files.parse().ok())
        .unwrap_or(0);
    if files < STRANGERS + 4000 {
        skip(&format!("{STRANGERS} connections need more files than {files}"));
        return;
    }
    run(async {
        let (server, _tokens) = guarded(ConnectionLimits::default()).await;
        let mut strangers = Vec::new();
        for _ in 0..STRANGERS {
            strangers.push(TcpStream::connect(server.running.local_addr()).await.unwrap());
        }
        let start = Instant::now();
        robot_lists_maps(&server).await;
        eprintln!("{STRANGERS} strangers: a robot has its answer after {:?}", start.elapsed());
        assert_eq!(strangers.len(), STRANGERS);
    });
}

#[test]
fn whoever_says_nothing_or_half_of_something_is_closed() {
    run(async {
        let limits = ConnectionLimits {
            stranger_time: Duration::from_millis(50),
            ..ConnectionLimits::default()
        };
        let (server, _tokens) = guarded(limits).await;
        let half_headers = frame(HEADERS, 0, 1, &[0x83, 0x86]);
        let half_a_frame = headers(CHECK)[..20].to_vec();
        let inputs = [
            Vec::new(),
            PREFACE[..10].to_vec(),
            PREFACE.to_vec(),
            greeting(&[]),
            greeting(&[half_headers]),
            greeting(&[half_a_frame]),
            greeting(&[headers(CHECK)]),
            greeting(&[headers(CHECK), half_a_message()]),
            // Without a token a call does not make a connection known.
            greeting(&[headers(LIST_MAPS), half_a_message()]),
        ];
        let mut reading = JoinSet::new();
        for input in inputs {
            reading.spawn(read_to_end(raw(&server, &input).await));
        }
        assert_eq!(reading.join_all().await.len(), 9);
    });
}

#[test]
fn a_connection_without_calls_is_told_to_go_away() {
    run(async {
        let limits = ConnectionLimits {
            idle_time: Duration::from_millis(50),
            ..ConnectionLimits::default()
        };
        let server = TestServer::with(limited(limits)).await;
        // An empty message, complete.
        let message = frame(DATA, 1, 1, &[0; 5]);
        let socket = raw(&server, &greeting(&[headers(LIST_MAPS), message])).await;
        let kinds = kinds(&read_to_end(socket).await);
        let answer = kinds.iter().position(|&frame| frame == (HEADERS, 1));
        let goodbye = kinds.iter().position(|&frame| frame == (GO_AWAY, 0));
        assert!(answer.is_some() && answer < goodbye, "{kinds:?}");
        // A client that reconnects notices nothing.
        for _ in 0..3 {
            server.maps().list_maps(v1::ListMapsRequest::default()).await.unwrap();
        }
    });
}

#[test]
fn a_message_that_is_begun_and_not_sent_on_ends_its_call() {
    run(async {
        let limits = ConnectionLimits {
            message_time: Duration::from_millis(50),
            ..ConnectionLimits::default()
        };
        let server = TestServer::with(|config| {
            config.connections = limits;
            config.metrics_listen = Some("127.0.0.1:0".to_owned());
        })
        .await;
        let frames = [headers(LIST_MAPS), half_a_message()];
        let mut socket = raw(&server, &greeting(&frames)).await;
        let mut bytes = Vec::new();
        while !kinds(&bytes).contains(&(HEADERS, 1)) {
            assert_ne!(socket.read_buf(&mut bytes).await.unwrap(), 0, "closed without an answer");
        }
        let mut page = TcpStream::connect(server.running.metrics_addr().unwrap()).await.unwrap();
        page.write_all(b"GET /metrics HTTP/1.1\r\nhost: covis\r\n\r\n").await.unwrap();
        let page = String::from_utf8(read_to_end(page).await).unwrap();
        let row =
            "covis_rpcs_total{rpc=\"covis.v1.MapService/ListMaps\",code=\"DEADLINE_EXCEEDED\"} 1";
        assert!(page.contains(row), "{page}");
        assert!(page.contains("covis_connections{state=\"known\"} 1"), "{page}");
    });
}

#[test]
fn health_takes_small_messages_only() {
    run(async {
        let server = TestServer::start().await;
        let mut health = HealthClient::new(server.channel.clone());
        let mut check = async |length| {
            health.check(HealthCheckRequest { service: "x".repeat(length) }).await.unwrap_err()
        };
        assert_eq!(check(4000).await.code(), Code::NotFound);
        assert_eq!(check(5000).await.code(), Code::OutOfRange);
    });
}

#[test]
fn where_every_place_is_in_use_the_limit_is_named() {
    run(async {
        let limits = ConnectionLimits {
            max_connections: 2,
            max_strangers: 1,
            ..ConnectionLimits::default()
        };
        let server = TestServer::with(limited(limits)).await;
        server.create_map("house").await;
        let (stream, _) = Stream::open(&server, "house", "robot", 0).await;
        let url = format!("http://{}", server.running.local_addr());
        let channel = Endpoint::from_shared(url).unwrap().connect().await.unwrap();
        let mut maps = MapServiceClient::new(channel);
        let status = maps.list_maps(v1::ListMapsRequest::default()).await.unwrap_err();
        check_status(&status, Code::ResourceExhausted, "SERVER_LIMIT");
        check_retry(&status);
        // The connection stays, and is taken when there is a place.
        stream.finish().await.unwrap();
        maps.list_maps(v1::ListMapsRequest::default()).await.unwrap();
    });
}
