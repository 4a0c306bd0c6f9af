//! Jobs: the calls of `JobService`, the files that jobs take, and those that they make.
//!
//! A job survives its client and the server: a caller that has its `job_id` finds it again. Creating a job
//! again with the same id and spec answers the job that is there.

use tokio_stream::{Stream, StreamExt as _};
use tonic::Streaming;

use super::calls::{answer, next, repeated};
use super::export::{Order, is_safe};
use super::{Client, ClientError};
use crate::wire::v1;
use v1::download_job_files_response::Content as Part;
use v1::upload_job_files_request::Content;

const DOWNLOAD: &str = "DownloadJobFiles";

impl Client {
    /// Creates a job, or answers the one with this id and spec.
    ///
    /// # Errors
    /// The codes of `CreateJob`.
    pub async fn create_job(&self, request: v1::CreateJobRequest) -> Result<v1::Job, ClientError> {
        const RPC: &str = "CreateJob";
        let call = || self.timed(request.clone());
        let answer = repeated!(self, answer(RPC, self.job_service().create_job(call()).await))?;
        one(RPC, answer.job)
    }

    /// One job.
    ///
    /// # Errors
    /// The codes of `GetJob`.
    pub async fn job(&self, job_id: &str) -> Result<v1::Job, ClientError> {
        const RPC: &str = "GetJob";
        let call = || self.timed(v1::GetJobRequest { job_id: job_id.to_owned() });
        let answer = repeated!(self, answer(RPC, self.job_service().get_job(call()).await))?;
        one(RPC, answer.job)
    }

    /// The jobs that the request's filters leave, the newest first, of all pages.
    ///
    /// # Errors
    /// The codes of `ListJobs`.
    pub async fn jobs(&self, filter: v1::ListJobsRequest) -> Result<Vec<v1::Job>, ClientError> {
        let (mut jobs, mut request) = (Vec::new(), filter);
        loop {
            let call = || self.timed(request.clone());
            let page =
                repeated!(self, answer("ListJobs", self.job_service().list_jobs(call()).await))?;
            jobs.extend(page.jobs);
            if page.next_page_token.is_empty() {
                return Ok(jobs);
            }
            request.page_token = page.next_page_token;
        }
    }

    /// Asks a job to stop; the job, often still running.
    ///
    /// # Errors
    /// The codes of `CancelJob`.
    pub async fn cancel_job(&self, job_id: &str) -> Result<v1::Job, ClientError> {
        const RPC: &str = "CancelJob";
        let call = || self.timed(v1::CancelJobRequest { job_id: job_id.to_owned() });
        let answer = repeated!(self, answer(RPC, self.job_service().cancel_job(call()).await))?;
        one(RPC, answer.job)
    }

    /// Forgets a job that has ended.
    ///
    /// # Errors
    /// The codes of `DeleteJob`.
    pub async fn delete_job(&self, job_id: &str) -> Result<(), ClientError> {
        let call = || self.timed(v1::DeleteJobRequest { job_id: job_id.to_owned() });
        repeated!(self, answer("DeleteJob", self.job_service().delete_job(call()).await)).map(drop)
    }

    /// Follows a job to its end and answers it; `on_change` sees it at once and as it changes.
    ///
    /// # Errors
    /// The codes of `WatchJob`; UNAVAILABLE where the server ends before the job.
    pub async fn watch_job(
        &self,
        job_id: &str,
        mut on_change: impl FnMut(&v1::Job),
    ) -> Result<v1::Job, ClientError> {
        const RPC: &str = "WatchJob";
        let request = v1::WatchJobRequest { job_id: job_id.to_owned() };
        let mut stream = answer(RPC, self.job_service().watch_job(request).await)?;
        let mut last = None;
        while let Some(part) = next(RPC, &mut stream).await? {
            let job = one(RPC, part.job)?;
            on_change(&job);
            last = Some(job);
        }
        one(RPC, last)
    }

    /// Uploads files for a job, whose chunks come in order. Dropping the future before the answer leaves
    /// nothing, unless the server had everything already.
    ///
    /// # Errors
    /// The codes of `UploadJobFiles`.
    pub async fn upload_job_files(
        &self,
        header: v1::UploadJobFilesHeader,
        chunks: impl Stream<Item = v1::FileChunk> + Send + 'static,
    ) -> Result<v1::UploadJobFilesResponse, ClientError> {
        let message = |content| v1::UploadJobFilesRequest { content: Some(content) };
        let header = tokio_stream::once(Content::Header(header));
        let content = header.chain(chunks.map(Content::Chunk)).map(message);
        answer("UploadJobFiles", self.job_service().upload_job_files(content).await)
    }

    /// Starts to download the files that a job made: the one that is named `path`, or all.
    ///
    /// # Errors
    /// The codes of `DownloadJobFiles`.
    pub async fn download_job_files(
        &self,
        job_id: &str,
        path: Option<&str>,
    ) -> Result<JobDownload, ClientError> {
        let path = path.unwrap_or_default().to_owned();
        let request = v1::DownloadJobFilesRequest { job_id: job_id.to_owned(), path };
        let stream = answer(DOWNLOAD, self.job_service().download_job_files(request).await)?;
        JobDownload::begin(stream).await
    }

    /// A whole file that a job made, for instance its `report.json`.
    ///
    /// # Errors
    /// The codes of `DownloadJobFiles`.
    pub async fn job_file(&self, job_id: &str, path: &str) -> Result<Vec<u8>, ClientError> {
        let mut download = self.download_job_files(job_id, Some(path)).await?;
        let mut bytes = Vec::new();
        while let Some(chunk) = download.next().await? {
            bytes.extend(chunk.data);
        }
        Ok(bytes)
    }
}

fn one(rpc: &'static str, job: Option<v1::Job>) -> Result<v1::Job, ClientError> {
    job.ok_or(ClientError::Protocol { rpc, what: "no job" })
}

/// A running download of a job's files.
#[derive(Debug)]
pub struct JobDownload {
    files: Vec<v1::JobFile>,
    stream: Streaming<v1::DownloadJobFilesResponse>,
    order: Order,
}

impl JobDownload {
    async fn begin(
        mut stream: Streaming<v1::DownloadJobFilesResponse>,
    ) -> Result<Self, ClientError> {
        let first = next(DOWNLOAD, &mut stream).await?.and_then(|answer| answer.content);
        let Some(Part::Header(header)) = first else {
            return Err(protocol("the download did not begin with a header"));
        };
        let paths: Vec<String> = header.files.iter().map(|file| file.path.clone()).collect();
        if !paths.iter().all(|path| is_safe(path)) {
            return Err(protocol("a path leaves the folder of the download"));
        }
        Ok(Self { files: header.files, stream, order: Order::of(paths) })
    }

    /// The files that follow, in order.
    pub fn files(&self) -> &[v1::JobFile] {
        &self.files
    }

    /// The next piece of a file; `None` after the last one.
    ///
    /// # Errors
    /// The codes of `DownloadJobFiles`; [`ClientError::Protocol`] for chunks out of order or an early
    /// end.
    pub async fn next(&mut self) -> Result<Option<v1::FileChunk>, ClientError> {
        match next(DOWNLOAD, &mut self.stream).await?.map(|answer| answer.content) {
            Some(Some(Part::Chunk(chunk))) => {
                let fits = self.order.fits(&chunk);
                fits.then_some(Some(chunk)).ok_or_else(|| protocol("a chunk is out of order"))
            }
            Some(_) => Err(protocol("a chunk was expected")),
            None if self.order.is_done() => Ok(None),
            None => Err(protocol("the download ended early")),
        }
    }
}

fn protocol(what: &'static str) -> ClientError {
    ClientError::Protocol { rpc: DOWNLOAD, what }
}
