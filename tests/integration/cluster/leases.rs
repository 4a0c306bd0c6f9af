//! Leases that lapse: of a server that nobody replaced, and of one whose map was taken.

use std::time::Duration;

use covis::client::{Client, ClientError, WatchOptions};
use covis::store::{FileStore, FileStoreOptions, ReplicatedStore, ReplicationOptions};
use futures_util::StreamExt;

use super::nats::Nats;
use super::streams::{messages, prove_one_writer};
use super::{Robot, both, keyframes};
use crate::cli_support::Workspace;
use crate::common::run;
use crate::proxy::Proxy;

/// Waits until a server says that another one may have the map, and names none.
async fn lapsed(url: &str) {
    let client = Client::connect(url).await.unwrap();
    loop {
        match client.get_map("house").await {
            Ok(_) => tokio::task::yield_now().await,
            Err(ClientError::Rpc { status, .. }) if status.message().contains("another server") => {
                return;
            }
            Err(error) => panic!("{error}"),
        }
    }
}

#[test]
fn a_lease_that_lapsed_and_that_nobody_took_goes_on_with_the_open_map() {
    let Some(nats) = Nats::start(1, true) else { return };
    let workspace = Workspace::new();
    run(async {
        let to = ([127, 0, 0, 1], nats.nodes[0].port.number).into();
        let link = Proxy::to(to).await;
        let by_link = link.url().replace("http", "nats");
        let server = nats.covis_over(&by_link, &workspace, "a", &[]);
        let mut robot = Robot::new(&server.url).await;
        let last = robot.send(10).await;
        robot.reach(last).await;
        let watcher = Client::connect(&server.url).await.unwrap();
        let mut watch = watcher.watch("house", WatchOptions::default()).await.unwrap();
        watch.next().await.unwrap();
        for _ in 0..2 {
            link.close();
            link.cut();
            lapsed(&server.url).await;
            // What comes meanwhile waits at the client.
            let last = robot.send(5).await;
            link.open();
            robot.reach(last).await;
        }
        assert_eq!(keyframes(&server.url).await, (0..20).collect::<Vec<_>>());
        // The server took the map once: it was not opened again.
        assert_eq!(prove_one_writer(&messages(&nats.urls()).await), 1);
        while watch.mirror().keyframes.len() < 20 {
            watch.next().await.unwrap();
        }
    });
}

#[test]
fn a_lease_that_lapsed_and_whose_map_was_taken_steps_down() {
    let Some(nats) = Nats::start(1, true) else { return };
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
        link.close();
        link.cut();
        let last = robot.send(10).await;
        robot.reach(last).await;
        link.open();
        // The first server leads to the second one, as soon as it can ask whose the map is.
        let client = Client::connect(&first.url).await.unwrap();
        while client.get_map("house").await.is_err() || *client.url() != *second.url {
            tokio::task::yield_now().await;
        }
        let last = robot.send(5).await;
        robot.reach(last).await;
        assert_eq!(keyframes(&second.url).await, (0..25).collect::<Vec<_>>());
        assert_eq!(prove_one_writer(&messages(&nats.urls()).await), 2);
    });
}

#[test]
fn a_lease_is_renewed_while_every_worker_of_the_server_is_busy() {
    /// Beats in two leases.
    const BEATS: usize = 8;
    let Some(nats) = Nats::start(1, true) else { return };
    let folder = tempfile::tempdir().unwrap();
    let lease = Duration::from_secs(1);
    let options = ReplicationOptions {
        nats: nats.urls(),
        monitoring: vec![nats.monitoring()],
        accept_unsynced: false,
        replicas: 1,
        lease,
        address: "http://127.0.0.1:1".to_owned(),
    };
    let server =
        tokio::runtime::Builder::new_multi_thread().worker_threads(1).enable_all().build().unwrap();
    let store = server.block_on(async {
        let local = FileStore::open(folder.path(), FileStoreOptions::default()).await.unwrap();
        ReplicatedStore::open(local, options).await.unwrap()
    });
    let (busy, is_busy) = std::sync::mpsc::channel();
    let (release, released) = std::sync::mpsc::channel::<()>();
    server.spawn(async move {
        busy.send(()).unwrap();
        // Blocks the only worker until the other end is dropped.
        released.recv().unwrap_err();
    });
    is_busy.recv().unwrap();
    run(async {
        let client = async_nats::connect(nats.urls()).await.unwrap();
        let beats =
            async_nats::jetstream::new(client).get_key_value("covis_servers").await.unwrap();
        let read = beats.watch_all().await.unwrap().take(BEATS).count();
        let read = tokio::time::timeout(60 * lease, read).await;
        assert_eq!(read.expect("the lease is not renewed"), BEATS);
    });
    drop(release);
    drop(store);
}
