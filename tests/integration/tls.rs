//! TLS and mutual TLS through a real server and the real binary, with certificates of throw-away
//! authorities; who is refused, what a reload changes, and that plain text stays on loopback.

use std::io::{BufRead, BufReader};
use std::path::PathBuf;
use std::process::{ChildStderr, Command, Stdio};

use covis::client::{Client, ClientError, Credentials, Token};
use covis::service::{RunningServer, Server, ServerConfig, ServerError, TlsFiles};
use rcgen::{BasicConstraints, CertificateParams, DnType, IsCa, Issuer, KeyPair};
use tempfile::TempDir;
use tokio::net::TcpListener;

use crate::cli_support::{Ran, Workspace};
use crate::common::run;
use crate::process::Process;
#[cfg(unix)]
use crate::process::Signal;
use crate::rpc_access::tokens_toml;

/// Signs certificates.
pub(crate) struct Authority {
    issuer: Issuer<'static, KeyPair>,
    pub(crate) pem: String,
}

impl Authority {
    pub(crate) fn new() -> Self {
        let key = KeyPair::generate().unwrap();
        let mut params = CertificateParams::new(Vec::<String>::new()).unwrap();
        params.is_ca = IsCa::Ca(BasicConstraints::Unconstrained);
        params.distinguished_name.push(DnType::CommonName, "an authority of the tests");
        let pem = params.self_signed(&key).unwrap().pem();
        Self { issuer: Issuer::new(params, key), pem }
    }

    /// A certificate for `host` and its key, PEM.
    pub(crate) fn issue(&self, host: &str) -> (String, String) {
        let key = KeyPair::generate().unwrap();
        let params = CertificateParams::new(vec![host.to_owned()]).unwrap();
        let certificate = params.signed_by(&key, &self.issuer).unwrap();
        (certificate.pem(), key.serialize_pem())
    }

    fn trusted(&self) -> Credentials {
        let ca_pem = Some(self.pem.clone().into_bytes());
        Credentials { ca_pem, ..Credentials::default() }
    }

    fn trusted_with(&self, (certificate, key): (String, String)) -> Credentials {
        let identity_pem = Some((certificate.into_bytes(), key.into_bytes()));
        Credentials { identity_pem, ..self.trusted() }
    }
}

/// The files of a server.
struct Files {
    folder: TempDir,
}

impl Files {
    fn new((certificate, key): (String, String)) -> Self {
        let files = Self { folder: tempfile::tempdir().unwrap() };
        files.write("cert.pem", &certificate);
        files.write("key.pem", &key);
        files
    }

    fn path(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }

    fn write(&self, name: &str, text: &str) -> PathBuf {
        fs_err::write(self.path(name), text).unwrap();
        self.path(name)
    }

    fn config(&self, client_ca: Option<PathBuf>) -> ServerConfig {
        let (certificate, key) = (self.path("cert.pem"), self.path("key.pem"));
        let tls = Some(TlsFiles { certificate, key, client_ca });
        ServerConfig { threads: 1, tls, ..ServerConfig::default() }
    }
}

async fn start(address: &str, config: ServerConfig) -> Result<RunningServer, ServerError> {
    let listener = TcpListener::bind(address).await.unwrap();
    Server::start(listener, config).await
}

/// Connects and makes a call: with TLS 1.3 a client learns only then that it was refused.
async fn call(url: &str, credentials: &Credentials) -> Result<Client, ClientError> {
    let client = Client::connect_with(url, credentials).await?;
    client.list_maps().await.map(|_| client)
}

#[test]
fn tls_serves_those_who_trust_the_authority_and_nobody_in_plain_text() {
    run(async {
        let (authority, other) = (Authority::new(), Authority::new());
        let files = Files::new(authority.issue("127.0.0.1"));
        let server = start("127.0.0.1:0", files.config(None)).await.unwrap();
        let url = format!("https://{}", server.local_addr());
        let client = call(&url, &authority.trusted()).await.unwrap();
        client.create_map("house", None).await.unwrap();
        assert_eq!(client.list_maps().await.unwrap().len(), 1);
        let error = call(&url, &other.trusted()).await.unwrap_err();
        assert!(matches!(error, ClientError::Unreachable { .. }), "{error:?}");
        call(&url.replace("https", "http"), &Credentials::default()).await.unwrap_err();
        // The name in the certificate counts, not only who signed it.
        let named = url.replace("127.0.0.1", "localhost");
        let error = call(&named, &authority.trusted()).await.unwrap_err();
        assert!(matches!(error, ClientError::Unreachable { .. }), "{error:?}");
        server.shutdown().await;
    });
}

#[test]
fn mutual_tls_takes_only_clients_whose_certificate_the_authority_signed() {
    run(async {
        let (authority, clients, other) = (Authority::new(), Authority::new(), Authority::new());
        let files = Files::new(authority.issue("127.0.0.1"));
        let client_ca = files.write("clients.pem", &clients.pem);
        let server = start("127.0.0.1:0", files.config(Some(client_ca))).await.unwrap();
        let url = format!("https://{}", server.local_addr());
        call(&url, &authority.trusted_with(clients.issue("robot"))).await.unwrap();
        call(&url, &authority.trusted()).await.unwrap_err();
        call(&url, &authority.trusted_with(other.issue("robot"))).await.unwrap_err();
        call(&url, &authority.trusted_with(authority.issue("robot"))).await.unwrap_err();
        server.shutdown().await;
    });
}

#[test]
fn a_reload_changes_the_certificate_and_a_bad_one_changes_nothing() {
    run(async {
        let (before, after) = (Authority::new(), Authority::new());
        let files = Files::new(before.issue("127.0.0.1"));
        let server = start("127.0.0.1:0", files.config(None)).await.unwrap();
        let url = format!("https://{}", server.local_addr());
        let old = call(&url, &before.trusted()).await.unwrap();

        files.write("key.pem", &before.issue("127.0.0.1").1);
        let error = server.reload().unwrap_err();
        assert!(matches!(error, ServerError::Tls(_)), "another certificate's key: {error:?}");
        files.write("key.pem", "nothing");
        server.reload().unwrap_err();
        call(&url, &before.trusted()).await.unwrap();

        let (certificate, key) = after.issue("127.0.0.1");
        files.write("cert.pem", &certificate);
        files.write("key.pem", &key);
        server.reload().unwrap();
        call(&url, &after.trusted()).await.unwrap();
        call(&url, &before.trusted()).await.unwrap_err();
        old.list_maps().await.expect("what was connected stays connected");
        server.shutdown().await;
    });
}

#[test]
fn plain_text_leaves_loopback_only_by_name() {
    run(async {
        let plain = ServerConfig { threads: 1, ..ServerConfig::default() };
        let error = start("0.0.0.0:0", plain.clone()).await.unwrap_err();
        assert!(matches!(error, ServerError::PlainText { .. }), "{error:?}");
        let allowed = ServerConfig { insecure_plain_text: true, ..plain };
        start("0.0.0.0:0", allowed).await.unwrap().shutdown().await;
        let files = Files::new(Authority::new().issue("127.0.0.1"));
        start("0.0.0.0:0", files.config(None)).await.unwrap().shutdown().await;
    });
}

/// `covis serve` with TLS, mutual TLS and tokens.
struct Served {
    child: Process,
    log: BufReader<ChildStderr>,
    url: String,
}

impl Served {
    fn start(mut command: Command) -> Self {
        let mut child = Process::spawn(command.stdout(Stdio::piped()).stderr(Stdio::piped()));
        let log = BufReader::new(child.stderr.take().unwrap());
        let mut line = String::new();
        BufReader::new(child.stdout.take().unwrap()).read_line(&mut line).unwrap();
        let url = line.trim().strip_prefix("listening on ").unwrap().to_owned();
        Self { child, log, url }
    }

    /// The log up to the line that holds `part`.
    fn log_until(&mut self, part: &str) -> String {
        let mut log = String::new();
        while !log.contains(part) {
            assert_ne!(self.log.read_line(&mut log).unwrap(), 0, "`{part}` in `{log}`");
        }
        log
    }
}

#[cfg(unix)]
#[test]
fn the_command_line_serves_and_calls_with_certificates_and_tokens() {
    let workspace = Workspace::new();
    let (authority, clients) = (Authority::new(), Authority::new());
    let write = |prefix: &str, (certificate, key): (String, String)| {
        workspace.file(&format!("{prefix}.pem"), &certificate);
        workspace.file(&format!("{prefix}.key"), &key);
    };
    write("server", authority.issue("127.0.0.1"));
    write("robot", clients.issue("robot"));
    workspace.file("ca.pem", &authority.pem);
    workspace.file("clients.pem", &clients.pem);
    workspace.file("tokens.toml", &tokens_toml(&[("robot", "acme", "admin")]));
    workspace.file("robot.token", "secret-of-robot\n");
    let mut command = workspace.command();
    command.args(["serve", "--listen", "127.0.0.1:0", "--in-memory", "--threads", "1"]);
    command.args(["--tls-cert", "server.pem", "--tls-key", "server.key"]);
    command.args(["--tls-client-ca", "clients.pem", "--tokens", "tokens.toml"]);
    // Deletions are told at every level, and a reload at this one.
    command.args(["--log", "off,covis::service::server=info"]);
    let mut served = Served::start(command);
    assert!(served.url.starts_with("https://127.0.0.1:"), "{}", served.url);
    let map = |arguments: &[&str]| {
        let mut command = workspace.command();
        command.args(["map", "--server", &served.url, "--ca", "ca.pem"]).args(arguments);
        command
    };
    let known = ["--cert", "robot.pem", "--key", "robot.key", "--token-file", "robot.token"];
    let run = |mut command: Command| Ran::of(command.output().unwrap());

    let ran = run(map(&[&known[..], &["list", "--json"]].concat()));
    assert_eq!((ran.code, ran.stdout.as_str()), (Some(0), "[]\n"), "{}", ran.stderr);
    let mut by_variable = map(&[&known[..4], &["list", "--json"]].concat());
    by_variable.env("COVIS_TOKEN", "secret-of-robot");
    assert_eq!(run(by_variable).code, Some(0));
    run(map(&[&known[..4], &["list"]].concat())).expect_failure(&["a bearer token is needed"]);
    let mut wrong = map(&[&known[..4], &["list"]].concat());
    wrong.env("COVIS_TOKEN", "secret-of-nobody");
    let ran = run(wrong);
    ran.expect_failure(&["the token is not known"]);
    assert!(!ran.stderr.contains("secret"), "{}", ran.stderr);
    assert_eq!(run(map(&["list"])).code, Some(1), "no certificate");
    run(map(&["list", "--cert", "robot.pem"])).expect_failure(&["--key"]);

    run(map(&[&known[..], &["delete", "house"]].concat())).expect_failure(&["house"]);
    let log = served.log_until("DeleteMap");
    for part in ["audit", "house", "acme", "robot", "failed"] {
        assert!(log.contains(part), "`{part}` in `{log}`");
    }
    assert!(!log.contains("secret"), "{log}");

    // The token is taken from the robot while the server runs.
    workspace.file("tokens.toml", &tokens_toml(&[("other", "acme", "admin")]));
    served.child.signal(Signal::HUP);
    served.log_until("read again");
    let refused = {
        let mut command = workspace.command();
        command.args(["map", "--server", &served.url, "--ca", "ca.pem"]).args(known).arg("list");
        run(command)
    };
    refused.expect_failure(&["the token is not known"]);
}

#[test]
fn a_flood_of_wrong_tokens_does_not_flood_the_log() {
    let workspace = Workspace::new();
    workspace.file("tokens.toml", &tokens_toml(&[("robot", "acme", "admin")]));
    let mut command = workspace.command();
    command.args(["serve", "--listen", "127.0.0.1:0", "--in-memory", "--threads", "1"]);
    workspace.file("keys.json", &crate::jwt::Issuer::new("k").jwks());
    command.args(["--tokens", "tokens.toml", "--jwks", "keys.json", "--jwt-issuer", "an issuer"]);
    command.args(["--jwt-audience", "covis", "--log", "info"]);
    let mut served = Served::start(command);
    let url = served.url.clone();
    run(async move {
        let token = |secret: &str| Credentials {
            token: Some(Token::new(secret)),
            ..Credentials::default()
        };
        let stranger = Client::connect_with(&url, &token("a.false.token")).await.unwrap();
        for _ in 0..500 {
            stranger.list_maps().await.unwrap_err();
        }
        // Told in any case, so that it ends what is looked at.
        let robot = Client::connect_with(&url, &token("secret-of-robot")).await.unwrap();
        robot.delete_map("house").await.unwrap_err();
    });
    let log = served.log_until("DeleteMap");
    let lines = log.lines().filter(|line| line.contains("refused")).count();
    assert!((1..100).contains(&lines), "{lines} lines of 500 calls");
}
