//! g2o pose graphs: `VERTEX_SE2`, `EDGE_SE2`, `VERTEX_SE3:QUAT`, `EDGE_SE3:QUAT`, `FIX`.
//!
//! A vertex is world_from_pose, an edge i_from_j with the upper triangle of its information matrix,
//! row by row, translation first (covis' own order). The file's numbers are kept as they stand, so
//! that writing gives the same objective back; only the conversion to a pose graph normalizes
//! quaternions whose norm is nearly 1. As g2o does, a reader normalizes all others, and leaves out edges
//! from a vertex to itself; [`G2oChanges`] tells of both. Lines of parameters (`PARAMS_…`) are skipped: no record that is read uses them, and a
//! record that does is refused by its tag. Information matrices may be singular; negative eigenvalues
//! are refused, or repaired in the file's numbers where the caller asks for it. A file may have edges
//! only: its ids then come from the edges, its poses are the identity and the start must be made
//! elsewhere.

mod convert;
mod parse;
mod write;

use std::path::Path;

use super::{IoError, files};

pub use convert::G2oPose;
pub use parse::Indefinite;

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

/// A g2o file's numbers: `P` a pose, `U` in the upper triangle of an information matrix.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct G2oFile<const P: usize, const U: usize> {
    /// Vertices in file order; empty in a file of edges only.
    pub vertices: Vec<G2oVertex<P>>,
    /// Edges in file order.
    pub edges: Vec<G2oEdge<P, U>>,
    /// Ids of `FIX` lines in file order.
    pub fixed: Vec<i64>,
}

/// Edges whose information matrix had negative eigenvalues before it was repaired.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RepairedEdges {
    /// How many there were.
    pub count: usize,
    /// Line of the first, from 1.
    pub first_line: u64,
    /// Id of its vertex i.
    pub i: i64,
    /// Id of its vertex j.
    pub j: i64,
    /// Its smallest eigenvalue, before.
    pub smallest_eigenvalue: f64,
}

/// Lines that a reader changed or left out.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ChangedLines {
    /// How many there were.
    pub count: usize,
    /// The first, from 1.
    pub first_line: u64,
}

/// What a reader changed in a file, so that its caller can tell.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct G2oChanges {
    /// Lines whose quaternion was normalized: its norm differed from 1 by more than 1e-3.
    pub normalized: Option<ChangedLines>,
    /// Edges from a vertex to itself, which were left out.
    pub self_edges: Option<ChangedLines>,
    /// Edges whose information matrix was repaired.
    pub repaired: Option<RepairedEdges>,
}

/// A 2D graph.
pub type G2oSe2 = G2oFile<3, 6>;

/// A 3D graph.
pub type G2oSe3 = G2oFile<7, 21>;

/// A g2o file of either kind.
#[derive(Clone, Debug, PartialEq)]
pub enum G2oGraph {
    /// `VERTEX_SE2` and `EDGE_SE2`.
    Se2(G2oSe2),
    /// `VERTEX_SE3:QUAT` and `EDGE_SE3:QUAT`.
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
    /// not finite, a word too many, a quaternion of zeros, a vertex id that stands twice, an edge or
    /// `FIX` of a vertex that the file does not hold, information matrices with an eigenvalue that is
    /// negative by more than 1e-12 of the largest. And a file without edges and vertices.
    pub fn parse(bytes: &[u8], path: &Path) -> Result<Self, IoError> {
        Self::parse_with(bytes, path, Indefinite::Refuse).map(|(graph, _)| graph)
    }

    /// As [`G2oGraph::read`], and tells what was changed.
    ///
    /// # Errors
    /// [`IoError::Read`], and those of [`G2oGraph::parse_with`].
    pub fn read_with(path: &Path, indefinite: Indefinite) -> Result<(Self, G2oChanges), IoError> {
        Self::parse_with(&files::read(path)?, path, indefinite)
    }

    /// As [`G2oGraph::parse`], and tells what was changed.
    ///
    /// # Errors
    /// Those of [`G2oGraph::parse`], but for what was repaired.
    pub fn parse_with(
        bytes: &[u8],
        path: &Path,
        indefinite: Indefinite,
    ) -> Result<(Self, G2oChanges), IoError> {
        parse::parse(bytes, path, indefinite)
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
