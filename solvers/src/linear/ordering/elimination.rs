//! Symbolic elimination of a block graph in a given order: tree, column heights, flops.
//!
//! Tree: Liu, "The role of elimination trees in sparse factorization", 1990. Heights: Gilbert, Ng and
//! Peyton, "An efficient algorithm to compute row and column counts for sparse Cholesky
//! factorization", 1994. The fill is counted exactly and never formed, so that a factor that would
//! not fit is known in milliseconds. Indices are positions in the order. No value is read.

use crate::linear::pattern::BlockPattern;
use crate::lists::Lists;
use crate::order;

/// Marks a root of the elimination forest.
pub(in super::super) const NO_PARENT: u32 = u32::MAX;

/// Symbolic block elimination in some order; indices are positions in that order.
#[derive(Debug, Clone, Default)]
pub(in super::super) struct Elimination {
    pub(in super::super) parents: Vec<u32>,
    /// Scalar rows below the diagonal block in each block column of the factor.
    pub(in super::super) heights: Vec<usize>,
    /// Blocks below the diagonal block in each block column of the factor.
    pub(in super::super) block_heights: Vec<u32>,
    pub(in super::super) flops: f64,
    pub(super) blocks: usize,
}

/// Elimination tree, column heights and flops of `order`; `None` where it is not a permutation.
///
/// The factor is never formed: time is nearly linear in the pattern, memory linear, whatever the fill.
pub(super) fn eliminate(pattern: &BlockPattern, order: &[u32]) -> Option<Elimination> {
    let count = pattern.block_count();
    let position = inverse_permutation(order, count)?;
    let neighbors = earlier_neighbors(pattern, &position);
    let parents = tree(&neighbors);
    let sizes: Vec<usize> = order.iter().map(|&block| pattern.sizes()[block as usize]).collect();
    let (heights, block_heights) = heights(&sizes, &parents, &neighbors);
    let (mut cubes, mut rest) = (0.0, 0.0);
    let mut blocks = count;
    for ((&size, &height), &block_height) in sizes.iter().zip(&heights).zip(&block_heights) {
        let (b, h) = (size as f64, height as f64);
        cubes += b.powi(3);
        // Sums of whole numbers: equal costs are equal to the bit.
        rest += b * h * (b + h);
        blocks += block_height as usize;
    }
    let flops = cubes / 3.0 + rest;
    Some(Elimination { parents, heights, block_heights, flops, blocks })
}

/// `position[order[k]] = k`, or `None` where `order` is not a permutation of `0..count`.
pub(super) fn inverse_permutation(order: &[u32], count: usize) -> Option<Vec<u32>> {
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

/// The elimination tree, by paths that are shortened as they are walked.
fn tree(neighbors: &Lists<u32>) -> Vec<u32> {
    let count = neighbors.count();
    let mut parents = vec![NO_PARENT; count];
    let mut ancestors = vec![NO_PARENT; count];
    for k in 0..count {
        for &neighbor in neighbors.of(k) {
            let mut i = neighbor as usize;
            while i < k {
                let next = ancestors[i];
                ancestors[i] = k as u32;
                if next == NO_PARENT {
                    parents[i] = k as u32;
                    break;
                }
                i = next as usize;
            }
        }
    }
    parents
}

/// Scalar rows and blocks below each diagonal block.
///
/// Row i of the factor is a subtree with root i; column j is in it where j is on the way from one of
/// its leaves. Each leaf adds the row to its column, the meeting point of consecutive leaves takes it
/// out once, and sums over the tree's subtrees then count every row once.
fn heights(sizes: &[usize], parents: &[u32], neighbors: &Lists<u32>) -> (Vec<usize>, Vec<u32>) {
    let count = sizes.len();
    let postorder = postorder_of(parents, 0..count as u32);
    let earlier = |k: usize| neighbors.of(k).iter().map(move |&j| (j as usize, k as u32));
    let later = Lists::new(count, (0..count).flat_map(earlier));
    // Position of the first descendant in postorder.
    let mut first = vec![NO_PARENT; count];
    let mut sums = vec![[0_i64; 2]; count];
    for (k, &j) in postorder.iter().enumerate() {
        if first[j as usize] == NO_PARENT {
            sums[j as usize] = [sizes[j as usize] as i64, 1];
        }
        let mut i = j;
        while i != NO_PARENT && first[i as usize] == NO_PARENT {
            first[i as usize] = k as u32;
            i = parents[i as usize];
        }
    }
    let mut last_first = vec![NO_PARENT; count];
    let mut last_leaf = vec![NO_PARENT; count];
    let mut ancestors: Vec<u32> = (0..count as u32).collect();
    for &j in &postorder {
        let j = j as usize;
        let parent = parents[j];
        if parent != NO_PARENT {
            sums[parent as usize][0] -= sizes[j] as i64;
            sums[parent as usize][1] -= 1;
        }
        for &i in later.of(j) {
            let row = i as usize;
            let seen = last_first[row];
            if seen != NO_PARENT && first[j] <= seen {
                // Not a leaf of the row's subtree.
                continue;
            }
            last_first[row] = first[j];
            let before = std::mem::replace(&mut last_leaf[row], j as u32);
            let size = sizes[row] as i64;
            sums[j][0] += size;
            sums[j][1] += 1;
            if before != NO_PARENT {
                let mut meeting = before;
                while ancestors[meeting as usize] != meeting {
                    meeting = ancestors[meeting as usize];
                }
                let mut short = before;
                while short != meeting {
                    short = std::mem::replace(&mut ancestors[short as usize], meeting);
                }
                sums[meeting as usize][0] -= size;
                sums[meeting as usize][1] -= 1;
            }
        }
        if parent != NO_PARENT {
            ancestors[j] = parent;
        }
    }
    for j in 0..count {
        let [rows, blocks] = sums[j];
        if let Some(sum) = sums.get_mut(parents[j] as usize) {
            sum[0] += rows;
            sum[1] += blocks;
        }
    }
    let heights = sums.iter().zip(sizes).map(|(sum, &size)| sum[0] as usize - size);
    (heights.collect(), sums.iter().map(|sum| (sum[1] - 1) as u32).collect())
}

/// For each position, the positions before it that it shares a stored block with.
pub(in super::super) fn earlier_neighbors(pattern: &BlockPattern, position: &[u32]) -> Lists<u32> {
    let positions =
        |i: usize| pattern.row(i).iter().map(move |&j| (position[i], position[j as usize]));
    let pairs = (0..pattern.block_count()).flat_map(positions).filter(|(p, q)| p != q);
    Lists::new(pattern.block_count(), pairs.map(|(p, q)| (p.max(q) as usize, p.min(q))))
}

impl Elimination {
    /// The same elimination with blocks in another order of the same fill, as [`Self::postorder`]
    /// gives it.
    pub(super) fn renumbered(&self, order: &[u32]) -> Self {
        let mut position = vec![0u32; order.len()];
        for (k, &old) in order.iter().enumerate() {
            position[old as usize] = k as u32;
        }
        let old = || order.iter().map(|&old| old as usize);
        // Of a root's parent there is no position.
        let parent = |k: usize| position.get(self.parents[k] as usize).copied();
        Self {
            parents: old().map(|k| parent(k).unwrap_or(NO_PARENT)).collect(),
            heights: old().map(|k| self.heights[k]).collect(),
            block_heights: old().map(|k| self.block_heights[k]).collect(),
            ..*self
        }
    }

    /// Positions in an order where each subtree is contiguous and ends at its root.
    ///
    /// The tallest child comes last, next to its parent, so that the two can share a supernode.
    pub(super) fn postorder(&self) -> Vec<u32> {
        let mut by_height: Vec<u32> = (0..self.parents.len() as u32).collect();
        order::sort_by_key(&mut by_height, &|k| self.heights[k as usize] as u64);
        postorder_of(&self.parents, by_height.into_iter())
    }
}

/// A postorder of a forest, children in the order of `siblings`; a child that is not listed is left out.
pub(in super::super) fn postorder_of(
    parents: &[u32],
    siblings: impl DoubleEndedIterator<Item = u32>,
) -> Vec<u32> {
    let count = parents.len();
    // Linked lists of children: prepending in descending order leaves the first one first.
    let (mut first_child, mut sibling) = (vec![NO_PARENT; count], vec![NO_PARENT; count]);
    for k in siblings.rev() {
        let parent = parents[k as usize];
        if parent != NO_PARENT {
            sibling[k as usize] = first_child[parent as usize];
            first_child[parent as usize] = k;
        }
    }
    let mut result = Vec::with_capacity(count);
    let mut stack = Vec::new();
    for root in (0..count as u32).filter(|&k| parents[k as usize] == NO_PARENT) {
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
