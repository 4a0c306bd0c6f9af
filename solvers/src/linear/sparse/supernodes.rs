//! Supernodes: columns of the factor that are eliminated together.
//!
//! Columns whose structures nest exactly are joined first (fundamental supernodes, and maximal
//! ones). Then a child is merged into its parent wherever the zeros that this stores cost less than
//! the front that it saves, by a model of time (relaxed amalgamation, after Ashcraft and Grimes,
//! "The influence of relaxed supernode partitions on the multifrontal method", 1989).
//! Structure only: no rows are listed here, no values are seen.

use std::ops::Range;

use crate::linear::ordering::{Elimination, NO_PARENT, postorder_of};
use crate::lists::Lists;
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
pub(super) struct Ordered {
    /// The block that is k-th.
    pub(super) order: Vec<u32>,
    /// The position of each block.
    pub(super) position: Vec<u32>,
    /// The supernode of each position.
    pub(super) node_of: Vec<u32>,
}

impl Supernodes {
    /// All of `count` blocks in one, in the order given: a dense factorization.
    pub(super) fn one(count: usize) -> Self {
        let nodes = usize::from(count > 0);
        Self {
            order: (0..count as u32).collect(),
            blocks: vec![0..count; nodes],
            parents: vec![NO_PARENT; nodes],
        }
    }

    /// The positions of blocks that were given in `order`.
    pub(super) fn ordered(&self, order: &[u32]) -> Ordered {
        let order: Vec<u32> = self.order.iter().map(|&k| order[k as usize]).collect();
        let mut position = vec![0; order.len()];
        for (k, &block) in order.iter().enumerate() {
            position[block as usize] = k as u32;
        }
        let node_of = numbers(&self.blocks, order.len());
        Ordered { order, position, node_of }
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
    let node_of = numbers(&maximal, sizes.len());
    let pivots = maximal.iter().map(|range| sizes[range.clone()].iter().sum::<usize>() as f64);
    let mut pivots: Vec<f64> = pivots.collect();
    let tops = || maximal.iter().map(|range| range.end - 1);
    let below: Vec<f64> = tops().map(|top| elimination.heights[top] as f64).collect();
    // Of a root there is no number.
    let parent = |top: usize| node_of.get(elimination.parents[top] as usize).copied();
    let parents: Vec<u32> = tops().map(|top| parent(top).unwrap_or(NO_PARENT)).collect();
    // Children are done before their parents; a merged child hands its own children up.
    let mut merged = vec![false; count];
    for s in (0..count).filter(|&s| parents[s] != NO_PARENT) {
        let p = parents[s] as usize;
        let apart = cost(pivots[s], below[s], front) + cost(pivots[p], below[p], front);
        if cost(pivots[s] + pivots[p], below[p], front) <= apart {
            merged[s] = true;
            pivots[p] += pivots[s];
        }
    }
    renumber(&maximal, &parents, &merged)
}

/// The number of the range that each of `count` blocks is in.
fn numbers(ranges: &[Range<usize>], count: usize) -> Vec<u32> {
    let mut numbers = vec![0; count];
    for (range, s) in ranges.iter().zip(0..) {
        numbers[range.clone()].fill(s);
    }
    numbers
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
    // The supernode that each was merged into, and the parent of each; a merged one has its host as
    // parent.
    let mut host: Vec<u32> = (0..count as u32).collect();
    let mut hung_on = vec![NO_PARENT; count];
    for s in (0..count).rev() {
        if parents[s] != NO_PARENT {
            hung_on[s] = host[parents[s] as usize];
        }
        if merged[s] {
            host[s] = hung_on[s];
        }
    }
    let members = Lists::new(count, host.iter().zip(0..).map(|(&h, s)| (h as usize, s)));
    let mut order = Vec::with_capacity(maximal.last().map_or(0, |last| last.end));
    let mut number = vec![NO_PARENT; count];
    let (mut blocks, mut hosts) = (Vec::new(), Vec::new());
    let kept = (0..count as u32).filter(|&s| !merged[s as usize]);
    for s in postorder_of(&hung_on, kept).into_iter().map(|s| s as usize) {
        number[s] = hosts.len() as u32;
        hosts.push(s);
        let start = order.len();
        for &member in members.of(s) {
            let range = &maximal[member as usize];
            order.extend(range.start as u32..range.end as u32);
        }
        blocks.push(start..order.len());
    }
    // Of a root there is no number.
    let parent = |&s: &usize| number.get(hung_on[s] as usize).copied().unwrap_or(NO_PARENT);
    let parents = hosts.iter().map(parent).collect();
    Supernodes { order, blocks, parents }
}
