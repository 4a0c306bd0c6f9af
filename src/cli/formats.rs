//! Formats of files as arguments, and trajectories in any of them.
//!
//! The list is [`covis_solvers::io::format::FORMATS`]; nothing here knows what a file contains.

use std::path::{Path, PathBuf};

use anyhow::{anyhow, bail};
use clap::builder::TypedValueParser;
use covis_solvers::geometry::Se3;
use covis_solvers::io::IoError;
use covis_solvers::io::format::{Content, FORMATS, Format};
use covis_solvers::io::g2o::{ChangedLines, G2oChanges};
use covis_solvers::io::openmvg::OpenMvgLeftOut;
use covis_solvers::io::trajectory::{Trajectory, TrajectoryFormat};
use fs_err as fs;

use super::choices::choice_of;
use crate::frontend::input::recording::{self, is_bag};

/// Takes one of the formats that are read.
pub(super) fn readable() -> impl TypedValueParser<Value = Format> {
    let readable = FORMATS.iter().filter(|entry| entry.is_read);
    choice_of(readable.map(|entry| (entry.name, entry.format, entry.title)))
}

/// Takes one of the formats that are written.
pub(super) fn writable() -> impl TypedValueParser<Value = Format> {
    let writable = FORMATS.iter().filter(|entry| entry.is_written);
    choice_of(writable.map(|entry| (entry.name, entry.format, entry.title)))
}

/// Takes one of the formats of trajectories.
pub(super) fn of_trajectories() -> impl TypedValueParser<Value = TrajectoryFormat> {
    choice_of(FORMATS.iter().filter_map(|entry| {
        let Format::Trajectory(format) = entry.format else { return None };
        Some((entry.name, format, entry.title))
    }))
}

/// A recording of ROS 2 as an argument names it: PATH, or PATH:TOPIC.
fn named_recording(argument: &Path) -> Option<(PathBuf, Option<String>)> {
    let is_recording = |path: &Path| {
        let extension = path.extension().and_then(|extension| extension.to_str());
        // A bag of ROS 1 is refused by name where it is opened.
        matches!(extension, Some("mcap" | "db3" | "bag")) || path.is_dir() && is_bag(path)
    };
    if is_recording(argument) {
        return Some((argument.to_owned(), None));
    }
    let (path, topic) = argument.to_str()?.rsplit_once(':')?;
    is_recording(Path::new(path)).then(|| (path.into(), Some(topic.to_owned())))
}

/// The trajectory of a topic of a recording, where the argument names a recording.
pub(super) fn read_recorded(argument: &Path) -> anyhow::Result<Option<Trajectory>> {
    let Some((path, topic)) = named_recording(argument) else { return Ok(None) };
    let (trajectory, topic, left_out) = recording::read_trajectory(&path, topic.as_deref())?;
    tracing::info!("{}: the trajectory of {topic}", path.display());
    if left_out > 0 {
        tracing::warn!(
            "{}: {left_out} messages of {} are no poses or repeat a time, and are left out",
            path.display(),
            topic.name
        );
    }
    if trajectory.is_empty() {
        bail!("{}: no message of {} has a pose", path.display(), topic.name);
    }
    Ok(Some(trajectory))
}

/// Reads a trajectory in the given format, else in the one that its name or first line tells; says
/// which. Of a recording of ROS 2 it is TUM's, whose times and frames are the same.
/// Fails for what cannot be read, for files of other contents and for those without poses.
pub(super) fn read_trajectory(
    path: &Path,
    format: Option<TrajectoryFormat>,
) -> anyhow::Result<(Trajectory, TrajectoryFormat)> {
    if let Some(trajectory) = read_recorded(path)? {
        return Ok((trajectory, TrajectoryFormat::Tum));
    }
    let bytes = fs::read(path)?;
    let format = match format.map_or_else(|| Format::of_file(path, &bytes), Format::Trajectory) {
        Format::Trajectory(format) => format,
        other @ (Format::Bal
        | Format::Bundler
        | Format::Colmap(_)
        | Format::OpenMvg
        | Format::G2o
        | Format::Pyfg
        | Format::Ply) => {
            let (file, entry) = (path.display(), other.entry());
            bail!(
                "{file}: is not a trajectory but {} ({}); `covis convert` makes one from it",
                entry.title,
                entry.name
            )
        }
    };
    Ok((Trajectory::parse_poses_as(&bytes, path, format)?, format))
}

/// As [`read_trajectory`], where times are needed.
/// Fails for a format without times too.
pub(super) fn read_timed(path: &Path) -> anyhow::Result<Trajectory> {
    let (trajectory, format) = read_trajectory(path, None)?;
    if !format.has_times() {
        bail!(
            "{}: holds no times; `covis convert {} OUT.txt --times FILE` adds them",
            path.display(),
            path.display()
        )
    }
    Ok(trajectory)
}

/// What a file is that other programs read and covis does not.
fn foreign(bytes: &[u8]) -> Option<&'static str> {
    if bytes.starts_with(b"#ROSBAG V") {
        return Some(
            "a bag of ROS 1, which covis does not read; rosbags-convert makes one of ROS 2",
        );
    }
    // Whether numbers have their low byte first, the length of the version, and the version.
    let binary = bytes.get(1..).unwrap_or_default().starts_with(b"\x03\0\0\0\0\0\0\x000.");
    binary.then_some(
        "OpenMVG's sfm_data.bin, which covis does not read; openMVG_main_ConvertSfM_DataFormat makes \
         sfm_data.json from it",
    )
}

/// An error of a file, with what the file looks like where that is something else than `wanted`, and the
/// command that takes it.
pub(super) fn with_kind(error: IoError, path: &Path, wanted: Content) -> anyhow::Error {
    // These say by themselves what the file is.
    if matches!(error, IoError::Compressed { .. } | IoError::LineEnds { .. }) {
        return error.into();
    }
    let bytes = fs::read(path).ok();
    if let Some(foreign) = bytes.as_ref().and_then(|bytes| foreign(bytes)) {
        return anyhow!("{error}; it looks like {foreign}");
    }
    let told = bytes.map(|bytes| Format::of_file(path, &bytes));
    // What looks like nothing is called TUM's, which would be no help.
    let unsure = Format::Trajectory(TrajectoryFormat::Tum);
    let other = told.filter(|format| format.entry().content != wanted && *format != unsure);
    let Some(entry) = other.map(Format::entry) else {
        let has_tags = matches!(told, Some(Format::G2o | Format::Pyfg));
        return if has_tags { with_skipping(error) } else { error.into() };
    };
    let command = match entry.content {
        Content::Bundle => "solve bundle",
        Content::PoseGraph => "solve pose-graph",
        Content::Trajectory => "eval",
        Content::Points => return error.into(),
    };
    anyhow!(
        "{error}; it looks like {} ({}), which `covis {command}` takes",
        entry.title,
        entry.name
    )
}

/// The trajectory of times, seconds, and poses.
pub(super) fn joined(poses: impl Iterator<Item = (f64, Se3)>) -> Trajectory {
    let mut trajectory = Trajectory::default();
    poses.for_each(|(time, pose)| trajectory.push(time, pose));
    trajectory
}

/// The usual extension of a format's files.
pub(super) fn extension(format: TrajectoryFormat) -> &'static str {
    Format::Trajectory(format).entry().extensions.first().copied().unwrap_or_default()
}

/// An error of a file of a graph; where a tag is not read, with the flag that skips its lines.
pub(super) fn with_skipping(error: IoError) -> anyhow::Error {
    let is_unknown = matches!(error, IoError::UnknownTag { .. });
    let error = anyhow::Error::new(error);
    match is_unknown {
        true => error.context("--skip-unknown skips the lines that covis does not read"),
        false => error,
    }
}

/// Warns of what the reader of a graph changed: a file that another program wrote may mean something
/// else.
pub(super) fn warn_of_changes(path: &Path, changes: &G2oChanges) {
    let warn = |lines: Option<ChangedLines>, what: &str| {
        if let Some(ChangedLines { count, first_line }) = lines {
            let path = path.display();
            tracing::warn!("{path}: {what}: {count}, the first in line {first_line}");
        }
    };
    warn(changes.normalized, "quaternions far from norm 1 are normalized");
    warn(changes.self_edges, "edges from a vertex to itself are left out");
    for (tag, lines) in &changes.skipped {
        warn(Some(*lines), &format!("lines with the tag {tag} are skipped"));
    }
}

/// Warns of what the model of an OpenMVG file leaves out or changes.
pub(super) fn warn_of_left_out(path: &Path, left_out: &OpenMvgLeftOut) {
    let OpenMvgLeftOut { views, observations, control_points, shared_poses } = *left_out;
    for (count, what) in [
        (views, "views without a pose or an intrinsic are left out"),
        (observations, "observations in such views are left out"),
        (control_points, "control points are left out"),
        (shared_poses, "views share their pose with another one; each gets a pose of its own"),
    ] {
        if count > 0 {
            tracing::warn!("{}: {count} {what}", path.display());
        }
    }
}
