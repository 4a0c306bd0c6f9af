//! Copies of a map on the disks of servers: which are published again, and which are set aside.

use std::path::Path;

use covis::client::{Client, SessionOptions};
use covis::map::Map;
use covis::wire::v1;

use super::nats::Nats;
use super::streams::{lose_stream, messages, prove_one_writer};
use super::{Robot, compact, keyframes};
use crate::cli_support::{Port, Running, Workspace};
use crate::common::{camera, run};
use crate::durable::{long_keyframe, on_disk};

/// Whether a file in a folder or below has the number that only the pose of a keyframe has.
fn holds(folder: &Path, keyframe: &v1::Keyframe) -> bool {
    let pose = keyframe.world_from_camera.as_ref().unwrap();
    let x = pose.translation.as_ref().unwrap().x.to_le_bytes();
    let entries = std::fs::read_dir(folder).unwrap().map(Result::unwrap);
    let mut found = entries.map(|entry| match entry.metadata() {
        Ok(data) if data.is_dir() => holds(&entry.path(), keyframe),
        // One that was removed meanwhile has nothing.
        _ => std::fs::read(entry.path())
            .is_ok_and(|bytes| bytes.windows(x.len()).any(|window| window == x)),
    });
    found.any(|found| found)
}

/// The map in the only folder that a server has set aside, read where documents say that it can be.
pub(super) async fn set_aside(folder: &Path, name: &str) -> Map {
    let aside: Vec<_> = std::fs::read_dir(folder.join("set-aside")).unwrap().collect();
    let [Ok(aside)] = &aside[..] else { panic!("one folder is expected: {aside:?}") };
    let other = folder.with_extension("other");
    let maps = other.join("maps");
    std::fs::create_dir_all(&maps).unwrap();
    std::fs::rename(aside.path(), maps.join(aside.file_name())).unwrap();
    on_disk(&other, name).await
}

#[test]
fn what_an_owner_has_on_its_disk_and_the_stream_lacks_is_put_back_where_nobody_wrote_since() {
    let Some(mut nats) = Nats::start(1, true) else { return };
    let workspace = Workspace::new();
    let folder = workspace.path("a");
    // A lease that does not end while NATS is away: the map takes changes as long as it lasts.
    let lease = ["--lease-seconds", "3600"];
    let mut server = nats.covis_over(&nats.urls(), &workspace, "a", &lease);
    run(async {
        let mut robot = Robot::new(&server.url).await;
        let last = robot.send(5).await;
        robot.reach(last).await;
        nats.kill();
        let sixth = long_keyframe(5);
        assert!(!holds(&folder, &sixth));
        let last = robot.send(1).await;
        robot.received(last).await;
        // Accepted is not yet written.
        while !holds(&folder, &sixth) {
            tokio::task::yield_now().await;
        }
        // It is on the owner's disk; nothing acknowledges it as durable.
        assert!(robot.durable() < last);
        // Nobody sends it again.
        drop(robot);
        server.kill();
        assert_eq!(on_disk(&folder, "house").await.keyframes().len(), 6);
        nats.restart();
        server = nats.covis_at(&server.port, &workspace, "a");
        assert_eq!(keyframes(&server.url).await, (0..6).collect::<Vec<_>>());
        prove_one_writer(&messages(&nats.urls()).await);
    });
}

#[test]
fn a_stream_that_nats_lost_is_written_again_from_the_disk_of_the_owner() {
    let Some(nats) = Nats::start(1, true) else { return };
    let workspace = Workspace::new();
    let mut server = nats.covis(&workspace, "a");
    run(async {
        let mut robot = Robot::new(&server.url).await;
        let last = robot.send(5).await;
        robot.reach(last).await;
        drop(robot);
        server.kill();
        lose_stream(&nats.urls()).await;
        server = nats.covis_at(&server.port, &workspace, "a");
        assert_eq!(keyframes(&server.url).await, (0..5).collect::<Vec<_>>());
        // The stream has it all again.
        server.kill();
        std::fs::remove_dir_all(workspace.path("a")).unwrap();
        server = nats.covis_at(&server.port, &workspace, "a");
        assert_eq!(keyframes(&server.url).await, (0..5).collect::<Vec<_>>());
        prove_one_writer(&messages(&nats.urls()).await);
    });
}

#[test]
fn a_map_of_a_data_directory_that_no_cluster_knows_is_set_aside_for_another_of_its_name() {
    let Some(nats) = Nats::start(1, true) else { return };
    let workspace = Workspace::new();
    let folder = workspace.path("a");
    run(async {
        let mut alone = Running::spawn(workspace.command(), Port::reserve(), &folder, &[]);
        let client = Client::connect(&alone.url).await.unwrap();
        client.create_map("house", None).await.unwrap();
        let options = SessionOptions::default();
        let mut session = client.ingest("house", "robot", options).await.unwrap();
        session.send(camera(0)).await.unwrap();
        for id in 0..7 {
            session.send(long_keyframe(id)).await.unwrap();
        }
        assert_eq!(session.finish().await.unwrap().acknowledged, 8);
        assert_eq!(alone.terminate(), Some(0));
        // The cluster does not know the map, and a robot makes one of that name.
        let server = nats.covis(&workspace, "a");
        let mut robot = Robot::new(&server.url).await;
        let last = robot.send(2).await;
        robot.reach(last).await;
        assert_eq!(keyframes(&server.url).await, [0, 1]);
        assert_eq!(set_aside(&folder, "house").await.keyframes().len(), 7);
    });
}

#[test]
fn what_an_owner_has_behind_a_snapshot_is_put_back_where_nats_lost_the_stream() {
    let Some(nats) = Nats::start(1, true) else { return };
    let workspace = Workspace::new();
    let mut server = nats.covis(&workspace, "a");
    run(async {
        let mut robot = Robot::new(&server.url).await;
        let last = robot.send(5).await;
        robot.reach(last).await;
        compact(&workspace, &server);
        let last = robot.send(3).await;
        robot.reach(last).await;
        drop(robot);
        server.kill();
        lose_stream(&nats.urls()).await;
        server = nats.covis_at(&server.port, &workspace, "a");
        assert_eq!(keyframes(&server.url).await, (0..8).collect::<Vec<_>>());
        assert!(!workspace.path("a/set-aside").exists());
        // Snapshot and stream have it all again.
        server.kill();
        std::fs::remove_dir_all(workspace.path("a")).unwrap();
        server = nats.covis_at(&server.port, &workspace, "a");
        assert_eq!(keyframes(&server.url).await, (0..8).collect::<Vec<_>>());
    });
}

#[test]
fn a_copy_of_a_server_that_does_not_fit_is_set_aside_after_nats_lost_the_stream() {
    let Some(nats) = Nats::start(1, true) else { return };
    let workspace = Workspace::new();
    let mut first = nats.covis(&workspace, "a");
    run(async {
        let mut robot = Robot::new(&first.url).await;
        let last = robot.send(5).await;
        robot.reach(last).await;
        drop(robot.session.finish().await.unwrap());
        compact(&workspace, &first);
        assert_eq!(first.terminate(), Some(0));
        // Another server has the map next, and what it acknowledges is in its copy and the stream.
        let mut second = nats.covis(&workspace, "b");
        send(&second, "next", 3).await;
        assert_eq!(second.terminate(), Some(0));
        lose_stream(&nats.urls()).await;
        // The first server can go on from the snapshot only.
        let mut first = nats.covis(&workspace, "a");
        assert_eq!(keyframes(&first.url).await, (0..5).collect::<Vec<_>>());
        send(&first, "other", 1).await;
        assert_eq!(first.terminate(), Some(0));
        let second = nats.covis(&workspace, "b");
        assert_eq!(keyframes(&second.url).await.len(), 6);
        assert_eq!(set_aside(&workspace.path("b"), "house").await.keyframes().len(), 8);
    });
}

/// A robot sends keyframes to a map that is there.
async fn send(server: &Running, robot: &str, count: usize) {
    let client = Client::connect(&server.url).await.unwrap();
    let mut session = client.ingest("house", robot, SessionOptions::default()).await.unwrap();
    session.send(camera(0)).await.unwrap();
    for id in (0..).take(count) {
        session.send(long_keyframe(id)).await.unwrap();
    }
    assert_eq!(session.finish().await.unwrap().acknowledged, count as u64 + 1);
}

#[test]
fn an_owner_that_comes_back_after_compactions_keeps_its_files() {
    let Some(nats) = Nats::start(1, true) else { return };
    let workspace = Workspace::new();
    let mut server = nats.covis(&workspace, "a");
    run(async {
        let mut robot = Robot::new(&server.url).await;
        // The stream has nothing left, then more than the journal, then events behind both.
        for (round, (before, behind)) in [(3, 0), (2, 0), (2, 1)].into_iter().enumerate() {
            let last = robot.send(before).await;
            robot.reach(last).await;
            compact(&workspace, &server);
            if behind > 0 {
                let last = robot.send(behind).await;
                robot.reach(last).await;
            }
            server.kill();
            let folders = maps(&workspace);
            server = nats.covis_at(&server.port, &workspace, "a");
            assert_eq!(keyframes(&server.url).await, (0..robot.sent).collect::<Vec<_>>());
            assert_eq!(maps(&workspace), folders, "round {round}: made anew");
            assert!(!workspace.path("a/set-aside").exists());
        }
    });
}

/// When the folders of the server's maps were made.
fn maps(workspace: &Workspace) -> Vec<std::time::SystemTime> {
    let entries = std::fs::read_dir(workspace.path("a/maps")).unwrap();
    let identity = |entry: std::io::Result<std::fs::DirEntry>| entry.unwrap().path().join("map");
    let times =
        entries.map(|entry| std::fs::metadata(identity(entry)).unwrap().modified().unwrap());
    times.collect()
}
