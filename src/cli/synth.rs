//! `covis synth`: writes synthetic data with ground truth.
//!
//! `rgbd` draws a sequence of [`crate::frontend::synthetic`] into a folder of the TUM layout, with
//! the ground truth of the camera and of moving objects beside it. That module draws; this one
//! shows progress.

use std::path::PathBuf;

use super::output::print;
use super::overwrite::Overwrite;
use super::progress::Progress;
use crate::frontend::synthetic::{SceneName, Sequence, SequenceOptions, write_sequence};

/// Arguments of `covis synth`.
#[derive(Debug, clap::Args)]
pub(super) struct Args {
    #[command(subcommand)]
    kind: Kind,
}

#[derive(Debug, clap::Subcommand)]
enum Kind {
    /// An RGB-D sequence of an indoor scene: color, depth, ground truth of the camera, masks of
    /// moving objects.
    Rgbd(Rgbd),
}

#[derive(Debug, clap::Args)]
struct Rgbd {
    /// The folder to write; it is created if it is missing.
    out: PathBuf,
    #[command(flatten)]
    overwrite: Overwrite,
    /// static, walking, sitting, pushed, exposure, loop, covered or rounds.
    #[arg(long, value_name = "NAME")]
    scene: SceneName,
    /// Seed; the same scene and seed give the same bytes.
    #[arg(long, value_name = "N", default_value_t = 0)]
    seed: u64,
    /// How many frames of 640 x 480 pixels, 30 a second.
    #[arg(long, value_name = "N", default_value_t = SequenceOptions::default().frames)]
    frames: usize,
    /// Exact depth and color, without a Kinect's noise and gaps.
    #[arg(long)]
    no_noise: bool,
}

/// Draws and writes.
pub(super) fn run(args: &Args) -> anyhow::Result<()> {
    let Kind::Rgbd(Rgbd { out, overwrite, scene, seed, frames, no_noise }) = &args.kind;
    overwrite.allow(out)?;
    let options =
        SequenceOptions { frames: *frames, seed: *seed, noise: !no_noise, ..Default::default() };
    let mut progress = Progress::new("frames", *frames as u64);
    write_sequence(&Sequence::new(*scene, &options), out, |_| progress.advance(1))?;
    progress.finish();
    print(format_args!("{}: {frames} frames of {scene}, seed {seed}", out.display()))
}
