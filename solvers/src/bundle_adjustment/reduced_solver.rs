//! The reduced camera system's solver, by cost.
//!
//! Dense Cholesky for local windows, sparse Cholesky while its factor is cheap, conjugate gradients
//! without the matrix past that. What a factorization costs is known from the structure; how many products
//! conjugate gradients take is expected from it, and counted afterwards. The choice looks at both and
//! never at a clock, so that it is the same on every run.

use std::sync::Arc;

use crate::linear::{BlockPattern, Cholesky, LinearError, Ordered, dense_price};
use crate::optimizer::from_linear;
use crate::price::{Limits, Price};
use crate::problem::{BundleProblem, SolveError};

use super::LinearSolver;
use super::covisible::{ChunkPairs, can_be_numbered, covisible_pairs, most_slots, slot_count};
use super::distance::longest_way;
use super::iterative::MAX_PRODUCTS;
use super::layout::Layout;
use super::price::Costs;
use super::reduce::block_pairs;
use super::state_factors;

/// What a multiplication with the pairs of a landmark costs, as a share of one with its observations
/// in conjugate gradients; and what a flop of a factorization costs.
const PAIR_COST: f64 = 1.5;
const FLOP_COST: f64 = 0.01;

/// Products that conjugate gradients take for a step, to be expected where views are close to each other.
const PRODUCTS: f64 = 40.0;

/// Products that it takes in addition to carry an error over a landmark, from one view to the next.
const PRODUCTS_A_HOP: f64 = 4.0;

/// Conjugate gradients are left once a step took so many times the products that a factorization costs.
const TOO_MANY: f64 = 1.5;

/// A factorization that takes so many times the memory of conjugate gradients is none for `auto`, unless it
/// is little anyway: bytes.
const MUCH_MEMORY: u64 = 8;
const LITTLE_MEMORY: u64 = 1 << 30;

/// Reduced systems of at most so many unknowns are dense: their factorization is cheap anyway.
const DENSE_DIMENSION: usize = 300;

/// Fuller reduced systems than this are dense rather than sparse.
const DENSE_FILL: f64 = 0.4;

/// More pairs of observations than this are not walked over for a price: their bound counts.
const MOST_COUNTED: usize = 1 << 28;

/// The chosen solver and what it needs.
pub(super) struct Choice {
    /// Never [`LinearSolver::Auto`].
    pub(super) linear_solver: LinearSolver,
    /// Blocks of the reduced system that are computed: the diagonal only, without a factorization.
    pub(super) pattern: Arc<BlockPattern>,
    /// The factorization and the pairs of views that feed it.
    pub(super) direct: Option<(Box<Cholesky>, Vec<ChunkPairs>)>,
    /// Products that cost as much as a step by the factorization, or fewer; infinite where there is none.
    break_even: f64,
}

impl Choice {
    /// From how many products in a step on [`choose`] is to be asked again, with that number.
    pub(super) fn most_products(&self) -> f64 {
        TOO_MANY * self.break_even
    }
}

/// Products that a step is expected to take.
#[derive(Clone, Copy, Debug)]
pub(super) enum Products {
    /// As many as the structure says.
    Unknown,
    /// As many as the last step took.
    Counted(usize),
}

/// A choice for which nothing large was allocated yet.
enum Plan {
    Dense,
    Sparse { pattern: Arc<BlockPattern>, pairs: Vec<ChunkPairs>, ordered: Ordered },
    Iterative { break_even: f64 },
}

/// Chooses as `wish` says, or the cheapest that stays within the ceiling; `products` is what conjugate
/// gradients would take.
///
/// # Errors
/// [`SolveError::TooExpensive`], [`SolveError::TooLarge`], [`SolveError::Interrupted`].
pub(super) fn choose(
    problem: &BundleProblem,
    layout: &Layout,
    wish: LinearSolver,
    products: Products,
    costs: &Costs,
    limits: Limits<'_>,
) -> Result<Choice, SolveError> {
    let sizes = layout.block_sizes.clone();
    let dimension: usize = sizes.iter().sum();
    let failed = |error: LinearError| from_linear(error, dimension);
    let auto = wish == LinearSolver::Auto;
    let plan = match plan(problem, layout, wish, products, costs, limits) {
        // The matrix does not fit; without it, it may.
        Err(SolveError::TooExpensive(_) | SolveError::TooLarge { .. }) if auto => {
            Plan::Iterative { break_even: f64::INFINITY }
        }
        other => other?,
    };
    match plan {
        Plan::Dense => {
            let pairs = covisible_pairs(layout, limits.interrupt).ok_or(SolveError::Interrupted)?;
            let pattern = Arc::new(BlockPattern::full(sizes));
            let cholesky = Box::new(Cholesky::dense(Arc::clone(&pattern)).map_err(failed)?);
            let direct = Some((cholesky, pairs));
            let linear_solver = LinearSolver::DenseSchur;
            Ok(Choice { linear_solver, pattern, direct, break_even: f64::INFINITY })
        }
        Plan::Sparse { pattern, pairs, ordered } => {
            let cholesky = Cholesky::ordered(Arc::clone(&pattern), ordered).map_err(failed)?;
            let direct = Some((Box::new(cholesky), pairs));
            let linear_solver = LinearSolver::SparseSchur;
            Ok(Choice { linear_solver, pattern, direct, break_even: f64::INFINITY })
        }
        Plan::Iterative { break_even } => {
            limits.ceiling.admit(&costs.iterative())?;
            let pattern = Arc::new(BlockPattern::new(sizes, []));
            let linear_solver = LinearSolver::IterativeSchur;
            Ok(Choice { linear_solver, pattern, direct: None, break_even })
        }
    }
}

/// Plans within the ceiling as far as there is a matrix.
fn plan(
    problem: &BundleProblem,
    layout: &Layout,
    wish: LinearSolver,
    products: Products,
    costs: &Costs,
    limits: Limits<'_>,
) -> Result<Plan, SolveError> {
    let dimension: usize = layout.block_sizes.iter().sum();
    let auto = wish == LinearSolver::Auto;
    let dense = || -> Result<Plan, SolveError> {
        let blocks = layout.block_sizes.len() as u64;
        let matrix = dense_price(dimension, blocks * (blocks + 1) / 2);
        let matrix = matrix.plus_bytes(costs.full_matrix_bytes());
        paired(layout, costs, |_slots| matrix, limits)?;
        Ok(Plan::Dense)
    };
    let numbered = || match can_be_numbered(layout) {
        true => Ok(()),
        false => Err(SolveError::TooLarge { dimension }),
    };
    if wish == LinearSolver::DenseSchur || (auto && dimension <= DENSE_DIMENSION) {
        numbered()?;
        return dense();
    }
    if wish == LinearSolver::IterativeSchur {
        return Ok(Plan::Iterative { break_even: f64::INFINITY });
    }
    let observations = layout.sorted.observation_count().max(1) as f64;
    let pairs = PAIR_COST * layout.sorted.pair_count as f64;
    // In products.
    let cost = |flops: f64| (FLOP_COST * flops + pairs) / observations;
    let mut way = None;
    let mut is_cheaper = |break_even: f64| {
        let expected = match products {
            Products::Counted(count) => count as f64 / TOO_MANY,
            // Nothing is known of products without observations, and a pose graph's factor is sparse.
            Products::Unknown if layout.sorted.observation_count() == 0 => f64::INFINITY,
            // The way between views is asked for only where it may change the choice.
            Products::Unknown if break_even <= PRODUCTS => PRODUCTS,
            Products::Unknown => {
                let hops = *way.get_or_insert_with(|| longest_way(layout));
                (PRODUCTS + PRODUCTS_A_HOP * hops as f64).min(MAX_PRODUCTS as f64)
            }
        };
        break_even > expected
    };
    if auto {
        let break_even = cost(least_factor_flops(layout));
        if is_cheaper(break_even) {
            return Ok(Plan::Iterative { break_even });
        }
    }
    numbered()?;
    // The lists of pairs alone may be too many.
    let lists = |slots| Price { bytes: costs.pattern_lists(slots), ..Price::default() };
    let base = paired(layout, costs, lists, limits)?;
    let pairs = covisible_pairs(layout, limits.interrupt).ok_or(SolveError::Interrupted)?;
    let mut tied = state_factors::block_pairs(problem, layout);
    tied.extend(block_pairs(layout, &pairs));
    let pattern = Arc::new(BlockPattern::new(layout.block_sizes.clone(), tied));
    if auto && pattern.density() > DENSE_FILL {
        let flops = (dimension as f64).powi(3) / 3.0;
        let break_even = cost(flops);
        return match is_cheaper(break_even) {
            true => Ok(Plan::Iterative { break_even }),
            false => dense(),
        };
    }
    let failed = |error: LinearError| from_linear(error, dimension);
    let ordered = Cholesky::order(&pattern, limits.interrupt).map_err(failed)?;
    let break_even = cost(ordered.price().flops_per_iteration);
    if auto && is_cheaper(break_even) {
        return Ok(Plan::Iterative { break_even });
    }
    let values = 8 * pattern.value_count() as u64 + 24 * pattern.stored_block_count() as u64;
    let matrix = values.saturating_add(ordered.price().bytes);
    let flops_per_iteration = base.flops_per_iteration + ordered.price().flops_per_iteration;
    limits
        .ceiling
        .admit(&Price { bytes: base.bytes.saturating_add(matrix), flops_per_iteration })?;
    let much = MUCH_MEMORY.saturating_mul(costs.iterative().bytes).max(LITTLE_MEMORY);
    let is_much = |base: Price| base.bytes.saturating_add(matrix) > much;
    // Within a ceiling a bound was enough. It says nothing of what is much.
    if auto && is_much(base) && is_much(counted(layout, costs, lists, limits)?) {
        return Ok(Plan::Iterative { break_even: f64::INFINITY });
    }
    Ok(Plan::Sparse { pattern, pairs, ordered })
}

/// What a solve takes with the pairs of views and `more`, which may grow with their slots.
///
/// A bound that is cheap to know is enough where it stays within the ceiling; else slots are counted.
fn paired(
    layout: &Layout,
    costs: &Costs,
    more: impl Fn(u64) -> Price,
    limits: Limits<'_>,
) -> Result<Price, SolveError> {
    // Whatever the slots are, it takes this much.
    limits.ceiling.admit(&with_slots(0, costs, &more))?;
    let most = with_slots(most_slots(layout), costs, &more);
    if !limits.ceiling.is_none() && limits.ceiling.admit(&most).is_ok() {
        return Ok(most);
    }
    let counted = counted(layout, costs, more, limits)?;
    limits.ceiling.admit(&counted)?;
    Ok(counted)
}

/// The same with slots that are counted, unless there are so many that their bound counts.
fn counted(
    layout: &Layout,
    costs: &Costs,
    more: impl Fn(u64) -> Price,
    limits: Limits<'_>,
) -> Result<Price, SolveError> {
    let slots = if layout.sorted.pair_count > MOST_COUNTED {
        most_slots(layout)
    } else {
        slot_count(layout, limits.interrupt).ok_or(SolveError::Interrupted)?
    };
    Ok(with_slots(slots, costs, more))
}

/// What a solve with so many slots takes, and `more`.
fn with_slots(slots: u64, costs: &Costs, more: impl Fn(u64) -> Price) -> Price {
    let (pairs, more) = (costs.paired(slots), more(slots));
    Price {
        bytes: pairs.bytes.saturating_add(more.bytes),
        flops_per_iteration: pairs.flops_per_iteration + more.flops_per_iteration,
    }
}

/// What a factorization without any fill would cost, from the neighbors of a few views: cheap to
/// know before the pairs are.
fn least_factor_flops(layout: &Layout) -> f64 {
    const SAMPLES: usize = 32;
    let sorted = &layout.sorted;
    let count = layout.views.len();
    // Poses without observations fill what their factors join.
    if count == 0 {
        return 0.0;
    }
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
