//! The settings of a server. Tokens, keys and certificates are in files that can be read again
//! while it runs; all other settings stay until it ends.

use std::path::PathBuf;
use std::time::Duration;

use serde::Deserialize;

use super::access::JwtOptions;
use super::clock::Clock;
use super::connections::ConnectionLimits;
use super::engine::{AccountLimits, EngineConfig, Resource};
use super::tls::TlsFiles;
use crate::map::MapLimits;

/// Largest message by default, bytes: 4 MiB.
const DEFAULT_MESSAGE_BYTES: usize = 4 * 1024 * 1024;

/// 1 GiB.
const GIB: u64 = 1 << 30;

/// What an open map takes that holds nothing, bytes: 91 KiB in a server with 8,000 of them.
const EMPTY_MAP_BYTES: u64 = 96 << 10;

/// Limits of one map, for a machine of 8 GiB: 2 GiB of estimated memory, which is half of what
/// all maps may take together, and counts that no robot or collection of pictures comes near. There
/// may be as many cameras as keyframes, because a model made from pictures may have one for each.
#[must_use]
pub fn default_map_limits() -> MapLimits {
    MapLimits {
        clients: Some(10_000),
        cameras: Some(100_000),
        keyframes: Some(100_000),
        landmarks: Some(20_000_000),
        observations: Some(100_000_000),
        constraints: Some(1_000_000),
        priors: Some(1_000_000),
        bytes: Some(2 * GIB),
    }
}

/// Bytes of the files of jobs that a server without a data directory keeps, in memory: half a GiB.
const JOB_BYTES_IN_MEMORY: u64 = GIB / 2;

/// Limits of a server on a machine of 8 GiB: 4 GiB for all maps, 2 GiB for solves, 1 GiB for problems
/// that wait for theirs and half a GiB for journals that wait for the disk leave the rest to queues,
/// exports and the system. A stream needs some ten kilobytes with its queue; an export or a list needs
/// its snapshot and one chunk.
#[must_use]
pub fn default_limits() -> AccountLimits {
    AccountLimits::of_maps(MapLimits { bytes: Some(4 * GIB), ..MapLimits::default() })
        .with(Resource::Streams, 2000)
        .with(Resource::Watchers, 1000)
        .with(Resource::Exports, 64)
        .with(Resource::Lists, 64)
        .with(Resource::WaitingSolves, 256)
        .with(Resource::WaitingSolveBytes, GIB)
        .with(Resource::RunningSolveBytes, 2 * GIB)
        .with(Resource::JournalBytes, GIB / 2)
        .with(Resource::PendingJobs, 256)
        .with(Resource::JobBytes, 4 * GIB)
        .with(Resource::Uploads, 256)
}

/// Limits of the estimate of one solve, `[solve_limits]` of `covis.toml`; a solve above them is not
/// started. An absent key means the default.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SolveLimits {
    /// Memory in bytes.
    pub max_bytes: Option<u64>,
    /// Work of one iteration, Gflop.
    pub max_gflops: Option<u64>,
}

impl SolveLimits {
    /// These limits where they are set, otherwise those of `default`.
    pub fn over(&self, default: EngineConfig) -> EngineConfig {
        EngineConfig {
            max_solve_bytes: self.max_bytes.unwrap_or(default.max_solve_bytes),
            max_solve_gflops: self.max_gflops.unwrap_or(default.max_solve_gflops),
            ..default
        }
    }
}

/// Settings of a server; each with its default.
#[derive(Clone, Debug)]
pub struct ServerConfig {
    /// Largest message that is accepted or sent, bytes (4 MiB).
    pub max_message_bytes: usize,
    /// Streams that one connection may hold at once (64).
    pub max_concurrent_streams: u32,
    /// How many connections are kept, and how long a connection may be idle.
    pub connections: ConnectionLimits,
    /// How a peer that disappeared is detected.
    pub keep_alive: KeepAlive,
    /// Maps that the server keeps ([`ServerConfig::most_maps`]).
    pub max_maps: Option<usize>,
    /// Limits of a map, which its policy can only lower; see [`default_map_limits`].
    pub map_limits: MapLimits,
    /// Limits of a tenant that has no limits in the file of tokens (none: those of the server).
    pub tenant_limits: AccountLimits,
    /// Limits of the server as a whole, besides `max_maps`; see [`default_limits`].
    pub server_limits: AccountLimits,
    /// The folder where maps are kept (none: in memory, lost at the end).
    pub data_dir: Option<PathBuf>,
    /// With whom maps are shared (nobody). Needs `data_dir`.
    #[cfg(feature = "cluster")]
    pub replication: Option<crate::store::ReplicationOptions>,
    /// Certificate and key of the listener (none: plain text).
    pub tls: Option<TlsFiles>,
    /// The file of tokens (none). Without it and `jwt` everybody may do everything.
    pub tokens: Option<PathBuf>,
    /// Whose JSON Web Tokens are accepted (nobody's).
    pub jwt: Option<JwtOptions>,
    /// Whether plain text is served beyond the loopback interface (no).
    pub insecure_plain_text: bool,
    /// Where `GET /metrics` is answered, `host:port` (nowhere).
    pub metrics_listen: Option<String>,
    /// Where the page is served to browsers, `host:port` (nowhere).
    pub page_listen: Option<String>,
    /// Threads of the solver pool (one per processor).
    pub threads: usize,
    /// How engines run.
    pub engine: EngineConfig,
    /// How long a job is kept after its end (7 days).
    pub job_retention: Duration,
    /// How long a shutdown waits for calls that are still running (10 s).
    pub drain_budget: Duration,
    /// The clock that decides whether a token has expired (the system's).
    pub clock: Clock,
    /// A fault that a test injects, from `COVIS_TEST_FAULT`: `rpc:NAME` panics in the handler of
    /// that RPC, `rpc:*` of any; `hold-jobs` and `hold-problems` hold jobs; `panic-in-solve`,
    /// `panic-in-window`, `panic-in-result`, `panic-in-retirement`, `panic-in-background`,
    /// `impossible-result`, `panic-in-engine` and `fail-calls` are faults of the engine.
    #[cfg(feature = "faults")]
    pub test_fault: Option<String>,
}

/// How a server detects connections whose peer is gone; their streams then end.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct KeepAlive {
    /// After this time without data from the peer, a connection is probed (HTTP/2 PING) (10 s).
    pub interval: Duration,
    /// A connection is closed when a probe is not answered within this time (10 s).
    pub timeout: Duration,
    /// The system's own probes (TCP) begin after this time; they also cover handshakes (60 s).
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
            max_maps: None,
            map_limits: default_map_limits(),
            tenant_limits: AccountLimits::default(),
            server_limits: default_limits(),
            data_dir: None,
            #[cfg(feature = "cluster")]
            replication: None,
            tls: None,
            tokens: None,
            jwt: None,
            insecure_plain_text: false,
            metrics_listen: None,
            page_listen: None,
            threads: std::thread::available_parallelism().map_or(1, usize::from),
            engine: EngineConfig::default(),
            job_retention: Duration::from_secs(7 * 24 * 3600),
            drain_budget: Duration::from_secs(10),
            clock: Clock::System,
            #[cfg(feature = "faults")]
            test_fault: None,
        }
    }
}

impl ServerConfig {
    /// The fault that a test injects; none without the feature `faults`.
    fn fault(&self) -> Option<&str> {
        #[cfg(feature = "faults")]
        return self.test_fault.as_deref();
        #[cfg(not(feature = "faults"))]
        return None;
    }

    /// Whether a test injects a panic into the handler of `rpc`.
    pub(super) fn panics_in_rpc(&self, rpc: &str) -> bool {
        let fault = self.fault().and_then(|fault| fault.strip_prefix("rpc:"));
        fault.is_some_and(|name| name == rpc || name == "*")
    }

    /// Whether a test holds jobs: `hold-jobs` before their work, `hold-problems` before the second
    /// problem of one, `hold-checkpoint` after a
    /// checkpoint, `hold-applied` after a map's solve was applied and before that is in the record.
    pub(super) fn holds(&self, what: &str) -> bool {
        self.fault() == Some(what)
    }

    /// Maps that the server keeps: `max_maps`, or as many as take a quarter of the bytes of all maps while they
    /// are empty.
    #[must_use]
    pub fn most_maps(&self) -> usize {
        let by_memory = || {
            let bytes = self.server_limits.held.bytes.unwrap_or(4 * GIB);
            usize::try_from(bytes / 4 / EMPTY_MAP_BYTES).unwrap_or(usize::MAX)
        };
        self.max_maps.unwrap_or_else(by_memory)
    }

    /// Limits of the server's account.
    pub(super) fn account_limits(&self) -> AccountLimits {
        let limits = self.server_limits.with(Resource::Maps, self.most_maps() as u64);
        match (&self.data_dir, limits.of(Resource::JobBytes)) {
            (Some(_), _) => limits,
            // In memory they are part of the process.
            (None, bytes) => {
                let bytes = bytes.unwrap_or(JOB_BYTES_IN_MEMORY).min(JOB_BYTES_IN_MEMORY);
                limits.with(Resource::JobBytes, bytes)
            }
        }
    }

    /// Limits of the account of each map.
    pub(super) fn map_account_limits(&self) -> AccountLimits {
        AccountLimits::of_maps(self.map_limits)
    }
}
