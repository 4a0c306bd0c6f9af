//! `covis run`: the reference frontend on a recorded or a synthetic sequence.
//!
//! Opens the source, starts a server in this process or connects to one, and writes what the run
//! left, a mesh where one is asked for. Truth that lies beside a sequence is never opened. Tracking
//! and mapping are [`crate::frontend`]'s.
//!
//! | file | role |
//! |---|---|
//! | `source`, `masks` | where frames and given masks come from |
//! | `dense` | the surface beside tracking |
//! | `interrupt` | ctrl-C and SIGTERM |
//! | `report`, `page` | what a run leaves |
//! | `refined` | a capture's own file with the poses of the run |

pub(super) mod dense;
mod interrupt;
pub(super) mod masks;
mod page;
mod refined;
pub(super) mod report;
mod source;

use std::path::PathBuf;

use anyhow::{Context, bail};
use covis_solvers::io::trajectory::TrajectoryFormat;
use fs_err as fs;

use super::config::Config;
use super::connect::{Embedded, connect};
use super::formats::of_trajectories;
use super::html::ReportFlag;
use super::output::{ended_by, show};
use super::overwrite::Overwrite;
use super::progress::Progress;
use super::record::{FrameWriter, RunRecording};
use super::volume::Measures;
use crate::client::Client;
use crate::frontend::image::{Image, RgbdFrame};
use crate::frontend::input::{FrameError, FrameSource, SensorTiming};
use crate::frontend::local_map::MOST_KEYFRAMES;
use crate::frontend::mapping::run::{Companion, MOST_HELD, RunReport, Target, run as track};
use crate::frontend::pipeline::{Outcome, Pipeline, PipelineOptions};
use dense::{Dense, DenseOptions};
pub(super) use interrupt::Interrupt;
use masks::GivenMasks;
use page::FinalMap;
pub(super) use source::{Drawing, Peeked, Recorded, Source};

/// The frontend's name as a client.
const CLIENT: &str = "frontend";

/// Arguments of `covis run`.
#[derive(Debug, clap::Args)]
pub(super) struct Args {
    /// mcap:FILE or bag:FOLDER (recordings of ROS 2), tum:FOLDER (TUM RGB-D or 7-Scenes layout),
    /// capture:FOLDER (nerfstudio, Polycam or Record3D), or synthetic:SCENE. The path of a recording is
    /// enough.
    source: Source,
    /// The map to create on the server.
    #[arg(long, value_name = "NAME", default_value = "run")]
    map: String,
    /// Folder for trajectories and masks; it is created if it is missing.
    #[arg(long, value_name = "FOLDER", default_value = "covis-run")]
    out: PathBuf,
    #[command(flatten)]
    overwrite: Overwrite,
    /// Format of the trajectories.
    #[arg(long, value_name = "FORMAT", value_parser = of_trajectories(), default_value = "tum")]
    format: TrajectoryFormat,
    #[command(flatten)]
    recorded: Recorded,
    /// Topic of odometry in an MCAP file or a bag. The motion between keyframes goes to the server as a
    /// measurement, whose noise the server finds. Static transforms must join its frame with the camera's.
    #[arg(long, value_name = "TOPIC")]
    odometry: Option<String>,
    /// Time from the first row's exposure to the last row's [default: from camera.txt, else a
    /// Kinect's 26.1; of an MCAP file or a bag 0].
    #[arg(long, value_name = "MILLISECONDS")]
    readout_ms: Option<f64>,
    /// How much later than their timestamps depth images are taken [default: from camera.txt, else
    /// -15; of an MCAP file or a bag 0].
    #[arg(long, value_name = "MILLISECONDS", allow_negative_numbers = true)]
    depth_late_ms: Option<f64>,
    /// Do not detect moving objects.
    #[arg(long)]
    no_mask: bool,
    /// Masks of known moving objects, one PNG file per frame: above 127 where something moves,
    /// named by the frame's timestamp.
    #[arg(long, value_name = "FOLDER")]
    mask_dir: Option<PathBuf>,
    /// Write the masks of moving objects to OUT/masks.
    #[arg(long)]
    save_masks: bool,
    /// Build a dense map: write mesh.ply, mesh.glb and volume.covis to OUT.
    #[arg(long)]
    mesh: bool,
    #[command(flatten)]
    measures: Measures,
    /// Integrate every Nth frame.
    #[arg(long, value_name = "N", default_value_t = 1, requires = "mesh",
          value_parser = clap::value_parser!(u16).range(1..))]
    mesh_every: u16,
    /// Wait at each keyframe until the server has solved it: slower, but each run gives the same
    /// files, except for the times in its report. Without this flag tracking never waits for the
    /// server.
    #[arg(long)]
    lock_step: bool,
    /// Threads; a single one decodes and tracks frames in turn [default: all processors].
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u16).range(1..=64))]
    threads: Option<u16>,
    #[command(flatten)]
    drawing: Drawing,
    /// Record the map, images of keyframes and figures to plot as MCAP, for Foxglove and Rerun.
    #[arg(long = "mcap", value_name = "FILE")]
    recording: Option<PathBuf>,
    /// Where to write the report of the run, one HTML file without scripts [default: OUT/report.html; with
    /// --json none].
    #[arg(long, value_name = "FILE")]
    report: Option<PathBuf>,
    /// Print one JSON object instead of a table.
    #[arg(long)]
    json: bool,
}

impl Args {
    /// Where the page goes: to whoever reads text, unasked.
    fn report_flag(&self) -> ReportFlag {
        let path = self.report.clone();
        ReportFlag { path: path.or_else(|| (!self.json).then(|| self.out.join("report.html"))) }
    }
}

/// How a sequence is run, apart from where it comes from.
#[derive(Clone, Debug, Default)]
pub(super) struct RunOptions {
    /// Camera and depth scale as given.
    pub(super) recorded: Recorded,
    /// Readout and lateness of depth as given, seconds.
    pub(super) timing: (Option<f64>, Option<f64>),
    /// Whether what moves is left out.
    pub(super) removes_motion: bool,
    /// Masks that the user gives.
    pub(super) mask_dir: Option<PathBuf>,
    /// Where the masks go.
    pub(super) saved_masks: Option<PathBuf>,
    /// Whether and how a dense map is made.
    pub(super) dense: Option<DenseOptions>,
    /// Whether tracking waits at each keyframe until the server has solved it.
    pub(super) lock_step: bool,
    /// Threads; one decodes nothing ahead.
    pub(super) threads: usize,
    /// Where the recording goes.
    pub(super) recording: Option<PathBuf>,
    /// Keyframes of the local map, where not as many as usual.
    pub(super) most_keyframes: Option<usize>,
    /// What ends the sequence early.
    pub(super) interrupt: Interrupt,
}

/// Runs the frontend.
/// Fails for a source that cannot be opened, a server that cannot be reached, a folder that cannot
/// be written.
pub(super) fn run(args: &Args, config: &Config) -> anyhow::Result<()> {
    // Seen now rather than after the run.
    args.overwrite.allow(&args.out)?;
    args.recording.iter().try_for_each(|file| args.overwrite.allow(file))?;
    fs::create_dir_all(&args.out)?;
    let available = std::thread::available_parallelism().map_or(1, usize::from);
    let threads = args.threads.map_or(available, usize::from);
    let seconds = |ms: Option<f64>| ms.map(|ms| ms * 1e-3);
    let volume = args.measures.options()?;
    let every = usize::from(args.mesh_every);
    let mut options = RunOptions {
        dense: args.mesh.then_some(DenseOptions {
            volume,
            ceiling: args.measures.ceiling(&args.out),
            every,
        }),
        recorded: args.recorded.clone().with_odometry(args.odometry.clone()),
        timing: (seconds(args.readout_ms), seconds(args.depth_late_ms)),
        removes_motion: !args.no_mask,
        mask_dir: args.mask_dir.clone(),
        saved_masks: args.save_masks.then(|| args.out.join("masks")),
        lock_step: args.lock_step,
        threads,
        recording: args.recording.clone(),
        most_keyframes: None,
        interrupt: Interrupt::default(),
    };
    let source = args.source.clone().with(args.drawing);
    refined::check(&source, &args.out)?;
    let runtime = tokio::runtime::Builder::new_multi_thread()
        .worker_threads(threads)
        .enable_all()
        .build()
        .context("the async runtime")?;
    let ((report, mut dense), map) = runtime.block_on(async {
        options.interrupt = Interrupt::catch().context("signal handlers")?;
        if config.names_server {
            let client = connect(config).await?;
            return run_and_ask(args, &source, &options, &client).await;
        }
        let server = Embedded::start(config).await?;
        let report = run_and_ask(args, &source, &options, &server.client).await;
        server.stop().await;
        report
    })?;
    report::write(&report, &args.out, args.format)?;
    let mesh = dense.as_mut().map(|dense| dense::write(dense, &args.out)).transpose()?;
    let signal = options.interrupt.signal();
    let refined = refined::write(&source, &report.trajectory, &args.out)?;
    let dense = dense.as_ref().map(|dense| &dense.report).zip(mesh);
    let mut document = report::document(&report, dense, signal);
    document.refined = refined;
    let flag = args.report_flag();
    let title = format!("Run of {}", args.source);
    flag.write(|| page::page(&title, &document, &report, map.as_ref()))?;
    show(args.json, &document, || report::table(&document, &args.out))?;
    flag.tell(args.json)?;
    match report.failure {
        Some(failure) => Err(failure).context("the session with the server ended early"),
        None => signal.map_or(Ok(()), |signal| Err(ended_by(signal))),
    }
}

/// Runs the sequence, and asks the map for what only a page shows.
async fn run_and_ask(
    args: &Args,
    source: &Source,
    options: &RunOptions,
    client: &Client,
) -> anyhow::Result<((RunReport, Option<Dense>), Option<FinalMap>)> {
    let run = sequence(source, options, client, &args.map).await?;
    if args.report_flag().path.is_none() || run.0.failure.is_some() {
        return Ok((run, None));
    }
    // What was tracked is kept, whatever the server says now.
    let map = FinalMap::of(client, &args.map).await;
    let map = map.inspect_err(|error| tracing::warn!("the report lacks the map: {error:#}"));
    Ok((run, map.ok()))
}

/// Runs one sequence into a new map.
pub(super) async fn sequence(
    source: &Source,
    options: &RunOptions,
    client: &Client,
    map: &str,
) -> anyhow::Result<(RunReport, Option<Dense>)> {
    let source = source.open(&options.recorded, &options.interrupt)?;
    let usual = source.timing();
    let readout_s = options.timing.0.unwrap_or(usual.readout_s);
    let depth_late_s = options.timing.1.unwrap_or(usual.depth_late_s);
    let Some(timing) = SensorTiming::new(readout_s, depth_late_s) else {
        bail!("--readout-ms must be 0 to 100 and --depth-late-ms -100 to 100");
    };
    let frames = Peeked::new(source, options.interrupt.clone())?;
    let camera = frames.frame_camera()?;
    let dense = match &options.dense {
        Some(dense) => Some((dense::start(dense, &camera, options.threads)?, dense.every)),
        None => None,
    };
    let removes_motion = options.removes_motion;
    let most_keyframes = options.most_keyframes.unwrap_or(MOST_KEYFRAMES);
    let has_odometry = frames.has_odometry();
    let options_of_tracking =
        PipelineOptions { removes_motion, timing, most_keyframes, has_odometry };
    let pipeline = Pipeline::new(camera, options_of_tracking);
    client
        .create_map(map, None)
        .await
        .with_context(|| format!("map {map} (--map names another)"))?;
    let recording = match &options.recording {
        Some(path) => {
            Some(RunRecording::start(client, map, CLIENT, path, options.lock_step).await?)
        }
        None => None,
    };
    if let Some(folder) = &options.saved_masks {
        fs::create_dir_all(folder)?;
    }
    let companion = Watcher {
        frames: recording.as_ref().map(RunRecording::frames),
        progress: Progress::new("frames", frames.source.len() as u64),
        given: options.mask_dir.as_deref().map(GivenMasks::open).transpose()?,
        saved: options.saved_masks.clone(),
        failure: None,
    };
    let target = Target {
        client,
        map_id: map,
        client_id: CLIENT,
        lock_step: options.lock_step,
        most_held: MOST_HELD,
    };
    let feed = dense.as_ref().map(|(thread, every)| thread.feed(*every));
    let ahead = options.threads > 1;
    let (report, companion) =
        track(Box::new(frames), pipeline, target, ahead, companion, feed).await?;
    companion.progress.finish();
    let dense = dense.map(|(thread, _)| dense::finish(thread)).transpose();
    if let Some((recording, frames)) = recording.zip(companion.frames) {
        let mesh = dense.as_ref().ok().and_then(|dense| Some(&dense.as_ref()?.mesh));
        // What was tracked is kept, whatever becomes of the recording.
        if let Err(error) = recording.finish(frames, &report, mesh).await {
            tracing::error!("the recording ends early: {error:#}");
        }
    }
    if let Some(failure) = companion.failure {
        return Err(failure);
    }
    Ok((report, dense?))
}

/// Progress, frames of a recording, masks in and masks out.
struct Watcher {
    frames: Option<FrameWriter>,
    progress: Progress,
    given: Option<GivenMasks>,
    saved: Option<PathBuf>,
    /// The first thing that could not be read or written.
    failure: Option<anyhow::Error>,
}

impl Companion for Watcher {
    fn mask(&mut self, timestamp_s: f64) -> Option<Image<u8>> {
        match self.given.as_ref()?.of(timestamp_s) {
            Ok(mask) => mask,
            Err(error) => {
                self.failure.get_or_insert(error);
                None
            }
        }
    }

    fn tracked(&mut self, frame: &RgbdFrame, outcome: &Outcome) {
        self.progress.advance(1);
        if let Some(frames) = &mut self.frames {
            frames.tracked(frame, outcome);
        }
        if outcome.tracked.is_none() {
            tracing::warn!("{:.6} s: tracking is lost", frame.timestamp_s);
        }
        if let Some(saved) = &self.saved
            && let Err(error) = masks::save(saved, frame, outcome.moving.as_ref())
        {
            self.failure.get_or_insert(error);
        }
    }

    fn skipped(&mut self, error: &FrameError) {
        self.progress.advance(1);
        tracing::warn!("frame skipped: {error}");
    }
}
