//! What the robots of the simulation send: a camera, then keyframes that see the same few landmarks.
//! Enough for windows to be solved, and small, so that a run has many of them.

use crate::wire::v1;

/// The sequence of the camera, which is a map's first item; those of keyframes, which are their ids too,
/// follow.
pub(crate) const CAMERA: i64 = 1;
/// Landmarks that each keyframe sees.
const LANDMARKS: i64 = 6;

/// A camera with the id 0.
pub(crate) fn camera() -> v1::Camera {
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

/// A keyframe on a way to and fro along x. The first one brings the landmarks, a little beside where they are, so
/// that windows have something to solve.
pub(crate) fn keyframe(id: i64) -> v1::Keyframe {
    let x = 0.02 * (id % 40) as f64;
    let at = |k: i64| [k as f64 - 2.5, 0.4 * (k % 3) as f64, 4.0 + 0.5 * (k % 2) as f64];
    let vector = |[x, y, z]: [f64; 3]| Some(v1::Vector3 { x, y, z });
    let pose = v1::RigidTransform {
        translation: vector([x, 0.0, 0.0]),
        rotation: Some(v1::Quaternion { w: 1.0, x: 0.0, y: 0.0, z: 0.0 }),
    };
    let observation = |k: i64| {
        let [px, y, z] = at(k);
        let landmark = Some(v1::LandmarkRef { id: k, ..v1::LandmarkRef::default() });
        let pixel = v1::Vector2 { x: 320.0 + 500.0 * (px - x) / z, y: 240.0 + 500.0 * y / z };
        v1::Observation { landmark, pixel: Some(pixel), ..v1::Observation::default() }
    };
    let landmark = |k: i64| {
        let [x, y, z] = at(k);
        let point_in_world = vector([x, y, z + 0.05]);
        v1::Landmark { id: k, point_in_world, ..v1::Landmark::default() }
    };
    let brought = if id == CAMERA + 1 { 0..LANDMARKS } else { 0..0 };
    v1::Keyframe {
        id,
        capture_time: Some(prost_types::Timestamp { seconds: id, nanos: 0 }),
        sensor: Some(v1::keyframe::Sensor::CameraId(0)),
        world_from_camera: Some(pose),
        observations: (0..LANDMARKS).map(observation).collect(),
        landmarks: brought.map(landmark).collect(),
        ..v1::Keyframe::default()
    }
}
