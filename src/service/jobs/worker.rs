//! A worker: a process that solves the problems of servers' jobs, one after the other.
//!
//! It has no maps and no jobs of its own, and keeps nothing on disk: what it is lost with is redelivered to
//! another worker, which continues from the last checkpoint. While it solves it beats. Once the task is not
//! its own any more, because it was canceled or because another worker has it, the solve ends and its
//! result is refused.

use std::future::Future;
use std::sync::Arc;

use covis_solvers::bundle_adjustment::Checkpoint;
use covis_solvers::io::reading::FileCounts;
use prost::Message;
use tokio::runtime::Handle;

use super::checkpoints::{CheckpointStorage, Checkpoints};
use super::reading::admit;
use super::run::{failure, pause};
use super::solving::{self, SolveContext, Solved, Task, Tell};
use super::task::{decode_task, encode_result};
use crate::service::engine::{Accounts, Cancellation, EngineMeters, SolverPool};
use crate::service::error::ServiceError;
use crate::service::server::ServerError;
use crate::store::{ClaimedTask, ReplicationOptions, TaskError, WorkerLink};
use crate::sync::Mutex;
use crate::wire::v1;

/// How many workers may end while they have a task before it counts as failed: it is likely what ends
/// them.
const MOST_ATTEMPTS: u32 = 5;
/// How often handing in a result is tried.
const HAND_IN: u32 = 150;

/// Settings of a worker.
#[derive(Clone, Debug)]
pub struct WorkerConfig {
    /// Where its tasks come from.
    pub replication: ReplicationOptions,
    /// Threads of its solves.
    pub threads: usize,
    /// A fault that a test injects: `hold-checkpoint` holds a solve after a checkpoint.
    #[cfg(feature = "faults")]
    pub test_fault: Option<String>,
}

/// A worker that is connected.
#[derive(Debug)]
pub struct Worker {
    link: WorkerLink,
    pool: Arc<SolverPool>,
    meters: EngineMeters,
    holds: bool,
}

impl Worker {
    /// Connects, waiting a while for NATS.
    ///
    /// # Errors
    /// [`ServerError::Replication`], and [`ServerError::Engine`] where the system has no threads.
    pub async fn connect(config: &WorkerConfig) -> Result<Self, ServerError> {
        let pool = SolverPool::shared_by(Accounts::default(), config.threads)?;
        let link = WorkerLink::open(&config.replication).await?;
        #[cfg(feature = "faults")]
        let holds = config.test_fault.as_deref() == Some("hold-checkpoint");
        #[cfg(not(feature = "faults"))]
        let holds = false;
        Ok(Self { link, pool, meters: EngineMeters::default(), holds })
    }

    /// Solves until `stop`. The task that it has then is given back.
    pub async fn run(self, stop: impl Future<Output = ()>) {
        tokio::pin!(stop);
        loop {
            let taken = tokio::select! {
                biased;
                () = &mut stop => break,
                taken = self.link.next() => match taken {
                    Ok(Some(taken)) => Arc::new(taken),
                    Ok(None) => continue,
                    Err(error) => {
                        tracing::warn!(%error, "no task was taken");
                        pause().await;
                        continue;
                    }
                },
            };
            let cancellation = Arc::<Cancellation>::default();
            let stopped = tokio::select! {
                biased;
                () = &mut stop => true,
                () = self.solve(&taken, &cancellation) => false,
            };
            if stopped {
                let _ends = cancellation.cancel();
                taken.give_back().await;
                break;
            }
        }
        self.link.leave().await;
    }

    /// Solves a task and hands in its result, as long as the task is this worker's.
    async fn solve(&self, taken: &Arc<ClaimedTask>, cancellation: &Arc<Cancellation>) {
        let (task, attempt) = (taken.name(), taken.attempts());
        tracing::info!(task, attempt, "a task was taken");
        let progress = Arc::<Mutex<v1::JobProgress>>::default();
        let beating = async {
            loop {
                tokio::time::sleep(self.link.period()).await;
                let told = progress.lock().encode_to_vec();
                match taken.beat(told).await {
                    Ok(true) => {}
                    Ok(false) => return,
                    Err(error) => tracing::warn!(task, %error, "a heartbeat was missed"),
                }
            }
        };
        let shown = Arc::clone(&progress);
        let tell: Tell = Arc::new(move |change| change(&mut shown.lock()));
        let result = tokio::select! {
            biased;
            () = beating => {
                let _ends = cancellation.cancel();
                tracing::info!(task, "the task was taken back, or another worker has it");
                return;
            }
            result = self.result(taken, cancellation, tell) => result,
        };
        let result = match result {
            Ok(result) => encode_result(result.map_err(failure)),
            Err(error) => {
                tracing::warn!(task, %error, "a task is returned");
                return taken.give_back().await;
            }
        };
        for _ in 0..HAND_IN {
            match taken.finish(&result).await {
                Ok(true) => return tracing::info!(task, "a task is done"),
                Ok(false) => return tracing::info!(task, "a late result was refused"),
                Err(error) => tracing::warn!(task, %error, "a result is not submitted yet"),
            }
            pause().await;
        }
    }

    /// The result of a task, which may be that it fails. An error is one of the queue: another attempt may
    /// succeed.
    async fn result(
        &self,
        taken: &Arc<ClaimedTask>,
        cancellation: &Arc<Cancellation>,
        tell: Tell,
    ) -> Result<Result<Solved, ServiceError>, TaskError> {
        let of_worker = |code: tonic::Code, message: String| {
            let (code, reason) = (code as i32, "WORKER_FAILED".to_owned());
            Ok(Err(ServiceError::OfWorker(v1::JobFailure { code, message, reason })))
        };
        if taken.attempts() > MOST_ATTEMPTS {
            let text = format!("{MOST_ATTEMPTS} workers ended while they had the task");
            return of_worker(tonic::Code::Aborted, text);
        }
        let Some(task) = decode_task(taken.description()) else {
            let text = "the worker does not know this kind of task: is it an older version?";
            return of_worker(tonic::Code::Unimplemented, text.to_owned());
        };
        let Task { path, files, .. } = &task;
        tell(&mut |progress| progress.phase = format!("reads {path}"));
        // The least that reading takes, before anything is in memory.
        let bytes = files.iter().map(|(_, size)| *size).fold(0, u64::saturating_add);
        if let Err(error) = admit("spec.solve_files", bytes, &task.ceiling) {
            return Ok(Err(error));
        }
        let (mut inputs, mut counts) = (Vec::with_capacity(files.len()), FileCounts::default());
        for index in 0..files.len() {
            let input = taken.input(index).await?;
            counts.add(&input);
            counts.end_file();
            inputs.push(input);
        }
        let solve_context = SolveContext {
            pool: &self.pool,
            account: self.pool.accounts().tenant(""),
            meters: &self.meters,
            cancellation: Arc::clone(cancellation),
            tell,
        };
        let storage = InQueue { taken: Arc::clone(taken), runtime: Handle::current() };
        let kept = Checkpoints::new(storage, self.holds, &solve_context);
        Ok(solving::solve(&task, &solve_context, (counts, move || Ok(inputs)), kept).await)
    }
}

/// Checkpoints where another worker can read them.
struct InQueue {
    taken: Arc<ClaimedTask>,
    runtime: Handle,
}

impl CheckpointStorage for InQueue {
    fn last(&self) -> Option<Checkpoint> {
        // A task that nobody had before has none.
        if self.taken.attempts() == 1 {
            return None;
        }
        let last = self.runtime.block_on(self.taken.checkpoint());
        last.unwrap_or_else(|error| {
            tracing::warn!(%error, "a checkpoint cannot be read, the solve begins again");
            None
        })
    }

    fn keep(&mut self, checkpoint: &Checkpoint) -> Result<(), String> {
        let kept = self.runtime.block_on(self.taken.keep_checkpoint(checkpoint));
        kept.map_err(|error| error.to_string())
    }
}
