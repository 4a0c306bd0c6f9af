//! How long keyframes take from arrays to their acks: the Rust side of `python/benches/keyframes.py`.
//!
//! `keyframes URL MAP KEYFRAMES OBSERVATIONS`. The map exists and solves nothing by itself. Each
//! keyframe is made from arrays of pixels, depths and ids as a frontend has them. Prints the seconds
//! from the first keyframe to the last ack.

#![allow(clippy::print_stdout, reason = "a bench shows what it measured")]

use std::time::Instant;

use covis_client::depth_noise::kinect_sigma_m;
use covis_client::wire::v1;
use covis_client::{Client, ClientError, SessionOptions};

/// What a frontend has of a keyframe.
struct View {
    pixels: Vec<[f64; 2]>,
    depths: Vec<f64>,
    landmarks: Vec<i64>,
    points: Vec<[f64; 3]>,
}

/// A grid of points on a plane 4 m away, half of which each keyframe sees for the first time.
fn view(keyframe: i64, observations: usize) -> View {
    let first = keyframe * (observations / 2) as i64;
    let landmarks: Vec<i64> = (0..observations as i64).map(|k| first + k).collect();
    let pixel = |k: usize| [(k % 40) as f64 * 16.0, (k / 40) as f64 * 19.0];
    let pixels: Vec<[f64; 2]> = (0..observations).map(pixel).collect();
    let point = |[u, v]: &[f64; 2]| [(u - 319.5) / 500.0 * 4.0, (v - 239.5) / 500.0 * 4.0, 4.0];
    let points = pixels.iter().map(point).collect();
    View { pixels, depths: vec![4.0; observations], landmarks, points }
}

fn message(id: i64, view: &View) -> v1::Keyframe {
    let observation = |k: usize| v1::Observation {
        landmark: Some(v1::LandmarkRef { id: view.landmarks[k], ..Default::default() }),
        pixel: Some(v1::Vector2 { x: view.pixels[k][0], y: view.pixels[k][1] }),
        depth_m: Some(view.depths[k]),
        sigma_depth_m: Some(kinect_sigma_m(view.depths[k])),
        ..Default::default()
    };
    let count = view.landmarks.len();
    let known = if id == 0 { 0 } else { count - count / 2 };
    let landmark = |k: usize| {
        let [x, y, z] = view.points[k];
        let point_in_world = Some(v1::Vector3 { x, y, z });
        v1::Landmark { id: view.landmarks[k], point_in_world, ..Default::default() }
    };
    v1::Keyframe {
        id,
        capture_time: Some(prost_types::Timestamp { seconds: 100 + id, nanos: 0 }),
        sensor: Some(v1::keyframe::Sensor::CameraId(0)),
        world_from_camera: Some(v1::RigidTransform {
            translation: Some(v1::Vector3::default()),
            rotation: Some(v1::Quaternion { w: 1.0, ..Default::default() }),
        }),
        observations: (0..count).map(observation).collect(),
        landmarks: (known..count).map(landmark).collect(),
        ..Default::default()
    }
}

fn camera() -> v1::Camera {
    let model = v1::PinholeRadialTangential {
        fx: 500.0,
        fy: 500.0,
        cx: 319.5,
        cy: 239.5,
        ..Default::default()
    };
    let model = Some(v1::camera::Model::PinholeRadialTangential(model));
    v1::Camera { width_px: 640, height_px: 480, model, ..Default::default() }
}

#[tokio::main(flavor = "current_thread")]
async fn main() -> Result<(), Box<dyn std::error::Error>> {
    let [url, map, keyframes, observations] = arguments()?;
    let (keyframes, observations) = (keyframes.parse::<i64>()?, observations.parse::<usize>()?);
    let views: Vec<View> = (0..keyframes).map(|id| view(id, observations)).collect();
    println!("{:.6}", drive(&url, &map, &views).await?);
    Ok(())
}

fn arguments() -> Result<[String; 4], String> {
    let given: Vec<String> = std::env::args().skip(1).collect();
    given.try_into().map_err(|_given| "URL MAP KEYFRAMES OBSERVATIONS".to_owned())
}

async fn drive(url: &str, map: &str, views: &[View]) -> Result<f64, ClientError> {
    let client = Client::connect(url).await?;
    let mut session = client.ingest(map, "robot", SessionOptions::default()).await?;
    session.send(camera()).await?;
    session.flush().await?;
    let begin = Instant::now();
    for (id, view) in (0..).zip(views) {
        session.send(message(id, view)).await?;
    }
    session.finish().await?;
    Ok(begin.elapsed().as_secs_f64())
}
