//! One job: what clients see of it, its record on disk, and what it holds of its tenant's account.
//!
//! A change of its state is written first and shown afterwards, so that no client learns of a state
//! that a crash could undo. Progress is shown only. Changes of one job are made one at a time, by whoever
//! has [`Entry::exclusive`]. What is shown is short enough for an answer ([`answer`](super::answer)); the
//! record has all files besides.

use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, MutexGuard};

use prost::Message;
use sha2::{Digest as _, Sha256};
use tokio::sync::watch;

use super::answer::shorten;
use super::uploads::{FILE_BYTES, counted};
use super::{answer, spec};
use crate::service::convert::time::timestamp;
use crate::service::engine::{Cancellation, EngineError, Reservation};
use crate::service::job_error::JobError;
use crate::store::{JobFiles, JobRecord, JobUid, JobUpload};
use crate::sync::Mutex;
use crate::wire::v1;
use v1::JobState;
use v1::job_spec::Spec;

/// Tenant and name of a job.
pub(super) type JobKey = (String, String);

/// Bytes that a job counts besides its files and its record: an empty job is not free.
const JOB_BYTES: u64 = 4096;

/// A job.
pub(super) struct Entry {
    pub(super) key: JobKey,
    pub(super) uid: JobUid,
    pub(super) number: i64,
    /// Its kind, by name.
    pub(super) kind: &'static str,
    /// What it was asked for in full, until it has ended: its record alone keeps that.
    asked: Mutex<Option<Arc<v1::JobSpec>>>,
    /// Length of that in the record, bytes.
    asked_bytes: u64,
    /// Tells that from what another request asks for.
    digest: Digest,
    /// The maps that it changes, by the engine's names.
    pub(super) changes: Vec<String>,
    /// What was uploaded for it.
    pub(super) upload: Option<JobUpload>,
    /// Whether it may still change something.
    pub(super) cancellation: Arc<Cancellation>,
    /// Whether it has had its turn.
    begun: AtomicBool,
    shown: watch::Sender<v1::Job>,
    /// All files that it made.
    files: Mutex<Vec<v1::JobFile>>,
    /// What is finished of its work.
    done: Mutex<v1::JobResult>,
    held: Mutex<JobReservations>,
    exclusive: tokio::sync::Mutex<()>,
}

/// A checksum of a spec.
type Digest = [u8; 32];

/// What a job holds of its tenant's account.
pub(super) struct JobReservations {
    /// Bytes of its files.
    pub(super) bytes: Reservation,
    /// One of the jobs that have not ended.
    pub(super) pending: Option<Reservation>,
}

impl Entry {
    /// A job with its full spec and what it holds.
    pub(super) fn new(
        (key, uid, number): (JobKey, JobUid, i64),
        mut job: v1::Job,
        done: v1::JobResult,
        changes: Vec<String>,
        upload: Option<JobUpload>,
        held: JobReservations,
    ) -> Self {
        let spec = job.spec.clone().unwrap_or_default();
        let files = job.files.clone();
        shorten(&mut job);
        let (kind, digest) = (spec::kind(&spec), digest(&spec));
        let asked_bytes = spec.encoded_len() as u64;
        let asked = (!is_ended(job.state())).then(|| Arc::new(spec));
        Self {
            key,
            uid,
            number,
            kind,
            asked: Mutex::new(asked),
            asked_bytes,
            digest,
            changes,
            upload,
            cancellation: Arc::default(),
            begun: AtomicBool::new(false),
            shown: watch::Sender::new(job),
            files: Mutex::new(files),
            done: Mutex::new(done),
            held: Mutex::new(held),
            exclusive: tokio::sync::Mutex::default(),
        }
    }

    /// Its name.
    pub(super) fn id(&self) -> &str {
        &self.key.1
    }

    /// The job as clients see it.
    pub(super) fn job(&self) -> v1::Job {
        self.shown.borrow().clone()
    }

    /// What it was asked for; `None` once it has ended.
    pub(super) fn asked(&self) -> Option<Arc<v1::JobSpec>> {
        self.asked.lock().clone()
    }

    /// Whether it was asked for the same.
    pub(super) fn is_asked(&self, spec: &v1::JobSpec) -> bool {
        self.digest == digest(spec)
    }

    /// Forgets what it was asked for: it has ended, and its record has all of it.
    pub(super) fn forget_asked(&self) {
        *self.asked.lock() = None;
    }

    /// Whether it is on a map, as its tenant calls it.
    pub(super) fn is_on(&self, map_id: &str) -> bool {
        let job = self.shown.borrow();
        job.spec.as_ref().is_some_and(|spec| spec::maps_of(spec).contains(&map_id))
    }

    /// All files that it made, the report first.
    pub(super) fn files(&self) -> Vec<v1::JobFile> {
        self.files.lock().clone()
    }

    /// Follows the job as clients see it.
    pub(super) fn follow(&self) -> watch::Receiver<v1::Job> {
        self.shown.subscribe()
    }

    /// Where it stands.
    pub(super) fn state(&self) -> JobState {
        self.shown.borrow().state()
    }

    /// Whether it has ended.
    pub(super) fn is_ended(&self) -> bool {
        is_ended(self.state())
    }

    /// Whether it waits for its turn.
    pub(super) fn is_waiting(&self) -> bool {
        self.state() == JobState::Pending && !self.begun.load(Ordering::Acquire)
    }

    /// It has its turn.
    pub(super) fn begin(&self) {
        self.begun.store(true, Ordering::Release);
    }

    /// Its priority.
    pub(super) fn priority(&self) -> i32 {
        self.shown.borrow().priority
    }

    /// When the server forgets it, Unix time in seconds.
    pub(super) fn expires(&self) -> Option<i64> {
        self.shown.borrow().expire_time.as_ref().map(|time| time.seconds)
    }

    /// Keeps an expired job for an hour, because it could not be removed.
    pub(super) fn keep_longer(&self) {
        self.shown.send_modify(|job| {
            if let Some(time) = &mut job.expire_time {
                time.seconds = time.seconds.saturating_add(3600);
            }
        });
    }

    /// Whoever has it changes the job.
    pub(super) async fn exclusive(&self) -> tokio::sync::MutexGuard<'_, ()> {
        self.exclusive.lock().await
    }

    /// What is finished of its work.
    pub(super) fn done(&self) -> v1::JobResult {
        self.done.lock().clone()
    }

    /// Bytes that its files hold of the account.
    pub(super) fn held(&self) -> MutexGuard<'_, JobReservations> {
        self.held.lock()
    }

    /// Counts more bytes of its files.
    ///
    /// # Errors
    /// RESOURCE_EXHAUSTED; then nothing is counted.
    pub(super) fn grow(&self, more: u64) -> Result<(), EngineError> {
        let mut held = self.held();
        let amount = held.bytes.amount().saturating_add(more);
        held.bytes.resize(amount)
    }

    /// Counts fewer bytes of its files.
    pub(super) fn shrink(&self, less: u64) {
        let mut held = self.held();
        let amount = held.bytes.amount().saturating_sub(less);
        held.bytes.count(amount);
    }

    /// Bytes that it counts with all that it keeps after its end.
    pub(super) fn kept_bytes(&self) -> u64 {
        let record = self.asked_bytes + self.shown.borrow().encoded_len() as u64;
        JOB_BYTES + record + files_bytes(&self.files.lock())
    }

    /// Writes the job as `change` makes it, then shows it. The caller has [`Entry::exclusive`].
    ///
    /// # Errors
    /// [`JobError::Unavailable`], [`JobError::Failed`]; nothing is changed.
    pub(super) async fn change(
        self: &Arc<Self>,
        files: &Arc<JobFiles>,
        change: impl FnOnce(&mut v1::Job, &mut v1::JobResult),
    ) -> Result<(), JobError> {
        let (mut job, mut done) = (self.job(), self.done());
        job.files = self.files();
        change(&mut job, &mut done);
        answer::forget_files(&mut job);
        let made = job.files.clone();
        // The record has the lists of the answer, and all files.
        shorten(&mut job);
        let record = v1::Job { files: made.clone(), ..job.clone() };
        self.write(files, &record, &done).await?;
        *self.done.lock() = done;
        *self.files.lock() = made;
        let has_ended = is_ended(job.state());
        self.shown.send_modify(|shown| {
            // Progress that was reported meanwhile stays.
            let progress = shown.progress.take();
            *shown = job;
            if !has_ended {
                shown.progress = progress;
            }
        });
        Ok(())
    }

    /// Writes its record. It has not ended, in memory.
    ///
    /// # Errors
    /// As [`Entry::change`].
    pub(super) async fn write(
        self: &Arc<Self>,
        files: &Arc<JobFiles>,
        job: &v1::Job,
        done: &v1::JobResult,
    ) -> Result<(), JobError> {
        let spec = self.asked().as_deref().cloned();
        let job = v1::Job { spec, progress: None, ..job.clone() };
        let record = JobRecord {
            tenant: self.key.0.clone(),
            job_id: self.key.1.clone(),
            number: self.number,
            job: job.encode_to_vec(),
            done: done.encode_to_vec(),
        };
        let uid = self.uid;
        on_disk(files, move |files| Ok(files.write_record(&uid, &record)?)).await?;
        Ok(())
    }

    /// Shows how far the job has come.
    pub(super) fn progress(&self, now_ns: i64, tell: impl FnOnce(&mut v1::JobProgress)) {
        self.shown.send_modify(|job| {
            let progress = job.progress.get_or_insert_default();
            tell(progress);
            progress.update_time = Some(timestamp(now_ns));
        });
    }
}

/// Bytes that files count.
pub(super) fn files_bytes(files: &[v1::JobFile]) -> u64 {
    let content: i64 = files.iter().map(|file| file.size_bytes).sum();
    u64::try_from(content).unwrap_or(0) + FILE_BYTES * files.len() as u64
}

/// Bytes that a job counts before it has made anything: its record, and its spec in memory.
pub(super) fn new_bytes(spec: &v1::JobSpec, upload: Option<&JobUpload>) -> u64 {
    JOB_BYTES + spec.encoded_len() as u64 + decoded_bytes(spec) + upload.map_or(0, counted)
}

/// Bytes that the long lists of a spec take in memory: a pose of 22 bytes on the wire takes many times that.
fn decoded_bytes(spec: &v1::JobSpec) -> u64 {
    let bytes = match &spec.spec {
        Some(Spec::EvaluateTrajectory(spec)) => size_of_val(&*spec.truth),
        Some(Spec::MergeMaps(request)) => {
            size_of_val(&*request.constraints) + size_of_val(&*request.renamed_clients)
        }
        Some(
            Spec::OptimizeMap(_)
            | Spec::RebuildMap(_)
            | Spec::CompactMap(_)
            | Spec::ExportMap(_)
            | Spec::SolveFiles(_)
            | Spec::Reconstruct(_),
        )
        | None => 0,
    };
    bytes as u64
}

fn digest(spec: &v1::JobSpec) -> Digest {
    Sha256::digest(spec.encode_to_vec()).into()
}

/// Whether a job in this state has ended.
pub(in crate::service) fn is_ended(state: JobState) -> bool {
    match state {
        JobState::Succeeded | JobState::Failed | JobState::Cancelled => true,
        JobState::Unspecified | JobState::Pending | JobState::Running => false,
    }
}

/// Works on files of jobs: on a thread that may block where they are on disk.
///
/// # Errors
/// Those of `work`, and [`JobError::Failed`] where it panics or the server stops.
pub(super) async fn on_disk<T: Send + 'static>(
    files: &Arc<JobFiles>,
    work: impl FnOnce(&JobFiles) -> Result<T, JobError> + Send + 'static,
) -> Result<T, JobError> {
    if !files.is_durable() {
        return work(files);
    }
    let files = Arc::clone(files);
    let done = tokio::task::spawn_blocking(move || work(&files)).await;
    done.unwrap_or_else(|error| {
        tracing::error!(%error, "work on files of a job did not end");
        Err(JobError::Failed { cause: "the work on them did not end".to_owned() })
    })
}
