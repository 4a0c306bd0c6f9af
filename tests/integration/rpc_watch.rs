//! `WatchMap`: resets, deltas that never leave a gap, parts, removals of filters, ends.

use std::collections::BTreeMap;

use covis::wire::v1;
use tonic::{Code, Streaming};
use v1::ingest_request::Item;

use crate::common::{
    LANDMARKS, Stream, TestServer, camera, check_field, check_status, landmark, relative_pose, run,
};

/// A reader's copy of a map, made from deltas alone.
#[derive(Default)]
struct Copy {
    revision: i64,
    keyframes: BTreeMap<(String, i64), v1::KeyframePose>,
    landmarks: BTreeMap<(String, i64), v1::Landmark>,
    constraints: usize,
    cameras: usize,
    frames: usize,
}

/// The next delta with its parts joined; checks what parts promise.
async fn next(stream: &mut Streaming<v1::WatchMapResponse>) -> (v1::MapDelta, usize) {
    let mut whole: Option<v1::MapDelta> = None;
    for index in 0.. {
        let message = stream.message().await.unwrap().expect("the stream goes on");
        assert!(prost::Message::encoded_len(&message) <= (1 << 20) + 300);
        let part = message.delta.unwrap();
        assert_eq!(part.part_index, index);
        let last = part.last_part;
        match &mut whole {
            None => whole = Some(part),
            Some(whole) => {
                assert_eq!(
                    (part.revision, part.base_revision),
                    (whole.revision, whole.base_revision)
                );
                assert_eq!(part.reset, whole.reset);
                whole.cameras.extend(part.cameras);
                whole.keyframes.extend(part.keyframes);
                whole.landmarks.extend(part.landmarks);
                whole.constraints.extend(part.constraints);
                whole.client_frames.extend(part.client_frames);
            }
        }
        if last {
            return (whole.unwrap(), index as usize + 1);
        }
    }
    unreachable!("a delta has a last part")
}

impl Copy {
    fn apply(&mut self, delta: v1::MapDelta) {
        if delta.reset {
            *self = Self::default();
            assert_eq!(delta.base_revision, 0);
        } else {
            assert_eq!(delta.base_revision, self.revision, "no gap");
        }
        assert!(delta.revision >= self.revision);
        self.revision = delta.revision;
        for pose in delta.keyframes {
            let name = pose.keyframe.clone().unwrap();
            self.keyframes.insert((name.client_id, name.id), pose);
        }
        for landmark in delta.landmarks {
            self.landmarks.insert((landmark.client_id.clone(), landmark.id), landmark);
        }
        self.constraints += delta.constraints.len();
        self.cameras += delta.cameras.len();
        self.frames += delta.client_frames.len();
    }
}

fn watch_request(map_id: &str, from_revision: Option<i64>) -> v1::WatchMapRequest {
    v1::WatchMapRequest { map_id: map_id.to_owned(), from_revision, ..Default::default() }
}

#[test]
fn applying_deltas_gives_the_map() {
    run(async {
        let server = TestServer::start().await;
        let uid = server.create_map("room").await.uid;
        let mut maps = server.maps();
        let mut watch = maps.watch_map(watch_request("room", None)).await.unwrap().into_inner();
        let mut copy = Copy::default();
        let (delta, _) = next(&mut watch).await;
        assert!(delta.reset && delta.map_uid == uid && delta.state() == v1::MapState::Open);
        copy.apply(delta);

        server.build_map("room", 4).await;
        let (mut stream, _) = Stream::open(&server, "room", "robot", 0).await;
        stream.put(10, Item::RelativePose(relative_pose(0, 0, 1))).await;
        let request = v1::GetMapRequest { map_id: "room".to_owned(), ..Default::default() };
        let revision = maps.get_map(request).await.unwrap().into_inner().map.unwrap().revision;
        while copy.revision < revision {
            copy.apply(next(&mut watch).await.0);
        }
        assert_eq!((copy.keyframes.len(), copy.landmarks.len() as i64), (4, LANDMARKS));
        assert_eq!(copy.constraints, 1);
        assert!(copy.cameras >= 1 && copy.frames >= 1);
        let request = v1::GetTrajectoryRequest { map_id: "room".to_owned(), ..Default::default() };
        let mut trajectory = maps.get_trajectory(request).await.unwrap().into_inner();
        let trajectory = trajectory.message().await.unwrap().unwrap();
        assert_eq!(trajectory.revision, copy.revision);
        let poses: Vec<_> = copy.keyframes.values().cloned().collect();
        assert_eq!(trajectory.poses, poses, "to the bit");

        // Going on from an earlier revision tells the same end without a reset.
        let mut later = maps.watch_map(watch_request("room", Some(3))).await.unwrap().into_inner();
        let (delta, _) = next(&mut later).await;
        assert!(!delta.reset);
        assert_eq!((delta.base_revision, delta.revision), (3, copy.revision));
        // The revision belongs to another map of this name: everything anew.
        let request = v1::WatchMapRequest {
            map_uid: "another".to_owned(),
            omit_landmarks: true,
            omit_constraints: true,
            ..watch_request("room", Some(3))
        };
        let mut other = maps.watch_map(request).await.unwrap().into_inner();
        let (delta, _) = next(&mut other).await;
        assert!(delta.reset && delta.landmarks.is_empty() && delta.constraints.is_empty());
        assert_eq!(delta.keyframes.len(), 4);
    });
}

#[test]
fn a_large_delta_comes_in_parts_of_one_revision() {
    run(async {
        let server = TestServer::start().await;
        server.create_map("room").await;
        let (mut stream, _) = Stream::open(&server, "room", "robot", 0).await;
        let landmarks: Vec<_> =
            (0..40_000).map(|id| v1::Landmark { id, ..landmark(id % 60) }).collect();
        stream.put(1, Item::Landmarks(v1::LandmarkBatch { landmarks })).await;
        let mut maps = server.maps();
        let mut watch = maps.watch_map(watch_request("room", None)).await.unwrap().into_inner();
        let (delta, parts) = next(&mut watch).await;
        assert!(parts > 1, "{parts}");
        assert_eq!(delta.landmarks.len(), 40_000);
        // A change that does not belong to the reset comes after it.
        stream.put(2, Item::Camera(camera(0))).await;
        let (delta, parts) = next(&mut watch).await;
        assert_eq!((delta.cameras.len(), parts), (1, 1));
    });
}

#[test]
fn a_slow_reader_gets_joined_revisions() {
    run(async {
        let server = TestServer::start().await;
        server.create_map("room").await;
        let mut maps = server.maps();
        let mut watch = maps.watch_map(watch_request("room", None)).await.unwrap().into_inner();
        let mut copy = Copy::default();
        // Nothing is read while the map is built.
        server.build_map("room", 12).await;
        let request = v1::GetMapRequest { map_id: "room".to_owned(), ..Default::default() };
        let revision = maps.get_map(request).await.unwrap().into_inner().map.unwrap().revision;
        while copy.revision < revision {
            copy.apply(next(&mut watch).await.0);
        }
        assert_eq!(copy.keyframes.len(), 12);
    });
}

#[test]
fn watch_map_refuses_bad_requests() {
    run(async {
        let server = TestServer::start().await;
        server.create_map("room").await;
        let mut maps = server.maps();
        for revision in [-1, 1000] {
            let request = watch_request("room", Some(revision));
            let mut watch = maps.watch_map(request).await.unwrap().into_inner();
            check_field(&watch.message().await.unwrap_err(), "from_revision", "OUT_OF_RANGE");
        }
        let mut watch = maps.watch_map(watch_request("none", None)).await.unwrap().into_inner();
        check_status(&watch.message().await.unwrap_err(), Code::NotFound, "MAP_NOT_FOUND");
        let mut watch = maps.watch_map(watch_request("", None)).await.unwrap().into_inner();
        check_field(&watch.message().await.unwrap_err(), "map_id", "MISSING");
    });
}

#[test]
fn a_watcher_sees_that_a_map_is_poisoned() {
    run(async {
        let server = TestServer::with_fault("panic-in-engine").await;
        server.create_map("room").await;
        let mut maps = server.maps();
        let mut watch = maps.watch_map(watch_request("room", None)).await.unwrap().into_inner();
        assert_eq!(next(&mut watch).await.0.state(), v1::MapState::Open);
        let (mut stream, _) = Stream::open(&server, "room", "robot", 0).await;
        stream.send(1, Item::Camera(camera(0))).await;
        check_status(&stream.end().await, Code::Internal, "BUG");
        while next(&mut watch).await.0.state() != v1::MapState::Poisoned {}
    });
}
