//! How long a keyframe waits for its local bundle adjustment while several robots stream at once.
//!
//! `cargo bench --bench load -- [--robots N] [--hz F] [--keyframes N] [--landmarks N] [--monocular]`
//!
//! A real server on a loopback port, one map and one ingest session a robot, each walking its own
//! scene with depth, or without and with landmarks that the server places. Keyframes leave at fixed
//! times, whatever the server does. A keyframe's wait is from the call of `send` to the OPTIMIZED ack that covers it, so it holds encoding, transport,
//! checks, the journal, the queue, the solve and the way back. The last row is the server's own: how
//! long a map's task held a thread of the async runtime at a time. Robots and server share the machine.

#![allow(clippy::print_stdout, reason = "a bench shows what it measured")]

mod timing;

use std::collections::VecDeque;
use std::sync::{Arc, Mutex, PoisonError};
use std::time::{Duration, Instant};

use clap::Parser;
use covis::client::{Client, IngestReport, SessionOptions};
use covis::service::{Server, ServerConfig};
use covis::wire::v1;
use covis_solvers::geometry::{Camera, Se3};
use covis_solvers::testing::{Scene, SceneOptions};
use nalgebra::{Vector2, Vector3};
use tokio::io::{AsyncReadExt, AsyncWriteExt};

use crate::timing::milliseconds;

/// Load on a server by several robots.
#[derive(Clone, Parser)]
struct Args {
    /// Robots that stream at the same time.
    #[arg(long, default_value_t = 4)]
    robots: usize,
    /// Keyframes a second of each.
    #[arg(long, default_value_t = 5.0)]
    hz: f64,
    /// Keyframes of each.
    #[arg(long, default_value_t = 150)]
    keyframes: usize,
    /// Landmarks of each scene.
    #[arg(long, default_value_t = 4000)]
    landmarks: usize,
    /// Send neither depths nor positions.
    #[arg(long)]
    monocular: bool,
    /// Given by cargo.
    #[arg(long, hide = true)]
    bench: bool,
}

/// What the acks of one robot told.
#[derive(Default)]
struct Waits {
    /// Keyframes on the way: sequence and when they were sent.
    open: VecDeque<(i64, Instant)>,
    /// From send to OPTIMIZED, in seconds.
    waits_s: Vec<f64>,
    /// Of the solves alone, in seconds.
    solves_s: Vec<f64>,
    iterations: i64,
}

#[tokio::main]
async fn main() -> anyhow::Result<()> {
    let args = Args::parse();
    let listener = tokio::net::TcpListener::bind("127.0.0.1:0").await?;
    let metrics_listen = Some("127.0.0.1:0".to_owned());
    let config = ServerConfig { metrics_listen, ..ServerConfig::default() };
    let server = Server::start(listener, config).await?;
    let url = format!("http://{}", server.local_addr());
    let robots: Vec<_> = (0..args.robots)
        .map(|robot| tokio::spawn(walk(url.clone(), robot, args.clone())))
        .collect();
    let mut all = Waits::default();
    let mut observations = 0;
    for robot in robots {
        let (waits, sent) = robot.await??;
        all.waits_s.extend(waits.waits_s);
        all.solves_s.extend(waits.solves_s);
        all.iterations += waits.iterations;
        observations += sent;
    }
    let page = match server.metrics_addr() {
        Some(address) => page(address).await?,
        None => String::new(),
    };
    server.shutdown().await;
    let keyframes = args.robots * args.keyframes;
    println!(
        "{} robots, {} keyframes a second each, {} keyframes of {} observations on average",
        args.robots,
        args.hz,
        keyframes,
        observations / keyframes.max(1)
    );
    println!("{:>28} {:>8} {:>8} {:>8} {:>8}", "milliseconds", "count", "p50", "p99", "max");
    print_row("send to OPTIMIZED", &mut all.waits_s);
    print_row("local bundle adjustment", &mut all.solves_s);
    print_held(&page);
    let solves = all.solves_s.len().max(1);
    println!("{:.1} iterations a solve", all.iterations as f64 / solves as f64);
    Ok(())
}

fn print_row(name: &str, seconds: &mut [f64]) {
    let [p50, p99, max] = milliseconds(seconds);
    println!("{name:>28} {:>8} {p50:>8.2} {p99:>8.2} {max:>8.2}", seconds.len());
}

/// The metrics page.
async fn page(address: std::net::SocketAddr) -> anyhow::Result<String> {
    let mut stream = tokio::net::TcpStream::connect(address).await?;
    stream.write_all(b"GET /metrics HTTP/1.0\r\n\r\n").await?;
    let mut page = String::new();
    stream.read_to_string(&mut page).await?;
    Ok(page)
}

/// Which share of the times that engines held a thread stayed below which bound.
fn print_held(page: &str) {
    let rows = page.lines().filter_map(|line| {
        let rest = line.strip_prefix("covis_engine_held_seconds_bucket{le=\"")?;
        let (bound, count) = rest.split_once("\"} ")?;
        // What passes every bound is infinite, which is a number to the parser.
        Some((bound.replace("+Inf", "inf").parse::<f64>().ok()?, count.trim().parse::<f64>().ok()?))
    });
    let rows: Vec<(f64, f64)> = rows.collect();
    let all = rows.last().map_or(0.0, |row| row.1);
    let within = |share: f64| {
        let row = rows.iter().find(|row| row.1 >= share * all);
        row.map_or(f64::NAN, |row| 1000.0 * row.0)
    };
    let [half, most, nearly_all] = [0.5, 0.99, 0.999].map(within);
    println!(
        "{:>28} {all:>8} times, half within {half} ms, 99 % within {most} ms, 99.9 % within \
         {nearly_all} ms",
        "an engine held a thread"
    );
}

/// Streams one robot's walk; returns what it waited for and how many observations it sent.
async fn walk(url: String, robot: usize, args: Args) -> anyhow::Result<(Waits, usize)> {
    let options = SceneOptions {
        keyframes: args.keyframes,
        landmarks: args.landmarks,
        seed: robot as u64 + 1,
        ..SceneOptions::default()
    };
    let scene = Scene::generate(&options);
    let client = Client::connect(&url).await?;
    let map = format!("robot-{robot}");
    client.create_map(&map, None).await?;
    let waits = Arc::new(Mutex::new(Waits::default()));
    let seen = Arc::clone(&waits);
    let options = SessionOptions::default().on_ack(move |ack| record(&seen, ack));
    let mut session = client.ingest(&map, "robot", options).await?;
    session.send(camera(&scene)).await?;

    let period = Duration::from_secs_f64(1.0 / args.hz);
    let offset = period.mul_f64(robot as f64 / args.robots as f64);
    let mut clock = tokio::time::interval_at(tokio::time::Instant::now() + offset, period);
    let mut is_known = vec![false; scene.landmarks.len()];
    let mut observations = 0;
    for (index, pose) in scene.odometry.iter().enumerate() {
        let mut keyframe = keyframe(&scene, index, pose, &mut is_known);
        if args.monocular {
            keyframe.landmarks.iter_mut().for_each(|landmark| landmark.point_in_world = None);
            for observation in &mut keyframe.observations {
                (observation.depth_m, observation.sigma_depth_m) = (None, None);
            }
        }
        observations += keyframe.observations.len();
        clock.tick().await;
        let sequence = session.next_sequence();
        lock(&waits).open.push_back((sequence, Instant::now()));
        session.send_as(sequence, keyframe).await?;
    }
    let IngestReport { rejected, failed_solves, .. } = session.finish().await?;
    anyhow::ensure!(rejected == 0, "{rejected} items of robot {robot} were refused");
    anyhow::ensure!(failed_solves == 0, "{failed_solves} solves of robot {robot} failed");
    let waits = std::mem::take(&mut *lock(&waits));
    anyhow::ensure!(waits.open.is_empty(), "keyframes of robot {robot} were never optimized");
    Ok((waits, observations))
}

fn lock(waits: &Mutex<Waits>) -> std::sync::MutexGuard<'_, Waits> {
    waits.lock().unwrap_or_else(PoisonError::into_inner)
}

fn record(waits: &Mutex<Waits>, ack: &v1::IngestAck) {
    if ack.status() != v1::AckStatus::Optimized {
        return;
    }
    let mut waits = lock(waits);
    while let Some(&(sequence, sent)) = waits.open.front()
        && sequence <= ack.sequence
    {
        waits.open.pop_front();
        waits.waits_s.push(sent.elapsed().as_secs_f64());
    }
    if let Some(summary) = &ack.solve_summary {
        waits.solves_s.push(summary.solve_duration_us as f64 * 1e-6);
        waits.iterations += i64::from(summary.iteration_count);
    }
}

fn camera(scene: &Scene) -> v1::Camera {
    let model = match scene.camera {
        Camera::Pinhole(c) => v1::PinholeRadialTangential {
            fx: c.fx,
            fy: c.fy,
            cx: c.cx,
            cy: c.cy,
            ..v1::PinholeRadialTangential::default()
        },
        Camera::Fisheye(_) | Camera::Snavely(_) => v1::PinholeRadialTangential::default(),
    };
    v1::Camera {
        id: 0,
        width_px: scene.image_px.0 as i32,
        height_px: scene.image_px.1 as i32,
        model: Some(v1::camera::Model::PinholeRadialTangential(model)),
        ..v1::Camera::default()
    }
}

/// Keyframe `index` at `pose`; landmarks that it sees first come along, placed by their depth.
fn keyframe(scene: &Scene, index: usize, pose: &Se3, is_known: &mut [bool]) -> v1::Keyframe {
    let mut keyframe = v1::Keyframe {
        id: index as i64,
        capture_time: Some(prost_types::Timestamp {
            seconds: scene.timestamps_s[index] as i64,
            nanos: ((scene.timestamps_s[index] % 1.0) * 1e9) as i32,
        }),
        sensor: Some(v1::keyframe::Sensor::CameraId(0)),
        world_from_camera: Some(rigid(pose)),
        odom_from_camera: Some(rigid(pose)),
        ..v1::Keyframe::default()
    };
    for observation in &scene.observations[index] {
        let (landmark, m) = (observation.landmark, &observation.measurement);
        if !std::mem::replace(&mut is_known[landmark], true) {
            let ray = scene.camera.unproject(&m.pixel);
            let point = ray.map(|ray| pose.transform(&(ray * (m.depth_m / ray.z))));
            keyframe.landmarks.push(v1::Landmark {
                id: landmark as i64,
                point_in_world: point.as_ref().map(vector3),
                ..v1::Landmark::default()
            });
        }
        keyframe.observations.push(v1::Observation {
            landmark: Some(v1::LandmarkRef { id: landmark as i64, ..v1::LandmarkRef::default() }),
            pixel: Some(vector2(&m.pixel)),
            sigma_px: Some(m.sigma_px),
            depth_m: Some(m.depth_m),
            sigma_depth_m: Some(m.sigma_depth_m),
            ..v1::Observation::default()
        });
    }
    keyframe
}

fn rigid(transform: &Se3) -> v1::RigidTransform {
    let q = transform.rotation.quaternion();
    v1::RigidTransform {
        translation: Some(vector3(&transform.translation)),
        rotation: Some(v1::Quaternion { x: q.i, y: q.j, z: q.k, w: q.w }),
    }
}

fn vector3(v: &Vector3<f64>) -> v1::Vector3 {
    v1::Vector3 { x: v.x, y: v.y, z: v.z }
}

fn vector2(v: &Vector2<f64>) -> v1::Vector2 {
    v1::Vector2 { x: v.x, y: v.y }
}
