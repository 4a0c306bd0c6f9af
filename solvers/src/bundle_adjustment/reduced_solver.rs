//! The reduced camera system's solver: chosen once a solve, by estimated cost.
//!
//! Dense Cholesky for local windows, sparse Cholesky while its factor is cheap, conjugate gradients
//! past that. The choice looks at the structure only, so that it is the same on every run.

use std::sync::Arc;

use crate::linear::{BlockMatrix, BlockPattern, Cholesky, LinearError, Pcg};
use crate::problem::{BundleProblem, SolveError};

use super::LinearSolver;
use super::covisible::ChunkPairs;
use super::layout::Layout;
use super::pose_factors;
use super::reduce::block_pairs;

/// Reduced systems of at most so many unknowns are dense: their factorization is cheap anyway.
const DENSE_DIMENSION: usize = 300;

/// Fuller reduced systems than this are dense rather than sparse.
const DENSE_FILL: f64 = 0.4;

/// A factorization that costs more than so many products with the matrix is not worth its exactness.
const WORTH_PRODUCTS: f64 = 400.0;

/// Nash and Sofer's η: below it, further inner steps do not make the outer step better.
const FORCING: f64 = 0.1;

/// At most so many inner steps.
const MAX_PRODUCTS: usize = 500;

/// A solver with its plan.
pub(super) enum ReducedSolver {
    /// An exact factorization.
    Cholesky(Box<Cholesky>),
    /// Inexact.
    Pcg(Box<Pcg>),
}

/// What a solve of the reduced system tells.
pub(super) struct Solved {
    pub(super) linear_residual: f64,
    pub(super) is_inexact: bool,
}

/// The chosen solver, the pattern that it needs, and its name.
pub(super) fn choose(
    problem: &BundleProblem,
    layout: &Layout,
    pairs: &[ChunkPairs],
    wish: LinearSolver,
) -> Result<(LinearSolver, Arc<BlockPattern>, ReducedSolver), SolveError> {
    let sizes = layout.block_sizes.clone();
    let dimension: usize = sizes.iter().sum();
    let too_large = |_error: LinearError| SolveError::TooLarge { dimension };
    let dense = |sizes| {
        let pattern = Arc::new(BlockPattern::full(sizes));
        let cholesky = Cholesky::dense(Arc::clone(&pattern)).map_err(too_large)?;
        Ok((LinearSolver::DenseSchur, pattern, ReducedSolver::Cholesky(Box::new(cholesky))))
    };
    let auto = wish == LinearSolver::Auto;
    if wish == LinearSolver::DenseSchur || (auto && dimension <= DENSE_DIMENSION) {
        return dense(sizes);
    }
    let mut tied = pose_factors::block_pairs(problem, layout);
    tied.extend(block_pairs(layout, pairs));
    let pattern = Arc::new(BlockPattern::new(sizes.clone(), tied));
    let product = 4.0 * pattern.value_count() as f64;
    let iterative = |pattern: Arc<BlockPattern>| {
        let pcg = ReducedSolver::Pcg(Box::new(Pcg::new(Arc::clone(&pattern))));
        Ok((LinearSolver::IterativeSchur, pattern, pcg))
    };
    if wish == LinearSolver::IterativeSchur {
        return iterative(pattern);
    }
    if auto && pattern.density() > DENSE_FILL {
        let flops = (dimension as f64).powi(3) / 3.0;
        return if flops > WORTH_PRODUCTS * product { iterative(pattern) } else { dense(sizes) };
    }
    let cholesky = Cholesky::sparse(Arc::clone(&pattern)).map_err(too_large)?;
    if auto && cholesky.factor_flops() > WORTH_PRODUCTS * product {
        return iterative(pattern);
    }
    Ok((LinearSolver::SparseSchur, pattern, ReducedSolver::Cholesky(Box::new(cholesky))))
}

impl ReducedSolver {
    /// Solves (S + D) x = g.
    pub(super) fn solve(
        &mut self,
        reduced: &BlockMatrix,
        added: &[f64],
        right: &[f64],
        x: &mut [f64],
    ) -> Result<Solved, LinearError> {
        match self {
            Self::Cholesky(cholesky) => {
                cholesky.factor(reduced, added)?;
                let linear_residual = cholesky.solve_checked(reduced, added, right, x);
                Ok(Solved { linear_residual, is_inexact: false })
            }
            Self::Pcg(pcg) => {
                let outcome = pcg.solve(reduced, added, right, x, (FORCING, MAX_PRODUCTS))?;
                Ok(Solved { linear_residual: outcome.relative_residual, is_inexact: true })
            }
        }
    }
}
