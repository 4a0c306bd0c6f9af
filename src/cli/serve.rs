//! `covis serve`: the server in the foreground until SIGTERM or ctrl-c.
//!
//! Standard output gets two lines once every map is open: `listening on http://ADDRESS`, with port 0
//! the port that was taken, and where maps are kept. The first signal drains the server, a second one ends
//! the process at once.

use std::ffi::OsString;
use std::path::PathBuf;
use std::process::ExitCode;

use anyhow::Context;
use tokio::net::TcpListener;

use super::config::{Config, Layer};
use super::output::{ClosedPipe, print};
use super::signals::Signals;
use crate::service::engine::EngineConfig;
use crate::service::{Server, ServerConfig};

/// Arguments of `covis serve`.
#[derive(Debug, clap::Args)]
pub(super) struct Args {
    /// Address to listen on; port 0 takes a free one [default: 127.0.0.1:7411] [env: COVIS_LISTEN].
    #[arg(long, value_name = "ADDR")]
    listen: Option<String>,
    /// Worker threads of the solvers [default: one per processor] [env: COVIS_THREADS].
    #[arg(long, value_name = "N")]
    threads: Option<usize>,
    /// Finish each solve before the next item of a stream is taken [env: COVIS_LOCK_STEP].
    #[arg(long)]
    lock_step: bool,
    /// Folder to keep maps in [default: the platform's folder for data] [env: COVIS_DATA_DIR].
    #[arg(long, value_name = "DIR", conflicts_with = "in_memory")]
    data_dir: Option<PathBuf>,
    /// Keep maps in memory only: they are gone at the end [env: COVIS_IN_MEMORY].
    #[arg(long)]
    in_memory: bool,
}

impl Args {
    /// The settings that flags override.
    pub(super) fn layer(&self) -> Layer {
        Layer {
            listen: self.listen.clone(),
            threads: self.threads,
            lock_step: self.lock_step.then_some(true),
            data_dir: self.data_dir.clone(),
            in_memory: self.in_memory.then_some(true),
            ..Layer::default()
        }
    }
}

/// Serves until a signal comes.
pub(super) fn run(_args: Args, config: &Config) -> anyhow::Result<ExitCode> {
    let runtime = tokio::runtime::Runtime::new().context("the async runtime")?;
    runtime.block_on(serve(config))
}

async fn serve(config: &Config) -> anyhow::Result<ExitCode> {
    // Signals are caught before the address is told: a script may stop the server at once.
    let mut signals = Signals::new().context("signal handlers")?;
    let listener = TcpListener::bind(&config.listen)
        .await
        .with_context(|| format!("cannot listen on {}", config.listen))?;
    let data_dir = data_dir(config, |name| std::env::var_os(name), std::env::home_dir())?;
    let kept = match &data_dir {
        Some(directory) => format!("maps are kept in {}", directory.display()),
        None => "maps are kept in memory, and gone at the end".to_owned(),
    };
    let start = Server::start(listener, ServerConfig { data_dir, ..server_config(config) });
    let server = tokio::select! {
        server = start => server?,
        // What was opened so far needs no more than to be dropped.
        signal = signals.next() => anyhow::bail!("{signal} while starting"),
    };
    match print(format_args!("listening on http://{}\n{kept}", server.local_addr())) {
        // Nobody needs to read the address for the server to be of use.
        Err(error) if !error.is::<ClosedPipe>() => return Err(error),
        Ok(()) | Err(_) => {}
    }
    let signal = signals.next().await;
    tracing::info!("{signal}: shutting down");
    tokio::select! {
        () = server.shutdown() => Ok(ExitCode::SUCCESS),
        signal = signals.next() => anyhow::bail!("{signal} while shutting down"),
    }
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

/// The settings of the configuration that a server takes; where maps are kept is not among them.
pub(super) fn server_config(config: &Config) -> ServerConfig {
    let engine = EngineConfig {
        lock_step: config.lock_step,
        queue_capacity: config.queue_capacity,
        ..EngineConfig::default()
    };
    ServerConfig {
        threads: config.threads,
        max_message_bytes: config.max_message_bytes,
        max_concurrent_streams: config.max_concurrent_streams,
        engine,
        test_fault: config.test_fault.clone(),
        ..ServerConfig::default()
    }
}
