//! The settings: each is written once, with its flag, its description and its type.
//!
//! A field's name is the key of `covis.toml`; with hyphens it is the flag, in capitals behind
//! `COVIS_` the variable. Its comment is the flag's help. A help heading says which commands have
//! the flag; one without a heading is a flag of `covis serve`. Fields with `skip` have no flag. The
//! files that settings name are not opened here.

use std::path::PathBuf;
use std::time::Duration;

use clap::Arg;
use serde::Deserialize;

use crate::client::Token;
use crate::map::MapLimits;
use crate::service::engine::AccountLimits;
use crate::service::{ServerConfig, SolveLimits};

/// Heading of the flags that all commands have.
pub const LOG: &str = "Log";

/// Heading of the flags of commands that talk to a server.
pub const CONNECTION: &str = "Connection";

/// Smallest message limit: every stream needs room for its control messages.
const LEAST_MESSAGE_BYTES: usize = 4096;

/// Format of log lines.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Deserialize, clap::ValueEnum)]
#[serde(rename_all = "lowercase")]
pub enum LogFormat {
    /// For people.
    #[default]
    Text,
    /// One JSON object a line.
    Json,
}

/// What the program runs with; what is absent is as the server has it by default.
#[derive(Clone, Debug, Default, PartialEq, Eq, clap::Args, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Config {
    /// Address to listen on, host:port; port 0 picks a free port [default: 127.0.0.1:7411].
    #[arg(long, value_name = "ADDR")]
    pub listen: Option<String>,
    /// The server's certificate (PEM); with it, the server uses TLS.
    #[arg(long, value_name = "FILE")]
    pub tls_cert: Option<PathBuf>,
    /// The private key of --tls-cert (PEM).
    #[arg(long, value_name = "FILE")]
    pub tls_key: Option<PathBuf>,
    /// Accept only clients whose certificate one of these authorities (PEM) has signed.
    #[arg(long, value_name = "FILE")]
    pub tls_client_ca: Option<PathBuf>,
    /// Accept only calls with a bearer token that this file (TOML) lists.
    #[arg(long, value_name = "FILE")]
    pub tokens: Option<PathBuf>,
    /// Also accept JSON Web Tokens that a key of this set (JWKS) has signed.
    #[arg(long, value_name = "FILE")]
    pub jwks: Option<PathBuf>,
    /// The issuer (`iss`) that those tokens must name.
    #[arg(long, value_name = "ISSUER")]
    pub jwt_issuer: Option<String>,
    /// The audience (`aud`) that those tokens must name.
    #[arg(long, value_name = "AUDIENCE")]
    pub jwt_audience: Option<String>,
    /// Serve plain text beyond loopback too: others on the network can read and change everything.
    #[arg(long)]
    pub insecure_plain_text: bool,
    /// Address at which the server answers `GET /metrics` for Prometheus, in plain text; port 0
    /// picks a free port [default: none].
    #[arg(long, value_name = "ADDR")]
    pub metrics_listen: Option<String>,
    /// Address of the web page that shows maps; port 0 picks a free port [default: none].
    #[arg(long, value_name = "ADDR")]
    pub http: Option<String>,
    /// Seconds that the server waits for running calls when it shuts down [default: 10].
    #[arg(long, value_name = "SECONDS")]
    pub drain_budget: Option<u64>,
    /// Seconds for which the server keeps a job after its end [default: 604800].
    #[arg(long, value_name = "SECONDS")]
    pub job_retention: Option<u64>,
    /// Export spans of calls, items and solves to this collector by OTLP over gRPC, in builds with
    /// the feature `opentelemetry` [default: none].
    #[arg(long, value_name = "URL")]
    pub otlp_endpoint: Option<String>,
    /// Worker threads for solves; results do not depend on their number [default: one per
    /// processor].
    #[arg(long, value_name = "N")]
    pub threads: Option<usize>,
    /// Finish each solve before taking the next item of a stream.
    #[arg(long)]
    pub lock_step: bool,
    /// Folder to keep maps in [default: the platform's folder for data].
    #[arg(long, value_name = "DIR", conflicts_with = "in_memory")]
    pub data_dir: Option<PathBuf>,
    /// Keep maps in memory only: they are lost when the server stops.
    #[arg(long)]
    pub in_memory: bool,
    /// Share maps with other servers over these NATS servers, URLs separated by commas, in builds with
    /// the feature `cluster` [default: none].
    #[arg(long, value_name = "URLS")]
    pub nats: Option<String>,
    /// Monitoring addresses of all NATS servers, separated by commas (http://host:8222): the server
    /// asks them whether NATS syncs before it acknowledges [default: none].
    #[arg(long, value_name = "URLS")]
    pub nats_monitoring: Option<String>,
    /// Number of NATS servers that keep each map's journal: 1, 3 or 5 [default: 3].
    #[arg(long, value_name = "N")]
    pub nats_replicas: Option<usize>,
    /// Seconds of silence after which other servers take over a server's maps [default: 5].
    #[arg(long, value_name = "SECONDS")]
    pub lease_seconds: Option<u64>,
    /// URL of this server for clients that called another server of the cluster [default: from
    /// --listen].
    #[arg(long, value_name = "URL")]
    pub advertise: Option<String>,
    /// Accept NATS servers that acknowledge before they sync: if several of them lose power, acknowledged
    /// items are lost.
    #[arg(long)]
    pub accept_unsynced_replicas: bool,
    /// Largest message in bytes, in and out [default: 4194304].
    #[arg(long, value_name = "N")]
    pub max_message_bytes: Option<usize>,
    /// Maximum number of concurrent streams of one connection [default: 64].
    #[arg(long, value_name = "N")]
    pub max_concurrent_streams: Option<u32>,
    /// Maximum number of connections [default: 512].
    #[arg(long, value_name = "N")]
    pub max_connections: Option<usize>,
    /// Maximum number of connections that have not made an admitted call yet; at most half of
    /// max-connections [default: 256].
    #[arg(long, value_name = "N")]
    pub max_strangers: Option<usize>,
    /// Items that may wait for a map's engine before a stream is slowed down [default: 64].
    #[arg(long, value_name = "N")]
    pub queue_capacity: Option<usize>,
    /// Limits of a map, over those of [`ServerConfig`]; in the file only (none).
    #[arg(skip)]
    pub map_limits: MapLimits,
    /// Limits of a tenant that has none in the file of tokens; in the file only (none).
    #[arg(skip)]
    pub tenant_limits: AccountLimits,
    /// Limits of the server as a whole, over those of [`ServerConfig`]; in the file only (none).
    #[arg(skip)]
    pub server_limits: AccountLimits,
    /// What one solve may take, over the engine's own limits; in the file only (none).
    #[arg(skip)]
    pub solve_limits: SolveLimits,
    /// The server's URL [default: http://127.0.0.1:7411].
    #[arg(long, value_name = "URL", help_heading = CONNECTION)]
    pub server: Option<String>,
    /// Certificates (PEM) of the authorities to trust instead of the system's.
    #[arg(long, value_name = "FILE", help_heading = CONNECTION)]
    pub ca: Option<PathBuf>,
    /// The client's own certificate (PEM), for mutual TLS.
    #[arg(long, value_name = "FILE", help_heading = CONNECTION)]
    pub cert: Option<PathBuf>,
    /// The private key of --cert (PEM).
    #[arg(long, value_name = "FILE", help_heading = CONNECTION)]
    pub key: Option<PathBuf>,
    /// File that holds the bearer token; COVIS_TOKEN holds the token itself.
    #[arg(long, value_name = "FILE", help_heading = CONNECTION)]
    pub token_file: Option<PathBuf>,
    /// Seconds to wait for a server that does not answer yet or still opens its maps; 0 fails at once
    /// [default: 10].
    #[arg(long, value_name = "SECONDS", help_heading = CONNECTION)]
    pub server_wait: Option<u64>,
    /// Log level (off, error, warn, info, debug, trace) or a list of them, `target=level` [default: info; warn
    /// of commands that do not write to a terminal].
    #[arg(long, value_name = "LEVEL", help_heading = LOG)]
    pub log: Option<String>,
    /// Format of log lines [default: text].
    #[arg(long, value_name = "FORMAT", help_heading = LOG)]
    pub log_format: LogFormat,
    /// Whether a flag names the server: `covis run` then starts none of its own.
    #[arg(skip)]
    #[serde(skip)]
    pub names_server: bool,
    /// The token of client commands, from `COVIS_TOKEN` only: every user of the machine can read
    /// arguments, and a file would be copied.
    #[arg(skip)]
    #[serde(skip)]
    pub token: Option<Token>,
    /// Name of a fault that the server is to commit, from `COVIS_TEST_FAULT`; for tests only.
    #[cfg(feature = "faults")]
    #[arg(skip)]
    #[serde(skip)]
    pub test_fault: Option<String>,
}

impl Config {
    /// A command that has all flags and demands none of them.
    pub(super) fn command() -> clap::Command {
        <Self as clap::Args>::augment_args_for_update(clap::Command::new("covis"))
    }

    /// The server's URL.
    #[must_use]
    pub fn server(&self) -> &str {
        self.server.as_deref().unwrap_or("http://127.0.0.1:7411")
    }

    /// How long commands wait for the server to be ready.
    #[must_use]
    pub fn server_wait(&self) -> Duration {
        Duration::from_secs(self.server_wait.unwrap_or(10))
    }

    /// Worker threads of solves.
    #[must_use]
    pub fn threads(&self) -> usize {
        self.threads.unwrap_or_else(|| ServerConfig::default().threads)
    }

    /// The first setting that is out of its range, and what it must be.
    pub(super) fn out_of_range(&self) -> Option<(&'static str, &'static str)> {
        let is_address = |address: &str| {
            address.rsplit_once(':').is_some_and(|(_, port)| port.parse::<u16>().is_ok())
        };
        // A bare word that is no level would be taken for a module's name and silence everything.
        let levels = ["off", "error", "warn", "info", "debug", "trace"];
        let is_log = |log: &str| {
            log.contains(['=', ',']) || levels.contains(&log.to_ascii_lowercase().as_str())
        };
        let jwt = [self.jwks.is_some(), self.jwt_issuer.is_some(), self.jwt_audience.is_some()];
        let rules = [
            (
                self.listen.as_deref().is_none_or(is_address),
                "listen",
                "must be host:port, for instance 127.0.0.1:7411",
            ),
            (
                self.metrics_listen.as_deref().is_none_or(is_address),
                "metrics_listen",
                "must be host:port, for instance 127.0.0.1:9411",
            ),
            (
                self.http.as_deref().is_none_or(is_address),
                "http",
                "must be host:port, for instance 127.0.0.1:7412",
            ),
            (self.threads != Some(0), "threads", "must be at least 1"),
            (
                self.tls_cert.is_some() == self.tls_key.is_some(),
                "tls_cert",
                "needs tls_key, and tls_key needs it: one of them is missing",
            ),
            (
                self.tls_client_ca.is_none() || self.tls_cert.is_some(),
                "tls_client_ca",
                "needs tls_cert and tls_key",
            ),
            (
                jwt == [jwt[0]; 3],
                "jwks",
                "needs jwt_issuer and jwt_audience, and they need it: one is missing",
            ),
            (
                self.max_message_bytes.is_none_or(|bytes| bytes >= LEAST_MESSAGE_BYTES),
                "max_message_bytes",
                "must be at least 4096",
            ),
            (
                self.max_concurrent_streams != Some(0),
                "max_concurrent_streams",
                "must be at least 1",
            ),
            (self.max_strangers != Some(0), "max_strangers", "must be at least 1"),
            (
                self.max_connections.is_none_or(|connections| connections > 1),
                "max_connections",
                "must be at least 2",
            ),
            (
                !self.in_memory || self.data_dir.is_none(),
                "in_memory",
                "excludes data_dir: set one of the two",
            ),
            (
                self.nats.is_none() || !self.in_memory,
                "nats",
                "excludes in_memory: this server keeps acknowledged items on its disk too",
            ),
            (
                matches!(self.nats_replicas, None | Some(1 | 3 | 5)),
                "nats_replicas",
                "must be 1, 3 or 5",
            ),
            (self.lease_seconds != Some(0), "lease_seconds", "must be at least 1"),
            (self.queue_capacity != Some(0), "queue_capacity", "must be at least 1"),
            (
                self.log.as_deref().is_none_or(is_log),
                "log",
                "must be off, error, warn, info, debug, trace or a list like info,covis=debug",
            ),
        ];
        let broken = rules.into_iter().find(|(holds, ..)| !holds);
        broken.map(|(_, key, reason)| (key, reason))
    }
}

/// The variable of a setting.
pub(super) fn variable(setting: &Arg) -> String {
    format!("COVIS_{}", setting.get_id().as_str().to_uppercase())
}

/// The flags of the settings that `is_wanted`, for a command and all below it; the help names the
/// variables.
pub fn flags(is_wanted: impl Fn(&Arg) -> bool) -> impl Iterator<Item = Arg> {
    let settings: Vec<Arg> = Config::command().get_arguments().cloned().collect();
    settings.into_iter().filter(move |setting| is_wanted(setting)).map(|setting| {
        let help = setting.get_help().map(ToString::to_string).unwrap_or_default();
        let help = format!("{help} [env: {}]", variable(&setting));
        setting.help(help).global(true)
    })
}
