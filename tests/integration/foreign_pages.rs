//! What a page of another site can have a browser send to the listener of gRPC: it is refused before it is
//! read, whatever service it is for, also where a client certificate goes with it.

use std::future::poll_fn;

use covis::service::{ServerConfig, TlsFiles};
use covis::wire::v1;
use http_body_util::StreamBody;
use hyper::body::{Bytes, Frame};
use prost::Message;
use tokio::io::{AsyncReadExt, AsyncWriteExt};
use tokio::net::{TcpListener, TcpStream};
use tonic::Status;
use tonic::body::Body;
use tonic::codegen::Service;
use tonic::codegen::http::{Request, Response};
use tonic::transport::{Certificate, Channel, ClientTlsConfig, Endpoint, Identity};
use v1::map_service_client::MapServiceClient;

use crate::common::{TestServer, run};
use crate::rpc_access::rpcs;
use crate::tls::Authority;

const DELETE_MAP: &str = "/covis.v1.MapService/DeleteMap";
const GRPC: (&str, &str) = ("content-type", "application/grpc");

/// Content types with which a browser posts for any page without asking the server first.
const SIMPLE: [&str; 4] = [
    "text/plain;charset=UTF-8",
    "text/plain; application/grpc",
    "application/x-www-form-urlencoded",
    "multipart/form-data; boundary=x",
];

/// Sends a request over HTTP/2 as it is.
async fn send(
    channel: &Channel,
    (method, path): (&str, &str),
    headers: &[(&str, &str)],
    body: Body,
) -> Response<Body> {
    let mut request = Request::builder().method(method).uri(path);
    for (name, value) in headers {
        request = request.header(*name, *value);
    }
    let mut channel = channel.clone();
    poll_fn(|cx| channel.poll_ready(cx)).await.unwrap();
    channel.call(request.body(body).unwrap()).await.unwrap()
}

/// A body that is never complete.
fn endless() -> Body {
    Body::new(StreamBody::new(tokio_stream::pending::<Result<Frame<Bytes>, Status>>()))
}

/// The one message of a call.
fn framed(message: &impl Message) -> Body {
    let bytes = message.encode_to_vec();
    let size = u32::try_from(bytes.len()).unwrap().to_be_bytes();
    let frame = [&[0], &size[..], &bytes].concat();
    Body::new(http_body_util::Full::new(Bytes::from(frame)))
}

fn deletion() -> v1::DeleteMapRequest {
    v1::DeleteMapRequest { map_id: "house".to_owned() }
}

async fn maps(channel: &Channel) -> usize {
    let request = v1::ListMapsRequest::default();
    let answer = MapServiceClient::new(channel.clone()).list_maps(request).await.unwrap();
    answer.into_inner().maps.len()
}

/// Every path that the listener serves, and one that it does not.
fn paths() -> Vec<String> {
    let others = [
        "/grpc.health.v1.Health/Check",
        "/grpc.health.v1.Health/Watch",
        "/grpc.reflection.v1.ServerReflection/ServerReflectionInfo",
        "/grpc.reflection.v1alpha.ServerReflection/ServerReflectionInfo",
        "/nothing.Here/Call",
    ];
    rpcs().into_iter().map(|(path, ..)| path).chain(others.map(str::to_owned)).collect()
}

#[test]
fn requests_that_are_not_of_grpc_are_refused_before_they_are_read() {
    run(async {
        let server = TestServer::start().await;
        let other = ["application/json", "application/grpc-web", "application/grpc-web+proto"];
        for path in paths() {
            for kind in SIMPLE.into_iter().chain(other) {
                let headers = [("content-type", kind)];
                let answer = send(&server.channel, ("POST", &path), &headers, endless()).await;
                assert_eq!(answer.status(), 415, "{path} {kind}");
                assert_eq!(answer.headers().get("access-control-allow-origin"), None);
            }
            // `navigator.sendBeacon` and `fetch` without a body's type.
            let answer = send(&server.channel, ("POST", &path), &[], endless()).await;
            assert_eq!(answer.status(), 415, "{path}");
            let asked =
                [("origin", "https://evil.example"), ("access-control-request-method", "POST")];
            let answer = send(&server.channel, ("OPTIONS", &path), &asked, endless()).await;
            assert_eq!(answer.status(), 415, "{path}");
            assert_eq!(answer.headers().get("access-control-allow-origin"), None);
            let answer = send(&server.channel, ("GET", &path), &[GRPC], endless()).await;
            assert_eq!(answer.status(), 405, "{path}");
        }
    });
}

#[test]
fn a_call_that_another_site_makes_is_refused_whatever_its_content_type() {
    run(async {
        let server = TestServer::start().await;
        server.create_map("house").await;
        for path in paths() {
            for from in [
                ("origin", "https://evil.example"),
                ("origin", "null"),
                ("sec-fetch-site", "cross-site"),
                ("sec-fetch-site", "same-site"),
            ] {
                let answer = send(&server.channel, ("POST", &path), &[GRPC, from], endless()).await;
                assert_eq!(answer.status(), 403, "{path} {from:?}");
            }
        }
        assert_eq!(maps(&server.channel).await, 1);
        let own = format!("http://{}", server.running.local_addr());
        let headers = [GRPC, ("origin", &own), ("sec-fetch-site", "same-origin")];
        let answer =
            send(&server.channel, ("POST", DELETE_MAP), &headers, framed(&deletion())).await;
        assert_eq!(answer.status(), 200);
        assert_eq!(maps(&server.channel).await, 0);
    });
}

/// A server with TLS and without tokens that asks for client certificates, and a channel with one: a
/// browser sends it along for any site.
async fn with_certificates() -> (covis::service::RunningServer, Channel, tempfile::TempDir) {
    let (authority, clients) = (Authority::new(), Authority::new());
    let (certificate, key) = authority.issue("localhost");
    let folder = tempfile::tempdir().unwrap();
    let write = |name: &str, text: &str| {
        fs_err::write(folder.path().join(name), text).unwrap();
        folder.path().join(name)
    };
    let files = TlsFiles {
        certificate: write("cert.pem", &certificate),
        key: write("key.pem", &key),
        client_ca: Some(write("clients.pem", &clients.pem)),
    };
    let config = ServerConfig { tls: Some(files), threads: 1, ..ServerConfig::default() };
    let listener = TcpListener::bind("127.0.0.1:0").await.unwrap();
    let server = covis::service::Server::start(listener, config).await.unwrap();
    let (certificate, key) = clients.issue("somebody");
    let tls = ClientTlsConfig::new()
        .ca_certificate(Certificate::from_pem(&authority.pem))
        .identity(Identity::from_pem(certificate, key))
        .domain_name("localhost");
    let url = format!("https://localhost:{}", server.local_addr().port());
    let endpoint = Endpoint::from_shared(url).unwrap().tls_config(tls).unwrap();
    (server, endpoint.connect().await.unwrap(), folder)
}

#[test]
fn a_foreign_page_deletes_no_map_of_a_server_that_knows_callers_by_certificate() {
    run(async {
        let (server, channel, _files) = with_certificates().await;
        let request = v1::CreateMapRequest { map_id: "house".to_owned(), ..Default::default() };
        MapServiceClient::new(channel.clone()).create_map(request).await.unwrap();
        // fetch(url, { method: "POST", mode: "no-cors", body }) on https://evil.example.
        for kind in SIMPLE {
            let headers = [
                ("content-type", kind),
                ("origin", "https://evil.example"),
                ("sec-fetch-site", "cross-site"),
                ("sec-fetch-mode", "no-cors"),
            ];
            let answer = send(&channel, ("POST", DELETE_MAP), &headers, framed(&deletion())).await;
            assert_eq!(answer.status(), 415, "{kind}");
        }
        assert_eq!(maps(&channel).await, 1);
        let answer = send(&channel, ("POST", DELETE_MAP), &[GRPC], framed(&deletion())).await;
        assert_eq!(answer.status(), 200);
        assert_eq!(maps(&channel).await, 0);
        server.shutdown().await;
    });
}

#[test]
fn the_listener_of_grpc_does_not_speak_the_http_that_browsers_speak_without_tls() {
    run(async {
        let server = TestServer::start().await;
        server.create_map("house").await;
        let body = [&[0_u8, 0, 0, 0, 7], &deletion().encode_to_vec()[..]].concat();
        let head = format!(
            "POST {DELETE_MAP} HTTP/1.1\r\nhost: {}\r\ncontent-type: application/grpc\r\n\
             content-length: {}\r\nconnection: close\r\n\r\n",
            server.running.local_addr(),
            body.len()
        );
        let mut stream = TcpStream::connect(server.running.local_addr()).await.unwrap();
        stream.write_all(&[head.as_bytes(), &body].concat()).await.unwrap();
        let mut answer = Vec::new();
        // The server closes, with or without a word.
        let _reset = stream.read_to_end(&mut answer).await;
        assert!(!answer.starts_with(b"HTTP/1"), "{}", String::from_utf8_lossy(&answer));
        assert_eq!(maps(&server.channel).await, 1);
    });
}
