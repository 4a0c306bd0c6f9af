//! Tasks of a server that other processes do: what a server asks of the queue between them.
//!
//! A task has a name that is never used for another one, and inputs. It is done once: its result is
//! accepted from the worker that has it, and from no other. What a task is about is not known here.

use std::fmt;

use async_trait::async_trait;
use covis_solvers::bundle_adjustment::Checkpoint;
use tokio::io::AsyncRead;

/// Why a call on the queue of tasks failed; the same call may succeed later.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("the queue of tasks: {what}: {cause}")]
pub struct TaskError {
    /// What was tried.
    pub what: &'static str,
    /// What the queue answered.
    pub cause: String,
}

/// Where a task stands.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum TaskState {
    /// No worker has it yet.
    Waiting,
    /// A worker has it.
    Taken {
        /// How many workers have had it, this one included.
        attempts: u32,
        /// What the worker last told, in the encoding of the task's owner.
        progress: Vec<u8>,
    },
    /// Its result is there.
    Done {
        /// Names the result in [`TaskQueue::result`].
        result: String,
    },
}

/// The queue of tasks, as servers see it.
#[async_trait]
pub trait TaskQueue: fmt::Debug + Send + Sync + 'static {
    /// Whether a worker has been heard of lately.
    ///
    /// # Errors
    /// [`TaskError`].
    async fn has_workers(&self) -> Result<bool, TaskError>;

    /// Where a task stands; `None` where there is none of this name.
    ///
    /// # Errors
    /// [`TaskError`].
    async fn state(&self, task: &str) -> Result<Option<TaskState>, TaskError>;

    /// Keeps an input of a task that is submitted afterwards.
    ///
    /// # Errors
    /// [`TaskError`], also where `content` cannot be read.
    async fn put_input(
        &self,
        task: &str,
        index: usize,
        content: &mut (dyn AsyncRead + Send + Unpin),
    ) -> Result<(), TaskError>;

    /// Submits a task. Repeating it changes nothing.
    ///
    /// # Errors
    /// [`TaskError`]; the task may be there or not.
    async fn submit(&self, task: &str, description: Vec<u8>) -> Result<(), TaskError>;

    /// The result of a task.
    ///
    /// # Errors
    /// [`TaskError`].
    async fn result(&self, name: &str) -> Result<Vec<u8>, TaskError>;

    /// The last checkpoint of a task's worker, if there is one that can be read.
    ///
    /// # Errors
    /// [`TaskError`].
    async fn checkpoint(&self, task: &str) -> Result<Option<Checkpoint>, TaskError>;

    /// Takes a task back: from here on no worker's result is accepted. False where it is done already.
    ///
    /// # Errors
    /// [`TaskError`]; it may be taken back or not.
    async fn withdraw(&self, task: &str) -> Result<bool, TaskError>;

    /// Removes a task, done or not, with its inputs. What cannot be removed takes room and expires.
    async fn forget(&self, task: &str, inputs: usize);
}
