//! Maps on disk, through the server and through the real binary: what is acknowledged as DURABLE is
//! there after a restart, and after kill -9 at any moment.

use std::path::Path;
use std::process::Command;
use std::sync::Arc;
use std::sync::atomic::{AtomicI64, Ordering};

use covis::client::{Client, RetryPolicy, SessionOptions};
use covis::map::Map;
use covis::store::{FileStore, FileStoreOptions, Store};
use covis::wire::v1;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use tokio::sync::Notify;
use v1::ingest_request::Item;

use crate::cli_support::{Running, Workspace};
use crate::common::{Stream, TestServer, camera, keyframe, run};
#[cfg(unix)]
use crate::process::Signal;

/// The map of a data directory that no server uses, replayed twice.
pub(crate) async fn on_disk(folder: &Path, name: &str) -> Map {
    let store = FileStore::open(folder, FileStoreOptions::default()).await.unwrap();
    store.acquire(name).await.unwrap();
    assert_eq!(store.damage(name).await.unwrap(), []);
    let snapshot = store.get_snapshot(name).await.unwrap();
    let start = snapshot.map_or_else(Map::new, |map| (*map).clone());
    let events = store.read(name, u64::try_from(start.revision()).unwrap()).await.unwrap();
    let replay = || {
        let mut map = start.clone();
        events.iter().for_each(|event| map.apply(event).unwrap());
        map
    };
    let map = replay();
    assert_eq!(map.state_hash(), replay().state_hash());
    map
}

#[test]
fn a_durable_server_says_so_and_brings_its_maps_back() {
    run(async {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().to_owned();
        let server = TestServer::with(|config| config.data_dir = Some(path.clone())).await;
        let create = v1::CreateMapRequest {
            map_id: "house".to_owned(),
            display_name: "Our house".to_owned(),
            policy: None,
        };
        server.maps().create_map(create).await.unwrap();
        let (stream, opened) = Stream::open(&server, "house", "robot", 0).await;
        assert_eq!(opened.durability(), v1::Durability::Disk);
        stream.send(1, Item::Camera(camera(0))).await;
        for id in 0..6 {
            stream.send(id + 2, Item::Keyframe(keyframe(id))).await;
        }
        let acks = stream.finish().await.unwrap();
        let durable = acks.iter().filter(|ack| ack.status() == v1::AckStatus::Durable);
        let durable: Vec<i64> = durable.map(|ack| ack.sequence).collect();
        assert_eq!(durable.last(), Some(&7), "{durable:?}");
        assert!(durable.is_sorted(), "{durable:?}");
        let get = v1::GetMapRequest { map_id: "house".to_owned(), ..Default::default() };
        let before = server.maps().get_map(get.clone()).await.unwrap().into_inner().map.unwrap();
        let second = covis::service::ServerConfig {
            data_dir: Some(path.clone()),
            ..covis::service::ServerConfig::default()
        };
        let listener = tokio::net::TcpListener::bind("127.0.0.1:0").await.unwrap();
        let refused = covis::service::Server::start(listener, second).await.unwrap_err();
        let text = format!("{refused:?}");
        assert!(text.contains("InUse"), "{text}");
        server.running.shutdown().await;

        let hash = on_disk(&path, "house").await.state_hash();
        let server = TestServer::with(|config| config.data_dir = Some(path.clone())).await;
        let after = server.maps().get_map(get).await.unwrap().into_inner().map.unwrap();
        assert_eq!(
            (&after.uid, after.revision, &after.counts),
            (&before.uid, before.revision, &before.counts)
        );
        assert_eq!((&*after.display_name, after.update_time), ("Our house", before.update_time));
        assert_ne!(after.update_time, after.create_time);
        // A re-sent item is durable already, and told so.
        let (stream, opened) = Stream::open(&server, "house", "robot", 0).await;
        assert_eq!(opened.next_sequence, 8);
        stream.send(7, Item::Keyframe(keyframe(5))).await;
        let acks = stream.finish().await.unwrap();
        let statuses: Vec<_> = acks.iter().map(|ack| (ack.sequence, ack.status())).collect();
        assert!(statuses.contains(&(7, v1::AckStatus::Durable)), "{statuses:?}");
        server.running.shutdown().await;
        // The opening of a stream is an event; the rest of the state is as it was.
        assert_ne!(on_disk(&path, "house").await.state_hash(), hash);
    });
}

/// Keyframe `id` far down the street: an item of some kilobytes whose values tell its id.
pub(crate) fn long_keyframe(id: i64) -> v1::Keyframe {
    let mut keyframe = keyframe(id % 6);
    keyframe.id = id;
    let nanos = i32::try_from(id).unwrap();
    keyframe.capture_time = Some(prost_types::Timestamp { seconds: 1, nanos });
    keyframe
}

/// Streams keyframes from `first` on until the server dies, which it does once the acks have reached
/// a number that the seed chooses. Returns the last keyframe that was sent, and that was durable.
pub(crate) async fn stream_until_killed(
    server: &mut Running,
    rng: &mut ChaCha8Rng,
    first: i64,
) -> (i64, i64) {
    let client = Client::connect(&server.url).await.unwrap();
    let _exists = client.create_map("house", None).await;
    let durable = Arc::new(AtomicI64::new(0));
    let (seen, acks) = (Arc::clone(&durable), Arc::new(Notify::new()));
    let notify = Arc::clone(&acks);
    let options = SessionOptions::default().on_ack(move |ack| {
        if ack.status() == v1::AckStatus::Durable {
            seen.fetch_max(ack.sequence, Ordering::Relaxed);
        }
        notify.notify_one();
    });
    let mut session = client.ingest("house", "robot", options).await.unwrap();
    if first == 0 {
        session.send(camera(0)).await.unwrap();
    }
    // Sequences and ids run together: the camera has sequence 1, keyframe k sequence k + 2.
    let next = session.next_sequence();
    assert_eq!(next, first + 2);
    let kill_at = first + 2 + rng.random_range(0..40);
    let mut sent = first - 1;
    let stop = Arc::clone(&durable);
    let sending = async {
        for id in first.. {
            sent = id;
            if session.send_as(id + 2, long_keyframe(id)).await.is_err() {
                break;
            }
        }
    };
    let killing = async {
        while stop.load(Ordering::Relaxed) < kill_at {
            acks.notified().await;
        }
    };
    tokio::select! {
        () = sending => {}
        () = killing => {}
    }
    server.kill();
    (sent, durable.load(Ordering::Relaxed) - 2)
}

/// What a server says of the state of "house": revision and hash.
async fn served_state(url: &str) -> (i64, Vec<u8>) {
    let client = Client::connect(url).await.unwrap();
    let (map, digests) = client.get_map_digests("house").await.unwrap();
    (map.revision, digests.state_hash)
}

#[test]
fn kill_at_any_moment_loses_nothing_durable() {
    let number = |name: &str, default: u64| {
        std::env::var(name).ok().map_or(default, |value| value.parse().unwrap())
    };
    let rounds = number("COVIS_TEST_KILLS", 12);
    let seed = number("COVIS_TEST_SEED", 1);
    println!("{rounds} rounds from seed {seed}");
    let runtime = tokio::runtime::Runtime::new().unwrap();
    let workspace = Workspace::new();
    let (mut between, mut next, mut folder) = (0, 0, workspace.path("maps-0"));
    let (mut kept, mut compared) = (None, 0);
    for round in 0..rounds {
        let mut rng = ChaCha8Rng::seed_from_u64(seed + round);
        // A few kills of one map, then another: no journal grows for the whole test.
        if round % 8 == 0 {
            (folder, next, kept) = (workspace.path(&format!("maps-{round}")), 0, None);
        }
        let mut server = Running::start(&workspace, &folder);
        if let Some(kept) = &kept {
            // A solve that the kill cut short may have been made up for already.
            let served = runtime.block_on(served_state(&server.url));
            let (revision, _): &(i64, Vec<u8>) = kept;
            assert!(served.0 >= *revision, "seed {}: revision {}", seed + round, served.0);
            if served.0 == *revision {
                compared += 1;
                assert_eq!(&served, kept, "seed {}: served is not what was kept", seed + round);
            }
        }
        let (sent, durable) = runtime.block_on(stream_until_killed(&mut server, &mut rng, next));
        let map = runtime.block_on(on_disk(&folder, "house"));
        let what = format!("seed {}: sent {sent}, durable {durable}", seed + round);
        let ids: Vec<i64> = map.keyframes().keys().map(|id| id.id).collect();
        let last = ids.last().copied().unwrap_or(-1);
        assert_eq!(ids, (0..=last).collect::<Vec<_>>(), "{what}");
        assert!(durable <= last && last <= sent, "{what}: kept {last}");
        for (id, keyframe) in map.keyframes() {
            assert_eq!(keyframe.capture_time_ns, 1_000_000_000 + id.id, "{what}");
        }
        let added: Vec<i64> = map.keyframes().values().map(|k| k.added_revision).collect();
        assert!(added.is_sorted_by(|a, b| a < b), "{what}: order");
        assert_eq!(map.clients()[0].next_sequence, last + 3, "{what}");
        between += u64::from(next <= durable && durable < sent);
        (next, kept) = (last + 1, Some((map.revision(), map.content_hash().to_vec())));
    }
    println!("in {between} of {rounds} rounds 0 < durable < sent, {compared} states compared");
    assert!(compared > 0, "no restarted server was asked before it solved");
    assert!(between * 2 > rounds, "the kills came too late or too early");
}

#[cfg(unix)]
#[test]
fn two_servers_on_one_directory_are_refused_with_a_clear_message() {
    let workspace = Workspace::new();
    let folder = workspace.path("maps");
    let server = Running::start(&workspace, &folder);
    let mut command: Command = workspace.command();
    command.args(["serve", "--listen", "127.0.0.1:0", "--data-dir"]).arg(&folder);
    let ran = crate::cli_support::Ran::of(command.output().unwrap());
    ran.expect_failure(&["in use by another server", &server.child.id().to_string()]);
    let ran = workspace.run("serve --in-memory --data-dir x", &[]);
    assert_eq!(ran.code, Some(2), "{}", ran.stderr);
}

#[cfg(unix)]
#[test]
fn a_drained_server_keeps_all_that_it_acknowledged() {
    // With no time at all calls are cut, and the promise is the same.
    for budget in ["10", "0"] {
        drain_with_budget(budget);
    }
}

/// SIGTERM while a client sends as fast as it can.
#[cfg(unix)]
fn drain_with_budget(seconds: &str) {
    let workspace = Workspace::new();
    let folder = workspace.path("maps");
    let mut server = Running::with(&workspace, &folder, &["--drain-budget", seconds]);
    let received = Arc::new(AtomicI64::new(0));
    run(async {
        let client = Client::connect(&server.url).await.unwrap();
        client.create_map("house", None).await.unwrap();
        let (seen, enough) = (Arc::clone(&received), Arc::new(Notify::new()));
        let notify = Arc::clone(&enough);
        let retry = RetryPolicy { max_attempts: 1, ..RetryPolicy::default() };
        let options = SessionOptions { retry, ..SessionOptions::default() }.on_ack(move |ack| {
            if ack.status() == v1::AckStatus::Received {
                seen.fetch_max(ack.sequence, Ordering::Relaxed);
            }
            if ack.sequence >= 20 {
                notify.notify_one();
            }
        });
        let mut session = client.ingest("house", "robot", options).await.unwrap();
        let terminating = async {
            enough.notified().await;
            server.child.signal(Signal::TERM);
        };
        let sending = async {
            session.send(camera(0)).await.unwrap();
            for id in 0.. {
                if session.send_as(id + 2, long_keyframe(id)).await.is_err() {
                    break;
                }
            }
        };
        tokio::join!(terminating, sending);
    });
    assert_eq!(server.child.wait().unwrap().code(), Some(0));
    let received = received.load(Ordering::Relaxed);
    run(async {
        let next = on_disk(&folder, "house").await.clients()[0].next_sequence;
        assert!(received >= 20 && next > received, "{received} received, goes on at {next}");
    });
}
