//! `DownloadJobFiles`: the files that a job made, read from the disk as their reader takes them.
//!
//! The last piece of a file is sent once its checksum was verified, so that a file that is whole for its
//! reader is what the job wrote. No job is changed here.

use std::io::Read;
use std::sync::Arc;

use tokio::sync::mpsc;

use super::Jobs;
use crate::service::access::Caller;
use crate::service::context::Sink;
use crate::service::convert::count;
use crate::service::engine::Resource;
use crate::service::error::ServiceError;
use crate::service::export::CHUNK_BYTES;
use crate::service::job_error::JobError;
use crate::store::{JobFile, JobFileError};
use crate::wire::v1;
use v1::download_job_files_response::Content;

use super::uploads::number;

/// Streams the files of a job of the caller's tenant, or the one that is named `path`.
///
/// # Errors
/// [`JobError::NotFound`], [`JobError::FileNotFound`], [`JobError::Failed`], and RESOURCE_EXHAUSTED where too
/// much is being read.
pub(in crate::service) async fn download(
    jobs: &Jobs,
    caller: &Caller,
    job_id: &str,
    path: &str,
    sink: &Sink<v1::DownloadJobFilesResponse>,
) -> Result<(), ServiceError> {
    let entry = jobs.get_entry(caller, job_id)?;
    let all = entry.files();
    let wanted: Vec<(usize, v1::JobFile)> =
        all.into_iter().enumerate().filter(|(_, f)| path.is_empty() || f.path == path).collect();
    if wanted.is_empty() && !path.is_empty() {
        let (job, path) = (job_id.to_owned(), path.to_owned());
        return Err(JobError::FileNotFound { job, path }.into());
    }
    // Pieces wait for whoever reads them, as those of an export do.
    let _reading = jobs.account(caller.tenant()).reserve(Resource::Exports, 1)?;
    let files = wanted.iter().map(|(_, file)| file.clone()).collect();
    let header = v1::DownloadJobFilesHeader { files };
    sink.send(v1::DownloadJobFilesResponse { content: Some(Content::Header(header)) }).await?;
    for (index, file) in wanted {
        let (pieces, mut queue) = mpsc::channel::<Vec<u8>>(1);
        let (files, uid) = (Arc::clone(&jobs.files), entry.uid);
        let reading = tokio::task::spawn_blocking(move || {
            files.read(&uid, JobFile::Output(number(index)), |body| {
                loop {
                    let mut piece = Vec::new();
                    (&mut *body).take(CHUNK_BYTES as u64).read_to_end(&mut piece)?;
                    // The reader of the stream may be gone, which the stream knows.
                    if piece.is_empty() || pieces.blocking_send(piece).is_err() {
                        return Ok(());
                    }
                }
            })
        });
        // The last piece waits for the checksum of the file.
        let (mut offset, mut last) = (0, Vec::new());
        while let Some(piece) = queue.recv().await {
            let data = std::mem::replace(&mut last, piece);
            if !data.is_empty() {
                offset = send(sink, &file.path, offset, data, false).await?;
            }
        }
        match reading.await {
            Ok(Ok(())) => {}
            // It was deleted meanwhile.
            Ok(Err(JobFileError::Missing)) => {
                return Err(JobError::NotFound { job: job_id.to_owned() }.into());
            }
            Ok(Err(error)) => return Err(JobError::from(error).into()),
            Err(error) => return Err(ServiceError::Panicked { message: error.to_string() }),
        }
        send(sink, &file.path, offset, last, true).await?;
    }
    Ok(())
}

/// Sends a chunk; returns where the next one begins.
async fn send(
    sink: &Sink<v1::DownloadJobFilesResponse>,
    path: &str,
    offset: i64,
    data: Vec<u8>,
    last_chunk: bool,
) -> Result<i64, ServiceError> {
    let next = offset.saturating_add(count(data.len()));
    let chunk = v1::FileChunk { path: path.to_owned(), offset, data, last_chunk };
    sink.send(v1::DownloadJobFilesResponse { content: Some(Content::Chunk(chunk)) }).await?;
    Ok(next)
}
