//! Uploads: files that clients send for a job, kept until a job takes them or they expire.
//!
//! A file goes to the disk while it comes, so that no upload is in memory. An upload exists once its
//! last file is complete and not before: one that is cut off leaves nothing. Room in the account of the
//! tenant is reserved before bytes are taken. The bytes mean nothing here.

use std::io;
use std::sync::Arc;

use tokio::sync::mpsc;
use tonic::Streaming;

use super::entry::on_disk;
use super::run::REPORT;
use super::{Jobs, Table};
use crate::map::Reason;
use crate::service::access::Caller;
use crate::service::convert::time::timestamp;
use crate::service::convert::{count, small};
use crate::service::engine::{Reservation, Resource};
use crate::service::error::ServiceError;
use crate::service::job_error::JobError;
use crate::service::random::random_uid;
use crate::service::upload::{Chunk, MAX_FILES, Upload, sent_before};
use crate::store::{JobFile, JobFiles, JobUid, JobUpload};
use crate::wire::v1;

/// Bytes that an upload counts besides its files: its folder, and the list of its files.
pub(super) const UPLOAD_BYTES: u64 = 8 << 10;
/// Bytes that a file of a job counts besides its content: an entry of a folder, a block of the disk that is
/// not full, head and checksum, and a path of 1 KiB in memory, in the list of the upload, and in the
/// record of the job. 1,024 empty files with such paths take 5.1 MiB of the disk.
pub(super) const FILE_BYTES: u64 = 8 << 10;
/// How long an upload waits for its job, seconds.
const LIFETIME_S: i64 = 24 * 3600;
/// Chunks that wait for the disk.
const QUEUE: usize = 2;

/// An upload that no job has taken.
pub(super) struct Waiting {
    pub(super) uid: JobUid,
    pub(super) upload: JobUpload,
    /// Its bytes in the account of the tenant.
    pub(super) _held: Reservation,
    /// Its place among the tenant's uploads.
    pub(super) _place: Reservation,
}

/// Bytes that an upload counts.
pub(super) fn counted(upload: &JobUpload) -> u64 {
    counted_with(upload.files.len(), upload.bytes())
}

fn counted_with(files: usize, content: u64) -> u64 {
    (UPLOAD_BYTES + FILE_BYTES * files as u64).saturating_add(content)
}

impl Waiting {
    /// When it is dropped, Unix time in seconds.
    pub(super) fn expires(&self) -> i64 {
        self.upload.create_time_s.saturating_add(LIFETIME_S)
    }
}

/// Whether a part of a path is a plain name, on every system.
pub(super) fn is_plain(part: &str) -> bool {
    !matches!(part, "" | "." | "..") && !part.contains(['\\', ':'])
}

/// Refuses the path of a file that cannot lie in one folder with the files before it and with the report:
/// solutions have the paths of their problems.
fn check_path(path: &str, files: &[(String, u64)]) -> Result<(), ServiceError> {
    let refused = |reason, text: &str| {
        Err(ServiceError::field("chunk.path", reason, format!("{path:?}: {text}")))
    };
    if !path.split('/').all(is_plain) {
        let text = r#"a path is relative, without "..", ".", empty parts, "\" and ":""#;
        return refused(Reason::OutOfRange, text);
    }
    let is_below = |path: &str, folder: &str| {
        path.strip_prefix(folder).is_some_and(|rest| rest.starts_with('/'))
    };
    if path == REPORT || is_below(path, REPORT) {
        return refused(Reason::OutOfRange, "this is the path of the job's report");
    }
    let meets = |(other, _): &&(String, u64)| is_below(path, other) || is_below(other, path);
    match files.iter().find(meets) {
        Some((other, _)) => {
            let text = format!("{other:?} cannot be a file and a folder");
            refused(Reason::Inconsistent, &text)
        }
        None => Ok(()),
    }
}

/// The number of a file from how many there are.
pub(super) fn number(index: usize) -> u32 {
    u32::try_from(index).unwrap_or(u32::MAX)
}

/// What clients call an upload.
fn id_of(uid: &JobUid) -> String {
    uid.iter().map(|byte| format!("{byte:02x}")).collect()
}

/// Removes the files of an upload that does not reach its end.
struct Partial {
    files: Arc<JobFiles>,
    uid: JobUid,
    is_whole: bool,
}

impl Drop for Partial {
    fn drop(&mut self) {
        if self.is_whole {
            return;
        }
        let (files, uid) = (Arc::clone(&self.files), self.uid);
        let remove = move || {
            // The next start removes what is left here.
            if let Err(error) = files.remove(&uid) {
                tracing::warn!(%error, "an upload that was cut off could not be removed");
            }
        };
        if !self.files.is_durable() {
            return remove();
        }
        match tokio::runtime::Handle::try_current() {
            Ok(runtime) => drop(runtime.spawn_blocking(remove)),
            Err(_ended) => remove(),
        }
    }
}

/// A file that is being written: its chunks, and where the writer answers.
struct Writing {
    path: String,
    bytes: u64,
    chunks: mpsc::Sender<Option<Vec<u8>>>,
    written: tokio::task::JoinHandle<Result<u64, JobError>>,
}

impl Writing {
    fn begin(files: &Arc<JobFiles>, uid: JobUid, number: u32, path: String) -> Self {
        let (chunks, mut queue) = mpsc::channel::<Option<Vec<u8>>>(QUEUE);
        let files = Arc::clone(files);
        let written = tokio::task::spawn_blocking(move || {
            let written = files.write(&uid, JobFile::Input(number), |out| {
                loop {
                    match queue.blocking_recv() {
                        Some(Some(chunk)) => out.write_all(&chunk)?,
                        Some(None) => return Ok(()),
                        // The upload ended within the file.
                        None => return Err(io::ErrorKind::UnexpectedEof.into()),
                    }
                }
            });
            Ok(written?)
        });
        Self { path, bytes: 0, chunks, written }
    }

    /// Gives the writer a chunk, or the end. A writer that is gone says why in [`Writing::end`].
    async fn put(&mut self, chunk: Option<Vec<u8>>) -> bool {
        self.bytes += chunk.as_ref().map_or(0, Vec::len) as u64;
        self.chunks.send(chunk).await.is_ok()
    }

    async fn end(self) -> Result<(String, u64), JobError> {
        let Self { path, bytes, chunks, written } = self;
        drop(chunks);
        let ended = written.await;
        let cause = "the writing did not end".to_owned();
        ended.map_err(|_lost| JobError::Failed { cause })??;
        Ok((path, bytes))
    }
}

impl Jobs {
    /// Takes the files of a client.
    ///
    /// # Errors
    /// INVALID_ARGUMENT, RESOURCE_EXHAUSTED; nothing is kept.
    pub(in crate::service) async fn upload(
        &self,
        caller: &Caller,
        inbound: Streaming<v1::UploadJobFilesRequest>,
    ) -> Result<v1::UploadJobFilesResponse, ServiceError> {
        let mut upload = Upload::new(&self.context, inbound);
        let header = upload.header().await?;
        let Ok(announced) = u64::try_from(header.size_bytes) else {
            let text = format!("{} is below 0", header.size_bytes);
            return Err(ServiceError::field("header.size_bytes", Reason::OutOfRange, text));
        };
        let account = self.account(caller.tenant());
        let place = account.reserve(Resource::Uploads, 1)?;
        let mut held = account.reserve(Resource::JobBytes, counted_with(0, announced))?;
        let uid = random_uid();
        let mut partial = Partial { files: Arc::clone(&self.files), uid, is_whole: false };
        let mut files: Vec<(String, u64)> = Vec::new();
        let (mut bytes, mut open) = (0_u64, None::<Writing>);
        while let Some(Chunk { path, data, begins_file, ends_file }) = upload.chunk().await? {
            if begins_file {
                if files.iter().any(|(other, _)| *other == path) {
                    return Err(sent_before());
                }
                check_path(&path, &files)?;
                if files.len() == MAX_FILES {
                    let maximum = count(MAX_FILES);
                    return Err(ServiceError::ServerLimit { limit: "max_upload_files", maximum });
                }
            }
            bytes = bytes.saturating_add(data.len() as u64);
            let begun = files.len() + 1;
            let needed = counted_with(begun, bytes.max(announced));
            if needed > held.amount() {
                held.resize(needed)?;
            }
            let mut file = match open.take() {
                Some(file) => file,
                None => Writing::begin(&self.files, uid, number(files.len()), path),
            };
            let mut goes_on = file.put(Some(data)).await;
            if ends_file && goes_on {
                goes_on = file.put(None).await;
            }
            if ends_file || !goes_on {
                files.push(file.end().await?);
            } else {
                open = Some(file);
            }
        }
        if files.is_empty() {
            let description = "an upload has at least one file";
            return Err(ServiceError::Protocol { field: "chunk", description });
        }
        held.resize(counted_with(files.len(), bytes))?;
        let create_time_s = self.context.config.clock.now();
        let upload = JobUpload { tenant: caller.tenant().to_owned(), create_time_s, files };
        let kept = upload.clone();
        on_disk(&self.files, move |files| Ok(files.write_upload(&uid, &kept)?)).await?;
        partial.is_whole = true;
        let file_count = small(upload.files.len());
        let waiting = Waiting { uid, upload, _held: held, _place: place };
        let expire_time = Some(timestamp(waiting.expires().saturating_mul(1_000_000_000)));
        self.give_back(waiting);
        Ok(v1::UploadJobFilesResponse {
            upload_id: id_of(&uid),
            file_count,
            size_bytes: i64::try_from(bytes).unwrap_or(i64::MAX),
            expire_time,
        })
    }

    /// Refuses an upload that the tenant does not have.
    ///
    /// # Errors
    /// [`JobError::UploadNotFound`].
    pub(super) fn check_upload(&self, tenant: &str, id: &str) -> Result<(), JobError> {
        let is_there = self.find_upload(&self.table.lock(), tenant, id).is_some();
        is_there.then_some(()).ok_or_else(|| JobError::UploadNotFound { upload: id.to_owned() })
    }

    /// The upload of a tenant that has not expired.
    fn find_upload(&self, table: &Table, tenant: &str, id: &str) -> Option<JobUid> {
        let now = self.context.config.clock.now();
        let mut waiting = table.uploads.values();
        let found = waiting.find(|waiting| {
            waiting.upload.tenant == tenant && id_of(&waiting.uid) == id && waiting.expires() > now
        });
        found.map(|waiting| waiting.uid)
    }

    /// Takes an upload of a tenant for a job.
    ///
    /// # Errors
    /// [`JobError::UploadNotFound`].
    pub(super) fn take_upload(&self, tenant: &str, id: &str) -> Result<Waiting, JobError> {
        let mut table = self.table.lock();
        let uid = self.find_upload(&table, tenant, id);
        let taken = uid.and_then(|uid| table.uploads.remove(&uid));
        taken.ok_or_else(|| JobError::UploadNotFound { upload: id.to_owned() })
    }

    /// Keeps an upload for a job to come.
    pub(super) fn give_back(&self, waiting: Waiting) {
        self.table.lock().uploads.insert(waiting.uid, waiting);
        self.wake.notify_one();
    }
}
