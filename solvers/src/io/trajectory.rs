//! TUM trajectories: lines `timestamp tx ty tz qx qy qz qw`, seconds and meters, `#` comments.
//!
//! Poses are world_from_body. Quaternions are normalized within 1e-3 on import. Numbers are written
//! with the fewest digits that read back exactly.

use std::path::Path;

use nalgebra::Vector3;

use super::text::{Text, TextWriter};
use super::{IoError, files, rotation};
use crate::geometry::Se3;

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

    /// Reads a file.
    ///
    /// # Errors
    /// [`IoError::Read`], and those of [`Trajectory::parse`].
    pub fn read(path: &Path) -> Result<Self, IoError> {
        Self::parse(&files::read(path)?, path)
    }

    /// Parses a file's bytes; `path` names them in errors. A file without poses is an empty
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
            let rotation = rotation::from_xyzw(&quaternion, || line.place())?;
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
