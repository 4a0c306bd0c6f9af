//! The numbers of a growing system's fronts: who makes them, and in what order.
//!
//! Memory is given out first. Then subtrees of little work are made side by side, and the fronts above
//! them one after the other, the columns of each dealt out in strips. Each element has one owner and
//! one order of operations, so the bits do not depend on the number of threads.

use rayon::prelude::*;

use super::front::{Shared, Work};
use super::terms::Terms;
use super::top::Top;
use super::tree::{NONE, Node, Tree, shape};
use crate::linear::LinearError;
use crate::simd::Class;

/// A top of fewer flops is made by one task; a subtree with less than this share of them is.
const PARALLEL_FLOPS: f64 = 6e6;
const SHARE: f64 = 1.0 / 6.0;

/// Makes the planned nodes and hangs up the subtrees that stay; the flops. `weight` takes √H.
pub(super) fn eliminate<const N: usize>(
    tree: &mut Tree,
    terms: &Terms<N>,
    top: Top,
    class: Class,
    weight: &mut [f64],
) -> Result<f64, LinearError> {
    let Top { blocks, nodes: planned } = top;
    let count = planned.len();
    let dimension = terms.block_count() * N;
    let mut works: Vec<Work> = Vec::with_capacity(count);
    let mut parents = Vec::with_capacity(count);
    for (s, node) in planned.into_iter().enumerate() {
        let measures = shape(node.pivots * N, (node.blocks.len() - node.pivots) * N);
        let memory = LinearError::OutOfMemory { dimension };
        let panel = tree.take(measures.panel_size()).ok_or_else(|| memory.clone())?;
        let update = tree.take(measures.update_size()).ok_or(memory)?;
        works.push(Work::new(node.blocks, node.pivots, measures, [panel, update], node.orphans));
        parents.push(node.parent);
        works[s].first = s;
    }
    for s in 0..count {
        if parents[s] != NONE {
            let (first, flops) = (works[s].first, works[s].flops);
            let parent = &mut works[parents[s] as usize];
            parent.children.push(s);
            parent.first = parent.first.min(first);
            parent.flops += flops;
        }
    }
    let shared = Shared { tree, terms, class, blocks: blocks.len() };
    let outcome = shared.make_all(&mut works, &parents);
    for &block in &blocks {
        tree.local[block as usize] = NONE;
    }
    outcome?;
    let roots = works.iter().zip(&parents).filter(|(_, parent)| **parent == NONE);
    let flops = roots.map(|(work, _)| work.flops).sum();
    let mut numbers = Vec::with_capacity(count);
    for (work, &parent) in works.into_iter().zip(&parents) {
        let Work { blocks, pivots, panel, update, orphans, children, decrease, weights, .. } = work;
        for (pivot, values) in blocks[..pivots].iter().zip(weights.chunks_exact(N)) {
            weight[*pivot as usize * N..][..N].copy_from_slice(values);
        }
        let number = tree.insert(Node::new(blocks, pivots, [panel, update], decrease));
        for child in children.into_iter().map(|child: usize| numbers[child]).chain(orphans) {
            tree.hang(child, number);
        }
        if parent == NONE {
            tree.roots.push(number);
        }
        numbers.push(number);
    }
    Ok(flops)
}

impl<const N: usize> Shared<'_, N> {
    /// Makes all fronts, which stand in postorder.
    fn make_all(&self, works: &mut [Work], parents: &[u32]) -> Result<(), LinearError> {
        let roots = works.iter().zip(parents).filter(|(_, parent)| **parent == NONE);
        let total: f64 = roots.map(|(work, _)| work.flops).sum();
        if total < PARALLEL_FLOPS || rayon::current_num_threads() < 2 {
            return self.sweep(works, 0, false);
        }
        let is_light = |work: &Work| work.flops < SHARE * total;
        // Light subtrees under heavy parents, from the back; heavy nodes stay one by one.
        let mut light: Vec<(usize, &mut [Work])> = Vec::new();
        let (mut rest, mut end) = (&mut *works, parents.len());
        while end > 0 {
            let begin = if is_light(&rest[end - 1]) { rest[end - 1].first } else { end - 1 };
            let (before, range) = rest.split_at_mut(begin);
            if is_light(&range[range.len() - 1]) {
                light.push((begin, range));
            }
            (rest, end) = (before, begin);
        }
        light
            .par_iter_mut()
            .with_max_len(1)
            .try_for_each(|(first, range)| self.sweep(range, *first, false))?;
        for s in 0..works.len() {
            if !is_light(&works[s]) {
                let (below, own) = works.split_at_mut(s);
                self.make(&mut own[0], below, 0, &mut self.scratch(), true)?;
            }
        }
        Ok(())
    }

    /// Makes a run of nodes whose first has the number `first`, one after the other.
    fn sweep(&self, works: &mut [Work], first: usize, is_dealt: bool) -> Result<(), LinearError> {
        let mut scratch = self.scratch();
        for s in 0..works.len() {
            let (below, own) = works.split_at_mut(s);
            self.make(&mut own[0], below, first, &mut scratch, is_dealt)?;
        }
        Ok(())
    }

    /// Where each block of the top begins in the front at hand.
    fn scratch(&self) -> Vec<u32> {
        vec![NONE; self.blocks]
    }
}
