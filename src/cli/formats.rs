//! Formats of files as arguments, and trajectories in any of them.
//!
//! The list is [`covis_solvers::io::format::FORMATS`]; nothing here knows what stands in a file.

use std::path::Path;

use anyhow::{anyhow, bail};
use clap::builder::{PossibleValue, PossibleValuesParser, TypedValueParser};
use covis_solvers::io::IoError;
use covis_solvers::io::format::{Content, Entry, FORMATS, Format};
use covis_solvers::io::trajectory::{Trajectory, TrajectoryFormat};
use fs_err as fs;

/// Takes one of the formats that are read.
pub(super) fn readable() -> impl TypedValueParser<Value = Format> {
    parser(|entry| entry.is_read)
}

/// Takes one of the formats that are written: all.
pub(super) fn writable() -> impl TypedValueParser<Value = Format> {
    parser(|_| true)
}

/// Takes one of the formats of trajectories.
pub(super) fn of_trajectories() -> impl TypedValueParser<Value = TrajectoryFormat> {
    parser(|entry| entry.content == Content::Trajectory).try_map(|format| match format {
        Format::Trajectory(format) => Ok(format),
        Format::Bal | Format::Bundler | Format::Colmap(_) | Format::G2o | Format::Ply => {
            Err("not a format of trajectories")
        }
    })
}

fn parser(is_taken: fn(&Entry) -> bool) -> impl TypedValueParser<Value = Format> {
    let taken = FORMATS.iter().filter(move |entry| is_taken(entry));
    let names = taken.map(|entry| PossibleValue::new(entry.name).help(entry.title));
    PossibleValuesParser::new(names).try_map(|name| {
        let found = FORMATS.iter().find(|entry| entry.name == name);
        found.map(|entry| entry.format).ok_or("not one of the possible values")
    })
}

/// Reads a trajectory in the given format, else in the one that its name or first line tells; says
/// which.
/// Fails for what cannot be read and for files of other contents.
pub(super) fn read_trajectory(
    path: &Path,
    format: Option<TrajectoryFormat>,
) -> anyhow::Result<(Trajectory, TrajectoryFormat)> {
    let bytes = fs::read(path)?;
    let format = match format.map_or_else(|| Format::of_file(path, &bytes), Format::Trajectory) {
        Format::Trajectory(format) => format,
        other @ (Format::Bal | Format::Bundler | Format::Colmap(_) | Format::G2o | Format::Ply) => {
            let (file, entry) = (path.display(), other.entry());
            bail!(
                "{file}: is no trajectory but {} ({}); `covis convert` makes one of it",
                entry.title,
                entry.name
            )
        }
    };
    Ok((Trajectory::parse_as(&bytes, path, format)?, format))
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

/// An error of a file, with what the file looks like where that is something else than `wanted`, and the
/// command that takes it.
pub(super) fn with_kind(error: IoError, path: &Path, wanted: Content) -> anyhow::Error {
    let told = fs::read(path).ok().map(|bytes| Format::of_file(path, &bytes));
    // What looks like nothing is called TUM's, which would be no help.
    let unsure = Format::Trajectory(TrajectoryFormat::Tum);
    let other = told.filter(|format| format.entry().content != wanted && *format != unsure);
    let Some(entry) = other.map(Format::entry) else { return error.into() };
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

/// The usual extension of a format's files.
pub(super) fn extension(format: TrajectoryFormat) -> &'static str {
    Format::Trajectory(format).entry().extensions.first().copied().unwrap_or_default()
}
