//! What a server is started with. Who may come in stands in files, which can be read again while it
//! runs; all else holds until the end.

use std::path::PathBuf;
use std::time::Duration;

use super::access::JwtOptions;
use super::clock::Clock;
use super::connections::ConnectionLimits;
use super::engine::{EngineConfig, TenantCeilings};
use super::tls::TlsFiles;
use crate::map::Ceilings;

/// Largest message by default, bytes: 4 MiB.
const DEFAULT_MESSAGE_BYTES: usize = 4 * 1024 * 1024;

/// Settings of a server; each with its default.
#[derive(Clone, Debug)]
pub struct ServerConfig {
    /// Largest message that is taken or sent, in bytes (4 MiB).
    pub max_message_bytes: usize,
    /// Streams that one connection may hold at once (64).
    pub max_concurrent_streams: u32,
    /// How many connections are held, and how long one may be without use.
    pub connections: ConnectionLimits,
    /// How a peer that went away without a word is found.
    pub keep_alive: KeepAlive,
    /// Maps that the server keeps (1000).
    pub max_maps: usize,
    /// Ceilings of a map, which its policy can only lower (100,000 keyframes, 20 million landmarks,
    /// 100 million observations).
    pub ceilings: Ceilings,
    /// Ceilings of a tenant that has none of its own in the file of tokens (none).
    pub tenant_ceilings: TenantCeilings,
    /// Where maps are kept (nowhere: in memory, and gone at the end).
    pub data_dir: Option<PathBuf>,
    /// Certificate and key of the listener (none: plain text).
    pub tls: Option<TlsFiles>,
    /// The file of tokens (none). Without it and `jwt` everybody may do everything.
    pub tokens: Option<PathBuf>,
    /// Whose JSON Web Tokens are taken (nobody's).
    pub jwt: Option<JwtOptions>,
    /// Whether plain text is served beyond the loopback interface (no).
    pub insecure_plain_text: bool,
    /// Where `GET /metrics` is answered, `host:port` (nowhere).
    pub metrics_listen: Option<String>,
    /// Threads of the solver pool (one per processor).
    pub threads: usize,
    /// How engines run.
    pub engine: EngineConfig,
    /// How long a shutdown waits for calls that are still running (10 s).
    pub drain_budget: Duration,
    /// What says whether a token has expired (the system's clock).
    pub clock: Clock,
    /// A fault that a test stages, from `COVIS_TEST_FAULT`: `rpc:NAME` panics in the handler of that RPC, `rpc:*` of any;
    /// `panic-in-solve`, `panic-in-engine` and `fail-calls` are faults of the engine.
    #[cfg(feature = "faults")]
    pub test_fault: Option<String>,
}

/// How a server finds links whose other end is gone; their streams then end.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct KeepAlive {
    /// A connection is probed (HTTP/2 PING) after so long without a word from the peer (10 s).
    pub interval: Duration,
    /// It is given up when a probe is not answered for so long (10 s).
    pub timeout: Duration,
    /// The system's own probes (TCP) begin after so long, which also covers handshakes (60 s).
    pub tcp: Duration,
}

impl Default for KeepAlive {
    fn default() -> Self {
        let (interval, timeout) = (Duration::from_secs(10), Duration::from_secs(10));
        Self { interval, timeout, tcp: Duration::from_secs(60) }
    }
}

impl Default for ServerConfig {
    fn default() -> Self {
        Self {
            max_message_bytes: DEFAULT_MESSAGE_BYTES,
            max_concurrent_streams: 64,
            connections: ConnectionLimits::default(),
            keep_alive: KeepAlive::default(),
            max_maps: 1000,
            ceilings: Ceilings {
                max_keyframes: Some(100_000),
                max_landmarks: Some(20_000_000),
                max_observations: Some(100_000_000),
                max_bytes: None,
            },
            tenant_ceilings: TenantCeilings::default(),
            data_dir: None,
            tls: None,
            tokens: None,
            jwt: None,
            insecure_plain_text: false,
            metrics_listen: None,
            threads: std::thread::available_parallelism().map_or(1, usize::from),
            engine: EngineConfig::default(),
            drain_budget: Duration::from_secs(10),
            clock: Clock::System,
            #[cfg(feature = "faults")]
            test_fault: None,
        }
    }
}

impl ServerConfig {
    /// Whether a test wants the handler of `rpc` to panic.
    #[cfg(feature = "faults")]
    pub(super) fn panics_in_rpc(&self, rpc: &str) -> bool {
        let fault = self.test_fault.as_deref().and_then(|fault| fault.strip_prefix("rpc:"));
        fault.is_some_and(|name| name == rpc || name == "*")
    }

    /// No test can want a handler to panic.
    #[cfg(not(feature = "faults"))]
    pub(super) const fn panics_in_rpc(&self, _rpc: &str) -> bool {
        false
    }
}
