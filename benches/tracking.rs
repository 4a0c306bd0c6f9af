//! What mapping costs tracking: frame times of the reference frontend beside a server with a large map.
//!
//! `cargo bench --bench tracking -- SEQUENCE [--landmarks N] [--hz F] [--rounds N]`
//!
//! A real server in this process holds a map to which another client has sent many landmarks. The
//! frontend tracks a recorded sequence into it, to and fro, at a camera's rate, and a third client
//! closes a loop every few seconds. A frame's time is all that the tracking thread does for it;
//! "mapping" is the part of it that hands over keyframes and takes corrections, which in lock-step is
//! waiting for the server. Frames are decoded before the clock starts. Server, mapping and the rest of
//! the machine run beside it: repeat, and compare modes within one call.

#![allow(clippy::print_stdout, reason = "a bench shows what it measured")]

mod timing;

use std::path::PathBuf;
use std::sync::Arc;
use std::time::{Duration, Instant};

use anyhow::{Context, bail};
use clap::Parser;
use covis::client::{Client, SessionOptions};
use covis::frontend::camera::FrameCamera;
use covis::frontend::image::{Image, RgbdFrame};
use covis::frontend::input::{FolderOptions, FrameError, FrameSource, SensorTiming, open_folder};
use covis::frontend::mapping::messages;
use covis::frontend::mapping::run::{Companion, MOST_HELD, RunReport, Target, run};
use covis::frontend::pipeline::{Outcome, Pipeline, PipelineOptions};
use covis::service::{Server, ServerConfig};
use covis::wire::v1;
use covis_solvers::geometry::{LieGroup, PinholeRadialTangential, Se3};
use nalgebra::{Vector2, Vector3};
use tokio::sync::mpsc::{UnboundedReceiver, UnboundedSender, unbounded_channel};

use crate::timing::milliseconds;

/// Frame times beside a large map.
#[derive(Clone, Parser)]
struct Args {
    /// A folder in the layout of TUM RGB-D.
    sequence: PathBuf,
    /// Frames of it that are used, to and fro.
    #[arg(long, default_value_t = 180)]
    frames: usize,
    /// How often the way there and back is gone.
    #[arg(long, default_value_t = 2)]
    turns: usize,
    /// Landmarks that the map has before.
    #[arg(long, value_delimiter = ',', default_value = "0,30000,100000")]
    landmarks: Vec<usize>,
    /// Frames a second; 0 is as fast as they are tracked.
    #[arg(long, default_value_t = 30.0)]
    hz: f64,
    /// Frames between two loop closures; 0 is none.
    #[arg(long, default_value_t = 150)]
    closure_every: usize,
    /// Leave lock-step out.
    #[arg(long)]
    beside_only: bool,
    /// Runs in each mode, in turns.
    #[arg(long, default_value_t = 1)]
    rounds: usize,
    /// Given by cargo.
    #[arg(long, hide = true)]
    bench: bool,
}

/// Landmarks of a keyframe of the other client.
const LANDMARKS: usize = 500;
/// Of these so many are seen by its next keyframe, too.
const SHARED: usize = 60;

/// Decoded frames, there and back.
struct ToAndFro {
    frames: Arc<Vec<RgbdFrame>>,
    camera: PinholeRadialTangential,
    timing: SensorTiming,
    period_s: f64,
    next: usize,
    len: usize,
}

impl FrameSource for ToAndFro {
    fn camera(&self) -> &PinholeRadialTangential {
        &self.camera
    }

    fn timing(&self) -> SensorTiming {
        self.timing
    }

    fn len(&self) -> usize {
        self.len
    }

    fn next_frame(&mut self) -> Option<Result<RgbdFrame, FrameError>> {
        if self.next == self.len {
            return None;
        }
        let last = self.frames.len() - 1;
        let index = self.next % (2 * last);
        let mut frame = self.frames[index.min(2 * last - index)].clone();
        frame.timestamp_s = 1.0 + self.next as f64 * self.period_s;
        self.next += 1;
        Some(Ok(frame))
    }
}

/// Paces the frames as a camera does and asks for closures.
struct Paced {
    period: Duration,
    next: Option<Instant>,
    closure_every: usize,
    frames: usize,
    first: Option<(usize, Se3)>,
    closures: UnboundedSender<(usize, Se3)>,
}

impl Companion for Paced {
    fn mask(&mut self, _timestamp_s: f64) -> Option<Image<u8>> {
        let now = Instant::now();
        let next = self.next.map_or(now, |next| next.max(now));
        std::thread::sleep(next - now);
        self.next = Some(next + self.period);
        None
    }

    fn tracked(&mut self, _frame: &RgbdFrame, outcome: &Outcome) {
        self.frames += 1;
        let Some(tracked) = &outcome.tracked else { return };
        let world_from_keyframe =
            tracked.world_from_camera.compose(&tracked.keyframe_from_camera.inverse());
        let here = (tracked.keyframe, world_from_keyframe);
        let first = *self.first.get_or_insert(here);
        let is_due = self.closure_every > 0 && self.frames.is_multiple_of(self.closure_every);
        if is_due && here.0 > first.0 + 1 {
            let measured = first.1.inverse().compose(&here.1);
            // The receiver is gone when it failed, which is told there.
            let _gone = self.closures.send((here.0, measured));
        }
    }

    fn skipped(&mut self, error: &FrameError) {
        println!("frame skipped: {error}");
    }
}

/// Sends closures between the first keyframe and another one.
async fn close_loops(
    client: Client,
    map: String,
    mut closures: UnboundedReceiver<(usize, Se3)>,
) -> anyhow::Result<()> {
    let mut session = client.ingest(&map, "finder", SessionOptions::default()).await?;
    let keyframe =
        |id: usize| Some(v1::KeyframeRef { client_id: "frontend".to_owned(), id: id as i64 });
    let mut id = 0;
    while let Some((to, measured)) = closures.recv().await {
        let mut upper_triangle = vec![0.0; 21];
        for diagonal in [0, 6, 11, 15, 18, 20] {
            upper_triangle[diagonal] = 1e4;
        }
        let closure = v1::RelativePoseConstraint {
            id,
            keyframe_i: keyframe(0),
            keyframe_j: keyframe(to),
            keyframe_i_from_keyframe_j: Some(messages::rigid(&measured)),
            information: Some(v1::InformationMatrix6 { upper_triangle }),
            kind: v1::ConstraintKind::LoopClosure.into(),
            ..Default::default()
        };
        session.send(closure).await?;
        id += 1;
    }
    session.finish().await?;
    Ok(())
}

/// Sends keyframes in a row with so many landmarks together, each sharing some with the next.
async fn fill(client: &Client, map: &str, landmarks: usize) -> anyhow::Result<()> {
    let options = SessionOptions { omit_solve_summary: true, ..SessionOptions::default() };
    let mut session = client.ingest(map, "past", options).await?;
    let lens = PinholeRadialTangential::undistorted(500.0, 500.0, 319.5, 239.5);
    session.send(messages::camera(0, &lens.into(), (640, 480))).await?;
    let mut sent = 0_usize;
    for id in 0..landmarks.div_ceil(LANDMARKS) {
        // Far from the frontend, and so far apart that places are not confused.
        let pose = Se3::new(
            covis_solvers::geometry::So3::identity(),
            Vector3::new(100.0 + 0.2 * id as f64, 0.0, 0.0),
        );
        let point = |landmark: usize| {
            let (row, column) = (landmark / 25 % 20, landmark % 25);
            let step = 0.08 * column as f64 + 0.2 * (landmark / LANDMARKS) as f64;
            Vector3::new(99.0 + step, 0.08 * row as f64 - 0.8, 2.0 + 0.01 * (landmark % 7) as f64)
        };
        let new = sent..(sent + LANDMARKS).min(landmarks);
        let seen = sent.saturating_sub(SHARED)..new.end;
        let observations = seen.filter_map(|landmark| {
            let point = pose.inverse_transform(&point(landmark));
            let pixel = Vector2::new(319.5, 239.5) + 500.0 * point.xy() / point.z;
            let is_in = (0.0..640.0).contains(&pixel.x) && (0.0..480.0).contains(&pixel.y);
            is_in.then(|| v1::Observation {
                landmark: Some(messages::landmark_ref(landmark as i64)),
                pixel: Some(messages::vector2(&pixel)),
                depth_m: Some(point.z),
                sigma_depth_m: Some(0.01),
                ..Default::default()
            })
        });
        let keyframe = v1::Keyframe {
            id: id as i64,
            capture_time: Some(messages::timestamp(1.0 + id as f64)),
            sensor: Some(v1::keyframe::Sensor::CameraId(0)),
            world_from_camera: Some(messages::rigid(&pose)),
            observations: observations.collect(),
            landmarks: new
                .clone()
                .map(|landmark| v1::Landmark {
                    id: landmark as i64,
                    point_in_world: Some(messages::vector3(&point(landmark))),
                    ..Default::default()
                })
                .collect(),
            ..Default::default()
        };
        session.send(keyframe).await?;
        sent = new.end;
    }
    let report = session.finish().await?;
    if let Some(item) = report.rejections.first() {
        bail!("the server refused {item:?}");
    }
    Ok(())
}

/// One run on a map that has so many landmarks.
async fn measure(
    args: &Args,
    (client, frames): (&Client, &ToAndFro),
    (map, landmarks, lock_step): (&str, usize, bool),
) -> anyhow::Result<RunReport> {
    client.create_map(map, None).await?;
    fill(client, map, landmarks).await?;
    let source = ToAndFro {
        frames: Arc::clone(&frames.frames),
        camera: frames.camera,
        timing: frames.timing,
        ..*frames
    };
    let (width, height) = frames.frames[0].color.size();
    let camera = FrameCamera::new(frames.camera, width, height).context("the camera")?;
    let options = PipelineOptions { timing: frames.timing, ..PipelineOptions::default() };
    let pipeline = Pipeline::new(camera, options);
    let (closures, asked) = unbounded_channel();
    let finder = tokio::spawn(close_loops(client.clone(), map.to_owned(), asked));
    let period = if args.hz > 0.0 { 1.0 / args.hz } else { 0.0 };
    let companion = Paced {
        period: Duration::from_secs_f64(period),
        next: None,
        closure_every: args.closure_every,
        frames: 0,
        first: None,
        closures,
    };
    let target =
        Target { client, map_id: map, client_id: "frontend", lock_step, most_held: MOST_HELD };
    let (report, companion) =
        run(Box::new(source), pipeline, target, false, companion, None).await?;
    drop(companion);
    finder.await??;
    client.delete_map(map).await?;
    Ok(report)
}

#[tokio::main]
async fn main() -> anyhow::Result<()> {
    let args = Args::parse();
    let mut source = open_folder(&args.sequence, FolderOptions::default())?.source;
    let mut decoded = Vec::new();
    while decoded.len() < args.frames.max(2) {
        let Some(frame) = source.next_frame() else { break };
        decoded.push(frame?);
    }
    if decoded.len() < 2 {
        bail!("{} has fewer than two frames", args.sequence.display());
    }
    let frames = ToAndFro {
        len: 2 * (decoded.len() - 1) * args.turns.max(1),
        frames: Arc::new(decoded),
        camera: *source.camera(),
        timing: source.timing(),
        period_s: if args.hz > 0.0 { 1.0 / args.hz } else { 1.0 / 30.0 },
        next: 0,
    };
    let listener = tokio::net::TcpListener::bind("127.0.0.1:0").await?;
    let server = Server::start(listener, ServerConfig::default()).await?;
    let client = Client::connect(&format!("http://{}", server.local_addr())).await?;
    println!("{} frames at {} a second", frames.len, args.hz);
    println!("{:>32} {:>8} {:>8} {:>8} {:>8}", "milliseconds", "count", "p50", "p99", "max");
    for round in 0..args.rounds {
        for &landmarks in &args.landmarks {
            for lock_step in [true, false] {
                if lock_step && args.beside_only {
                    continue;
                }
                let mode = if lock_step { "lock-step" } else { "beside" };
                let name = format!("{mode}-{landmarks}-{round}");
                let report =
                    measure(&args, (&client, &frames), (&name, landmarks, lock_step)).await?;
                print(mode, landmarks, &report);
            }
        }
    }
    drop(client);
    server.shutdown().await;
    Ok(())
}

fn print(mode: &str, landmarks: usize, report: &RunReport) {
    println!(
        "{mode}, {landmarks} landmarks before and {} of {} keyframes: {} frames lost, {} late; {} \
         corrections, {} loops, {} switched off; {} keyframes waited at most, {} left out",
        report.landmarks,
        report.keyframes.len(),
        report.lost(),
        report.late(),
        report.corrections,
        report.loops.counting,
        report.loops.switched_off,
        report.most_held,
        report.left_out,
    );
    if let Some(failure) = &report.failure {
        println!("the session ended early: {failure}");
    }
    let durations = &report.durations;
    let track: Vec<f64> = durations.stages.iter().map(|stages| stages.track).collect();
    print_row("frame", &durations.frame);
    print_row("tracking alone", &track);
    print_row("mapping", &durations.map);
}

fn print_row(name: &str, seconds: &[f64]) {
    let [p50, p99, max] = milliseconds(&mut seconds.to_vec());
    println!("{name:>32} {:>8} {p50:>8.2} {p99:>8.2} {max:>8.2}", seconds.len());
}
