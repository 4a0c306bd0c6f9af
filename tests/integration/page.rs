//! The page for browsers: what is served, to whom, and that it is the one of the sources. What it shows
//! is tested in a real browser by `page/test`.

use std::path::{Path, PathBuf};

use covis::service::{ConnectionLimits, Server, ServerConfig, ServerError, TlsFiles};
use covis::wire::v1;
use flate2::read::GzDecoder;
use prost::Message;
use sha2::{Digest, Sha256};
use tempfile::NamedTempFile;
use tokio::io::{AsyncReadExt, AsyncWriteExt};
use tokio::net::{TcpListener, TcpStream};
use tokio_rustls::TlsConnector;
use tokio_rustls::rustls::pki_types::pem::PemObject;
use tokio_rustls::rustls::pki_types::{CertificateDer, ServerName};
use tokio_rustls::rustls::{ClientConfig, RootCertStore};
use tonic::Code;

use crate::common::{TestServer, run};
use crate::rpc_access::tokens_toml;
use crate::tls::Authority;

const LIST_MAPS: &str = "/covis.v1.MapService/ListMaps";

async fn start(change: impl FnOnce(&mut ServerConfig)) -> TestServer {
    TestServer::with(|config| {
        config.page_listen = Some("127.0.0.1:0".to_owned());
        change(config);
    })
    .await
}

fn tokens() -> NamedTempFile {
    let file = NamedTempFile::new().unwrap();
    let tokens =
        [("reader", "acme", "read"), ("chief", "acme", "admin"), ("other", "rival", "read")];
    fs_err::write(file.path(), tokens_toml(&tokens)).unwrap();
    file
}

/// An answer over HTTP/1.1.
#[derive(Debug)]
struct Answer {
    head: String,
    body: Vec<u8>,
}

impl Answer {
    fn status(&self) -> u16 {
        self.head.split(' ').nth(1).unwrap().parse().unwrap()
    }

    fn header(&self, name: &str) -> Option<&str> {
        let mut lines = self.head.lines().filter_map(|line| line.split_once(": "));
        lines.find(|(found, _)| found.eq_ignore_ascii_case(name)).map(|(_, value)| value)
    }

    /// The status of gRPC: in the headers, or in the frame of trailers.
    fn code(&self) -> Code {
        let trailers = String::from_utf8_lossy(&self.body);
        let trailer = trailers.split("grpc-status:").nth(1);
        let code = self.header("grpc-status").or(trailer.and_then(|rest| rest.lines().next()));
        Code::from_i32(code.unwrap_or_else(|| panic!("{self:?}")).trim().parse().unwrap())
    }
}

/// Sends one request with these headers and reads until the server closes.
async fn request(server: &TestServer, line: &str, headers: &[(&str, &str)], body: &[u8]) -> Answer {
    let address = server.running.page_addr().unwrap();
    let host = address.to_string();
    let mut text =
        format!("{line} HTTP/1.1\r\nconnection: close\r\ncontent-length: {}\r\n", body.len());
    if !headers.iter().any(|(name, _)| *name == "host") {
        text += &format!("host: {host}\r\n");
    }
    for (name, value) in headers {
        text += &format!("{name}: {value}\r\n");
    }
    let mut stream = TcpStream::connect(address).await.unwrap();
    stream.write_all(&[text.as_bytes(), b"\r\n", body].concat()).await.unwrap();
    let mut bytes = Vec::new();
    stream.read_to_end(&mut bytes).await.unwrap();
    let end = bytes.windows(4).position(|four| four == b"\r\n\r\n").unwrap();
    let body = bytes.split_off(end + 4);
    Answer { head: String::from_utf8(bytes).unwrap(), body }
}

async fn get(server: &TestServer, path: &str) -> Answer {
    request(server, &format!("GET {path}"), &[], &[]).await
}

/// A call by gRPC-Web without fields.
async fn call(server: &TestServer, path: &str, headers: &[(&str, &str)]) -> Answer {
    let kind = [("content-type", "application/grpc-web+proto")];
    request(server, &format!("POST {path}"), &[&kind, headers].concat(), &[0; 5]).await
}

#[test]
fn the_bundle_is_the_one_of_the_sources() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("page");
    let mut files: Vec<String> =
        ["build.mjs", "package.json", "package-lock.json"].map(str::to_owned).to_vec();
    let mut folders = vec![PathBuf::from("src")];
    while let Some(folder) = folders.pop() {
        for entry in fs_err::read_dir(root.join(&folder)).unwrap() {
            let path = folder.join(entry.unwrap().file_name());
            if root.join(&path).is_dir() {
                folders.push(path);
            } else {
                files.push(path.to_str().unwrap().replace('\\', "/"));
            }
        }
    }
    files.sort_unstable();
    let mut digest = Sha256::new();
    for path in files {
        let bytes = fs_err::read(root.join(&path)).unwrap();
        digest.update(format!("{path}\0{}\0", bytes.len()));
        digest.update(bytes);
    }
    let digest: String = digest.finalize().iter().map(|byte| format!("{byte:02x}")).collect();
    let built = fs_err::read_to_string(root.join("dist/sources.sha256")).unwrap();
    assert_eq!(
        built.trim(),
        digest,
        "page/dist was built from other sources; run: npm --prefix page ci && npm --prefix page run build"
    );
}

#[test]
fn a_browser_gets_the_page_and_may_run_nothing_else() {
    run(async {
        let server = start(|_| {}).await;
        let mut compressed = 0;
        for (path, kind) in [
            ("/", "text/html; charset=utf-8"),
            ("/page.js", "text/javascript; charset=utf-8"),
            ("/page.css", "text/css; charset=utf-8"),
            ("/icon.svg", "image/svg+xml"),
            ("/descriptors", "application/octet-stream"),
        ] {
            let plain = get(&server, path).await;
            assert_eq!((plain.status(), plain.header("content-type")), (200, Some(kind)), "{path}");
            let gzip = [("accept-encoding", "gzip, br")];
            let packed = request(&server, &format!("GET {path}"), &gzip, &[]).await;
            assert_eq!(packed.header("content-encoding"), Some("gzip"));
            compressed += packed.body.len();
            let mut unpacked = Vec::new();
            std::io::Read::read_to_end(&mut GzDecoder::new(&packed.body[..]), &mut unpacked)
                .unwrap();
            assert!(unpacked == plain.body, "{path}");
            for answer in [&plain, &packed] {
                let policy = answer.header("content-security-policy").unwrap();
                assert!(policy.starts_with("default-src 'none';"), "{policy}");
                assert!(policy.contains("frame-ancestors 'none'"), "{policy}");
                assert!(!policy.contains("unsafe") && !policy.contains('*'), "{policy}");
                assert_eq!(answer.header("x-content-type-options"), Some("nosniff"));
                assert_eq!(answer.header("access-control-allow-origin"), None);
            }
        }
        assert!(compressed < 1 << 20, "{compressed} bytes");
        assert_eq!(get(&server, "/descriptors").await.body, v1::FILE_DESCRIPTOR_SET);
        let document = String::from_utf8(get(&server, "/").await.body).unwrap();
        assert!(!document.contains("<style") && !document.contains("style="), "{document}");
        assert_eq!(
            document.matches("<script").count(),
            document.matches("<script type=\"module\" src=").count()
        );
        let head = request(&server, "HEAD /page.js", &[], &[]).await;
        assert_eq!((head.status(), head.body.len()), (200, 0));
        for path in ["/page.map", "/../Cargo.toml", "//", "/index.html"] {
            assert_eq!(get(&server, path).await.status(), 404, "{path}");
        }
        let posted = request(&server, "POST /", &[], b"x").await;
        assert_eq!((posted.status(), posted.header("allow")), (405, Some("GET, HEAD")));
    });
}

#[test]
fn the_page_calls_the_services_of_the_wire() {
    run(async {
        let server = start(|_| {}).await;
        server.create_map("house").await;
        let answer = call(&server, LIST_MAPS, &[]).await;
        assert_eq!((answer.status(), answer.code()), (200, Code::Ok));
        let size = u32::from_be_bytes(answer_frame(&answer)[1..5].try_into().unwrap()) as usize;
        let maps = v1::ListMapsResponse::decode(&answer_frame(&answer)[5..5 + size]).unwrap().maps;
        assert_eq!(maps.iter().map(|map| map.map_id.as_str()).collect::<Vec<_>>(), ["house"]);
        // Streams of items are for robots.
        let ingest = call(&server, "/covis.v1.IngestService/Ingest", &[]).await;
        assert_eq!(ingest.status(), 404);
    });
}

/// The first frame of a chunked answer.
fn answer_frame(answer: &Answer) -> &[u8] {
    assert_eq!(answer.header("transfer-encoding"), Some("chunked"));
    let start = answer.body.windows(2).position(|two| two == b"\r\n").unwrap() + 2;
    &answer.body[start..]
}

#[test]
fn tokens_roles_and_tenants_hold_on_the_page_as_on_the_wire() {
    run(async {
        let file = tokens();
        let server = start(|config| config.tokens = Some(file.path().to_owned())).await;
        // The files are for everybody: they ask for the token.
        assert_eq!(get(&server, "/").await.status(), 200);
        let bearer = |name: &str| format!("Bearer secret-of-{name}");
        let as_who = async |path: &str, name: &str| {
            call(&server, path, &[("authorization", &bearer(name))]).await.code()
        };
        assert_eq!(call(&server, LIST_MAPS, &[]).await.code(), Code::Unauthenticated);
        assert_eq!(as_who(LIST_MAPS, "nobody").await, Code::Unauthenticated);
        assert_eq!(as_who(LIST_MAPS, "reader").await, Code::Ok);
        assert_eq!(
            as_who("/covis.v1.MapService/CreateMap", "reader").await,
            Code::PermissionDenied
        );
        assert_eq!(as_who("/covis.v1.MapService/DeleteMap", "chief").await, Code::InvalidArgument);
        // Metrics are of all tenants.
        assert_eq!(get(&server, "/metrics").await.status(), 401);
        for (name, wanted) in [("nobody", 401), ("reader", 403), ("chief", 200)] {
            let bearer = bearer(name);
            let answer = request(&server, "GET /metrics", &[("authorization", &bearer)], &[]).await;
            assert_eq!(answer.status(), wanted, "{name}: {answer:?}");
            let challenge = (wanted == 401).then_some("Bearer");
            assert_eq!(answer.header("www-authenticate"), challenge, "{name}");
            let body = String::from_utf8(answer.body).unwrap();
            assert_eq!(body.contains("covis_build_info"), wanted == 200, "{name}");
            assert!(!body.is_empty(), "{name}");
        }
    });
}

#[test]
fn requests_that_another_site_sends_through_a_browser_are_refused() {
    run(async {
        let server = start(|_| {}).await;
        let own = format!("http://{}", server.running.page_addr().unwrap());
        assert_eq!(call(&server, LIST_MAPS, &[("origin", &own)]).await.code(), Code::Ok);
        for origin in ["http://evil.example", "null", "http://127.0.0.1", ""] {
            let answer = call(&server, LIST_MAPS, &[("origin", origin)]).await;
            assert_eq!(answer.status(), 403, "{origin}: {answer:?}");
        }
        // A name that its owner lets lead to loopback.
        let rebound = [("host", "evil.example:80"), ("origin", "http://evil.example:80")];
        for path in [LIST_MAPS, "/metrics"] {
            assert_eq!(call(&server, path, &rebound).await.status(), 421, "{path}");
        }
        let preflight = [("origin", own.as_str()), ("access-control-request-method", "POST")];
        let answer = request(&server, &format!("OPTIONS {LIST_MAPS}"), &preflight, &[]).await;
        assert_eq!(answer.header("access-control-allow-origin"), None, "{answer:?}");
        // Newer browsers say where requests without an origin come from.
        for (site, wanted) in [("cross-site", 403), ("same-site", 403), ("same-origin", 200)] {
            let headers = [("sec-fetch-site", site), ("sec-fetch-mode", "no-cors")];
            assert_eq!(call(&server, LIST_MAPS, &headers).await.status(), wanted, "{site}");
            let answer = request(&server, "GET /page.js", &headers, &[]).await;
            assert_eq!(answer.status(), wanted, "{site}");
        }
        let link = [("sec-fetch-site", "cross-site"), ("sec-fetch-mode", "navigate")];
        assert_eq!(request(&server, "GET /", &link, &[]).await.status(), 200);
        // Not the type that only a page of the same site may send without being asked.
        let simple = [("content-type", "text/plain")];
        let answer = request(&server, &format!("POST {LIST_MAPS}"), &simple, &[0; 5]).await;
        assert_eq!(answer.status(), 415);
    });
}

#[test]
fn strangers_at_the_page_are_bounded_like_all_others() {
    run(async {
        let file = tokens();
        let limits = ConnectionLimits {
            max_connections: 8,
            max_strangers: 4,
            stranger_time: std::time::Duration::from_millis(50),
            ..ConnectionLimits::default()
        };
        let server = start(|config| {
            config.tokens = Some(file.path().to_owned());
            config.connections = limits;
        })
        .await;
        let address = server.running.page_addr().unwrap();
        let half = b"POST /covis.v1.MapService/ListMaps HTTP/1.1\r\nhost: localhost\r\ncontent-l";
        let mut strangers = Vec::new();
        for begun in [&b""[..], b"GET / HT", half] {
            let mut stream = TcpStream::connect(address).await.unwrap();
            stream.write_all(begun).await.unwrap();
            strangers.push(stream);
        }
        for mut stranger in strangers {
            let mut rest = Vec::new();
            // Closed by the server, with or without a word.
            let _reset = stranger.read_to_end(&mut rest).await;
        }
        let reader = [("authorization", "Bearer secret-of-reader")];
        assert_eq!(call(&server, LIST_MAPS, &reader).await.code(), Code::Ok);
    });
}

#[test]
fn the_page_is_plain_on_loopback_only() {
    run(async {
        let listener = || TcpListener::bind("127.0.0.1:0");
        let open = ServerConfig {
            page_listen: Some("0.0.0.0:0".to_owned()),
            threads: 1,
            ..ServerConfig::default()
        };
        let refused = Server::start(listener().await.unwrap(), open.clone()).await.unwrap_err();
        assert!(matches!(refused, ServerError::PlainText { .. }), "{refused:?}");
        let allowed = ServerConfig { insecure_plain_text: true, ..open };
        Server::start(listener().await.unwrap(), allowed).await.unwrap().shutdown().await;
        let taken = listener().await.unwrap();
        let config = ServerConfig {
            page_listen: Some(taken.local_addr().unwrap().to_string()),
            threads: 1,
            ..ServerConfig::default()
        };
        let refused = Server::start(listener().await.unwrap(), config).await.unwrap_err();
        assert!(matches!(refused, ServerError::Page { .. }), "{refused:?}");
    });
}

#[test]
fn a_name_that_leads_to_an_open_listener_beyond_loopback_is_refused() {
    run(async {
        let server = start(|config| {
            config.page_listen = Some("0.0.0.0:0".to_owned());
            config.insecure_plain_text = true;
        })
        .await;
        let port = server.running.page_addr().unwrap().port();
        for (name, wanted) in [("evil.example", 421), ("192.168.1.5", 200), ("robot.local", 200)] {
            let host = format!("{name}:{port}");
            let origin = format!("http://{host}");
            let headers = [("host", host.as_str()), ("origin", origin.as_str())];
            assert_eq!(call(&server, LIST_MAPS, &headers).await.status(), wanted, "{name}");
        }
    });
}

#[test]
fn with_tls_browsers_may_choose_http_1_or_2() {
    run(async {
        let authority = Authority::new();
        let (certificate, key) = authority.issue("localhost");
        let folder = tempfile::tempdir().unwrap();
        let write = |name: &str, text: &str| {
            fs_err::write(folder.path().join(name), text).unwrap();
            folder.path().join(name)
        };
        let files = TlsFiles {
            certificate: write("cert.pem", &certificate),
            key: write("key.pem", &key),
            client_ca: None,
        };
        let config = ServerConfig {
            page_listen: Some("127.0.0.1:0".to_owned()),
            tls: Some(files),
            threads: 1,
            ..ServerConfig::default()
        };
        let listener = TcpListener::bind("127.0.0.1:0").await.unwrap();
        let server = Server::start(listener, config).await.unwrap();
        let mut roots = RootCertStore::empty();
        roots.add(CertificateDer::from_pem_slice(authority.pem.as_bytes()).unwrap()).unwrap();
        for protocol in [&b"http/1.1"[..], b"h2"] {
            let provider = tokio_rustls::rustls::crypto::ring::default_provider();
            let mut client = ClientConfig::builder_with_provider(provider.into())
                .with_safe_default_protocol_versions()
                .unwrap()
                .with_root_certificates(roots.clone())
                .with_no_client_auth();
            client.alpn_protocols = vec![protocol.to_vec()];
            let connector = TlsConnector::from(std::sync::Arc::new(client));
            let socket = TcpStream::connect(server.page_addr().unwrap()).await.unwrap();
            let name = ServerName::try_from("localhost").unwrap();
            let mut stream = connector.connect(name, socket).await.unwrap();
            assert_eq!(stream.get_ref().1.alpn_protocol(), Some(protocol));
            if protocol == b"h2" {
                continue;
            }
            let request = b"GET / HTTP/1.1\r\nhost: localhost\r\nconnection: close\r\n\r\n";
            stream.write_all(request).await.unwrap();
            let mut answer = Vec::new();
            // The server may close without the last word of TLS.
            let _end = stream.read_to_end(&mut answer).await;
            assert!(answer.starts_with(b"HTTP/1.1 200 "));
        }
        server.shutdown().await;
    });
}
