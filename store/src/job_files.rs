//! The files of jobs: records, uploads and results, on disk with the care of maps, or in memory.
//!
//! A file is complete and durable, or it is not there. A file of a later version is distinguished from damage
//! and left untouched. What a record means is not known here. Everything blocks, briefly for records, as long
//! as its body takes for others.

use std::collections::BTreeMap;
use std::io::{self, BufRead, Write};
use std::sync::Arc;

use covis_solvers::bundle_adjustment::Checkpoint;

use super::StoreError;
use super::encoding::{
    EncodingError, decode_checkpoint, decode_job, decode_later_job, decode_upload,
    encode_checkpoint, encode_job, encode_upload,
};
use super::files::JobFolders;
use crate::sync::Mutex;

/// Names the files of a job or of an upload, independent of what clients call it.
pub type JobUid = [u8; 16];

/// A file of a job.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum JobFile {
    /// Its record.
    Record,
    /// What was uploaded for it; written last.
    Upload,
    /// A file that was uploaded.
    Input(u32),
    /// A file that it made.
    Output(u32),
    /// A part of its work that need not be done again.
    Part(u32),
    /// A solve on its way.
    Checkpoint(u32),
}

/// What is there of a job or an upload.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct JobFolder {
    /// Its name.
    pub uid: JobUid,
    /// Its files.
    pub files: Vec<JobFile>,
}

/// A job as it is kept.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct JobRecord {
    /// The tenant; empty for the default one.
    pub tenant: String,
    /// The job's name within the tenant.
    pub job_id: String,
    /// Counts the jobs in the order of their creation.
    pub number: i64,
    /// The job, in the encoding of its owner.
    pub job: Vec<u8>,
    /// What it has finished of its work, in the encoding of its owner.
    pub done: Vec<u8>,
}

/// Files that were uploaded for a job.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct JobUpload {
    /// The tenant; empty for the default one.
    pub tenant: String,
    /// When the upload ended, Unix time in seconds.
    pub create_time_s: i64,
    /// Path and length in bytes of each file; the first one is [`JobFile::Input`] 0.
    pub files: Vec<(String, u64)>,
}

impl JobUpload {
    /// Bytes of all files.
    pub fn bytes(&self) -> u64 {
        self.files.iter().map(|(_, bytes)| bytes).sum()
    }
}

/// Why a file of a job cannot be read.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[allow(missing_docs, reason = "the messages say what the fields are")]
pub enum JobFileError {
    /// It is not there.
    #[error("the file is not there")]
    Missing,
    /// The disk failed, which says nothing about the file.
    #[error(transparent)]
    Store(#[from] StoreError),
    /// A later version wrote it; it is left as it is.
    #[error("{file} was written by a later version: {reason}")]
    Later { file: String, reason: String },
    /// It does not hold what was written.
    #[error("{file} is damaged: {reason}")]
    Damaged { file: String, reason: String },
}

/// A record that was read.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum FoundRecord {
    /// A job.
    Job(JobRecord),
    /// A job that a later version wrote: only whose it is and what it is called is known.
    Later {
        /// The tenant.
        tenant: String,
        /// The job's name.
        job_id: String,
    },
}

/// The files of all jobs of a server.
#[derive(Debug)]
pub struct JobFiles(Storage);

/// The bytes of each file.
type InMemory = BTreeMap<(JobUid, JobFile), Arc<[u8]>>;

#[derive(Debug)]
enum Storage {
    Disk(JobFolders),
    Memory(Mutex<InMemory>),
}

impl JobFiles {
    /// In memory: gone at the end.
    #[must_use]
    pub fn in_memory() -> Self {
        Self(Storage::Memory(Mutex::default()))
    }

    /// In a data directory.
    pub(super) fn on_disk(folders: JobFolders) -> Self {
        Self(Storage::Disk(folders))
    }

    /// Whether they survive the process.
    pub fn is_durable(&self) -> bool {
        matches!(self.0, Storage::Disk(_))
    }

    /// What is there of each job and upload. Removes leftovers.
    ///
    /// # Errors
    /// [`StoreError::File`].
    pub fn list(&self) -> Result<Vec<JobFolder>, StoreError> {
        match &self.0 {
            Storage::Disk(folders) => folders.list(),
            Storage::Memory(_) => Ok(Vec::new()),
        }
    }

    /// Writes the record of a job; returns its size in bytes.
    ///
    /// # Errors
    /// [`StoreError::File`]; the record before it stays.
    pub fn write_record(&self, uid: &JobUid, record: &JobRecord) -> Result<u64, StoreError> {
        let bytes = encode_job(record);
        self.write(uid, JobFile::Record, |out| out.write_all(&bytes))
    }

    /// Writes a checkpoint of solve `number`; returns its size in bytes.
    ///
    /// # Errors
    /// [`StoreError::File`]; the checkpoint before it stays.
    pub fn write_checkpoint(
        &self,
        uid: &JobUid,
        number: u32,
        checkpoint: &Checkpoint,
    ) -> Result<u64, StoreError> {
        let bytes = encode_checkpoint(checkpoint);
        self.write(uid, JobFile::Checkpoint(number), |out| out.write_all(&bytes))
    }

    /// The last checkpoint of solve `number`.
    ///
    /// # Errors
    /// [`JobFileError`].
    pub fn read_checkpoint(&self, uid: &JobUid, number: u32) -> Result<Checkpoint, JobFileError> {
        let bytes = self.bytes(uid, JobFile::Checkpoint(number))?;
        decode_checkpoint(&bytes).map_err(|error| unreadable(uid, &error))
    }

    /// A whole file.
    ///
    /// # Errors
    /// [`JobFileError`].
    pub fn bytes(&self, uid: &JobUid, file: JobFile) -> Result<Vec<u8>, JobFileError> {
        self.read(uid, file, |body| {
            let mut bytes = Vec::new();
            body.read_to_end(&mut bytes)?;
            Ok(bytes)
        })
    }

    /// Ends an upload: with this file it is complete.
    ///
    /// # Errors
    /// [`StoreError::File`].
    pub fn write_upload(&self, uid: &JobUid, upload: &JobUpload) -> Result<u64, StoreError> {
        let bytes = encode_upload(upload);
        self.write(uid, JobFile::Upload, |out| out.write_all(&bytes))
    }

    /// What was uploaded.
    ///
    /// # Errors
    /// [`JobFileError`].
    pub fn read_upload(&self, uid: &JobUid) -> Result<JobUpload, JobFileError> {
        decode_upload(&self.bytes(uid, JobFile::Upload)?).map_err(|error| unreadable(uid, &error))
    }

    /// Reads the record of a job.
    ///
    /// # Errors
    /// [`JobFileError`].
    pub fn read_record(&self, uid: &JobUid) -> Result<FoundRecord, JobFileError> {
        let bytes = self.bytes(uid, JobFile::Record)?;
        match decode_job(&bytes) {
            Ok(record) => Ok(FoundRecord::Job(record)),
            Err(EncodingError::Later) => match decode_later_job(&bytes) {
                Ok((tenant, job_id)) => Ok(FoundRecord::Later { tenant, job_id }),
                Err(error) => Err(unreadable(uid, &error)),
            },
            Err(error) => Err(unreadable(uid, &error)),
        }
    }

    /// Writes a file whose content `body` makes; returns its size in bytes. Where `body` fails there is
    /// no file.
    ///
    /// # Errors
    /// [`StoreError::File`].
    pub fn write(
        &self,
        uid: &JobUid,
        file: JobFile,
        body: impl FnOnce(&mut dyn Write) -> io::Result<()>,
    ) -> Result<u64, StoreError> {
        match &self.0 {
            Storage::Disk(folders) => folders.write(uid, file, body),
            Storage::Memory(files) => {
                let mut bytes = Vec::new();
                body(&mut bytes).map_err(|error| StoreError::File {
                    action: "cannot write",
                    path: "a file of a job".to_owned(),
                    message: error.to_string(),
                    passes: false,
                })?;
                let size = bytes.len() as u64;
                files.lock().insert((*uid, file), bytes.into());
                Ok(size)
            }
        }
    }

    /// Reads a file. What `read` returns is the content only if this succeeds: the checksum is at the
    /// file's end.
    ///
    /// # Errors
    /// [`JobFileError`].
    pub fn read<T>(
        &self,
        uid: &JobUid,
        file: JobFile,
        read: impl FnOnce(&mut dyn BufRead) -> io::Result<T>,
    ) -> Result<T, JobFileError> {
        match &self.0 {
            Storage::Disk(folders) => folders.read(uid, file, read),
            Storage::Memory(files) => {
                let bytes =
                    files.lock().get(&(*uid, file)).cloned().ok_or(JobFileError::Missing)?;
                read(&mut &bytes[..]).map_err(|error| JobFileError::Damaged {
                    file: "a file of a job".to_owned(),
                    reason: error.to_string(),
                })
            }
        }
    }

    /// Removes the files of a job but those that `keep` says.
    ///
    /// # Errors
    /// [`StoreError::File`]; some may be gone.
    pub fn retain(&self, uid: &JobUid, keep: impl Fn(JobFile) -> bool) -> Result<(), StoreError> {
        match &self.0 {
            Storage::Disk(folders) => folders.retain(uid, keep),
            Storage::Memory(files) => {
                files.lock().retain(|(other, file), _| other != uid || keep(*file));
                Ok(())
            }
        }
    }

    /// Removes a job or an upload with all its files.
    ///
    /// # Errors
    /// [`StoreError::File`]: it is as it was.
    pub fn remove(&self, uid: &JobUid) -> Result<(), StoreError> {
        match &self.0 {
            Storage::Disk(folders) => folders.remove(uid),
            Storage::Memory(files) => {
                files.lock().retain(|(other, _), _| other != uid);
                Ok(())
            }
        }
    }
}

fn unreadable(uid: &JobUid, error: &EncodingError) -> JobFileError {
    let folder: String = uid.iter().map(|byte| format!("{byte:02x}")).collect();
    JobFileError::Damaged { file: format!("jobs/{folder}"), reason: error.to_string() }
}
