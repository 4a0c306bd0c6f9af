//! g2o out: vertices, `FIX` lines, edges, 17 significant digits.
//!
//! It checks nothing.

use std::path::Path;

use super::super::text::TextWriter;
use super::super::{IoError, files};
use super::{G2oEdge, G2oFile, G2oSe2, G2oVertex};

impl<const P: usize, const U: usize> G2oFile<P, U> {
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
        let mut bytes = Vec::new();
        self.vertices.iter().for_each(|vertex| Self::put_vertex(vertex, &mut bytes));
        self.fixed.iter().for_each(|&id| Self::put_fixed(id, &mut bytes));
        self.edges.iter().for_each(|edge| Self::put_edge(edge, &mut bytes));
        bytes
    }

    /// Appends the line of a vertex, for a caller that does not hold all of a file.
    pub fn put_vertex(vertex: &G2oVertex<P>, out: &mut Vec<u8>) {
        TextWriter::append(out, |text| {
            text.put(format_args!("VERTEX_{} {}", Self::SUFFIX, vertex.id));
            text.put_numbers(&vertex.pose);
            text.end_line();
        });
    }

    /// Appends the line that holds a vertex.
    pub fn put_fixed(id: i64, out: &mut Vec<u8>) {
        TextWriter::append(out, |text| text.put(format_args!("FIX {id}\n")));
    }

    /// Appends the line of an edge.
    pub fn put_edge(edge: &G2oEdge<P, U>, out: &mut Vec<u8>) {
        TextWriter::append(out, |text| {
            text.put(format_args!("EDGE_{} {} {}", Self::SUFFIX, edge.i, edge.j));
            text.put_numbers(&edge.i_from_j);
            text.put_numbers(&edge.information);
            text.end_line();
        });
    }

    /// Numbers that a pose takes.
    pub(super) const POSE_NUMBERS: usize = P;

    /// What the tags of lines end with.
    const SUFFIX: &str = if P == G2oSe2::POSE_NUMBERS { "SE2" } else { "SE3:QUAT" };
}
