//! One source's settings, each of them optional, and how a TOML file becomes them.
//!
//! An error names the file, the line and its text; defaults and ranges stand in [`super::Config`].

use std::path::{Path, PathBuf};

use serde::Deserialize;

use crate::service::{MapLimits, SolveLimits, TenantLimits};

/// How log lines look.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Deserialize, clap::ValueEnum)]
#[serde(rename_all = "lowercase")]
pub enum LogFormat {
    /// For people.
    #[default]
    Text,
    /// One JSON object a line.
    Json,
}

/// Settings of one source; the keys of `covis.toml` have these names.
#[derive(Clone, Debug, Default, PartialEq, Eq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Layer {
    /// Address to listen on, `host:port`.
    pub listen: Option<String>,
    /// URL of the server that client commands talk to.
    pub server: Option<String>,
    /// Certificates of the authorities that client commands trust, PEM.
    pub ca: Option<PathBuf>,
    /// The certificate that client commands show, PEM.
    pub cert: Option<PathBuf>,
    /// Its private key, PEM.
    pub key: Option<PathBuf>,
    /// File that holds the token of client commands.
    pub token_file: Option<PathBuf>,
    /// The certificate that a server shows, PEM.
    pub tls_cert: Option<PathBuf>,
    /// Its private key, PEM.
    pub tls_key: Option<PathBuf>,
    /// Certificates of the authorities that must have signed the clients' certificates, PEM.
    pub tls_client_ca: Option<PathBuf>,
    /// File of the tokens that a server knows.
    pub tokens: Option<PathBuf>,
    /// Keys that sign the JSON Web Tokens that a server takes, a JWKS.
    pub jwks: Option<PathBuf>,
    /// The issuer of those tokens.
    pub jwt_issuer: Option<String>,
    /// Their audience.
    pub jwt_audience: Option<String>,
    /// Whether a server speaks plain text beyond loopback.
    pub insecure_plain_text: Option<bool>,
    /// Worker threads of a solve.
    pub threads: Option<usize>,
    /// Whether each solve finishes before the next item is taken.
    pub lock_step: Option<bool>,
    /// Largest message in bytes.
    pub max_message_bytes: Option<usize>,
    /// Most concurrent streams of one connection.
    pub max_concurrent_streams: Option<u32>,
    /// Most connections at once.
    pub max_connections: Option<usize>,
    /// Those of them that have made no call that was admitted.
    pub max_strangers: Option<usize>,
    /// Items that may wait for a map's engine.
    pub queue_capacity: Option<usize>,
    /// Ceilings of a map, which its policy can only lower.
    pub map_limits: Option<MapLimits>,
    /// Ceilings of a tenant that has none of its own in the file of tokens.
    pub tenant_limits: Option<TenantLimits>,
    /// See [`super::Config::server_limits`].
    pub server_limits: Option<TenantLimits>,
    /// What one solve may take.
    pub solve_limits: Option<SolveLimits>,
    /// Address at which a server answers `GET /metrics`, `host:port`.
    pub metrics_listen: Option<String>,
    /// Seconds that a server waits for running calls at its end.
    pub drain_budget: Option<u64>,
    /// Log level or directives.
    pub log: Option<String>,
    /// How log lines look.
    pub log_format: Option<LogFormat>,
    /// URL of the collector that a server exports spans to.
    pub otlp_endpoint: Option<String>,
    /// Folder that a server keeps its maps in.
    pub data_dir: Option<PathBuf>,
    /// Whether a server keeps its maps in memory only.
    pub in_memory: Option<bool>,
}

/// A configuration that cannot be used.
#[derive(Debug, thiserror::Error)]
pub enum ConfigError {
    /// The file cannot be read.
    #[error("{}: cannot be read", path.display())]
    Read {
        /// The file.
        path: PathBuf,
        /// What the system said.
        source: std::io::Error,
    },
    /// The file is not TOML, holds an unknown key or a value of another type.
    #[error("{}, line {line}: {reason} (`{text}`)", path.display())]
    File {
        /// The file.
        path: PathBuf,
        /// The line, from 1.
        line: usize,
        /// What is wrong; an unknown key is named.
        reason: String,
        /// The line's text.
        text: String,
    },
    /// A variable of the environment cannot be read as its setting.
    #[error("environment variable {variable}: {expected} is needed, not `{value}`")]
    Variable {
        /// Its name.
        variable: String,
        /// Its value.
        value: String,
        /// What it should be.
        expected: &'static str,
    },
    /// A setting is out of its range.
    #[error("setting {key}: {reason}")]
    OutOfRange {
        /// The setting.
        key: &'static str,
        /// What it must be.
        reason: &'static str,
    },
}

/// Longest file, bytes. The parser of TOML may take a hundred times as much.
const MAX_BYTES: usize = 256 << 10;

impl Layer {
    /// Reads a TOML file.
    ///
    /// # Errors
    /// [`ConfigError::Read`] and [`ConfigError::File`].
    pub fn read(path: &Path) -> Result<Self, ConfigError> {
        let text = fs_err::read_to_string(path)
            .map_err(|source| ConfigError::Read { path: path.to_owned(), source })?;
        Self::parse(&text, path)
    }

    /// Parses a TOML text; `path` names it in errors.
    ///
    /// # Errors
    /// [`ConfigError::File`] with the line.
    pub fn parse(text: &str, path: &Path) -> Result<Self, ConfigError> {
        if text.len() > MAX_BYTES {
            return Err(ConfigError::File {
                path: path.to_owned(),
                line: 1,
                reason: format!("the file has {} bytes, at most {MAX_BYTES} are read", text.len()),
                text: "...".to_owned(),
            });
        }
        toml::from_str(text).map_err(|error| {
            let offset = error.span().map_or(0, |span| span.start.min(text.len()));
            let line = 1 + text.bytes().take(offset).filter(|&b| b == b'\n').count();
            let shown = text.lines().nth(line - 1).unwrap_or_default().trim();
            // A token does not belong here, and no less into a log.
            let key = shown.split('=').next().unwrap_or_default().trim().trim_matches(['"', '\'']);
            let shown = if key == "token" { "token = ..." } else { shown };
            ConfigError::File {
                path: path.to_owned(),
                line,
                reason: error.message().to_owned(),
                text: shown.to_owned(),
            }
        })
    }

    /// These settings where they are given, else those of `lower`.
    #[must_use]
    pub fn over(self, lower: Self) -> Self {
        // One setting in two keys: who says where maps are kept says all of it.
        let decided = self.data_dir.is_some() || self.in_memory.is_some();
        let storage = if decided {
            (self.data_dir, self.in_memory)
        } else {
            (lower.data_dir, lower.in_memory)
        };
        Self {
            listen: self.listen.or(lower.listen),
            server: self.server.or(lower.server),
            ca: self.ca.or(lower.ca),
            cert: self.cert.or(lower.cert),
            key: self.key.or(lower.key),
            token_file: self.token_file.or(lower.token_file),
            tls_cert: self.tls_cert.or(lower.tls_cert),
            tls_key: self.tls_key.or(lower.tls_key),
            tls_client_ca: self.tls_client_ca.or(lower.tls_client_ca),
            tokens: self.tokens.or(lower.tokens),
            jwks: self.jwks.or(lower.jwks),
            jwt_issuer: self.jwt_issuer.or(lower.jwt_issuer),
            jwt_audience: self.jwt_audience.or(lower.jwt_audience),
            insecure_plain_text: self.insecure_plain_text.or(lower.insecure_plain_text),
            threads: self.threads.or(lower.threads),
            lock_step: self.lock_step.or(lower.lock_step),
            max_message_bytes: self.max_message_bytes.or(lower.max_message_bytes),
            max_connections: self.max_connections.or(lower.max_connections),
            max_strangers: self.max_strangers.or(lower.max_strangers),
            max_concurrent_streams: self.max_concurrent_streams.or(lower.max_concurrent_streams),
            queue_capacity: self.queue_capacity.or(lower.queue_capacity),
            map_limits: self.map_limits.or(lower.map_limits),
            tenant_limits: self.tenant_limits.or(lower.tenant_limits),
            server_limits: self.server_limits.or(lower.server_limits),
            solve_limits: self.solve_limits.or(lower.solve_limits),
            metrics_listen: self.metrics_listen.or(lower.metrics_listen),
            drain_budget: self.drain_budget.or(lower.drain_budget),
            log: self.log.or(lower.log),
            log_format: self.log_format.or(lower.log_format),
            otlp_endpoint: self.otlp_endpoint.or(lower.otlp_endpoint),
            data_dir: storage.0,
            in_memory: storage.1,
        }
    }
}
