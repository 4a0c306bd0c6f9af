//! The choice between dense and sparse Cholesky, and what each takes.
//!
//! Both are fronts with the same kernels: a dense one is a single front in the caller's order.
//! The choice depends on the pattern only: on its dimension and on the flops of its cheapest order.

use std::sync::Arc;

use super::checked::solve_checked;
use super::error::LinearError;
use super::matrix::BlockMatrix;
use super::ordering::{BlockOrdering, Elimination, cheapest};
use super::pattern::BlockPattern;
use super::sparse::{self, Multifrontal};
use crate::interrupt::Interrupt;
use crate::price::{Ceiling, Price};
use crate::simd::Class;

/// Up to this dimension a system is factored dense without asking for its fill.
const ALWAYS_DENSE: usize = 48;

/// Dense factorization is chosen where it costs at most this many times the sparse flops: it has
/// no indices to follow and keeps the kernels on large blocks.
const DENSE_ADVANTAGE: f64 = 2.0;

/// A Cholesky factorization H + D = L Lᵀ, dense or sparse, planned once and renewed for each set of values.
#[derive(Debug)]
pub struct Cholesky {
    fronts: Multifrontal,
}

impl Cholesky {
    /// Plans for `pattern`, dense or sparse, whichever is estimated faster.
    ///
    /// # Errors
    /// Too large to index, or no memory.
    pub fn new(pattern: Arc<BlockPattern>) -> Result<Self, LinearError> {
        Self::within(pattern, Ceiling::NONE, &Interrupt::NEVER)
    }

    /// The same, unless the factorization passes `ceiling` or planning is interrupted.
    ///
    /// # Errors
    /// As [`Cholesky::new`]; [`LinearError::TooExpensive`], [`LinearError::Interrupted`].
    pub fn within(
        pattern: Arc<BlockPattern>,
        ceiling: Ceiling,
        interrupt: &Interrupt,
    ) -> Result<Self, LinearError> {
        match choose(&pattern, interrupt)? {
            None => {
                // The ordering was made all the same.
                let price = dense_price(pattern.dimension(), pattern.stored_block_count() as u64);
                ceiling.admit(&price.plus_bytes(ordering_bytes(&pattern)))?;
                Self::dense(pattern)
            }
            Some(ordered) => {
                ceiling.admit(&ordered.price())?;
                Self::ordered(pattern, ordered)
            }
        }
    }

    /// Orders `pattern` for a sparse factorization, which [`Cholesky::ordered`] then plans.
    ///
    /// # Errors
    /// [`LinearError::Interrupted`].
    pub fn order(pattern: &BlockPattern, interrupt: &Interrupt) -> Result<Ordered, LinearError> {
        let (ordering, elimination) = cheapest(pattern, interrupt)?;
        Ok(Ordered::new(pattern, ordering, elimination))
    }

    /// Plans a sparse factorization in an order that was made for this pattern.
    ///
    /// # Errors
    /// Too large to index, or no memory.
    pub fn ordered(pattern: Arc<BlockPattern>, ordered: Ordered) -> Result<Self, LinearError> {
        let Ordered { ordering, elimination, .. } = ordered;
        Ok(Self { fronts: Multifrontal::sparse(pattern, &ordering.order, &elimination)? })
    }

    /// Plans a dense factorization.
    ///
    /// # Errors
    /// Too large to index, or no memory.
    pub fn dense(pattern: Arc<BlockPattern>) -> Result<Self, LinearError> {
        Ok(Self { fronts: Multifrontal::dense(pattern)? })
    }

    /// Whether all of it is one front.
    #[must_use]
    pub fn is_dense(&self) -> bool {
        self.fronts.front_count() <= 1
    }

    /// Flops of a factorization, and of the longest chain of its steps that wait for each other. The first over
    /// the second bounds how many times faster many threads can be than one, memory left aside.
    #[must_use]
    pub fn work_and_span(&self) -> (f64, f64) {
        self.fronts.work_and_span()
    }

    /// Uses the kernels of another instruction set, or the scalar ones where the processor lacks it.
    pub fn set_class(&mut self, class: Class) {
        self.fronts.set_class(class);
    }

    /// Factors H + D; `added_diagonal` is D, or empty for zero.
    ///
    /// # Errors
    /// Not positive definite, not finite, or a matrix or diagonal of another shape. After an
    /// error no factor stands.
    pub fn factor(
        &mut self,
        matrix: &BlockMatrix,
        added_diagonal: &[f64],
    ) -> Result<(), LinearError> {
        self.factor_until(matrix, added_diagonal, &Interrupt::NEVER)
    }

    /// The same, ending once `interrupt` is due, as do solves with this factor.
    ///
    /// # Errors
    /// As [`Cholesky::factor`], and [`LinearError::Interrupted`].
    pub fn factor_until(
        &mut self,
        matrix: &BlockMatrix,
        added_diagonal: &[f64],
        interrupt: &Interrupt,
    ) -> Result<(), LinearError> {
        self.fronts.factor_until(matrix, added_diagonal, interrupt)
    }

    /// Solves in place with the last factor; without one, or with a vector of another length,
    /// the result is NaN. So it may be once the interrupt of the factorization is due.
    pub fn solve(&mut self, rhs: &mut [f64]) {
        self.fronts.solve(rhs);
    }

    /// Solves (H + D) x = g, refines once if need be, returns ‖(H + D) x − g‖ / ‖g‖.
    ///
    /// `matrix` and `added_diagonal` are those last factored. The answer is 0 for g = 0, and
    /// infinite where there is no factor, a length is wrong or the solution is not finite.
    pub fn solve_checked(
        &mut self,
        matrix: &BlockMatrix,
        added_diagonal: &[f64],
        rhs: &[f64],
        x: &mut [f64],
    ) -> f64 {
        solve_checked(|v| self.solve(v), matrix, added_diagonal, rhs, x)
    }
}

/// An elimination order with what a factorization in it takes.
#[derive(Debug)]
pub struct Ordered {
    ordering: BlockOrdering,
    elimination: Elimination,
    price: Price,
}

impl Ordered {
    fn new(pattern: &BlockPattern, ordering: BlockOrdering, elimination: Elimination) -> Self {
        let planned = sparse::bytes(pattern, &ordering.order, &elimination);
        // The graph is gone when the factor is planned; the tree and the heights stay.
        let kept = 32 * pattern.block_count() as u64;
        let bytes = planned.max(ordering_bytes(pattern)).saturating_add(kept);
        let price = Price { bytes, flops_per_iteration: ordering.flops };
        Self { ordering, elimination, price }
    }

    /// What the factorization takes, planning included.
    pub fn price(&self) -> Price {
        self.price
    }
}

/// The order of a sparse factorization, or `None` where a dense one is estimated faster.
fn choose(pattern: &BlockPattern, interrupt: &Interrupt) -> Result<Option<Ordered>, LinearError> {
    let dimension = pattern.dimension();
    if dimension <= ALWAYS_DENSE {
        return Ok(None);
    }
    let (ordering, elimination) = cheapest(pattern, interrupt)?;
    let is_sparse = dense_flops(dimension) > DENSE_ADVANTAGE * ordering.flops;
    Ok(is_sparse.then(|| Ordered::new(pattern, ordering, elimination)))
}

/// Flops of a dense factorization: n³/3.
fn dense_flops(dimension: usize) -> f64 {
    (dimension as f64).powi(3) / 3.0
}

/// What a dense factorization of so many scalars takes, of which so many blocks are stored.
pub fn dense_price(dimension: usize, stored_blocks: u64) -> Price {
    let bytes = sparse::dense_bytes(dimension, stored_blocks);
    Price { bytes, flops_per_iteration: dense_flops(dimension) }
}

/// The block graph, its lists while vertices are taken out, and the work of the orderings.
fn ordering_bytes(pattern: &BlockPattern) -> u64 {
    64 * pattern.block_count() as u64 + 40 * pattern.stored_block_count() as u64
}
