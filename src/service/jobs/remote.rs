//! A problem of a job, solved by a worker: given away, waited for, and taken back where no worker is left.
//!
//! The task has the name of the job's folder and the number of the problem. So a server that begins a job
//! again finds what it gave away, and a result that is there already. The result is taken off the queue
//! after it is in the job's record: until then the next start finds it again. How a problem is solved
//! is known to `solving` alone.

use std::io::{self, BufRead, Read};
use std::pin::Pin;
use std::sync::Arc;
use std::sync::atomic::Ordering;
use std::task::{Context, Poll, ready};
use std::time::Duration;

use prost::Message;
use tokio::io::{AsyncRead, ReadBuf};
use tokio::sync::mpsc;

use super::Jobs;
use super::run::Run;
use super::solving::{Solved, Task};
use super::task::{decode_result, encode_task};
use crate::service::engine::Resource;
use crate::service::error::ServiceError;
use crate::service::job_error::JobError;
use crate::store::{JobFile, JobFileError, JobFiles, JobUid, TaskError, TaskQueue, TaskState};
use crate::wire::v1;

/// How often a server looks where a task stands.
const LOOKS: Duration = Duration::from_millis(250);
/// Looks between two at whether there still are workers.
const COUNTS: u32 = 8;
/// Bytes of an input that are in memory at once.
const PIECE_BYTES: u64 = 256 << 10;
/// The phase of a job whose task no worker has.
const WAITS: &str = "waits for a worker";

/// A task that was given away. It is forgotten when this is dropped, unless the server stops.
pub(super) struct Outstanding {
    jobs: Arc<Jobs>,
    queue: Arc<dyn TaskQueue>,
    task: String,
    inputs: usize,
}

impl Drop for Outstanding {
    fn drop(&mut self) {
        // The next start of the server continues with it.
        if self.jobs.stopping.load(Ordering::Acquire) {
            return;
        }
        let (queue, task, inputs) =
            (Arc::clone(&self.queue), std::mem::take(&mut self.task), self.inputs);
        if let Ok(runtime) = tokio::runtime::Handle::try_current() {
            runtime.spawn(async move { queue.forget(&task, inputs).await });
        }
    }
}

/// Has a problem solved by a worker; `None` where there is none, or none any more. The caller drops what
/// comes with the result once it is in the job's record.
///
/// # Errors
/// The failure of the task, and [`JobError`] where its files cannot be read.
pub(super) async fn solve(
    run: &Run<'_>,
    task: &Task,
    inputs: &[u32],
    index: u32,
) -> Result<Option<(Solved, Outstanding)>, ServiceError> {
    let Some(queue) = &run.jobs.tasks else { return Ok(None) };
    let uid: String = run.entry.uid.iter().map(|byte| format!("{byte:02x}")).collect();
    let name = format!("{uid}-{index}");
    let outstanding = Outstanding {
        jobs: Arc::clone(run.jobs),
        queue: Arc::clone(queue),
        task: name.clone(),
        inputs: inputs.len(),
    };
    match given(run, queue.as_ref(), &name, task, inputs).await? {
        Ok(Some(result)) => {
            let account = run.jobs.account(&run.entry.key.0);
            // The message, and what it holds.
            let bytes = 2 * result.len() as u64;
            let held = account.reserve_existing(Resource::RunningSolveBytes, bytes);
            let solved = decode_result(&result)?;
            Ok(Some((Solved { held: Some(held), ..solved }, outstanding)))
        }
        Ok(None) => {
            let kept = match queue.checkpoint(&name).await {
                Ok(Some(checkpoint)) => {
                    let (files, uid) = (Arc::clone(&run.jobs.files), run.entry.uid);
                    let write = move || files.write_checkpoint(&uid, index, &checkpoint);
                    tokio::task::spawn_blocking(write).await.is_ok_and(|written| written.is_ok())
                }
                Ok(None) | Err(_) => false,
            };
            tracing::info!(
                job = run.entry.id(),
                kept,
                "no worker is available: this server does the job"
            );
            Ok(None)
        }
        Err(error) => {
            tracing::warn!(job = run.entry.id(), %error, "this server does a job itself");
            Ok(None)
        }
    }
}

/// Gives a task away and waits for its result; none where there are no workers. The inner error is one
/// before anything was given away.
async fn given(
    run: &Run<'_>,
    queue: &dyn TaskQueue,
    name: &str,
    task: &Task,
    inputs: &[u32],
) -> Result<Result<Option<Vec<u8>>, TaskError>, ServiceError> {
    let (known, has_workers) = match tokio::join!(queue.state(name), queue.has_workers()) {
        (Ok(known), Ok(has_workers)) => (known, has_workers),
        (Err(error), _) | (_, Err(error)) => return Ok(Err(error)),
    };
    if known.is_none() && !has_workers {
        return Ok(Ok(None));
    }
    let mut looks = 0_u32;
    // Where it is known it was given away by an attempt before, which may have ended in between.
    let (mut is_given, mut has_inputs) = (false, known.is_some());
    loop {
        if !is_given {
            run.tell(|progress| progress.phase = WAITS.to_owned());
            match give(run, queue, name, task, inputs, has_inputs).await? {
                Ok(()) => is_given = true,
                Err(error) => {
                    tracing::warn!(job = run.entry.id(), %error, "a task is not published yet")
                }
            }
        }
        looks = looks.wrapping_add(1);
        match look(run, queue, name, looks.is_multiple_of(COUNTS)).await {
            Ok(Look::Ended(result)) => return Ok(Ok(result)),
            // It has expired.
            Ok(Look::Gone) => (is_given, has_inputs) = (false, false),
            Ok(Look::Open) => {}
            // Until NATS is there again.
            Err(error) => {
                tracing::debug!(job = run.entry.id(), %error, "the state of a task cannot be read")
            }
        }
        tokio::time::sleep(LOOKS).await;
    }
}

/// What a look at a task found.
enum Look {
    /// It waits, or a worker has it.
    Open,
    /// It is not there any more.
    Gone,
    /// Its result, or none where it was taken back.
    Ended(Option<Vec<u8>>),
}

async fn look(
    run: &Run<'_>,
    queue: &dyn TaskQueue,
    name: &str,
    counts_workers: bool,
) -> Result<Look, TaskError> {
    match queue.state(name).await? {
        None => return Ok(Look::Gone),
        Some(TaskState::Done { result }) => {
            return Ok(Look::Ended(Some(queue.result(&result).await?)));
        }
        Some(TaskState::Taken { attempts, progress }) => show(run, attempts, &progress),
        Some(TaskState::Waiting) => {
            run.tell(|progress| progress.phase = WAITS.to_owned());
        }
    }
    if counts_workers && !queue.has_workers().await? && queue.withdraw(name).await? {
        return Ok(Look::Ended(None));
    }
    Ok(Look::Open)
}

/// Shows what a worker tells.
fn show(run: &Run<'_>, attempts: u32, told: &[u8]) {
    let Ok(told) = v1::JobProgress::decode(told) else { return };
    run.tell(|progress| {
        let share = progress.share;
        *progress = told;
        progress.share = share.or(progress.share);
        if progress.phase.is_empty() {
            progress.phase = format!("worker {attempts} begins");
        }
    });
}

/// Keeps the inputs where workers find them, and submits the task.
async fn give(
    run: &Run<'_>,
    queue: &dyn TaskQueue,
    name: &str,
    task: &Task,
    inputs: &[u32],
    has_inputs: bool,
) -> Result<Result<(), TaskError>, ServiceError> {
    if !has_inputs {
        for (index, &input) in inputs.iter().enumerate() {
            let (mut content, read) =
                Pieces::of(&run.jobs.files, run.entry.uid, JobFile::Input(input));
            let put = queue.put_input(name, index, &mut content).await;
            // The reader ends where nobody takes its pieces.
            drop(content);
            read.await.map_err(|_lost| ServiceError::Draining)?.map_err(JobError::from)?;
            if let Err(error) = put {
                return Ok(Err(error));
            }
        }
    }
    Ok(queue.submit(name, encode_task(task)).await)
}

/// The bytes of a file of a job, read in pieces as they are taken.
struct Pieces {
    queue: mpsc::Receiver<io::Result<Vec<u8>>>,
    piece: io::Cursor<Vec<u8>>,
}

impl Pieces {
    /// Begins to read; the other one says how the reading ended.
    fn of(
        files: &Arc<JobFiles>,
        uid: JobUid,
        file: JobFile,
    ) -> (Self, tokio::task::JoinHandle<Result<(), JobFileError>>) {
        let (pieces, queue) = mpsc::channel(1);
        let files = Arc::clone(files);
        let reading = tokio::task::spawn_blocking(move || {
            let read = files.read(&uid, file, |body| {
                loop {
                    let mut piece = Vec::new();
                    (&mut *body).take(PIECE_BYTES).read_to_end(&mut piece)?;
                    if piece.is_empty() || pieces.blocking_send(Ok(piece)).is_err() {
                        return Ok(());
                    }
                }
            });
            if read.is_err() {
                // What was taken is not whole.
                let _taken = pieces.blocking_send(Err(io::ErrorKind::InvalidData.into()));
            }
            read
        });
        (Self { queue, piece: io::Cursor::default() }, reading)
    }
}

impl AsyncRead for Pieces {
    fn poll_read(
        mut self: Pin<&mut Self>,
        cx: &mut Context<'_>,
        out: &mut ReadBuf<'_>,
    ) -> Poll<io::Result<()>> {
        loop {
            let rest = self.piece.fill_buf()?;
            if !rest.is_empty() {
                let length = rest.len().min(out.remaining());
                out.put_slice(&rest[..length]);
                self.piece.consume(length);
                return Poll::Ready(Ok(()));
            }
            match ready!(self.queue.poll_recv(cx)) {
                Some(piece) => self.piece = io::Cursor::new(piece?),
                None => return Poll::Ready(Ok(())),
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use tokio::io::AsyncReadExt as _;

    use super::*;

    #[tokio::test]
    async fn a_file_is_read_in_pieces_and_a_missing_one_is_no_empty_one() {
        let (files, uid) = (Arc::new(JobFiles::in_memory()), [1; 16]);
        let wanted: Vec<u8> = (0..3 * PIECE_BYTES + 7).map(|k| k as u8).collect();
        files.write(&uid, JobFile::Input(0), |out| out.write_all(&wanted)).unwrap();
        let (mut pieces, read) = Pieces::of(&files, uid, JobFile::Input(0));
        let mut bytes = Vec::new();
        pieces.read_to_end(&mut bytes).await.unwrap();
        assert!(bytes == wanted);
        read.await.unwrap().unwrap();
        let (mut pieces, read) = Pieces::of(&files, uid, JobFile::Input(1));
        pieces.read_to_end(&mut bytes).await.unwrap_err();
        assert_eq!(read.await.unwrap(), Err(JobFileError::Missing));
        // Whoever stops taking stops the reader.
        let (pieces, read) = Pieces::of(&files, uid, JobFile::Input(0));
        drop(pieces);
        read.await.unwrap().unwrap();
    }
}
