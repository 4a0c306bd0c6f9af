//! What jobs and uploads may hold and read, and how long they may be in answers: files without content,
//! many problems, long records of an earlier version, and text that a terminal would obey.

use std::path::Path;

use covis::service::engine::{AccountLimits, Resource};
use covis::store::{FileStore, FileStoreOptions, JobRecord};
use covis::wire::v1;
use prost::Message;
use tonic::Code;
use v1::JobState;
use v1::job_result::Result as Kind;
use v1::job_spec::Spec;

use crate::cli_support::{Running, Workspace};
use crate::common::{Stream, TestServer, check_field, check_retry, check_status, occupy, run};
use crate::job_support::{BUNDLE, GRAPH, Jobs, solve, twin, unsolved_map};

/// Most bytes of a job in an answer.
const ANSWER_BYTES: usize = 256 << 10;

/// What a tenant holds of a resource.
async fn held(server: &TestServer, resource: &str) -> i64 {
    let mut client = v1::server_service_client::ServerServiceClient::new(server.channel.clone());
    let info = client.get_server_info(v1::GetServerInfoRequest {}).await.unwrap().into_inner();
    info.resources.iter().find(|row| row.resource == resource).unwrap().held
}

#[test]
fn files_without_content_count_and_a_tenant_has_so_many_uploads() {
    run(async {
        let folder = tempfile::tempdir().unwrap();
        let start = async || {
            TestServer::with(|config| {
                config.data_dir = Some(folder.path().to_owned());
                config.tenant_limits = AccountLimits::default()
                    .with(Resource::JobBytes, 10 << 20)
                    .with(Resource::Uploads, 3);
            })
            .await
        };
        let server = start().await;
        let jobs = Jobs::of(&server);
        let names: Vec<String> = (0..1024).map(|k| format!("{k:0>1024}")).collect();
        let empty: Vec<_> = names.iter().map(|name| (name.as_str(), Vec::new())).collect();
        jobs.upload(&empty).await.unwrap();
        let counted = held(&server, "job_bytes").await;
        assert_eq!(counted, 1025 * 8192, "8 KiB a file and 8 KiB the upload");
        let status = jobs.upload(&empty).await.unwrap_err();
        check_status(&status, Code::ResourceExhausted, "TENANT_LIMIT");
        assert!(status.message().contains("tenant_max_job_bytes"), "{status}");
        check_retry(&status);
        assert_eq!(held(&server, "job_bytes").await, counted, "what is refused leaves nothing");

        let second = jobs.upload(&[(GRAPH, twin(GRAPH))]).await.unwrap();
        jobs.upload(&[(GRAPH, twin(GRAPH))]).await.unwrap();
        let status = jobs.upload(&[(GRAPH, twin(GRAPH))]).await.unwrap_err();
        check_status(&status, Code::ResourceExhausted, "TENANT_LIMIT");
        assert!(status.message().contains("tenant_max_upload_count"), "{status}");
        let counted = held(&server, "job_bytes").await;
        server.running.shutdown().await;

        // A restart counts the same.
        let server = start().await;
        let jobs = Jobs::of(&server);
        assert_eq!(held(&server, "uploads").await, 3);
        assert_eq!(held(&server, "job_bytes").await, counted);
        // A job takes an upload, and its place is free again.
        jobs.create("takes", solve(&second)).await.unwrap();
        jobs.success("takes").await;
        assert_eq!(held(&server, "uploads").await, 2);
        jobs.upload(&[(GRAPH, twin(GRAPH))]).await.unwrap();
        server.running.shutdown().await;
    });
}

fn evaluation(upload_id: &str) -> Spec {
    Spec::EvaluateTrajectory(v1::EvaluateTrajectorySpec {
        map_id: "house".to_owned(),
        client_id: "robot".to_owned(),
        truth_upload_id: upload_id.to_owned(),
        ..Default::default()
    })
}

/// A true trajectory of the scene, and poses of other times.
fn truth(others: usize) -> Vec<u8> {
    let poses = (0..4).map(|id| {
        let [x, y, z] = crate::common::keyframe_position(id);
        format!("{}.5 {x} {y} {z} 0 0 0 1\n", 100 + id)
    });
    let others = (0..others).map(|k| format!("{} 0 0 0 0 0 0 1\n", 1000 + k));
    poses.chain(others).collect::<String>().into_bytes()
}

#[test]
fn what_a_job_reads_is_priced_before_it_is_read() {
    run(async {
        // As much as a few hundred poses take.
        let server = TestServer::with(|config| config.engine.max_solve_bytes = 1 << 20).await;
        let jobs = Jobs::of(&server);
        unsolved_map(&server, "house", 4).await;
        let upload = jobs.upload(&[("truth.tum", truth(100))]).await.unwrap();
        jobs.create("short", evaluation(&upload)).await.unwrap();
        jobs.success("short").await;

        let upload = jobs.upload(&[("truth.tum", truth(10_000))]).await.unwrap();
        jobs.create("truth", evaluation(&upload)).await.unwrap();
        let bal = "0 0 1 1\n".repeat(20_000);
        let bal = format!("1 1 20000\n{bal}0 0 0 0 0 0 1 0 0\n0 0 1\n").into_bytes();
        let upload = jobs.upload(&[("long.txt", bal)]).await.unwrap();
        jobs.create("bundle", solve(&upload)).await.unwrap();
        let graph: String = (0..20_000).map(|k| format!("VERTEX_SE2 {k} 0 0 0\n")).collect();
        let upload = jobs.upload(&[("long.g2o", graph.into_bytes())]).await.unwrap();
        jobs.create("graph", solve(&upload)).await.unwrap();
        for job in ["truth", "bundle", "graph"] {
            let failure = jobs.end(job).await.failure.unwrap();
            assert_eq!(failure.code, Code::ResourceExhausted as i32, "{job}: {failure:?}");
            assert_eq!(failure.reason, "SOLVE_TOO_EXPENSIVE", "{job}: {failure:?}");
        }
        assert_eq!(held(&server, "running_solve_bytes").await, 0);
    });
}

/// A server whose jobs are in a folder.
async fn server_of(folder: &Path) -> TestServer {
    TestServer::with(|config| config.data_dir = Some(folder.to_owned())).await
}

#[test]
fn a_truth_counts_as_in_memory_until_its_job_has_ended_and_is_known_after_that() {
    run(async {
        let folder = tempfile::tempdir().unwrap();
        let server = server_of(folder.path()).await;
        let jobs = Jobs::of(&server);
        unsolved_map(&server, "house", 4).await;
        let truth = |first: i64| {
            let pose = |k| v1::KeyframePose {
                capture_time: Some(prost_types::Timestamp { seconds: first + k, nanos: 0 }),
                world_from_camera: Some(v1::RigidTransform {
                    translation: Some(v1::Vector3::default()),
                    rotation: Some(v1::Quaternion { w: 1.0, ..Default::default() }),
                }),
                ..Default::default()
            };
            (0..10_000).map(pose).collect::<Vec<_>>()
        };
        let of_truth = |truth| {
            Spec::EvaluateTrajectory(v1::EvaluateTrajectorySpec {
                map_id: "house".to_owned(),
                client_id: "robot".to_owned(),
                truth,
                ..Default::default()
            })
        };
        let record = of_truth(truth(1)).encoded_len() as i64;
        let occupied = occupy(&server).await;
        jobs.create("long", of_truth(truth(1))).await.unwrap();
        let counted = held(&server, "job_bytes").await;
        assert!(counted > 4 * record, "{counted} for a record of {record}");
        drop(occupied);
        // No time of it is that of a keyframe.
        let ended = v1::Job { progress: None, ..jobs.end("long").await };
        assert_eq!(ended.state(), JobState::Failed);
        // What it held is given back a moment after its end.
        while !(record..record + 8192).contains(&held(&server, "job_bytes").await) {}
        let known = async |jobs: &Jobs| {
            let again = jobs.create("long", of_truth(truth(1))).await.unwrap();
            // Progress is shown only.
            assert_eq!(v1::Job { progress: None, ..again }, ended);
            let status = jobs.create("long", of_truth(truth(2))).await.unwrap_err();
            check_status(&status, Code::AlreadyExists, "JOB_EXISTS");
        };
        known(&jobs).await;
        server.running.shutdown().await;
        let server = server_of(folder.path()).await;
        let kept = held(&server, "job_bytes").await;
        assert!((record..record + 8192).contains(&kept), "{kept} for a record of {record}");
        known(&Jobs::of(&server)).await;
        server.running.shutdown().await;
    });
}

#[test]
fn an_evaluation_takes_its_turn_among_the_solves() {
    run(async {
        let server = TestServer::start().await;
        let jobs = Jobs::of(&server);
        unsolved_map(&server, "house", 4).await;
        let upload = jobs.upload(&[("truth.tum", truth(0))]).await.unwrap();
        let occupied = occupy(&server).await;
        jobs.create("waits", evaluation(&upload)).await.unwrap();
        while held(&server, "waiting_solves").await == 0 {
            tokio::task::yield_now().await;
        }
        assert_eq!(jobs.get("waits").await.unwrap().state(), JobState::Running);
        drop(occupied);
        jobs.success("waits").await;
        assert_eq!(held(&server, "waiting_solves").await, 0);
    });
}

/// The small window with `blind` cameras more that see nothing.
fn with_blind_cameras(blind: usize) -> Vec<u8> {
    let text = String::from_utf8(twin(BUNDLE)).unwrap();
    let mut lines: Vec<String> = text.lines().map(str::to_owned).collect();
    lines[0] = format!("{} 80 362", 6 + blind);
    let camera = "0 0 0 0 0 0 500 0 0".replace(' ', "\n");
    let at = 1 + 362 + 6 * 9;
    lines.splice(at..at, std::iter::repeat_n(camera, blind));
    lines.join("\n").into_bytes()
}

#[test]
fn many_reconstructions_with_many_unplaced_keyframes_make_a_job_that_can_be_answered() {
    run(async {
        let folder = tempfile::tempdir().unwrap();
        let server = server_of(folder.path()).await;
        let jobs = Jobs::of(&server);
        let names: Vec<String> = (0..8).map(|k| format!("scene-{k}.txt")).collect();
        let files: Vec<_> =
            names.iter().map(|name| (name.as_str(), with_blind_cameras(1_200))).collect();
        let upload_id = jobs.upload(&files).await.unwrap();
        let spec = v1::ReconstructSpec { upload_id, ..Default::default() };
        jobs.create("night", Spec::Reconstruct(spec)).await.unwrap();
        // Progress is shown only.
        let ended = v1::Job { progress: None, ..jobs.success("night").await };
        let is_answered = |job: v1::Job| v1::Job { progress: None, ..job } == ended;
        assert!(ended.encoded_len() <= ANSWER_BYTES, "{}", ended.encoded_len());
        let Some(Kind::Reconstruct(result)) = ended.result.clone().unwrap().result else {
            panic!("{ended:?}")
        };
        assert_eq!(result.problems.len(), 8);
        let found = |problem: &v1::SolvedProblem| problem.reconstruction.clone().unwrap();
        let unplaced =
            |found: v1::Reconstruction| found.keyframe_count - found.placed_keyframe_count;
        let all: i64 = result.problems.iter().map(|problem| unplaced(found(problem))).sum();
        assert!(all >= 8 * 1_200, "{all}");
        let list = &ended.shortened_lists[0];
        let field = "result.reconstruct.problems.reconstruction.unplaced_keyframes";
        assert_eq!((list.field_path.as_str(), list.entry_count), (field, all));
        // The file has all of them.
        assert_eq!(list.file_path, "report.json");
        let report = jobs.report("night").await;
        let listed = report["problems"].as_array().unwrap().iter();
        let listed: usize =
            listed.map(|of| of["rebuilt"]["unplaced"].as_array().unwrap().len()).sum();
        assert_eq!(listed as i64, all);
        let sum: f64 = result.problems.iter().map(|p| p.summary.as_ref().unwrap().final_cost).sum();
        assert_eq!(ended.cost_after.unwrap().to_bits(), sum.to_bits());
        assert!(is_answered(jobs.get("night").await.unwrap()));
        let listed = jobs.list(Default::default()).await.unwrap().jobs;
        assert!(listed.len() == 1 && listed.into_iter().all(is_answered));
        server.running.shutdown().await;
        let server = server_of(folder.path()).await;
        assert!(is_answered(Jobs::of(&server).get("night").await.unwrap()));
        server.running.shutdown().await;
    });
}

/// A record as an earlier version wrote it, of whatever length.
async fn write_record(data: &Path, number: i64, job: &v1::Job) {
    let store = FileStore::open(data, FileStoreOptions::default()).await.unwrap();
    let record = JobRecord {
        tenant: String::new(),
        job_id: job.job_id.clone(),
        number,
        job: job.encode_to_vec(),
        done: Vec::new(),
    };
    let mut uid = [7; 16];
    uid[0] = u8::try_from(number).unwrap();
    store.job_files().write_record(&uid, &record).unwrap();
}

/// A job that solved `problems` problems, each with a list of 1,000 keyframes, and made as many files.
fn long_job(job_id: &str, problems: usize) -> v1::Job {
    let unplaced = |id| v1::UnplacedKeyframe {
        id,
        reason: "it shares fewer landmarks than needed with those that are placed".to_owned(),
        ..Default::default()
    };
    let problem = |index| v1::SolvedProblem {
        path: format!("{index}.txt"),
        summary: Some(v1::SolveSummary { final_cost: 1.0, ..Default::default() }),
        reconstruction: Some(v1::Reconstruction {
            keyframe_count: 1_200,
            unplaced_keyframes: (0..1_000).map(unplaced).collect(),
            ..Default::default()
        }),
    };
    let result = v1::ReconstructResult {
        problems: (0..problems).map(problem).collect(),
        ..Default::default()
    };
    let spec = v1::ReconstructSpec { upload_id: "0".repeat(32), ..Default::default() };
    let time = |seconds| Some(prost_types::Timestamp { seconds, nanos: 0 });
    v1::Job {
        job_id: job_id.to_owned(),
        spec: Some(v1::JobSpec { spec: Some(Spec::Reconstruct(spec)) }),
        state: JobState::Succeeded.into(),
        result: Some(v1::JobResult { result: Some(Kind::Reconstruct(result)) }),
        files: (0..=problems)
            .map(|index| v1::JobFile { path: format!("{index:0>1000}"), size_bytes: 0 })
            .collect(),
        create_time: time(1),
        end_time: time(2),
        expire_time: time(4_000_000_000),
        ..Default::default()
    }
}

#[test]
fn records_that_an_earlier_version_wrote_too_long_are_listed_cut() {
    run(async {
        let folder = tempfile::tempdir().unwrap();
        for number in 1..=6 {
            let job = long_job(&format!("night-{number}"), 100);
            assert!(job.encoded_len() > 4 << 20);
            write_record(folder.path(), number, &job).await;
        }
        let server =
            TestServer::with(|config| config.data_dir = Some(folder.path().to_owned())).await;
        let jobs = Jobs::of(&server);
        for number in 1..=6 {
            let job_id = format!("night-{number}");
            let job = jobs.get(&job_id).await.unwrap();
            assert!(job.encoded_len() <= ANSWER_BYTES);
            assert_eq!(jobs.end(&job_id).await, job, "as it is watched");
            let lists: Vec<_> = job.shortened_lists.iter().map(|list| list.entry_count).collect();
            assert_eq!(lists, [101, 100 * 1_200], "files and keyframes");
        }
        // A page ends where the message is long enough, and with one job where that is asked for.
        for page_size in [0, 1] {
            let (mut found, mut page_token) = (Vec::new(), String::new());
            loop {
                let request = v1::ListJobsRequest { page_size, page_token, ..Default::default() };
                let page = jobs.list(request).await.unwrap();
                assert!(page.encoded_len() <= (1 << 20) + (64 << 10));
                assert!(page_size == 0 || page.jobs.len() == 1);
                found.extend(page.jobs.into_iter().map(|job| job.job_id));
                page_token = page.next_page_token;
                if page_token.is_empty() {
                    break;
                }
            }
            let wanted: Vec<String> = (1..=6).rev().map(|k| format!("night-{k}")).collect();
            assert_eq!(found, wanted, "{page_size}");
        }
        server.running.shutdown().await;
    });
}

#[test]
fn what_a_terminal_would_obey_is_printed_escaped() {
    let workspace = Workspace::new();
    let data = workspace.path("data");
    let name = "a\u{1b}[2J\u{9b}31m\u{202e}\rb.txt";
    let file = v1::JobFile { path: name.to_owned(), size_bytes: 5 };
    let failure =
        v1::JobFailure { code: 3, message: format!("{name}: line 1\nbad"), ..Default::default() };
    let job = v1::Job {
        state: JobState::Failed.into(),
        failure: Some(failure),
        result: None,
        files: vec![file],
        ..long_job("old", 0)
    };
    run(async { write_record(&data, 1, &job).await });
    let server = Running::start(&workspace, &data);
    for arguments in ["show old", "list", "watch old", "show old --json", "watch old --json"] {
        let ran = workspace.run(&format!("job {arguments} --server {}", server.url), &[]);
        for text in [&ran.stdout, &ran.stderr] {
            let obeyed = text.chars().find(|c| (c.is_control() && *c != '\n') || *c == '\u{202e}');
            assert_eq!(obeyed, None, "{arguments}: {text:?}");
        }
        if arguments.starts_with("show old") {
            assert!(ran.stdout.contains("a\\u001b[2J\\u009b31m\\u202e"), "{}", ran.stdout);
        }
    }
    let shown = workspace.run(&format!("job show old --server {}", server.url), &[]).stdout;
    assert!(shown.contains("line 1\\u000abad"), "{shown}");
    let json = workspace.json(&format!("job show old --json --server {}", server.url), &[]);
    assert_eq!(json["files"][0]["path"], name, "the same characters");
}

#[test]
fn a_name_for_people_has_no_characters_that_terminals_obey() {
    run(async {
        let server = TestServer::start().await;
        let create = async |display_name: &str| {
            let request = v1::CreateMapRequest {
                map_id: "house".to_owned(),
                display_name: display_name.to_owned(),
                ..Default::default()
            };
            server.maps().create_map(request).await
        };
        for bad in ["a\u{1b}]0;b", "a\nb", "a\u{9b}b", "a\u{202e}b"] {
            check_field(&create(bad).await.unwrap_err(), "display_name", "OUT_OF_RANGE");
        }
        create("Haus – 家").await.unwrap();
    });
}

#[test]
fn a_page_of_maps_ends_where_the_message_is_long_enough() {
    run(async {
        let server = TestServer::start().await;
        for map_id in ["a", "b", "c"] {
            server.create_map(map_id).await;
        }
        // A client of a map is some 100 bytes of the answer: two maps are more than a page.
        for map_id in ["a", "b"] {
            for number in 0..7_000 {
                let (stream, _) = Stream::open(&server, map_id, &format!("{number:0>63}"), 0).await;
                stream.finish().await.unwrap();
            }
        }
        let (mut found, mut page_token, mut pages) = (Vec::new(), String::new(), 0);
        loop {
            let request = v1::ListMapsRequest { page_token, ..Default::default() };
            let page = server.maps().list_maps(request).await.unwrap().into_inner();
            assert!(page.encoded_len() <= (1 << 20) + (64 << 10), "{}", page.encoded_len());
            found.extend(page.maps.into_iter().map(|map| map.map_id));
            pages += 1;
            page_token = page.next_page_token;
            if page_token.is_empty() {
                break;
            }
        }
        assert_eq!((found.join(" ").as_str(), pages > 1), ("a b c", true));
    });
}
