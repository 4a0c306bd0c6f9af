//! `JobService`: making, watching and canceling jobs, and the files that they take and make.
//!
//! Each handler reads its request and asks [`Jobs`]; what a job does is not known here.

use std::sync::Arc;

use prost::Message;
use tonic::{Request, Response, Status, Streaming};

use super::access::Caller;
use super::context::{Answers, Context, Messages};
use super::convert::{Path, convert, ids};
use super::deadline::call_time;
use super::error::ServiceError;
use super::job_error::JobError;
use super::jobs::{JobList, Jobs, download, is_ended};
use super::listing::{self, ENTRY_OVERHEAD, MESSAGE_BYTES, PagedList};
use crate::map::Reason;
use crate::wire::v1;
use v1::JobState;
use v1::job_service_server::JobService;

/// Most states of a list: there are fewer.
const MOST_STATES: usize = 16;

/// A required name of a job.
fn job_id(job_id: &str) -> Result<String, ServiceError> {
    Ok(convert(|out| ids::name(Path::root("job_id"), job_id, out))?)
}

/// The service of jobs.
#[derive(Clone, Debug)]
pub(super) struct JobRpcs {
    pub(super) context: Arc<Context>,
    pub(super) jobs: Arc<Jobs>,
}

impl JobRpcs {
    fn list(
        &self,
        request: &Request<v1::ListJobsRequest>,
    ) -> Result<v1::ListJobsResponse, ServiceError> {
        let caller = Caller::of(request)?;
        let v1::ListJobsRequest { page_size, page_token, map_id, states } = request.get_ref();
        let states = convert(|out| {
            if !map_id.is_empty() {
                ids::map_id(map_id, out)?;
            }
            let at = Path::root("states");
            // There are six, and each job is compared with all that are named.
            out.at_most(at, states, MOST_STATES)?;
            let mut known = Vec::new();
            for (index, &state) in states.iter().enumerate() {
                let state = out.known::<JobState>(at.index(index), state)?;
                if state == JobState::Unspecified {
                    return out.missing(at.index(index));
                }
                known.push(state);
            }
            known.sort_unstable();
            known.dedup();
            Some(known)
        })?;
        let list = PagedList::new("ListJobs", format!("{}/{map_id}/{states:?}", caller.tenant()));
        let (size, after) = listing::page(*page_size, page_token, &list)?;
        let before = match after.as_str() {
            "" => i64::MAX,
            number => number.parse().map_err(|_error| {
                let text = "not a page token of this server";
                ServiceError::field("page_token", Reason::OutOfRange, text)
            })?,
        };
        let wanted = JobList { before, map_id, states: &states };
        let (mut jobs, mut bytes, mut token) = (Vec::new(), 0, String::new());
        let mut last = 0;
        for (number, job) in self.jobs.list(&caller, &wanted) {
            let length = job.encoded_len() + ENTRY_OVERHEAD;
            if jobs.len() == size || (!jobs.is_empty() && bytes + length > MESSAGE_BYTES) {
                token = list.token(&last.to_string());
                break;
            }
            (bytes, last) = (bytes + length, number);
            jobs.push(job);
        }
        Ok(v1::ListJobsResponse { jobs, next_page_token: token })
    }
}

#[async_trait::async_trait]
impl JobService for JobRpcs {
    async fn create_job(
        &self,
        request: Request<v1::CreateJobRequest>,
    ) -> Result<Response<v1::CreateJobResponse>, Status> {
        let handler = async {
            let caller = Caller::of(&request)?;
            let job = self.jobs.create(&caller, request.into_inner()).await?;
            Ok(v1::CreateJobResponse { job: Some(job) })
        };
        self.context.answer("CreateJob", handler).await
    }

    async fn get_job(
        &self,
        request: Request<v1::GetJobRequest>,
    ) -> Result<Response<v1::GetJobResponse>, Status> {
        let handler = async {
            let caller = Caller::of(&request)?;
            let job = self.jobs.get(&caller, &job_id(&request.get_ref().job_id)?)?;
            Ok(v1::GetJobResponse { job: Some(job) })
        };
        self.context.answer("GetJob", handler).await
    }

    async fn list_jobs(
        &self,
        request: Request<v1::ListJobsRequest>,
    ) -> Result<Response<v1::ListJobsResponse>, Status> {
        self.context.answer("ListJobs", async { self.list(&request) }).await
    }

    async fn cancel_job(
        &self,
        request: Request<v1::CancelJobRequest>,
    ) -> Result<Response<v1::CancelJobResponse>, Status> {
        let handler = async {
            let caller = Caller::of(&request)?;
            let id = job_id(&request.get_ref().job_id)?;
            let job = self.jobs.cancel(&caller, &id).await?;
            Ok(v1::CancelJobResponse { job: Some(job) })
        };
        self.context.answer("CancelJob", handler).await
    }

    async fn delete_job(
        &self,
        request: Request<v1::DeleteJobRequest>,
    ) -> Result<Response<v1::DeleteJobResponse>, Status> {
        let handler = async {
            let caller = Caller::of(&request)?;
            let id = job_id(&request.get_ref().job_id)?;
            self.jobs.delete(&caller, &id).await?;
            Ok(v1::DeleteJobResponse {})
        };
        self.context.answer("DeleteJob", handler).await
    }

    type WatchJobStream = Answers<v1::WatchJobResponse>;

    async fn watch_job(
        &self,
        request: Request<v1::WatchJobRequest>,
    ) -> Result<Response<Self::WatchJobStream>, Status> {
        let time = call_time(request.metadata());
        let caller = Caller::of(&request);
        let (rpcs, request) = (self.clone(), request.into_inner());
        self.context.stream("WatchJob", time, Messages::Small, |sink| async move {
            let caller = caller?;
            let id = job_id(&request.job_id)?;
            let mut following = rpcs.jobs.follow(&caller, &id)?;
            let watching = async {
                loop {
                    // The newest state at the time when there is room for it.
                    let room = sink.room().await?;
                    let job = following.borrow_and_update().clone();
                    let has_ended = is_ended(job.state());
                    room.send(v1::WatchJobResponse { job: Some(job) });
                    if has_ended {
                        return Ok(());
                    }
                    if following.changed().await.is_err() {
                        return Err(JobError::NotFound { job: id.clone() }.into());
                    }
                }
            };
            tokio::select! {
                biased;
                ended = watching => ended,
                reason = rpcs.context.access.withdrawn(&caller) => Err(reason),
                () = rpcs.context.drained() => Err(ServiceError::Draining),
            }
        })
    }

    async fn upload_job_files(
        &self,
        request: Request<Streaming<v1::UploadJobFilesRequest>>,
    ) -> Result<Response<v1::UploadJobFilesResponse>, Status> {
        let handler = async {
            let caller = Caller::of(&request)?;
            self.jobs.upload(&caller, request.into_inner()).await
        };
        self.context.answer("UploadJobFiles", handler).await
    }

    type DownloadJobFilesStream = Answers<v1::DownloadJobFilesResponse>;

    async fn download_job_files(
        &self,
        request: Request<v1::DownloadJobFilesRequest>,
    ) -> Result<Response<Self::DownloadJobFilesStream>, Status> {
        let time = call_time(request.metadata());
        let caller = Caller::of(&request);
        let (jobs, request) = (Arc::clone(&self.jobs), request.into_inner());
        self.context.stream("DownloadJobFiles", time, Messages::Large, |sink| async move {
            let caller = caller?;
            let id = job_id(&request.job_id)?;
            download(&jobs, &caller, &id, &request.path, &sink).await
        })
    }
}
