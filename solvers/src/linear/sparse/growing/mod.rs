//! A factorization that grows: new blocks and new terms cost what they touch.
//!
//! H δ = −g, where H and g are sums of terms over pairs of blocks that are added or replaced between
//! solves (a pose graph's edges). The elimination tree is kept with each node's front. What a changed
//! term reaches are the nodes on the way from its blocks to the root, the top: these alone are ordered
//! and factored again; the subtrees below them keep their update matrices, which are added. Back
//! substitution goes down only where the solution changed. (Kaess, Johannsson, Roberts, Ila, Leonard,
//! Dellaert, "iSAM2", 2012, on supernodes; the right-hand side is one more row of each front.)
//!
//! - `terms`: what is summed; `tree`: nodes and their memory; `top`: which nodes are made anew, in
//!   which order; `fronts`: their numbers.
//!
//! Large tops are eliminated on the rayon pool of the caller; the bits do not depend on it. It knows
//! nothing of poses.

mod fronts;
mod terms;
#[cfg(test)]
mod tests;
mod top;
mod tree;

use nalgebra::SVector;

use crate::linear::error::LinearError;
use crate::linear::sparse::triangular::backward;
use crate::simd::{Class, Kernel, Lanes};

use fronts::eliminate;
pub use terms::PairTerm;
use terms::Terms;
use top::Top;
use tree::{NONE, Node, Tree};

/// A growing system of blocks of `N` scalars, with its factor and its solution.
#[derive(Debug)]
pub struct GrowingCholesky<const N: usize> {
    terms: Terms<N>,
    tree: Tree,
    /// Blocks whose terms changed since the last update.
    touched: Vec<u32>,
    /// δ, N scalars a block.
    delta: Vec<f64>,
    /// δ as the nodes below a block have seen it.
    seen: Vec<f64>,
    /// √H of each scalar: what a change of it counts.
    weight: Vec<f64>,
    /// Blocks whose δ changed in the last solve, and the mark of the solve by block.
    changed: Vec<u32>,
    changed_in: Vec<u32>,
    solves: u32,
    class: Class,
}

/// What an update did.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Updated {
    /// Blocks that were eliminated anew.
    pub blocks: usize,
    /// Nodes that they became.
    pub nodes: usize,
    /// Flops of their elimination.
    pub flops: f64,
}

impl<const N: usize> GrowingCholesky<N> {
    /// A system without blocks.
    #[must_use]
    pub fn new() -> Self {
        Self {
            terms: Terms::default(),
            tree: Tree::default(),
            touched: Vec::new(),
            delta: Vec::new(),
            seen: Vec::new(),
            weight: Vec::new(),
            changed: Vec::new(),
            changed_in: Vec::new(),
            solves: 0,
            class: Class::detect(),
        }
    }

    /// Number of blocks.
    #[must_use]
    pub fn block_count(&self) -> usize {
        self.terms.block_count()
    }

    /// Appends a block without terms and returns its number.
    pub fn push_block(&mut self) -> usize {
        self.terms.push_block();
        self.tree.push_block();
        self.delta.extend([0.0; N]);
        self.seen.extend([0.0; N]);
        self.weight.extend([0.0; N]);
        self.changed_in.push(0);
        self.touched.push(self.block_count() as u32 - 1);
        self.block_count() - 1
    }

    /// Appends a term over blocks i and j and returns its number; `None` stands for what is held
    /// fixed. The two must differ.
    pub fn push_term(&mut self, i: Option<usize>, j: Option<usize>, term: PairTerm<N>) -> usize {
        debug_assert!(i != j, "a term over block {i:?} twice");
        let number = self.terms.push(i, j, term);
        self.touch(number);
        number
    }

    /// Replaces a term.
    pub fn set_term(&mut self, number: usize, term: PairTerm<N>) {
        self.terms.set(number, term);
        self.touch(number);
    }

    fn touch(&mut self, number: usize) {
        self.touched.extend(self.terms.ends[number].iter().filter(|&&block| block != NONE));
    }

    /// δ of a block.
    #[must_use]
    pub fn delta(&self, block: usize) -> SVector<f64, N> {
        SVector::from_column_slice(&self.delta[block * N..][..N])
    }

    /// What a change of a block's δ counts: its largest entry, in standard deviations were all other
    /// scalars held fixed.
    #[must_use]
    pub fn counts(&self, block: usize, change: &SVector<f64, N>) -> f64 {
        counted(change.iter().copied(), &self.weight[block * N..][..N])
    }

    /// Says that a block's δ was taken into what its terms are made at: it begins at zero again.
    /// All terms of the block must be replaced before the next update.
    pub fn rebase(&mut self, block: usize) {
        self.delta[block * N..][..N].fill(0.0);
        self.seen[block * N..][..N].fill(0.0);
    }

    /// Number of terms.
    #[must_use]
    pub fn term_count(&self) -> usize {
        self.terms.count()
    }

    /// Numbers in the factor: what a whole back substitution reads.
    #[must_use]
    pub fn factor_entries(&self) -> usize {
        self.tree.entries
    }

    /// The cost at δ that the last update predicts: that of the terms less ½ gᵀH⁻¹g.
    #[must_use]
    pub fn predicted_cost(&self) -> f64 {
        self.terms.cost - self.tree.decrease
    }

    /// The numbers of a block's terms.
    #[must_use]
    pub fn terms_of(&self, block: usize) -> &[u32] {
        self.terms.of(block)
    }

    /// Factors what changed. Blocks in `last` are eliminated as late as can be: those that the next
    /// terms will touch.
    ///
    /// # Errors
    /// Not positive definite, not finite. Everything is then eliminated anew in the next update.
    pub fn update(&mut self, last: &[usize]) -> Result<Updated, LinearError> {
        let top = Top::of(&self.terms, &mut self.tree, &self.touched, last);
        self.touched.clear();
        let (blocks, nodes) = (top.blocks.len(), top.nodes.len());
        let outcome = eliminate(&mut self.tree, &self.terms, top, self.class, &mut self.weight);
        if outcome.is_err() {
            self.tree.clear();
            self.touched.extend(0..self.block_count() as u32);
        }
        outcome.map(|flops| Updated { blocks, nodes, flops })
    }

    /// Solves for δ with the last factor, and returns the blocks whose δ changed.
    ///
    /// A change that counts less than `tolerance` (in standard deviations of the block were all
    /// others held fixed) is not handed down to the blocks eliminated before.
    pub fn solve(&mut self, tolerance: f64) -> &[u32] {
        self.solves += 1;
        self.changed.clear();
        self.descend(tolerance);
        &self.changed
    }

    /// Back substitution from the roots down, only where something changed. A block hands its change
    /// on only once it counts; what was not handed on is remembered in `seen`, so that small changes
    /// do not add up unseen.
    fn descend(&mut self, tolerance: f64) {
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

impl<const N: usize> Default for GrowingCholesky<N> {
    fn default() -> Self {
        Self::new()
    }
}

/// The largest change, each by its weight.
fn counted(change: impl Iterator<Item = f64>, weights: &[f64]) -> f64 {
    change.zip(weights).fold(0.0, |most, (change, weight)| most.max(change.abs() * weight))
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
        backward(lanes, panel, shape.stride, shape.pivots, front);
    }
}
