//! Values of a symmetric block matrix on a [`BlockPattern`].
//!
//! Block (i, j), j ≤ i, is dense and column-major: element (r, c) is at r + c·sizes\[i\]. A block
//! row's values are contiguous, so rows can be filled in parallel, each by one owner, and the sums
//! keep one order at any thread count.
//! In a diagonal block only the lower triangle is read (by factorizations and by the product);
//! what stands above it may be anything finite. It orders and factors nothing.

use std::sync::Arc;

use nalgebra::SMatrix;

use super::error::LinearError;
use super::pattern::BlockPattern;

/// A symmetric block matrix, lower triangle stored.
#[derive(Debug, Clone)]
pub struct BlockMatrix {
    pattern: Arc<BlockPattern>,
    values: Vec<f64>,
}

impl BlockMatrix {
    /// The zero matrix on `pattern`.
    pub fn new(pattern: Arc<BlockPattern>) -> Self {
        let values = vec![0.0; pattern.value_count()];
        Self { pattern, values }
    }

    /// Which blocks are stored.
    pub fn pattern(&self) -> &Arc<BlockPattern> {
        &self.pattern
    }

    /// Sets every value to zero.
    pub fn set_zero(&mut self) {
        self.values.fill(0.0);
    }

    /// Adds the blocks of `other` that are stored here too; both have the same block sizes.
    pub fn add(&mut self, other: &Self) {
        for i in 0..other.pattern.block_count() {
            for (block, &j) in other.pattern.row_range(i).zip(other.pattern.row(i)) {
                if let Some(target) = self.block_mut(i, j as usize) {
                    let source = &other.values[other.pattern.value_range(block)];
                    target.iter_mut().zip(source).for_each(|(t, s)| *t += s);
                }
            }
        }
    }

    /// All values, laid out as [`BlockPattern::value_range`] says.
    pub fn values(&self) -> &[f64] {
        &self.values
    }

    /// All values, to be filled through ranges looked up beforehand.
    pub fn values_mut(&mut self) -> &mut [f64] {
        &mut self.values
    }

    /// Block (i, j), column-major, or `None` where it is not stored or j > i.
    pub fn block(&self, i: usize, j: usize) -> Option<&[f64]> {
        self.pattern.find(i, j).map(|block| &self.values[self.pattern.value_range(block)])
    }

    /// Block (i, j), column-major, or `None` where it is not stored or j > i.
    pub fn block_mut(&mut self, i: usize, j: usize) -> Option<&mut [f64]> {
        self.pattern.find(i, j).map(|block| &mut self.values[self.pattern.value_range(block)])
    }

    /// Adds to block (i, j) of the symmetric matrix, of either triangle, where it is stored; where i and
    /// j are one, `block` is the whole of it.
    pub fn add_block<const D: usize>(&mut self, i: usize, j: usize, block: &SMatrix<f64, D, D>) {
        let block = if i < j { block.transpose() } else { *block };
        if let Some(values) = self.block_mut(i.max(j), i.min(j)) {
            values.iter_mut().zip(block.as_slice()).for_each(|(value, added)| *value += added);
        }
    }

    /// The block rows, one writer each, first row first.
    pub fn rows_mut(&mut self) -> Vec<BlockRowMut<'_>> {
        let pattern = self.pattern.as_ref();
        let mut rest = self.values.as_mut_slice();
        (0..pattern.block_count())
            .map(|i| {
                let range = pattern.row_range(i);
                let starts = &pattern.value_starts()[range.start..=range.end];
                let length = starts[starts.len() - 1] - starts[0];
                let (values, tail) = std::mem::take(&mut rest).split_at_mut(length);
                rest = tail;
                BlockRowMut { index: i, columns: pattern.row(i), starts, values }
            })
            .collect()
    }

    /// The scalar diagonal, `dimension()` long.
    pub fn diagonal(&self) -> Vec<f64> {
        let mut diagonal = Vec::with_capacity(self.pattern.dimension());
        for (i, &size) in self.pattern.sizes().iter().enumerate() {
            let start = self.pattern.value_range(self.pattern.row_range(i).end - 1).start;
            diagonal.extend((0..size).map(|k| self.values[start + k * (size + 1)]));
        }
        diagonal
    }

    /// y = H x; both slices are `dimension()` long, else `y` becomes NaN.
    pub fn symmetric_multiply(&self, x: &[f64], y: &mut [f64]) {
        let pattern = self.pattern.as_ref();
        if x.len() != pattern.dimension() || y.len() != pattern.dimension() {
            debug_assert!(false, "vectors of {} and {} scalars", x.len(), y.len());
            y.fill(f64::NAN);
            return;
        }
        y.fill(0.0);
        for i in 0..pattern.block_count() {
            let rows = pattern.sizes()[i];
            let top = pattern.offset(i);
            if rows == 0 {
                continue;
            }
            for (block, &j) in pattern.row_range(i).zip(pattern.row(i)) {
                let values = &self.values[pattern.value_range(block)];
                let j = j as usize;
                if j == i {
                    multiply_diagonal(values, &x[top..top + rows], &mut y[top..top + rows]);
                    continue;
                }
                // j < i, so the two pieces of y do not overlap.
                let left = pattern.offset(j);
                let (head, tail) = y.split_at_mut(top);
                let (x_i, y_i) = (&x[top..top + rows], &mut tail[..rows]);
                for (c, column) in values.chunks_exact(rows).enumerate() {
                    let x_c = x[left + c];
                    let mut dot = 0.0;
                    for r in 0..rows {
                        y_i[r] += column[r] * x_c;
                        dot += column[r] * x_i[r];
                    }
                    head[left + c] += dot;
                }
            }
        }
    }

    /// r = g − (H + D) x; `added_diagonal` is D, or empty for zero.
    ///
    /// # Errors
    /// [`LinearError::DimensionMismatch`] where a vector has the wrong length.
    pub fn residual(
        &self,
        added_diagonal: &[f64],
        x: &[f64],
        g: &[f64],
        r: &mut [f64],
    ) -> Result<(), LinearError> {
        let expected = self.pattern.dimension();
        check_added_diagonal(expected, added_diagonal)?;
        for found in [x.len(), g.len(), r.len()] {
            if found != expected {
                return Err(LinearError::DimensionMismatch { expected, found });
            }
        }
        self.symmetric_multiply(x, r);
        for (k, r) in r.iter_mut().enumerate() {
            let damped = added_diagonal.get(k).map_or(0.0, |d| d * x[k]);
            *r = g[k] - (*r + damped);
        }
        Ok(())
    }
}

/// y += A x for a diagonal block of which only the lower triangle is read.
fn multiply_diagonal(values: &[f64], x: &[f64], y: &mut [f64]) {
    let size = x.len();
    for (c, column) in values.chunks_exact(size).enumerate() {
        let mut dot = column[c] * x[c];
        for r in c + 1..size {
            y[r] += column[r] * x[c];
            dot += column[r] * x[r];
        }
        y[c] += dot;
    }
}

/// Refuses an added diagonal that is neither empty nor `dimension` long.
pub(super) fn check_added_diagonal(
    dimension: usize,
    added_diagonal: &[f64],
) -> Result<(), LinearError> {
    let found = added_diagonal.len();
    if found == 0 || found == dimension {
        return Ok(());
    }
    Err(LinearError::DimensionMismatch { expected: dimension, found })
}

/// One block row of a matrix, for its one writer.
#[derive(Debug)]
pub struct BlockRowMut<'a> {
    index: usize,
    columns: &'a [u32],
    /// Value starts in the whole matrix, one past the last included.
    starts: &'a [usize],
    values: &'a mut [f64],
}

impl BlockRowMut<'_> {
    /// Which block row this is.
    pub fn index(&self) -> usize {
        self.index
    }

    /// Columns of the stored blocks, ascending; the last is the row itself.
    #[cfg(test)]
    pub(super) fn columns(&self) -> &[u32] {
        self.columns
    }

    /// The `k`-th stored block in the order of columns, column-major.
    ///
    /// # Panics
    /// Where fewer blocks are stored.
    #[inline]
    pub fn slot_mut(&mut self, k: usize) -> &mut [f64] {
        let base = self.starts[0];
        &mut self.values[self.starts[k] - base..self.starts[k + 1] - base]
    }

    /// The diagonal block, column-major; only its lower triangle is ever read.
    pub fn diagonal_mut(&mut self) -> &mut [f64] {
        self.slot_mut(self.columns.len() - 1)
    }

    /// All values of the row, block after block.
    pub fn values_mut(&mut self) -> &mut [f64] {
        self.values
    }
}
