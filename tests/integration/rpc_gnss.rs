//! Fixes of a receiver: they bring a map to their frame, correct its drift, and false ones are told.

use covis::wire::v1;
use covis_solvers::geometry::{Geodetic, LocalFrame};
use nalgebra::Vector3;
use v1::ingest_request::Item;

use crate::common::{Stream, TestServer, information3, information6, run, vector3};

/// Keyframes of a lap.
const LAP: i64 = 20;
/// Keyframes in all.
const COUNT: i64 = 2 * LAP;
/// The antenna in the keyframe's frame, in meters.
const ARM: [f64; 3] = [0.3, -0.2, 0.5];

/// The angle and the place of keyframe `k` of two laps of a circle with hills; with `drift` m a
/// keyframe, where odometry has it.
fn place(k: i64, drift: f64) -> (f64, [f64; 3]) {
    let turn = std::f64::consts::TAU / LAP as f64;
    let (angle, radius) = (k as f64 * turn, 1.0 / turn);
    let hill = 0.3 * (2.0 * angle).sin();
    (angle, [radius * angle.sin() + drift * k as f64, radius * (1.0 - angle.cos()), hill])
}

fn pose(angle: f64, translation: [f64; 3]) -> v1::RigidTransform {
    let (z, w) = (angle / 2.0).sin_cos();
    v1::RigidTransform {
        translation: Some(vector3(translation)),
        rotation: Some(v1::Quaternion { x: 0.0, y: 0.0, z, w }),
    }
}

/// `point` turned by `angle` about z and shifted.
fn moved(angle: f64, [x, y, z]: [f64; 3], by: [f64; 3]) -> [f64; 3] {
    let (sin, cos) = angle.sin_cos();
    [cos * x - sin * y + by[0], sin * x + cos * y + by[1], z + by[2]]
}

/// Where the map begins: in a frame of its own, far from the world's.
fn keyframe(k: i64) -> Item {
    let (angle, at) = place(k, 0.01);
    let own = moved(2.0, at, [300.0, -40.0, 7.0]);
    Item::Keyframe(v1::Keyframe {
        id: k,
        capture_time: Some(prost_types::Timestamp { seconds: 100 + k, nanos: 0 }),
        world_from_camera: Some(pose(angle + 2.0, own)),
        ..Default::default()
    })
}

/// The antenna of keyframe `k` in the world.
fn antenna(k: i64) -> [f64; 3] {
    let (angle, at) = place(k, 0.0);
    moved(angle, ARM, at)
}

fn fix(id: i64, k: i64, edit: impl FnOnce(&mut v1::PositionPrior)) -> Item {
    let mut prior = v1::PositionPrior {
        id,
        keyframe: Some(v1::KeyframeRef { id: k, ..Default::default() }),
        point_in_world: Some(vector3(antenna(k))),
        point_in_camera: Some(vector3(ARM)),
        information: Some(information3(1e4)),
        ..Default::default()
    };
    edit(&mut prior);
    Item::PositionPrior(prior)
}

async fn send(server: &TestServer, map_id: &str, items: Vec<Item>) -> Vec<v1::IngestAck> {
    let (stream, opened) = Stream::open(server, map_id, "robot", 0).await;
    for (sequence, item) in (opened.next_sequence..).zip(items) {
        stream.send(sequence, item).await;
    }
    let acks = stream.finish().await.unwrap();
    for ack in &acks {
        assert!(ack.violations.is_empty(), "{ack:?}");
    }
    acks
}

/// The largest distance of a keyframe from `truth`, in meters.
fn error(delta: &v1::MapDelta, truth: impl Fn(i64) -> [f64; 3]) -> f64 {
    let apart = |keyframe: &v1::KeyframePose| {
        let [x, y, z] = truth(keyframe.keyframe.as_ref().unwrap().id);
        let at = keyframe.world_from_camera.unwrap().translation.unwrap();
        (at.x - x).hypot(at.y - y).hypot(at.z - z)
    };
    assert_eq!(delta.keyframes.len() as i64, COUNT);
    delta.keyframes.iter().map(apart).fold(0.0, f64::max)
}

/// The position priors of a delta that are switched off.
fn off(delta: &v1::MapDelta) -> Vec<i64> {
    let off = |c: &v1::Constraint| match &c.constraint {
        Some(v1::constraint::Constraint::PositionPrior(prior)) => {
            prior.switched_off.map(|_| prior.id)
        }
        _ => None,
    };
    delta.constraints.iter().filter_map(off).collect()
}

#[test]
fn fixes_with_a_lever_arm_bring_a_map_to_the_world_and_a_false_one_is_reported() {
    run(async {
        let server = TestServer::lock_step().await;
        server.create_map("room").await;
        send(&server, "room", (0..COUNT).map(keyframe).collect()).await;
        assert!(error(&server.watched("room").await, |k| place(k, 0.0).1) > 100.0);
        let fixes = (0..COUNT / 3).map(|n| {
            fix(n, 3 * n, |prior| {
                if n == 6 {
                    prior.point_in_world.as_mut().unwrap().y += 8.0;
                }
            })
        });
        let acks = send(&server, "room", fixes.collect()).await;
        let last = acks.iter().rfind(|ack| ack.status() == v1::AckStatus::Optimized).unwrap();
        assert_eq!(last.sequence, COUNT + COUNT / 3, "the last fix is covered");
        assert!(last.solve_id > 0);
        let delta = server.watched("room").await;
        assert_eq!(off(&delta), [6]);
        let left = error(&delta, |k| place(k, 0.0).1);
        assert!(left < 0.06, "{left} m of 0.4 m are left");
        // On request too, and the answer says what fixed the frame and which fix is off.
        let request = v1::OptimizeMapRequest {
            map_id: "room".to_owned(),
            problem: v1::MapProblem::PoseGraph.into(),
            ..Default::default()
        };
        let (_, result) = server.optimize_map(request).await.unwrap();
        let summary = result.summary.unwrap();
        assert_eq!(summary.gauge(), v1::Gauge::Priors);
        assert_eq!(summary.fixed_pose_count, 0);
        assert_eq!(result.switched_off_constraints.len(), 1);
        let name = result.switched_off_constraints[0].constraint.clone().unwrap();
        assert_eq!(name.id, 6);
        assert!(result.switched_off_constraints[0].switched_off.unwrap().chi2 > 1000.0);
    });
}

#[test]
fn fixes_that_arrive_together_are_covered_by_fewer_solves() {
    run(async {
        let server = TestServer::start().await;
        server.create_map("room").await;
        send(&server, "room", (0..COUNT).map(keyframe).collect()).await;
        let acks = send(&server, "room", (0..COUNT).map(|n| fix(n, n, |_| ())).collect()).await;
        let optimized = acks.iter().filter(|ack| ack.status() == v1::AckStatus::Optimized);
        let sequences: Vec<i64> = optimized.map(|ack| ack.sequence).collect();
        assert_eq!(sequences.last(), Some(&(2 * COUNT)));
        let left = error(&server.watched("room").await, |k| place(k, 0.0).1);
        assert!(left < 0.05, "{left} m");
    });
}

#[test]
fn a_map_without_loop_closure_optimization_answers_a_fix_without_a_solve() {
    run(async {
        let server = TestServer::lock_step().await;
        let policy = v1::MapPolicy { loop_closure_optimization: Some(false), ..Default::default() };
        server.create_map_with("room", policy).await;
        send(&server, "room", (0..COUNT).map(keyframe).collect()).await;
        let acks = send(&server, "room", vec![fix(0, 0, |_| ()), fix(1, 9, |_| ())]).await;
        let optimized = acks.iter().filter(|ack| ack.status() == v1::AckStatus::Optimized);
        assert!(optimized.clone().count() > 0);
        assert!(optimized.into_iter().all(|ack| ack.solve_id == 0));
        assert!(error(&server.watched("room").await, |k| place(k, 0.0).1) > 100.0);
    });
}

#[test]
fn a_pose_prior_moves_the_whole_map() {
    run(async {
        let server = TestServer::lock_step().await;
        server.create_map("room").await;
        send(&server, "room", (0..COUNT).map(keyframe).collect()).await;
        let (angle, at) = place(0, 0.0);
        let prior = Item::PosePrior(v1::PosePrior {
            id: 1,
            keyframe: Some(v1::KeyframeRef { id: 0, ..Default::default() }),
            world_from_camera: Some(pose(angle, at)),
            information: Some(information6(1e4)),
            loss: Some(v1::Loss { kind: v1::LossKind::Huber.into(), width: Some(1.0) }),
            ..Default::default()
        });
        send(&server, "room", vec![prior]).await;
        let left = error(&server.watched("room").await, |k| place(k, 0.01).1);
        assert!(left < 1e-6, "{left} m");
    });
}

#[test]
fn geodetic_fixes_place_a_map_in_the_frame_of_its_anchor() {
    run(async {
        let server = TestServer::lock_step().await;
        let anchor = Geodetic { latitude_deg: 40.1, longitude_deg: -105.15, height_m: 1600.0 };
        let to_wire = |place: Geodetic| v1::GeodeticPosition {
            latitude_deg: place.latitude_deg,
            longitude_deg: place.longitude_deg,
            height_m: place.height_m,
        };
        let policy = v1::MapPolicy { geodetic_anchor: Some(to_wire(anchor)), ..Default::default() };
        server.create_map_with("room", policy).await;
        // A path on the Earth, and the map's own idea of it.
        let earth = |k: i64| Geodetic {
            latitude_deg: anchor.latitude_deg + 2e-5 * (0.3 * k as f64).sin(),
            longitude_deg: anchor.longitude_deg + 1e-5 * k as f64,
            height_m: anchor.height_m + (0.2 * k as f64).cos(),
        };
        let frame = LocalFrame::new(&anchor);
        let truth = move |k: i64| -> [f64; 3] {
            let point: Vector3<f64> = frame.point_in_local(&earth(k));
            [point.x, point.y, point.z]
        };
        let keyframes = (0..COUNT).map(|k| {
            Item::Keyframe(v1::Keyframe {
                id: k,
                capture_time: Some(prost_types::Timestamp { seconds: 100 + k, nanos: 0 }),
                world_from_camera: Some(pose(1.0, moved(1.0, truth(k), [5.0, 6.0, 7.0]))),
                ..Default::default()
            })
        });
        send(&server, "room", keyframes.collect()).await;
        let fixes = (0..COUNT).step_by(8).map(|k| {
            fix(k, k, |prior| {
                (prior.point_in_world, prior.point_in_camera) = (None, None);
                prior.geodetic_point = Some(to_wire(earth(k)));
            })
        });
        send(&server, "room", fixes.collect()).await;
        let delta = server.watched("room").await;
        assert!(error(&delta, truth) < 1e-3, "{} m", error(&delta, truth));
        // What is answered is in the world.
        let points = delta.constraints.iter().filter_map(|c| match &c.constraint {
            Some(v1::constraint::Constraint::PositionPrior(p)) => p.point_in_world.zip(Some(p.id)),
            _ => None,
        });
        for (point, k) in points {
            let [x, y, z] = truth(k);
            assert!((point.x - x).hypot(point.y - y).hypot(point.z - z) < 1e-9);
        }
    });
}
