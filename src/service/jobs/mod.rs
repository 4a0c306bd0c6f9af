//! Jobs: work that outlives a call, and survives the server where maps are kept on disk.
//!
//! A job is on disk before its creation is answered, and each change of its state before it is shown.
//! A restart begins again with what ran: a solve gives the same bits as one that was not cut off. What a
//! job has finished of several problems is not solved again, and a bundle adjustment of files goes on from
//! its last checkpoint (decision 0030).
//!
//! | file | role |
//! |---|---|
//! | `entry` | one job, its record and what it holds |
//! | `answer` | a job in an answer: its long lists are cut |
//! | `spec` | what a spec asks for: role, maps, uploads |
//! | `uploads`, `download` | the files that jobs take and make |
//! | `schedule` | which job begins next; restarts; what has expired |
//! | `run` | one job from its begin to its end |
//! | `maps` | the work on maps: optimizing, compacting, merging, exporting, evaluating |
//! | `problems` | the work on problem files: which there are, one after the other |
//! | `solving` | one problem, read and solved by a server or a worker |
//! | `reading` | what reading uploaded files takes, before they are read |
//! | `remote`, `task` | a problem that a worker solves, as its server sees it, and as messages |
//! | `worker` | the process that solves problems of servers, behind the feature `cluster` |
//! | `checkpoints` | solves of problem files on their way |
//! | `progress` | how much longer a solve takes |
//! | `report`, `moved` | what is kept of a job's work as JSON, and where keyframes were before and after |
//!
//! No mathematics here: solves are those of the engine and of the solver crate.

mod answer;
mod checkpoints;
mod download;
mod entry;
mod maps;
mod meters;
mod moved;
mod problems;
mod progress;
mod reading;
mod remote;
mod report;
mod run;
mod schedule;
mod solving;
mod spec;
mod task;
mod uploads;
#[cfg(feature = "cluster")]
mod worker;

use std::collections::{BTreeMap, BTreeSet};
use std::sync::Arc;
use std::sync::atomic::AtomicBool;

use futures_util::FutureExt;
use tokio::sync::{Notify, Semaphore};

use super::access::Caller;
use super::context::Context;
use super::convert::time::timestamp;
use super::engine::{Account, FairQueue, Resource};
use super::error::ServiceError;
use super::job_error::JobError;
use super::random::random_uid;
use crate::store::{JobFile, JobFiles, JobUid, TaskQueue};
use crate::sync::Mutex;
use crate::wire::v1;
use entry::{Entry, JobKey, JobReservations, new_bytes};
use uploads::Waiting;
use v1::JobState;

pub(super) use download::download;
pub(super) use entry::is_ended;
pub(super) use meters::JobMeters;
pub(super) use schedule::serve;
pub(crate) use spec::{kind, maps_of};
#[cfg(feature = "cluster")]
pub use worker::{Worker, WorkerConfig};

/// Jobs that run besides those of the solver's threads where workers solve.
const AT_WORKERS: usize = 32;

/// Jobs of a server.
pub(super) struct Jobs {
    context: Arc<Context>,
    files: Arc<JobFiles>,
    table: Mutex<Table>,
    /// Jobs are created one at a time, so that none conflicts with another that is not there yet.
    creating: tokio::sync::Mutex<()>,
    /// Wakes the schedule.
    wake: Notify,
    /// Solves of problem files that this server does itself, at once.
    solves_here: Semaphore,
    /// Where problems are given to workers.
    tasks: Option<Arc<dyn TaskQueue>>,
    /// Whether the server stops: what runs is left as it is, for the next start.
    stopping: AtomicBool,
    /// What is counted.
    pub(super) meters: JobMeters,
}

impl std::fmt::Debug for Jobs {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Jobs").finish_non_exhaustive()
    }
}

/// All jobs and uploads.
struct Table {
    jobs: BTreeMap<JobKey, Arc<Entry>>,
    /// Uploads that no job has taken.
    uploads: BTreeMap<JobUid, Waiting>,
    /// Names of jobs that a later version wrote: they are taken.
    taken: BTreeSet<JobKey>,
    /// One entry for each waiting job: whose turn it is. Which job of a tenant begins is chosen then.
    queue: FairQueue<()>,
    last_number: i64,
}

/// A page of a list of jobs.
pub(super) struct JobList<'a> {
    /// Only jobs that were created before this one.
    pub(super) before: i64,
    /// Only jobs on this map.
    pub(super) map_id: &'a str,
    /// Only jobs in these states; empty for all.
    pub(super) states: &'a [JobState],
}

impl Jobs {
    /// No jobs yet; at most as many run at once as the solver pool has threads, and more where there is a
    /// queue to workers.
    pub(super) fn new(
        context: Arc<Context>,
        files: JobFiles,
        tasks: Option<Arc<dyn TaskQueue>>,
    ) -> Self {
        let threads = context.maps.pool().threads();
        let slots = if tasks.is_some() { threads + AT_WORKERS } else { threads };
        let table = Table {
            jobs: BTreeMap::new(),
            uploads: BTreeMap::new(),
            taken: BTreeSet::new(),
            queue: FairQueue::new(slots),
            last_number: 0,
        };
        Self {
            context,
            files: Arc::new(files),
            table: Mutex::new(table),
            creating: tokio::sync::Mutex::default(),
            wake: Notify::new(),
            solves_here: Semaphore::new(threads),
            tasks,
            stopping: AtomicBool::new(false),
            meters: JobMeters::default(),
        }
    }

    /// Nanoseconds since 1970 by the server's clock.
    fn now_ns(&self) -> i64 {
        self.context.config.clock.now_ns()
    }

    /// The account of a tenant.
    fn account(&self, tenant: &str) -> Arc<Account> {
        self.context.maps.pool().accounts().tenant(tenant)
    }

    /// How many jobs wait, run, and have ended.
    pub(super) fn counts(&self) -> [u64; 3] {
        let mut counts = [0; 3];
        for entry in self.table.lock().jobs.values() {
            let group = match entry.state() {
                JobState::Unspecified | JobState::Pending => 0,
                JobState::Running => 1,
                JobState::Succeeded | JobState::Failed | JobState::Cancelled => 2,
            };
            counts[group] += 1;
        }
        counts
    }

    fn find(&self, key: &JobKey) -> Option<Arc<Entry>> {
        self.table.lock().jobs.get(key).cloned()
    }

    fn get_entry(&self, caller: &Caller, job_id: &str) -> Result<Arc<Entry>, JobError> {
        let found = self.find(&(caller.tenant().to_owned(), job_id.to_owned()));
        found.ok_or_else(|| JobError::NotFound { job: job_id.to_owned() })
    }

    /// One job of the caller's tenant.
    ///
    /// # Errors
    /// [`JobError::NotFound`].
    pub(super) fn get(&self, caller: &Caller, job_id: &str) -> Result<v1::Job, JobError> {
        Ok(self.get_entry(caller, job_id)?.job())
    }

    /// Follows a job of the caller's tenant; the channel closes when it is deleted.
    ///
    /// # Errors
    /// [`JobError::NotFound`].
    pub(super) fn follow(
        &self,
        caller: &Caller,
        job_id: &str,
    ) -> Result<tokio::sync::watch::Receiver<v1::Job>, JobError> {
        Ok(self.get_entry(caller, job_id)?.follow())
    }

    /// The jobs of the caller's tenant that fit, the newest first, each with its number. A job is copied
    /// when it is asked for.
    pub(super) fn list(
        &self,
        caller: &Caller,
        list: &JobList<'_>,
    ) -> impl Iterator<Item = (i64, v1::Job)> + use<> {
        let mut entries: Vec<Arc<Entry>> = {
            let table = self.table.lock();
            let from = (caller.tenant().to_owned(), String::new());
            let of_tenant = table.jobs.range(from..).map(|(_, entry)| entry);
            let of_tenant = of_tenant.take_while(|entry| entry.key.0 == caller.tenant());
            of_tenant.filter(|entry| entry.number < list.before).cloned().collect()
        };
        entries.sort_unstable_by_key(|entry| std::cmp::Reverse(entry.number));
        let is_wanted = |entry: &Arc<Entry>| {
            let of_state = list.states.is_empty() || list.states.contains(&entry.state());
            let of_map = list.map_id.is_empty() || entry.is_on(list.map_id);
            of_state && of_map
        };
        entries.retain(is_wanted);
        entries.into_iter().map(|entry| (entry.number, entry.job()))
    }

    /// Creates a job, or answers the one that is there.
    ///
    /// # Errors
    /// [`JobError`], [`ServiceError::RoleTooLow`], and those of the maps that it needs.
    pub(super) async fn create(
        self: &Arc<Self>,
        caller: &Caller,
        request: v1::CreateJobRequest,
    ) -> Result<v1::Job, ServiceError> {
        let asked = spec::read(&request, &self.context)?;
        caller.require(asked.role)?;
        let v1::CreateJobRequest { job_id, spec, priority } = request;
        let spec = spec.unwrap_or_default();
        let key = (caller.tenant().to_owned(), job_id);
        if let Some(job) = self.same(&key, &spec)? {
            return Ok(job);
        }
        let changes = spec::check(&spec, &asked, self, caller).await?;
        let jobs = Arc::clone(self);
        // A creation that has begun ends, whether its caller waits or not.
        to_end(async move {
            let _creating = jobs.creating.lock().await;
            if let Some(job) = jobs.same(&key, &spec)? {
                return Ok(job);
            }
            jobs.check_free(&changes)?;
            let account = jobs.account(&key.0);
            let pending = account.reserve(Resource::PendingJobs, 1)?;
            let size = new_bytes(&spec, None);
            let mut bytes = account.reserve(Resource::JobBytes, size)?;
            let taken = match &asked.upload {
                Some(id) => Some(jobs.take_upload(&key.0, id)?),
                None => None,
            };
            let (uid, upload) = match &taken {
                Some(waiting) => (waiting.uid, Some(waiting.upload.clone())),
                None => (random_uid(), None),
            };
            // The files are counted already, as an upload.
            bytes.count(new_bytes(&spec, upload.as_ref()));
            let job = v1::Job {
                job_id: key.1.clone(),
                spec: Some(spec),
                state: JobState::Pending.into(),
                create_time: Some(timestamp(jobs.now_ns())),
                priority,
                ..v1::Job::default()
            };
            let number = {
                let mut table = jobs.table.lock();
                table.last_number += 1;
                table.last_number
            };
            let held = JobReservations { bytes, pending: Some(pending) };
            let done = v1::JobResult::default();
            let entry = Entry::new((key, uid, number), job, done, changes, upload, held);
            let entry = Arc::new(entry);
            if let Err(error) = entry.write(&jobs.files, &entry.job(), &entry.done()).await {
                match taken {
                    Some(waiting) => jobs.give_back(waiting),
                    None => {
                        let removed =
                            entry::on_disk(&jobs.files, move |files| Ok(files.remove(&uid)?));
                        // A folder without a record is removed by the next start.
                        let _left = removed.await;
                    }
                }
                return Err(error.into());
            }
            drop(taken);
            let job = entry.job();
            jobs.put_pending(entry);
            Ok(job)
        })
        .await
    }

    /// The job that is there under this name, if it has this spec.
    fn same(&self, key: &JobKey, spec: &v1::JobSpec) -> Result<Option<v1::Job>, JobError> {
        let exists = || JobError::Exists { job: key.1.clone() };
        let table = self.table.lock();
        match table.jobs.get(key) {
            Some(entry) if entry.is_asked(spec) => Ok(Some(entry.job())),
            Some(_) => Err(exists()),
            None if table.taken.contains(key) => Err(exists()),
            None => Ok(None),
        }
    }

    /// Refuses a job that would change a map which another one changes.
    fn check_free(&self, changes: &[String]) -> Result<(), JobError> {
        let table = self.table.lock();
        let mut going = table.jobs.values().filter(|entry| !entry.is_ended());
        let busy = going.find_map(|entry| {
            let map = entry.changes.iter().find(|map| changes.contains(map))?;
            Some((map.clone(), entry.id().to_owned()))
        });
        match busy {
            Some((map, job)) => {
                let map = super::names::shown(&map).to_owned();
                Err(JobError::MapBusy { map, job })
            }
            None => Ok(()),
        }
    }

    /// Adds a job that waits for its turn.
    fn put_pending(&self, entry: Arc<Entry>) {
        let mut table = self.table.lock();
        table.queue.push(&Arc::from(entry.key.0.as_str()), ());
        table.jobs.insert(entry.key.clone(), entry);
        drop(table);
        self.wake.notify_one();
    }

    /// Asks a job to stop.
    ///
    /// # Errors
    /// [`JobError::NotFound`], [`JobError::Ended`], [`JobError::Unavailable`], [`JobError::Failed`].
    pub(super) async fn cancel(
        self: &Arc<Self>,
        caller: &Caller,
        job_id: &str,
    ) -> Result<v1::Job, ServiceError> {
        let entry = self.get_entry(caller, job_id)?;
        let jobs = Arc::clone(self);
        to_end(async move {
            let _exclusive = entry.exclusive().await;
            if entry.is_ended() {
                return Err(JobError::Ended { job: entry.id().to_owned() }.into());
            }
            if entry.state() == JobState::Pending {
                jobs.end(&entry, JobState::Cancelled, |job, _| job.cancel_requested = true).await?;
            } else {
                entry.change(&jobs.files, |job, _| job.cancel_requested = true).await?;
                // Where its changes are under way already, it ends as it would have.
                let _stops = entry.cancellation.cancel();
            }
            Ok(entry.job())
        })
        .await
    }

    /// Ends a job in `state` and gives back what it does not need any more. The caller has the job's
    /// exclusive lock.
    async fn end(
        &self,
        entry: &Arc<Entry>,
        state: JobState,
        change: impl FnOnce(&mut v1::Job, &mut v1::JobResult),
    ) -> Result<(), JobError> {
        let now_ns = self.now_ns();
        let retention = self.context.config.job_retention;
        let kept_ns = i64::try_from(retention.as_nanos()).unwrap_or(i64::MAX);
        entry
            .change(&self.files, |job, done| {
                change(job, done);
                job.set_state(state);
                if let Some(progress) = &mut job.progress {
                    progress.phase = "ended".to_owned();
                    progress.time_left_s = None;
                    progress.update_time = Some(timestamp(now_ns));
                }
                job.end_time = Some(timestamp(now_ns));
                job.expire_time = Some(timestamp(now_ns.saturating_add(kept_ns)));
                if state != JobState::Succeeded {
                    (job.cost_before, job.cost_after) = (None, None);
                }
                *done = v1::JobResult::default();
            })
            .await?;
        entry.forget_asked();
        self.drop_inputs(entry).await;
        self.meters.ended(entry.kind, state);
        self.wake.notify_one();
        Ok(())
    }

    /// Removes what an ended job needs no more: what was uploaded, parts of its work, and files that it
    /// did not finish.
    async fn drop_inputs(&self, entry: &Arc<Entry>) {
        let (uid, outputs) = (entry.uid, uploads::number(entry.files().len()));
        let removed = entry::on_disk(&self.files, move |files| {
            Ok(files.retain(&uid, |file| match file {
                JobFile::Record => true,
                JobFile::Output(number) => number < outputs,
                JobFile::Upload | JobFile::Input(_) | JobFile::Part(_) | JobFile::Checkpoint(_) => {
                    false
                }
            })?)
        });
        if let Err(error) = removed.await {
            tracing::warn!(job = entry.id(), %error, "files of an ended job could not be removed");
        }
        let kept = entry.kept_bytes();
        let mut held = entry.held();
        held.bytes.count(kept);
        held.pending = None;
    }

    /// Forgets a job that has ended.
    ///
    /// # Errors
    /// [`JobError::NotFound`], [`JobError::NotEnded`], [`JobError::Unavailable`],
    /// [`JobError::Failed`].
    pub(super) async fn delete(
        self: &Arc<Self>,
        caller: &Caller,
        job_id: &str,
    ) -> Result<(), ServiceError> {
        let entry = self.get_entry(caller, job_id)?;
        let jobs = Arc::clone(self);
        to_end(async move { Ok(jobs.forget(&entry).await?) }).await
    }

    /// Removes an ended job with its files.
    async fn forget(&self, entry: &Arc<Entry>) -> Result<(), JobError> {
        let _exclusive = entry.exclusive().await;
        let not_found = || JobError::NotFound { job: entry.id().to_owned() };
        let present = self.find(&entry.key).filter(|present| Arc::ptr_eq(present, entry));
        present.ok_or_else(not_found)?;
        if !entry.is_ended() {
            return Err(JobError::NotEnded { job: entry.id().to_owned() });
        }
        let uid = entry.uid;
        entry::on_disk(&self.files, move |files| Ok(files.remove(&uid)?)).await?;
        self.table.lock().jobs.remove(&entry.key);
        Ok(())
    }
}

/// Runs a change in a task of its own, so that it is finished if its caller stops waiting.
async fn to_end<T: Send + 'static>(
    change: impl Future<Output = Result<T, ServiceError>> + Send + 'static,
) -> Result<T, ServiceError> {
    match tokio::spawn(change.boxed()).await {
        Ok(outcome) => outcome,
        Err(error) if error.is_panic() => {
            Err(ServiceError::Panicked { message: format!("a change of a job: {error}") })
        }
        Err(_canceled) => Err(ServiceError::Draining),
    }
}
