//! What a growing system is the sum of: terms over pairs of blocks, and which block has which.
//!
//! It sums nothing but the cost; a front sums the terms of its pivots when it is made.

use nalgebra::{SMatrix, SVector};

use super::tree::NONE;

/// One term's share of H and g, over blocks i and j.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PairTerm<const N: usize> {
    /// Block (i, i).
    pub h_ii: SMatrix<f64, N, N>,
    /// Block (i, j).
    pub h_ij: SMatrix<f64, N, N>,
    /// Block (j, j).
    pub h_jj: SMatrix<f64, N, N>,
    /// Gradient of block i.
    pub g_i: SVector<f64, N>,
    /// Gradient of block j.
    pub g_j: SVector<f64, N>,
    /// The term's share of the cost at δ = 0.
    pub cost: f64,
}

impl<const N: usize> PairTerm<N> {
    /// All zero.
    #[must_use]
    pub fn zeros() -> Self {
        let (h, g) = (SMatrix::zeros(), SVector::zeros());
        Self { h_ii: h, h_ij: h, h_jj: h, g_i: g, g_j: g, cost: 0.0 }
    }
}

/// The terms of a growing system.
#[derive(Debug, Default)]
pub(super) struct Terms<const N: usize> {
    terms: Vec<PairTerm<N>>,
    /// Blocks i and j of each term, or [`NONE`].
    pub(super) ends: Vec<[u32; 2]>,
    of: Vec<Vec<u32>>,
    /// The sum of their costs.
    pub(super) cost: f64,
}

impl<const N: usize> Terms<N> {
    pub(super) fn block_count(&self) -> usize {
        self.of.len()
    }

    pub(super) fn count(&self) -> usize {
        self.terms.len()
    }

    pub(super) fn push_block(&mut self) {
        self.of.push(Vec::new());
    }

    pub(super) fn push(&mut self, i: Option<usize>, j: Option<usize>, term: PairTerm<N>) -> usize {
        let number = self.terms.len();
        for block in [i, j].into_iter().flatten() {
            self.of[block].push(number as u32);
        }
        self.cost += term.cost;
        self.ends.push([i, j].map(|block| block.map_or(NONE, |block| block as u32)));
        self.terms.push(term);
        number
    }

    pub(super) fn set(&mut self, number: usize, term: PairTerm<N>) {
        self.cost += term.cost - self.terms[number].cost;
        self.terms[number] = term;
    }

    /// The terms of a block.
    pub(super) fn of(&self, block: usize) -> &[u32] {
        &self.of[block]
    }

    /// The terms of a block, each with the block at its other end, or [`NONE`], and whether the
    /// block is its i.
    pub(super) fn incident(&self, block: u32) -> impl Iterator<Item = (&PairTerm<N>, u32, bool)> {
        self.of[block as usize].iter().map(move |&number| {
            let [i, j] = self.ends[number as usize];
            let is_i = i == block;
            (&self.terms[number as usize], if is_i { j } else { i }, is_i)
        })
    }
}
