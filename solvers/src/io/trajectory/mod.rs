//! Trajectories of TUM, KITTI and EuRoC. Without a format named, a file is TUM's.
//!
//! TUM: lines `timestamp tx ty tz qx qy qz qw`, seconds and meters, `#` comments; commas may separate the
//! numbers. Poses are world_from_body. Quaternions are normalized within 1e-3 on import. Numbers are written
//! with the fewest digits that read back exactly. The others are in `kitti` and `euroc`, how they are
//! distinguished in `columns`. Poses stay in file order: nothing is sorted or interpolated.

mod columns;
mod euroc;
mod kitti;
mod times;

use std::fmt::Display;
use std::path::Path;

use nalgebra::Vector3;

pub use kitti::read_times;
pub use times::{nanoseconds_of_seconds, seconds_of_nanoseconds};

use times::DecimalSeconds;

use super::text::{Line, Text, TextWriter};
use super::{IoError, files, rotation};
use crate::geometry::Se3;

/// The form of a trajectory's file.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum TrajectoryFormat {
    /// Seconds, position, quaternion (x, y, z, w).
    #[default]
    Tum,
    /// Matrices [R | t] without times.
    Kitti,
    /// A table of nanoseconds, position, quaternion (w, x, y, z).
    Euroc,
}

impl TrajectoryFormat {
    /// Told by the first lines that are neither blank nor a comment: twelve words are KITTI's, numbers
    /// between commas are EuRoC's where the times are nanoseconds and TUM's where they are seconds, and
    /// anything else is TUM's to refuse.
    #[must_use]
    pub fn of_bytes(bytes: &[u8]) -> Self {
        columns::format(bytes)
    }

    /// As [`Self::of_bytes`], for a table (`.csv`): EuRoC's where the times do not say otherwise.
    pub(super) fn of_table(bytes: &[u8]) -> Self {
        columns::format_of_table(bytes)
    }

    /// Whether its files hold times.
    #[must_use]
    pub fn has_times(self) -> bool {
        self != Self::Kitti
    }
}

/// A trajectory, one pose a timestamp, in file order.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Trajectory {
    /// Timestamps in seconds.
    pub timestamps: Vec<f64>,
    /// `world_from_body` at each timestamp.
    pub world_from_body: Vec<Se3>,
}

impl Trajectory {
    /// Appends a pose.
    pub fn push(&mut self, timestamp: f64, world_from_body: Se3) {
        self.timestamps.push(timestamp);
        self.world_from_body.push(world_from_body);
    }

    /// The number of poses.
    #[must_use]
    pub fn len(&self) -> usize {
        self.timestamps.len()
    }

    /// Whether there is none.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.timestamps.is_empty()
    }

    /// Length of the straight lines from pose to pose, m.
    #[must_use]
    pub fn length_m(&self) -> f64 {
        let steps = self.world_from_body.windows(2);
        steps.map(|pair| (pair[1].translation - pair[0].translation).norm()).sum()
    }

    /// From the first pose to the last, s.
    #[must_use]
    pub fn duration_s(&self) -> f64 {
        let times = &self.timestamps;
        times.first().zip(times.last()).map_or(0.0, |(first, last)| last - first)
    }

    /// Reads a TUM file.
    ///
    /// # Errors
    /// [`IoError::Read`], and those of [`Trajectory::parse`].
    pub fn read(path: &Path) -> Result<Self, IoError> {
        Self::parse(&files::read(path)?, path)
    }

    /// Reads a file of the given format, else of the one that its first line tells, and says which.
    /// Poses of a format without times have the numbers of their rows, from 0, as seconds.
    ///
    /// # Errors
    /// [`IoError::Read`], and those of [`Trajectory::parse_as`].
    pub fn read_any(
        path: &Path,
        format: Option<TrajectoryFormat>,
    ) -> Result<(Self, TrajectoryFormat), IoError> {
        let bytes = files::read(path)?;
        let format = format.unwrap_or_else(|| TrajectoryFormat::of_bytes(&bytes));
        Ok((Self::parse_as(&bytes, path, format)?, format))
    }

    /// Parses a file's bytes in a format; `path` names them in errors. A file without poses is an empty
    /// trajectory.
    ///
    /// # Errors
    /// With its line: the first field that is missing, malformed or not finite, a word too many, a
    /// quaternion whose norm is off by more than 1e-3, a matrix that is no rigid motion. And what shows
    /// that the file has another format ([`IoError::OtherFormat`]), is compressed, or ends its lines in
    /// CR alone.
    pub fn parse_as(bytes: &[u8], path: &Path, format: TrajectoryFormat) -> Result<Self, IoError> {
        files::check_lines(bytes, path)?;
        match format {
            TrajectoryFormat::Tum => Self::parse(bytes, path),
            TrajectoryFormat::Kitti => kitti::parse(bytes, path),
            TrajectoryFormat::Euroc => euroc::parse(bytes, path),
        }
    }

    /// As [`Trajectory::parse_as`], where poses are needed.
    ///
    /// # Errors
    /// Those of [`Trajectory::parse_as`], and [`IoError::Empty`] where the file holds no pose.
    pub fn parse_poses_as(
        bytes: &[u8],
        path: &Path,
        format: TrajectoryFormat,
    ) -> Result<Self, IoError> {
        let trajectory = Self::parse_as(bytes, path, format)?;
        if !trajectory.is_empty() {
            return Ok(trajectory);
        }
        let is_empty = bytes.trim_ascii().is_empty();
        let what = if is_empty { "pose, the file is empty" } else { "pose, only comments" };
        Err(IoError::Empty { path: path.to_owned(), what })
    }

    /// Parses a TUM file's bytes; `path` names them in errors. A file without poses is an empty
    /// trajectory.
    ///
    /// # Errors
    /// With its line: the first field that is missing, malformed or not finite, a ninth word, or a
    /// quaternion whose norm is off by more than 1e-3. And [`IoError::OtherFormat`] where a row is
    /// KITTI's or the header names the quaternion's w first, compressed bytes, lines that end in CR
    /// alone.
    pub fn parse(bytes: &[u8], path: &Path) -> Result<Self, IoError> {
        files::check_lines(bytes, path)?;
        columns::check_order(bytes, path, TrajectoryFormat::Tum)?;
        let is_table = columns::is_table(bytes);
        let mut text = Text::new(bytes, path);
        let mut trajectory = Self::default();
        while let Some(line) = text.record() {
            let line = line.separated(is_table);
            let row = tum_row(line).map_err(|error| columns::not_tum(line).unwrap_or(error));
            let (timestamp, pose) = row?;
            trajectory.push(timestamp, pose);
        }
        Ok(trajectory)
    }

    /// Writes the trajectory in TUM form.
    ///
    /// # Errors
    /// [`IoError::Write`].
    pub fn write(&self, path: &Path) -> Result<(), IoError> {
        files::write(path, &self.to_bytes())
    }

    /// Writes the trajectory in a format.
    ///
    /// # Errors
    /// [`IoError::Write`], and those of [`Trajectory::to_bytes_as`].
    pub fn write_as(&self, path: &Path, format: TrajectoryFormat) -> Result<(), IoError> {
        files::write(path, &self.to_bytes_as(format)?)
    }

    /// A file's bytes in a format.
    ///
    /// # Errors
    /// [`IoError::UnwritableText`] where a time has no 64-bit number of nanoseconds, in EuRoC's format.
    pub fn to_bytes_as(&self, format: TrajectoryFormat) -> Result<Vec<u8>, IoError> {
        match format {
            TrajectoryFormat::Tum => Ok(self.to_bytes()),
            TrajectoryFormat::Kitti => Ok(kitti::to_bytes(self)),
            TrajectoryFormat::Euroc => euroc::to_bytes(self),
        }
    }

    /// The TUM file's bytes.
    #[must_use]
    pub fn to_bytes(&self) -> Vec<u8> {
        let mut bytes = Self::HEAD.to_vec();
        for (&timestamp, pose) in self.timestamps.iter().zip(&self.world_from_body) {
            put_row(format_args!("{timestamp:?}"), pose, &mut bytes);
        }
        bytes
    }

    /// What a TUM file begins with.
    pub const HEAD: &[u8] = b"# timestamp tx ty tz qx qy qz qw\n";

    /// Appends the line of a pose, for a caller that does not hold all of a file. The time
    /// has the digits that give its nanoseconds back, which can be more than a number of seconds holds.
    pub fn put_pose(nanoseconds: i64, world_from_body: &Se3, out: &mut Vec<u8>) {
        put_row(DecimalSeconds(nanoseconds), world_from_body, out);
    }
}

/// Appends a row of a TUM file.
fn put_row(seconds: impl Display, world_from_body: &Se3, out: &mut Vec<u8>) {
    TextWriter::append(out, |text| {
        text.put(seconds);
        let rotation = rotation::to_xyzw(&world_from_body.rotation);
        for number in world_from_body.translation.iter().chain(&rotation) {
            text.put(format_args!(" {number:?}"));
        }
        text.end_line();
    });
}

/// Time and pose of a row of a TUM file.
fn tum_row(mut line: Line<'_>) -> Result<(f64, Se3), IoError> {
    let timestamp = line.number("timestamp")?;
    let [x, y, z] = line.numbers("translation")?;
    let quaternion = line.numbers("quaternion")?;
    let rotation = rotation::from_xyzw(&quaternion, || line.location())?;
    line.end()?;
    Ok((timestamp, Se3::new(rotation, Vector3::new(x, y, z))))
}
