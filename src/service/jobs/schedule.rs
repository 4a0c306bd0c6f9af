//! Which job begins next, what a restart finds, and what has expired.
//!
//! Tenants take turns by the time that their jobs ran ([`FairQueue`](crate::service::engine)); of a
//! tenant's waiting jobs the one with the highest priority begins, of equals the oldest. As many run at
//! once as the solver pool has threads; their solves wait for those as all solves do. When the server
//! drains, what runs is left as it is on disk, and begins again after the restart. It runs no job itself.

use std::cmp::Reverse;
use std::sync::Arc;
use std::sync::atomic::Ordering;
use std::time::Instant;

use prost::Message;
use tokio::task::JoinSet;

use super::answer;
use super::entry::{Entry, JobReservations, files_bytes, is_ended, new_bytes, on_disk};
use super::uploads::{FILE_BYTES, Waiting, counted};
use super::{Jobs, run, spec};
use crate::service::access::Caller;
use crate::service::engine::{Resource, Turn};
use crate::service::job_error::JobError;
use crate::store::{FoundRecord, JobFile, JobFileError, JobFolder, JobRecord};
use crate::wire::v1;
use v1::JobState;

/// Runs jobs until the server drains; returns when none runs any more.
pub(in crate::service) async fn serve(jobs: Arc<Jobs>) {
    let mut running: JoinSet<Arc<Entry>> = JoinSet::new();
    let mut entries: Vec<Arc<Entry>> = Vec::new();
    loop {
        while let Some((turn, entry)) = jobs.next() {
            entries.push(Arc::clone(&entry));
            let jobs = Arc::clone(&jobs);
            running.spawn(async move {
                let begin = Instant::now();
                run::run(&jobs, &entry).await;
                let took_ns = u64::try_from(begin.elapsed().as_nanos()).unwrap_or(u64::MAX);
                jobs.table.lock().queue.ended(&turn, took_ns);
                entry
            });
        }
        let expires = jobs.next_expiry();
        let expired = async {
            match expires {
                Some(time) => jobs.context.config.clock.reached(time).await,
                None => std::future::pending().await,
            }
        };
        tokio::select! {
            biased;
            () = jobs.context.drained() => break,
            Some(ended) = running.join_next() => {
                // A panic inside a job is caught there.
                if let Ok(ended) = ended {
                    entries.retain(|entry| !Arc::ptr_eq(entry, &ended));
                }
            }
            () = jobs.wake.notified() => {}
            () = expired => jobs.drop_expired().await,
        }
    }
    jobs.stopping.store(true, Ordering::Release);
    for entry in &entries {
        // What makes its changes already ends first.
        let _stops = entry.cancellation.cancel();
    }
    while running.join_next().await.is_some() {}
}

impl Jobs {
    /// The next job, if one waits and there is room for it.
    fn next(&self) -> Option<(Turn, Arc<Entry>)> {
        let mut table = self.table.lock();
        loop {
            let (turn, ()) = table.queue.next(|_, _, ()| true, |_, ()| true)?;
            let waiting = table
                .jobs
                .values()
                .filter(|entry| *entry.key.0 == **turn.tenant() && entry.is_waiting());
            let best = waiting.max_by_key(|entry| (entry.priority(), Reverse(entry.number)));
            match best {
                Some(entry) => {
                    entry.begin();
                    return Some((turn, Arc::clone(entry)));
                }
                // The job was canceled while it waited.
                None => table.queue.ended(&turn, 0),
            }
        }
    }

    /// When the next job or upload is to be dropped, Unix time in seconds.
    fn next_expiry(&self) -> Option<i64> {
        let table = self.table.lock();
        let jobs = table.jobs.values().filter_map(|entry| entry.expires());
        jobs.chain(table.uploads.values().map(Waiting::expires)).min()
    }

    /// Drops what has expired.
    async fn drop_expired(&self) {
        let now = self.context.config.clock.now();
        let (jobs, uploads) = {
            let mut table = self.table.lock();
            let is_due = |entry: &&Arc<Entry>| entry.expires().is_some_and(|time| time <= now);
            let jobs: Vec<_> = table.jobs.values().filter(is_due).cloned().collect();
            let due: Vec<_> = table.uploads.extract_if(.., |_, w| w.expires() <= now).collect();
            (jobs, due)
        };
        for entry in jobs {
            if let Err(error) = self.forget(&entry).await {
                tracing::warn!(job = entry.id(), %error, "an expired job could not be removed");
                entry.keep_longer();
            }
        }
        for (uid, waiting) in uploads {
            let removed = on_disk(&self.files, move |files| Ok(files.remove(&uid)?)).await;
            if let Err(error) = removed {
                // The next start finds and drops it.
                tracing::warn!(%error, "an expired upload could not be removed");
            }
            drop(waiting);
        }
    }

    /// Reads what is on disk; jobs that have not ended wait for their turn.
    ///
    /// # Errors
    /// [`JobError`] where the folder of jobs cannot be read.
    pub(in crate::service) async fn load(&self) -> Result<(), JobError> {
        let folders = on_disk(&self.files, |files| Ok(files.list()?)).await?;
        let mut entries = Vec::new();
        for folder in folders {
            // One at a time: a record as it is read takes many times what an ended job keeps of it.
            match on_disk(&self.files, move |files| Ok(read(files, folder))).await? {
                FolderContent::Job(job) => entries.push(self.restored(*job)),
                FolderContent::Upload(folder, upload) => {
                    let account = self.account(&upload.tenant);
                    let held = account.reserve_existing(Resource::JobBytes, counted(&upload));
                    let place = account.reserve_existing(Resource::Uploads, 1);
                    self.give_back(Waiting { uid: folder.uid, upload, _held: held, _place: place });
                }
                FolderContent::Later(key) => {
                    self.table.lock().taken.insert(key);
                }
                FolderContent::Nothing => {}
            }
        }
        entries.sort_unstable_by_key(|entry| entry.number);
        for entry in entries {
            let is_waiting = !entry.is_ended();
            if let Some(other) = self.insert(&entry) {
                // Only a copy of a folder has the name of another one.
                tracing::error!(job = other.id(), "two folders have this job: the newer counts");
            }
            if is_waiting {
                self.put_pending(entry);
            } else {
                // The server may have ended between the record and this.
                self.drop_inputs(&entry).await;
            }
        }
        Ok(())
    }

    /// Adds a job that was found; returns another one of that name.
    fn insert(&self, entry: &Arc<Entry>) -> Option<Arc<Entry>> {
        let mut table = self.table.lock();
        table.last_number = table.last_number.max(entry.number);
        table.jobs.insert(entry.key.clone(), Arc::clone(entry))
    }

    /// Resumes a job after a restart: one that was running waits for its turn again.
    fn restored(&self, job: OnDisk) -> Arc<Entry> {
        let OnDisk { folder, record, mut job, done, upload, part_bytes } = job;
        let caller = Caller::of_tenant(&record.tenant);
        let account = self.account(&record.tenant);
        let spec = job.spec.clone().unwrap_or_default();
        if job.state() == JobState::Running {
            // It waits for its turn again.
            job.set_state(JobState::Pending);
        }
        let has_ended = is_ended(job.state());
        let size = new_bytes(&spec, upload.as_ref()) + files_bytes(&job.files) + part_bytes;
        let done = answer::done_within_bounds(done);
        let held = JobReservations {
            bytes: account.reserve_existing(Resource::JobBytes, size),
            pending: (!has_ended).then(|| account.reserve_existing(Resource::PendingJobs, 1)),
        };
        let changes =
            if has_ended { Vec::new() } else { spec::changed_maps(&spec, &self.context, &caller) };
        let key = (record.tenant, record.job_id);
        let identity = (key, folder.uid, record.number);
        Arc::new(Entry::new(identity, job, done, changes, upload, held))
    }
}

/// What a folder holds.
enum FolderContent {
    Job(Box<OnDisk>),
    Upload(JobFolder, crate::store::JobUpload),
    /// A job that a later version wrote.
    Later((String, String)),
    Nothing,
}

/// A job as it is on disk.
struct OnDisk {
    folder: JobFolder,
    record: JobRecord,
    job: v1::Job,
    done: v1::JobResult,
    upload: Option<crate::store::JobUpload>,
    /// Bytes of the work that need not be done again.
    part_bytes: u64,
}

/// Reads a folder. What cannot be read is reported and left as it is.
fn read(files: &crate::store::JobFiles, folder: JobFolder) -> FolderContent {
    let tell = |error: &JobFileError| {
        tracing::error!(%error, "a job or an upload cannot be read, it is left as it is");
    };
    let has = |file| folder.files.contains(&file);
    let upload = if has(JobFile::Upload) {
        match files.read_upload(&folder.uid) {
            Ok(upload) => Some(upload),
            Err(error) => {
                tell(&error);
                None
            }
        }
    } else {
        None
    };
    if !has(JobFile::Record) {
        return upload
            .map_or(FolderContent::Nothing, |upload| FolderContent::Upload(folder, upload));
    }
    let record = match files.read_record(&folder.uid) {
        Ok(FoundRecord::Job(record)) => record,
        Ok(FoundRecord::Later { tenant, job_id }) => {
            tracing::error!(job_id, "a later version wrote this job, it is left as it is");
            return FolderContent::Later((tenant, job_id));
        }
        Err(error) => {
            tell(&error);
            return FolderContent::Nothing;
        }
    };
    let job = v1::Job::decode(&*record.job).ok();
    let done = v1::JobResult::decode(&*record.done).ok();
    // A kind that is not known here decodes to no spec at all, and what is unknown is lost.
    let known = job.zip(done).filter(|(job, done)| {
        let has_spec = job.spec.as_ref().is_some_and(|spec| spec.spec.is_some());
        let is_whole =
            job.encoded_len() == record.job.len() && done.encoded_len() == record.done.len();
        has_spec && is_whole && job.job_id == record.job_id
    });
    let Some((job, done)) = known else {
        let job = &record.job_id;
        tracing::error!(job, "a later version wrote this job, it is left as it is");
        return FolderContent::Later((record.tenant, record.job_id));
    };
    let part_bytes = part_bytes(files, &folder);
    FolderContent::Job(Box::new(OnDisk { folder, record, job, done, upload, part_bytes }))
}

/// Bytes that the parts of a job count; one that cannot be read is made again. A checkpoint counts when
/// the next one replaces it.
fn part_bytes(files: &crate::store::JobFiles, folder: &JobFolder) -> u64 {
    let parts = folder.files.iter().filter(|file| matches!(file, JobFile::Part(_)));
    let size = |file: &JobFile| {
        let read = files.read(&folder.uid, *file, |body| std::io::copy(body, &mut std::io::sink()));
        FILE_BYTES + read.unwrap_or(0)
    };
    parts.map(size).sum()
}
