//! The ground truth: a file of any format, or a recorded folder with the truth beside its images. A
//! capture's own poses are read in the same way.
//!
//! `covis eval truth` writes it as a file, for instance for evo. Only commands that compare with
//! the truth, or that the user asks to use it, read it; the frontend does not.

use std::path::{Path, PathBuf};

use anyhow::{bail, ensure};
use covis_solvers::io::pose_matrix;
use covis_solvers::io::trajectory::{Trajectory, TrajectoryFormat, read_times};

use super::super::formats::{self, of_trajectories, read_trajectory};
use super::super::output::show;
use super::super::overwrite::Overwrite;
use crate::frontend::input::capture::{given_poses, is_capture};
use crate::frontend::input::seven_scenes;
use crate::frontend::input::without_depth::{DataSet, WithoutDepth};

/// The truth in a folder of the TUM layout.
const TUM_TRUTH: &str = "groundtruth.txt";

/// Arguments of `covis eval truth`.
#[derive(Debug, clap::Args)]
pub(super) struct Args {
    /// A recorded folder with poses: groundtruth.txt (TUM), frame-*.pose.txt (7-Scenes), a folder of EuRoC
    /// or KITTI, or a capture.
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
    if !path.is_dir() && !is_capture(path) {
        let (trajectory, format) = read_trajectory(path, format)?;
        return Ok((trajectory, format.has_times()));
    }
    if let Some(truth) = of_folder(path)? {
        return Ok((truth, true));
    }
    if is_capture(path) {
        return Ok((of_capture(path)?, true));
    }
    if let Some(found) = WithoutDepth::of(path) {
        return of_data_set(path, &found);
    }
    bail!("{}: neither {TUM_TRUTH} nor frame-000000.pose.txt is in this folder", path.display())
}

/// The poses that a capture gives.
fn of_capture(path: &Path) -> anyhow::Result<Trajectory> {
    let given = given_poses(path)?;
    ensure!(!given.is_empty(), "{}: no frame of this capture has a pose", path.display());
    Ok(formats::joined(given.iter().map(|pose| (pose.timestamp_s, pose.world_from_camera))))
}

/// The trajectory of a data set, and whether it has times.
fn of_data_set(path: &Path, found: &WithoutDepth) -> anyhow::Result<(Trajectory, bool)> {
    let layout = found.layout;
    let Some(truth) = &found.truth else {
        bail!("{}: a folder of {layout} without its poses", path.display())
    };
    let format = match layout {
        DataSet::Euroc => TrajectoryFormat::Euroc,
        DataSet::Kitti => TrajectoryFormat::Kitti,
    };
    let (mut truth, format) = read_trajectory(truth, Some(format))?;
    let Some(times) = found.times.as_ref().filter(|_| !format.has_times()) else {
        return Ok((truth, format.has_times()));
    };
    let timestamps = read_times(times)?;
    ensure!(
        timestamps.len() == truth.len(),
        "{}: {} times, but there are {} poses",
        times.display(),
        timestamps.len(),
        truth.len()
    );
    truth.timestamps = timestamps;
    Ok((truth, true))
}

/// As [`read`], where times are needed.
pub(in crate::cli) fn read_timed(path: &Path) -> anyhow::Result<Trajectory> {
    if !path.is_dir() && !is_capture(path) {
        return formats::read_timed(path);
    }
    let (truth, has_times) = read(path, None)?;
    ensure!(has_times, "{}: its poses have no times", path.display());
    Ok(truth)
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
    if !folder.is_dir() {
        return Ok(None);
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
