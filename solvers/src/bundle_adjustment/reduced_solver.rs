//! The reduced camera system's solver: chosen once a solve, by estimated cost.
//!
//! Dense Cholesky for local windows, sparse Cholesky while its factor is cheap, conjugate gradients
//! without the matrix past that. The choice looks at the structure only, so that it is the same on
//! every run.

use std::sync::Arc;

use crate::linear::{BlockPattern, Cholesky, LinearError};
use crate::problem::{BundleProblem, SolveError};

use super::LinearSolver;
use super::covisible::{ChunkPairs, covisible_pairs};
use super::layout::Layout;
use super::pose_factors;
use super::reduce::block_pairs;

/// What a multiplication with the pairs of a landmark costs, as a share of one with its observations
/// in conjugate gradients; and what a flop of a factorization costs.
const PAIR_COST: f64 = 1.5;
const FLOP_COST: f64 = 0.01;

/// Products that conjugate gradients take for a step, to be expected.
const PRODUCTS: f64 = 40.0;

/// Reduced systems of at most so many unknowns are dense: their factorization is cheap anyway.
const DENSE_DIMENSION: usize = 300;

/// Fuller reduced systems than this are dense rather than sparse.
const DENSE_FILL: f64 = 0.4;

/// The chosen solver and what it needs.
pub(super) struct Choice {
    /// Never [`LinearSolver::Auto`].
    pub(super) linear_solver: LinearSolver,
    /// Blocks of the reduced system that are computed: the diagonal only, without a factorization.
    pub(super) pattern: Arc<BlockPattern>,
    /// The factorization and the pairs of views that feed it.
    pub(super) direct: Option<(Box<Cholesky>, Vec<ChunkPairs>)>,
}

/// Chooses as `wish` says, or the cheapest.
pub(super) fn choose(
    problem: &BundleProblem,
    layout: &Layout,
    wish: LinearSolver,
) -> Result<Choice, SolveError> {
    let sizes = layout.block_sizes.clone();
    let dimension: usize = sizes.iter().sum();
    let too_large = |_error: LinearError| SolveError::TooLarge { dimension };
    let iterative = |sizes| {
        let pattern = Arc::new(BlockPattern::new(sizes, []));
        Choice { linear_solver: LinearSolver::IterativeSchur, pattern, direct: None }
    };
    let dense = |sizes, pairs| {
        let pattern = Arc::new(BlockPattern::full(sizes));
        let cholesky = Box::new(Cholesky::dense(Arc::clone(&pattern)).map_err(too_large)?);
        let direct = Some((cholesky, pairs));
        Ok(Choice { linear_solver: LinearSolver::DenseSchur, pattern, direct })
    };
    let auto = wish == LinearSolver::Auto;
    if wish == LinearSolver::DenseSchur || (auto && dimension <= DENSE_DIMENSION) {
        return dense(sizes, covisible_pairs(layout));
    }
    let observations = layout.sorted.observation_count() as f64;
    let affordable = PRODUCTS * observations - PAIR_COST * layout.sorted.pair_count as f64;
    if wish == LinearSolver::IterativeSchur
        || (auto && FLOP_COST * least_factor_flops(layout) > affordable)
    {
        return Ok(iterative(sizes));
    }
    let pairs = covisible_pairs(layout);
    let mut tied = pose_factors::block_pairs(problem, layout);
    tied.extend(block_pairs(layout, &pairs));
    let pattern = Arc::new(BlockPattern::new(sizes.clone(), tied));
    if auto && pattern.density() > DENSE_FILL {
        let flops = (dimension as f64).powi(3) / 3.0;
        return if FLOP_COST * flops > affordable {
            Ok(iterative(sizes))
        } else {
            dense(sizes, pairs)
        };
    }
    let cholesky = Box::new(Cholesky::sparse(Arc::clone(&pattern)).map_err(too_large)?);
    if auto && FLOP_COST * cholesky.factor_flops() > affordable {
        return Ok(iterative(sizes));
    }
    let direct = Some((cholesky, pairs));
    Ok(Choice { linear_solver: LinearSolver::SparseSchur, pattern, direct })
}

/// What a factorization without any fill would cost, from the neighbors of a few views: cheap to
/// know before the pairs are.
fn least_factor_flops(layout: &Layout) -> f64 {
    const SAMPLES: usize = 32;
    let sorted = &layout.sorted;
    let count = layout.views.len();
    let step = count.div_ceil(SAMPLES).max(1);
    let mut seen = vec![usize::MAX; count];
    let mut squares = 0.0;
    let mut samples = 0_u32;
    // Tracks of the sampled views: one pass over the observations finds them all.
    let mut tracks: Vec<Vec<u32>> = vec![Vec::new(); count.div_ceil(step)];
    for (&view, &position) in sorted.views.iter().zip(&sorted.positions) {
        if (view as usize).is_multiple_of(step) {
            tracks[view as usize / step].push(position);
        }
    }
    for (sample, tracks) in tracks.iter().enumerate() {
        let mut neighbors = 0_u32;
        for &position in tracks {
            for o in sorted.track(position as usize) {
                let other = &mut seen[sorted.views[o] as usize];
                if *other != sample {
                    *other = sample;
                    neighbors += 1;
                }
            }
        }
        // Half of them come later in any order.
        squares += (f64::from(neighbors) / 2.0).powi(2);
        samples += 1;
    }
    let dimension: usize = layout.block_sizes.iter().sum();
    let size = dimension as f64 / layout.block_sizes.len().max(1) as f64;
    squares / f64::from(samples.max(1)) * layout.block_sizes.len() as f64 * size.powi(3)
}
