//! The record of a job, and what was uploaded for it, as bytes. What the parts of a record mean is known
//! by their owner.

use prost::Message;

use super::{EncodingError, decode, v1};
use crate::store::job_files::{JobRecord, JobUpload};

/// The bytes of a record.
pub(in crate::store) fn encode_job(record: &JobRecord) -> Vec<u8> {
    let JobRecord { tenant, job_id, number, job, done } = record.clone();
    v1::JobRecord { tenant, job_id, number, job, done }.encode_to_vec()
}

/// The record of `bytes`.
///
/// # Errors
/// [`EncodingError`] where they are no record, or one of a later version.
pub(in crate::store) fn decode_job(bytes: &[u8]) -> Result<JobRecord, EncodingError> {
    let v1::JobRecord { tenant, job_id, number, job, done } = decode(bytes)?;
    Ok(JobRecord { tenant, job_id, number, job, done })
}

/// Tenant and name of the job in a record of any later version: its fields 1 and 2 stay that forever.
pub(in crate::store) fn decode_later_job(bytes: &[u8]) -> Result<(String, String), EncodingError> {
    let record = v1::JobRecord::decode(bytes);
    let record = record.map_err(|error| EncodingError::Message(error.to_string()))?;
    Ok((record.tenant, record.job_id))
}

/// The bytes of an upload's description.
pub(in crate::store) fn encode_upload(upload: &JobUpload) -> Vec<u8> {
    let JobUpload { tenant, create_time_s, files } = upload.clone();
    let files = files.into_iter().map(|(path, size_bytes)| v1::JobUploadFile { path, size_bytes });
    v1::JobUpload { tenant, create_time_s, files: files.collect() }.encode_to_vec()
}

/// The description of an upload in `bytes`.
///
/// # Errors
/// As [`decode_job`].
pub(in crate::store) fn decode_upload(bytes: &[u8]) -> Result<JobUpload, EncodingError> {
    let v1::JobUpload { tenant, create_time_s, files } = decode(bytes)?;
    let files = files.into_iter().map(|file| (file.path, file.size_bytes)).collect();
    Ok(JobUpload { tenant, create_time_s, files })
}
