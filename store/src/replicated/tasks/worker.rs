//! The queue as workers use it: taking a task, telling that it goes on, handing in its result.
//!
//! A worker that has a task sends heartbeats: it renews the delivery and the task's entry. The entry tells it
//! whether the task is still its own. It is not where another worker took it, or its owner took it back. What
//! a task is about is not known here.

use std::time::Duration;

use async_nats::jetstream::{AckKind, Message};
use covis_solvers::bundle_adjustment::Checkpoint;
use futures_util::StreamExt;
use tokio::sync::Mutex;
use tokio::task::AbortHandle;

use super::{Entry, Tasks, checkpoint_of, failed, input_of};
use crate::encoding::encode_checkpoint;
use crate::replicated::connect::{link, patiently};
use crate::replicated::new_uid;
use crate::{ReplicationError, ReplicationOptions, TaskError};

/// Beats in the time of a lease.
const BEATS: u32 = 4;
/// How long one request for a task waits.
const WAITS: Duration = Duration::from_secs(5);

/// A worker's place at the queue; dropping it ends its beats.
#[derive(Debug)]
pub struct WorkerLink {
    tasks: Tasks,
    name: String,
    beating: AbortHandle,
}

impl Drop for WorkerLink {
    fn drop(&mut self) {
        self.beating.abort();
    }
}

impl WorkerLink {
    /// Connects, waiting a while for NATS, and tells that there is a worker.
    ///
    /// # Errors
    /// [`ReplicationError`].
    pub async fn open(options: &ReplicationOptions) -> Result<Self, ReplicationError> {
        let tasks = patiently(options, || async {
            let (context, _) = link(options).await?;
            Tasks::open(&context, options).await
        });
        let (tasks, name) = (tasks.await?, new_uid());
        let (beats, key) = (tasks.clone(), name.clone());
        let beating = tokio::spawn(async move {
            loop {
                if let Err(error) = beats.workers.put(&key, "".into()).await {
                    tracing::warn!(%error, "the worker's heartbeat was not sent");
                }
                tokio::time::sleep(beats.lease / BEATS).await;
            }
        });
        Ok(Self { tasks, name, beating: beating.abort_handle() })
    }

    /// How often a worker beats for a task that it has.
    pub fn period(&self) -> Duration {
        self.tasks.lease / BEATS
    }

    /// Takes a task; `None` where there is none for a while.
    ///
    /// # Errors
    /// [`TaskError`].
    pub async fn next(&self) -> Result<Option<ClaimedTask>, TaskError> {
        let fetched = self.tasks.consumer.fetch().max_messages(1).expires(WAITS).messages().await;
        let mut fetched = fetched.map_err(|error| failed("taking a task", &error))?;
        let Some(message) = fetched.next().await else { return Ok(None) };
        let message = message.map_err(|error| failed("taking a task", &error))?;
        let task = message.subject.rsplit('.').next().unwrap_or_default().to_owned();
        loop {
            let known = self.tasks.entry(&task).await?;
            let Some((entry, revision)) = known.filter(|(entry, _)| entry.result.is_none()) else {
                // Done, or taken back by its owner.
                settle(&message).await?;
                return Ok(None);
            };
            let attempts = entry.attempts.saturating_add(1);
            let entry = Entry { worker: Some(self.name.clone()), attempts, ..entry };
            if let Some(revision) = self.tasks.replace(&task, &entry, revision).await? {
                let (tasks, held) = (self.tasks.clone(), Mutex::new((entry, revision)));
                return Ok(Some(ClaimedTask { tasks, task, attempts, message, held }));
            }
        }
    }

    /// Tells that there is no worker here any more.
    pub async fn leave(self) {
        self.beating.abort();
        let key = format!("{}{}", self.tasks.workers.prefix, self.name);
        if let Err(error) = self.tasks.workers.stream.purge().filter(key).await {
            tracing::debug!(%error, "the worker's heartbeat is left until it expires");
        }
    }
}

/// A task that this worker has, as long as no other one has it and its owner waits.
#[derive(Debug)]
pub struct ClaimedTask {
    tasks: Tasks,
    task: String,
    attempts: u32,
    message: Message,
    /// The entry as this worker wrote it last, and its revision.
    held: Mutex<(Entry, u64)>,
}

impl ClaimedTask {
    /// Its name.
    pub fn name(&self) -> &str {
        &self.task
    }

    /// What is to be done, in the encoding of its owner.
    pub fn description(&self) -> &[u8] {
        &self.message.payload
    }

    /// How many workers have had it, this one included.
    pub fn attempts(&self) -> u32 {
        self.attempts
    }

    /// An input.
    ///
    /// # Errors
    /// [`TaskError`].
    pub async fn input(&self, index: usize) -> Result<Vec<u8>, TaskError> {
        let found = self.tasks.object(&input_of(&self.task, index)).await?;
        found.ok_or_else(|| failed("an input of a task", &"it is not there"))
    }

    /// The last checkpoint of the workers before.
    ///
    /// # Errors
    /// [`TaskError`].
    pub async fn checkpoint(&self) -> Result<Option<Checkpoint>, TaskError> {
        self.tasks.last_checkpoint(&self.task).await
    }

    /// Keeps a checkpoint where another worker can read it.
    ///
    /// # Errors
    /// [`TaskError`]; the checkpoint before it may be lost.
    pub async fn keep_checkpoint(&self, checkpoint: &Checkpoint) -> Result<(), TaskError> {
        let name = checkpoint_of(&self.task);
        self.tasks.put_object(name, &encode_checkpoint(checkpoint)).await
    }

    /// Tells that the work goes on, and how far it is. False once the task is not this worker's any
    /// more.
    ///
    /// # Errors
    /// [`TaskError`].
    pub async fn beat(&self, progress: Vec<u8>) -> Result<bool, TaskError> {
        let is_ours = self.write(|entry| entry.progress = progress).await?;
        if is_ours {
            let renewed = self.message.ack_with(AckKind::Progress).await;
            renewed.map_err(|error| failed("renewing a task", &error))?;
        }
        Ok(is_ours)
    }

    /// Hands in the result. False where the task is not this worker's any more: the result is refused.
    /// The same call can be repeated.
    ///
    /// # Errors
    /// [`TaskError`].
    pub async fn finish(&self, result: &[u8]) -> Result<bool, TaskError> {
        // No other worker's result has this name.
        let name = format!("{}.result.{}", self.task, new_uid());
        self.tasks.put_object(name.clone(), result).await?;
        let result = Some(name.clone());
        if !self.write(|entry| entry.result = result).await? {
            self.tasks.remove_object(&name).await;
            return Ok(false);
        }
        settle(&self.message).await?;
        Ok(true)
    }

    /// Lets another worker take it at once, or this one once more.
    pub async fn give_back(&self) {
        if let Err(error) = self.message.ack_with(AckKind::Nak(None)).await {
            tracing::debug!(task = self.task, %error, "the task is free with the lease");
        }
    }

    /// Changes the entry, if it is still that of this worker.
    async fn write(&self, change: impl FnOnce(&mut Entry)) -> Result<bool, TaskError> {
        let mut held = self.held.lock().await;
        let mut entry = held.0.clone();
        change(&mut entry);
        loop {
            if let Some(revision) = self.tasks.replace(&self.task, &entry, held.1).await? {
                *held = (entry, revision);
                return Ok(true);
            }
            // The answer to this worker's own last write may have been lost.
            match self.tasks.entry(&self.task).await? {
                Some((found, revision))
                    if found.worker == entry.worker && found.attempts == entry.attempts =>
                {
                    held.1 = revision;
                }
                Some(_) | None => return Ok(false),
            }
        }
    }
}

/// Takes the message out of the queue.
async fn settle(message: &Message) -> Result<(), TaskError> {
    message.double_ack().await.map_err(|error| failed("settling a task", &error))
}
