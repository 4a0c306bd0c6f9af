//! The queue as the servers use it that give tasks away.
//!
//! A task's entry is made before its message, so that a worker that has the message finds the entry. A
//! message is put only where the queue has none of the task: a server that begins again may submit what it
//! submitted before. What a task is about is not known here.

use async_nats::jetstream::context::PublishErrorKind;
use async_nats::jetstream::kv;
use async_nats::jetstream::message::PublishMessage;
use async_trait::async_trait;
use covis_solvers::bundle_adjustment::Checkpoint;
use tokio::io::AsyncRead;

use super::{Entry, Tasks, checkpoint_of, failed, input_of, subject_of};
use crate::{TaskError, TaskQueue, TaskState};

#[async_trait]
impl TaskQueue for Tasks {
    async fn has_workers(&self) -> Result<bool, TaskError> {
        let info = self.workers.stream.get_info().await;
        let info = info.map_err(|error| failed("the workers", &error))?;
        // Beats expire.
        Ok(info.state.messages > 0)
    }

    async fn state(&self, task: &str) -> Result<Option<TaskState>, TaskError> {
        let entry = self.entry(task).await?;
        Ok(entry.map(|(entry, _)| match entry {
            Entry { result: Some(result), .. } => TaskState::Done { result },
            Entry { worker: Some(_), attempts, progress, .. } => {
                TaskState::Taken { attempts, progress }
            }
            Entry { worker: None, .. } => TaskState::Waiting,
        }))
    }

    async fn put_input(
        &self,
        task: &str,
        index: usize,
        content: &mut (dyn AsyncRead + Send + Unpin),
    ) -> Result<(), TaskError> {
        self.put_stream(input_of(task, index), content).await
    }

    async fn submit(&self, task: &str, description: Vec<u8>) -> Result<(), TaskError> {
        match self.states.create(task, Entry::default().bytes()?).await {
            Ok(_) => {}
            Err(error) if error.kind() == kv::CreateErrorKind::AlreadyExists => {}
            Err(error) => return Err(failed("the state of a task", &error)),
        }
        let message =
            PublishMessage::build().payload(description.into()).expected_last_subject_sequence(0);
        let sent = self.context.send_publish(subject_of(task), message).await;
        let sent = sent.map_err(|error| failed("submitting", &error))?;
        match sent.await {
            Ok(_) => Ok(()),
            Err(error) if error.kind() == PublishErrorKind::WrongLastSequence => Ok(()),
            Err(error) => Err(failed("submitting", &error)),
        }
    }

    async fn result(&self, name: &str) -> Result<Vec<u8>, TaskError> {
        let found = self.object(name).await?;
        found.ok_or_else(|| failed("the result of a task", &"it is not there"))
    }

    async fn checkpoint(&self, task: &str) -> Result<Option<Checkpoint>, TaskError> {
        self.last_checkpoint(task).await
    }

    async fn withdraw(&self, task: &str) -> Result<bool, TaskError> {
        loop {
            let Some((entry, revision)) = self.entry(task).await? else { return Ok(true) };
            if entry.result.is_some() {
                return Ok(false);
            }
            match self.states.delete_expect_revision(task, Some(revision)).await {
                Ok(()) => return Ok(true),
                Err(error) if error.kind() == kv::UpdateErrorKind::WrongLastRevision => {}
                Err(error) => return Err(failed("the state of a task", &error)),
            }
        }
    }

    async fn forget(&self, task: &str, inputs: usize) {
        let result = match self.entry(task).await {
            Ok(Some((entry, _))) => entry.result,
            Ok(None) | Err(_) => None,
        };
        let entry = format!("{}{task}", self.states.prefix);
        // The entry first: from here on its worker is fenced.
        let left = match self.states.stream.purge().filter(entry).await {
            Ok(_) => self.queue.purge().filter(subject_of(task)).await.err(),
            Err(error) => Some(error),
        };
        if let Some(error) = left {
            tracing::warn!(task, %error, "a task is left until it expires");
        }
        self.remove_object(&checkpoint_of(task)).await;
        for index in 0..inputs {
            self.remove_object(&input_of(task, index)).await;
        }
        if let Some(result) = result {
            self.remove_object(&result).await;
        }
    }
}
