//! PyFactorGraph's text files (`.pyfg`, `.pfg`), which CORA reads too: pose graphs with ranges.
//!
//! A vertex is world_from_pose or a point in the world, an edge i_from_j with the upper triangle of its
//! COVARIANCE, row by row, translation first. A range is the distance between two variables, each a pose or
//! a landmark, with its variance. Variables have names ([`PyfgName`]), all records but landmarks a time. The
//! file's numbers are kept as they are, so that writing gives the same objective back. A record that is not
//! read is refused by its tag, or skipped and counted where the caller asks for it.
//!
//! | file | role |
//! |---|---|
//! | `name`, `time` | names of variables, times of records |
//! | `parse`, `write` | in and out |
//! | `convert` | graphs from files and files from graphs; g2o |

mod convert;
mod name;
mod parse;
mod time;
mod write;

use std::path::Path;

use super::{IoError, files};

pub use super::changed_lines::ChangedLines;
pub use name::{BadName, PyfgName};
pub use time::{BadTime, PyfgTime};

/// A pose.
#[derive(Clone, Debug, PartialEq)]
pub struct PyfgPose<const P: usize> {
    /// Its time.
    pub time: PyfgTime,
    /// Its name.
    pub name: PyfgName,
    /// world_from_pose: `x y theta`, or `x y z qx qy qz qw`.
    pub pose: [f64; P],
}

/// A landmark, which has no time.
#[derive(Clone, Debug, PartialEq)]
pub struct PyfgLandmark {
    /// Its name.
    pub name: PyfgName,
    /// The position in the world, m; z = 0 in the plane.
    pub position: [f64; 3],
}

/// A measured pose.
#[derive(Clone, Debug, PartialEq)]
pub struct PyfgPosePrior<const P: usize, const U: usize> {
    /// When it was measured.
    pub time: PyfgTime,
    /// The pose.
    pub name: PyfgName,
    /// The measured world_from_pose, in the form of [`PyfgPose::pose`].
    pub world_from_pose: [f64; P],
    /// Upper triangle of the covariance, row by row.
    pub covariance: [f64; U],
}

/// A measured position of a landmark.
#[derive(Clone, Debug, PartialEq)]
pub struct PyfgLandmarkPrior {
    /// When it was measured.
    pub time: PyfgTime,
    /// The landmark.
    pub name: PyfgName,
    /// The position in the world, m; z = 0 in the plane.
    pub position: [f64; 3],
    /// Upper triangle of the covariance over (x, y, z), row by row; zero where the plane has no z.
    pub covariance: [f64; 6],
}

/// A relative pose.
#[derive(Clone, Debug, PartialEq)]
pub struct PyfgEdge<const P: usize, const U: usize> {
    /// When it was measured.
    pub time: PyfgTime,
    /// Pose i.
    pub i: PyfgName,
    /// Pose j.
    pub j: PyfgName,
    /// The measured i_from_j, in the form of [`PyfgPose::pose`].
    pub i_from_j: [f64; P],
    /// Upper triangle of the covariance, row by row.
    pub covariance: [f64; U],
}

/// A landmark as a pose sees it.
#[derive(Clone, Debug, PartialEq)]
pub struct PyfgSighting {
    /// When it was measured.
    pub time: PyfgTime,
    /// The pose.
    pub pose: PyfgName,
    /// The landmark.
    pub landmark: PyfgName,
    /// The position in the frame of the pose, m; z = 0 in the plane.
    pub position: [f64; 3],
    /// Upper triangle of the covariance over (x, y, z), row by row; zero where the plane has no z.
    pub covariance: [f64; 6],
}

/// A distance between two variables.
#[derive(Clone, Debug, PartialEq)]
pub struct PyfgRange {
    /// When it was measured.
    pub time: PyfgTime,
    /// The two, each a pose or a landmark.
    pub ends: [PyfgName; 2],
    /// The distance, m.
    pub distance_m: f64,
    /// Its variance, m².
    pub variance: f64,
}

/// A file's numbers: `P` a pose, `U` in the upper triangle of a covariance. Each list has file order.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct PyfgFile<const P: usize, const U: usize> {
    /// Poses.
    pub poses: Vec<PyfgPose<P>>,
    /// Landmarks.
    pub landmarks: Vec<PyfgLandmark>,
    /// Measured poses.
    pub pose_priors: Vec<PyfgPosePrior<P, U>>,
    /// Measured positions of landmarks.
    pub landmark_priors: Vec<PyfgLandmarkPrior>,
    /// Relative poses.
    pub edges: Vec<PyfgEdge<P, U>>,
    /// Landmarks as poses see them.
    pub sightings: Vec<PyfgSighting>,
    /// Distances.
    pub ranges: Vec<PyfgRange>,
}

/// A 2D file.
pub type PyfgSe2 = PyfgFile<3, 6>;

/// A 3D file.
pub type PyfgSe3 = PyfgFile<7, 21>;

/// A file of either kind.
#[derive(Clone, Debug, PartialEq)]
pub enum PyfgGraph {
    /// In the plane: `VERTEX_SE2`, `VERTEX_XY`, ….
    Se2(PyfgSe2),
    /// In space: `VERTEX_SE3:QUAT`, `VERTEX_XYZ`, ….
    Se3(PyfgSe3),
}

/// A file, and the lines that were skipped, by tag.
pub type PyfgRead = (PyfgGraph, Vec<(String, ChangedLines)>);

impl PyfgGraph {
    /// Reads a file; `skip_unknown` skips lines with tags that are not read.
    ///
    /// # Errors
    /// [`IoError::Read`], and those of [`PyfgGraph::parse`].
    pub fn read(path: &Path, skip_unknown: bool) -> Result<PyfgRead, IoError> {
        Self::parse(&files::read(path)?, path, skip_unknown)
    }

    /// Parses a file's bytes; `path` names them in errors. `skip_unknown` skips lines with tags that are not
    /// read.
    ///
    /// # Errors
    /// With its line: an unknown tag, 2D and 3D in one file, a field that is missing, malformed or not
    /// finite, a word too many, a quaternion whose norm is off by more than 1e-3, a covariance that is not
    /// positive definite, a name that occurs twice or that no vertex has, a record between a variable and
    /// itself. And a file without vertices.
    pub fn parse(bytes: &[u8], path: &Path, skip_unknown: bool) -> Result<PyfgRead, IoError> {
        parse::parse(bytes, path, skip_unknown)
    }

    /// Writes the file with 17 significant digits: reading it gives the same numbers, names and times.
    ///
    /// # Errors
    /// [`IoError::Write`].
    pub fn write(&self, path: &Path) -> Result<(), IoError> {
        files::write(path, &self.to_bytes())
    }

    /// The file's bytes.
    #[must_use]
    pub fn to_bytes(&self) -> Vec<u8> {
        match self {
            Self::Se2(file) => file.to_bytes(),
            Self::Se3(file) => file.to_bytes(),
        }
    }
}
