//! The configuration: flags over `COVIS_*` environment over `covis.toml` over defaults.
//!
//! Each source fills a [`Layer`] of optional settings; [`Config::load`] lays them over one another
//! and checks the result. `covis.toml` is read from the working folder, or from where `--config` or
//! `COVIS_CONFIG` says. A key that is not known is an error in the file (with its line), and a
//! warning in the environment, where a neighbor's variable may stray in.

mod environment;
mod layer;
#[cfg(test)]
mod tests;

use std::path::{Path, PathBuf};

use crate::client::Token;
use crate::service::{ConnectionLimits, MapLimits, SolveLimits, TenantLimits};

pub use environment::Environment;
pub use layer::{ConfigError, Layer, LogFormat};

/// The file that is read when no other is named.
const DEFAULT_FILE: &str = "covis.toml";

/// Smallest message limit: every stream needs room for its control messages.
const LEAST_MESSAGE_BYTES: usize = 4096;

/// What the program runs with.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Config {
    /// Address that `serve` listens on, `host:port`; port 0 takes a free one (127.0.0.1:7411).
    pub listen: String,
    /// URL of the server that client commands talk to (http://127.0.0.1:7411).
    pub server: String,
    /// Certificates of the authorities that client commands trust, PEM (the system's).
    pub ca: Option<PathBuf>,
    /// The certificate that client commands show, PEM (none).
    pub cert: Option<PathBuf>,
    /// Its private key, PEM (none).
    pub key: Option<PathBuf>,
    /// File that holds the token of client commands (none).
    pub token_file: Option<PathBuf>,
    /// The token of client commands, from `COVIS_TOKEN` only (none).
    pub token: Option<Token>,
    /// The certificate that a server shows, PEM (none: plain text).
    pub tls_cert: Option<PathBuf>,
    /// Its private key, PEM; with `tls_cert` only.
    pub tls_key: Option<PathBuf>,
    /// Certificates of the authorities that must have signed the clients' certificates, PEM (none:
    /// clients need no certificate).
    pub tls_client_ca: Option<PathBuf>,
    /// File of the tokens that a server knows (none: without `jwks` too everybody may do everything).
    pub tokens: Option<PathBuf>,
    /// Keys that sign the JSON Web Tokens that a server takes, a JWKS (none: it takes no such token).
    pub jwks: Option<PathBuf>,
    /// The issuer of those tokens; with `jwks` only.
    pub jwt_issuer: Option<String>,
    /// Their audience; with `jwks` only.
    pub jwt_audience: Option<String>,
    /// Whether a server speaks plain text beyond loopback (no).
    pub insecure_plain_text: bool,
    /// Worker threads of a solve; at least 1 (one per processor).
    pub threads: usize,
    /// Whether each solve finishes before the next item of a stream is taken (no).
    pub lock_step: bool,
    /// Largest message in bytes, in and out (4 MiB).
    pub max_message_bytes: usize,
    /// Most concurrent streams of one connection (64).
    pub max_concurrent_streams: u32,
    /// Most connections of a server at once (512).
    pub max_connections: usize,
    /// Those of them that have made no call that was admitted (256); half of
    /// them at most.
    pub max_strangers: usize,
    /// Items that may wait for a map's engine before a stream is slowed down (64).
    pub queue_capacity: usize,
    /// Ceilings of a map, over those of [`ServerConfig`](crate::service::ServerConfig); in the file
    /// only (none).
    pub map_limits: MapLimits,
    /// Ceilings of a tenant without its own; in the file only (none).
    pub tenant_limits: TenantLimits,
    /// Limits of the server as a whole (see `service::default_limits`).
    pub server_limits: TenantLimits,
    /// What one solve may take; in the file only (see
    /// [`EngineConfig`](crate::service::engine::EngineConfig)).
    pub solve_limits: SolveLimits,
    /// Folder that a server keeps its maps in (the platform's folder for data of programs).
    pub data_dir: Option<PathBuf>,
    /// Whether a server keeps its maps in memory only (no).
    pub in_memory: bool,
    /// Address at which a server answers `GET /metrics`, `host:port` (none).
    pub metrics_listen: Option<String>,
    /// Seconds that a server waits for running calls at its end (10).
    pub drain_budget: u64,
    /// How log lines look (text).
    pub log_format: LogFormat,
    /// URL of the collector that a server exports spans to (none).
    pub otlp_endpoint: Option<String>,
    /// Log level, or directives of `tracing-subscriber` (info).
    pub log: String,
    /// Name of a fault that the server is to commit, from `COVIS_TEST_FAULT`; for tests only.
    #[cfg(feature = "faults")]
    pub test_fault: Option<String>,
}

impl Config {
    /// Lays `flags` over `environment` over the file over the defaults. `file` is what `--config`
    /// names. Returns the warnings as well, one sentence each.
    ///
    /// # Errors
    /// [`ConfigError`] names the source, the key and, in a file, the line.
    pub fn load(
        flags: Layer,
        file: Option<PathBuf>,
        environment: Environment,
    ) -> Result<(Self, Vec<String>), ConfigError> {
        let variables = environment.read()?;
        let file = match file.or(variables.config) {
            Some(path) => Layer::read(&path)?,
            None if Path::new(DEFAULT_FILE).is_file() => Layer::read(Path::new(DEFAULT_FILE))?,
            None => Layer::default(),
        };
        let layer = flags.over(variables.layer).over(file);
        let config = Self {
            token: variables.token,
            #[cfg(feature = "faults")]
            test_fault: variables.test_fault,
            ..Self::from_layer(layer)
        };
        config.check()?;
        Ok((config, variables.warnings))
    }

    fn from_layer(layer: Layer) -> Self {
        let connections = ConnectionLimits::default();
        let processors = || std::thread::available_parallelism().map_or(1, usize::from);
        Self {
            listen: layer.listen.unwrap_or_else(|| "127.0.0.1:7411".to_owned()),
            server: layer.server.unwrap_or_else(|| "http://127.0.0.1:7411".to_owned()),
            ca: layer.ca,
            cert: layer.cert,
            key: layer.key,
            token_file: layer.token_file,
            token: None,
            tls_cert: layer.tls_cert,
            tls_key: layer.tls_key,
            tls_client_ca: layer.tls_client_ca,
            tokens: layer.tokens,
            jwks: layer.jwks,
            jwt_issuer: layer.jwt_issuer,
            jwt_audience: layer.jwt_audience,
            insecure_plain_text: layer.insecure_plain_text.unwrap_or(false),
            threads: layer.threads.unwrap_or_else(processors),
            lock_step: layer.lock_step.unwrap_or(false),
            max_message_bytes: layer.max_message_bytes.unwrap_or(4 * 1024 * 1024),
            max_concurrent_streams: layer.max_concurrent_streams.unwrap_or(64),
            max_connections: layer.max_connections.unwrap_or(connections.max_connections),
            max_strangers: layer.max_strangers.unwrap_or(connections.max_strangers),
            queue_capacity: layer.queue_capacity.unwrap_or(64),
            map_limits: layer.map_limits.unwrap_or_default(),
            tenant_limits: layer.tenant_limits.unwrap_or_default(),
            server_limits: layer.server_limits.unwrap_or_default(),
            solve_limits: layer.solve_limits.unwrap_or_default(),
            data_dir: layer.data_dir,
            in_memory: layer.in_memory.unwrap_or(false),
            metrics_listen: layer.metrics_listen,
            drain_budget: layer.drain_budget.unwrap_or(10),
            log_format: layer.log_format.unwrap_or_default(),
            otlp_endpoint: layer.otlp_endpoint,
            log: layer.log.unwrap_or_else(|| "info".to_owned()),
            #[cfg(feature = "faults")]
            test_fault: None,
        }
    }

    fn check(&self) -> Result<(), ConfigError> {
        let out_of_range = |key, reason| Err(ConfigError::OutOfRange { key, reason });
        let is_address = |address: &str| {
            address.rsplit_once(':').is_some_and(|(_, port)| port.parse::<u16>().is_ok())
        };
        if !is_address(&self.listen) {
            return out_of_range("listen", "must be host:port, for instance 127.0.0.1:7411");
        }
        if !self.metrics_listen.as_deref().is_none_or(is_address) {
            return out_of_range(
                "metrics_listen",
                "must be host:port, for instance 127.0.0.1:9411",
            );
        }
        if self.threads == 0 {
            return out_of_range("threads", "must be at least 1");
        }
        if self.tls_cert.is_some() != self.tls_key.is_some() {
            return out_of_range("tls_cert", "belongs with tls_key: one of them is missing");
        }
        if self.tls_client_ca.is_some() && self.tls_cert.is_none() {
            return out_of_range("tls_client_ca", "needs tls_cert and tls_key");
        }
        let jwt = [self.jwks.is_some(), self.jwt_issuer.is_some(), self.jwt_audience.is_some()];
        if jwt.contains(&true) && jwt.contains(&false) {
            return out_of_range(
                "jwks",
                "belongs with jwt_issuer and jwt_audience: one is missing",
            );
        }
        if self.max_message_bytes < LEAST_MESSAGE_BYTES {
            return out_of_range("max_message_bytes", "must be at least 4096");
        }
        if self.max_concurrent_streams == 0 {
            return out_of_range("max_concurrent_streams", "must be at least 1");
        }
        if self.max_strangers == 0 {
            return out_of_range("max_strangers", "must be at least 1");
        }
        if self.max_connections < 2 {
            return out_of_range("max_connections", "must be at least 2");
        }
        if self.in_memory && self.data_dir.is_some() {
            return out_of_range("in_memory", "excludes data_dir: maps are kept here or there");
        }
        if self.queue_capacity == 0 {
            return out_of_range("queue_capacity", "must be at least 1");
        }
        // A bare word that is no level would be taken for a module's name and silence everything.
        let levels = ["off", "error", "warn", "info", "debug", "trace"];
        let directives = self.log.contains(['=', ',', '[']);
        if !directives && !levels.contains(&self.log.to_ascii_lowercase().as_str()) {
            return out_of_range(
                "log",
                "must be off, error, warn, info, debug, trace or directives",
            );
        }
        Ok(())
    }
}
