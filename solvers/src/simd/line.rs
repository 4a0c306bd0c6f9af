//! Rows on cache-line boundaries.
//!
//! A 512-bit access that crosses a line costs two; buffers that kernels read and write again and
//! again are made of [`Line`]s. Nothing here knows what the numbers mean.

use std::ops::{Deref, DerefMut};

use super::{Row, WIDTH};

/// A row that begins on a cache line.
#[repr(C, align(64))]
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(crate) struct Line(pub(crate) Row);

impl Line {
    /// Eight zeros.
    pub(crate) const ZERO: Self = Self([0.0; WIDTH]);
}

impl Deref for Line {
    type Target = Row;

    #[inline(always)]
    fn deref(&self) -> &Row {
        &self.0
    }
}

impl DerefMut for Line {
    #[inline(always)]
    fn deref_mut(&mut self) -> &mut Row {
        &mut self.0
    }
}
