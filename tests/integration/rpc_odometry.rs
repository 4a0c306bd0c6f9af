//! `map_from_odom`, the frame in which a client tracks, and keyframes that have no camera.

use std::collections::BTreeSet;

use covis::wire::v1;
use covis_solvers::geometry::{LieGroup, Se3, So3};
use covis_solvers::testing::random::{normal_vector, seeded, uniform_vector};
use nalgebra::{Vector3, Vector6};
use tonic::Code;
use v1::ingest_request::Item;

use crate::common::{
    CENTER, FOCAL, Stream, TestServer, camera, check_status, keyframe, observation, relative_pose,
    run,
};

pub(crate) fn se3(message: &v1::RigidTransform) -> Se3 {
    let (t, q) = (message.translation.unwrap(), message.rotation.unwrap());
    let rotation = So3::from_quaternion_xyzw(q.x, q.y, q.z, q.w).unwrap();
    Se3::new(rotation, Vector3::new(t.x, t.y, t.z))
}

pub(crate) fn message(pose: &Se3) -> v1::RigidTransform {
    let (t, q) = (&pose.translation, pose.rotation.quaternion());
    v1::RigidTransform {
        translation: Some(v1::Vector3 { x: t.x, y: t.y, z: t.z }),
        rotation: Some(v1::Quaternion { x: q.i, y: q.j, z: q.k, w: q.w }),
    }
}

/// Where the client's odometry has keyframe `id`: in a frame of its own, turned and shifted, that
/// drifts with every keyframe.
fn odometry(id: i64) -> Se3 {
    let k = id as f64;
    let odom_from_world =
        Se3::identity().plus(&Vector6::new(3.0, -2.0, 0.5 + 0.1 * k, 0.2, -0.4, 0.7 + 0.05 * k));
    odom_from_world.compose(&se3(keyframe(id).world_from_camera.as_ref().unwrap()))
}

fn tracked(id: i64) -> v1::Keyframe {
    v1::Keyframe { odom_from_camera: Some(message(&odometry(id))), ..keyframe(id) }
}

/// The pose of each keyframe of "robot" as it is now.
async fn poses(server: &TestServer) -> Vec<(i64, Se3)> {
    let request = v1::GetTrajectoryRequest { map_id: "room".to_owned(), ..Default::default() };
    let mut stream = server.maps().get_trajectory(request).await.unwrap().into_inner();
    let poses = stream.message().await.unwrap().unwrap().poses;
    let poses = poses.iter().map(|p| (p.keyframe.as_ref().unwrap().id, &p.world_from_camera));
    poses.map(|(id, pose)| (id, se3(pose.as_ref().unwrap()))).collect()
}

async fn map(server: &TestServer) -> v1::Map {
    let request = v1::GetMapRequest { map_id: "room".to_owned(), ..Default::default() };
    server.maps().get_map(request).await.unwrap().into_inner().map.unwrap()
}

/// The full state as `WatchMap` tells it.
async fn reset(server: &TestServer) -> v1::MapDelta {
    let request = v1::WatchMapRequest { map_id: "room".to_owned(), ..Default::default() };
    let mut watch = server.maps().watch_map(request).await.unwrap().into_inner();
    watch.message().await.unwrap().unwrap().delta.unwrap()
}

#[test]
fn map_from_odom_ties_the_newest_keyframe_to_the_clients_own_frame() {
    run(async {
        let server = TestServer::start().await;
        server.create_map("room").await;
        let (mut stream, _) = Stream::open(&server, "room", "robot", 0).await;
        stream.put(1, Item::Camera(camera(0))).await;
        for id in 0..4 {
            let ack = stream.put(id + 2, Item::Keyframe(tracked(id))).await;
            assert!(ack.violations.is_empty(), "{ack:?}");
        }
        // One that was captured earlier than the others and arrives late has no say.
        let late = v1::Keyframe {
            id: 90,
            capture_time: Some(prost_types::Timestamp { seconds: 1, nanos: 0 }),
            odom_from_camera: Some(message(&Se3::identity())),
            observations: Vec::new(),
            ..tracked(1)
        };
        stream.put(10, Item::Keyframe(late)).await;
        for ack in stream.finish().await.unwrap() {
            assert!(ack.violations.is_empty() && ack.solve_failure.is_none(), "{ack:?}");
        }

        let optimized = poses(&server).await.last().copied().unwrap();
        assert_eq!(optimized.0, 3, "newest by capture time");
        let start = se3(keyframe(3).world_from_camera.as_ref().unwrap());
        assert!(optimized.1.minus(&start).norm() > 1e-3, "a solve has moved the keyframe");
        let expected = optimized.1.compose(&odometry(3).inverse());

        let delta = reset(&server).await;
        let [frame] = delta.client_frames.as_slice() else { panic!("{:?}", delta.client_frames) };
        let newest = frame.keyframe.as_ref().unwrap();
        assert_eq!((frame.client_id.as_str(), newest.id), ("robot", 3));
        let told = se3(frame.map_from_odom.as_ref().unwrap());
        assert!(told.minus(&expected).norm() < 1e-12, "{told:?} is not {expected:?}");
        let map = map(&server).await;
        assert_eq!(map.clients[0].map_from_odom, frame.map_from_odom);
    });
}

#[test]
fn without_odometry_the_start_estimate_is_taken() {
    run(async {
        let server = TestServer::start().await;
        let policy = v1::MapPolicy { local_bundle_adjustment: Some(false), ..Default::default() };
        server.create_map_with("room", policy).await;
        server.build_map("room", 3).await;
        let frame = |map: v1::Map| se3(map.clients[0].map_from_odom.as_ref().unwrap());
        assert!(frame(map(&server).await).log().norm() < 1e-12, "nothing has moved");
        // The same keyframe with its default written out is the same content, another is not.
        let (mut stream, _) = Stream::open(&server, "room", "robot", 0).await;
        let start = keyframe(2).world_from_camera;
        let same = v1::Keyframe { odom_from_camera: start, ..keyframe(2) };
        assert!(stream.put(20, Item::Keyframe(same)).await.duplicate);
        let refused = stream.put(21, Item::Keyframe(tracked(2))).await;
        assert_eq!(refused.violations[0].field, "keyframe.id");
        assert_eq!(refused.violations[0].reason(), v1::ViolationReason::AlreadyExists);
    });
}

/// A keyframe that only constraints place.
fn blind(id: i64) -> v1::Keyframe {
    v1::Keyframe { sensor: None, observations: Vec::new(), landmarks: Vec::new(), ..keyframe(id) }
}

#[test]
fn a_keyframe_needs_a_camera_only_for_observations() {
    run(async {
        let server = TestServer::start().await;
        server.create_map("room").await;
        server.build_map("room", 2).await;
        let (mut stream, _) = Stream::open(&server, "room", "robot", 0).await;
        let ack = stream.put(10, Item::Keyframe(blind(2))).await;
        assert_eq!(ack.status(), v1::AckStatus::Received, "{ack:?}");
        assert!(stream.put(11, Item::Keyframe(blind(2))).await.duplicate);
        let constraint = Item::RelativePose(relative_pose(0, 1, 2));
        assert!(stream.put(12, constraint).await.violations.is_empty());
        let batch = v1::ObservationBatch {
            keyframe: Some(v1::KeyframeRef { id: 2, ..Default::default() }),
            observations: vec![observation(2, 0)],
        };
        let ack = stream.put(13, Item::Observations(batch)).await;
        assert_eq!(ack.violations[0].field, "observations.keyframe");
        assert_eq!(ack.violations[0].reason(), v1::ViolationReason::Inconsistent);

        // It takes part in a solve through its constraint.
        let request = v1::OptimizeMapRequest { map_id: "room".to_owned(), ..Default::default() };
        let mut solve = server.optimization().optimize_map(request).await.unwrap().into_inner();
        let mut result = None;
        while let Some(message) = solve.message().await.unwrap() {
            if let Some(v1::optimize_map_response::Event::Result(end)) = message.event {
                result = Some(end);
            }
        }
        let result = result.unwrap();
        assert_eq!((result.keyframe_count, result.constraint_count), (3, 1));

        // COLMAP has no place for it, TUM has.
        let export = async |format: v1::MapFormat| {
            let request = v1::ExportMapRequest {
                map_id: "room".to_owned(),
                format: format.into(),
                all_landmarks: false,
            };
            server.maps().export_map(request).await.unwrap().into_inner().message().await
        };
        for format in [v1::MapFormat::ColmapText, v1::MapFormat::ColmapBinary] {
            let status = export(format).await.unwrap_err();
            check_status(&status, Code::FailedPrecondition, "FORMAT_CANNOT_HOLD_MAP");
            assert!(status.message().contains("robot/2"), "{}", status.message());
        }
        export(v1::MapFormat::Tum).await.unwrap();
    });
}

/// Keyframes of a way that is long enough to see whether it bends.
const WAY: usize = 400;

/// Keyframes half a meter apart that look ahead, along a way with landmarks on both sides, of which each sees a
/// quarter of those 6 to 16 m ahead. Poses and landmarks are true, pixels off by 0.05 px.
fn along_a_way(count: usize) -> Vec<v1::Keyframe> {
    let mut rng = seeded(1);
    let length = 0.5 * count as f64 + 20.0;
    let places: Vec<Vector3<f64>> = (0..12 * count)
        .map(|_| uniform_vector::<3>(&mut rng, 1.0))
        .map(|at| {
            let side = 6.0 + 6.0 * at.x.abs();
            Vector3::new(side.copysign(at.x), 1.5 + 3.5 * at.y, 0.5 * length * (1.0 + at.z))
        })
        .collect();
    let mut known = BTreeSet::new();
    let keyframe = |k: usize| {
        let at = Vector3::new(0.0, 0.0, 0.5 * k as f64);
        let mut is_seen = |&(_, place): &(usize, &Vector3<f64>)| {
            let is_found = uniform_vector::<1>(&mut rng, 1.0).x < -0.5;
            is_found && (6.0..16.0).contains(&(place - at).z)
        };
        let seen: Vec<_> = places.iter().enumerate().filter(&mut is_seen).collect();
        let observations = seen.iter().map(|&(id, place)| {
            let (ahead, noise) = (place - at, normal_vector::<2>(&mut rng, 0.05));
            v1::Observation {
                landmark: Some(v1::LandmarkRef { id: id as i64, ..Default::default() }),
                pixel: Some(v1::Vector2 {
                    x: FOCAL * ahead.x / ahead.z + CENTER[0] + noise.x,
                    y: FOCAL * ahead.y / ahead.z + CENTER[1] + noise.y,
                }),
                ..Default::default()
            }
        });
        let observations = observations.collect();
        let new = seen.iter().filter(|seen| known.insert(seen.0));
        let position = |p: &Vector3<f64>| Some(v1::Vector3 { x: p.x, y: p.y, z: p.z });
        let landmarks = new.map(|&(id, place)| v1::Landmark {
            id: id as i64,
            point_in_world: position(place),
            ..Default::default()
        });
        v1::Keyframe {
            id: k as i64,
            capture_time: Some(prost_types::Timestamp { seconds: 100 + k as i64, nanos: 0 }),
            sensor: Some(v1::keyframe::Sensor::CameraId(0)),
            world_from_camera: Some(message(&Se3::new(So3::identity(), at))),
            observations,
            landmarks: landmarks.collect(),
            ..Default::default()
        }
    };
    (0..count).map(keyframe).collect()
}

#[test]
fn a_way_that_only_views_measure_does_not_bend() {
    run(async {
        let server = TestServer::lock_step().await;
        let policy = v1::MapPolicy { odometry: Some(false), ..Default::default() };
        server.create_map_with("room", policy).await;
        let (mut stream, _) = Stream::open(&server, "room", "robot", 0).await;
        let wide = v1::Camera { width_px: 1500, height_px: 1500, ..camera(0) };
        stream.put(1, Item::Camera(wide)).await;
        for (k, keyframe) in (2..).zip(along_a_way(WAY)) {
            let ack = stream.put(k, Item::Keyframe(keyframe)).await;
            assert!(ack.violations.is_empty(), "{ack:?}");
        }
        stream.finish().await.unwrap();
        let off = |(k, pose): &(i64, Se3)| {
            (pose.translation - Vector3::new(0.0, 0.0, 0.5 * *k as f64)).norm()
        };
        let poses = poses(&server).await;
        let farthest = poses.iter().map(off).fold(0.0, f64::max);
        assert!(farthest < 0.001 * 0.5 * WAY as f64, "{farthest} m");
    });
}
