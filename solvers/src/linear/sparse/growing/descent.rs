//! Back substitution from the roots down, only where something changed.
//!
//! A block hands its change on only once it counts; what was not handed on is remembered, so that
//! small changes do not add up unseen.

use super::tree::Node;
use super::{GrowingCholesky, counted};
use crate::linear::sparse::triangular::backward;
use crate::simd::{Kernel, Lanes};

impl<const N: usize> GrowingCholesky<N> {
    /// δ of all blocks to within `tolerance`; see [`Self::solve`].
    pub(super) fn descend(&mut self, tolerance: f64) {
        let mut stack = self.tree.roots.clone();
        let mut front = Vec::new();
        while let Some(number) = stack.pop() {
            let Some(node) = self.tree.node_mut(number) else { continue };
            let is_changed = |&row: &u32| self.changed_in[row as usize] == self.solves;
            if !std::mem::take(&mut node.is_new) && !node.rows().iter().any(is_changed) {
                continue;
            }
            let Some(node) = self.tree.node(number) else { continue };
            stack.extend(self.tree.children(node));
            front.clear();
            front.resize(node.shape::<N>().stride, 0.0);
            self.class.run(Pivots::<N> { node, delta: &self.delta, front: &mut front });
            for (k, &pivot) in node.pivots().iter().enumerate() {
                let range = pivot as usize * N..(pivot as usize + 1) * N;
                let delta = &mut self.delta[range.clone()];
                delta.copy_from_slice(&front[k * N..(k + 1) * N]);
                let seen = &mut self.seen[range.clone()];
                let change = delta.iter().zip(&*seen).map(|(delta, seen)| delta - seen);
                if counted(change, &self.weight[range]) > tolerance {
                    seen.copy_from_slice(delta);
                    self.changed_in[pivot as usize] = self.solves;
                    self.changed.push(pivot);
                }
            }
        }
    }
}

/// The pivots' δ into the head of `front`, from those of the rows.
struct Pivots<'a, const N: usize> {
    node: &'a Node,
    delta: &'a [f64],
    front: &'a mut [f64],
}

impl<const N: usize> Kernel for Pivots<'_, N> {
    type Output = ();

    #[inline(always)]
    fn run<L: Lanes>(self, lanes: L) {
        let Self { node, delta, front } = self;
        let shape = node.shape::<N>();
        let panel = &node.panel.slice()[..shape.panel_size()];
        for (c, column) in panel.chunks_exact(shape.stride).enumerate() {
            front[c] = column[shape.rows];
        }
        for (k, &row) in node.rows().iter().enumerate() {
            front[shape.pivots + k * N..][..N].copy_from_slice(&delta[row as usize * N..][..N]);
        }
        backward(lanes, panel, (shape.stride, shape.pivots), front);
    }
}
