//! What `covis solve pose-graph` tells about the graph itself: gauge, repairs, what stays open.
//!
//! The diagnosis is made at the solution and after the clock has stopped.

use std::path::Path;

use covis_solvers::geometry::LieGroup;
use covis_solvers::io::IoError;
use covis_solvers::io::g2o::{G2oGraph, RepairedEdges};
use covis_solvers::pose_graph::{self, Undetermined};
use covis_solvers::problem::{PoseGraph, SolveError};
use serde::Serialize;

/// Poses that a line of text names.
const NAMED: usize = 3;

/// Names of a tangent's entries, by its dimension.
const PLANE: [&str; 3] = ["x", "y", "rotation"];
const SPACE: [&str; 6] = ["x", "y", "z", "rotation x", "rotation y", "rotation z"];

/// Part of the report's details.
#[derive(Debug, Default, Serialize)]
pub(super) struct Diagnosis {
    /// Ids of the vertices that were held fixed.
    gauge: Vec<i64>,
    /// With `--repair-information`.
    #[serde(skip_serializing_if = "Option::is_none")]
    repaired: Option<Repaired>,
    /// Vertices that the edges leave open.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    undetermined: Vec<Open>,
}

/// Information matrices that were replaced.
#[derive(Debug, Serialize)]
struct Repaired {
    edges: usize,
    #[serde(flatten)]
    first: Option<FirstRepaired>,
}

/// The first of them.
#[derive(Debug, Serialize)]
struct FirstRepaired {
    first_line: u64,
    i: i64,
    j: i64,
    smallest_eigenvalue: f64,
}

/// A vertex and the tangent directions in which it has no information.
#[derive(Debug, Serialize)]
struct Open {
    id: i64,
    directions: Vec<Vec<f64>>,
}

/// Reads a file, as it stands or with its information matrices repaired.
pub(super) fn read(path: &Path, repair: bool) -> anyhow::Result<(G2oGraph, Diagnosis)> {
    if repair {
        let (file, repaired) = G2oGraph::read_repaired(path)?;
        let repaired = Some(Repaired::new(repaired));
        return Ok((file, Diagnosis { repaired, ..Diagnosis::default() }));
    }
    match G2oGraph::read(path) {
        Ok(file) => Ok((file, Diagnosis::default())),
        Err(error @ IoError::IndefiniteInformation { .. }) => Err(anyhow::Error::new(error)
            .context("--repair-information takes the nearest positive semi-definite matrices")),
        Err(error) => Err(error.into()),
    }
}

impl Repaired {
    fn new(repaired: Option<RepairedEdges>) -> Self {
        let edges = repaired.map_or(0, |repaired| repaired.count);
        let first =
            repaired.map(|RepairedEdges { first_line, i, j, smallest_eigenvalue, .. }| {
                FirstRepaired { first_line, i, j, smallest_eigenvalue }
            });
        Self { edges, first }
    }
}

impl Diagnosis {
    /// Adds what can be seen in the solved graph.
    pub(super) fn of_solution<G: LieGroup<N>, const N: usize>(
        &mut self,
        graph: &PoseGraph<G, N>,
    ) -> Result<(), SolveError> {
        let held = graph.ids.iter().zip(&graph.constant).filter(|&(_, &constant)| constant);
        self.gauge = held.map(|(&id, _)| id).collect();
        let open = pose_graph::undetermined(graph)?.into_iter();
        self.undetermined = open
            .map(|Undetermined { id, directions }| Open {
                id,
                directions: directions.iter().map(|d| d.as_slice().to_vec()).collect(),
            })
            .collect();
        Ok(())
    }

    /// Lines `name value` of the summary.
    pub(super) fn lines(&self) -> Vec<(&'static str, String)> {
        let gauge = match self.gauge.as_slice() {
            [id] => format!("vertex {id} fixed"),
            ids => format!("{} vertices fixed", ids.len()),
        };
        let mut lines = vec![("gauge", gauge)];
        if let Some(Repaired { edges, first }) = &self.repaired {
            let first = first.as_ref().map(|first| {
                format!(
                    ", the first in line {}, edge {} to {}, smallest eigenvalue {:.3e}",
                    first.first_line, first.i, first.j, first.smallest_eigenvalue
                )
            });
            let text = format!("{edges} information matrices{}", first.unwrap_or_default());
            lines.push(("repaired", text));
        }
        if !self.undetermined.is_empty() {
            let named = self.undetermined.iter().take(NAMED).map(Open::describe);
            let named = named.collect::<Vec<_>>().join("; ");
            let more = match self.undetermined.len().saturating_sub(NAMED) {
                0 => String::new(),
                more => format!("; and {more} more, which --json lists"),
            };
            lines.push(("undetermined", format!("{named}{more}")));
        }
        lines
    }
}

impl Open {
    /// `vertex 7 (x, rotation z)`: axes by name, other directions by their coordinates.
    fn describe(&self) -> String {
        let directions = self.directions.iter().map(|direction| {
            let names: &[&str] = if direction.len() == PLANE.len() { &PLANE } else { &SPACE };
            let mut moving = direction.iter().zip(names).filter(|&(&x, _)| x != 0.0);
            match (moving.next(), moving.next()) {
                (Some((_, name)), None) => (*name).to_owned(),
                _ => format!("{direction:.3?}"),
            }
        });
        format!("vertex {} ({})", self.id, directions.collect::<Vec<_>>().join(", "))
    }
}
