//! A frontend in one file: odometry that drifts, an RGB-D camera, a loop, corrections.
//!
//! Start a server (`cargo run --release -- serve`), then
//! `cargo run --release --example first_frontend [URL]`. `docs/your-first-frontend.md` explains it
//! step by step. Tracking is played by arithmetic: a robot drives along a wall of known points and
//! back, and its odometry is off by 4 %.

#![allow(clippy::print_stdout, reason = "an example shows what it does")]

use covis_client::depth_noise::kinect_sigma_m;
use covis_client::wire::v1;
use covis_client::{Client, ClientError, SessionOptions, WatchOptions};
use prost_types::Timestamp;
use v1::keyframe::Sensor;

const FOCAL_PX: f64 = 525.0;
const CENTER_PX: [f64; 2] = [319.5, 239.5];
/// Keyframes of the drive, there and back.
const KEYFRAMES: i64 = 24;

#[tokio::main]
async fn main() -> Result<(), ClientError> {
    let url = std::env::args().nth(1).unwrap_or_else(|| "http://127.0.0.1:7411".to_owned());
    for pose in drive(&url, "first").await? {
        let id = pose.keyframe.map_or(0, |keyframe| keyframe.id);
        let x = pose.world_from_camera.and_then(|pose| pose.translation).map_or(0.0, |t| t.x);
        let (odometry, truth) = (odom_x(id), true_x(id));
        println!("keyframe {id:>2}: odometry {odometry:.3} m, map {x:.3} m, truth {truth:.3} m");
    }
    Ok(())
}

/// Drives once and returns the poses of the map.
pub async fn drive(url: &str, map_id: &str) -> Result<Vec<v1::KeyframePose>, ClientError> {
    let client = Client::connect(url).await?;
    if client.find_map(map_id).await?.is_none() {
        client.create_map(map_id, None).await?;
    }

    // Corrections come on a stream of their own. What moved by less than a millimeter and a
    // milliradian is not sent, and landmarks are of no use to this frontend.
    let options = WatchOptions {
        omit_landmarks: true,
        position_resolution_m: 1e-3,
        rotation_resolution_rad: 1e-3,
        ..WatchOptions::default()
    };
    let mut map = client.watch(map_id, options).await?;
    let (correction, corrected) = tokio::sync::watch::channel(at(0.0));
    let follower = tokio::spawn(async move {
        while let Ok(mirror) = map.next().await {
            if let Some(map_from_odom) = mirror.map_from_odom("robot") {
                correction.send_replace(*map_from_odom);
            }
        }
    });

    // The session numbers items, keeps those without an answer and sends them again after a break.
    let options = SessionOptions::default().on_ack(|ack| {
        for violation in &ack.violations {
            println!("item {}: {}: {}", ack.sequence, violation.field, violation.description);
        }
    });
    let mut session = client.ingest(map_id, "robot", options).await?;
    session.send(camera()).await?;
    for id in 0..KEYFRAMES {
        // Where the robot is in the map, as far as it is known now.
        let start = compose(&corrected.borrow(), &at(odom_x(id)));
        session.send(keyframe(id, start)).await?;
        if id > 0 {
            session.send(odometry(id)).await?;
        }
    }
    // The robot is back and recognizes where it began.
    session.send(loop_closure()).await?;
    // All acks, also those of the last solve.
    session.finish().await?;
    follower.abort();
    Ok(client.trajectory(map_id, Some("robot")).await?.poses)
}

fn camera() -> v1::Camera {
    let [cx, cy] = CENTER_PX;
    let model =
        v1::PinholeRadialTangential { fx: FOCAL_PX, fy: FOCAL_PX, cx, cy, ..Default::default() };
    v1::Camera {
        id: 0,
        width_px: 640,
        height_px: 480,
        model: Some(v1::camera::Model::PinholeRadialTangential(model)),
        ..Default::default()
    }
}

fn keyframe(id: i64, start: v1::RigidTransform) -> v1::Keyframe {
    let seen = landmarks_in_view(id);
    let is_new = |landmark: &i64| id == 0 || !landmarks_in_view(id - 1).contains(landmark);
    v1::Keyframe {
        id,
        capture_time: Some(Timestamp { seconds: 1_700_000_000 + id, nanos: 0 }),
        sensor: Some(Sensor::CameraId(0)),
        world_from_camera: Some(start),
        odom_from_camera: Some(at(odom_x(id))),
        // Without position: the server places them by their depth.
        landmarks: seen
            .iter()
            .filter(|landmark| is_new(landmark))
            .map(|&id| v1::Landmark { id, ..Default::default() })
            .collect(),
        observations: seen.iter().map(|&landmark| observation(id, landmark)).collect(),
        ..Default::default()
    }
}

fn observation(keyframe: i64, landmark: i64) -> v1::Observation {
    let [x, y, z] = point(landmark);
    let sigma_px = 1.0;
    let sigma_depth_m = kinect_sigma_m(z);
    let u = FOCAL_PX * (x - true_x(keyframe)) / z + CENTER_PX[0];
    let v = FOCAL_PX * y / z + CENTER_PX[1];
    v1::Observation {
        landmark: Some(v1::LandmarkRef { id: landmark, ..Default::default() }),
        pixel: Some(v1::Vector2 {
            x: u + sigma_px * noise(keyframe, landmark),
            y: v + sigma_px * noise(landmark, keyframe),
        }),
        sigma_px: Some(sigma_px),
        depth_m: Some(z + sigma_depth_m * noise(keyframe + 1, landmark)),
        sigma_depth_m: Some(sigma_depth_m),
        ..Default::default()
    }
}

/// From one keyframe to the next by odometry: exact to 5 % of the way and 5 mm, and to half a degree.
fn odometry(id: i64) -> v1::RelativePoseConstraint {
    let step = odom_x(id) - odom_x(id - 1);
    constraint(id, id - 1, id, step, 0.05 * step.abs() + 0.005, v1::ConstraintKind::Odometry)
}

/// The last keyframe is where the first one was, to a centimeter and half a degree.
fn loop_closure() -> v1::RelativePoseConstraint {
    let last = KEYFRAMES - 1;
    let x = true_x(last) - true_x(0);
    constraint(0, 0, last, x, 0.01, v1::ConstraintKind::LoopClosure)
}

fn constraint(
    id: i64,
    i: i64,
    j: i64,
    x: f64,
    sigma_m: f64,
    kind: v1::ConstraintKind,
) -> v1::RelativePoseConstraint {
    let keyframe = |id| Some(v1::KeyframeRef { id, ..Default::default() });
    v1::RelativePoseConstraint {
        id,
        keyframe_i: keyframe(i),
        keyframe_j: keyframe(j),
        keyframe_i_from_keyframe_j: Some(at(x)),
        information: Some(information(sigma_m, 0.5_f64.to_radians())),
        kind: kind.into(),
        ..Default::default()
    }
}

/// Independent errors of translation (m) and rotation (rad), as the wire packs them: the upper
/// triangle of the inverse covariance, row by row, translation first.
fn information(sigma_m: f64, sigma_rad: f64) -> v1::InformationMatrix6 {
    let diagonal = |k: usize| if k < 3 { sigma_m.powi(-2) } else { sigma_rad.powi(-2) };
    let entry = |i: usize, j: usize| if i == j { diagonal(i) } else { 0.0 };
    let upper_triangle = (0..6).flat_map(|i| (i..6).map(move |j| entry(i, j))).collect();
    v1::InformationMatrix6 { upper_triangle }
}

/// a · b: first b, then a.
fn compose(a: &v1::RigidTransform, b: &v1::RigidTransform) -> v1::RigidTransform {
    let (p, q) = (a.rotation.unwrap_or_default(), b.rotation.unwrap_or_default());
    let (s, t) = (a.translation.unwrap_or_default(), b.translation.unwrap_or_default());
    // The rotated t is t + 2 (w v + n × v) with v = n × t, n the vector part of p.
    let v = cross([p.x, p.y, p.z], [t.x, t.y, t.z]);
    let u = cross([p.x, p.y, p.z], v);
    v1::RigidTransform {
        translation: Some(v1::Vector3 {
            x: s.x + t.x + 2.0 * (p.w * v[0] + u[0]),
            y: s.y + t.y + 2.0 * (p.w * v[1] + u[1]),
            z: s.z + t.z + 2.0 * (p.w * v[2] + u[2]),
        }),
        rotation: Some(v1::Quaternion {
            x: p.w * q.x + p.x * q.w + p.y * q.z - p.z * q.y,
            y: p.w * q.y - p.x * q.z + p.y * q.w + p.z * q.x,
            z: p.w * q.z + p.x * q.y - p.y * q.x + p.z * q.w,
            w: p.w * q.w - p.x * q.x - p.y * q.y - p.z * q.z,
        }),
    }
}

fn cross(a: [f64; 3], b: [f64; 3]) -> [f64; 3] {
    [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
}

/// A pose without rotation.
fn at(x: f64) -> v1::RigidTransform {
    v1::RigidTransform {
        translation: Some(v1::Vector3 { x, y: 0.0, z: 0.0 }),
        rotation: Some(v1::Quaternion { x: 0.0, y: 0.0, z: 0.0, w: 1.0 }),
    }
}

// From here on: the world and the tracking that a real robot has.

/// Where the camera really is: along the wall and back, 15 cm a keyframe.
pub fn true_x(keyframe: i64) -> f64 {
    0.15 * keyframe.min(KEYFRAMES - 1 - keyframe) as f64
}

/// Where odometry says that it is: it counts 4 % too much on the way there, too little on the way
/// back.
pub fn odom_x(keyframe: i64) -> f64 {
    let turn = (KEYFRAMES - 1) / 2;
    let there = 1.04 * true_x(keyframe.min(turn));
    let back = 0.96 * (true_x(keyframe.max(turn)) - true_x(turn));
    there + back
}

/// The tracking finds the points again that the keyframe before saw. On the way back it takes the
/// wall for new: its landmarks have other ids.
fn landmarks_in_view(keyframe: i64) -> Vec<i64> {
    let first = if keyframe < KEYFRAMES / 2 { 0 } else { 10_000 };
    let column = (true_x(keyframe) / 0.15).round() as i64;
    (column * 10..(column + 16) * 10).map(|id| first + id).collect()
}

/// Ten points in each column of an uneven wall about 3 m away.
fn point(landmark: i64) -> [f64; 3] {
    let id = landmark % 10_000;
    let (column, row) = (id / 10 - 8, id % 10);
    [0.15 * column as f64, -0.9 + 0.2 * row as f64, 3.0 + 0.3 * noise(id, 7)]
}

/// Numbers between -1 and 1 that look random and are the same in every run.
fn noise(a: i64, b: i64) -> f64 {
    let mixed = (a * 7919 + b * 104_729 + 17).wrapping_mul(0x9E37_79B9_7F4A_7C15_u64 as i64);
    ((mixed >> 20) & 0xffff) as f64 / 32_768.0 - 1.0
}
