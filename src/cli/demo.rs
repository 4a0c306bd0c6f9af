//! `covis demo`: a room in which people walk, tracked with and without the mask of what moves.
//!
//! The reference frontend runs twice on one synthetic sequence, through a server in this process,
//! as `covis run` does. The truth is known to this file alone; errors are those of
//! [`crate::evaluation`]. In lock-step, so that every run prints the same errors.

use std::path::{Path, PathBuf};

use anyhow::Context;
use covis_solvers::io::trajectory::Trajectory;
use fs_err as fs;

use super::config::Config;
use super::connect::Embedded;
use super::output::print;
use super::run::{RunOptions, Source, report, sequence};
use crate::evaluation::{ape, rpe_over};
use crate::frontend::mapping::run::RunReport;
use crate::frontend::synthetic::{SceneName, Sequence, SequenceOptions};
use crate::wire::v1;

/// What is seen.
const SCENE: SceneName = SceneName::Walking;
/// The two maps.
const MAPS: [&str; 2] = ["with-mask", "without-mask"];
/// How far apart timestamps may be that belong together, in seconds.
const MAX_TIME_DIFFERENCE_S: f64 = 0.01;
/// Over what time drift is counted, in seconds.
const DRIFT_S: f64 = 1.0;

/// Arguments of `covis demo`.
#[derive(Debug, clap::Args)]
pub(super) struct Args {
    /// Folder for the map and the trajectories; made when it does not exist.
    #[arg(long, value_name = "FOLDER", default_value = "covis-demo")]
    out: PathBuf,
    /// Frames of 640 x 480 pixels, 30 a second.
    #[arg(long, value_name = "N", default_value_t = 90, value_parser = clap::value_parser!(u16).range(5..=2000))]
    frames: u16,
    /// Seed of the scene and of all noise.
    #[arg(long, value_name = "N", default_value_t = 2)]
    seed: u64,
}

/// Runs the sequence twice and compares both with the truth.
/// Fails for a folder that cannot be written, a server that does not start, a trajectory without
/// errors to tell.
pub(super) fn run(args: Args, config: &Config) -> anyhow::Result<()> {
    // Seen now rather than after the runs.
    fs::create_dir_all(&args.out)?;
    let runtime = tokio::runtime::Runtime::new().context("the async runtime")?;
    runtime.block_on(session(&args, config))
}

async fn session(args: &Args, config: &Config) -> anyhow::Result<()> {
    let frames = usize::from(args.frames);
    print(format_args!(
        "People walk through a room, and an RGB-D camera is held into it by hand. covis tracks it\n\
         twice, through a server of its own: without what moves, then as if nothing did.\n\n\
         Scene    {SCENE}, seed {}: {frames} frames of 640 x 480",
        args.seed
    ))?;
    let server = Embedded::start(config).await?;
    let source = Source::Synthetic(SCENE, args.seed, Some(frames));
    let threads = std::thread::available_parallelism().map_or(1, usize::from);
    let mut estimates = Vec::new();
    for (map, removes_motion) in MAPS.into_iter().zip([true, false]) {
        let options =
            RunOptions { removes_motion, lock_step: true, threads, ..RunOptions::default() };
        let (run, _) = sequence(&source, &options, &server.client, map).await?;
        print(summary(map, &run))?;
        estimates.push(report::trajectory(&run));
    }

    let truth = truth(frames, args.seed);
    print(errors(&truth, &estimates)?)?;
    truth.write(&args.out.join("truth.tum"))?;
    for (name, estimate) in ["with_mask.tum", "without_mask.tum"].into_iter().zip(&estimates) {
        estimate.write(&args.out.join(name))?;
    }
    let export = server.client.export_map(MAPS[0], v1::MapFormat::Ply).await?;
    super::map::write(export, &args.out.join("map.ply")).await?;
    print(ending(&args.out))?;
    server.stop().await;
    Ok(())
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

/// Where the camera was.
fn truth(frames: usize, seed: u64) -> Trajectory {
    let options = SequenceOptions { frames, seed, ..SequenceOptions::default() };
    let sequence = Sequence::new(SCENE, &options);
    let mut truth = Trajectory::default();
    for index in 0..frames {
        truth.push(sequence.timestamp_s(index), sequence.world_from_camera(index));
    }
    truth
}

/// The errors of both, side by side. A sequence that is too short has no drift over a second.
fn errors(truth: &Trajectory, estimates: &[Trajectory]) -> anyhow::Result<String> {
    let mut rows = [
        "  position (APE), rmse        ".to_owned(),
        "  drift a second (RPE), rmse  ".to_owned(),
        "  rotation a second, rmse     ".to_owned(),
    ];
    for estimate in estimates {
        let absolute = ape(truth, estimate, MAX_TIME_DIFFERENCE_S)?.translation_m.rmse;
        let drift = rpe_over(truth, estimate, DRIFT_S).ok();
        let of = |value: Option<f64>, digits: usize, unit: &str| match value {
            Some(value) => format!("{value:>10.digits$} {unit:<4}"),
            None => format!("{:>10} {unit:<4}", "-"),
        };
        rows[0].push_str(&of(Some(absolute * 1e3), 1, "mm"));
        rows[1].push_str(&of(drift.as_ref().map(|e| e.translation_m.rmse * 1e3), 1, "mm"));
        rows[2].push_str(&of(drift.as_ref().map(|e| e.angle_deg.rmse), 3, "deg"));
    }
    let rows: Vec<&str> = rows.iter().map(|row| row.trim_end()).collect();
    Ok(format!("\nTrajectory error{:>25}{:>15}\n{}", "with mask", "without mask", rows.join("\n")))
}

fn ending(out: &Path) -> String {
    let folder = out.display();
    format!(
        "\nWritten to {folder}/\n\
         \x20 map.ply            landmarks and trajectory, for MeshLab, CloudCompare or Open3D\n\
         \x20 truth.tum          where the camera was\n\
         \x20 with_mask.tum      where covis says it was, without what moves\n\
         \x20 without_mask.tum   the same as if nothing moved\n\n\
         Next: compare them yourself\n\
         \x20 cargo run --release -- eval ape {folder}/truth.tum {folder}/with_mask.tum\n\
         or track a sequence of your own, in the layout of the TUM RGB-D benchmark\n\
         \x20 cargo run --release -- run tum:FOLDER"
    )
}
