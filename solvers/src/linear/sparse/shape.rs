//! Measures of a front, in scalars: its panel (the pivot columns) and its update matrix (the rest);
//! and memory for them. Columns of both begin on whole vectors. It knows neither blocks nor values.

use crate::simd::WIDTH;

/// Measures of a front.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Shape {
    pub(super) pivots: usize,
    /// Pivots and rows below them.
    pub(super) rows: usize,
    /// From one column of the panel to the next.
    pub(super) stride: usize,
}

impl Shape {
    /// A front of so many pivots and rows, and `more` rows under all of them.
    pub(super) fn new(pivots: usize, rows: usize, more: usize) -> Self {
        let mut stride = (rows + more).next_multiple_of(WIDTH);
        // A stride of many whole pages would put all columns into the same cache sets.
        if stride.is_multiple_of(64) && stride >= 128 {
            stride += WIDTH;
        }
        Self { pivots, rows, stride }
    }

    /// The front's row that stands first in the update matrix: whole vectors of pivots are left out.
    pub(super) fn update_row(&self) -> usize {
        self.pivots & !(WIDTH - 1)
    }

    /// From one column of the update matrix to the next.
    pub(super) fn update_stride(&self) -> usize {
        self.stride - self.update_row()
    }

    /// Elements of the panel.
    pub(super) fn panel_size(&self) -> usize {
        self.stride * self.pivots
    }

    /// Elements of the update matrix.
    pub(super) fn update_size(&self) -> usize {
        self.update_stride() * (self.rows - self.pivots)
    }

    /// Flops of the front.
    pub(super) fn flops(&self) -> f64 {
        let (k, m) = (self.pivots as f64, (self.rows - self.pivots) as f64);
        k * (k * k / 3.0 + k * m + m * m)
    }
}

/// Numbers, zero at first, that begin on a cache line as long as they are not moved to another
/// allocation.
#[derive(Debug)]
pub(super) struct Aligned {
    values: Box<[f64]>,
    skipped: usize,
    length: usize,
}

impl Aligned {
    /// `None` where there is no memory.
    pub(super) fn new(length: usize) -> Option<Self> {
        let whole = length.checked_add(WIDTH)?;
        // Unlike a vector that is filled, this gets its pages as they are used, by the threads that use
        // them, and it never asks twice: an allocator that gives the same memory again has to clear it.
        let values = bytemuck::try_zeroed_slice_box::<f64>(whole).ok()?;
        let skipped = values.as_ptr().align_offset(size_of::<f64>() * WIDTH).min(WIDTH);
        Some(Self { values, skipped, length })
    }

    pub(super) fn len(&self) -> usize {
        self.length
    }

    pub(super) fn slice(&self) -> &[f64] {
        &self.values[self.skipped..self.skipped + self.length]
    }

    pub(super) fn slice_mut(&mut self) -> &mut [f64] {
        &mut self.values[self.skipped..self.skipped + self.length]
    }
}
