//! Workers: processes that solve the jobs of servers, killed, paused and canceled.

use std::io::{BufRead, BufReader};
use std::path::{Path, PathBuf};
use std::process::Stdio;
use std::time::{Duration, Instant};

use covis::client::Client;
use covis::store::{
    FileStore, FileStoreOptions, ReplicatedStore, ReplicationOptions, TaskState, WorkerLink,
};
use covis::wire::v1;
use covis_solvers::testing::data;
use serde_json::Value;
use v1::JobState;

use super::nats::Nats;
use super::rounds;
use crate::cli_support::{Ran, Running, Workspace, golden};
use crate::common::run;
use crate::job_support::{BUNDLE, GRAPH, twin};
use crate::process::Process;
#[cfg(unix)]
use crate::process::Signal;

/// A worker of its own process.
struct Worker(Process);

impl Worker {
    /// A worker with one thread, and where its log goes; `fault` is one that it commits.
    fn start(nats: &Nats, workspace: &Workspace, fault: &str, log: Stdio) -> Self {
        let mut command = workspace.command();
        command.args(["worker", "--threads", "1", "--nats", &nats.urls(), "--lease-seconds", "2"]);
        command.args(["--nats-monitoring", &nats.monitoring(), "--nats-replicas", "1"]);
        command.args(["--log-format", "json"]);
        command.env("COVIS_TEST_FAULT", fault).stdout(Stdio::piped()).stderr(log);
        let mut child = Process::spawn(&mut command);
        let mut lines = BufReader::new(child.stdout.take().unwrap()).lines();
        assert_eq!(lines.next().unwrap().unwrap(), "waiting for tasks, with 1 threads");
        Self(child)
    }

    fn kill(mut self) {
        self.0.end();
    }

    #[cfg(unix)]
    fn signal(&self, signal: Signal) {
        self.0.signal(signal);
    }
}

/// A covis server with a NATS server, and a problem for workers.
struct Scene {
    server: Running,
    problem: PathBuf,
    workspace: Workspace,
    nats: Nats,
}

impl Scene {
    /// `None` where there is no NATS.
    fn start(problem: PathBuf) -> Option<Self> {
        let (nats, workspace) = (Nats::start(1, true)?, Workspace::new());
        Some(Self { server: nats.covis(&workspace, "a"), problem, workspace, nats })
    }

    async fn client(&self) -> Client {
        Client::connect(&self.server.url).await.unwrap()
    }

    /// A worker with one thread; `fault` is one that it commits.
    fn worker(&self, fault: &str) -> Worker {
        Worker::start(&self.nats, &self.workspace, fault, Stdio::null())
    }

    /// Submits the problem as a job.
    fn submit(&self, id: &str) {
        let url = &self.server.url;
        let arguments = format!("job submit solve --file {{}} --id {id} --json --server {url}");
        self.workspace.json(&arguments, &[&self.problem]);
    }

    /// Submits the problem and waits until its worker holds it; the iteration then.
    async fn submit_held(&self, client: &Client, id: &str) -> i32 {
        self.submit(id);
        until_held(client, id).await
    }

    /// What a server without workers makes of the problem.
    fn undisturbed(&self) -> Value {
        let alone = Running::start(&self.workspace, &self.workspace.path("alone"));
        let arguments =
            format!("job submit solve --file {{}} --wait --json --server {}", alone.url);
        self.workspace.json(&arguments, &[&self.problem])
    }

    /// Compares a job with an undisturbed one: every number of every iteration, bit by bit.
    fn check_same(&self, id: &str, undisturbed: &Value) {
        let arguments = format!("job show {id} --json --server {}", self.server.url);
        let shown = self.workspace.json(&arguments, &[]);
        assert_eq!(shown["state"], "succeeded", "{shown}");
        let bits = |value: &Value| value.as_f64().unwrap().to_bits();
        for key in ["cost_before", "cost_after"] {
            assert_eq!(bits(&shown[key]), bits(&undisturbed[key]), "{key}");
        }
        let rows = |document: &Value| -> Vec<[u64; 3]> {
            let rows = document["report"]["iterations"].as_array().unwrap().clone();
            let numbers = ["cost", "damping", "gradient_max_norm"];
            rows.iter().map(|row| numbers.map(|key| bits(&row[key]))).collect()
        };
        assert_eq!(rows(&shown), rows(undisturbed), "every iteration, once");
        for key in ["initial_cost", "final_cost", "termination", "gradient_max_norm"] {
            assert_eq!(shown["report"][key], undisturbed["report"][key], "{key}");
        }
    }
}

/// Waits until a worker holds a job; its iteration then.
async fn until_held(client: &Client, id: &str) -> i32 {
    loop {
        let job = client.job(id).await.unwrap();
        assert!(job.end_time.is_none(), "{job:?}");
        let progress = job.progress.unwrap_or_default();
        if progress.phase == "held by a test" {
            return progress.iteration.map_or(0, |row| row.iteration);
        }
        tokio::task::yield_now().await;
    }
}

/// Waits for the success of a job that went on from iteration `at`.
async fn ends_after(client: &Client, id: &str, at: i32) -> v1::Job {
    let mut seen = Vec::new();
    let ended = client.watch_job(id, |job| {
        let row = job.progress.as_ref().and_then(|progress| progress.iteration);
        seen.extend(row.map(|row| row.iteration));
    });
    let job = ended.await.unwrap();
    assert_eq!(job.state(), JobState::Succeeded, "{job:?}");
    assert!(seen.iter().all(|&iteration| iteration >= at), "{seen:?} after {at}");
    job
}

#[test]
fn a_solve_of_a_worker_that_is_killed_goes_on_at_another_one_to_the_same_bits() {
    let Some(scene) = Scene::start(golden("twins").join(BUNDLE)) else { return };
    let undisturbed = scene.undisturbed();
    run(async {
        let client = scene.client().await;
        for round in 0..rounds() {
            let id = format!("round-{round}");
            let held = scene.worker("hold-checkpoint");
            let at = scene.submit_held(&client, &id).await;
            assert!(at >= 3, "{at}");
            let _other = scene.worker("");
            held.kill();
            let job = ends_after(&client, &id, at).await;
            assert_eq!(job.attempt_count, 1, "the server itself began it once: {job:?}");
            scene.check_same(&id, &undisturbed);
        }
    });
}

#[test]
fn a_job_whose_last_worker_is_killed_goes_on_at_its_server_to_the_same_bits() {
    let Some(scene) = Scene::start(golden("twins").join(BUNDLE)) else { return };
    let undisturbed = scene.undisturbed();
    run(async {
        let client = scene.client().await;
        // Without any worker, too.
        scene.submit("alone");
        assert_eq!(client.watch_job("alone", |_| {}).await.unwrap().state(), JobState::Succeeded);
        let held = scene.worker("hold-checkpoint");
        let at = scene.submit_held(&client, "left").await;
        held.kill();
        ends_after(&client, "left", at).await;
        for id in ["alone", "left"] {
            scene.check_same(id, &undisturbed);
        }
    });
}

#[test]
fn what_a_worker_hands_in_while_the_server_is_killed_is_applied_at_its_next_start() {
    let Some(mut scene) = Scene::start(golden("twins").join(BUNDLE)) else { return };
    let undisturbed = scene.undisturbed();
    run(async {
        let client = scene.client().await;
        let held = scene.worker("hold-checkpoint");
        scene.submit_held(&client, "one").await;
        scene.server.kill();
        // Done by a worker that ends when no task is left.
        held.kill();
        let other = scene.worker("");
        while !super::streams::has_result(&scene.nats.urls()).await {
            tokio::task::yield_now().await;
        }
        other.kill();
        scene.server = scene.nats.covis(&scene.workspace, "a");
        let client = scene.client().await;
        let mut phases = Vec::new();
        let job = client
            .watch_job("one", |job| {
                phases.extend(job.progress.as_ref().map(|progress| progress.phase.clone()));
            })
            .await
            .unwrap();
        assert_eq!((job.state(), job.attempt_count), (JobState::Succeeded, 2), "{job:?}");
        assert!(!phases.iter().any(|phase| phase.contains("solves")), "{phases:?}");
        scene.check_same("one", &undisturbed);
        // Nothing of it is left in NATS once it is in the record.
        while super::streams::has_tasks(&scene.nats.urls()).await {
            tokio::task::yield_now().await;
        }
    });
}

#[test]
fn a_cancel_reaches_the_worker_which_is_free_for_the_next_task() {
    let Some(scene) = Scene::start(golden("twins").join(BUNDLE)) else { return };
    run(async {
        let client = scene.client().await;
        let _held = scene.worker("hold-checkpoint");
        scene.submit_held(&client, "first").await;
        let begin = Instant::now();
        client.cancel_job("first").await.unwrap();
        let job = client.watch_job("first", |_| {}).await.unwrap();
        assert_eq!(job.state(), JobState::Cancelled);
        println!("canceled after {:?}", begin.elapsed());
        // The only worker holds each task until it is canceled.
        scene.submit_held(&client, "second").await;
    });
}

#[cfg(unix)]
#[test]
fn a_worker_that_is_paused_past_its_lease_loses_its_task_and_takes_the_next_one() {
    let Some(scene) = Scene::start(golden("twins").join(BUNDLE)) else { return };
    let undisturbed = scene.undisturbed();
    run(async {
        let client = scene.client().await;
        let paused = scene.worker("hold-checkpoint");
        scene.submit_held(&client, "first").await;
        paused.signal(Signal::STOP);
        let other = scene.worker("");
        let job = client.watch_job("first", |_| {}).await.unwrap();
        assert_eq!(job.state(), JobState::Succeeded, "{job:?}");
        scene.check_same("first", &undisturbed);
        paused.signal(Signal::CONT);
        other.kill();
        // It holds its first task until it learns that it is its own no more.
        scene.submit_held(&client, "second").await;
    });
}

#[test]
fn a_file_that_a_worker_cannot_read_fails_as_it_does_at_a_server() {
    let Some(nats) = Nats::start(1, true) else { return };
    let workspace = Workspace::new();
    let problems = workspace.path("problems");
    fs_err::create_dir(&problems).unwrap();
    fs_err::write(problems.join("a.g2o"), twin(GRAPH)).unwrap();
    fs_err::write(problems.join("b.txt"), "1 1 1\n0 0 nothing\n").unwrap();
    let server = nats.covis(&workspace, "a");
    let fails = |url: &str, id: &str| {
        let arguments = format!("job submit solve --file {{}} --id {id} --wait --server {url}");
        assert_eq!(workspace.run(&arguments, &[&problems]).code, Some(1));
    };
    run(async {
        let client = Client::connect(&server.url).await.unwrap();
        fails(&server.url, "here");
        let _worker = Worker::start(&nats, &workspace, "", Stdio::null());
        fails(&server.url, "there");
        let here = client.job("here").await.unwrap().failure.unwrap();
        let there = client.job("there").await.unwrap().failure.unwrap();
        assert!(here.message.contains("b.txt"), "{here:?}");
        assert_eq!(there, here);
    });
}

#[test]
fn a_worker_without_nats_says_what_it_needs() {
    let workspace = Workspace::new();
    let ran = Ran::of(workspace.command().arg("worker").output().unwrap());
    ran.expect_failure(&["--nats"]);
}

/// When each worker took a task and had done it, seconds, from its log.
fn spans(log: &Path) -> Vec<[f64; 2]> {
    let text = fs_err::read_to_string(log).unwrap();
    let lines = text.lines().map(|line| serde_json::from_str::<Value>(line).unwrap());
    let (mut spans, mut begin) = (Vec::new(), 0.0);
    for line in lines {
        let time = line["timestamp"].as_str().unwrap().parse::<prost_types::Timestamp>().unwrap();
        let time = time.seconds as f64 + f64::from(time.nanos) * 1e-9;
        match line["message"].as_str().unwrap() {
            "a task was taken" => begin = time,
            "a task is done" => spans.push([begin, time]),
            _ => {}
        }
    }
    spans
}

/// How long `workers` take for the tasks in their order, each with a pause before it.
fn schedule(tasks: &[f64], pause: f64, workers: usize) -> f64 {
    let mut free = vec![0.0_f64; workers];
    for task in tasks {
        let next = free.iter_mut().min_by(|a, b| a.total_cmp(b)).unwrap();
        *next += pause + task;
    }
    free.into_iter().fold(0.0, f64::max)
}

/// `COVIS_TEST_WORKER_JOBS` says how many jobs; it measures on an idle machine with some tens.
#[test]
fn equal_jobs_are_shared_by_workers() {
    let Some(problem) = data("bal/ladybug-49-7776.txt") else { return };
    let Some(scene) = Scene::start(problem) else { return };
    let jobs = std::env::var("COVIS_TEST_WORKER_JOBS");
    let jobs = jobs.ok().map_or(3, |jobs| jobs.parse::<usize>().unwrap());
    let mut took = Vec::new();
    run(async {
        let client = scene.client().await;
        for count in 1..=2 {
            let log = |index: usize| scene.workspace.path(&format!("worker-{count}-{index}.log"));
            let logged = |index| {
                let log = std::fs::File::create(log(index)).unwrap();
                Worker::start(&scene.nats, &scene.workspace, "", log.into())
            };
            let workers: Vec<_> = (0..count).map(logged).collect();
            for job in 0..jobs {
                scene.submit(&format!("of-{count}-{job}"));
            }
            for job in 0..jobs {
                let id = format!("of-{count}-{job}");
                let job = client.watch_job(&id, |_| {}).await.unwrap();
                assert_eq!(job.state(), JobState::Succeeded, "{job:?}");
            }
            drop(workers);
            took.push((0..count).map(|index| spans(&log(index))).collect::<Vec<_>>());
            let done: usize = took[count - 1].iter().map(Vec::len).sum();
            assert_eq!(done, jobs, "each is done by one worker");
        }
    });
    // From the first task to the last; submitting is no part of it.
    let whole = |spans: &[Vec<[f64; 2]>]| {
        let all = || spans.iter().flatten();
        let begin = all().map(|span| span[0]).fold(f64::INFINITY, f64::min);
        all().map(|span| span[1]).fold(0.0, f64::max) - begin
    };
    let (one, two) = (whole(&took[0]), whole(&took[1]));
    let tasks: Vec<f64> = took[0][0].iter().map(|[begin, end]| end - begin).collect();
    let pauses = took[0][0].windows(2).map(|pair| pair[1][0] - pair[0][1]);
    let pause = pauses.sum::<f64>() / (jobs - 1) as f64;
    let of_four = schedule(&tasks, pause, 4);
    println!(
        "{jobs} jobs of {:.2} s with {pause:.3} s between two: {one:.2} s by one worker, {two:.2} s by \
         two ({:.2} a worker); by the schedule of these times {of_four:.2} s by four ({:.2} a worker)",
        tasks.iter().sum::<f64>() / jobs as f64,
        one / two / 2.0,
        one / of_four / 4.0,
    );
}

/// The settings of whoever takes part.
fn options(nats: &Nats) -> ReplicationOptions {
    ReplicationOptions {
        nats: nats.urls(),
        monitoring: vec![nats.monitoring()],
        accept_unsynced: false,
        replicas: 1,
        lease: Duration::from_secs(1),
        address: "http://localhost:1".to_owned(),
    }
}

/// Takes the next task.
async fn taken(worker: &WorkerLink) -> covis::store::ClaimedTask {
    loop {
        if let Some(taken) = worker.next().await.unwrap() {
            return taken;
        }
    }
}

#[test]
fn a_result_is_accepted_from_the_last_worker_that_took_the_task_and_once() {
    let Some(nats) = Nats::start(1, true) else { return };
    let folder = tempfile::tempdir().unwrap();
    run(async {
        let local = FileStore::open(folder.path(), FileStoreOptions::default()).await.unwrap();
        let store = ReplicatedStore::open(local, options(&nats)).await.unwrap();
        let tasks = store.tasks();
        let first = WorkerLink::open(&options(&nats)).await.unwrap();
        let second = WorkerLink::open(&options(&nats)).await.unwrap();
        tasks.put_input("a-0", 0, &mut &[7; 2_000_000][..]).await.unwrap();
        tasks.submit("a-0", b"what".to_vec()).await.unwrap();
        // Again, as after a restart: there is one task all the same.
        tasks.submit("a-0", b"what".to_vec()).await.unwrap();
        assert_eq!(tasks.state("a-0").await.unwrap(), Some(TaskState::Waiting));
        let early = taken(&first).await;
        assert_eq!((early.description(), early.attempts()), (&b"what"[..], 1));
        assert_eq!(early.input(0).await.unwrap(), vec![7; 2_000_000]);
        assert!(early.beat(b"half".to_vec()).await.unwrap());
        let state = tasks.state("a-0").await.unwrap();
        let progress = b"half".to_vec();
        assert_eq!(state, Some(TaskState::Taken { attempts: 1, progress }));
        // The first worker beats no more: the task is redelivered.
        let late = taken(&second).await;
        assert_eq!(late.attempts(), 2);
        assert!(!early.finish(b"early").await.unwrap(), "a fenced worker's result is refused");
        assert!(!early.beat(Vec::new()).await.unwrap());
        assert!(late.finish(b"late").await.unwrap());
        let Some(TaskState::Done { result }) = tasks.state("a-0").await.unwrap() else { panic!() };
        assert_eq!(tasks.result(&result).await.unwrap(), b"late");
        // It is done, which cannot be taken back.
        assert!(!tasks.withdraw("a-0").await.unwrap());
        tasks.forget("a-0", 1).await;
        assert_eq!(tasks.state("a-0").await.unwrap(), None);

        // What is taken back is accepted from nobody, also where it is submitted once more.
        tasks.submit("b-0", Vec::new()).await.unwrap();
        let early = taken(&first).await;
        assert!(tasks.withdraw("b-0").await.unwrap());
        assert!(!early.finish(b"early").await.unwrap());
        tasks.forget("b-0", 0).await;
        tasks.submit("b-0", Vec::new()).await.unwrap();
        assert!(!early.finish(b"early").await.unwrap());
        let late = taken(&second).await;
        assert!(late.finish(b"late").await.unwrap());
        // Beats expire with the workers.
        assert!(tasks.has_workers().await.unwrap());
        second.leave().await;
        drop(first);
        while tasks.has_workers().await.unwrap() {
            tokio::task::yield_now().await;
        }
    });
}
