//! The file of a pose graph: g2o's, or PyFactorGraph's, whose vertices have names.
//!
//! It reads, and says how vertices are called; the formats are those of `covis_solvers::io`.

use std::fmt;
use std::path::Path;

use anyhow::{anyhow, ensure};
use covis_solvers::io::IoError;
use covis_solvers::io::format::{Content, Format};
use covis_solvers::io::g2o::{G2oChanges, G2oGraph, G2oReading, Indefinite};
use covis_solvers::io::pyfg::{PyfgGraph, PyfgName};
use covis_solvers::problem::{Piece, SolveError};
use serde::Serialize;

use super::kind::format_of;
use crate::cli::formats::{warn_of_changes, with_kind};

/// A file of either format.
pub(super) enum GraphFile {
    G2o(G2oGraph),
    Pyfg(PyfgGraph),
}

/// A vertex as its file calls it.
#[derive(Debug, Serialize)]
#[serde(untagged)]
pub(super) enum Vertex {
    Id(i64),
    Name(String),
}

/// How a file calls the vertex with an id.
pub(super) type Naming = fn(i64) -> Vertex;

impl GraphFile {
    /// Reads a file and warns of what was changed without being asked for, or was skipped.
    /// Fails for what cannot be read, and for `--repair-information` of a file with covariances.
    pub(super) fn read(path: &Path, reading: G2oReading) -> anyhow::Result<(Self, G2oChanges)> {
        let read = if format_of(path) == Format::Pyfg {
            ensure!(
                reading.indefinite == Indefinite::Refuse,
                "--repair-information: {} has covariances, which must be positive definite",
                path.display()
            );
            PyfgGraph::read(path, reading.skip_unknown).map(|(file, skipped)| {
                (Self::Pyfg(file), G2oChanges { skipped, ..G2oChanges::default() })
            })
        } else {
            G2oGraph::read_with(path, reading).map(|(file, changes)| (Self::G2o(file), changes))
        };
        match read {
            Ok((file, changes)) => {
                warn_of_changes(path, &changes);
                Ok((file, changes))
            }
            Err(error @ IoError::IndefiniteInformation { .. }) => Err(anyhow::Error::new(error)
                .context("--repair-information takes the nearest positive semi-definite matrices")),
            Err(error) => Err(with_kind(error, path, Content::PoseGraph)),
        }
    }

    /// Whether the file gives a start.
    pub(super) fn has_vertices(&self) -> bool {
        match self {
            Self::G2o(file) => file.has_vertices(),
            Self::Pyfg(_) => true,
        }
    }

    /// How the file calls its vertices.
    pub(super) fn naming(&self) -> Naming {
        match self {
            Self::G2o(_) => Vertex::Id,
            Self::Pyfg(_) => Vertex::of_name,
        }
    }
}

impl Vertex {
    fn of_name(id: i64) -> Self {
        PyfgName::from_id(id).map_or(Self::Id(id), |name| Self::Name(name.to_string()))
    }

    /// The id of a vertex that an argument names, by id or by name.
    pub(super) fn id_of(text: &str) -> Option<i64> {
        let by_name = || text.parse().ok().map(PyfgName::id);
        text.parse().ok().or_else(by_name)
    }
}

impl fmt::Display for Vertex {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Id(id) => write!(f, "{id}"),
            Self::Name(name) => f.write_str(name),
        }
    }
}

/// An error of a solve, with pieces by the names of their vertices.
pub(super) fn with_names(error: SolveError, naming: Naming) -> anyhow::Error {
    let SolveError::Disconnected { pieces } = &error else { return error.into() };
    let text = Piece::describe_as(pieces, |id| naming(id).to_string());
    anyhow!("the graph is in {} pieces: {text}", pieces.len())
}
