//! One job from its begin to its end.
//!
//! The job's state on disk is RUNNING while it runs. Its files are complete before its end is written:
//! a job that has ended has all of them. A cancel that comes before the first change ends it at once;
//! the threads that still work on it stop by themselves, and what they make is dropped. A bug ends the
//! job and nothing else.

use std::future::Future;
use std::panic::AssertUnwindSafe;
use std::sync::Arc;
use std::sync::atomic::Ordering;
use std::time::Duration;

use futures_util::FutureExt;
use tonic::Status;
use tonic_types::StatusExt as _;

use super::entry::{Entry, on_disk};
use super::uploads::{FILE_BYTES, number};
use super::{Jobs, maps, problems, report};
use crate::service::access::Caller;
use crate::service::context::Context;
use crate::service::convert::count;
use crate::service::convert::time::timestamp;
use crate::service::engine::{EngineError, panic_message};
use crate::service::error::ServiceError;
use crate::service::job_error::JobError;
use crate::store::{JobFile, JobFiles, StoreError};
use crate::wire::v1;
use v1::JobState;
use v1::job_spec::Spec;

/// Path of the report among a job's files.
pub(super) const REPORT: &str = "report.json";

/// How long a job waits before it asks again for a disk that has no room, or a map that is busy.
const PAUSE: Duration = Duration::from_millis(200);

/// Phase of a job that waits for room on the disk.
const WAITS_FOR_DISK: &str = "waits for the disk";

/// What a job made.
pub(super) struct Made {
    /// The result.
    pub(super) result: v1::job_result::Result,
    /// A list of the result that is longer than it is there.
    pub(super) shortened: Option<v1::ShortenedList>,
    /// Cost before and after, where it solved something.
    pub(super) costs: Option<(f64, f64)>,
    /// What is kept of its work.
    pub(super) report: Report,
}

impl Made {
    /// Something with a short result.
    pub(super) fn new(result: v1::job_result::Result, report: serde_json::Value) -> Self {
        Self { result, shortened: None, costs: None, report: Report::Whole(report) }
    }
}

/// The report of a job, as JSON.
pub(super) enum Report {
    /// In memory.
    Whole(serde_json::Value),
    /// That of each problem is a part of the work on disk: together they may be longer than what a solve
    /// may take.
    OfParts(u32),
}

/// A job that runs.
pub(super) struct Run<'a> {
    pub(super) jobs: &'a Arc<Jobs>,
    pub(super) entry: &'a Arc<Entry>,
    /// Somebody of the job's tenant; the role was checked when the job was created.
    pub(super) caller: Caller,
}

impl Run<'_> {
    /// Shows how far the job has come.
    pub(super) fn tell(&self, tell: impl FnOnce(&mut v1::JobProgress)) {
        self.entry.progress(self.jobs.now_ns(), tell);
    }

    /// Shows what the job is doing.
    pub(super) fn phase(&self, phase: impl Into<String>) {
        let phase = phase.into();
        self.tell(|progress| {
            *progress = v1::JobProgress { phase, ..v1::JobProgress::default() };
        });
    }

    /// Counts more bytes of files that the job made.
    ///
    /// # Errors
    /// RESOURCE_EXHAUSTED.
    pub(super) fn reserve(&self, more: u64) -> Result<(), EngineError> {
        self.entry.grow(more)
    }

    /// Does work that a full disk may stop, again until there is room: the work of hours is not thrown
    /// away for want of a few bytes, and what a map was given cannot be taken back.
    ///
    /// # Errors
    /// Those of `work` but those that pass once there is room, and [`ServiceError::Draining`].
    async fn patiently<T, F: Future<Output = Result<T, ServiceError>>>(
        &self,
        mut work: impl FnMut() -> F,
    ) -> Result<T, ServiceError> {
        loop {
            let done = work().await;
            let Some(cause) = done.as_ref().err().and_then(lacks_room) else { return done };
            tracing::warn!(job = self.entry.id(), cause, "a job waits for the disk");
            self.phase(WAITS_FOR_DISK);
            drop(done);
            tokio::select! {
                () = pause() => {}
                () = self.jobs.context.drained() => return Err(ServiceError::Draining),
            }
        }
    }

    /// Writes a file of the job. It counts for the job once it is in the record.
    ///
    /// # Errors
    /// RESOURCE_EXHAUSTED of the job's account, [`JobError`].
    pub(super) async fn write(&self, file: JobFile, bytes: Vec<u8>) -> Result<(), ServiceError> {
        self.reserve(FILE_BYTES + bytes.len() as u64)?;
        let (uid, bytes) = (self.entry.uid, Arc::<[u8]>::from(bytes));
        let files = &self.jobs.files;
        let write = || {
            let bytes = Arc::clone(&bytes);
            async move {
                let write = move |files: &JobFiles| {
                    files.write(&uid, file, |out| out.write_all(&bytes))?;
                    Ok(())
                };
                Ok(on_disk(files, write).await?)
            }
        };
        self.patiently(write).await
    }

    /// Changes the job's record.
    ///
    /// # Errors
    /// As [`Run::write`].
    pub(super) async fn change(
        &self,
        change: impl Fn(&mut v1::Job, &mut v1::JobResult),
    ) -> Result<(), ServiceError> {
        let write = || async {
            let _exclusive = self.entry.exclusive().await;
            Ok(self.entry.change(&self.jobs.files, &change).await?)
        };
        self.patiently(write).await
    }

    async fn work(&self) -> Result<Made, ServiceError> {
        let asked = self.entry.asked();
        match asked.as_ref().and_then(|asked| asked.spec.as_ref()) {
            Some(Spec::OptimizeMap(request)) => maps::optimize(self, request).await,
            Some(Spec::MergeMaps(request)) => maps::merge(self, request).await,
            Some(Spec::CompactMap(spec)) => maps::compact(self, spec).await,
            Some(Spec::EvaluateTrajectory(spec)) => maps::evaluate(self, spec).await,
            Some(Spec::ExportMap(request)) => maps::export(self, request).await,
            Some(Spec::SolveFiles(spec)) => problems::solve(self, spec).await,
            Some(Spec::Reconstruct(spec)) if spec.map_id.is_empty() => {
                problems::rebuild(self, spec).await
            }
            Some(Spec::Reconstruct(spec)) => maps::rebuild(self, &spec.map_id).await,
            Some(Spec::RebuildMap(_)) | None => Err(ServiceError::Unserved { what: "this kind" }),
        }
    }

    /// Does the work, and writes the report.
    async fn made(&self) -> Result<Made, ServiceError> {
        if self.jobs.context.config.holds("hold-jobs") {
            self.entry.cancellation.canceled().await;
        }
        let made = self.patiently(|| self.work()).await?;
        let size_bytes = match &made.report {
            Report::Whole(report) => {
                let report = report::to_text(report);
                let size = count(report.len());
                self.write(JobFile::Output(0), report).await?;
                size
            }
            Report::OfParts(parts) => self.patiently(|| self.join_parts(*parts)).await?,
        };
        let file = v1::JobFile { path: REPORT.to_owned(), size_bytes };
        let changed = self.change(|job, _| match job.files.first_mut() {
            Some(first) => *first = file.clone(),
            None => job.files.push(file.clone()),
        });
        changed.await?;
        Ok(made)
    }
}

impl Run<'_> {
    /// Makes the report of those of the problems, one in memory at a time; returns its size.
    async fn join_parts(&self, parts: u32) -> Result<i64, ServiceError> {
        self.reserve(FILE_BYTES)?;
        let (entry, uid) = (Arc::clone(self.entry), self.entry.uid);
        let files = Arc::clone(&self.jobs.files);
        let joined = Context::blocking(move || {
            let (mut failure, mut grown, mut size) = (None::<ServiceError>, 0_u64, 0_u64);
            let written = files.write(&uid, JobFile::Output(0), |out| {
                size = report::join_parts(parts, out, |part| {
                    let read = files.bytes(&uid, JobFile::Part(part)).map_err(JobError::from);
                    let counted = read.map_err(ServiceError::from).and_then(|bytes| {
                        entry.grow(bytes.len() as u64)?;
                        grown += bytes.len() as u64;
                        Ok(bytes)
                    });
                    counted.map_err(|error| {
                        failure = Some(error);
                        std::io::ErrorKind::InvalidData.into()
                    })
                })?;
                Ok(())
            });
            let error = match (failure, written) {
                (None, Ok(_whole)) => return Ok(i64::try_from(size).unwrap_or(i64::MAX)),
                (Some(error), _) => error,
                (None, Err(error)) => JobError::from(error).into(),
            };
            // It may be tried again.
            entry.shrink(FILE_BYTES + grown);
            Err(error)
        });
        joined.await
    }
}

/// The number of the file that a job with these files writes next; 0 is the report's.
pub(super) fn next_output(files: &[v1::JobFile]) -> JobFile {
    JobFile::Output(number(files.len().max(1)))
}

/// Adds a file that is written to those of a job.
pub(super) fn add_file(files: &mut Vec<v1::JobFile>, path: String, size_bytes: i64) {
    if files.is_empty() {
        // The report is the first file.
        files.push(v1::JobFile { path: REPORT.to_owned(), size_bytes: 0 });
    }
    files.push(v1::JobFile { path, size_bytes });
}

/// Waits before something is tried again.
pub(super) async fn pause() {
    tokio::time::sleep(PAUSE).await;
}

/// Runs a job to its end, or until the server stops.
pub(super) async fn run(jobs: &Arc<Jobs>, entry: &Arc<Entry>) {
    if !begin(jobs, entry).await {
        return;
    }
    let caller = Caller::of_tenant(&entry.key.0);
    let run = Run { jobs, entry, caller };
    let work = AssertUnwindSafe(run.made()).catch_unwind();
    let outcome = tokio::select! {
        biased;
        () = entry.cancellation.canceled() => None,
        outcome = work => Some(outcome.unwrap_or_else(|panic| {
            let message = panic_message(panic.as_ref());
            Err(ServiceError::Panicked { message: format!("a job: {message}") })
        })),
    };
    let is_stopping = || jobs.stopping.load(Ordering::Acquire);
    let outcome = match outcome {
        // For the next start.
        None if is_stopping() => return,
        None => Err(None),
        Some(Err(error)) if ends_with_the_server(&error) => {
            jobs.context.drained().await;
            return;
        }
        Some(Err(error)) => Err(Some(failure(error))),
        Some(Ok(made)) => Ok(made),
    };
    loop {
        let exclusive = entry.exclusive().await;
        let ended = match &outcome {
            Ok(made) => {
                let change = |job: &mut v1::Job, _: &mut v1::JobResult| {
                    job.result = Some(v1::JobResult { result: Some(made.result.clone()) });
                    job.shortened_lists.extend(made.shortened.clone());
                    // Costs that no number holds are in the summary only.
                    let is_finite = |&(before, after): &(f64, f64)| (before + after).is_finite();
                    (job.cost_before, job.cost_after) = made.costs.filter(is_finite).unzip();
                };
                jobs.end(entry, JobState::Succeeded, change).await
            }
            Err(Some(failure)) => {
                jobs.end(entry, JobState::Failed, |job, _| {
                    job.failure = Some(failure.clone());
                    job.files.clear();
                })
                .await
            }
            Err(None) => jobs.end(entry, JobState::Cancelled, |job, _| job.files.clear()).await,
        };
        let Err(error) = ended else { break };
        tracing::warn!(job = entry.id(), %error, "the end of a job could not be written");
        run.phase(WAITS_FOR_DISK);
        drop(exclusive);
        tokio::select! {
            () = pause() => {}
            () = jobs.context.drained() => return,
        }
    }
    if let Some(begin) = entry.job().start_time.as_ref().and_then(nanoseconds) {
        let took = jobs.now_ns().saturating_sub(begin);
        jobs.meters.running_ns.observe(u64::try_from(took).unwrap_or(0));
    }
}

/// Why work ended, where it succeeds once the disk has room again.
fn lacks_room(error: &ServiceError) -> Option<&str> {
    let (ServiceError::Job(JobError::Unavailable { cause })
    | ServiceError::Engine(EngineError::Store(StoreError::Unavailable { cause, .. }))) = error
    else {
        return None;
    };
    Some(cause)
}

/// Whether work ended because the server does, and is to be done by the next start.
fn ends_with_the_server(error: &ServiceError) -> bool {
    matches!(error, ServiceError::Draining | ServiceError::Engine(EngineError::ShuttingDown))
}

/// Writes that the job runs. `false` if it was canceled before, or the server stops.
async fn begin(jobs: &Arc<Jobs>, entry: &Arc<Entry>) -> bool {
    loop {
        let exclusive = entry.exclusive().await;
        if entry.is_ended() {
            return false;
        }
        let now_ns = jobs.now_ns();
        // Where it was canceled before, the server ended before the job did.
        let is_canceled = entry.job().cancel_requested;
        let written = if is_canceled {
            jobs.end(entry, JobState::Cancelled, |job, _| job.files.clear()).await
        } else {
            let begun = entry.change(&jobs.files, |job, _| {
                job.set_state(JobState::Running);
                job.start_time = Some(timestamp(now_ns));
                job.attempt_count = job.attempt_count.saturating_add(1);
            });
            begun.await
        };
        match written {
            Ok(()) if is_canceled => return false,
            Ok(()) => break,
            Err(error) => {
                tracing::warn!(job = entry.id(), %error, "the begin of a job could not be written");
            }
        }
        drop(exclusive);
        tokio::select! {
            () = pause() => {}
            () = jobs.context.drained() => return false,
        }
    }
    let job = entry.job();
    let times = job.create_time.as_ref().zip(job.start_time.as_ref());
    if let Some((created, begun)) = times
        && let (Some(created), Some(begun)) = (nanoseconds(created), nanoseconds(begun))
    {
        let waited = begun.saturating_sub(created);
        jobs.meters.waiting_ns.observe(u64::try_from(waited).unwrap_or(0));
    }
    tracing::debug!(job = entry.id(), kind = entry.kind, "job begun");
    true
}

fn nanoseconds(time: &prost_types::Timestamp) -> Option<i64> {
    time.seconds.checked_mul(1_000_000_000)?.checked_add(i64::from(time.nanos))
}

/// Why a job failed, as the call would have answered.
pub(super) fn failure(error: ServiceError) -> v1::JobFailure {
    let status = Status::from(error);
    let reason = status.get_details_error_info().map(|info| info.reason).unwrap_or_default();
    v1::JobFailure { code: status.code() as i32, message: status.message().to_owned(), reason }
}
