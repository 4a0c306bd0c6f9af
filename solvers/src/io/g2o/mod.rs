//! g2o graphs: poses in the plane or in space, landmarks, edges, measurements of landmarks, priors, `FIX`.
//!
//! A vertex is world_from_pose or a point in the world, an edge i_from_j with the upper triangle of its
//! information matrix, row by row, translation first (covis' own order). A measurement in space is in
//! the frame of a sensor, whose place on the pose a line of parameters gives. The file's numbers are
//! kept as they stand, so that writing gives the same objective back; only the conversion to a pose
//! graph normalizes quaternions whose norm is nearly 1. As g2o does, a reader normalizes all others, and
//! leaves out edges from a vertex to itself; [`G2oChanges`] counts both. Other lines of parameters
//! (`PARAMS_…`) are skipped: no record that is read uses them. A record that is not read is refused by
//! its tag, or skipped and counted where the caller asks for it. Information matrices may be singular;
//! negative eigenvalues are refused, or repaired in the file's numbers where the caller asks for it. The
//! lines of TORO are read as well, and written as g2o's. A
//! file may have no vertices: its ids then come from the edges, its poses are the identity and the start
//! must be made elsewhere.
//!
//! | file | role |
//! |---|---|
//! | `tags`, `toro` | the tags of lines; numbers as TORO writes them |
//! | `parse`, `write` | in and out |
//! | `convert`, `landmarks` | graphs from files and files from graphs; what is measured of landmarks |

mod convert;
mod landmarks;
mod parse;
mod tags;
mod toro;
mod write;

use std::path::Path;

use super::{IoError, files};

pub use super::changed_lines::ChangedLines;
pub use convert::G2oPose;

/// One vertex line.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct G2oVertex<const P: usize> {
    /// The id.
    pub id: i64,
    /// world_from_pose: `x y theta`, or `x y z qx qy qz qw`.
    pub pose: [f64; P],
}

/// One edge line.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct G2oEdge<const P: usize, const U: usize> {
    /// Id of vertex i.
    pub i: i64,
    /// Id of vertex j.
    pub j: i64,
    /// The measured i_from_j, in the form of [`G2oVertex::pose`].
    pub i_from_j: [f64; P],
    /// Upper triangle of the information matrix, row by row.
    pub information: [f64; U],
}

/// One landmark line.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct G2oPoint {
    /// The id, in one space with those of poses.
    pub id: i64,
    /// The position in the world; z = 0 in the plane.
    pub position: [f64; 3],
}

/// Where a sensor is on a pose.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct G2oOffset<const P: usize> {
    /// The id of the parameter.
    pub id: i64,
    /// pose_from_sensor, in the form of [`G2oVertex::pose`].
    pub pose_from_sensor: [f64; P],
}

/// What a line says of a landmark.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum G2oMeasured {
    /// Its position in the frame of the sensor; z = 0 in the plane.
    Position([f64; 3]),
    /// Its direction from the x axis of the pose, radians.
    Bearing(f64),
}

/// One measurement of a landmark.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct G2oSighting {
    /// Id of the pose.
    pub pose: i64,
    /// Id of the landmark.
    pub point: i64,
    /// Id of the offset of the sensor; `None` in the plane.
    pub offset: Option<i64>,
    /// The measurement.
    pub measured: G2oMeasured,
    /// Upper triangle of the information matrix over (x, y, z), row by row; what the measurement does
    /// not have is zero.
    pub information: [f64; 6],
}

/// One measured pose.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct G2oPosePrior<const P: usize, const U: usize> {
    /// Id of the pose.
    pub id: i64,
    /// Id of the offset of the sensor; `None` in the plane.
    pub offset: Option<i64>,
    /// The measured world_from_sensor, in the form of [`G2oVertex::pose`].
    pub world_from_sensor: [f64; P],
    /// Upper triangle of the information matrix, row by row.
    pub information: [f64; U],
}

/// One measured position of a pose or a landmark.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct G2oPositionPrior {
    /// Id of the pose or landmark.
    pub id: i64,
    /// Id of an offset, where the tag has one. g2o does not use it: the origin of the pose is measured.
    pub offset: Option<i64>,
    /// The position in the world; z = 0 in the plane.
    pub position: [f64; 3],
    /// Upper triangle of the information matrix over (x, y, z), row by row; zero where the plane has no z.
    pub information: [f64; 6],
}

/// A g2o file's numbers: `P` a pose, `U` in the upper triangle of an information matrix.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct G2oFile<const P: usize, const U: usize> {
    /// Vertices in file order; empty in a file of edges only.
    pub vertices: Vec<G2oVertex<P>>,
    /// Edges in file order.
    pub edges: Vec<G2oEdge<P, U>>,
    /// Ids of `FIX` lines in file order, of poses and landmarks.
    pub fixed: Vec<i64>,
    /// Landmarks in file order.
    pub points: Vec<G2oPoint>,
    /// Offsets of sensors in file order.
    pub offsets: Vec<G2oOffset<P>>,
    /// Measurements of landmarks in file order.
    pub sightings: Vec<G2oSighting>,
    /// Measured poses in file order.
    pub pose_priors: Vec<G2oPosePrior<P, U>>,
    /// Measured positions in file order.
    pub position_priors: Vec<G2oPositionPrior>,
}

/// What becomes of information matrices with negative eigenvalues.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Indefinite {
    /// The file is refused.
    #[default]
    Refuse,
    /// The nearest positive semi-definite matrix (in the Frobenius norm) takes their place.
    Repair,
}

/// How a file is read.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct G2oReading {
    /// What becomes of indefinite information matrices.
    pub indefinite: Indefinite,
    /// Whether lines with a tag that is not read are skipped and counted; otherwise they are refused.
    pub skip_unknown: bool,
}

/// Lines whose information matrix had negative eigenvalues before it was repaired.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RepairedEdges {
    /// How many there were.
    pub count: usize,
    /// Line of the first, from 1.
    pub first_line: u64,
    /// Id of its vertex i.
    pub i: i64,
    /// Id of its vertex j; i again in a prior.
    pub j: i64,
    /// Its smallest eigenvalue, before.
    pub smallest_eigenvalue: f64,
}

/// What a reader changed in a file, so that its caller can tell.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct G2oChanges {
    /// Lines whose quaternion was normalized: its norm differed from 1 by more than 1e-3.
    pub normalized: Option<ChangedLines>,
    /// Edges from a vertex to itself, which were left out.
    pub self_edges: Option<ChangedLines>,
    /// Lines whose information matrix was repaired.
    pub repaired: Option<RepairedEdges>,
    /// Lines that were skipped, by tag.
    pub skipped: Vec<(String, ChangedLines)>,
}

/// A 2D graph.
pub type G2oSe2 = G2oFile<3, 6>;

/// A 3D graph.
pub type G2oSe3 = G2oFile<7, 21>;

/// A g2o file of either kind.
#[derive(Clone, Debug, PartialEq)]
pub enum G2oGraph {
    /// In the plane: `VERTEX_SE2`, `EDGE_SE2`, ….
    Se2(G2oSe2),
    /// In space: `VERTEX_SE3:QUAT`, `EDGE_SE3:QUAT`, ….
    Se3(G2oSe3),
}

impl G2oGraph {
    /// Reads a file.
    ///
    /// # Errors
    /// [`IoError::Read`], and those of [`G2oGraph::parse`].
    pub fn read(path: &Path) -> Result<Self, IoError> {
        Self::parse(&files::read(path)?, path)
    }

    /// Parses a file's bytes; `path` names them in errors.
    ///
    /// # Errors
    /// With its line: an unknown tag, 2D and 3D in one file, a field that is missing, malformed or
    /// not finite, a word too many, a quaternion of zeros, an id that occurs twice, a vertex or a
    /// parameter that is named and that the file does not hold, information matrices with an eigenvalue
    /// that is negative by more than 1e-12 of the largest. And a file without edges and vertices.
    pub fn parse(bytes: &[u8], path: &Path) -> Result<Self, IoError> {
        Self::parse_with(bytes, path, G2oReading::default()).map(|(graph, _)| graph)
    }

    /// As [`G2oGraph::read`], and tells what was changed.
    ///
    /// # Errors
    /// [`IoError::Read`], and those of [`G2oGraph::parse_with`].
    pub fn read_with(path: &Path, reading: G2oReading) -> Result<(Self, G2oChanges), IoError> {
        Self::parse_with(&files::read(path)?, path, reading)
    }

    /// As [`G2oGraph::parse`], and tells what was changed.
    ///
    /// # Errors
    /// Those of [`G2oGraph::parse`], but for what was repaired or skipped.
    pub fn parse_with(
        bytes: &[u8],
        path: &Path,
        reading: G2oReading,
    ) -> Result<(Self, G2oChanges), IoError> {
        parse::parse(bytes, path, reading)
    }

    /// Writes the file with 17 significant digits: reading it gives the same numbers.
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

    /// Whether the file gives a start; if not, it has edges only.
    #[must_use]
    pub fn has_vertices(&self) -> bool {
        match self {
            Self::Se2(file) => file.has_vertices(),
            Self::Se3(file) => file.has_vertices(),
        }
    }
}

impl<const P: usize, const U: usize> G2oFile<P, U> {
    /// Whether the file gives a start; if not, it has edges only.
    #[must_use]
    pub fn has_vertices(&self) -> bool {
        !self.vertices.is_empty()
    }
}
