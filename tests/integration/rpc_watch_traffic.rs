//! What a watcher is sent: values that changed, by more than its resolution, and little beside them.
//!
//! A camera sees a long wall with noise on its pixels, as a frontend does; each keyframe is solved
//! with its window before the next one (lock-step), so that deltas are the same in every run.

use std::collections::BTreeMap;

use covis::client::{Client, WatchOptions};
use covis::wire::v1;
use prost::Message;
use tonic::Streaming;
use v1::ingest_request::Item;
use v1::ingest_response::Event;

use crate::common::{Stream, TestServer, camera, check_field, relative_pose, run, shift, vector3};

/// Keyframes of the sequence, and how many landmarks each one sees anew.
const KEYFRAMES: i64 = 40;
const NEW: i64 = 20;
/// How many keyframes see a landmark.
const SPAN: i64 = 8;

/// Noise that is the same in every run, about one in size.
fn noise(a: i64, b: i64) -> f64 {
    let mixed = (a.wrapping_mul(7919) ^ b.wrapping_mul(104_729)).wrapping_mul(2_654_435_761);
    ((mixed >> 8) & 0xffff) as f64 / 32_768.0 - 1.0
}

fn wall(landmark: i64) -> [f64; 3] {
    let (column, row) = (landmark / NEW, landmark % NEW);
    let depth = 4.0 + 0.3 * noise(landmark, 3);
    [0.15 * column as f64, -1.2 + 0.12 * row as f64, depth]
}

fn moving_keyframe(id: i64) -> v1::Keyframe {
    let at = 0.15 * id as f64;
    let first = (id - SPAN + 1).max(0) * NEW;
    let observation = |landmark: i64| {
        let [x, y, z] = wall(landmark);
        let pixel = [500.0 * (x - at) / z + 319.5, 500.0 * y / z + 239.5];
        v1::Observation {
            landmark: Some(v1::LandmarkRef { id: landmark, ..Default::default() }),
            pixel: Some(v1::Vector2 {
                x: pixel[0] + 0.5 * noise(id, landmark),
                y: pixel[1] + 0.5 * noise(landmark, id),
            }),
            depth_m: Some(z + 0.02 * noise(id + 1, landmark)),
            sigma_depth_m: Some(0.02),
            ..Default::default()
        }
    };
    v1::Keyframe {
        id,
        capture_time: Some(prost_types::Timestamp { seconds: 100 + id, nanos: 0 }),
        sensor: Some(v1::keyframe::Sensor::CameraId(0)),
        world_from_camera: Some(shift([at + 0.01 * noise(id, 1), 0.01 * noise(id, 2), 0.0])),
        observations: (first..(id + 1) * NEW).map(observation).collect(),
        landmarks: (id * NEW..(id + 1) * NEW)
            .map(|id| v1::Landmark {
                id,
                point_in_world: Some(vector3(wall(id))),
                ..Default::default()
            })
            .collect(),
        ..Default::default()
    }
}

/// A reader's copy, and what it took to keep it.
#[derive(Default)]
struct Reader {
    keyframes: BTreeMap<i64, v1::KeyframePose>,
    landmarks: BTreeMap<i64, v1::Landmark>,
    others: BTreeMap<String, Vec<u8>>,
    revision: i64,
    /// All that came, and of it the entities that the reader had otherwise, bytes.
    bytes: usize,
    changed: usize,
    /// Entities that came with the value that the reader had.
    repeated: usize,
}

impl Reader {
    fn take<M: Message + PartialEq>(&mut self, had: Option<&M>, now: &M) {
        if had.is_some_and(|had| had == now) {
            self.repeated += 1;
        } else {
            self.changed += now.encoded_len();
        }
    }

    /// Takes deltas until `revision` is there.
    async fn reach(&mut self, stream: &mut Streaming<v1::WatchMapResponse>, revision: i64) {
        loop {
            let message = stream.message().await.unwrap().expect("the stream goes on");
            self.bytes += message.encoded_len();
            let part = message.delta.unwrap();
            for pose in part.keyframes {
                let id = pose.keyframe.as_ref().unwrap().id;
                let had = self.keyframes.insert(id, pose.clone());
                self.take(had.as_ref(), &pose);
            }
            for landmark in part.landmarks {
                let had = self.landmarks.insert(landmark.id, landmark.clone());
                self.take(had.as_ref(), &landmark);
            }
            for camera in part.cameras {
                self.other(format!("camera {}", camera.id), &camera);
            }
            for frame in part.client_frames {
                self.other(format!("frame {}", frame.client_id), &frame);
            }
            for constraint in part.constraints {
                let name = format!("{:?}", constraint.constraint);
                self.other(name, &constraint);
            }
            self.revision = part.revision;
            if part.last_part && self.revision >= revision {
                return;
            }
        }
    }

    fn other<M: Message + PartialEq>(&mut self, name: String, now: &M) {
        let had = self.others.insert(name, now.encode_to_vec());
        if had.is_some_and(|had| had == now.encode_to_vec()) {
            self.repeated += 1;
        } else {
            self.changed += now.encoded_len();
        }
    }
}

fn watch_request(position_m: f64, rotation_rad: f64) -> v1::WatchMapRequest {
    v1::WatchMapRequest {
        map_id: "wall".to_owned(),
        position_resolution_m: position_m,
        rotation_resolution_rad: rotation_rad,
        ..Default::default()
    }
}

async fn revision(server: &TestServer) -> i64 {
    let request = v1::GetMapRequest { map_id: "wall".to_owned(), ..Default::default() };
    server.maps().get_map(request).await.unwrap().into_inner().map.unwrap().revision
}

/// Sends a keyframe and waits for its solve.
async fn solved(stream: &mut Stream, sequence: i64, keyframe: v1::Keyframe) {
    stream.send(sequence, Item::Keyframe(keyframe)).await;
    loop {
        let Event::Ack(ack) = stream.event().await.unwrap() else { panic!("opened twice") };
        assert!(ack.violations.is_empty() && ack.solve_failure.is_none(), "{ack:?}");
        if ack.status() == v1::AckStatus::Optimized && ack.sequence >= sequence {
            return;
        }
    }
}

/// Sends the sequence; after each keyframe every reader takes what there is for it.
async fn replay(server: &TestServer, readers: &mut [(Reader, Streaming<v1::WatchMapResponse>)]) {
    let (mut stream, _) = Stream::open(server, "wall", "robot", 0).await;
    stream.put(1, Item::Camera(camera(0))).await;
    for id in 0..KEYFRAMES {
        solved(&mut stream, id + 2, moving_keyframe(id)).await;
        let revision = revision(server).await;
        for (reader, stream) in &mut *readers {
            reader.reach(stream, revision).await;
        }
    }
    stream.finish().await.unwrap();
    let last = revision(server).await;
    for (reader, stream) in readers {
        if reader.revision < last {
            reader.reach(stream, last).await;
        }
    }
}

/// The map as a reader who begins now gets it.
async fn whole(server: &TestServer) -> Reader {
    let mut reader = Reader::default();
    let mut stream = server.maps().watch_map(watch_request(0.0, 0.0)).await.unwrap().into_inner();
    reader.reach(&mut stream, revision(server).await).await;
    reader
}

fn distance(a: Option<v1::Vector3>, b: Option<v1::Vector3>) -> f64 {
    let (a, b) = (a.unwrap(), b.unwrap());
    (a.x - b.x).hypot(a.y - b.y).hypot(a.z - b.z)
}

fn angle(a: Option<v1::Quaternion>, b: Option<v1::Quaternion>) -> f64 {
    let (a, b) = (a.unwrap(), b.unwrap());
    let dot = a.x * b.x + a.y * b.y + a.z * b.z + a.w * b.w;
    2.0 * dot.abs().min(1.0).acos()
}

/// Checks that a reader's values are those of the map, within a resolution.
#[track_caller]
fn check(reader: &Reader, map: &Reader, position_m: f64, rotation_rad: f64) {
    assert_eq!(reader.revision, map.revision);
    assert!(reader.keyframes.keys().eq(map.keyframes.keys()));
    assert!(reader.landmarks.keys().eq(map.landmarks.keys()));
    for (id, pose) in &map.keyframes {
        let (a, b) = (reader.keyframes[id].world_from_camera, pose.world_from_camera);
        let (a, b) = (a.unwrap(), b.unwrap());
        let off = (distance(a.translation, b.translation), angle(a.rotation, b.rotation));
        assert!(off.0 <= position_m && off.1 <= rotation_rad + 1e-7, "keyframe {id}: {off:?}");
    }
    for (id, landmark) in &map.landmarks {
        let had = &reader.landmarks[id];
        let off = distance(had.point_in_world, landmark.point_in_world);
        assert!(off <= position_m, "landmark {id}: {off} m");
        let (a, b) = (had.observation_count, landmark.observation_count);
        assert!(a == b || (a < 4 * b && b < 4 * a), "landmark {id}: {a} observations, not {b}");
    }
}

#[test]
fn a_watcher_is_sent_what_changed_by_more_than_its_resolution() {
    run(async {
        let server = TestServer::lock_step().await;
        server.create_map("wall").await;
        let resolutions = [(0.0, 0.0), (1e-3, 1e-3), (1e-2, 1e-2)];
        let mut readers = Vec::new();
        for (position_m, rotation_rad) in resolutions {
            let request = watch_request(position_m, rotation_rad);
            let stream = server.maps().watch_map(request).await.unwrap().into_inner();
            readers.push((Reader::default(), stream));
        }
        replay(&server, &mut readers).await;
        let map = whole(&server).await;
        for ((reader, _), (position_m, rotation_rad)) in readers.iter().zip(resolutions) {
            let Reader { bytes, changed, repeated, .. } = reader;
            assert_eq!(*repeated, 0, "{position_m} m: a value came that the reader had");
            assert!(*bytes <= 2 * changed, "{position_m} m: {bytes} bytes for {changed}");
            check(reader, &map, position_m, rotation_rad);
        }
        let [exact, fine, coarse] = [0, 1, 2].map(|i: usize| readers[i].0.bytes);
        assert_eq!(readers[0].0.landmarks, map.landmarks, "exact: to the bit");
        assert_eq!(readers[0].0.keyframes, map.keyframes, "exact: to the bit");
        assert!(coarse < fine && fine < exact, "{exact} {fine} {coarse}");
    });
}

#[test]
fn a_reader_whose_links_break_stays_within_its_resolution() {
    const MOST: f64 = 0.005;
    run(async {
        let server = TestServer::lock_step().await;
        server.create_map("wall").await;
        let url = format!("http://{}", server.running.local_addr());
        let client = Client::connect(&url).await.unwrap();
        let options = WatchOptions {
            position_resolution_m: MOST,
            rotation_resolution_rad: MOST,
            ..WatchOptions::default()
        };
        let mut watch = client.watch("wall", options).await.unwrap();
        let (mut ingest, _) = Stream::open(&server, "wall", "robot", 0).await;
        ingest.put(1, Item::Camera(camera(0))).await;
        let mut reader = Reader::default();
        let mut stream = None;
        for id in 0..KEYFRAMES / 2 {
            if id % 3 == 0 {
                // The stream breaks, and another one goes on with what the reader has.
                let request = v1::WatchMapRequest {
                    from_revision: (id > 0).then_some(reader.revision),
                    ..watch_request(MOST, MOST)
                };
                stream = Some(server.maps().watch_map(request).await.unwrap().into_inner());
            }
            solved(&mut ingest, id + 2, moving_keyframe(id)).await;
            let revision = revision(&server).await;
            reader.reach(stream.as_mut().unwrap(), revision).await;
            let map = whole(&server).await;
            check(&reader, &map, MOST, MOST);

            let mirror = watch.reach(revision).await.unwrap();
            let values = Reader {
                keyframes: mirror.keyframes.iter().map(|(k, pose)| (k.1, pose.clone())).collect(),
                landmarks: mirror.landmarks.iter().map(|(k, l)| (k.1, l.clone())).collect(),
                revision: mirror.revision,
                ..Reader::default()
            };
            check(&values, &map, MOST, MOST);
        }
    });
}

#[test]
fn a_step_without_news_still_leads_to_its_revision() {
    run(async {
        let server = TestServer::start().await;
        server.create_map("wall").await;
        let mut stream =
            server.maps().watch_map(watch_request(0.5, 0.5)).await.unwrap().into_inner();
        let mut reader = Reader::default();
        server.build_map("wall", 3).await;
        reader.reach(&mut stream, revision(&server).await).await;
        let before = reader.bytes;
        let (mut ingest, _) = Stream::open(&server, "wall", "robot", 0).await;
        let ack = ingest.put(10, Item::RelativePose(relative_pose(0, 0, 1))).await;
        reader.reach(&mut stream, ack.revision).await;
        assert!(reader.others.len() >= 3, "camera, frame and constraint: {:?}", reader.others);
        assert!(reader.bytes - before < 600, "{} bytes for a constraint", reader.bytes - before);
        assert_eq!(reader.repeated, 0);
        check(&reader, &whole(&server).await, 0.5, 0.5);
    });
}

#[test]
fn a_resolution_that_is_no_length_or_angle_is_refused() {
    run(async {
        let server = TestServer::start().await;
        server.create_map("wall").await;
        for (value, reason) in
            [(-1e-3, "OUT_OF_RANGE"), (f64::NAN, "NOT_FINITE"), (f64::INFINITY, "NOT_FINITE")]
        {
            for (request, field) in [
                (watch_request(value, 0.0), "position_resolution_m"),
                (watch_request(0.0, value), "rotation_resolution_rad"),
            ] {
                let mut stream = server.maps().watch_map(request).await.unwrap().into_inner();
                check_field(&stream.message().await.unwrap_err(), field, reason);
            }
        }
    });
}
