//! How long a keyframe waits for its local bundle adjustment while several robots stream at once.
//!
//! `cargo bench --bench load -- [--robots N] [--hz F] [--keyframes N] [--landmarks N] [--monocular]
//! [--cancels N]`
//!
//! A real server on a loopback port, one map and one ingest session a robot, each walking its own
//! scene with depth, or without and with landmarks that the server places. Keyframes leave at fixed
//! times, whatever the server does. A keyframe's wait is from the call of `send` to the OPTIMIZED ack that covers it, so it holds encoding, transport,
//! checks, the journal, the queue, the solve and the way back. The last row is the server's own: how
//! long a map's task held a thread of the async runtime at a time. Robots and server share the machine.
//!
//! With `--cancels` jobs on the first robot's map follow: each is run once to its end, then canceled again
//! and again at places that are spread over that time. A row is the time from the call of `CancelJob` to
//! the state CANCELLED, and from there to the first step of a job that comes next, beside that of a job
//! that nothing came before: by their difference the canceled work held its threads.

#![allow(clippy::print_stdout, reason = "a bench shows what it measured")]

mod timing;

use std::time::{Duration, Instant};

use clap::Parser;
use covis::cli::load::robot::{LandmarkMeasurement, Schedule, Waits, drive, keyframe};
use covis::client::{Client, IngestReport};
use covis::frontend::mapping::messages;
use covis::service::{Server, ServerConfig};
use covis::wire::v1;
use covis_solvers::testing::{Scene, SceneOptions};
use tokio::io::{AsyncReadExt, AsyncWriteExt};
use v1::job_spec::Spec;

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
    /// How often a job of each kind is canceled.
    #[arg(long, default_value_t = 0)]
    cancels: usize,
    /// Given by cargo.
    #[arg(long, hide = true)]
    bench: bool,
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
    for robot in robots {
        all.add(robot.await??);
    }
    let mut rows = Vec::new();
    if args.cancels > 0 {
        let client = Client::connect(&url).await?;
        for (name, spec) in [("optimize-map", optimize()), ("rebuild", rebuild())] {
            rows.extend(cancels(&client, name, &spec, args.cancels).await?);
        }
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
        all.observations / keyframes.max(1)
    );
    println!("{:>28} {:>8} {:>8} {:>8} {:>8}", "milliseconds", "count", "p50", "p99", "max");
    print_row("send to OPTIMIZED", &mut all.optimized.waits_s);
    print_row("local bundle adjustment", &mut all.solves_s);
    print_held(&page);
    let solves = all.solves_s.len().max(1);
    println!("{:.1} iterations a solve", all.iterations as f64 / solves as f64);
    rows.iter_mut().for_each(|(name, seconds)| print_row(name, seconds));
    Ok(())
}

fn optimize() -> Spec {
    let map_id = "robot-0".to_owned();
    Spec::OptimizeMap(v1::OptimizeMapRequest { map_id, ..v1::OptimizeMapRequest::default() })
}

fn rebuild() -> Spec {
    let map_id = "robot-0".to_owned();
    Spec::Reconstruct(v1::ReconstructSpec { map_id, ..v1::ReconstructSpec::default() })
}

/// Cancels jobs of a kind; rows of a table.
async fn cancels(
    client: &Client,
    name: &str,
    spec: &Spec,
    count: usize,
) -> anyhow::Result<Vec<(String, Vec<f64>)>> {
    let (mut canceled, mut idle, mut after) = (Vec::new(), Vec::new(), Vec::new());
    let begin = Instant::now();
    create(client, &format!("{name}-whole"), spec).await?;
    client.watch_job(&format!("{name}-whole"), |_| {}).await?;
    let whole = begin.elapsed();
    println!("{name}: {:.3} s to its end", whole.as_secs_f64());
    for round in 0..count {
        let id = format!("{name}-{round}");
        idle.push(first_step(client, &id, spec).await?.as_secs_f64());
        // Not to order events: a job that has ended by then has no time to measure.
        tokio::time::sleep(whole.mul_f64((round as f64 + 0.5) / count as f64)).await;
        let begin = Instant::now();
        if client.cancel_job(&id).await.is_err() {
            continue;
        }
        let job = client.watch_job(&id, |_| {}).await?;
        if job.state() == v1::JobState::Cancelled {
            canceled.push(begin.elapsed().as_secs_f64());
            let next = format!("{name}-{round}-next");
            after.push(first_step(client, &next, spec).await?.as_secs_f64());
            // One that has ended by then needs no cancel.
            let _ended = client.cancel_job(&next).await.is_err();
            client.watch_job(&next, |_| {}).await?;
        }
    }
    Ok(vec![
        (format!("{name}: cancel"), canceled),
        (format!("{name}: first step"), idle),
        (format!("{name}: after a cancel"), after),
    ])
}

async fn create(client: &Client, job_id: &str, spec: &Spec) -> anyhow::Result<()> {
    let (job_id, spec) = (job_id.to_owned(), Some(v1::JobSpec { spec: Some(spec.clone()) }));
    client.create_job(v1::CreateJobRequest { job_id, spec, priority: 0 }).await?;
    Ok(())
}

/// Creates a job; the time until its work has told of a first step, or it has ended.
async fn first_step(client: &Client, job_id: &str, spec: &Spec) -> anyhow::Result<Duration> {
    let begin = Instant::now();
    create(client, job_id, spec).await?;
    loop {
        let job = client.job(job_id).await?;
        let progress = job.progress.unwrap_or_default();
        if progress.iteration.is_some() || progress.share.is_some() || job.end_time.is_some() {
            return Ok(begin.elapsed());
        }
    }
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

/// Streams one robot's walk; returns what it waited for.
async fn walk(url: String, robot: usize, args: Args) -> anyhow::Result<Waits> {
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
    let period = Duration::from_secs_f64(1.0 / args.hz);
    let (_go_on, stop) = tokio::sync::watch::channel(false);
    let offset = period.mul_f64(robot as f64 / args.robots as f64);
    let schedule = Schedule { period, offset, stop };
    let mut is_known = vec![false; scene.landmarks.len()];
    let (width, height) = scene.image_px;
    let camera = messages::camera(0, &scene.camera, (width as i32, height as i32));
    let keyframes = (0..args.keyframes).map(|k| view(&scene, k, &mut is_known, args.monocular));
    let (waits, report) = drive(&client, &map, camera, keyframes, schedule).await?;
    let IngestReport { rejected, failed_solves, .. } = report;
    anyhow::ensure!(rejected == 0, "{rejected} items of robot {robot} were refused");
    anyhow::ensure!(failed_solves == 0, "{failed_solves} solves of robot {robot} failed");
    let unanswered = waits.optimized.unanswered();
    anyhow::ensure!(unanswered == 0, "keyframes of robot {robot} were never optimized");
    Ok(waits)
}

/// Keyframe `index`; landmarks that it sees first come along, placed by their depth unless monocular.
fn view(scene: &Scene, index: usize, is_known: &mut [bool], is_monocular: bool) -> v1::Keyframe {
    let pose = &scene.odometry[index];
    let measured: Vec<LandmarkMeasurement> = scene.observations[index]
        .iter()
        .map(|observation| {
            let (landmark, m) = (observation.landmark, &observation.measurement);
            let is_new = !std::mem::replace(&mut is_known[landmark], true);
            let ray = scene.camera.unproject(&m.pixel).filter(|_| is_new && !is_monocular);
            LandmarkMeasurement {
                landmark: landmark as i64,
                pixel: (m.pixel, m.sigma_px),
                depth_m: m.depth_m.filter(|_| !is_monocular),
                is_new,
                point_in_world: ray
                    .zip(m.depth_m)
                    .map(|(ray, (depth_m, _sigma))| pose.transform(&(ray * (depth_m / ray.z)))),
            }
        })
        .collect();
    keyframe(index as i64, scene.timestamps_s[index], pose, &measured)
}
