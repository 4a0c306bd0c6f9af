//! Dense Cholesky of a block matrix: every block is scattered into one dense lower triangle.
//!
//! H + D = L Lᵀ by faer's blocked, in-place factorization, in the caller's order, on one thread
//! (faer#273: its parallel kernels can corrupt results). Only the lower triangle is touched.
//! Memory is taken once, at planning. Right for nearly full systems; n³/3 flops whatever the fill.

use std::fmt;
use std::sync::Arc;

use faer::dyn_stack::{MemBuffer, MemStack, StackReq};
use faer::linalg::cholesky::llt::factor::{self, LltError, LltRegularization};
use faer::linalg::cholesky::llt::solve;
use faer::linalg::matmul::matmul;
use faer::linalg::triangular_solve::solve_lower_triangular_in_place;
use faer::{Accum, Mat, MatMut, Par};

use super::checked::check_system;
use super::error::LinearError;
use super::matrix::BlockMatrix;
use super::pattern::BlockPattern;
use crate::interrupt::Interrupt;
use crate::price::Price;

/// Systems of at most so many scalars are factored at once whatever may interrupt, in some 20 ms.
const WHOLE: usize = 1024;

/// Columns of a panel of larger ones, and rows that are solved for at a time.
const PANEL: usize = 128;
const STRIP: usize = 2048;
/// Rows of blocks that are copied between two looks at what may interrupt.
const ROWS: usize = 32;

/// A dense factorization, to be renewed for each set of values.
pub struct DenseCholesky {
    pattern: Arc<BlockPattern>,
    factor: Mat<f64>,
    factored: bool,
    memory: MemBuffer,
}

impl fmt::Debug for DenseCholesky {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let dimension = self.pattern.dimension();
        f.debug_struct("DenseCholesky").field("dimension", &dimension).finish_non_exhaustive()
    }
}

/// What faer needs to factor and to solve.
fn workspace(dimension: usize) -> StackReq {
    factor::cholesky_in_place_scratch::<f64>(dimension, Par::Seq, faer::Spec::default())
        .or(solve::solve_in_place_scratch::<f64>(dimension, 1, Par::Seq))
}

impl DenseCholesky {
    /// Takes the memory for systems on `pattern`.
    ///
    /// # Errors
    /// [`LinearError::OutOfMemory`] where the workspace cannot be had.
    pub fn new(pattern: Arc<BlockPattern>) -> Result<Self, LinearError> {
        let dimension = pattern.dimension();
        if dimension.checked_mul(dimension).is_none_or(|n| n > isize::MAX as usize / 8) {
            return Err(LinearError::TooLarge { dimension });
        }
        let Ok(memory) = MemBuffer::try_new(workspace(dimension)) else {
            return Err(LinearError::OutOfMemory { dimension });
        };
        Ok(Self { pattern, factor: Mat::zeros(dimension, dimension), factored: false, memory })
    }

    /// Factors H + D until `interrupt` is due; `added_diagonal` is D, or empty for zero.
    ///
    /// # Errors
    /// Not positive definite, not finite, a matrix or diagonal of another shape, or
    /// [`LinearError::Interrupted`].
    pub fn factor_until(
        &mut self,
        matrix: &BlockMatrix,
        added_diagonal: &[f64],
        interrupt: &Interrupt,
    ) -> Result<(), LinearError> {
        self.factored = false;
        check_system(&self.pattern, matrix, added_diagonal)?;
        self.scatter(matrix, added_diagonal, interrupt)?;
        if let Some(scalar) = self.factor_panels(interrupt)? {
            let block = self.pattern.block_of(scalar);
            return Err(LinearError::NotPositiveDefinite { block, scalar });
        }
        for k in 0..self.pattern.dimension() {
            if !self.factor[(k, k)].is_finite() {
                return Err(LinearError::NonFinite { block: self.pattern.block_of(k) });
            }
        }
        self.factored = true;
        Ok(())
    }

    /// Cholesky in place; the failing pivot, if any. Where something may interrupt it and the whole
    /// would take long, it goes panel by panel, which rounds in another order. Panels depend on the
    /// dimension only: any two deadlines give the same bits.
    fn factor_panels(&mut self, interrupt: &Interrupt) -> Result<Option<usize>, LinearError> {
        let dimension = self.pattern.dimension();
        let at_once = dimension <= WHOLE || interrupt.is_never();
        let panel = if at_once { dimension.max(1) } else { PANEL };
        let stack = MemStack::new(&mut self.memory);
        for first in (0..dimension).step_by(panel) {
            if interrupt.is_due() {
                return Err(LinearError::Interrupted);
            }
            let left = dimension - first;
            let width = panel.min(left);
            let rest = self.factor.as_mut().submatrix_mut(first, first, left, left);
            let (mut pivots, _, mut below, mut trailing) = rest.split_at_mut(width, width);
            let outcome = factor::cholesky_in_place(
                pivots.as_mut(),
                LltRegularization::default(),
                Par::Seq,
                stack,
                faer::Spec::default(),
            );
            if let Err(LltError::NonPositivePivot { index }) = outcome {
                return Ok(Some(first + index));
            }
            let rows = left - width;
            // L₂₁ = A₂₁ L₁₁⁻ᵀ, then A₂₂ −= L₂₁ L₂₁ᵀ below its diagonal, a strip of columns at a time.
            for row in (0..rows).step_by(STRIP) {
                let count = STRIP.min(rows - row);
                let strip = below.as_mut().subrows_mut(row, count);
                let right = strip.transpose_mut();
                solve_lower_triangular_in_place(pivots.as_ref(), right, Par::Seq);
            }
            for column in (0..rows).step_by(panel) {
                if interrupt.is_due() {
                    return Err(LinearError::Interrupted);
                }
                let count = panel.min(rows - column);
                let left = below.as_ref().subrows(column, rows - column);
                let right = below.as_ref().subrows(column, count).transpose();
                let target = trailing.as_mut().submatrix_mut(column, column, rows - column, count);
                matmul(target, Accum::Add, left, right, -1.0, Par::Seq);
            }
        }
        Ok(None)
    }

    /// Fills the lower triangle. The first time its memory comes page by page, which takes a sixth of a
    /// second for 6,000 scalars: it ends where `interrupt` is due.
    fn scatter(
        &mut self,
        matrix: &BlockMatrix,
        added_diagonal: &[f64],
        interrupt: &Interrupt,
    ) -> Result<(), LinearError> {
        let pattern = self.pattern.as_ref();
        let dimension = pattern.dimension();
        for c in 0..dimension {
            if c.is_multiple_of(PANEL) && interrupt.is_due() {
                return Err(LinearError::Interrupted);
            }
            self.factor.col_as_slice_mut(c)[c..].fill(0.0);
        }
        for i in 0..pattern.block_count() {
            let rows = pattern.sizes()[i];
            if rows == 0 {
                continue;
            }
            if i.is_multiple_of(ROWS) && interrupt.is_due() {
                return Err(LinearError::Interrupted);
            }
            let top = pattern.offset(i);
            for (block, &j) in pattern.row_range(i).zip(pattern.row(i)) {
                let values = &matrix.values()[pattern.value_range(block)];
                let left = pattern.offset(j as usize);
                for (c, column) in values.chunks_exact(rows).enumerate() {
                    let target = &mut self.factor.col_as_slice_mut(left + c)[top..top + rows];
                    target.copy_from_slice(column);
                }
            }
        }
        for (k, added) in added_diagonal.iter().enumerate() {
            self.factor[(k, k)] += added;
        }
        Ok(())
    }

    /// Solves in place with the last factor; without one, or with a vector of another length,
    /// the result is NaN.
    pub fn solve(&mut self, rhs: &mut [f64]) {
        let dimension = self.pattern.dimension();
        if !self.factored || rhs.len() != dimension {
            debug_assert_eq!(rhs.len(), dimension, "right-hand side of another length");
            rhs.fill(f64::NAN);
            return;
        }
        solve::solve_in_place(
            self.factor.as_ref(),
            MatMut::from_column_major_slice_mut(rhs, dimension, 1),
            Par::Seq,
            MemStack::new(&mut self.memory),
        );
    }
}

/// Flops of one factorization: n³/3.
pub(super) fn dense_flops(dimension: usize) -> f64 {
    (dimension as f64).powi(3) / 3.0
}

/// What a dense factorization of so many scalars takes.
pub fn dense_price(dimension: usize) -> Price {
    let n = dimension as u64;
    // faer pads columns to whole cache lines; a few vectors of the solve come on top.
    let bytes = n
        .saturating_mul(n.next_multiple_of(16))
        .saturating_mul(8)
        .saturating_add(workspace(dimension).unaligned_bytes_required() as u64)
        .saturating_add(512 * n + (1 << 18));
    Price { bytes, flops_per_iteration: dense_flops(dimension) }
}
