//! What the tests of merges share: robots that walk around in one room, their maps, and requests.

#![allow(clippy::unwrap_used, reason = "helpers of tests fail by panicking")]

use std::collections::BTreeMap;
use std::path::Path;

use covis::client::RetryPolicy;
use covis::wire::v1;
use covis_solvers::geometry::{LieGroup, Se3};
use v1::ingest_request::Item;
use v1::ingest_response::Event;

use crate::common::{Stream, TestServer};
use crate::made_sequence::{Course, Made};
use crate::made_verdicts;
use crate::sequence::{Order, Sequence, items, pose};

/// The points of the room are those of this seed.
pub(crate) const POINTS: u64 = 7;

/// A robot that begins at the corner `start` of the ring of 12 and walks around once and a bit, in a frame
/// that begins where it begins.
pub(crate) fn walker(start: i32, seed: u64) -> Made {
    walk_in(&ring(start), seed)
}

/// The way of [`walker`].
pub(crate) fn ring(start: i32) -> Course {
    let corner = |k: i32| {
        let angle = f64::from(k) * std::f64::consts::FRAC_PI_6;
        [1.2 * angle.cos(), 1.0 * angle.sin()]
    };
    let way = (start..=start + 14).map(corner).collect();
    // The camera is that of every robot: an error of its calibration scales a map, and merging does not
    // take that away.
    Course { way, closure_step: 1000, calibration_error: 0.0, ..made_verdicts::room() }
}

/// A robot of `seed` on a course, in a frame that begins where it begins.
pub(crate) fn walk_in(course: &Course, seed: u64) -> Made {
    let mut made = course.walk_of(POINTS, seed);
    let origin = made.sequence.odometry[0].1.inverse();
    for (_, pose) in &mut made.sequence.odometry {
        *pose = origin.compose(pose);
    }
    made
}

pub(crate) fn robot(number: usize) -> String {
    format!("robot-{number}")
}

/// Sends what a robot saw.
pub(crate) async fn walk(server: &TestServer, map: &str, client: &str, sequence: &Sequence) {
    let (stream, _) = Stream::open(server, map, client, 0).await;
    for (number, item) in (1..).zip(items(sequence, &[], Order::Streamed)) {
        stream.send(number, item).await;
    }
    for ack in stream.finish().await.unwrap() {
        assert!(ack.violations.is_empty(), "{ack:?}");
    }
}

/// Waits until searches of places, their closures and the adjustment after them are done. A map with no
/// adjustment due may still search, find a closure and be adjusted after it. In lock-step a stream ends after
/// all of that; the client must have no other one.
pub(crate) async fn all_done(server: &TestServer, map: &str, client: &str) {
    let mut stream = Stream::connect(server).await;
    let open = v1::IngestOpen {
        map_id: map.to_owned(),
        client_id: client.to_owned(),
        options: Some(v1::IngestOptions { lock_step: true, ..Default::default() }),
        ..Default::default()
    };
    stream.send(0, Item::Open(open)).await;
    assert!(matches!(stream.event().await.unwrap(), Event::Opened(_)));
    assert_eq!(stream.finish().await.unwrap(), []);
}

/// The poses of a map by client and id.
pub(crate) async fn poses(server: &TestServer, map: &str) -> BTreeMap<(String, i64), Se3> {
    let request =
        v1::WatchMapRequest { map_id: map.to_owned(), omit_landmarks: true, ..Default::default() };
    let mut watch = server.maps().watch_map(request).await.unwrap().into_inner();
    let mut poses = BTreeMap::new();
    loop {
        let delta = watch.message().await.unwrap().unwrap().delta.unwrap();
        for keyframe in delta.keyframes {
            let id = keyframe.keyframe.unwrap();
            let found = keyframe.world_from_camera.unwrap();
            let (t, q) = (found.translation.unwrap(), found.rotation.unwrap());
            let found = pose(&[t.x, t.y, t.z, q.x, q.y, q.z, q.w]);
            poses.insert((id.client_id, id.id), found);
        }
        if delta.last_part {
            return poses;
        }
    }
}

pub(crate) fn merge(target: &str, source: &str) -> v1::MergeMapsRequest {
    v1::MergeMapsRequest {
        target_map_id: target.to_owned(),
        source_map_id: source.to_owned(),
        ..Default::default()
    }
}

pub(crate) async fn get(server: &TestServer, map: &str) -> v1::Map {
    let request = v1::GetMapRequest { map_id: map.to_owned(), ..Default::default() };
    server.maps().get_map(request).await.unwrap().into_inner().map.unwrap()
}

/// Retries without waiting long.
pub(crate) fn quickly() -> RetryPolicy {
    let first_delay = std::time::Duration::from_millis(1);
    RetryPolicy {
        max_attempts: 1000,
        first_delay,
        longest_delay: first_delay,
        ..Default::default()
    }
}

pub(crate) async fn on_disk(folder: &Path) -> TestServer {
    let folder = folder.to_owned();
    TestServer::with(|config| config.data_dir = Some(folder)).await
}

pub(crate) fn copy(from: &Path, to: &Path) {
    std::fs::create_dir_all(to).unwrap();
    for entry in std::fs::read_dir(from).unwrap() {
        let entry = entry.unwrap();
        let to = to.join(entry.file_name());
        match entry.file_type().unwrap().is_dir() {
            true => copy(&entry.path(), &to),
            false => drop(std::fs::copy(entry.path(), to).unwrap()),
        }
    }
}
