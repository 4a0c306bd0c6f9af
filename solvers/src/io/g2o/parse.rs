//! g2o in: one pass over the lines, then the checks that need the whole file.
//!
//! Lines are remembered during the parse only, so that a refusal names them. Numbers stay those of the
//! file, except for quaternions far from norm 1 and for information matrices that are repaired on request.

use std::collections::BTreeSet;
use std::path::Path;

use super::super::error::excerpt;
use super::super::rotation::normalized;
use super::super::text::{Line, Text};
use super::super::{IoError, Location, files};
use super::convert::{refused, symmetric, upper_triangle};
use super::{ChangedLines, G2oChanges, G2oEdge, G2oFile, G2oGraph, G2oVertex, RepairedEdges};
use crate::information::{Information, InformationError};

/// What becomes of information matrices with negative eigenvalues.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Indefinite {
    /// The file is refused.
    Refuse,
    /// The nearest positive semi-definite matrix (in the Frobenius norm) takes their place.
    Repair,
}

/// What a line holds.
enum Tag {
    Vertex,
    Edge,
    Fix,
    Parameter,
}

/// A file that is being read, with the line of each record.
struct Builder<const P: usize, const U: usize> {
    file: G2oFile<P, U>,
    edge_lines: Vec<u64>,
    ids: BTreeSet<i64>,
    changes: G2oChanges,
}

/// The file, and what was changed in it.
pub(super) fn parse(
    bytes: &[u8],
    path: &Path,
    indefinite: Indefinite,
) -> Result<(G2oGraph, G2oChanges), IoError> {
    files::check_lines(bytes, path)?;
    let mut se2 = Builder::<3, 6>::new();
    let mut se3 = Builder::<7, 21>::new();
    let mut fixed: Vec<(i64, u64)> = Vec::new();
    let mut text = Text::new(bytes, path);
    while let Some(mut line) = text.record() {
        let word = line.word().unwrap_or_default();
        let (tag, is_se3) = match word {
            b"VERTEX_SE2" => (Tag::Vertex, false),
            b"EDGE_SE2" => (Tag::Edge, false),
            b"VERTEX_SE3:QUAT" => (Tag::Vertex, true),
            b"EDGE_SE3:QUAT" => (Tag::Edge, true),
            b"FIX" => (Tag::Fix, false),
            // Only edges that are not read, and refused, use parameters.
            word if word.starts_with(b"PARAMS_") => (Tag::Parameter, false),
            _ => return Err(IoError::UnknownTag { location: line.location(), tag: excerpt(word) }),
        };
        match (tag, is_se3) {
            (Tag::Parameter, _) => {}
            (Tag::Fix, _) => {
                fixed.push((line.integer("vertex id")?, line.line_number()));
                while !line.is_at_end() {
                    fixed.push((line.integer("vertex id")?, line.line_number()));
                }
            }
            (_, false) if !se3.is_empty() => return Err(mixed(&line, word, "3D")),
            (_, true) if !se2.is_empty() => return Err(mixed(&line, word, "2D")),
            (Tag::Vertex, false) => se2.vertex(line)?,
            (Tag::Vertex, true) => se3.vertex(line)?,
            (Tag::Edge, false) => se2.edge(line)?,
            (Tag::Edge, true) => se3.edge(line)?,
        }
    }
    if !se2.is_empty() {
        let (file, changes) = se2.finish::<3>(fixed, path, indefinite)?;
        Ok((G2oGraph::Se2(file), changes))
    } else if !se3.is_empty() {
        let (file, changes) = se3.finish::<6>(fixed, path, indefinite)?;
        Ok((G2oGraph::Se3(file), changes))
    } else {
        Err(IoError::Empty { path: path.to_owned(), what: "vertex or edge" })
    }
}

fn mixed(line: &Line<'_>, tag: &[u8], kind: &'static str) -> IoError {
    IoError::MixedKinds { location: line.location(), kind, found: excerpt(tag) }
}

impl<const P: usize, const U: usize> Builder<P, U> {
    fn new() -> Self {
        let file = G2oFile { vertices: Vec::new(), edges: Vec::new(), fixed: Vec::new() };
        let changes = G2oChanges::default();
        Self { file, edge_lines: Vec::new(), ids: BTreeSet::new(), changes }
    }

    fn is_empty(&self) -> bool {
        self.file.vertices.is_empty() && self.file.edges.is_empty()
    }

    fn vertex(&mut self, mut line: Line<'_>) -> Result<(), IoError> {
        let id: i64 = line.integer("vertex id")?;
        let mut pose = line.numbers("pose")?;
        self.normalize(&mut pose, &line)?;
        let location = line.location();
        line.end()?;
        if !self.ids.insert(id) {
            return Err(IoError::DuplicateId { location, field: "vertex", id: id.into() });
        }
        self.file.vertices.push(G2oVertex { id, pose });
        Ok(())
    }

    fn edge(&mut self, mut line: Line<'_>) -> Result<(), IoError> {
        let i: i64 = line.integer("vertex i")?;
        let j: i64 = line.integer("vertex j")?;
        let mut i_from_j = line.numbers("measurement")?;
        let information = line.numbers("information")?;
        if i == j {
            note(&mut self.changes.self_edges, &line);
            return line.end();
        }
        self.normalize(&mut i_from_j, &line)?;
        self.edge_lines.push(line.line_number());
        line.end()?;
        self.file.edges.push(G2oEdge { i, j, i_from_j, information });
        Ok(())
    }

    /// Gives the quaternion of a 3D pose norm 1, unless rounding alone keeps it from that.
    fn normalize(&mut self, pose: &mut [f64; P], line: &Line<'_>) -> Result<(), IoError> {
        let quaternion = pose.get_mut(3..).and_then(|q| q.first_chunk_mut::<4>());
        if let Some(quaternion) = quaternion
            && let Some(new) = normalized(quaternion, || line.location())?
        {
            *quaternion = new;
            note(&mut self.changes.normalized, line);
        }
        Ok(())
    }

    /// The checks that need the whole file; `N` is the tangent's dimension.
    fn finish<const N: usize>(
        mut self,
        fixed: Vec<(i64, u64)>,
        path: &Path,
        indefinite: Indefinite,
    ) -> Result<(G2oFile<P, U>, G2oChanges), IoError> {
        let edges = &self.file.edges;
        if !self.file.has_vertices() {
            self.ids.extend(edges.iter().flat_map(|e| [e.i, e.j]));
        }
        let lines = || edges.iter().zip(&self.edge_lines);
        let edge_ends = lines().flat_map(|(e, &line)| [(e.i, line), (e.j, line)]);
        for (id, line) in edge_ends.chain(fixed.iter().copied()) {
            if !self.ids.contains(&id) {
                let location = Location::line(path, line);
                return Err(IoError::UnknownId { location, field: "vertex", id: id.into() });
            }
        }
        self.changes.repaired = self.check_information::<N>(path, indefinite)?;
        self.file.fixed = fixed.into_iter().map(|(id, _)| id).collect();
        Ok((self.file, self.changes))
    }

    /// Refuses or repairs information matrices with negative eigenvalues.
    fn check_information<const N: usize>(
        &mut self,
        path: &Path,
        indefinite: Indefinite,
    ) -> Result<Option<RepairedEdges>, IoError> {
        let mut first = None;
        let mut count = 0;
        for (edge, &line) in self.file.edges.iter_mut().zip(&self.edge_lines) {
            let matrix = symmetric::<N, U>(&edge.information);
            let Err(error) = Information::semidefinite(&matrix) else { continue };
            count += 1;
            first.get_or_insert((error, line, (edge.i, edge.j)));
            if indefinite == Indefinite::Repair {
                let nearest = Information::nearest(&matrix);
                let refuse =
                    |error| refused(error, Location::line(path, line), (edge.i, edge.j), 1);
                edge.information = upper_triangle(&nearest.map_err(refuse)?);
            }
        }
        match (first, indefinite) {
            (None, _) => Ok(None),
            (
                Some((InformationError::Indefinite { smallest_eigenvalue }, first_line, (i, j))),
                Indefinite::Repair,
            ) => Ok(Some(RepairedEdges { count, first_line, i, j, smallest_eigenvalue })),
            (Some((error, line, edge)), _) => {
                Err(refused(error, Location::line(path, line), edge, count))
            }
        }
    }
}

/// Counts a line that is changed.
fn note(lines: &mut Option<ChangedLines>, line: &Line<'_>) {
    let first = ChangedLines { count: 0, first_line: line.line_number() };
    lines.get_or_insert(first).count += 1;
}
