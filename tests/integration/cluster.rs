//! Several servers that share maps over NATS: real processes of both, on loopback ports.
//!
//! `NATS_SERVER` names the program of NATS, else it is looked for in the path; the tests are skipped
//! where there is none of version 2.10 or later, or fail where `COVIS_TEST_NATS_REQUIRED` is 1.
//! `COVIS_TEST_CLUSTER_ROUNDS` repeats what kills.

mod copies;
#[cfg(target_os = "linux")]
mod disk;
#[cfg(target_os = "linux")]
mod fuse;
mod leases;
mod nats;
#[cfg(target_os = "linux")]
mod power;
mod streams;
mod workers;

use std::sync::Arc;
use std::sync::atomic::{AtomicI64, Ordering};
use std::time::{Duration, Instant};

use covis::client::{Client, Credentials, IngestSession, LinkOptions, RetryPolicy, SessionOptions};
use covis::wire::v1;
use tokio::sync::Notify;

use self::nats::Nats;
use self::streams::{messages, prove_one_writer};
use crate::cli_support::{Ran, Running, Workspace};
use crate::common::{camera, run};
use crate::durable::long_keyframe;
#[cfg(unix)]
use crate::process::Signal;
use crate::proxy::Proxy;

/// How often a scenario that kills is played.
fn rounds() -> usize {
    let rounds = std::env::var("COVIS_TEST_CLUSTER_ROUNDS");
    rounds.ok().map_or(2, |rounds| rounds.parse().unwrap())
}

/// A session that does not give up, and asks often.
fn patient() -> RetryPolicy {
    let longest_delay = Duration::from_millis(500);
    RetryPolicy { max_attempts: 200, longest_delay, ..RetryPolicy::default() }
}

/// A robot that sends keyframes and remembers what was acknowledged as durable.
struct Robot {
    session: IngestSession,
    durable: Arc<AtomicI64>,
    received: Arc<AtomicI64>,
    acks: Arc<Notify>,
    sent: i64,
}

impl Robot {
    /// A robot that knows these servers, with a map of its own.
    async fn new(urls: &str) -> Self {
        let client = Client::connect(urls).await.unwrap();
        client.create_map("house", None).await.unwrap();
        let (durable, received): (Arc<AtomicI64>, Arc<AtomicI64>) = Default::default();
        let acks = Arc::new(Notify::new());
        let seen = [Arc::clone(&durable), Arc::clone(&received)];
        let notify = Arc::clone(&acks);
        let options = SessionOptions { retry: patient(), ..SessionOptions::default() };
        let options = options.on_ack(move |ack| {
            let [durable, received] = &seen;
            match ack.status() {
                v1::AckStatus::Durable => durable.fetch_max(ack.sequence, Ordering::AcqRel),
                v1::AckStatus::Received => received.fetch_max(ack.sequence, Ordering::AcqRel),
                v1::AckStatus::Unspecified | v1::AckStatus::Optimized | v1::AckStatus::Rejected => {
                    return;
                }
            };
            notify.notify_one();
        });
        let mut session = client.ingest("house", "robot", options).await.unwrap();
        assert_eq!(session.opened().durability(), v1::Durability::Replicated);
        session.send(camera(0)).await.unwrap();
        Self { session, durable, received, acks, sent: 0 }
    }

    /// Sends keyframes; sequence of the last one.
    async fn send(&mut self, count: i64) -> i64 {
        for _ in 0..count {
            // The camera has sequence 1, keyframe k sequence k + 2.
            let id = self.sent;
            self.session.send_as(id + 2, long_keyframe(id)).await.unwrap();
            self.sent += 1;
        }
        self.sent + 1
    }

    /// Waits until a sequence is accepted.
    async fn received(&self, sequence: i64) {
        while self.received.load(Ordering::Acquire) < sequence {
            self.acks.notified().await;
        }
    }

    fn durable(&self) -> i64 {
        self.durable.load(Ordering::Acquire)
    }

    /// Waits until a sequence is durable.
    async fn reach(&self, sequence: i64) {
        while self.durable() < sequence {
            self.acks.notified().await;
        }
    }
}

/// Both servers' URLs, as a client takes them.
fn both(a: &Running, b: &Running) -> String {
    format!("{},{}", a.url, b.url)
}

/// The ids of the keyframes that a server has of the map.
async fn keyframes(url: &str) -> Vec<i64> {
    let client = Client::connect(url).await.unwrap();
    let poses = client.trajectory("house", None).await.unwrap().poses;
    let mut ids: Vec<i64> = poses.into_iter().map(|pose| pose.keyframe.unwrap().id).collect();
    ids.sort_unstable();
    ids
}

/// Keeps a snapshot of the map and drops the journal before it.
fn compact(workspace: &Workspace, server: &Running) {
    let command = format!("job submit compact --map house --wait --server {}", server.url);
    let ran = workspace.run(&command, &[]);
    assert_eq!(ran.code, Some(0), "{}", ran.stderr);
}

#[test]
fn a_map_is_durable_on_disk_and_in_the_stream_and_another_server_takes_it_over() {
    let Some(nats) = Nats::start(1, true) else { return };
    let workspace = Workspace::new();
    let mut first = nats.covis(&workspace, "a");
    let second = nats.covis(&workspace, "b");
    run(async {
        let mut robot = Robot::new(&both(&first, &second)).await;
        let last = robot.send(5).await;
        robot.reach(last).await;
        // Asked for the map, the other server leads to the owner, and our client follows.
        let client = Client::connect(&second.url).await.unwrap();
        assert_eq!(client.get_map("house").await.unwrap().counts.unwrap().keyframe_count, 5);
        assert_eq!(*client.url(), *first.url);
        first.kill();
        let last = robot.send(5).await;
        robot.reach(last).await;
        assert_eq!(keyframes(&second.url).await, (0..10).collect::<Vec<_>>());
        let owners = prove_one_writer(&messages(&nats.urls()).await);
        assert_eq!(owners, 2);
        drop(robot.session.finish().await.unwrap());
    });
}

#[test]
fn a_drained_server_gives_its_maps_away_at_once() {
    let Some(nats) = Nats::start(1, true) else { return };
    let workspace = Workspace::new();
    let mut first = nats.covis_over(&nats.urls(), &workspace, "a", &["--lease-seconds", "3600"]);
    let second = nats.covis(&workspace, "b");
    run(async {
        let mut robot = Robot::new(&both(&first, &second)).await;
        let last = robot.send(5).await;
        robot.reach(last).await;
        assert_eq!(first.terminate(), Some(0));
        // The lease would last an hour.
        let last = robot.send(5).await;
        robot.reach(last).await;
        assert_eq!(keyframes(&second.url).await, (0..10).collect::<Vec<_>>());
    });
}

#[test]
fn an_earlier_state_is_restored_by_the_owner_whichever_server_is_asked() {
    let Some(nats) = Nats::start(1, true) else { return };
    let workspace = Workspace::new();
    let mut first = nats.covis(&workspace, "a");
    let second = nats.covis(&workspace, "b");
    let restore = async |url: &str, new: &str| {
        let client = Client::connect(url).await.unwrap();
        let request = v1::CopyMapRequest {
            source_map_id: "house".to_owned(),
            new_map_id: new.to_owned(),
            at: Some(v1::copy_map_request::At::Revision(4)),
            state: v1::MapState::Frozen.into(),
        };
        patient().run(|| client.copy_map(request.clone())).await
    };
    run(async {
        let mut robot = Robot::new(&both(&first, &second)).await;
        let last = robot.send(5).await;
        robot.reach(last).await;
        let made = restore(&second.url, "early").await.unwrap();
        assert_eq!((made.revision, made.map.unwrap().counts.unwrap().keyframe_count), (4, 1));
        let taken = restore(&second.url, "early").await.unwrap_err();
        assert_eq!(taken.reason().as_deref(), Some("MAP_EXISTS"));
        drop(robot.session.finish().await.unwrap());
        first.kill();
        // The other server has taken the whole stream over, which begins with the first event.
        let made = restore(&second.url, "again").await.unwrap();
        assert_eq!(made.map.unwrap().counts.unwrap().keyframe_count, 1);
        let client = Client::connect(&second.url).await.unwrap();
        let early = patient().run(|| client.get_map("early")).await.unwrap();
        assert_eq!((early.revision, early.state()), (4, v1::MapState::Frozen));
    });
}

#[test]
fn a_map_whose_journal_was_dropped_is_taken_over_from_its_snapshot() {
    let Some(nats) = Nats::start(1, true) else { return };
    let workspace = Workspace::new();
    let mut first = nats.covis(&workspace, "a");
    let second = nats.covis(&workspace, "b");
    run(async {
        let mut robot = Robot::new(&first.url).await;
        let last = robot.send(10).await;
        robot.reach(last).await;
        compact(&workspace, &first);
        let kept = messages(&nats.urls()).await;
        let first_kept = kept.first_key_value().map(|(&sequence, _)| sequence);
        assert!(first_kept.is_none_or(|first| first > 1), "nothing was purged: {kept:?}");
        // What comes behind the snapshot is in the stream alone.
        let last = robot.send(5).await;
        robot.reach(last).await;
        drop(robot.session.finish().await.unwrap());
        let client = Client::connect(&first.url).await.unwrap();
        let before = client.get_map_digests("house").await.unwrap();
        first.kill();
        let client = Client::connect(&second.url).await.unwrap();
        let after = patient().run(|| client.get_map_digests("house")).await.unwrap();
        assert_eq!((&after.0.uid, after.0.revision), (&before.0.uid, before.0.revision));
        assert_eq!(after.1, before.1, "the map that was taken over is another one");
    });
}

#[test]
fn a_nats_that_acknowledges_before_it_syncs_is_refused_unless_it_is_accepted_by_name() {
    let Some(nats) = Nats::start(1, false) else { return };
    let workspace = Workspace::new();
    let mut command = workspace.command();
    command.args(["serve", "--listen", "127.0.0.1:0", "--nats", &nats.urls()]);
    command.args(["--nats-replicas", "1", "--data-dir"]).arg(workspace.path("a"));
    let ran = Ran::of(command.output().unwrap());
    ran.expect_failure(&["monitoring addresses", "accept unsynced replicas"]);
    command.args(["--nats-monitoring", &nats.monitoring()]);
    let ran = Ran::of(command.output().unwrap());
    ran.expect_failure(&["n0", "acknowledges before it syncs", "sync_interval: always"]);
    let accepted = ["--accept-unsynced-replicas"];
    let server = nats.covis_over(&nats.urls(), &workspace, "a", &accepted);
    run(async {
        let mut robot = Robot::new(&server.url).await;
        let last = robot.send(1).await;
        robot.reach(last).await;
    });
}

#[test]
fn a_monitoring_address_is_needed_of_each_nats_server() {
    let Some(nats) = Nats::start(3, true) else { return };
    let workspace = Workspace::new();
    let (urls, monitoring) = (nats.urls(), nats.monitoring());
    let one = monitoring.split(',').next().unwrap();
    let mut command = workspace.command();
    command.args(["serve", "--listen", "127.0.0.1:0", "--nats", &urls, "--nats-monitoring", one]);
    command.arg("--data-dir").arg(workspace.path("a"));
    let ran = Ran::of(command.output().unwrap());
    ran.expect_failure(&["3 NATS servers keep streams", "are of 1"]);
}

#[test]
fn no_acknowledged_keyframe_is_lost_when_the_owner_is_killed() {
    let Some(nats) = Nats::start(3, true) else { return };
    let workspace = Workspace::new();
    let mut servers = [nats.covis(&workspace, "a"), nats.covis(&workspace, "b")];
    let mut longest = Duration::ZERO;
    run(async {
        let mut robot = Robot::new(&both(&servers[0], &servers[1])).await;
        let mut owner = 0;
        for round in 0..rounds() {
            let last = robot.send(20).await;
            robot.reach(last - 10).await;
            let acknowledged = robot.durable();
            servers[owner].kill();
            let killed = Instant::now();
            let last = robot.send(5).await;
            robot.reach(last).await;
            longest = longest.max(killed.elapsed());
            owner = 1 - owner;
            let kept = keyframes(&servers[owner].url).await;
            assert_eq!(kept, (0..robot.sent).collect::<Vec<_>>(), "round {round}");
            assert!(acknowledged <= robot.durable());
            // The server that was killed comes back where it was.
            let name = ["a", "b"][1 - owner];
            let port = servers[1 - owner].port.clone();
            servers[1 - owner] = nats.covis_at(&port, &workspace, name);
        }
        let owners = prove_one_writer(&messages(&nats.urls()).await);
        assert_eq!(owners, rounds() + 1);
    });
    println!("{} rounds, at most {longest:?} until the next ack", rounds());
}

#[test]
fn no_acknowledged_keyframe_is_lost_when_the_owner_and_all_of_nats_are_killed() {
    let Some(mut nats) = Nats::start(3, true) else { return };
    let workspace = Workspace::new();
    let mut server = nats.covis(&workspace, "a");
    run(async {
        let mut robot = Robot::new(&server.url).await;
        for round in 0..rounds() {
            let last = robot.send(20).await;
            robot.reach(last - 10).await;
            server.kill();
            nats.kill();
            nats.restart();
            // Without what this server's own disk has: all is in the streams.
            std::fs::remove_dir_all(workspace.path("a")).unwrap();
            server = nats.covis_at(&server.port, &workspace, "a");
            let last = robot.send(1).await;
            robot.reach(last).await;
            let kept = keyframes(&server.url).await;
            assert_eq!(kept, (0..robot.sent).collect::<Vec<_>>(), "round {round}");
        }
        prove_one_writer(&messages(&nats.urls()).await);
    });
}

#[test]
fn an_owner_that_nats_cannot_be_reached_by_acknowledges_nothing_and_loses_the_map() {
    let Some(nats) = Nats::start(3, true) else { return };
    let workspace = Workspace::new();
    run(async {
        let to = ([127, 0, 0, 1], nats.nodes[0].port.number).into();
        let link = Proxy::to(to).await;
        let by_link = link.url().replace("http", "nats");
        let first = nats.covis_over(&by_link, &workspace, "a", &[]);
        let second = nats.covis(&workspace, "b");
        let mut robot = Robot::new(&both(&first, &second)).await;
        let last = robot.send(10).await;
        robot.reach(last).await;
        // Both directions: what is on its way is lost, and nothing new gets through.
        link.close();
        link.cut();
        let last = robot.send(10).await;
        robot.reach(last).await;
        // The second server has the map, and the first one sends clients there once it is back.
        assert_eq!(keyframes(&second.url).await, (0..20).collect::<Vec<_>>());
        link.open();
        assert_eq!(prove_one_writer(&messages(&nats.urls()).await), 2);
    });
}

#[cfg(unix)]
#[test]
fn an_owner_that_is_paused_past_its_lease_never_writes_again() {
    let Some(nats) = Nats::start(3, true) else { return };
    let workspace = Workspace::new();
    let first = nats.covis(&workspace, "a");
    let second = nats.covis(&workspace, "b");
    run(async {
        let mut robot = Robot::new(&first.url).await;
        let last = robot.send(10).await;
        robot.reach(last).await;
        // Paused with work in its queues.
        robot.send(10).await;
        first.child.signal(Signal::STOP);
        // Another robot brings the map to the second server.
        // It is led to the paused one first, until the lease is over.
        let usual = Duration::from_secs(1);
        let link =
            LinkOptions { keep_alive: usual, keep_alive_timeout: usual, ..LinkOptions::default() };
        let nobody = Credentials::default();
        let client = Client::connect_over(&second.url, &nobody, link).await.unwrap();
        let options = SessionOptions { retry: patient(), ..SessionOptions::default() };
        let mut other = client.ingest("house", "other", options).await.unwrap();
        other.send(camera(0)).await.unwrap();
        other.send(long_keyframe(0)).await.unwrap();
        let acknowledged = robot.durable();
        // The other robot's keyframe need not be there yet.
        let kept = Client::connect(&second.url).await.unwrap();
        let kept = kept.trajectory("house", Some("robot")).await.unwrap().poses.len();
        assert!(i64::try_from(kept).unwrap() >= acknowledged - 1, "{kept} of {acknowledged}");
        first.child.signal(Signal::CONT);
        // The first robot is led to the second server, and what was not acknowledged comes again.
        let last = robot.send(1).await;
        robot.reach(last).await;
        let report = other.finish().await.unwrap();
        assert_eq!(report.acknowledged, 2);
        assert_eq!(prove_one_writer(&messages(&nats.urls()).await), 2);
        let map = Client::connect(&first.url).await.unwrap().get_map("house").await.unwrap();
        assert_eq!(map.counts.unwrap().keyframe_count, robot.sent + 1);
    });
}
