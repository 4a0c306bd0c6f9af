//! `JobService`: part of the wire, not served yet. Every RPC answers UNIMPLEMENTED. The messages
//! are complete, so that jobs can be added without breaking the wire.

use tonic::{Request, Response, Status};

use super::context::{Answers, Rpcs, unserved};
use crate::wire::v1;
use v1::job_service_server::JobService;

#[async_trait::async_trait]
impl JobService for Rpcs {
    async fn create_job(
        &self,
        _request: Request<v1::CreateJobRequest>,
    ) -> Result<Response<v1::CreateJobResponse>, Status> {
        unserved("CreateJob")
    }

    async fn get_job(
        &self,
        _request: Request<v1::GetJobRequest>,
    ) -> Result<Response<v1::GetJobResponse>, Status> {
        unserved("GetJob")
    }

    async fn list_jobs(
        &self,
        _request: Request<v1::ListJobsRequest>,
    ) -> Result<Response<v1::ListJobsResponse>, Status> {
        unserved("ListJobs")
    }

    async fn cancel_job(
        &self,
        _request: Request<v1::CancelJobRequest>,
    ) -> Result<Response<v1::CancelJobResponse>, Status> {
        unserved("CancelJob")
    }

    async fn delete_job(
        &self,
        _request: Request<v1::DeleteJobRequest>,
    ) -> Result<Response<v1::DeleteJobResponse>, Status> {
        unserved("DeleteJob")
    }

    type WatchJobStream = Answers<v1::WatchJobResponse>;

    async fn watch_job(
        &self,
        _request: Request<v1::WatchJobRequest>,
    ) -> Result<Response<Self::WatchJobStream>, Status> {
        unserved("WatchJob")
    }
}
