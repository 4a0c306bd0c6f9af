//! g2o out: vertices, `FIX` lines, edges, 17 significant digits.

use std::path::Path;

use super::super::text::TextWriter;
use super::super::{IoError, files};
use super::{G2oFile, G2oSe2};

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
        let suffix = if P == G2oSe2::POSE_NUMBERS { "SE2" } else { "SE3:QUAT" };
        let mut text = TextWriter::default();
        for vertex in &self.vertices {
            text.put(format_args!("VERTEX_{suffix} {}", vertex.id));
            text.put_numbers(&vertex.pose);
            text.end_line();
        }
        for id in &self.fixed {
            text.put(format_args!("FIX {id}\n"));
        }
        for edge in &self.edges {
            text.put(format_args!("EDGE_{suffix} {} {}", edge.i, edge.j));
            text.put_numbers(&edge.i_from_j);
            text.put_numbers(&edge.information);
            text.end_line();
        }
        text.into_bytes()
    }

    /// Numbers that a pose takes.
    pub(super) const POSE_NUMBERS: usize = P;
}
