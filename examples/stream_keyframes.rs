//! The shortest frontend: makes a map, streams a few keyframes, reads the corrected poses.
//!
//! Start a server (`cargo run --release -- serve`), then
//! `cargo run --release --example stream_keyframes [URL]`. A real frontend takes pixels and start
//! poses from its tracking; here a camera slides along a wall of known points, and its start poses
//! are off by some centimeters.

#![allow(clippy::print_stdout, reason = "an example shows what it does")]

use covis::client::{Client, SessionOptions};
use covis::wire::v1;

/// Focal length and principal point of a 640 x 480 camera, px.
const FOCAL: f64 = 500.0;
const CENTER: [f64; 2] = [319.5, 239.5];

#[tokio::main]
async fn main() -> anyhow::Result<()> {
    let url = std::env::args().nth(1).unwrap_or_else(|| "http://127.0.0.1:7411".to_owned());
    let client = Client::connect(&url).await?;
    if client.find_map("example").await?.is_some() {
        client.delete_map("example").await?;
    }
    client.create_map("example", None).await?;

    // Sends wait while too many items are unanswered; a broken link is resumed on its own.
    let mut session = client.ingest("example", "robot", SessionOptions::default()).await?;
    session.send(camera()).await?;
    for id in 0..6 {
        session.send(keyframe(id)).await?;
    }
    let report = session.finish().await?;
    println!("{} items sent, {} acknowledged", report.sent, report.acknowledged);
    for rejected in &report.rejections {
        println!("item {} was rejected: {:?}", rejected.sequence, rejected.violations);
    }

    println!("keyframe   start x (m)   optimized x (m)   truth (m)");
    for pose in client.trajectory("example", None).await?.poses {
        let id = pose.keyframe.map_or(0, |keyframe| keyframe.id);
        let position = pose.world_from_camera.and_then(|p| p.translation).unwrap_or_default();
        let (start, truth) = (start_position(id)[0], true_position(id)[0]);
        println!("{id:>8}   {start:>11.4}   {:>15.4}   {truth:>9.4}", position.x);
    }
    Ok(())
}

fn camera() -> v1::Camera {
    let [cx, cy] = CENTER;
    let pinhole =
        v1::PinholeRadialTangential { fx: FOCAL, fy: FOCAL, cx, cy, ..Default::default() };
    v1::Camera {
        id: 0,
        width_px: 640,
        height_px: 480,
        model: Some(v1::camera::Model::PinholeRadialTangential(pinhole)),
        ..Default::default()
    }
}

/// Keyframe `id` with all that it sees; the first one brings the landmarks along.
fn keyframe(id: i64) -> v1::Keyframe {
    let [x, y, z] = start_position(id);
    v1::Keyframe {
        id,
        capture_time: Some(prost_types::Timestamp { seconds: 100 + id, nanos: 0 }),
        sensor: Some(v1::keyframe::Sensor::CameraId(0)),
        world_from_camera: Some(v1::RigidTransform {
            translation: Some(v1::Vector3 { x, y, z }),
            rotation: Some(v1::Quaternion { x: 0.0, y: 0.0, z: 0.0, w: 1.0 }),
        }),
        observations: (0..60).map(|landmark| observation(id, landmark)).collect(),
        landmarks: if id == 0 { (0..60).map(landmark).collect() } else { Vec::new() },
        ..Default::default()
    }
}

fn landmark(id: i64) -> v1::Landmark {
    let [x, y, z] = point(id);
    v1::Landmark { id, point_in_world: Some(v1::Vector3 { x, y, z }), ..Default::default() }
}

/// Where a landmark is seen, with the depth that an RGB-D camera or a stereo pair measures.
fn observation(keyframe: i64, landmark: i64) -> v1::Observation {
    let (camera, point) = (true_position(keyframe), point(landmark));
    let z = point[2] - camera[2];
    v1::Observation {
        landmark: Some(v1::LandmarkRef { id: landmark, ..Default::default() }),
        pixel: Some(v1::Vector2 {
            x: FOCAL * (point[0] - camera[0]) / z + CENTER[0],
            y: FOCAL * (point[1] - camera[1]) / z + CENTER[1],
        }),
        depth_m: Some(z),
        sigma_depth_m: Some(0.01),
        ..Default::default()
    }
}

/// A grid of points on an uneven wall about 4 m away.
fn point(id: i64) -> [f64; 3] {
    let k = id as f64;
    [-1.6 + 0.4 * (k % 10.0), -1.1 + 0.4 * (k / 10.0).floor(), 4.0 + 0.35 * ((k * 7.0) % 5.0)]
}

fn true_position(keyframe: i64) -> [f64; 3] {
    [0.1 * keyframe as f64, 0.0, 0.0]
}

fn start_position(keyframe: i64) -> [f64; 3] {
    [0.11 * keyframe as f64, 0.02 * (keyframe % 2) as f64, 0.0]
}
