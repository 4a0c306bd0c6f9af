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
//! robot drove, and a map that does not change gives the same bytes each time. Built with the feature `mcap`.

#[cfg(not(feature = "mcap"))]
mod lacking;
#[cfg(feature = "mcap")]
mod of_run;
#[cfg(feature = "mcap")]
mod recorder;
#[cfg(feature = "mcap")]
mod scene;
#[cfg(feature = "mcap")]
mod schemas;
#[cfg(feature = "mcap")]
mod sink;
#[cfg(feature = "mcap")]
mod surface;

use std::path::PathBuf;

use super::config::Config;
#[cfg(not(feature = "mcap"))]
pub(super) use lacking::{FrameWriter, RunRecording};
#[cfg(feature = "mcap")]
pub(super) use of_run::{FrameWriter, RunRecording};

/// Arguments of `covis record`.
#[derive(Debug, clap::Args)]
pub(super) struct Args {
    /// The map.
    map: String,
    /// The recording, as a rule with the ending .mcap; `-` is standard output.
    out: PathBuf,
    /// Go on recording what changes, until ctrl-c, SIGTERM or the end of the map.
    #[arg(long)]
    follow: bool,
    /// Go on recording what changes for this long.
    #[arg(long = "for", value_name = "SECONDS", value_parser = seconds, conflicts_with = "follow")]
    for_s: Option<f64>,
    /// While the map changes, write landmarks, trajectories and closures this often at most.
    #[arg(long, value_name = "SECONDS", default_value = "1", value_parser = seconds)]
    every: f64,
}

fn seconds(text: &str) -> Result<f64, String> {
    /// A month.
    const MOST: f64 = 2.7e6;
    match text.parse::<f64>() {
        Ok(value) if (0.0..=MOST).contains(&value) => Ok(value),
        Ok(_) | Err(_) => Err(format!("must be a number of seconds from 0 to {MOST}")),
    }
}

/// Records a map.
/// Fails for a server that is not there, a map that it does not have, and a file that cannot be written.
#[cfg(feature = "mcap")]
pub(super) fn run(args: &Args, config: &Config) -> anyhow::Result<()> {
    use std::time::Duration;

    use anyhow::Context;

    use super::connect::connect;
    use super::output::print;
    use super::signals::Signals;

    let runtime = tokio::runtime::Runtime::new().context("the async runtime")?;
    runtime.block_on(async {
        let mut signals = Signals::new().context("signals")?;
        let client = connect(config).await?;
        let every = Duration::from_secs_f64(args.every);
        let mut recorder = recorder::Recorder::open(&client, &args.map, every).await?;
        let sink = sink::Sink::create(&args.out)?;
        let follows = args.follow || args.for_s.is_some();
        // A signal ends a recording as its time does: what was recorded is a complete file.
        let end = async {
            match args.for_s {
                Some(seconds) => {
                    let pause = tokio::time::sleep(Duration::from_secs_f64(seconds));
                    tokio::select! { () = pause => {}, _ = signals.next() => {} }
                }
                None => {
                    signals.next().await;
                }
            }
        };
        let written = recorder.record(&sink, follows, end).await?;
        if args.out.as_os_str() == "-" {
            return Ok(());
        }
        print(format_args!("{written} messages in {}", args.out.display()))
    })
}

/// Says that this program cannot record.
#[cfg(not(feature = "mcap"))]
pub(super) fn run(args: &Args, _config: &Config) -> anyhow::Result<()> {
    let Args { map, out, follow: _, for_s: _, every: _ } = args;
    anyhow::bail!("{map} cannot be recorded to {}: {LACKING}", out.display())
}

/// Why a program without the feature does not record, and what to do.
#[cfg(not(feature = "mcap"))]
pub(super) const LACKING: &str =
    "this covis was built without MCAP; build it with `cargo build --release --features mcap`";
