//! Files of jobs: uploads that are hostile or cut off, and solutions that come back.

use covis::wire::v1;
use tokio_stream::wrappers::ReceiverStream;
use tonic::Code;
use v1::job_result::Result as Kind;
use v1::job_service_client::JobServiceClient;
use v1::job_spec::Spec;
use v1::upload_job_files_request::Content;

use crate::common::{TestServer, check_field, check_status, run};
use crate::job_support::{BUNDLE, GRAPH, Jobs, message, solve, twin, upload};

fn chunk(path: &str, offset: i64, data: &[u8], last_chunk: bool) -> v1::UploadJobFilesRequest {
    let (path, data) = (path.to_owned(), data.to_vec());
    message(Content::Chunk(v1::FileChunk { path, offset, data, last_chunk }))
}

fn header() -> v1::UploadJobFilesRequest {
    message(Content::Header(v1::UploadJobFilesHeader::default()))
}

/// Bytes that the server holds for files of jobs.
async fn held(server: &TestServer) -> i64 {
    let mut client = v1::server_service_client::ServerServiceClient::new(server.channel.clone());
    let info = client.get_server_info(v1::GetServerInfoRequest {}).await.unwrap().into_inner();
    info.resources.iter().find(|row| row.resource == "job_bytes").unwrap().held
}

#[test]
fn an_upload_that_is_out_of_order_is_refused_and_leaves_nothing() {
    run(async {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().to_owned();
        let server = TestServer::with(|config| config.data_dir = Some(path.clone())).await;
        let jobs = Jobs::of(&server);
        let mebibytes = vec![0; (1 << 20) + 1];
        let cases: [(Vec<v1::UploadJobFilesRequest>, &str); 15] = [
            (vec![], "header"),
            (vec![chunk("a", 0, b"x", true)], "header"),
            (vec![header(), header()], "header"),
            (vec![header()], "chunk"),
            (vec![header(), chunk("a", 0, b"x", false)], "chunk"),
            (vec![header(), chunk("a", 1, b"x", true)], "chunk.offset"),
            (vec![header(), chunk("a", 0, b"x", false), chunk("b", 0, b"", true)], "chunk.path"),
            (vec![header(), chunk("a", 0, b"x", true), chunk("a", 0, b"", true)], "chunk.path"),
            (vec![header(), chunk("", 0, b"x", true)], "chunk.path"),
            // What a terminal obeys where the path is printed.
            (vec![header(), chunk("a\u{1b}[2J", 0, b"x", true)], "chunk.path"),
            (vec![header(), chunk("a\r\nb", 0, b"x", true)], "chunk.path"),
            (vec![header(), chunk("a\u{9b}2J", 0, b"x", true)], "chunk.path"),
            (vec![header(), chunk("a\u{7f}", 0, b"x", true)], "chunk.path"),
            (vec![header(), chunk("a\u{202e}txt.exe", 0, b"x", true)], "chunk.path"),
            (vec![header(), chunk("a", 0, &mebibytes, true)], "chunk.data"),
        ];
        for (messages, field) in cases {
            let status = jobs.upload_messages(messages.clone()).await.unwrap_err();
            check_field_of(&status, field);
        }
        let empty = v1::UploadJobFilesRequest { content: None };
        let status = jobs.upload_messages(vec![header(), empty]).await.unwrap_err();
        check_field_of(&status, "content");
        let negative = v1::UploadJobFilesHeader { size_bytes: -1 };
        let status = jobs.upload_messages(vec![message(Content::Header(negative))]).await;
        check_field(&status.unwrap_err(), "header.size_bytes", "OUT_OF_RANGE");
        assert_eq!(held(&server).await, 0);
        // The files are removed in the background, and by the next start.
        server.running.shutdown().await;
        let server = TestServer::with(|config| config.data_dir = Some(path.clone())).await;
        assert_eq!(fs_err::read_dir(path.join("jobs")).unwrap().count(), 0);
        server.running.shutdown().await;
    });
}

#[track_caller]
fn check_field_of(status: &tonic::Status, field: &str) {
    check_status(status, Code::InvalidArgument, "PROTOCOL");
    assert!(status.message().starts_with(&format!("{field}:")), "{field}: {status}");
}

#[test]
fn an_upload_whose_client_leaves_holds_nothing() {
    run(async {
        let server = TestServer::start().await;
        let (sender, receiver) = tokio::sync::mpsc::channel(4);
        let mut client = JobServiceClient::new(server.channel.clone());
        let call = tokio::spawn(async move {
            client.upload_job_files(ReceiverStream::new(receiver)).await.map(drop)
        });
        sender.send(header()).await.unwrap();
        sender.send(chunk("a", 0, &[1; 5000], false)).await.unwrap();
        // The bytes, the file and the upload.
        while held(&server).await != 5000 + 2 * 8192 {
            tokio::task::yield_now().await;
        }
        call.abort();
        let _canceled = call.await;
        drop(sender);
        while held(&server).await != 0 {
            tokio::task::yield_now().await;
        }
    });
}

#[test]
fn an_announced_size_that_has_no_room_is_refused_before_the_first_byte() {
    run(async {
        let server = TestServer::start().await;
        let announced = v1::UploadJobFilesHeader { size_bytes: 1 << 50 };
        let messages = vec![message(Content::Header(announced))];
        let status = Jobs::of(&server).upload_messages(messages).await.unwrap_err();
        check_status(&status, Code::ResourceExhausted, "SERVER_LIMIT");
    });
}

#[test]
fn a_folder_of_problems_is_solved_in_order_and_its_solutions_come_back() {
    run(async {
        let server = TestServer::start().await;
        let jobs = Jobs::of(&server);
        let model = ["cameras.txt", "images.txt", "points3D.txt"];
        let room = model.map(|name| (format!("room/{name}"), twin(&format!("colmap-room/{name}"))));
        let mut files = vec![("a/window.txt", twin(BUNDLE)), ("a/grid.g2o", twin(GRAPH))];
        files.extend(room.iter().map(|(path, bytes)| (path.as_str(), bytes.clone())));
        let uploaded = jobs.upload_messages(upload(&files)).await.unwrap();
        assert_eq!(uploaded.file_count, 5);
        assert!(uploaded.expire_time.is_some());
        let spec = v1::SolveFilesSpec {
            upload_id: uploaded.upload_id,
            keep_solutions: true,
            ..Default::default()
        };
        jobs.create("all", Spec::SolveFiles(spec)).await.unwrap();
        let job = jobs.success("all").await;
        let Some(Kind::SolveFiles(result)) = job.result.unwrap().result else { panic!() };
        let paths: Vec<&str> = result.problems.iter().map(|p| p.path.as_str()).collect();
        assert_eq!(paths, ["a/window.txt", "a/grid.g2o", "room"]);
        let sum: f64 = result.problems.iter().map(|p| p.summary.as_ref().unwrap().final_cost).sum();
        assert_eq!(job.cost_after, Some(sum));
        let report = jobs.report("all").await;
        assert_eq!(report["problems"].as_array().unwrap().len(), 3);

        let made = jobs.download("all", "").await.unwrap();
        let paths: Vec<&str> = made.iter().map(|(path, _)| path.as_str()).collect();
        let wanted = [
            "report.json",
            "a/window.txt",
            "a/grid.g2o",
            "room/cameras.txt",
            "room/images.txt",
            "room/points3D.txt",
        ];
        assert_eq!(paths, wanted);
        // A solution is at its optimum: solved again it stays there.
        let again = jobs.upload(&[("window.txt", made[1].1.clone())]).await.unwrap();
        jobs.create("again", solve(&again)).await.unwrap();
        let again = jobs.success("again").await;
        let first = result.problems[0].summary.as_ref().unwrap().final_cost;
        assert!((again.cost_before.unwrap() - first).abs() <= 1e-9 * first);
        let status = jobs.download("all", "nothing").await.unwrap_err();
        check_status(&status, Code::NotFound, "JOB_FILE_NOT_FOUND");
        jobs.delete("all").await.unwrap();
        jobs.delete("again").await.unwrap();
        // The task that ran a job holds it for a moment after its end.
        while held(&server).await != 0 {}
    });
}

#[test]
fn files_that_cannot_lie_beside_each_other_and_the_report_are_refused() {
    run(async {
        let server = TestServer::start().await;
        let jobs = Jobs::of(&server);
        let cases: [(&[&str], &str); 13] = [
            (&["../../outside.g2o"], "OUT_OF_RANGE"),
            (&["a/../b.g2o"], "OUT_OF_RANGE"),
            (&["/a.g2o"], "OUT_OF_RANGE"),
            (&["a.g2o", "./a.g2o"], "OUT_OF_RANGE"),
            (&["a//b.g2o"], "OUT_OF_RANGE"),
            (&["a/"], "OUT_OF_RANGE"),
            (&[".."], "OUT_OF_RANGE"),
            (&["c:a.g2o"], "OUT_OF_RANGE"),
            (&["a\\b.g2o"], "OUT_OF_RANGE"),
            (&["report.json"], "OUT_OF_RANGE"),
            (&["report.json/a.g2o"], "OUT_OF_RANGE"),
            (&["a", "a/b.g2o"], "INCONSISTENT"),
            (&["a/b/c.g2o", "d.g2o", "a/b"], "INCONSISTENT"),
        ];
        for (paths, reason) in cases {
            let files: Vec<_> = paths.iter().map(|path| (*path, twin(GRAPH))).collect();
            let status = jobs.upload(&files).await.unwrap_err();
            check_field(&status, "chunk.path", reason);
            let path = format!("{:?}", paths.last().unwrap());
            assert!(status.message().contains(&path), "{path}: {status}");
        }
        assert_eq!(held(&server).await, 0);
        // What only looks alike is taken, and keeps its path.
        let paths = ["a", "ab/c", "sub/report.json", "..a/b..c", "report.json2"];
        let files: Vec<_> = paths.iter().map(|path| (*path, twin(GRAPH))).collect();
        let uploaded = jobs.upload(&files).await.unwrap();
        let spec = v1::SolveFilesSpec {
            upload_id: uploaded,
            kind: v1::ProblemFileKind::PoseGraph.into(),
            keep_solutions: true,
        };
        jobs.create("kept", Spec::SolveFiles(spec)).await.unwrap();
        let job = jobs.success("kept").await;
        let made: Vec<&str> = job.files.iter().map(|file| file.path.as_str()).collect();
        assert_eq!(made, [&["report.json"], &paths[..]].concat());
    });
}
