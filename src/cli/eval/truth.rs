//! The ground truth: a file of any format, or a recorded folder with the truth beside its images.
//!
//! `covis eval truth` writes it as a file, for instance for evo. Only commands that compare with
//! the truth, or that the user asks to use it, read it; the frontend does not.

use std::path::{Path, PathBuf};

use anyhow::{bail, ensure};
use covis_solvers::io::pose_matrix;
use covis_solvers::io::trajectory::{Trajectory, TrajectoryFormat};

use super::super::formats::{self, of_trajectories, read_trajectory};
use super::super::output::show;
use super::super::overwrite::Overwrite;
use crate::frontend::input::seven_scenes;

/// The truth in a folder of the TUM layout.
const TUM_TRUTH: &str = "groundtruth.txt";

/// Arguments of `covis eval truth`.
#[derive(Debug, clap::Args)]
pub(super) struct Args {
    /// A recorded folder with groundtruth.txt (TUM) or frame-*.pose.txt (7-Scenes).
    folder: PathBuf,
    /// The trajectory to write, camera in world.
    out: PathBuf,
    /// Format of the trajectory.
    #[arg(long, value_name = "FORMAT", value_parser = of_trajectories(), default_value = "tum")]
    format: TrajectoryFormat,
    #[command(flatten)]
    overwrite: Overwrite,
    /// Print one JSON object instead of a sentence.
    #[arg(long)]
    json: bool,
}

pub(super) fn run(args: &Args) -> anyhow::Result<()> {
    args.overwrite.allow(&args.out)?;
    let truth = read_timed(&args.folder)?;
    truth.write_as(&args.out, args.format)?;
    let document = serde_json::json!({ "poses": truth.len() });
    show(args.json, &document, || format!("{} poses in {}", truth.len(), args.out.display()))
}

/// The trajectory of a file, or a folder's truth, and whether it has times.
/// Fails for what cannot be read, and for a folder without truth.
pub(super) fn read(
    path: &Path,
    format: Option<TrajectoryFormat>,
) -> anyhow::Result<(Trajectory, bool)> {
    if let Some(trajectory) = formats::read_recorded(path)? {
        return Ok((trajectory, true));
    }
    if !path.is_dir() {
        let (trajectory, format) = read_trajectory(path, format)?;
        return Ok((trajectory, format.has_times()));
    }
    let Some(truth) = of_folder(path)? else {
        bail!("{}: neither {TUM_TRUTH} nor frame-000000.pose.txt is in this folder", path.display())
    };
    Ok((truth, true))
}

/// As [`read`], where times are needed.
pub(in crate::cli) fn read_timed(path: &Path) -> anyhow::Result<Trajectory> {
    if path.is_dir() { read(path, None).map(|(truth, _)| truth) } else { formats::read_timed(path) }
}

/// The truth beside a folder's images, where there is one: `groundtruth.txt`, else the poses of
/// 7-Scenes at the times that their frames have. Frames whose pose is marked as unknown are left
/// out.
pub(in crate::cli) fn of_folder(folder: &Path) -> anyhow::Result<Option<Trajectory>> {
    let tum = folder.join(TUM_TRUTH);
    if tum.is_file() {
        let (truth, _) = read_trajectory(&tum, Some(TrajectoryFormat::Tum))?;
        return Ok(Some(truth));
    }
    let files = seven_scenes::files(folder, &[seven_scenes::POSE])?;
    if files.is_empty() {
        return Ok(None);
    }
    let mut truth = Trajectory::default();
    for file in files {
        if let Some(world_from_camera) = pose_matrix::read(&file.path)? {
            truth.push(file.timestamp_s, world_from_camera);
        }
    }
    ensure!(!truth.is_empty(), "{}: every pose is marked as unknown", folder.display());
    Ok(Some(truth))
}
