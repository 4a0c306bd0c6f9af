//! `covis worker`: solves the problems of servers' jobs until SIGTERM or ctrl-c.
//!
//! Standard output gets one line once it is connected. The first signal gives the task back that it has; a
//! second one ends the process at once, which does no harm either. The work is that of
//! `crate::service::Worker`; a build without the feature `cluster` refuses the command.

use super::config::Config;

/// Works until a signal comes.
#[cfg(feature = "cluster")]
pub(super) fn run(config: &Config) -> anyhow::Result<()> {
    use anyhow::Context;

    let runtime = tokio::runtime::Runtime::new().context("the async runtime")?;
    runtime.block_on(work(config))
}

/// Without the feature `cluster` there is nobody to work for.
#[cfg(not(feature = "cluster"))]
pub(super) fn run(_config: &Config) -> anyhow::Result<()> {
    anyhow::bail!("this covis was built without the feature `cluster`")
}

#[cfg(feature = "cluster")]
async fn work(config: &Config) -> anyhow::Result<()> {
    use anyhow::Context;

    use super::output::announce;
    use super::signals::Signals;
    use crate::service::{Worker, WorkerConfig};

    let mut signals = Signals::new().context("signal handlers")?;
    let replication = super::serve::replication(config, String::new());
    let replication =
        replication.context("a worker needs --nats: the NATS servers of its servers")?;
    let settings = WorkerConfig {
        replication,
        threads: config.threads(),
        #[cfg(feature = "faults")]
        test_fault: config.test_fault.clone(),
    };
    let worker = tokio::select! {
        worker = Worker::connect(&settings) => worker?,
        signal = signals.next() => anyhow::bail!("{signal} while starting"),
    };
    announce(format_args!("waiting for tasks, with {} threads", config.threads()))?;
    let (stop, stopped) = tokio::sync::oneshot::channel::<()>();
    let running = worker.run(async {
        // A dropped sender ends it too.
        let _stopped = stopped.await;
    });
    tokio::pin!(running);
    tokio::select! {
        () = &mut running => return Ok(()),
        signal = signals.next() => tracing::info!("{signal}: shutting down"),
    }
    drop(stop);
    tokio::select! {
        () = running => Ok(()),
        signal = signals.next() => anyhow::bail!("{signal} while shutting down"),
    }
}
