//! Elimination orders of the block graph, and what each costs.
//!
//! Eliminating a block of b rows whose factor column has h scalar rows below it costs about
//! b³/3 + b²h + bh² flops (with equal blocks and c = h/b: b³(1/3 + c + c²)). Candidates are tried in
//! turn and the cheapest is kept.
//!
//! - `minimum_degree`: AMD behind an exact reduction; `dissection`, `multilevel`,
//!   `refinement`: nested dissection; `elimination`: tree and fill of an order.
//!
//! The result is always postordered, which keeps fill and cost and brings supernodes together.
//! Nothing here looks at values.

mod dissection;
mod elimination;
mod graph;
mod minimum_degree;
mod multilevel;
mod refinement;

use std::sync::Arc;

use super::error::LinearError;
use super::pattern::BlockPattern;
use crate::interrupt::Interrupt;
use crate::order;

use dissection::nested_dissection;
use elimination::eliminate;
pub(super) use elimination::{Elimination, NO_PARENT, earlier_neighbors, postorder_of};
use graph::Graph;
use minimum_degree::{minimum_degree, minimum_degree_until, reduced};

/// Which algorithm made an elimination order.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum OrderingMethod {
    /// Approximate minimum degree on the block graph.
    MinimumDegree,
    /// Nested dissection of the block graph.
    NestedDissection,
    /// The caller's order.
    Natural,
}

/// Candidates, most promising first, since the first ones bound the counting of the later.
const CANDIDATES: [OrderingMethod; 3] =
    [OrderingMethod::MinimumDegree, OrderingMethod::NestedDissection, OrderingMethod::Natural];

/// Dissection costs a few microseconds a block: it is tried where what it may save over the
/// factorizations of a solve is more, and where there is something to cut.
const DISSECTION_FLOPS: f64 = 2e5;
const DENSE: f64 = 0.3;

/// The caller's order is a candidate for so many blocks.
const NATURAL: usize = 256;

/// An elimination order and what it costs.
#[derive(Debug, Clone, PartialEq)]
pub struct BlockOrdering {
    /// `order[k]` is the block that is eliminated k-th.
    pub order: Vec<u32>,
    /// Flops of one factorization.
    pub flops: f64,
    /// Where the order came from.
    pub method: OrderingMethod,
}

/// The elimination in a given order, postordered; `None` where `order` is not a permutation.
pub(super) fn postordered(
    pattern: &BlockPattern,
    order: &[u32],
) -> Option<(Vec<u32>, Elimination)> {
    eliminate(pattern, order).map(|elimination| in_postorder(order, &elimination))
}

fn in_postorder(order: &[u32], elimination: &Elimination) -> (Vec<u32>, Elimination) {
    let postorder = elimination.postorder();
    let order = postorder.iter().map(|&k| order[k as usize]).collect();
    (order, elimination.renumbered(&postorder))
}

/// A minimum-degree order in which the blocks marked in `is_last` come after all others, postordered,
/// with its elimination.
pub(super) fn ordered_with_last(
    pattern: &BlockPattern,
    is_last: &[bool],
) -> (Vec<u32>, Elimination) {
    let natural = || (0..pattern.block_count() as u32).collect();
    let mut order = minimum_degree(&Graph::of_pattern(pattern)).unwrap_or_else(natural);
    order::sort_by_key(&mut order, &|block| u64::from(is_last[block as usize]));
    postordered(pattern, &order).unwrap_or_default()
}

/// The cheapest elimination order found, with its cost and its elimination tree; ties go to the earlier
/// candidate.
///
/// # Errors
/// [`LinearError::Interrupted`].
pub(super) fn cheapest(
    pattern: &BlockPattern,
    interrupt: &Interrupt,
) -> Result<(BlockOrdering, Elimination), LinearError> {
    let count = pattern.block_count();
    let natural = || (0..count as u32).collect::<Vec<u32>>();
    let graph = Arc::new(Graph::of_pattern(pattern));
    let mut best: Option<(OrderingMethod, Vec<u32>, Elimination)> = None;
    for method in CANDIDATES {
        let flops = best.as_ref().map_or(f64::INFINITY, |(_, _, elimination)| elimination.flops);
        let order = match method {
            // Where every block is stored there is nothing to choose.
            OrderingMethod::MinimumDegree if pattern.density() >= 1.0 => None,
            OrderingMethod::MinimumDegree => minimum_degree_until(&graph, interrupt),
            OrderingMethod::NestedDissection if flops < DISSECTION_FLOPS * count as f64 => None,
            OrderingMethod::NestedDissection if pattern.density() > DENSE => None,
            OrderingMethod::NestedDissection => {
                reduced(&graph, |core| nested_dissection(core, interrupt))
            }
            OrderingMethod::Natural if best.is_some() && count > NATURAL => None,
            OrderingMethod::Natural => Some(natural()),
        };
        if interrupt.is_due() {
            return Err(LinearError::Interrupted);
        }
        let Some(order) = order else { continue };
        let Some(elimination) = eliminate(pattern, &order) else { continue };
        let is_better = best.as_ref().is_none_or(|(_, _, best)| {
            elimination.flops <= best.flops && elimination.blocks <= best.blocks.saturating_mul(2)
        });
        if is_better {
            best = Some((method, order, elimination));
        }
    }
    // The natural order always answers, so the fallback is never taken.
    let (method, order, elimination) =
        best.unwrap_or_else(|| (OrderingMethod::Natural, natural(), Elimination::default()));
    let (order, elimination) = in_postorder(&order, &elimination);
    Ok((BlockOrdering { order, flops: elimination.flops, method }, elimination))
}

#[cfg(test)]
mod tests;
