//! Helpers of the tests of jobs: specs, uploads, and waiting for an end.

use covis::wire::v1;
use tonic::transport::Channel;
use tonic::{Request, Status};
use v1::job_service_client::JobServiceClient;
use v1::job_spec::Spec;
use v1::{JobState, upload_job_files_request};

use crate::cli_support::golden;
use crate::common::{TestServer, bearing};

/// The calls of `JobService`, with a token.
#[derive(Clone)]
pub(crate) struct Jobs {
    client: JobServiceClient<Channel>,
    token: String,
}

impl Jobs {
    pub(crate) fn of(server: &TestServer) -> Self {
        Self::with(server, "")
    }

    pub(crate) fn with(server: &TestServer, token: &str) -> Self {
        let client = JobServiceClient::new(server.channel.clone());
        Self { client, token: token.to_owned() }
    }

    fn request<T>(&self, message: T) -> Request<T> {
        bearing(&self.token, message)
    }

    pub(crate) async fn create(&self, job_id: &str, spec: Spec) -> Result<v1::Job, Status> {
        self.create_with(job_id, spec, 0).await
    }

    pub(crate) async fn create_with(
        &self,
        job_id: &str,
        spec: Spec,
        priority: i32,
    ) -> Result<v1::Job, Status> {
        let spec = Some(v1::JobSpec { spec: Some(spec) });
        let request = v1::CreateJobRequest { job_id: job_id.to_owned(), spec, priority };
        let answer = self.client.clone().create_job(self.request(request)).await?;
        Ok(answer.into_inner().job.unwrap())
    }

    pub(crate) async fn get(&self, job_id: &str) -> Result<v1::Job, Status> {
        let request = v1::GetJobRequest { job_id: job_id.to_owned() };
        let answer = self.client.clone().get_job(self.request(request)).await?;
        Ok(answer.into_inner().job.unwrap())
    }

    pub(crate) async fn list(
        &self,
        request: v1::ListJobsRequest,
    ) -> Result<v1::ListJobsResponse, Status> {
        Ok(self.client.clone().list_jobs(self.request(request)).await?.into_inner())
    }

    pub(crate) async fn cancel(&self, job_id: &str) -> Result<v1::Job, Status> {
        let request = v1::CancelJobRequest { job_id: job_id.to_owned() };
        let answer = self.client.clone().cancel_job(self.request(request)).await?;
        Ok(answer.into_inner().job.unwrap())
    }

    pub(crate) async fn delete(&self, job_id: &str) -> Result<(), Status> {
        let request = v1::DeleteJobRequest { job_id: job_id.to_owned() };
        self.client.clone().delete_job(self.request(request)).await.map(drop)
    }

    pub(crate) async fn watch(
        &self,
        job_id: &str,
    ) -> Result<tonic::Streaming<v1::WatchJobResponse>, Status> {
        let request = v1::WatchJobRequest { job_id: job_id.to_owned() };
        Ok(self.client.clone().watch_job(self.request(request)).await?.into_inner())
    }

    /// Follows a job until `is_reached`; it must come.
    pub(crate) async fn until(
        &self,
        job_id: &str,
        mut is_reached: impl FnMut(&v1::Job) -> bool,
    ) -> v1::Job {
        let mut stream = self.watch(job_id).await.unwrap();
        loop {
            let part = stream.message().await.unwrap();
            let job = part.expect("the job ended before").job.unwrap();
            if is_reached(&job) {
                return job;
            }
        }
    }

    /// Waits for the end of a job.
    pub(crate) async fn end(&self, job_id: &str) -> v1::Job {
        self.until(job_id, |job| job.end_time.is_some()).await
    }

    /// Waits for the end of a job, which must be a success.
    pub(crate) async fn success(&self, job_id: &str) -> v1::Job {
        let job = self.end(job_id).await;
        assert_eq!(job.state(), JobState::Succeeded, "{job:?}");
        job
    }

    pub(crate) async fn upload_messages(
        &self,
        messages: Vec<v1::UploadJobFilesRequest>,
    ) -> Result<v1::UploadJobFilesResponse, Status> {
        let request = self.request(tokio_stream::iter(messages));
        Ok(self.client.clone().upload_job_files(request).await?.into_inner())
    }

    /// Uploads files; returns the upload's id.
    pub(crate) async fn upload(&self, files: &[(&str, Vec<u8>)]) -> Result<String, Status> {
        Ok(self.upload_messages(upload(files)).await?.upload_id)
    }

    /// The files that a job made, by path.
    pub(crate) async fn download(
        &self,
        job_id: &str,
        path: &str,
    ) -> Result<Vec<(String, Vec<u8>)>, Status> {
        let (job_id, path) = (job_id.to_owned(), path.to_owned());
        let request = self.request(v1::DownloadJobFilesRequest { job_id, path });
        let mut stream = self.client.clone().download_job_files(request).await?.into_inner();
        let mut files: Vec<(String, Vec<u8>)> = Vec::new();
        while let Some(message) = stream.message().await? {
            match message.content.unwrap() {
                v1::download_job_files_response::Content::Header(header) => {
                    assert!(files.is_empty());
                    drop(header);
                }
                v1::download_job_files_response::Content::Chunk(chunk) => {
                    if chunk.offset == 0 {
                        files.push((chunk.path, Vec::new()));
                    }
                    files.last_mut().unwrap().1.extend(chunk.data);
                }
            }
        }
        Ok(files)
    }

    /// The report of a job.
    pub(crate) async fn report(&self, job_id: &str) -> serde_json::Value {
        let files = self.download(job_id, "report.json").await.unwrap();
        serde_json::from_slice(&files[0].1).unwrap()
    }
}

pub(crate) fn message(content: upload_job_files_request::Content) -> v1::UploadJobFilesRequest {
    v1::UploadJobFilesRequest { content: Some(content) }
}

/// The messages of an upload.
pub(crate) fn upload(files: &[(&str, Vec<u8>)]) -> Vec<v1::UploadJobFilesRequest> {
    const SIZE: usize = 4_000;
    let header = v1::UploadJobFilesHeader::default();
    let mut messages = vec![message(upload_job_files_request::Content::Header(header))];
    for (path, bytes) in files {
        let chunks: Vec<&[u8]> =
            if bytes.is_empty() { vec![&[]] } else { bytes.chunks(SIZE).collect() };
        for (index, data) in chunks.iter().enumerate() {
            messages.push(message(upload_job_files_request::Content::Chunk(v1::FileChunk {
                path: (*path).to_owned(),
                offset: (index * SIZE) as i64,
                data: data.to_vec(),
                last_chunk: index + 1 == chunks.len(),
            })));
        }
    }
    messages
}

/// A problem file of the goldens.
pub(crate) fn twin(name: &str) -> Vec<u8> {
    fs_err::read(golden("twins").join(name)).unwrap()
}

/// A small BAL file.
pub(crate) const BUNDLE: &str = "window-6-80.txt";
/// A small pose graph.
pub(crate) const GRAPH: &str = "grid-200.g2o";

pub(crate) fn optimize(map_id: &str) -> Spec {
    Spec::OptimizeMap(v1::OptimizeMapRequest { map_id: map_id.to_owned(), ..Default::default() })
}

pub(crate) fn pose_graph(map_id: &str) -> Spec {
    Spec::OptimizeMap(v1::OptimizeMapRequest {
        map_id: map_id.to_owned(),
        problem: v1::MapProblem::PoseGraph.into(),
        ..Default::default()
    })
}

pub(crate) fn compact(map_id: &str, redundant_share: Option<f64>) -> Spec {
    Spec::CompactMap(v1::CompactMapSpec {
        map_id: map_id.to_owned(),
        redundant_share,
        drop_old_journal: true,
    })
}

pub(crate) fn export(map_id: &str, format: v1::MapFormat) -> Spec {
    Spec::ExportMap(v1::ExportMapRequest {
        map_id: map_id.to_owned(),
        format: format.into(),
        all_landmarks: false,
    })
}

pub(crate) fn solve(upload_id: &str) -> Spec {
    Spec::SolveFiles(v1::SolveFilesSpec { upload_id: upload_id.to_owned(), ..Default::default() })
}

/// A map of the scene that no solve has touched.
pub(crate) async fn unsolved_map(server: &TestServer, map_id: &str, keyframes: i64) {
    let policy = v1::MapPolicy { local_bundle_adjustment: Some(false), ..Default::default() };
    server.create_map_with(map_id, policy).await;
    server.build_map(map_id, keyframes).await;
}

/// The hash of a map's state.
pub(crate) async fn state_hash(server: &TestServer, map_id: &str) -> Vec<u8> {
    let request = v1::GetMapRequest { map_id: map_id.to_owned(), include_digests: true };
    server.maps().get_map(request).await.unwrap().into_inner().state_hash
}
