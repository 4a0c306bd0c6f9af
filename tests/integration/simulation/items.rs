//! What the robots of the simulation send: a camera, keyframes with depth, and loop closures.
//!
//! A robot goes the same short way again and again, and takes what it sees for new each time: landmarks
//! of a visit have ids of their own. A closure at the end of a visit joins it with the one before. So
//! windows, pose graphs, comparisons of places and adjustments have something to do, and items are
//! small, so that a run has many of them. All measurements are exact.

use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

use covis::wire::v1;
use v1::ingest_request::Item;

/// The sequence of the camera, which is a map's first item. Those of keyframes and closures, which are
/// their ids too, follow.
pub(crate) const CAMERA: i64 = 1;
/// Items of a visit.
const VISIT: i64 = 8;
/// Landmarks that each keyframe sees: two places with ten points in common can be joined.
const LANDMARKS: i64 = 12;

/// The item with this sequence.
pub(crate) fn item(sequence: i64) -> Item {
    match sequence {
        CAMERA => Item::Camera(camera()),
        _ if is_closure(sequence) => Item::RelativePose(closure(sequence)),
        _ => Item::Keyframe(keyframe(sequence)),
    }
}

/// Whether the item with this sequence is a loop closure: the last one of each visit but the first.
pub(crate) fn is_closure(sequence: i64) -> bool {
    sequence >= 2 * VISIT - 1 && sequence % VISIT == VISIT - 1
}

/// Where the keyframe with this id is, along x in meters.
pub(crate) fn place_m(id: i64) -> f64 {
    0.05 * (id % VISIT) as f64
}

fn vector([x, y, z]: [f64; 3]) -> Option<v1::Vector3> {
    Some(v1::Vector3 { x, y, z })
}

fn shift(x: f64) -> Option<v1::RigidTransform> {
    let rotation = Some(v1::Quaternion { w: 1.0, x: 0.0, y: 0.0, z: 0.0 });
    Some(v1::RigidTransform { translation: vector([x, 0.0, 0.0]), rotation })
}

/// A camera with the id 0.
fn camera() -> v1::Camera {
    let model = v1::PinholeRadialTangential {
        fx: 500.0,
        fy: 500.0,
        cx: 320.0,
        cy: 240.0,
        ..Default::default()
    };
    let model = Some(v1::camera::Model::PinholeRadialTangential(model));
    v1::Camera { width_px: 640, height_px: 480, model, ..v1::Camera::default() }
}

/// Each point of the place looks like no other one, and the same on each visit.
fn descriptor(k: i64) -> v1::Descriptor {
    let data = ChaCha8Rng::seed_from_u64(k as u64).random::<[u8; 32]>().to_vec();
    v1::Descriptor { kind: v1::DescriptorKind::Binary.into(), name: "orb".to_owned(), data }
}

/// The first keyframe of a visit brings its landmarks, a little beside where they are, so that windows
/// have something to solve.
fn keyframe(id: i64) -> v1::Keyframe {
    let x = place_m(id);
    let at = |k: i64| {
        let (column, row) = ((k % 6) as f64, (k / 6) as f64);
        [0.7 * column - 1.75, 0.9 * row - 0.5, 4.0 + 0.5 * (k % 3) as f64]
    };
    let landmark_id = |k: i64| LANDMARKS * (id / VISIT) + k;
    let observation = |k: i64| {
        let [px, y, z] = at(k);
        let landmark = Some(v1::LandmarkRef { id: landmark_id(k), ..v1::LandmarkRef::default() });
        let pixel = v1::Vector2 { x: 320.0 + 500.0 * (px - x) / z, y: 240.0 + 500.0 * y / z };
        v1::Observation {
            landmark,
            pixel: Some(pixel),
            depth_m: Some(z),
            sigma_depth_m: Some(0.02),
            descriptor: Some(descriptor(k)),
            ..v1::Observation::default()
        }
    };
    let landmark = |k: i64| {
        let [x, y, z] = at(k);
        let point_in_world = vector([x, y, z + 0.05]);
        v1::Landmark { id: landmark_id(k), point_in_world, ..v1::Landmark::default() }
    };
    let is_first = id == CAMERA + 1 || id % VISIT == 0;
    let brought = if is_first { 0..LANDMARKS } else { 0..0 };
    v1::Keyframe {
        id,
        capture_time: Some(prost_types::Timestamp { seconds: id, nanos: 0 }),
        sensor: Some(v1::keyframe::Sensor::CameraId(0)),
        world_from_camera: shift(x),
        observations: (0..LANDMARKS).map(observation).collect(),
        landmarks: brought.map(landmark).collect(),
        ..v1::Keyframe::default()
    }
}

/// The keyframe before it is where the same one of the visit before was.
fn closure(id: i64) -> v1::RelativePoseConstraint {
    let keyframe = |id| Some(v1::KeyframeRef { id, ..v1::KeyframeRef::default() });
    // σ is 1 cm and 0.01 rad.
    let information = (0..6).flat_map(|row| (row..6).map(move |column| (row, column)));
    let information = information.map(|(row, column)| if row == column { 1e4 } else { 0.0 });
    v1::RelativePoseConstraint {
        id,
        kind: v1::ConstraintKind::LoopClosure.into(),
        keyframe_i: keyframe(id - 1 - VISIT),
        keyframe_j: keyframe(id - 1),
        keyframe_i_from_keyframe_j: shift(0.0),
        information: Some(v1::InformationMatrix6 { upper_triangle: information.collect() }),
        ..v1::RelativePoseConstraint::default()
    }
}
