//! Jobs over restarts: of a server that drains, of one that is killed, with files that are damaged, of a
//! later version, or not ours.

use std::path::{Path, PathBuf};

use covis::client::Client;
use covis::wire::v1;
use tonic::Code;
use v1::JobState;

use crate::cli_support::{Port, Running, Workspace};
use crate::common::{TestServer, check_status, occupy, run};
use crate::job_support::{
    BUNDLE, GRAPH, Jobs, export, optimize, solve, state_hash, twin, unsolved_map,
};

async fn server(path: &Path, fault: Option<&str>) -> TestServer {
    TestServer::with(|config| {
        config.data_dir = Some(path.to_owned());
        config.test_fault = fault.map(str::to_owned);
    })
    .await
}

/// The record of the only job, or of the last one by time.
fn records(path: &Path) -> Vec<PathBuf> {
    let folders = fs_err::read_dir(path.join("jobs")).unwrap();
    let files = folders.map(|folder| folder.unwrap().path().join("job"));
    files.filter(|file| file.is_file()).collect()
}

#[test]
fn what_waits_and_what_runs_goes_on_after_a_drain() {
    run(async {
        let folder = tempfile::tempdir().unwrap();
        let first = server(folder.path(), Some("hold-jobs")).await;
        let jobs = Jobs::of(&first);
        unsolved_map(&first, "house", 4).await;
        unsolved_map(&first, "shed", 4).await;
        jobs.create("runs", optimize("house")).await.unwrap();
        jobs.until("runs", |job| job.state() == JobState::Running).await;
        jobs.create("waits", optimize("shed")).await.unwrap();
        let before = state_hash(&first, "house").await;
        let mut watched = jobs.watch("waits").await.unwrap();
        watched.message().await.unwrap();
        let ends = tokio::spawn(async move {
            loop {
                if let Err(status) = watched.message().await {
                    return status;
                }
            }
        });
        first.running.shutdown().await;
        check_status(&ends.await.unwrap(), Code::Unavailable, "DRAINING");

        let second = server(folder.path(), None).await;
        let jobs = Jobs::of(&second);
        let job = jobs.success("runs").await;
        assert_eq!(job.attempt_count, 2);
        assert_ne!(state_hash(&second, "house").await, before);
        assert_eq!(jobs.success("waits").await.attempt_count, 1);
        second.running.shutdown().await;

        // Ended jobs are there with their results.
        let third = server(folder.path(), None).await;
        let jobs = Jobs::of(&third);
        let again = jobs.get("runs").await.unwrap();
        assert_eq!((again.cost_after, again.result), (job.cost_after, job.result));
        assert!(jobs.report("runs").await["final_cost"].is_number());
        let list = jobs.list(Default::default()).await.unwrap();
        let ids: Vec<_> = list.jobs.iter().map(|job| job.job_id.as_str()).collect();
        assert_eq!(ids, ["waits", "runs"]);
        // Numbers go on: a newer job is listed first.
        jobs.create("new", export("house", v1::MapFormat::Tum)).await.unwrap();
        jobs.success("new").await;
        assert_eq!(jobs.list(Default::default()).await.unwrap().jobs[0].job_id, "new");
        third.running.shutdown().await;
    });
}

#[test]
fn a_cancel_survives_the_server_that_took_it() {
    run(async {
        let folder = tempfile::tempdir().unwrap();
        let first = server(folder.path(), None).await;
        let jobs = Jobs::of(&first);
        unsolved_map(&first, "house", 4).await;
        let before = state_hash(&first, "house").await;
        let occupied = occupy(&first).await;
        jobs.create("gone", optimize("house")).await.unwrap();
        jobs.until("gone", |job| job.state() == JobState::Running).await;
        jobs.cancel("gone").await.unwrap();
        assert_eq!(jobs.end("gone").await.state(), JobState::Cancelled);
        drop(occupied);
        first.running.shutdown().await;
        let second = server(folder.path(), None).await;
        assert_eq!(Jobs::of(&second).get("gone").await.unwrap().state(), JobState::Cancelled);
        assert_eq!(state_hash(&second, "house").await, before);
        second.running.shutdown().await;
    });
}

#[test]
fn damaged_later_and_foreign_files_are_confined_and_left_alone() {
    run(async {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path();
        let first = server(path, None).await;
        let jobs = Jobs::of(&first);
        unsolved_map(&first, "house", 2).await;
        for id in ["damaged", "later"] {
            jobs.create(id, export("house", v1::MapFormat::Tum)).await.unwrap();
            jobs.success(id).await;
        }
        first.running.shutdown().await;
        let find = |name: &str| {
            let holds = |file: &PathBuf| {
                let bytes = fs_err::read(file).unwrap();
                bytes.windows(name.len()).any(|window| window == name.as_bytes())
            };
            records(path).into_iter().find(holds).unwrap()
        };
        let (damaged, later) = (find("damaged"), find("later"));
        let mut bytes = fs_err::read(&damaged).unwrap();
        let middle = bytes.len() / 2;
        bytes[middle] ^= 1;
        fs_err::write(&damaged, &bytes).unwrap();
        // A field that is not known here, behind a checksum that fits.
        let mut bytes = fs_err::read(&later).unwrap();
        let body = bytes[48..bytes.len() - 4].to_vec();
        bytes.truncate(48);
        bytes.extend(body.iter().chain(&[0xf8, 0x07, 1]));
        let length = (body.len() + 3) as u64;
        bytes[40..48].copy_from_slice(&length.to_le_bytes());
        let crc = crc32c::crc32c(&bytes);
        bytes.extend(crc.to_le_bytes());
        fs_err::write(&later, &bytes).unwrap();
        let stray = path.join("jobs/notes.txt");
        fs_err::write(&stray, "mine").unwrap();
        let kept: Vec<Vec<u8>> = [&damaged, &later, &stray]
            .into_iter()
            .map(|file| fs_err::read(file).unwrap())
            .collect();

        let second = server(path, None).await;
        let jobs = Jobs::of(&second);
        assert_eq!(jobs.list(Default::default()).await.unwrap().jobs, []);
        check_status(&jobs.get("damaged").await.unwrap_err(), Code::NotFound, "JOB_NOT_FOUND");
        let tum = || export("house", v1::MapFormat::Tum);
        let status = jobs.create("later", tum()).await.unwrap_err();
        check_status(&status, Code::AlreadyExists, "JOB_EXISTS");
        jobs.create("fresh", tum()).await.unwrap();
        jobs.success("fresh").await;
        second.running.shutdown().await;
        for (file, bytes) in [&damaged, &later, &stray].into_iter().zip(kept) {
            assert_eq!(fs_err::read(file).unwrap(), bytes, "{file:?}");
        }
    });
}

#[test]
fn a_result_that_is_damaged_on_disk_is_not_given_out() {
    run(async {
        let folder = tempfile::tempdir().unwrap();
        let first = server(folder.path(), None).await;
        let jobs = Jobs::of(&first);
        unsolved_map(&first, "house", 2).await;
        jobs.create("a", export("house", v1::MapFormat::Tum)).await.unwrap();
        jobs.success("a").await;
        let report = records(folder.path())[0].with_file_name("0000000000.out");
        let mut bytes = fs_err::read(&report).unwrap();
        bytes[60] ^= 1;
        fs_err::write(&report, &bytes).unwrap();
        let status = jobs.download("a", "report.json").await.unwrap_err();
        check_status(&status, Code::Internal, "STORE_FAILED");
        assert!(!status.message().contains('/'), "{status}");
        first.running.shutdown().await;
    });
}

/// Starts the real server, with a fault of the tests.
pub(crate) fn spawn(workspace: &Workspace, folder: &Path, fault: &str) -> Running {
    let mut command = workspace.command();
    if !fault.is_empty() {
        command.env("COVIS_TEST_FAULT", fault);
    }
    Running::spawn(command, Port::reserve(), folder, &[])
}

#[cfg(unix)]
#[test]
fn kill_9_in_each_state_loses_no_job() {
    run(async {
        let workspace = Workspace::new();
        let folder = workspace.path("data");
        let map = crate::cli_support::golden("twins/sphere-200.g2o");
        let mut held = spawn(&workspace, &folder, "hold-jobs");
        let url = held.url.clone();
        workspace.json(&format!("map import grid {{}} --server {url} --json"), &[&map]);
        let submit = |id: &str, url: &str| {
            let arguments = format!(
                "job submit optimize-pose-graph --map grid --id {id} --server {url} --json"
            );
            workspace.json(&arguments, &[])
        };
        let ended = workspace.json(
            &format!("job submit export --map grid --format tum --id ended --server {url} --json"),
            &[],
        );
        assert_ne!(ended["state"], "succeeded");
        let client = Client::connect(&url).await.unwrap();
        let job = client.cancel_job("ended").await.unwrap();
        assert!(job.cancel_requested);
        let job = client.watch_job("ended", |_| {}).await.unwrap();
        assert_eq!(job.state(), JobState::Cancelled);
        submit("runs", &url);
        loop {
            if client.job("runs").await.unwrap().state() == JobState::Running {
                break;
            }
            tokio::task::yield_now().await;
        }
        let waits = format!("job submit export --map grid --format tum --id waits --server {url}");
        assert_eq!(workspace.run(&waits, &[]).code, Some(0));
        held.kill();
        let mut server = spawn(&workspace, &folder, "");
        let client = Client::connect(&server.url).await.unwrap();
        assert_eq!(client.job("ended").await.unwrap().state(), JobState::Cancelled);
        let runs = client.watch_job("runs", |_| {}).await.unwrap();
        assert_eq!((runs.state(), runs.attempt_count), (JobState::Succeeded, 2));
        let waits = client.watch_job("waits", |_| {}).await.unwrap();
        assert_eq!((waits.state(), waits.attempt_count), (JobState::Succeeded, 1));
        // Killed after their ends, they are what they were.
        server.kill();
        let server = spawn(&workspace, &folder, "");
        let client = Client::connect(&server.url).await.unwrap();
        let again = client.job("runs").await.unwrap();
        assert_eq!((again.cost_after, again.files), (runs.cost_after, runs.files));
    });
}

#[cfg(unix)]
#[test]
fn a_problem_that_was_solved_before_kill_9_is_not_solved_again() {
    run(async {
        let workspace = Workspace::new();
        let folder = workspace.path("data");
        let problems = workspace.path("problems");
        fs_err::create_dir(&problems).unwrap();
        fs_err::write(problems.join("a.txt"), twin(BUNDLE)).unwrap();
        fs_err::write(problems.join("b.g2o"), twin(GRAPH)).unwrap();
        let undisturbed = {
            let server = spawn(&workspace, &workspace.path("other"), "");
            let arguments =
                format!("job submit solve --file {{}} --wait --json --server {}", server.url);
            workspace.json(&arguments, &[&problems])
        };
        let mut held = spawn(&workspace, &folder, "hold-problems");
        let arguments =
            format!("job submit solve --file {{}} --id two --json --server {}", held.url);
        workspace.json(&arguments, &[&problems]);
        let client = Client::connect(&held.url).await.unwrap();
        loop {
            let progress = client.job("two").await.unwrap().progress.unwrap_or_default();
            if progress.phase == "held by a test" {
                break;
            }
            tokio::task::yield_now().await;
        }
        held.kill();
        let server = spawn(&workspace, &folder, "");
        let client = Client::connect(&server.url).await.unwrap();
        let mut phases = Vec::new();
        let job = client
            .watch_job("two", |job| {
                phases.extend(job.progress.as_ref().map(|progress| progress.phase.clone()));
            })
            .await
            .unwrap();
        assert_eq!(job.state(), JobState::Succeeded, "{job:?}");
        assert!(!phases.iter().any(|phase| phase.contains("a.txt")), "{phases:?}");
        let cost = undisturbed["cost_after"].as_f64().unwrap();
        assert_eq!(job.cost_after.unwrap().to_bits(), cost.to_bits());
        let shown = workspace.json(&format!("job show two --json --server {}", server.url), &[]);
        for index in 0..2 {
            for key in ["final_cost", "path", "termination"] {
                let pick = |document: &serde_json::Value| {
                    document["report"]["problems"][index][key].clone()
                };
                assert_eq!(pick(&shown), pick(&undisturbed), "{index} {key}");
            }
        }
    });
}

#[cfg(unix)]
#[test]
fn a_solve_that_kill_9_cuts_off_goes_on_from_its_checkpoint_to_the_same_bits() {
    run(async {
        let workspace = Workspace::new();
        let folder = workspace.path("data");
        let problem = crate::cli_support::golden("twins").join(BUNDLE);
        let undisturbed = {
            let server = spawn(&workspace, &workspace.path("other"), "");
            let arguments =
                format!("job submit solve --file {{}} --wait --json --server {}", server.url);
            workspace.json(&arguments, &[&problem])
        };
        let mut held = spawn(&workspace, &folder, "hold-checkpoint");
        let arguments =
            format!("job submit solve --file {{}} --id one --json --server {}", held.url);
        workspace.json(&arguments, &[&problem]);
        let client = Client::connect(&held.url).await.unwrap();
        let at = loop {
            let progress = client.job("one").await.unwrap().progress.unwrap_or_default();
            if progress.phase == "held by a test" {
                break progress.iteration.unwrap().iteration;
            }
            tokio::task::yield_now().await;
        };
        assert!(at >= 3);
        held.kill();
        let server = spawn(&workspace, &folder, "");
        let client = Client::connect(&server.url).await.unwrap();
        let mut seen = Vec::new();
        let job = client
            .watch_job("one", |job| {
                let row = job.progress.as_ref().and_then(|progress| progress.iteration);
                seen.extend(row.map(|row| row.iteration));
            })
            .await
            .unwrap();
        assert_eq!((job.state(), job.attempt_count), (JobState::Succeeded, 2), "{job:?}");
        assert!(seen.iter().all(|&iteration| iteration > at), "{seen:?} after {at}");
        let cost = undisturbed["cost_after"].as_f64().unwrap();
        assert_eq!(job.cost_after.unwrap().to_bits(), cost.to_bits());
        let shown = workspace.json(&format!("job show one --json --server {}", server.url), &[]);
        let costs = |document: &serde_json::Value| -> Vec<u64> {
            let rows = document["report"]["iterations"].as_array().unwrap();
            rows.iter().map(|row| row["cost"].as_f64().unwrap().to_bits()).collect()
        };
        assert_eq!(costs(&shown), costs(&undisturbed), "every iteration, once");
        for key in ["initial_cost", "final_cost", "termination", "gradient_max_norm"] {
            assert_eq!(shown["report"][key], undisturbed["report"][key], "{key}");
        }
    });
}

#[test]
fn an_upload_survives_a_restart_and_serves_one_job() {
    run(async {
        let folder = tempfile::tempdir().unwrap();
        let first = server(folder.path(), None).await;
        let upload = Jobs::of(&first).upload(&[(GRAPH, twin(GRAPH))]).await.unwrap();
        first.running.shutdown().await;
        let second = server(folder.path(), None).await;
        let jobs = Jobs::of(&second);
        jobs.create("a", solve(&upload)).await.unwrap();
        jobs.success("a").await;
        let status = jobs.create("b", solve(&upload)).await.unwrap_err();
        check_status(&status, Code::NotFound, "UPLOAD_NOT_FOUND");
        jobs.create("a", solve(&upload)).await.unwrap();
        second.running.shutdown().await;
    });
}
