//! Symbolic elimination of a block graph in a given order: tree, column heights, flops.
//!
//! Liu, "The role of elimination trees in sparse factorization", 1990. Row k of the factor is the
//! union of the paths from the entries of row k up to k; walking them counts the fill exactly, in
//! time proportional to the factor's blocks. Indices are positions in the order.

use std::cmp::Ordering;

use super::inverse_permutation;
use crate::linear::pattern::BlockPattern;

/// Marks a root of the elimination forest.
pub(in super::super) const NO_PARENT: u32 = u32::MAX;

/// What a candidate must stay within to be worth counting to its end.
#[derive(Debug, Clone, Copy)]
pub(super) struct Bound {
    pub(super) flops: f64,
    pub(super) blocks: usize,
}

impl Bound {
    pub(super) const NONE: Self = Self { flops: f64::INFINITY, blocks: usize::MAX };
}

/// Symbolic block elimination in some order; indices are positions in that order.
#[derive(Debug, Clone, Default)]
pub(in super::super) struct Elimination {
    pub(in super::super) parents: Vec<u32>,
    /// Scalar rows below the diagonal block in each block column of the factor.
    pub(in super::super) heights: Vec<usize>,
    pub(super) flops: f64,
    pub(super) blocks: usize,
    pub(super) factor_entries: f64,
}

/// Elimination tree, column heights and flops of `order`, or `None` once beyond `bound`.
pub(super) fn eliminate(
    pattern: &BlockPattern,
    order: &[u32],
    bound: Bound,
) -> Option<Elimination> {
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
pub(in super::super) fn earlier_neighbors(
    pattern: &BlockPattern,
    position: &[u32],
) -> (Vec<usize>, Vec<u32>) {
    let count = pattern.block_count();
    let mut starts = vec![0usize; count + 1];
    for i in 0..count {
        let p = position[i];
        for &j in pattern.row(i) {
            let q = position[j as usize];
            if p != q {
                starts[p.max(q) as usize + 1] += 1;
            }
        }
    }
    for k in 0..count {
        starts[k + 1] += starts[k];
    }
    let mut next = starts.clone();
    let mut neighbors = vec![0u32; starts[count]];
    for i in 0..count {
        let p = position[i];
        for &j in pattern.row(i) {
            let q = position[j as usize];
            if p != q {
                let slot = &mut next[p.max(q) as usize];
                neighbors[*slot] = p.min(q);
                *slot += 1;
            }
        }
    }
    (starts, neighbors)
}

impl Elimination {
    /// The same elimination with blocks in another order of the same fill, as [`Self::postorder`]
    /// gives it.
    pub(super) fn renumbered(&self, order: &[u32]) -> Self {
        let mut position = vec![0u32; order.len()];
        for (k, &old) in order.iter().enumerate() {
            position[old as usize] = k as u32;
        }
        let parents = order.iter().map(|&old| match self.parents[old as usize] {
            NO_PARENT => NO_PARENT,
            parent => position[parent as usize],
        });
        let heights = order.iter().map(|&old| self.heights[old as usize]);
        Self { parents: parents.collect(), heights: heights.collect(), ..*self }
    }

    /// Positions in an order where each subtree is contiguous and ends at its root.
    ///
    /// The tallest child comes last, next to its parent, so that the two can share a supernode.
    pub(super) fn postorder(&self) -> Vec<u32> {
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
