//! Sparse supernodal Cholesky of a block matrix in a fill-reducing order.
//!
//! P (H + D) Pᵀ = L Lᵀ, with P from the block graph ([`super::ordering`]). Planning joins columns to
//! supernodes, lays out the factor and takes all memory; factoring (multifrontal, in parallel over
//! the elimination tree on the rayon pool of the caller) and solving take none. Kernels are compiled for each
//! instruction set; the classes with fused multiply-add give the same bits, and so does any number
//! of threads.

use std::fmt;
use std::sync::Arc;

use super::cholesky::{check_finite, check_pattern, not_positive_definite, solve_checked};
use super::error::LinearError;
use super::matrix::{BlockMatrix, check_added_diagonal};
use super::ordering::{BlockOrdering, Elimination, cheapest, postordered};
use super::pattern::BlockPattern;
use crate::interrupt::Interrupt;
use crate::simd::{Class, WIDTH};

mod branch;
mod columns;
mod front;
mod growing;
mod kernels;
mod numeric;
mod plan;
mod shape;
mod size;
mod supernodes;
mod sweep;
mod triangular;

pub use growing::{GrowingCholesky, PairTerm, Updated};
use numeric::Numeric;
use plan::Plan;
pub(super) use size::bytes;
use triangular::Triangular;

/// A sparse factorization, planned once and renewed for each set of values.
pub struct SparseCholesky {
    pattern: Arc<BlockPattern>,
    ordering: BlockOrdering,
    plan: Plan,
    factor: Aligned,
    /// Update matrices.
    space: Aligned,
    /// A permuted right-hand side.
    permuted: Aligned,
    /// One column of a front.
    front: Aligned,
    class: Class,
    factored: bool,
    /// Of the last factorization.
    interrupt: Interrupt,
}

impl fmt::Debug for SparseCholesky {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("SparseCholesky")
            .field("dimension", &self.pattern.dimension())
            .field("method", &self.ordering.method)
            .field("flops", &self.ordering.flops)
            .field("supernodes", &self.plan.nodes.len())
            .field("factored", &self.factored)
            .finish_non_exhaustive()
    }
}

impl SparseCholesky {
    /// Orders `pattern` by the cheapest candidate and plans for it.
    ///
    /// # Errors
    /// Too large to index, or no memory.
    pub fn new(pattern: Arc<BlockPattern>) -> Result<Self, LinearError> {
        let (ordering, elimination) = cheapest(&pattern, &Interrupt::NEVER)?;
        Self::planned(pattern, ordering, &elimination)
    }

    /// Plans for `pattern` in a given order.
    ///
    /// # Errors
    /// Too large to index, or no memory; [`LinearError::PatternMismatch`] where the order is not a
    /// permutation of the pattern's blocks.
    pub fn with_ordering(
        pattern: Arc<BlockPattern>,
        ordering: BlockOrdering,
    ) -> Result<Self, LinearError> {
        let Some((order, elimination)) = postordered(&pattern, &ordering.order) else {
            let (expected, found) = (pattern.block_count(), ordering.order.len());
            return Err(LinearError::PatternMismatch { expected, found });
        };
        Self::planned(pattern, BlockOrdering { order, ..ordering }, &elimination)
    }

    /// Plans for a postordered order with its elimination.
    pub(super) fn planned(
        pattern: Arc<BlockPattern>,
        ordering: BlockOrdering,
        elimination: &Elimination,
    ) -> Result<Self, LinearError> {
        let dimension = pattern.dimension();
        let plan = Plan::new(&pattern, &ordering.order, elimination)?;
        let memory = |length| Aligned::new(length).ok_or(LinearError::OutOfMemory { dimension });
        Ok(Self {
            factor: memory(plan.factor_size)?,
            space: memory(plan.space)?,
            permuted: memory(dimension)?,
            front: memory(plan.longest)?,
            class: Class::detect(),
            factored: false,
            interrupt: Interrupt::NEVER,
            pattern,
            ordering,
            plan,
        })
    }

    /// Uses the kernels of another instruction set, or the scalar ones where the processor lacks it.
    pub fn set_class(&mut self, class: Class) {
        self.class = class;
        self.factored = false;
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
        self.factor_until(matrix, added_diagonal, &Interrupt::NEVER)
    }

    /// The same, ending once `interrupt` is due, as do the solves with this factor.
    ///
    /// # Errors
    /// As [`SparseCholesky::factor`], and [`LinearError::Interrupted`].
    pub fn factor_until(
        &mut self,
        matrix: &BlockMatrix,
        added_diagonal: &[f64],
        interrupt: &Interrupt,
    ) -> Result<(), LinearError> {
        self.factored = false;
        check_pattern(&self.pattern, matrix)?;
        check_added_diagonal(self.pattern.dimension(), added_diagonal)?;
        check_finite(matrix, added_diagonal)?;
        let (plan, values) = (&self.plan, matrix.values());
        let numeric = Numeric {
            plan,
            values,
            added: added_diagonal,
            class: self.class,
            interrupt,
            is_parallel: rayon::current_num_threads() > 1,
        };
        let outcome = numeric.run(self.factor.slice_mut(), self.space.slice_mut());
        if interrupt.is_due() {
            return Err(LinearError::Interrupted);
        }
        outcome.map_err(|bad| {
            let scalar = self.plan.scalars[bad.column] as usize;
            if bad.is_finite {
                not_positive_definite(&self.pattern, scalar)
            } else {
                LinearError::NonFinite { block: self.pattern.block_of(scalar) }
            }
        })?;
        self.factored = true;
        self.interrupt = interrupt.clone();
        Ok(())
    }

    /// Solves in place with the last factor; without one, or with a vector of another length,
    /// the result is NaN. So it may be once the interrupt of the factorization is due.
    pub fn solve(&mut self, rhs: &mut [f64]) {
        let dimension = self.pattern.dimension();
        if !self.factored || rhs.len() != dimension {
            debug_assert_eq!(rhs.len(), dimension, "right-hand side of another length");
            rhs.fill(f64::NAN);
            return;
        }
        let permuted = self.permuted.slice_mut();
        for (value, &scalar) in permuted.iter_mut().zip(&self.plan.scalars) {
            *value = rhs[scalar as usize];
        }
        self.class.run(Triangular {
            plan: &self.plan,
            factor: self.factor.slice(),
            x: permuted,
            front: self.front.slice_mut(),
            interrupt: &self.interrupt,
        });
        if self.interrupt.is_due() {
            rhs.fill(f64::NAN);
            return;
        }
        for (value, &scalar) in permuted.iter().zip(&self.plan.scalars) {
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

    /// The elimination order chosen, before columns of joined supernodes were put side by side.
    pub fn ordering(&self) -> &BlockOrdering {
        &self.ordering
    }

    /// The pattern planned for.
    pub fn pattern(&self) -> &Arc<BlockPattern> {
        &self.pattern
    }
}

/// Numbers, zero at first, that begin on a cache line as long as they are not moved to another
/// allocation.
#[derive(Debug)]
struct Aligned {
    values: Vec<f64>,
    skipped: usize,
    length: usize,
}

impl Aligned {
    /// `None` where there is no memory.
    fn new(length: usize) -> Option<Self> {
        let whole = length.checked_add(WIDTH)?;
        // Asked for and given back: unlike a vector filled here, one made of zeros gets its pages
        // from the system as they are used, by the threads that use them.
        Vec::<f64>::new().try_reserve_exact(whole).ok()?;
        let values = vec![0.0; whole];
        let skipped = values.as_ptr().align_offset(size_of::<f64>() * WIDTH).min(WIDTH);
        Some(Self { values, skipped, length })
    }

    fn len(&self) -> usize {
        self.length
    }

    fn slice(&self) -> &[f64] {
        &self.values[self.skipped..self.skipped + self.length]
    }

    fn slice_mut(&mut self) -> &mut [f64] {
        &mut self.values[self.skipped..self.skipped + self.length]
    }
}
