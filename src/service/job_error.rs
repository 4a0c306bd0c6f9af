//! Why a call on a job ends early. `status.rs` assigns the codes.
//!
//! Paths of the server are for its log alone: no error has one.

use crate::store::{JobFileError, StoreError};

/// A refused call on a job.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub(in crate::service) enum JobError {
    /// There is no such job.
    #[error("job {job:?} does not exist")]
    NotFound { job: String },
    /// A job with this name is there, with another spec.
    #[error("job {job:?} exists already, with another spec")]
    Exists { job: String },
    /// The job has ended.
    #[error("job {job:?} has ended")]
    Ended { job: String },
    /// The job has not ended.
    #[error("job {job:?} has not ended")]
    NotEnded { job: String },
    /// A job that has not ended changes the map.
    #[error("job {job:?} changes map {map:?} and has not ended")]
    MapBusy { map: String, job: String },
    /// There is no such upload, or a job has taken it, or it has expired.
    #[error("upload {upload:?} does not exist: an upload expires, and one job can use it")]
    UploadNotFound { upload: String },
    /// The job made no such file.
    #[error("job {job:?} made no file {path:?}")]
    FileNotFound { job: String, path: String },
    /// There is no space, no descriptor or no memory just now; nothing was changed.
    #[error("the store is out of resources for now: {cause}")]
    Unavailable {
        /// What the system said, without paths of the server.
        cause: String,
    },
    /// The disk failed the call, or a file does not hold what it should. The log names the file.
    #[error("the files of a job: {cause}")]
    Failed {
        /// What is wrong, without paths of the server.
        cause: String,
    },
    /// A problem file cannot be read.
    #[error("{text}")]
    BadFile {
        /// What is wrong, with the file's path as the client gave it.
        text: String,
    },
}

impl From<StoreError> for JobError {
    fn from(error: StoreError) -> Self {
        tracing::warn!(%error, "the files of a job");
        if let StoreError::File { action, message, passes, .. } = error {
            let cause = format!("{action} a file of a job: {message}");
            return if passes { Self::Unavailable { cause } } else { Self::Failed { cause } };
        }
        Self::Failed { cause: "the store failed".to_owned() }
    }
}

impl From<JobFileError> for JobError {
    fn from(error: JobFileError) -> Self {
        let reason = match error {
            JobFileError::Store(error) => return error.into(),
            JobFileError::Missing => "a file is missing".to_owned(),
            JobFileError::Later { file, reason } => {
                tracing::warn!(file, reason, "a file of a job was written by a later version");
                format!("written by a later version: {reason}")
            }
            JobFileError::Damaged { file, reason } => {
                tracing::error!(file, reason, "a file of a job is damaged");
                format!("damaged: {reason}")
            }
        };
        Self::Failed { cause: reason }
    }
}
