//! Trajectories of TUM, KITTI and EuRoC. Without a format named, a file is TUM's.
//!
//! TUM: lines `timestamp tx ty tz qx qy qz qw`, seconds and meters, `#` comments. Poses are
//! world_from_body. Quaternions are normalized within 1e-3 on import. Numbers are written with the
//! fewest digits that read back exactly. The others are in `kitti` and `euroc`. Poses stay in file
//! order: nothing is sorted or interpolated.

mod euroc;
mod kitti;

use std::path::Path;

use nalgebra::Vector3;

pub use kitti::read_times;

use super::text::{Text, TextWriter};
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
    /// Told by the first line that is neither blank nor a comment: a comma is EuRoC's, twelve words are
    /// KITTI's, and anything else is TUM's to refuse.
    #[must_use]
    pub fn of_bytes(bytes: &[u8]) -> Self {
        let mut words = 0;
        if let Some(mut line) = Text::new(bytes, Path::new("")).record() {
            let mut rest = line;
            if rest.tail().contains(&b',') {
                return Self::Euroc;
            }
            while words <= 12 && line.word().is_some() {
                words += 1;
            }
        }
        if words == 12 { Self::Kitti } else { Self::Tum }
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
    /// quaternion whose norm is off by more than 1e-3, a matrix that is no rigid motion.
    pub fn parse_as(bytes: &[u8], path: &Path, format: TrajectoryFormat) -> Result<Self, IoError> {
        files::check_plain(bytes, path)?;
        match format {
            TrajectoryFormat::Tum => Self::parse(bytes, path),
            TrajectoryFormat::Kitti => kitti::parse(bytes, path),
            TrajectoryFormat::Euroc => euroc::parse(bytes, path),
        }
    }

    /// Parses a TUM file's bytes; `path` names them in errors. A file without poses is an empty
    /// trajectory.
    ///
    /// # Errors
    /// The first field that is missing, malformed or not finite, a ninth word, or a quaternion
    /// whose norm is off by more than 1e-3, with its line.
    pub fn parse(bytes: &[u8], path: &Path) -> Result<Self, IoError> {
        let mut text = Text::new(bytes, path);
        let mut trajectory = Self::default();
        while let Some(mut line) = text.record() {
            let timestamp = line.number("timestamp")?;
            let [x, y, z] = line.numbers("translation")?;
            let quaternion = line.numbers("quaternion")?;
            let rotation = rotation::from_xyzw(&quaternion, || line.location())?;
            trajectory.push(timestamp, Se3::new(rotation, Vector3::new(x, y, z)));
            line.end()?;
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
            Self::put_pose(timestamp, pose, &mut bytes);
        }
        bytes
    }

    /// What a TUM file begins with.
    pub const HEAD: &[u8] = b"# timestamp tx ty tz qx qy qz qw\n";

    /// Appends the line of a pose, for a caller that does not hold all of a file.
    pub fn put_pose(timestamp: f64, world_from_body: &Se3, out: &mut Vec<u8>) {
        TextWriter::append(out, |text| {
            text.put(format_args!("{timestamp:?}"));
            let rotation = rotation::to_xyzw(&world_from_body.rotation);
            for number in world_from_body.translation.iter().chain(&rotation) {
                text.put(format_args!(" {number:?}"));
            }
            text.end_line();
        });
    }
}
