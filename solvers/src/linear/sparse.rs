//! Sparse supernodal Cholesky of a block matrix in a fill-reducing order.
//!
//! P (H + D) Pᵀ = L Lᵀ, with P from the block graph ([`super::ordering`]) expanded to scalars.
//! faer does the symbolic and numeric work: always its supernodal form, since blocks make
//! supernodes at least as wide as themselves (its automatic choice is simplicial at sizes where
//! supernodal is four times faster), and always on one thread. Planning takes all memory and
//! a scatter map from blocks to compressed columns; factoring and solving take none.

use std::fmt;
use std::sync::Arc;

use faer::dyn_stack::{MemBuffer, MemStack};
use faer::linalg::cholesky::llt::factor::{LltError as PivotError, LltRegularization};
use faer::sparse::linalg::SymbolicSupernodalParams;
use faer::sparse::linalg::cholesky::supernodal::{
    self, SupernodalLltRef, SymbolicSupernodalCholesky,
};
use faer::sparse::{FaerError, SparseColMatRef, SymbolicSparseColMat};
use faer::{Conj, MatMut, Par};

use super::cholesky::{check_finite, check_pattern, not_positive_definite, solve_checked};
use super::error::LinearError;
use super::matrix::{BlockMatrix, check_added_diagonal};
use super::ordering::{BlockOrdering, cheapest_ordering, inverse_permutation};
use super::pattern::BlockPattern;

mod plan;

use plan::{Placement, Plan};

/// A sparse factorization, planned once and renewed for each set of values.
pub struct SparseCholesky {
    pattern: Arc<BlockPattern>,
    ordering: BlockOrdering,
    /// `scalars[k]` is the caller's scalar row that is eliminated k-th.
    scalars: Vec<u32>,
    /// Where each stored block goes among `values`.
    placements: Vec<Placement>,
    /// Where each of the caller's diagonal scalars stands among `values`.
    diagonal: Vec<usize>,
    columns: SymbolicSparseColMat<u32>,
    values: Vec<f64>,
    symbolic: SymbolicSupernodalCholesky<u32>,
    factor: Vec<f64>,
    factored: bool,
    /// A permuted right-hand side.
    permuted: Vec<f64>,
    memory: MemBuffer,
}

impl fmt::Debug for SparseCholesky {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("SparseCholesky")
            .field("dimension", &self.pattern.dimension())
            .field("method", &self.ordering.method)
            .field("flops", &self.ordering.flops)
            .field("factored", &self.factored)
            .finish_non_exhaustive()
    }
}

impl SparseCholesky {
    /// Orders `pattern` by the cheapest candidate and plans for it.
    ///
    /// # Errors
    /// Too large for 32-bit indices, or no memory.
    pub fn new(pattern: Arc<BlockPattern>) -> Result<Self, LinearError> {
        let ordering = cheapest_ordering(&pattern);
        Self::with_ordering(pattern, ordering)
    }

    /// Plans for `pattern` in a given order.
    ///
    /// # Errors
    /// Too large for 32-bit indices, or no memory; [`LinearError::PatternMismatch`] where the
    /// order is not a permutation of the pattern's blocks.
    pub fn with_ordering(
        pattern: Arc<BlockPattern>,
        ordering: BlockOrdering,
    ) -> Result<Self, LinearError> {
        let dimension = pattern.dimension();
        let expected = pattern.block_count();
        let Some(position) = inverse_permutation(&ordering.order, expected) else {
            return Err(LinearError::PatternMismatch { expected, found: ordering.order.len() });
        };
        // faer counts entries in 31 bits; ours are at most those of the factor.
        let limit = i32::MAX as usize;
        if pattern.value_count() > limit / 2 || ordering.factor_entries > limit as f64 {
            return Err(LinearError::TooLarge { dimension });
        }
        let Plan { scalars, placements, diagonal, columns, symbolic } =
            Plan::new(&pattern, &ordering.order, &position).map_err(|error| {
                if error == FaerError::OutOfMemory {
                    LinearError::OutOfMemory { dimension }
                } else {
                    LinearError::TooLarge { dimension }
                }
            })?;
        let scratch = supernodal::factorize_supernodal_numeric_llt_scratch::<u32, f64>(
            &symbolic,
            Par::Seq,
            faer::Spec::default(),
        )
        .or(symbolic.solve_in_place_scratch::<f64>(1, Par::Seq));
        let Ok(memory) = MemBuffer::try_new(scratch) else {
            return Err(LinearError::OutOfMemory { dimension });
        };
        let mut factor = Vec::new();
        if factor.try_reserve_exact(symbolic.len_val()).is_err() {
            return Err(LinearError::OutOfMemory { dimension });
        }
        factor.resize(symbolic.len_val(), 0.0);
        let values = vec![0.0; columns.row_idx().len()];
        let permuted = vec![0.0; dimension];
        Ok(Self {
            pattern,
            ordering,
            scalars,
            placements,
            diagonal,
            columns,
            values,
            symbolic,
            factor,
            factored: false,
            permuted,
            memory,
        })
    }

    /// Factors H + D; `added_diagonal` is D, or empty for zero.
    ///
    /// # Errors
    /// Not positive definite, not finite, or a matrix or diagonal of another shape.
    pub fn factor(
        &mut self,
        matrix: &BlockMatrix,
        added_diagonal: &[f64],
    ) -> Result<(), LinearError> {
        self.factored = false;
        check_pattern(&self.pattern, matrix)?;
        check_added_diagonal(self.pattern.dimension(), added_diagonal)?;
        check_finite(matrix, added_diagonal)?;
        self.scatter(matrix);
        for (&place, added) in self.diagonal.iter().zip(added_diagonal) {
            self.values[place] += added;
        }
        let outcome = supernodal::factorize_supernodal_numeric_llt(
            &mut self.factor,
            SparseColMatRef::new(self.columns.as_ref(), &self.values),
            LltRegularization::default(),
            &self.symbolic,
            Par::Seq,
            MemStack::new(&mut self.memory),
            faer::Spec::default(),
        );
        let failing = match outcome {
            Ok(_) => self.first_bad_pivot(),
            Err(PivotError::NonPositivePivot { index }) => {
                let scalar = self.scalars[index] as usize;
                return Err(not_positive_definite(&self.pattern, scalar));
            }
        };
        if let Some(k) = failing {
            let block = self.pattern.block_of(self.scalars[k] as usize);
            return Err(LinearError::NonFinite { block });
        }
        self.factored = true;
        Ok(())
    }

    /// The first column of the factor whose diagonal is not finite, in elimination order.
    fn first_bad_pivot(&self) -> Option<usize> {
        let factor = SupernodalLltRef::new(&self.symbolic, &self.factor);
        (0..self.symbolic.n_supernodes()).find_map(|s| {
            let node = factor.supernode(s);
            let values = node.val();
            (0..values.ncols()).find(|&k| !values[(k, k)].is_finite()).map(|k| node.start() + k)
        })
    }

    fn scatter(&mut self, matrix: &BlockMatrix) {
        let pattern = self.pattern.as_ref();
        for i in 0..pattern.block_count() {
            let rows = pattern.sizes()[i];
            if rows == 0 {
                continue;
            }
            for block in pattern.row_range(i) {
                let source = &matrix.values()[pattern.value_range(block)];
                let Placement { start, stride, transposed } = self.placements[block];
                for (c, column) in source.chunks_exact(rows).enumerate() {
                    if transposed {
                        for (r, value) in column.iter().enumerate() {
                            self.values[start + c + r * stride] = *value;
                        }
                    } else {
                        let target = start + c * stride;
                        self.values[target..target + rows].copy_from_slice(column);
                    }
                }
            }
        }
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
        for (value, &scalar) in self.permuted.iter_mut().zip(&self.scalars) {
            *value = rhs[scalar as usize];
        }
        SupernodalLltRef::new(&self.symbolic, &self.factor).solve_in_place_with_conj(
            Conj::No,
            MatMut::from_column_major_slice_mut(&mut self.permuted, dimension, 1),
            Par::Seq,
            MemStack::new(&mut self.memory),
        );
        for (value, &scalar) in self.permuted.iter().zip(&self.scalars) {
            rhs[scalar as usize] = *value;
        }
    }

    /// Solves, measures the residual, refines once if need be; see [`super::Cholesky::solve_checked`].
    pub fn solve_checked(
        &mut self,
        matrix: &BlockMatrix,
        added_diagonal: &[f64],
        rhs: &[f64],
        x: &mut [f64],
    ) -> f64 {
        solve_checked(|v| self.solve(v), matrix, added_diagonal, rhs, x)
    }

    /// Flops of one factorization, estimated from the block structure.
    pub fn factor_flops(&self) -> f64 {
        self.ordering.flops
    }

    /// The elimination order in use.
    pub fn ordering(&self) -> &BlockOrdering {
        &self.ordering
    }

    /// The pattern planned for.
    pub fn pattern(&self) -> &Arc<BlockPattern> {
        &self.pattern
    }
}
