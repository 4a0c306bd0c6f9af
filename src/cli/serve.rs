//! `covis serve`: the server in the foreground until SIGTERM or ctrl-c.
//!
//! Standard output gets two lines once every map is open: `listening on http://ADDRESS` (`https`
//! with TLS), with port 0 the port that was taken, and where maps are kept; further ones tell where
//! metrics and the page are, if they are served. The first signal drains the server, a second one ends the
//! process at once. SIGHUP has certificates, tokens and keys read again, where there are any.

use std::ffi::OsString;
use std::io;
use std::net::SocketAddr;
use std::path::PathBuf;
use std::time::Duration;

use anyhow::Context;
use tokio::net::TcpListener;

use super::config::Config;
use super::output::announce;
use super::signals::Signals;
use crate::service::engine::{EngineConfig, Resource};
use crate::service::{ConnectionLimits, JwtOptions, Server, ServerConfig, TlsFiles};

/// Serves until a signal comes.
pub(super) fn run(config: &Config) -> anyhow::Result<()> {
    let runtime = tokio::runtime::Runtime::new().context("the async runtime")?;
    raise_descriptors();
    runtime.block_on(serve(config))
}

/// Lets the process open as many files and connections as the system allows it: the usual soft
/// limit of 1024 is for programs that cannot count further.
fn raise_descriptors() {
    #[cfg(unix)]
    {
        use rustix::process::{Resource, Rlimit, getrlimit, setrlimit};
        let Rlimit { maximum, .. } = getrlimit(Resource::Nofile);
        // Where that is refused the limits of connections follow what there is.
        let _as_it_is = setrlimit(Resource::Nofile, Rlimit { current: maximum, maximum });
    }
}

async fn serve(config: &Config) -> anyhow::Result<()> {
    // Signals are caught before the address is told: a script may stop the server at once.
    let mut signals = Signals::new().context("signal handlers")?;
    let mut reloads = Reloads::new(config).context("signal handlers")?;
    let listen = config.listen.as_deref().unwrap_or("127.0.0.1:7411");
    let listener =
        TcpListener::bind(listen).await.with_context(|| format!("cannot listen on {listen}"))?;
    let data_dir = data_dir(config, |name| std::env::var_os(name), std::env::home_dir())?;
    let kept = match &data_dir {
        Some(directory) => format!("maps are kept in {}", directory.display()),
        None => "maps are kept in memory, and lost when the server stops".to_owned(),
    };
    let address = listener.local_addr().context("the listener's address")?;
    let settings = ServerConfig { data_dir, ..guarded(config) };
    let start = Server::start(listener, shared(settings, config, address)?);
    let server = tokio::select! {
        server = start => server?,
        // What was opened so far needs no more than to be dropped.
        signal = signals.next() => anyhow::bail!("{signal} while starting"),
    };
    let scheme = if config.tls_cert.is_some() { "https" } else { "http" };
    let metrics =
        server.metrics_addr().map(|address| format!("\nmetrics on http://{address}/metrics"));
    let metrics = metrics.unwrap_or_default();
    let page = server.page_addr().map(|address| format!("\nthe page is at {scheme}://{address}/"));
    let page = page.unwrap_or_default();
    let address = server.local_addr();
    announce(format_args!("listening on {scheme}://{address}\n{kept}{metrics}{page}"))?;
    let signal = loop {
        tokio::select! {
            signal = signals.next() => break signal,
            () = reloads.next() => {
                if let Err(error) = server.reload() {
                    let error = anyhow::Error::from(error);
                    tracing::error!("nothing was reloaded, everything stays as it was: {error:#}");
                }
            }
        }
    };
    tracing::info!("{signal}: shutting down");
    tokio::select! {
        () = server.shutdown() => Ok(()),
        signal = signals.next() => anyhow::bail!("{signal} while shutting down"),
    }
}

/// The settings with those of a cluster, where maps are shared.
#[cfg(feature = "cluster")]
fn shared(
    settings: ServerConfig,
    config: &Config,
    address: SocketAddr,
) -> anyhow::Result<ServerConfig> {
    if config.nats.is_none() {
        return Ok(settings);
    }
    let scheme = if config.tls_cert.is_some() { "https" } else { "http" };
    let address = match &config.advertise {
        Some(url) => url.clone(),
        None if address.ip().is_unspecified() => {
            anyhow::bail!("clients of other servers need --advertise: they cannot reach {address}")
        }
        None => format!("{scheme}://{address}"),
    };
    Ok(ServerConfig { replication: replication(config, address), ..settings })
}

/// The settings of a process that is reached at `address`; `None` where no NATS is named.
#[cfg(feature = "cluster")]
pub(super) fn replication(
    config: &Config,
    address: String,
) -> Option<crate::store::ReplicationOptions> {
    let nats = config.nats.clone()?;
    let monitoring = config.nats_monitoring.as_deref().unwrap_or_default().split(',');
    let monitoring = monitoring.map(str::trim).filter(|url| !url.is_empty());
    Some(crate::store::ReplicationOptions {
        nats,
        monitoring: monitoring.map(str::to_owned).collect(),
        accept_unsynced: config.accept_unsynced_replicas,
        replicas: config.nats_replicas.unwrap_or(3),
        lease: Duration::from_secs(config.lease_seconds.unwrap_or(5)),
        address,
    })
}

/// Without the feature `cluster` nothing is shared.
#[cfg(not(feature = "cluster"))]
fn shared(
    settings: ServerConfig,
    config: &Config,
    _address: SocketAddr,
) -> anyhow::Result<ServerConfig> {
    anyhow::ensure!(config.nats.is_none(), "this covis was built without the feature `cluster`");
    Ok(settings)
}

/// Where maps are kept; `None` is in memory. Without a setting it is where the platform keeps data
/// of programs.
fn data_dir(
    config: &Config,
    variable: impl Fn(&str) -> Option<OsString>,
    home: Option<PathBuf>,
) -> anyhow::Result<Option<PathBuf>> {
    if config.in_memory {
        return Ok(None);
    }
    if let Some(directory) = &config.data_dir {
        return Ok(Some(directory.clone()));
    }
    let from = |name| variable(name).map(PathBuf::from).filter(|path| path.is_absolute());
    let data = if cfg!(windows) {
        from("LOCALAPPDATA")
    } else if cfg!(target_os = "macos") {
        home.map(|home| home.join("Library/Application Support"))
    } else {
        from("XDG_DATA_HOME").or_else(|| home.map(|home| home.join(".local/share")))
    };
    let data = data.context("no home folder is known: name one with --data-dir, or --in-memory")?;
    Ok(Some(data.join("covis")))
}

/// The settings of a server that others may reach: those of [`server_config`], and who may come in.
fn guarded(config: &Config) -> ServerConfig {
    let files = config.tls_cert.clone().zip(config.tls_key.clone());
    let tls = files.map(|(certificate, key)| {
        let client_ca = config.tls_client_ca.clone();
        TlsFiles { certificate, key, client_ca }
    });
    let jwt = config.jwks.clone().map(|jwks| JwtOptions {
        jwks,
        issuer: config.jwt_issuer.clone().unwrap_or_default(),
        audience: config.jwt_audience.clone().unwrap_or_default(),
    });
    ServerConfig {
        tls,
        tokens: config.tokens.clone(),
        jwt,
        insecure_plain_text: config.insecure_plain_text,
        metrics_listen: config.metrics_listen.clone(),
        page_listen: config.http.clone(),
        ..server_config(config)
    }
}

/// The settings of the configuration that a server takes; where maps are kept and who may come in
/// are not among them.
pub(super) fn server_config(config: &Config) -> ServerConfig {
    let default = ServerConfig::default();
    let engine = EngineConfig {
        lock_step: config.lock_step,
        queue_capacity: config.queue_capacity.unwrap_or(default.engine.queue_capacity),
        ..config.solve_limits.over(EngineConfig::default())
    };
    let (most, strangers) = (config.max_connections, config.max_strangers);
    let connections = ConnectionLimits {
        max_connections: most.unwrap_or(default.connections.max_connections),
        max_strangers: strangers.unwrap_or(default.connections.max_strangers),
        ..default.connections
    };
    let streams = config.max_concurrent_streams;
    let max_maps =
        config.server_limits.of(Resource::Maps).and_then(|maps| usize::try_from(maps).ok());
    ServerConfig {
        threads: config.threads(),
        map_limits: config.map_limits.over(&default.map_limits),
        max_maps,
        tenant_limits: config.tenant_limits,
        server_limits: config.server_limits.over(&default.server_limits),
        max_message_bytes: config.max_message_bytes.unwrap_or(default.max_message_bytes),
        max_concurrent_streams: streams.unwrap_or(default.max_concurrent_streams),
        connections,
        drain_budget: config.drain_budget.map_or(default.drain_budget, Duration::from_secs),
        job_retention: config.job_retention.map_or(default.job_retention, Duration::from_secs),
        engine,
        #[cfg(feature = "faults")]
        test_fault: config.test_fault.clone(),
        ..default
    }
}

/// SIGHUP, where there is something to read again; elsewhere it ends the process as it always does.
struct Reloads {
    #[cfg(unix)]
    hangup: Option<tokio::signal::unix::Signal>,
}

impl Reloads {
    #[cfg(unix)]
    fn new(config: &Config) -> io::Result<Self> {
        use tokio::signal::unix::{SignalKind, signal};
        let files = [&config.tls_cert, &config.tokens, &config.jwks];
        let is_wanted = files.iter().any(|file| file.is_some());
        Ok(Self { hangup: is_wanted.then(|| signal(SignalKind::hangup())).transpose()? })
    }

    #[cfg(not(unix))]
    fn new(_config: &Config) -> io::Result<Self> {
        Ok(Self {})
    }

    /// Waits until the files are to be read again.
    async fn next(&mut self) {
        #[cfg(unix)]
        if let Some(hangup) = &mut self.hangup {
            hangup.recv().await;
            return;
        }
        std::future::pending().await
    }
}
