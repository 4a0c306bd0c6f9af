//! Supernodes: columns of the factor that are eliminated together.
//!
//! Columns whose structures nest exactly are joined first (fundamental supernodes, and maximal
//! ones). Then a child is merged into its parent wherever the zeros that this stores cost less than
//! the front that it saves, by a model of time (relaxed amalgamation, after Ashcraft and Grimes,
//! "The influence of relaxed supernode partitions on the multifrontal method", 1989).
//! Structure only: no rows are listed here, no values are seen.

use std::ops::Range;

use super::super::ordering::{Elimination, NO_PARENT};
use crate::simd::WIDTH;

/// The model of time, in units of one vector operation of eight multiplications and additions:
/// a front, a vector of it that is assembled, and one that is added to the parent.
pub(super) const FRONT: f64 = 250.0;
const PANEL_VECTOR: f64 = 1.5;
const LIFT_VECTOR: f64 = 4.0;

/// Supernodes in postorder.
#[derive(Debug)]
pub(super) struct Supernodes {
    /// `order[k]`: the position, in the order given, of the block that is now k-th.
    pub(super) order: Vec<u32>,
    /// Blocks of each supernode in the new order.
    pub(super) blocks: Vec<Range<usize>>,
    /// The parent of each supernode, or [`NO_PARENT`].
    pub(super) parents: Vec<u32>,
}

/// Where blocks stand once those of joined supernodes are side by side.
pub(super) struct Placed {
    /// The block that is k-th.
    pub(super) order: Vec<u32>,
    /// The place of each block.
    pub(super) position: Vec<u32>,
    /// The supernode of each place.
    pub(super) node_of: Vec<u32>,
}

impl Supernodes {
    /// The places of blocks that were given in `order`.
    pub(super) fn placed(&self, order: &[u32]) -> Placed {
        let order: Vec<u32> = self.order.iter().map(|&k| order[k as usize]).collect();
        let mut position = vec![0; order.len()];
        for (k, &block) in order.iter().enumerate() {
            position[block as usize] = k as u32;
        }
        let mut node_of = vec![0; order.len()];
        for (s, range) in self.blocks.iter().enumerate() {
            node_of[range.clone()].fill(s as u32);
        }
        Placed { order, position, node_of }
    }
}

/// What a front of `k` pivots and `m` further rows costs, `front` by itself.
fn cost(k: f64, m: f64, front: f64) -> f64 {
    let width = WIDTH as f64;
    let rows = ((k + m) / width).ceil();
    let below = m / width + 0.5;
    front
        + PANEL_VECTOR * k * rows
        + LIFT_VECTOR * m * below
        + k * k * rows / 2.0
        + k * m * below / 2.0
}

/// Supernodes of a postordered elimination over blocks of the given sizes; a front costs `front` by
/// itself.
pub(super) fn amalgamate(sizes: &[usize], elimination: &Elimination, front: f64) -> Supernodes {
    let maximal = maximal(sizes, elimination);
    let count = maximal.len();
    let mut node_of = vec![0u32; sizes.len()];
    for (s, range) in maximal.iter().enumerate() {
        node_of[range.clone()].fill(s as u32);
    }
    let mut pivots: Vec<f64> = Vec::with_capacity(count);
    let mut below: Vec<f64> = Vec::with_capacity(count);
    let mut parents: Vec<u32> = Vec::with_capacity(count);
    for range in &maximal {
        pivots.push(sizes[range.clone()].iter().sum::<usize>() as f64);
        let top = range.end - 1;
        below.push(elimination.heights[top] as f64);
        let parent = elimination.parents[top];
        parents.push(if parent == NO_PARENT { NO_PARENT } else { node_of[parent as usize] });
    }
    // Children are done before their parents; a merged child hands its own children up.
    let mut merged = vec![false; count];
    for s in 0..count {
        let parent = parents[s];
        if parent == NO_PARENT {
            continue;
        }
        let p = parent as usize;
        let apart = cost(pivots[s], below[s], front) + cost(pivots[p], below[p], front);
        if cost(pivots[s] + pivots[p], below[p], front) <= apart {
            merged[s] = true;
            pivots[p] += pivots[s];
        }
    }
    renumber(&maximal, &parents, &merged)
}

/// Ranges of blocks with nested structures.
fn maximal(sizes: &[usize], elimination: &Elimination) -> Vec<Range<usize>> {
    let mut ranges = Vec::new();
    let mut start = 0;
    for j in 0..sizes.len() {
        let continues = j + 1 < sizes.len()
            && elimination.parents[j] == j as u32 + 1
            && elimination.heights[j] == elimination.heights[j + 1] + sizes[j + 1];
        if !continues {
            ranges.push(start..j + 1);
            start = j + 1;
        }
    }
    ranges
}

/// Puts the blocks of merged supernodes side by side, in a postorder of what remains.
fn renumber(maximal: &[Range<usize>], parents: &[u32], merged: &[bool]) -> Supernodes {
    let count = maximal.len();
    // Whom each one ended in, and its members and children as linked lists, lowest first.
    let mut host: Vec<u32> = (0..count as u32).collect();
    let mut next_member = vec![NO_PARENT; count];
    let mut first_member = vec![NO_PARENT; count];
    let mut next_child = vec![NO_PARENT; count];
    let mut first_child = vec![NO_PARENT; count];
    let mut first_root = NO_PARENT;
    for s in (0..count).rev() {
        let parent = parents[s];
        if merged[s] {
            host[s] = host[parent as usize];
        }
        let h = host[s] as usize;
        next_member[s] = first_member[h];
        first_member[h] = s as u32;
        if !merged[s] {
            let list = if parent == NO_PARENT {
                &mut first_root
            } else {
                &mut first_child[host[parent as usize] as usize]
            };
            next_child[s] = *list;
            *list = s as u32;
        }
    }
    let mut result = Supernodes {
        order: Vec::with_capacity(maximal.last().map_or(0, |last| last.end)),
        blocks: Vec::new(),
        parents: Vec::new(),
    };
    let mut number = vec![NO_PARENT; count];
    let mut hosts = Vec::new();
    let mut stack = Vec::new();
    let mut root = first_root;
    while root != NO_PARENT {
        stack.push(root);
        while let Some(&top) = stack.last() {
            let child = first_child[top as usize];
            if child != NO_PARENT {
                first_child[top as usize] = next_child[child as usize];
                stack.push(child);
                continue;
            }
            stack.pop();
            number[top as usize] = result.blocks.len() as u32;
            hosts.push(top);
            let start = result.order.len();
            let mut member = first_member[top as usize];
            while member != NO_PARENT {
                let range = &maximal[member as usize];
                result.order.extend(range.start as u32..range.end as u32);
                member = next_member[member as usize];
            }
            result.blocks.push(start..result.order.len());
        }
        root = next_child[root as usize];
    }
    result.parents = hosts
        .iter()
        .map(|&s| match parents[s as usize] {
            NO_PARENT => NO_PARENT,
            parent => number[host[parent as usize] as usize],
        })
        .collect();
    result
}
