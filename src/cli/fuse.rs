//! `covis fuse`: reconstructs a surface from recorded frames at given poses. No tracking, no
//! server.
//!
//! Opens the source, takes each frame's pose from the trajectory, and writes the mesh and the
//! volume. [`crate::frontend::dense`] does the fusion.

use std::collections::BTreeMap;
use std::path::PathBuf;
use std::time::Instant;

use anyhow::{Context, bail};
use fs_err as fs;
use serde::Serialize;

use super::eval::truth;
use super::output::show;
use super::overwrite::Overwrite;
use super::progress::Progress;
use super::run::report::Quantiles;
use super::run::{Drawing, Interrupt, Peeked, Recorded, Source};
use super::volume::{Measures, MeshFigures, Paging, write_surface};
use crate::frontend::dense::integrate::{DenseFrame, IntegrationOptions, Integrator};
use crate::frontend::dense::paged::PagedVolume;
use crate::frontend::dense::pages::PageError;
use crate::frontend::dense::pose_track::PoseTrack;
use crate::frontend::dense::surface::{SurfaceCache, extract};
use crate::frontend::input::FrameSource;

/// A frame has the pose of this time, seconds, or none.
const POSE_REACH_S: f64 = 0.02;

/// Arguments of `covis fuse`.
#[derive(Debug, clap::Args)]
pub(super) struct Args {
    /// mcap:FILE or bag:FOLDER (recordings of ROS 2), tum:FOLDER (TUM RGB-D or 7-Scenes layout),
    /// capture:FOLDER (nerfstudio, Polycam or Record3D), or synthetic:SCENE. The path of a recording is
    /// enough.
    source: Source,
    /// Poses of the camera: a TUM or EuRoC trajectory, or a recorded folder or a capture with poses beside
    /// its images. Poses are interpolated; frames without a pose within 0.02 s are skipped.
    #[arg(long, value_name = "TRAJECTORY|FOLDER")]
    poses: PathBuf,
    /// Folder for mesh.ply and volume.covis; it is created if it is missing.
    #[arg(long, value_name = "FOLDER")]
    out: PathBuf,
    #[command(flatten)]
    overwrite: Overwrite,
    #[command(flatten)]
    measures: Measures,
    /// Update the surface after each frame, at most this many changed blocks, oldest first; the
    /// rest waits for later frames [default: compute the surface at the end].
    #[arg(long, value_name = "BLOCKS", value_parser = clap::value_parser!(u32).range(1..))]
    remesh: Option<u32>,
    /// Maximum depth that is used, meters.
    #[arg(long, value_name = "METERS", default_value_t = IntegrationOptions::default().max_depth_m)]
    max_depth: f32,
    #[command(flatten)]
    recorded: Recorded,
    /// Threads [default: all processors].
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u16).range(1..=64))]
    threads: Option<u16>,
    #[command(flatten)]
    drawing: Drawing,
    /// Print one JSON object instead of a table.
    #[arg(long)]
    json: bool,
}

/// The object of `--json`.
#[derive(Debug, Serialize)]
struct Document {
    frames: usize,
    skipped: usize,
    stages: BTreeMap<&'static str, Quantiles>,
    #[serde(skip_serializing_if = "Option::is_none")]
    remesh: Option<Remesh>,
    mesh: MeshFigures,
    #[serde(skip_serializing_if = "Option::is_none")]
    paging: Option<Paging>,
}

/// How well the surface followed while frames came.
#[derive(Clone, Copy, Debug, Default, Serialize)]
struct Remesh {
    /// Pieces that were made anew, each time counted.
    pieces: usize,
    /// Frames after which some were left for later.
    frames_behind: usize,
    /// Frames that the surface of a block had to wait at most.
    most_behind: u64,
}

/// A surface that follows the volume frame by frame.
struct Follower {
    cache: SurfaceCache,
    /// Pieces that are made anew after a frame, at most.
    most: usize,
    figures: Remesh,
    seconds: Vec<f64>,
}

impl Follower {
    fn new(most: u32) -> Self {
        let cache = SurfaceCache::default();
        Self { cache, most: most as usize, figures: Remesh::default(), seconds: Vec::new() }
    }

    fn follow(&mut self, volume: &mut PagedVolume) -> Result<(), PageError> {
        let start = Instant::now();
        self.figures.pieces += self.cache.update(volume, self.most)?;
        self.seconds.push(start.elapsed().as_secs_f64());
        let lag = self.cache.lag();
        self.figures.frames_behind += usize::from(lag > 0);
        self.figures.most_behind = self.figures.most_behind.max(lag);
        Ok(())
    }
}

/// Fuses a source.
/// Fails for a source or trajectory that cannot be read, options out of range, a folder that cannot
/// be written.
pub(super) fn run(args: &Args) -> anyhow::Result<()> {
    let threads = args.threads.map_or(0, usize::from);
    let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().context("threads")?;
    // All of it on the pool: a frame that is handed to it would wait for a thread to wake up.
    pool.install(|| fuse(args))
}

fn fuse(args: &Args) -> anyhow::Result<()> {
    let options = args.measures.options()?;
    if !(args.max_depth > 0.0 && args.max_depth <= 100.0) {
        bail!("--max-depth must be more than 0 and at most 100 m, not {}", args.max_depth);
    }
    // Seen now rather than after the work.
    args.overwrite.allow(&args.out)?;
    fs::create_dir_all(&args.out)?;
    let poses = PoseTrack::new(&truth::read_timed(&args.poses)?);
    let source = args.source.clone().with(args.drawing);
    let interrupt = Interrupt::default();
    let source = source.open(&args.recorded, &interrupt)?;
    let mut frames = Peeked::new(source, interrupt)?;
    let camera = frames.frame_camera()?;
    let integration =
        IntegrationOptions { max_depth_m: args.max_depth, ..IntegrationOptions::default() };
    let mut integrator = Integrator::new(&camera, integration);
    let mut volume = match args.measures.ceiling(&args.out) {
        Some(ceiling) => ceiling.volume(options, 1).context("the page file")?,
        None => PagedVolume::new(options),
    };
    let mut progress = Progress::new("frames", frames.len() as u64);
    let (mut seconds, mut skipped) = (Vec::new(), 0);
    let mut follower = args.remesh.map(Follower::new);
    while let Some(frame) = frames.next_frame() {
        progress.advance(1);
        let frame = match frame {
            Ok(frame) => frame,
            Err(error) => {
                tracing::warn!("frame skipped: {error}");
                skipped += 1;
                continue;
            }
        };
        let Some(world_from_camera) = poses.at(frame.timestamp_s, POSE_REACH_S) else {
            skipped += 1;
            continue;
        };
        let dense = DenseFrame {
            depth_m: &frame.depth_m,
            color: &frame.color,
            moving: None,
            world_from_camera: &world_from_camera,
        };
        let start = Instant::now();
        volume
            .integrate(&mut integrator, &dense)
            .with_context(|| format!("the frame at {:.6} s", frame.timestamp_s))?;
        seconds.push(start.elapsed().as_secs_f64());
        if let Some(follower) = &mut follower {
            follower.follow(&mut volume)?;
        }
    }
    progress.finish();
    if seconds.is_empty() {
        bail!("{}: no frame has a pose within {POSE_REACH_S} s", args.poses.display());
    }
    let start = Instant::now();
    let mesh = extract(&mut volume)?;
    let extract_s = start.elapsed().as_secs_f64();
    let paging = Paging::of(&volume);
    let figures = write_surface(&mut volume, &mesh, &args.out)?;

    let frames = seconds.len();
    let mut stages = BTreeMap::from([
        ("integrate", Quantiles::of(seconds.into_iter())),
        ("extract", Quantiles::of(std::iter::once(extract_s))),
    ]);
    if let Some(Follower { seconds, .. }) = &follower {
        stages.insert("remesh", Quantiles::of(seconds.iter().copied()));
    }
    let document = Document {
        frames,
        skipped,
        stages,
        remesh: follower.map(|follower| follower.figures),
        mesh: figures,
        paging,
    };
    show(args.json, &document, || table(&document, args))
}

fn table(document: &Document, args: &Args) -> String {
    let Document { frames, skipped, stages, remesh, mesh, paging } = document;
    let mut text = format!("{frames} frames, {skipped} skipped\n");
    for (name, Quantiles { p50_ms, p99_ms }) in stages {
        text.push_str(&format!("\n{name:>9}  p50 {p50_ms:>6.1} ms  p99 {p99_ms:>6.1} ms"));
    }
    if let Some(Remesh { pieces, frames_behind, most_behind }) = remesh {
        text.push_str(&format!(
            "\n\n{pieces} blocks meshed again; {frames_behind} frames left some"
        ));
        text.push_str(&format!(" for later, for {most_behind} frames at most"));
    }
    let MeshFigures { vertices, triangles, .. } = mesh;
    let out = args.out.display();
    if let Some(Paging { paged_out, paged_in, frames_above, .. }) = paging {
        text.push_str(&format!("\n\n{paged_out} blocks to disk, {paged_in} back"));
        text.push_str(&format!(", {frames_above} frames needed more memory"));
    }
    text.push_str(&format!("\n\n{vertices} vertices, {triangles} triangles in {out}/mesh.ply"));
    text
}
