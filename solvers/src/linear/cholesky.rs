//! The choice between dense and sparse Cholesky, and the checked solve that both share.
//!
//! A checked solve measures ‖(H + D) x − g‖ / ‖g‖ with the matrix itself, not with the factor, so
//! that a wrong kernel or a hopeless condition is seen; one step of iterative refinement
//! (x ← x + L⁻ᵀL⁻¹ r) follows where the residual is above 1e-10.

use std::sync::Arc;

use super::dense::DenseCholesky;
use super::error::LinearError;
use super::matrix::BlockMatrix;
use super::ordering::{BlockOrdering, Elimination, cheapest};
use super::pattern::BlockPattern;
use super::sparse::{self, SparseCholesky};
use crate::interrupt::Interrupt;
use crate::price::{Ceiling, Price};

/// Relative residual above which a solution is refined once.
const REFINE_ABOVE: f64 = 1e-10;

/// Up to this dimension a system is factored dense without asking for its fill.
const ALWAYS_DENSE: usize = 48;

/// Dense factorization is chosen where it costs at most this many times the sparse flops: it has
/// no indices to follow and keeps the kernels on large blocks.
const DENSE_ADVANTAGE: f64 = 2.0;

/// A Cholesky factorization, dense or sparse.
#[derive(Debug)]
pub enum Cholesky {
    /// One dense lower triangle in the caller's order.
    Dense(DenseCholesky),
    /// Supernodal, in a fill-reducing order.
    Sparse(Box<SparseCholesky>),
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
        let choice = choose(&pattern, interrupt)?;
        ceiling.admit(&choice.price(&pattern))?;
        match choice {
            Choice::Dense => Self::dense(pattern),
            Choice::Sparse(ordering, elimination) => {
                let sparse = SparseCholesky::planned(pattern, ordering, &elimination)?;
                Ok(Self::Sparse(Box::new(sparse)))
            }
        }
    }

    /// What [`Cholesky::new`] would allocate, planning included, and the flops of one factorization.
    /// Time and memory of this are nearly linear in the pattern.
    ///
    /// # Errors
    /// [`LinearError::Interrupted`].
    pub fn price(pattern: &BlockPattern, interrupt: &Interrupt) -> Result<Price, LinearError> {
        Ok(choose(pattern, interrupt)?.price(pattern))
    }

    /// Orders `pattern` for a sparse factorization, which [`Cholesky::ordered`] then plans.
    ///
    /// # Errors
    /// [`LinearError::Interrupted`].
    pub fn order(pattern: &BlockPattern, interrupt: &Interrupt) -> Result<Ordered, LinearError> {
        let (ordering, elimination) = cheapest(pattern, interrupt)?;
        let price = sparse_price(pattern, &ordering, &elimination);
        Ok(Ordered { ordering, elimination, price })
    }

    /// Plans a sparse factorization in an order that was made for this pattern.
    ///
    /// # Errors
    /// As [`SparseCholesky::new`].
    pub fn ordered(pattern: Arc<BlockPattern>, ordered: Ordered) -> Result<Self, LinearError> {
        let Ordered { ordering, elimination, .. } = ordered;
        let sparse = SparseCholesky::planned(pattern, ordering, &elimination)?;
        Ok(Self::Sparse(Box::new(sparse)))
    }

    /// Plans a dense factorization.
    ///
    /// # Errors
    /// As [`DenseCholesky::new`].
    pub fn dense(pattern: Arc<BlockPattern>) -> Result<Self, LinearError> {
        Ok(Self::Dense(DenseCholesky::new(pattern)?))
    }

    /// Plans a sparse factorization.
    ///
    /// # Errors
    /// As [`SparseCholesky::new`].
    pub fn sparse(pattern: Arc<BlockPattern>) -> Result<Self, LinearError> {
        Ok(Self::Sparse(Box::new(SparseCholesky::new(pattern)?)))
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

    /// The same, ending once `interrupt` is due, as do solves with a sparse factor.
    ///
    /// # Errors
    /// As [`Cholesky::factor`], and [`LinearError::Interrupted`].
    pub fn factor_until(
        &mut self,
        matrix: &BlockMatrix,
        added_diagonal: &[f64],
        interrupt: &Interrupt,
    ) -> Result<(), LinearError> {
        match self {
            Self::Dense(dense) => dense.factor_until(matrix, added_diagonal, interrupt),
            Self::Sparse(sparse) => sparse.factor_until(matrix, added_diagonal, interrupt),
        }
    }

    /// Solves in place with the last factor; without one, or with a vector of another length,
    /// the result is NaN.
    pub fn solve(&mut self, rhs: &mut [f64]) {
        match self {
            Self::Dense(dense) => dense.solve(rhs),
            Self::Sparse(sparse) => sparse.solve(rhs),
        }
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

    /// Flops of one factorization, estimated from the structure.
    pub fn factor_flops(&self) -> f64 {
        match self {
            Self::Dense(dense) => dense.factor_flops(),
            Self::Sparse(sparse) => sparse.factor_flops(),
        }
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
    /// What the factorization takes, planning included.
    pub fn price(&self) -> Price {
        self.price
    }
}

/// Which factorization suits a pattern.
enum Choice {
    Dense,
    Sparse(BlockOrdering, Elimination),
}

fn choose(pattern: &BlockPattern, interrupt: &Interrupt) -> Result<Choice, LinearError> {
    let dimension = pattern.dimension();
    if dimension <= ALWAYS_DENSE {
        return Ok(Choice::Dense);
    }
    let (ordering, elimination) = cheapest(pattern, interrupt)?;
    if dense_flops(dimension) <= DENSE_ADVANTAGE * ordering.flops {
        return Ok(Choice::Dense);
    }
    Ok(Choice::Sparse(ordering, elimination))
}

impl Choice {
    fn price(&self, pattern: &BlockPattern) -> Price {
        match self {
            // The ordering was made all the same.
            Self::Dense => dense_price(pattern.dimension()).plus_bytes(ordering_bytes(pattern)),
            Self::Sparse(ordering, elimination) => sparse_price(pattern, ordering, elimination),
        }
    }
}

fn dense_flops(dimension: usize) -> f64 {
    (dimension as f64).powi(3) / 3.0
}

/// What a dense factorization of so many scalars takes.
pub fn dense_price(dimension: usize) -> Price {
    let bytes = DenseCholesky::bytes(dimension);
    Price { bytes, flops_per_iteration: dense_flops(dimension) }
}

fn sparse_price(
    pattern: &BlockPattern,
    ordering: &BlockOrdering,
    elimination: &Elimination,
) -> Price {
    let planned = sparse::bytes(pattern, &ordering.order, elimination);
    // The graph is gone when the factor is planned.
    let bytes = planned.max(ordering_bytes(pattern)).saturating_add(elimination_bytes(pattern));
    Price { bytes, flops_per_iteration: ordering.flops }
}

/// The block graph, its lists while vertices are taken out, and the work of the orderings.
fn ordering_bytes(pattern: &BlockPattern) -> u64 {
    64 * pattern.block_count() as u64 + 40 * pattern.stored_block_count() as u64
}

/// The tree and the heights of the order that is kept.
fn elimination_bytes(pattern: &BlockPattern) -> u64 {
    32 * pattern.block_count() as u64
}

/// The checked solve over any `solve`; see [`Cholesky::solve_checked`].
pub(super) fn solve_checked(
    mut solve: impl FnMut(&mut [f64]),
    matrix: &BlockMatrix,
    added_diagonal: &[f64],
    rhs: &[f64],
    x: &mut [f64],
) -> f64 {
    if x.len() != rhs.len() || rhs.len() != matrix.pattern().dimension() {
        x.fill(f64::NAN);
        return f64::INFINITY;
    }
    x.copy_from_slice(rhs);
    solve(x);
    let mut residual = vec![0.0; rhs.len()];
    let before = relative_residual(matrix, added_diagonal, rhs, x, &mut residual);
    if before <= REFINE_ABOVE || !before.is_finite() {
        return before;
    }
    solve(&mut residual);
    let refined: Vec<f64> = x.iter().zip(&residual).map(|(x, dx)| x + dx).collect();
    let after = relative_residual(matrix, added_diagonal, rhs, &refined, &mut residual);
    if after < before {
        x.copy_from_slice(&refined);
    }
    after.min(before)
}

/// ‖g − (H + D) x‖ / ‖g‖, infinite rather than NaN; `r` receives the residual.
fn relative_residual(
    matrix: &BlockMatrix,
    added_diagonal: &[f64],
    g: &[f64],
    x: &[f64],
    r: &mut [f64],
) -> f64 {
    if matrix.residual(added_diagonal, x, g, r).is_err() {
        return f64::INFINITY;
    }
    let norm = |v: &[f64]| {
        let scale = v.iter().fold(0.0f64, |m, x| m.max(x.abs()));
        let scale = if scale > 0.0 { scale } else { 1.0 };
        scale * v.iter().map(|x| (x / scale).powi(2)).sum::<f64>().sqrt()
    };
    let (r, g) = (norm(r), norm(g));
    let relative = if g > 0.0 { r / g } else { r };
    if relative.is_nan() { f64::INFINITY } else { relative }
}

/// Refuses a matrix that is not on the pattern planned for.
pub(super) fn check_pattern(
    planned: &Arc<BlockPattern>,
    matrix: &BlockMatrix,
) -> Result<(), LinearError> {
    let given = matrix.pattern();
    if Arc::ptr_eq(planned, given) || **planned == **given {
        return Ok(());
    }
    let (expected, found) = (planned.stored_block_count(), given.stored_block_count());
    Err(LinearError::PatternMismatch { expected, found })
}

/// Refuses NaN and infinity, which the kernels would spread silently.
pub(super) fn check_finite(
    matrix: &BlockMatrix,
    added_diagonal: &[f64],
) -> Result<(), LinearError> {
    let pattern = matrix.pattern();
    // Chunks without an early exit inside, so that the scan is vectorized.
    let finite = |values: &[f64]| {
        values.chunks(256).all(|chunk| chunk.iter().fold(true, |ok, v| ok & v.is_finite()))
    };
    if !finite(matrix.values()) {
        for i in 0..pattern.block_count() {
            for block in pattern.row_range(i) {
                if !finite(&matrix.values()[pattern.value_range(block)]) {
                    return Err(LinearError::NonFinite { block: i });
                }
            }
        }
    }
    match added_diagonal.iter().position(|d| !d.is_finite()) {
        Some(scalar) => Err(LinearError::NonFinite { block: pattern.block_of(scalar) }),
        None => Ok(()),
    }
}

/// The error for a failing pivot at a scalar row of the caller's order.
pub(super) fn not_positive_definite(pattern: &BlockPattern, scalar: usize) -> LinearError {
    LinearError::NotPositiveDefinite { block: pattern.block_of(scalar), scalar }
}
