//! Tasks that servers give to workers: a work queue, a bucket that fences, and an object store.
//!
//! - The queue (stream `covis_work`) has a message for each task that is not done. NATS hands it to one
//!   worker, and to another one where that is not heard of for the time of a lease.
//! - The bucket `covis_tasks` has the state of each task. Every write names the revision that it replaces: a
//!   worker that takes a task over makes the next write of the previous worker fail, and so does its owner by
//!   taking it back. So a result is accepted once, and no late one is.
//! - The objects (`covis_work_files`) are inputs, checkpoints and results. They count by what the bucket
//!   says. A checkpoint may also be that of a worker that was fenced: it is of the same solve.
//!
//! What is left by a server or a worker that was lost expires.

mod owner;
mod worker;

use std::fmt;
use std::time::Duration;

use async_nats::jetstream::consumer::{AckPolicy, PullConsumer, pull};
use async_nats::jetstream::context::Context;
use async_nats::jetstream::kv;
use async_nats::jetstream::object_store::{self, ObjectMetadata, ObjectStore};
use async_nats::jetstream::stream::{self, DiscardPolicy, RetentionPolicy, StorageType, Stream};
use serde::{Deserialize, Serialize};
use tokio::io::{AsyncRead, AsyncReadExt};

use super::bucket::latest;
use super::connect::{bucket, nats};
use super::{ReplicationError, ReplicationOptions};
use crate::{EncodingError, TaskError};
pub use worker::{ClaimedTask, WorkerLink};

/// How long what belongs to a task is kept after its last change. A server that still waits then submits
/// the task again.
const KEPT: Duration = Duration::from_secs(7 * 24 * 3600);
/// Bytes of a message of an object.
const CHUNK: usize = 512 << 10;

/// What servers and workers share of tasks.
#[derive(Clone)]
pub(super) struct Tasks {
    context: Context,
    queue: Stream,
    consumer: PullConsumer,
    states: kv::Store,
    workers: kv::Store,
    objects: ObjectStore,
    lease: Duration,
}

impl fmt::Debug for Tasks {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Tasks").field("lease", &self.lease).finish_non_exhaustive()
    }
}

/// A task as the bucket knows it.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
struct Entry {
    /// The worker that has it.
    #[serde(default)]
    worker: Option<String>,
    /// How many workers have had it.
    #[serde(default)]
    attempts: u32,
    /// What the worker last told.
    #[serde(default)]
    progress: Vec<u8>,
    /// The object that is its result, once it is done.
    #[serde(default)]
    result: Option<String>,
}

impl Entry {
    fn bytes(&self) -> Result<bytes::Bytes, TaskError> {
        let bytes = serde_json::to_vec(self);
        Ok(bytes.map_err(|error| failed("the state of a task", &error))?.into())
    }
}

impl Tasks {
    /// Opens what is shared, or makes it.
    ///
    /// # Errors
    /// [`ReplicationError::Nats`].
    pub(super) async fn open(
        context: &Context,
        options: &ReplicationOptions,
    ) -> Result<Self, ReplicationError> {
        let (lease, replicas) = (options.lease, options.replicas);
        let config = stream::Config {
            name: "covis_work".to_owned(),
            subjects: vec![subject_of("*")],
            description: Some("tasks that wait for a worker, or that one has".to_owned()),
            retention: RetentionPolicy::WorkQueue,
            discard: DiscardPolicy::New,
            storage: StorageType::File,
            num_replicas: replicas,
            max_age: KEPT,
            ..stream::Config::default()
        };
        let queue = context.get_or_create_stream(config).await;
        let queue = queue.map_err(|error| nats("the queue of tasks", &error))?;
        let config = pull::Config {
            durable_name: Some("workers".to_owned()),
            ack_policy: AckPolicy::Explicit,
            // A worker that is not heard of for so long has lost its task.
            ack_wait: lease,
            ..pull::Config::default()
        };
        let consumer = queue.create_consumer(config).await;
        let consumer = consumer.map_err(|error| nats("the queue of tasks", &error))?;
        let states = bucket("covis_tasks", replicas, KEPT);
        let states = context.create_or_update_key_value(states).await;
        let states = states.map_err(|error| nats("the bucket of tasks", &error))?;
        let workers = bucket("covis_workers", replicas, 2 * lease);
        let workers = context.create_or_update_key_value(workers).await;
        let workers = workers.map_err(|error| nats("the bucket of workers", &error))?;
        let config = object_store::Config {
            bucket: "covis_work_files".to_owned(),
            num_replicas: replicas,
            max_age: KEPT,
            ..object_store::Config::default()
        };
        let objects = context.create_object_store(config).await;
        let objects = objects.map_err(|error| nats("the files of tasks", &error))?;
        let context = context.clone();
        Ok(Self { context, queue, consumer, states, workers, objects, lease })
    }

    /// A task's entry as the leader has it, and its revision.
    async fn entry(&self, task: &str) -> Result<Option<(Entry, u64)>, TaskError> {
        let found = latest(&self.states, task).await;
        let found = found.map_err(|error| failed("the state of a task", &error))?;
        let Some((bytes, revision)) = found else { return Ok(None) };
        let entry = serde_json::from_slice(&bytes);
        let entry = entry.map_err(|error| failed("the state of a task", &error))?;
        Ok(Some((entry, revision)))
    }

    /// Replaces the entry of `revision`; `None` where it is another one by now.
    async fn replace(
        &self,
        task: &str,
        entry: &Entry,
        revision: u64,
    ) -> Result<Option<u64>, TaskError> {
        match self.states.update(task, entry.bytes()?, revision).await {
            Ok(revision) => Ok(Some(revision)),
            Err(error) if error.kind() == kv::UpdateErrorKind::WrongLastRevision => Ok(None),
            Err(error) => Err(failed("the state of a task", &error)),
        }
    }

    async fn put_object(&self, name: String, bytes: &[u8]) -> Result<(), TaskError> {
        self.put_stream(name, &mut &bytes[..]).await
    }

    /// Puts an object that is read in pieces.
    async fn put_stream(
        &self,
        name: String,
        mut content: &mut (dyn AsyncRead + Send + Unpin),
    ) -> Result<(), TaskError> {
        let meta = ObjectMetadata { name, chunk_size: Some(CHUNK), ..Default::default() };
        let put = self.objects.put(meta, &mut content).await;
        put.map(drop).map_err(|error| failed("a file of a task", &error))
    }

    /// An object; `None` where there is none of this name.
    async fn object(&self, name: &str) -> Result<Option<Vec<u8>>, TaskError> {
        let mut object = match self.objects.get(name).await {
            Ok(object) => object,
            Err(error) if error.kind() == object_store::GetErrorKind::NotFound => return Ok(None),
            Err(error) => return Err(failed("a file of a task", &error)),
        };
        let mut bytes = Vec::new();
        let read = object.read_to_end(&mut bytes).await;
        read.map_err(|error| failed("a file of a task", &error))?;
        Ok(Some(bytes))
    }

    /// Removes an object; what cannot be removed expires.
    async fn remove_object(&self, name: &str) {
        if let Err(error) = self.objects.delete(name).await {
            tracing::debug!(name, %error, "a file of a task is left until it expires");
        }
    }

    /// The last checkpoint of a task. One that cannot be read is told: the solve begins again.
    async fn last_checkpoint(
        &self,
        task: &str,
    ) -> Result<Option<covis_solvers::bundle_adjustment::Checkpoint>, TaskError> {
        let Some(bytes) = self.object(&checkpoint_of(task)).await? else { return Ok(None) };
        let decoded = crate::encoding::decode_checkpoint(&bytes);
        let tell = |error: &EncodingError| {
            tracing::warn!(task, %error, "a checkpoint cannot be read, the solve begins again");
        };
        Ok(decoded.inspect_err(tell).ok())
    }
}

fn failed(what: &'static str, cause: &dyn fmt::Display) -> TaskError {
    TaskError { what, cause: cause.to_string() }
}

/// The subject of a task in the queue.
fn subject_of(task: &str) -> String {
    format!("covis.work.{task}")
}

fn input_of(task: &str, index: usize) -> String {
    format!("{task}.input.{index}")
}

fn checkpoint_of(task: &str) -> String {
    format!("{task}.checkpoint")
}
