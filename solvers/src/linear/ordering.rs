//! Elimination orders of the block graph, and what each costs.
//!
//! Eliminating a block of b rows whose factor column has h scalar rows below it costs about
//! b³/3 + b²h + bh² flops (with equal blocks and c = h/b: b³(1/3 + c + c²)). The heights come from
//! a block elimination tree and row subtrees (Liu, "The role of elimination trees in sparse
//! factorization", 1990). Candidates are tried in turn and the cheapest is kept; counting stops as
//! soon as a candidate is seen to lose. A further ordering is one more entry in `CANDIDATES`.
//! The result is always postordered, which keeps fill and cost and brings supernodes together.
//! Nothing here looks at values.

use std::cmp::Ordering;

use faer::dyn_stack::{MemBuffer, MemStack};
use faer::sparse::SymbolicSparseColMatRef;
use faer::sparse::linalg::amd;

use super::pattern::BlockPattern;

/// Marks a root of the elimination forest.
const NO_PARENT: u32 = u32::MAX;

/// Which algorithm made an elimination order.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum OrderingMethod {
    /// Approximate minimum degree on the block graph.
    MinimumDegree,
    /// The caller's order.
    Natural,
}

/// Candidates, most promising first, since the first ones bound the counting of the later.
const CANDIDATES: [OrderingMethod; 2] = [OrderingMethod::MinimumDegree, OrderingMethod::Natural];

/// An elimination order and what it costs.
#[derive(Debug, Clone, PartialEq)]
pub struct BlockOrdering {
    /// `order[k]` is the block that is eliminated k-th.
    pub order: Vec<u32>,
    /// Flops of one factorization.
    pub flops: f64,
    /// Scalars in the lower triangle of the factor.
    pub factor_entries: f64,
    /// Where the order came from.
    pub method: OrderingMethod,
}

/// The cheapest elimination order found: `order[k]` is the block eliminated k-th.
pub fn block_order(pattern: &BlockPattern) -> Vec<u32> {
    cheapest_ordering(pattern).order
}

/// The cheapest elimination order found, with its cost; ties go to the caller's order.
pub fn cheapest_ordering(pattern: &BlockPattern) -> BlockOrdering {
    let natural = || (0..pattern.block_count() as u32).collect::<Vec<u32>>();
    let mut best: Option<(OrderingMethod, Vec<u32>, Elimination)> = None;
    for method in CANDIDATES {
        let order = match method {
            // Where every block is stored there is nothing to choose.
            OrderingMethod::MinimumDegree if pattern.density() >= 1.0 => None,
            OrderingMethod::MinimumDegree => minimum_degree(pattern),
            OrderingMethod::Natural => Some(natural()),
        };
        let Some(order) = order else { continue };
        let bound = best.as_ref().map_or(Bound::NONE, |(_, _, elimination)| Bound {
            flops: elimination.flops,
            blocks: elimination.blocks.saturating_mul(2),
        });
        if let Some(elimination) = eliminate(pattern, &order, bound) {
            best = Some((method, order, elimination));
        }
    }
    // The natural order without a bound always answers, so the fallback is never taken.
    let (method, order, elimination) =
        best.unwrap_or_else(|| (OrderingMethod::Natural, natural(), Elimination::default()));
    let order = elimination.postorder().into_iter().map(|k| order[k as usize]).collect();
    let factor_entries = elimination.factor_entries;
    BlockOrdering { order, flops: elimination.flops, factor_entries, method }
}

/// Flops of a factorization that eliminates blocks in the given order.
///
/// `None` where `order` is not a permutation of the blocks.
pub fn elimination_flops(pattern: &BlockPattern, order: &[u32]) -> Option<f64> {
    inverse_permutation(order, pattern.block_count())?;
    eliminate(pattern, order, Bound::NONE).map(|elimination| elimination.flops)
}

/// `position[order[k]] = k`, or `None` where `order` is not a permutation of `0..count`.
pub(crate) fn inverse_permutation(order: &[u32], count: usize) -> Option<Vec<u32>> {
    if order.len() != count {
        return None;
    }
    let mut position = vec![u32::MAX; count];
    for (k, &block) in order.iter().enumerate() {
        let slot = position.get_mut(block as usize)?;
        if *slot != u32::MAX {
            return None;
        }
        *slot = k as u32;
    }
    Some(position)
}

/// AMD on the block graph; `None` where it fails for want of memory or of index range.
fn minimum_degree(pattern: &BlockPattern) -> Option<Vec<u32>> {
    let count = pattern.block_count();
    let entries = u32::try_from(pattern.stored_block_count()).ok()?;
    if entries > u32::MAX / 4 {
        return None;
    }
    // Our rows j ≤ i, read as columns, are the upper triangle in compressed columns.
    let starts: Vec<u32> = pattern.row_starts().iter().map(|&start| start as u32).collect();
    let graph =
        SymbolicSparseColMatRef::new_checked(count, count, &starts, None, pattern.columns());
    let (mut order, mut position) = (vec![0u32; count], vec![0u32; count]);
    let scratch = amd::order_scratch::<u32>(count, entries as usize);
    let mut memory = MemBuffer::try_new(scratch).ok()?;
    let control = amd::Control::default();
    amd::order(&mut order, &mut position, graph, control, MemStack::new(&mut memory)).ok()?;
    Some(order)
}

/// What a candidate must stay within to be worth counting to its end.
#[derive(Debug, Clone, Copy)]
struct Bound {
    flops: f64,
    blocks: usize,
}

impl Bound {
    const NONE: Self = Self { flops: f64::INFINITY, blocks: usize::MAX };
}

/// Symbolic block elimination in some order; indices are positions in that order.
#[derive(Debug, Clone, Default)]
struct Elimination {
    parents: Vec<u32>,
    /// Scalar rows below the diagonal block in each block column of the factor.
    heights: Vec<usize>,
    flops: f64,
    blocks: usize,
    factor_entries: f64,
}

/// Elimination tree, column heights and flops of `order`, or `None` once beyond `bound`.
fn eliminate(pattern: &BlockPattern, order: &[u32], bound: Bound) -> Option<Elimination> {
    let count = pattern.block_count();
    let position = inverse_permutation(order, count)?;
    let (starts, neighbors) = earlier_neighbors(pattern, &position);
    let size = |k: usize| pattern.sizes()[order[k] as usize];
    let mut parents = vec![NO_PARENT; count];
    let mut heights = vec![0usize; count];
    let mut visited = vec![u32::MAX; count];
    let mut blocks = count;
    let mut flops: f64 = (0..count).map(|k| (size(k) as f64).powi(3) / 3.0).sum();
    for k in 0..count {
        let rows = size(k);
        visited[k] = k as u32;
        // Row k of the factor: every path from an entry of the row up to k.
        for &neighbor in &neighbors[starts[k]..starts[k + 1]] {
            let mut i = neighbor as usize;
            while visited[i] != k as u32 {
                visited[i] = k as u32;
                if parents[i] == NO_PARENT {
                    parents[i] = k as u32;
                }
                let (b, h, s) = (size(i) as f64, heights[i] as f64, rows as f64);
                flops += b * s * (b + 2.0 * h + s);
                heights[i] += rows;
                blocks += 1;
                i = parents[i] as usize;
            }
        }
        if flops > bound.flops || blocks > bound.blocks {
            return None;
        }
    }
    let factor_entries = (0..count)
        .map(|k| {
            let (b, h) = (size(k) as f64, heights[k] as f64);
            b * (b + 1.0) / 2.0 + b * h
        })
        .sum();
    Some(Elimination { parents, heights, flops, blocks, factor_entries })
}

/// For each position, the positions before it that it shares a stored block with.
fn earlier_neighbors(pattern: &BlockPattern, position: &[u32]) -> (Vec<usize>, Vec<u32>) {
    let count = pattern.block_count();
    let pairs = || {
        (0..count).flat_map(|i| {
            let p = position[i];
            pattern.row(i).iter().map(move |&j| (p, position[j as usize])).filter(|(p, q)| p != q)
        })
    };
    let mut starts = vec![0usize; count + 1];
    for (p, q) in pairs() {
        starts[p.max(q) as usize + 1] += 1;
    }
    for k in 0..count {
        starts[k + 1] += starts[k];
    }
    let mut next = starts.clone();
    let mut neighbors = vec![0u32; starts[count]];
    for (p, q) in pairs() {
        let slot = &mut next[p.max(q) as usize];
        neighbors[*slot] = p.min(q);
        *slot += 1;
    }
    (starts, neighbors)
}

impl Elimination {
    /// Positions in an order where each subtree is contiguous and ends at its root.
    ///
    /// The tallest child comes last, next to its parent, so that the two can share a supernode.
    fn postorder(&self) -> Vec<u32> {
        let count = self.parents.len();
        let mut by_height: Vec<u32> = (0..count as u32).collect();
        let key = |k: u32| self.heights[k as usize];
        by_height.sort_by(|&a, &b| match key(a).cmp(&key(b)) {
            Ordering::Equal => a.cmp(&b),
            unequal @ (Ordering::Less | Ordering::Greater) => unequal,
        });
        // Linked lists of children: prepending in descending height leaves the lowest first.
        let (mut first_child, mut sibling) = (vec![NO_PARENT; count], vec![NO_PARENT; count]);
        for &k in by_height.iter().rev() {
            let parent = self.parents[k as usize];
            if parent != NO_PARENT {
                sibling[k as usize] = first_child[parent as usize];
                first_child[parent as usize] = k;
            }
        }
        let mut result = Vec::with_capacity(count);
        let mut stack = Vec::new();
        for root in (0..count as u32).filter(|&k| self.parents[k as usize] == NO_PARENT) {
            stack.push(root);
            while let Some(&top) = stack.last() {
                let child = first_child[top as usize];
                if child == NO_PARENT {
                    result.push(top);
                    stack.pop();
                } else {
                    first_child[top as usize] = sibling[child as usize];
                    stack.push(child);
                }
            }
        }
        result
    }
}

#[cfg(test)]
mod tests;
