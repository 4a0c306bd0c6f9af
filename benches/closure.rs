//! What a loop closure of 0.3 m does to the times of frames, in tracking and in dense mapping.
//!
//! `cargo bench --bench closure -- SEQUENCE [--voxel 0.01] [--threads 2] [--hz 30] [--rounds 2]`
//!
//! Runs a TUM folder as `covis run --mesh` does, a server in this process included, with frames at the
//! rate of a camera. Dense mapping is told poses that drift by 0.3 m until half of the frames are in,
//! and then the true ones, so that the volume is built again while the other half comes; the run
//! beside it never drifts. A row is a time of the frames of the second half: of tracking, of waiting
//! for a place in the queue of dense mapping, of integrating the frame, and of following the
//! correction after it.

#![allow(clippy::print_stdout, reason = "a bench shows what it measured")]

mod timing;

use std::collections::BTreeMap;
use std::path::PathBuf;
use std::time::{Duration, Instant};

use anyhow::{Context, bail};
use clap::Parser;
use covis::client::Client;
use covis::frontend::camera::FrameCamera;
use covis::frontend::dense::frame_log::LoggedFrame;
use covis::frontend::dense::integrate::IntegrationOptions;
use covis::frontend::dense::mapper::{AnchoredFrame, DenseMapper};
use covis::frontend::dense::thread::{DenseFeed, DenseReport, DenseThread};
use covis::frontend::dense::volume::VolumeOptions;
use covis::frontend::image::{Image, RgbdFrame};
use covis::frontend::input::{FolderOptions, FrameError, open_folder};
use covis::frontend::mapping::run::{Companion, MOST_HELD, Target, run};
use covis::frontend::pipeline::{Outcome, Pipeline, PipelineOptions};
use covis::service::{Server, ServerConfig};
use covis_solvers::geometry::{LieGroup, Se3, So3};
use nalgebra::Vector3;

use crate::timing::milliseconds;

/// Frame times around a loop closure.
#[derive(Clone, Parser)]
struct Args {
    /// A folder in the layout of TUM RGB-D.
    sequence: PathBuf,
    /// Edge of a voxel, meters.
    #[arg(long, default_value_t = 0.01)]
    voxel: f32,
    /// As of `covis run`: one of them is tracking's.
    #[arg(long, default_value_t = 2)]
    threads: usize,
    /// Frames a second; 0 is as fast as they are tracked.
    #[arg(long, default_value_t = 30.0)]
    hz: f64,
    /// Runs with and without a closure, in turns.
    #[arg(long, default_value_t = 2)]
    rounds: usize,
    /// Given by cargo.
    #[arg(long, hide = true)]
    bench: bool,
}

/// How far the drift has come where the loop is closed: 0.3 m, and a turn.
fn drift(share: f64) -> Se3 {
    let turn = So3::exp(&Vector3::new(0.01, -0.03, 0.02).scale(share));
    Se3::new(turn, Vector3::new(0.2, 0.2, 0.1).scale(share))
}

/// Hands frames to dense mapping as a run does, at poses that drift until the loop is closed.
struct Feed {
    dense: DenseFeed,
    /// The frame after which the loop is closed; without it nothing drifts.
    closure: Option<usize>,
    /// Where each keyframe stood when it came, which here is the truth.
    keyframes: BTreeMap<usize, Se3>,
    frames: usize,
    /// Between two frames.
    period: Duration,
    next: Option<Instant>,
    /// Seconds of each frame that was handed over: tracking it, and waiting for a place.
    track_s: Vec<f64>,
    wait_s: Vec<f64>,
    /// How many were handed over before the closure would be.
    before: usize,
    half: usize,
}

impl Companion for Feed {
    fn mask(&mut self, _timestamp_s: f64) -> Option<Image<u8>> {
        // The decoder is ahead, so that this is when the camera delivers.
        let now = Instant::now();
        let next = self.next.map_or(now, |next| next.max(now));
        std::thread::sleep(next - now);
        self.next = Some(next + self.period);
        None
    }

    fn tracked(&mut self, frame: &RgbdFrame, outcome: &Outcome) {
        self.frames += 1;
        if self.frames == self.half {
            self.before = self.track_s.len();
        }
        let is_new = outcome.keyframe.is_some();
        let Some(tracked) = outcome.tracked.filter(|tracked| tracked.inliers > 0 || is_new) else {
            return;
        };
        let logged = LoggedFrame {
            depth_m: outcome.synchronized_depth_m.clone().unwrap_or_else(|| frame.depth_m.clone()),
            color: frame.color.clone(),
            moving: outcome.moving.clone(),
        };
        let beside = tracked.keyframe_from_camera;
        let truth = tracked.world_from_camera.compose(&beside.inverse());
        let truth = *self.keyframes.entry(tracked.keyframe).or_insert(truth);
        let share = match self.closure {
            Some(closure) if self.frames <= closure => self.frames as f64 / closure as f64,
            _ => 0.0,
        };
        if self.closure == Some(self.frames) {
            let truth = self.keyframes.iter().map(|(&id, &pose)| (id, pose)).collect();
            self.dense.correct(truth);
        }
        let anchored = AnchoredFrame {
            frame: logged,
            keyframe: tracked.keyframe,
            keyframe_from_camera: beside,
        };
        let start = Instant::now();
        self.dense.integrate(anchored, drift(share).compose(&truth));
        self.wait_s.push(start.elapsed().as_secs_f64());
        self.track_s.push(outcome.seconds.track);
    }

    fn skipped(&mut self, error: &FrameError) {
        println!("frame skipped: {error}");
    }
}

/// The times of the frames of the second half, by what they are of.
struct Times {
    track_s: Vec<f64>,
    wait_s: Vec<f64>,
    dense: DenseReport,
    before: usize,
}

async fn measure(args: &Args, client: &Client, map: &str, closes: bool) -> anyhow::Result<Times> {
    let mut source = open_folder(&args.sequence, FolderOptions::default())?.source;
    let first = source.next_frame().context("no frames")??;
    let (width, height) = first.color.size();
    let camera = FrameCamera::new(*source.camera(), width, height).context("the camera")?;
    let source = open_folder(&args.sequence, FolderOptions::default())?.source;
    let half = source.len() / 2;
    let volume = VolumeOptions { voxel_m: args.voxel, truncation_m: 8.0 * args.voxel };
    let mapper = DenseMapper::new(&camera, volume, IntegrationOptions::default(), None)?;
    let threads = args.threads.saturating_sub(1).max(1);
    let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build()?;
    let period = if args.hz > 0.0 { 1.0 / args.hz } else { 0.0 };
    let thread = DenseThread::start(mapper, pool);
    let feed = Feed {
        dense: thread.feed(1),
        closure: closes.then_some(half),
        keyframes: BTreeMap::new(),
        frames: 0,
        period: Duration::from_secs_f64(period),
        next: None,
        track_s: Vec::new(),
        wait_s: Vec::new(),
        before: 0,
        half,
    };
    let timing = source.timing();
    let pipeline = Pipeline::new(camera, PipelineOptions { timing, ..PipelineOptions::default() });
    client.create_map(map, None).await?;
    let target =
        Target { client, map_id: map, client_id: "closure", lock_step: true, most_held: MOST_HELD };
    let (_, feed) = run(source, pipeline, target, args.threads > 1, feed, None).await?;
    let Feed { dense, track_s, wait_s, before, .. } = feed;
    drop(dense);
    let dense = thread.finish(&mut |_, _| {})?;
    if dense.skipped > 0 || dense.rebuilt != usize::from(closes) {
        bail!("{} frames skipped, built again {} times", dense.skipped, dense.rebuilt);
    }
    Ok(Times { track_s, wait_s, dense, before })
}

#[tokio::main]
async fn main() -> anyhow::Result<()> {
    let args = Args::parse();
    let listener = tokio::net::TcpListener::bind("127.0.0.1:0").await?;
    let server = Server::start(listener, ServerConfig::default()).await?;
    let client = Client::connect(&format!("http://{}", server.local_addr())).await?;
    println!("{:>24} {:>8} {:>8} {:>8} {:>8}", "milliseconds", "count", "p50", "p99", "max");
    for round in 0..args.rounds {
        for closes in [false, true] {
            let name = format!("{}-{round}", if closes { "closure" } else { "none" });
            let times = measure(&args, &client, &name, closes).await?;
            println!("{}", if closes { "closure of 0.3 m" } else { "no closure" });
            let DenseReport { integrate_s, follow_s, .. } = &times.dense;
            let both = integrate_s.iter().zip(follow_s).map(|(a, b)| a + b).collect::<Vec<_>>();
            print_row("track", &times.track_s[times.before..]);
            print_row("wait for a place", &times.wait_s[times.before..]);
            print_row("integrate", &integrate_s[times.before..]);
            print_row("follow", &follow_s[times.before..]);
            print_row("dense, together", &both[times.before..]);
        }
    }
    drop(client);
    server.shutdown().await;
    Ok(())
}

fn print_row(name: &str, seconds: &[f64]) {
    let [p50, p99, max] = milliseconds(&mut seconds.to_vec());
    println!("{name:>24} {:>8} {p50:>8.2} {p99:>8.2} {max:>8.2}", seconds.len());
}
