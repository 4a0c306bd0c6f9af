//! `covis serve`: the server in the foreground until SIGTERM or ctrl-c.
//!
//! Standard output gets one line, `listening on http://ADDRESS`, once connections are accepted; with
//! port 0 it tells the port that was taken. The first signal drains the server, a second one ends
//! the process at once.

use std::io;
use std::process::ExitCode;

use anyhow::Context;
use tokio::net::TcpListener;

use super::config::{Config, Layer};
use super::output::{ClosedPipe, print};
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
}

impl Args {
    /// The settings that flags override.
    pub(super) fn layer(&self) -> Layer {
        Layer {
            listen: self.listen.clone(),
            threads: self.threads,
            lock_step: self.lock_step.then_some(true),
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
    let server = Server::start(listener, server_config(config)).await?;
    match print(format_args!("listening on http://{}", server.local_addr())) {
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

/// The settings of the configuration that a server takes.
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

/// Interrupts and, on Unix, SIGTERM.
#[cfg(unix)]
struct Signals {
    interrupt: tokio::signal::unix::Signal,
    terminate: tokio::signal::unix::Signal,
}

#[cfg(unix)]
impl Signals {
    fn new() -> io::Result<Self> {
        use tokio::signal::unix::{SignalKind, signal};
        let interrupt = signal(SignalKind::interrupt())?;
        Ok(Self { interrupt, terminate: signal(SignalKind::terminate())? })
    }

    /// Waits for the next signal and names it.
    async fn next(&mut self) -> &'static str {
        tokio::select! {
            _ = self.interrupt.recv() => "interrupt",
            _ = self.terminate.recv() => "SIGTERM",
        }
    }
}

/// Interrupts.
#[cfg(not(unix))]
struct Signals;

#[cfg(not(unix))]
impl Signals {
    fn new() -> io::Result<Self> {
        Ok(Self)
    }

    /// Waits for the next interrupt.
    async fn next(&mut self) -> &'static str {
        if tokio::signal::ctrl_c().await.is_err() {
            std::future::pending::<()>().await;
        }
        "interrupt"
    }
}
