//! How long it takes until a loop that the server finds itself has corrected the map.
//!
//! `cargo bench --bench found_loops -- [--keyframes N] [--loops N] [--seed N]`
//!
//! A robot with a depth camera goes twice around a square with noisy odometry. The server looks for
//! places from the last keyframes on, each of which shows a place of the first lap. A wait is from the
//! call of `send` of such a keyframe to the delta that says that the map is corrected, in a client
//! that watches over a loopback port: transport, journal, index, verification, judgment, solve, delta.
//! The first wait, which also makes the index, is a row of its own.

#![allow(clippy::print_stdout, reason = "a bench shows what it measured")]

mod timing;

use std::collections::BTreeSet;
use std::time::{Duration, Instant};

use clap::Parser;
use covis::client::{Client, MapMirror, MapWatch, SessionOptions, WatchOptions};
use covis::service::{Server, ServerConfig};
use covis::wire::v1;
use covis_solvers::geometry::{LieGroup, Se3, So3};
use covis_solvers::testing::random::{normal_vector, perturbed, seeded};
use nalgebra::{Vector3, Vector6};
use rand::{Rng, RngExt};

use crate::timing::milliseconds;

/// Waits for corrected maps.
#[derive(Clone, Parser)]
struct Args {
    /// Keyframes of the two laps.
    #[arg(long, default_value_t = 2500)]
    keyframes: usize,
    /// Last keyframes whose places are searched.
    #[arg(long, default_value_t = 50)]
    loops: usize,
    /// Of the scene and the noise.
    #[arg(long, default_value_t = 1)]
    seed: u64,
    /// Given by cargo.
    #[arg(long, hide = true)]
    bench: bool,
}

/// Points of a place, a meter of the way long. A keyframe sees those of [`SEEN`] places.
const POINTS: usize = 100;
const SEEN: usize = 4;
/// Standard deviations of a step of odometry: 1 cm and 0.1°.
const STEP: [f64; 6] = [0.01, 0.01, 0.01, 0.0017, 0.0017, 0.0017];
/// Of a pixel, and the focal length, px.
const SIGMA_PX: f64 = 0.7;
const FOCAL_PX: f64 = 525.0;
/// Share of the bits of a descriptor that differ from one view to the next.
const FLIPPED: f64 = 0.12;
/// After so long no loop was found and solved for.
const PATIENCE: Duration = Duration::from_secs(20);

/// A point in the frame of the keyframe that begins its place, and what it looks like.
struct Point {
    position: Vector3<f64>,
    descriptor: [u8; 32],
}

#[tokio::main]
async fn main() -> anyhow::Result<()> {
    let args = Args::parse();
    let mut rng = seeded(args.seed);
    let lap = args.keyframes / 2 / 4 * 4;
    let turn = So3::exp(&Vector3::new(0.0, std::f64::consts::FRAC_PI_2, 0.0));
    let ahead = Se3::new(So3::identity(), Vector3::new(0.0, 0.0, 1.0));
    let corner = Se3::new(turn, Vector3::new(0.0, 0.0, 1.0));
    let (mut truth, mut odometry) = (vec![Se3::identity()], vec![Se3::identity()]);
    for k in 1..args.keyframes {
        let step = if k % (lap / 4).max(1) == 0 { corner } else { ahead };
        truth.push(truth[k - 1].compose(&step));
        let noisy: Se3 = perturbed(&mut rng, &step, &Vector6::from(STEP));
        odometry.push(odometry[k - 1].compose(&noisy));
    }
    let point = |rng: &mut dyn Rng| Point {
        position: Vector3::new(
            6.0 * rng.random::<f64>() - 3.0,
            3.0 * rng.random::<f64>() - 1.5,
            6.0 + 3.0 * rng.random::<f64>(),
        ),
        descriptor: rng.random(),
    };
    let places: Vec<Vec<Point>> =
        (0..lap).map(|_| (0..POINTS).map(|_| point(&mut rng)).collect()).collect();

    let listener = tokio::net::TcpListener::bind("127.0.0.1:0").await?;
    let server = Server::start(listener, ServerConfig::default()).await?;
    let client = Client::connect(&format!("http://{}", server.local_addr())).await?;
    client.create_map("loop", Some(policy(false))).await?;
    let mut session = client.ingest("loop", "robot", SessionOptions::default()).await?;
    session.send(camera()).await?;
    let mut sent = BTreeSet::new();
    let mut seen_by: Vec<v1::Keyframe> = Vec::new();
    for (k, pose) in odometry.iter().enumerate() {
        seen_by.push(keyframe((k, pose), (&truth, &places, lap), &mut sent, &mut rng));
    }
    let last = seen_by.split_off(args.keyframes - args.loops);
    let before = seen_by.len();
    for keyframe in seen_by {
        session.send(keyframe).await?;
    }
    let mut watch =
        client.watch("loop", WatchOptions { omit_landmarks: true, ..Default::default() }).await?;
    while watch.mirror().keyframes.len() < before {
        watch.next().await?;
    }
    let request = v1::UpdateMapRequest {
        map_id: "loop".to_owned(),
        policy: Some(policy(true)),
        update_mask: Some(prost_types::FieldMask {
            paths: vec!["policy.place_recognition.enabled".to_owned()],
        }),
        ..v1::UpdateMapRequest::default()
    };
    client.update_map(request).await?;

    let mut waits = Vec::new();
    for keyframe in last {
        let sent = Instant::now();
        let id = keyframe.id;
        session.send(keyframe).await?;
        if tokio::time::timeout(PATIENCE, corrected(&mut watch, id)).await.is_ok() {
            waits.push(sent.elapsed().as_secs_f64());
        }
    }
    session.finish().await?;
    for search in client.place_searches("loop").await?.searches {
        let refusals = search.candidates.iter().filter_map(|c| c.refusal.as_ref());
        let reasons: Vec<&str> = refusals.map(|refusal| refusal.text.as_str()).collect();
        if search.closure.is_none() {
            println!("keyframe {}: {reasons:?}", search.keyframe.map_or(-1, |k| k.id));
        }
    }
    println!("{} keyframes, {} of {} loops found", args.keyframes, waits.len(), args.loops);
    anyhow::ensure!(waits.len() > 1, "no loops to measure");
    let first = waits.remove(0);
    println!("the first, with the index: {:.0} ms", 1e3 * first);
    println!("{:>32} {:>8} {:>8} {:>8}", "milliseconds", "p50", "p99", "max");
    let [p50, p99, max] = milliseconds(&mut waits);
    println!("{:>32} {p50:>8.2} {p99:>8.2} {max:>8.2}", "keyframe to corrected map");
    Ok(())
}

/// Waits until the closure of a keyframe is there and a pose graph has covered it. Poses do not show it: the
/// second closure of a place moves none of them far enough for a measurement to notice.
async fn corrected(watch: &mut MapWatch, keyframe: i64) -> anyhow::Result<()> {
    let is_closed = |map: &MapMirror| {
        map.constraints.values().any(|constraint| match &constraint.constraint {
            Some(v1::constraint::Constraint::RelativePose(pose)) => {
                pose.keyframe_j.as_ref().is_some_and(|j| j.id == keyframe)
            }
            _ => false,
        })
    };
    let is_settled = |map: &MapMirror| map.pending_work == Some(v1::PendingWork::default());
    while !is_closed(watch.mirror()) || !is_settled(watch.mirror()) {
        watch.next().await?;
    }
    Ok(())
}

/// Nothing else is solved, so that only loops are waited for.
fn policy(enabled: bool) -> v1::MapPolicy {
    v1::MapPolicy {
        local_bundle_adjustment: Some(false),
        closure_adjustment: Some(false),
        place_recognition: Some(v1::PlaceRecognition { enabled: Some(enabled) }),
        ..v1::MapPolicy::default()
    }
}

fn camera() -> v1::Camera {
    let model = v1::camera::Model::PinholeRadialTangential(v1::PinholeRadialTangential {
        fx: FOCAL_PX,
        fy: FOCAL_PX,
        cx: 319.5,
        cy: 239.5,
        ..v1::PinholeRadialTangential::default()
    });
    v1::Camera { width_px: 640, height_px: 480, model: Some(model), ..v1::Camera::default() }
}

/// What the robot sends of its k-th keyframe.
fn keyframe(
    (k, pose): (usize, &Se3),
    (truth, places, lap): (&[Se3], &[Vec<Point>], usize),
    sent: &mut BTreeSet<i64>,
    rng: &mut impl Rng,
) -> v1::Keyframe {
    let (mut observations, mut landmarks) = (Vec::new(), Vec::new());
    for step in k.saturating_sub(SEEN - 1)..=k {
        let points = &places[step % lap];
        for (number, point) in points.iter().enumerate() {
            // The frame of the place in the lap that the robot walks.
            let in_world = truth[step].transform(&point.position);
            let p = truth[k].inverse_transform(&in_world);
            let noise = normal_vector::<3>(rng, 1.0);
            let (u, v) = (FOCAL_PX * p.x / p.z + 319.5, FOCAL_PX * p.y / p.z + 239.5);
            let (u, v) = (u + SIGMA_PX * noise.x, v + SIGMA_PX * noise.y);
            if p.z < 0.6 || !(0.0..640.0).contains(&u) || !(0.0..480.0).contains(&v) {
                continue;
            }
            let sigma = 0.001_425 * p.z * p.z + 0.002;
            let depth = p.z + sigma * noise.z;
            let mut flip = |byte: u8| {
                (0..8).fold(byte, |b, bit| b ^ u8::from(rng.random_bool(FLIPPED)) << bit)
            };
            let data = point.descriptor.map(&mut flip).to_vec();
            let id = (step * POINTS + number) as i64;
            observations.push(v1::Observation {
                landmark: Some(v1::LandmarkRef { id, ..v1::LandmarkRef::default() }),
                pixel: Some(v1::Vector2 { x: u, y: v }),
                sigma_px: Some(SIGMA_PX),
                depth_m: Some(depth),
                sigma_depth_m: Some(sigma),
                descriptor: Some(v1::Descriptor {
                    kind: v1::DescriptorKind::Binary.into(),
                    name: "orb".to_owned(),
                    data,
                }),
                ..v1::Observation::default()
            });
            let ray = Vector3::new((u - 319.5) / FOCAL_PX, (v - 239.5) / FOCAL_PX, 1.0);
            let start = pose.transform(&(ray * depth));
            if sent.insert(id) {
                landmarks.push(v1::Landmark {
                    id,
                    point_in_world: Some(v1::Vector3 { x: start.x, y: start.y, z: start.z }),
                    ..v1::Landmark::default()
                });
            }
        }
    }
    let (q, t) = (pose.rotation.quaternion(), pose.translation);
    v1::Keyframe {
        id: k as i64,
        capture_time: Some(prost_types::Timestamp { seconds: k as i64, nanos: 0 }),
        sensor: Some(v1::keyframe::Sensor::CameraId(0)),
        world_from_camera: Some(v1::RigidTransform {
            translation: Some(v1::Vector3 { x: t.x, y: t.y, z: t.z }),
            rotation: Some(v1::Quaternion { x: q.i, y: q.j, z: q.k, w: q.w }),
        }),
        observations,
        landmarks,
        ..v1::Keyframe::default()
    }
}
