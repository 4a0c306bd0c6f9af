//! `covis record`: a map as an MCAP recording, which Foxglove and Rerun open: transforms, poses, landmarks,
//! cameras, closures, and figures to plot; `covis run --mcap` adds frames and images.
//!
//! | file | role |
//! |---|---|
//! | this | arguments, and when a recording ends |
//! | `recorder` | follows a map and writes what changes |
//! | `scene` | a map as messages |
//! | `of_run` | what a run adds: images, frames, solves |
//! | `surface` | the mesh of a run as a message |
//! | `sink` | the MCAP file; the only place that knows the crate |
//! | `schemas` | generated from `proto/foxglove` and `proto/covis/recording` |
//!
//! Times of a recording are capture times, never this machine's: the map of a robot of yesterday plays as the
//! robot drove, and a map that does not change gives the same bytes each time. Without the feature `mcap`
//! there is no sink, and nothing is recorded.

mod colors;
mod of_run;
mod recorder;
mod scene;
mod schemas;
#[cfg_attr(not(feature = "mcap"), path = "no_sink.rs")]
mod sink;
mod surface;

use std::path::PathBuf;
use std::time::Duration;

use anyhow::Context;

use super::choices::number;
use super::config::Config;
use super::connect::connect;
use super::output::print;
use super::overwrite::Overwrite;
use super::signals::Signals;
pub(super) use of_run::{FrameWriter, RunRecording};

/// Arguments of `covis record`.
#[derive(Debug, clap::Args)]
pub(super) struct Args {
    /// The map.
    map: String,
    /// The recording, usually with the extension .mcap; `-` is standard output.
    out: PathBuf,
    #[command(flatten)]
    overwrite: Overwrite,
    /// Keep recording changes until ctrl-c, SIGTERM or the end of the map.
    #[arg(long)]
    follow: bool,
    /// Keep recording changes for this long.
    #[arg(long = "for", value_name = "SECONDS", value_parser = seconds, conflicts_with = "follow")]
    for_s: Option<f64>,
    /// While the map changes, write landmarks, trajectories and closures at most this often.
    #[arg(long, value_name = "SECONDS", default_value = "1", value_parser = seconds)]
    every: f64,
}

fn seconds(text: &str) -> Result<f64, String> {
    /// A month.
    const MOST: f64 = 2.7e6;
    let must = format!("must be a number of seconds from 0 to {MOST}");
    number(text, &must, |seconds| (0.0..=MOST).contains(seconds))
}

/// Records a map.
/// Fails for a server that is not there, a map that it does not have, and a file that cannot be written.
pub(super) fn run(args: &Args, config: &Config) -> anyhow::Result<()> {
    args.overwrite.allow(&args.out)?;
    sink::available()
        .with_context(|| format!("{} cannot be recorded to {}", args.map, args.out.display()))?;
    let runtime = tokio::runtime::Runtime::new().context("the async runtime")?;
    runtime.block_on(async {
        let mut signals = Signals::new().context("signals")?;
        let client = connect(config).await?;
        let every = Duration::from_secs_f64(args.every);
        let mut recorder = recorder::Recorder::open(&client, &args.map, every, None).await?;
        let sink = sink::Sink::create(&args.out)?;
        let follows = args.follow || args.for_s.is_some();
        // A signal ends a recording as its time does: what was recorded is a complete file.
        let end = async {
            let pause = Duration::from_secs_f64(args.for_s.unwrap_or_default());
            tokio::select! {
                () = tokio::time::sleep(pause), if args.for_s.is_some() => {}
                _ = signals.next() => {}
            }
        };
        let written = recorder.record(&sink, follows, end).await?;
        if args.out.as_os_str() == "-" {
            return Ok(());
        }
        print(format_args!("{written} messages in {}", args.out.display()))
    })
}
