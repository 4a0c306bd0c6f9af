//! Blocks and vectors over the columns of a view, laid out for vectors of eight.
//!
//! A view has D columns: V·8 entries in vectors and, where D is one more, a *tail* of T = 1 that is
//! kept apart, so that nine columns do not cost sixteen. Nothing here computes.

use crate::simd::{Line, WIDTH};

/// A vector over a view's columns; entries past D are zero.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct ViewVector<const V: usize, const T: usize> {
    pub(super) rows: [Line; V],
    /// The tail is the first entry.
    pub(super) tail: [Line; T],
}

impl<const V: usize, const T: usize> ViewVector<V, T> {
    pub(super) const ZERO: Self = Self { rows: [Line::ZERO; V], tail: [Line::ZERO; T] };

    /// Entry `i`, below D.
    pub(super) fn get(&self, i: usize) -> f64 {
        match i.checked_sub(V * WIDTH) {
            None => self.rows[i / WIDTH][i % WIDTH],
            Some(t) => self.tail[t][0],
        }
    }

    /// Entry `i`, below D, to be written.
    pub(super) fn get_mut(&mut self, i: usize) -> &mut f64 {
        match i.checked_sub(V * WIDTH) {
            None => &mut self.rows[i / WIDTH][i % WIDTH],
            Some(t) => &mut self.tail[t][0],
        }
    }
}

/// A D × D block. Of a symmetric one only the lower triangle counts.
#[derive(Clone, Copy, Debug)]
pub(super) struct Block<const D: usize, const V: usize, const T: usize> {
    /// Columns without their tail.
    pub(super) columns: [[Line; V]; D],
    /// Tail rows without their tail.
    pub(super) tails: [[Line; V]; T],
    /// Tail of the tail row, the first entry.
    pub(super) corner: [Line; T],
}

impl<const D: usize, const V: usize, const T: usize> Block<D, V, T> {
    pub(super) const ZERO: Self = Self {
        columns: [[Line::ZERO; V]; D],
        tails: [[Line::ZERO; V]; T],
        corner: [Line::ZERO; T],
    };

    /// Entry (row, column).
    #[inline]
    pub(super) fn get(&self, row: usize, column: usize) -> f64 {
        match (row.checked_sub(V * WIDTH), column.checked_sub(V * WIDTH)) {
            (None, _) => self.columns[column][row / WIDTH][row % WIDTH],
            (Some(t), None) => self.tails[t][column / WIDTH][column % WIDTH],
            (Some(t), Some(_)) => self.corner[t][0],
        }
    }
}
