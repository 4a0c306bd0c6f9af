//! `covis demo`: a camera follows people around a room, twice; drift, the loops that the server finds,
//! and what the mask of what moves gains.
//!
//! The reference frontend runs twice on one synthetic sequence, through a server in this process,
//! as `covis run` does: with the mask and without. Its local map is small, so that it has forgotten a
//! place when it comes back to it; the server has not. The truth is known to this file alone; errors are
//! those of [`crate::evaluation`]. In lock-step, so that every run prints the same errors.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use anyhow::Context;
use covis_solvers::io::trajectory::Trajectory;
use fs_err as fs;

use super::config::Config;
use super::connect::Embedded;
use super::formats::joined;
use super::output::print;
use super::overwrite::Overwrite;
use super::run::masks::microseconds;
use super::run::{self, RunOptions, Source, report};
use super::signals::Signals;
use crate::client::Client;
use crate::evaluation::ape;
use crate::frontend::mapping::run::RunReport;
use crate::frontend::synthetic::{SceneName, Sequence, SequenceOptions};
use crate::wire::v1;

/// What is seen.
const SCENE: SceneName = SceneName::Rounds;
/// The two maps.
const MAPS: [&str; 2] = ["with-mask", "without-mask"];
/// Columns and rows of a frame.
const SIZE: (usize, usize) = (320, 240);
/// Keyframes of the local map.
const MOST_KEYFRAMES: usize = 20;
/// How far apart timestamps may be that belong together, in seconds.
const MAX_TIME_DIFFERENCE_S: f64 = 0.01;

/// Arguments of `covis demo`.
#[derive(Debug, clap::Args)]
pub(super) struct Args {
    /// Folder for the map and the trajectories; it is created if it is missing.
    #[arg(long, value_name = "FOLDER", default_value = "covis-demo")]
    out: PathBuf,
    #[command(flatten)]
    overwrite: Overwrite,
    /// Frames, 30 a second; a round takes 180.
    #[arg(long, value_name = "N", default_value_t = 360, value_parser = clap::value_parser!(u16).range(5..=2000))]
    frames: u16,
    /// Seed of the scene and of all noise.
    #[arg(long, value_name = "N", default_value_t = 2)]
    seed: u64,
    /// Keep the server and its page until ctrl-c.
    #[arg(long)]
    keep: bool,
}

/// Runs the sequence twice and compares both with the truth.
/// Fails for a folder that cannot be written, a server that does not start, a trajectory without
/// errors to tell.
pub(super) fn run(args: Args, config: &Config) -> anyhow::Result<()> {
    // Seen now rather than after the runs.
    args.overwrite.allow(&args.out)?;
    fs::create_dir_all(&args.out)?;
    let runtime = tokio::runtime::Runtime::new().context("the async runtime")?;
    runtime.block_on(session(&args, config))
}

async fn session(args: &Args, config: &Config) -> anyhow::Result<()> {
    let (width, height) = SIZE;
    let (frames, seed) = (usize::from(args.frames), args.seed);
    let options = SequenceOptions { width, height, frames, seed, noise: true };
    print(format_args!(
        "Two people walk around a room, twice, and an RGB-D camera follows them. covis tracks it\n\
         through its own server: first with the people masked, then without the mask. Tracking\n\
         remembers {MOST_KEYFRAMES} keyframes; the server recognizes the places of the\n\
         first round in the second.\n\n\
         Scene    {SCENE}, seed {seed}: {frames} frames of {width} x {height}"
    ))?;
    let (server, page) = Embedded::start_with_page(config).await?;
    print(format_args!("Watch    http://{page}/ in a browser while it runs"))?;
    let threads = std::thread::available_parallelism().map_or(1, usize::from);
    let sequence = Sequence::new(SCENE, &options);
    let mut runs = Vec::new();
    for (map, removes_motion) in MAPS.into_iter().zip([true, false]) {
        let source = Source::Synthetic(SCENE, options);
        let options = RunOptions {
            removes_motion,
            lock_step: true,
            threads,
            most_keyframes: Some(MOST_KEYFRAMES),
            ..RunOptions::default()
        };
        let (report, _) = run::sequence(&source, &options, &server.client, map).await?;
        print(summary(map, &report))?;
        let on_people = on_people(&server.client, map, &sequence).await?;
        runs.push(Run { report, on_people });
    }

    let truth = truth(&sequence);
    print(comparison(&truth, &runs)?)?;
    truth.write(&args.out.join("truth.tum"))?;
    let trajectories = [
        ("odometry.tum", odometry(&runs[0].report)),
        ("with_mask.tum", report::trajectory(&runs[0].report)),
        ("without_mask.tum", report::trajectory(&runs[1].report)),
    ];
    for (name, trajectory) in trajectories {
        trajectory.write(&args.out.join(name))?;
    }
    let export = server.client.export_map(MAPS[0], v1::MapFormat::Ply).await?;
    super::map::write(export, &args.out.join("map.ply"), args.overwrite).await?;
    print(ending(&args.out))?;
    if args.keep {
        print(format_args!("\nThe maps are at http://{page}/ until ctrl-c ends the server"))?;
        Signals::new()?.next().await;
    }
    server.stop().await;
    Ok(())
}

/// One of the two runs.
struct Run {
    report: RunReport,
    /// Share of the map's measurements that show people.
    on_people: f64,
}

/// What became of a run.
fn summary(map: &str, run: &RunReport) -> String {
    format!(
        "{:<12}  {} frames tracked, {} lost; {} keyframes, {} landmarks; {:.1} ms a frame",
        map,
        run.live.len(),
        run.lost(),
        run.keyframes.len(),
        run.landmarks,
        report::track(run).p50_ms
    )
}

/// The share of the measurements in a map that show what moves, by the truth.
async fn on_people(client: &Client, map: &str, sequence: &Sequence) -> anyhow::Result<f64> {
    let index_of: BTreeMap<i64, usize> = (0..sequence.len())
        .map(|index| (microseconds(sequence.timestamp_s(index)), index))
        .collect();
    let (mut all, mut on_people) = (0_usize, 0_usize);
    let paths = ["capture_time", "observations"].map(str::to_owned).to_vec();
    let fields = Some(prost_types::FieldMask { paths });
    for keyframe in client.keyframes(map, fields).await?.keyframes {
        let time = keyframe.capture_time.unwrap_or_default();
        let seconds = time.seconds as f64 + f64::from(time.nanos) * 1e-9;
        let Some(&index) = index_of.get(&microseconds(seconds)) else { continue };
        let moving = sequence.moving_mask(index);
        for pixel in keyframe.observations.iter().filter_map(|seen| seen.pixel) {
            let (u, v) = (pixel.x.round().max(0.0) as usize, pixel.y.round().max(0.0) as usize);
            all += 1;
            let (width, height) = moving.size();
            on_people += usize::from(u < width && v < height && moving.at(u, v) > 127);
        }
    }
    Ok(on_people as f64 / all.max(1) as f64)
}

/// Where the camera was.
fn truth(sequence: &Sequence) -> Trajectory {
    let pose = |index| (sequence.timestamp_s(index), sequence.world_from_camera(index));
    joined((0..sequence.len()).map(pose))
}

/// Where tracking alone says that the camera was: no loop moved it.
fn odometry(run: &RunReport) -> Trajectory {
    joined(run.live.iter().map(|frame| (frame.timestamp_s, frame.odom_from_camera)))
}

/// Both runs, side by side.
fn comparison(truth: &Trajectory, runs: &[Run]) -> anyhow::Result<String> {
    let rmse_mm = |estimate: &Trajectory| -> anyhow::Result<String> {
        let error = ape(truth, estimate, MAX_TIME_DIFFERENCE_S)?;
        Ok(format!("{:.1} mm", error.translation_m.rmse * 1e3))
    };
    let mut rows = [
        "Measurements in the map that show people ".to_owned(),
        "Position error (APE, rmse) of tracking   ".to_owned(),
        "  loops that the server found            ".to_owned(),
        "  error after them, on the server's map  ".to_owned(),
    ];
    for Run { report, on_people } in runs {
        let cells = [
            format!("{:.2} %", 100.0 * on_people),
            rmse_mm(&odometry(report))?,
            report.loops.counting.to_string(),
            rmse_mm(&report::trajectory(report))?,
        ];
        rows.iter_mut().zip(cells).for_each(|(row, cell)| row.push_str(&format!("{cell:>15}")));
    }
    Ok(format!("\n{:>56}{:>15}\n{}", "with mask", "without mask", rows.join("\n")))
}

fn ending(out: &Path) -> String {
    let folder = out.display();
    format!(
        "\nWritten to {folder}/\n\
         \x20 map.ply            landmarks and trajectory, for MeshLab, CloudCompare or Open3D\n\
         \x20 truth.tum          ground truth\n\
         \x20 odometry.tum       tracking alone, with the mask\n\
         \x20 with_mask.tum      estimate of covis with the mask\n\
         \x20 without_mask.tum   estimate of covis without the mask\n\n\
         Next: compare them yourself\n\
         \x20 cargo run --release -- eval ape {folder}/truth.tum {folder}/with_mask.tum\n\
         or track a sequence of your own, in the layout of the TUM RGB-D benchmark\n\
         \x20 cargo run --release -- run tum:FOLDER"
    )
}
