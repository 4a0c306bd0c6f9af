//! What bundle adjustment takes, from the index structure alone.
//!
//! Linear parts are summed from the sizes of what is allocated. What may be quadratic, the pairs of
//! views that see a common landmark and the factorization, is counted before it is formed. Nothing
//! here allocates more than a few numbers a view.

use crate::geometry::{Camera, Se3};
use crate::loss::Loss;
use crate::price::Price;
use crate::problem::BundleProblem;
use crate::simd::Line;

use super::accumulate::ChunkSums;
use super::blocks::Block;
use super::landmarks::LandmarkGroup;
use super::layout::{Layout, Part, View};
use super::observe::ViewRecord;
use super::product::ProductSums;
use super::reduce::SOURCE_BYTES;
use super::sorted::GROUPS;
use super::state_factors::{self, Variable};

/// A vector that grows item by item has up to twice its length, beside its former self.
const GROWTH: u64 = 3;

/// Flops of an observation in the fused pass, the back substitution and the cost, about.
const OBSERVATION_FLOPS: f64 = 1500.0;

/// Flops of an observation in the inner iterations that follow a step under a loss, about.
const INNER_FLOPS: f64 = 2000.0;

/// Flops of an observation in a product of conjugate gradients, and products of a step, about.
const PRODUCT_FLOPS: f64 = 400.0;
const PRODUCTS: f64 = 40.0;

/// What the parts of a solve take, for one set of kernels.
#[derive(Clone, Copy, Debug)]
pub(super) struct Costs {
    /// Whatever solves the reduced system.
    common: Price,
    /// More, for conjugate gradients.
    iterative: u64,
    /// For each slot: a pair of views of a chunk.
    slot: u64,
    /// For each pair of observations.
    pair: u64,
    /// For the pairs' own lists.
    lists: u64,
    pair_flops: f64,
    pairs: u64,
    block_count: u64,
    values_of_all_blocks: u64,
    products: f64,
}

impl Costs {
    pub(super) fn of<const D: usize, const V: usize, const T: usize, const R: usize>(
        problem: &BundleProblem,
        layout: &Layout,
    ) -> Self {
        let sorted = &layout.sorted;
        let count = |n: usize| n as u64;
        let observations = count(sorted.observation_count());
        let landmarks = count(problem.landmarks.len());
        let views = count(layout.views.len());
        let chunk_views: u64 = layout.chunks().iter().map(|c| count(c.views.len())).sum();
        let dimension: usize = layout.block_sizes.iter().sum();
        let squares: usize = layout.block_sizes.iter().map(|n| n * n).sum();
        let blocks = count(layout.block_sizes.len());
        let with_depth = if problem.depth_reprojections.is_empty() { 0 } else { 16 };
        let index = observations * (5 * 4 + 24 + with_depth)
            + landmarks * 24
            + count(sorted.tile_count()) * (4 * GROWTH + count(GROUPS * size_of::<LandmarkGroup>()))
            + views * (count(size_of::<View>() + 4 * size_of::<Part>()) + 8 * GROWTH + 1)
            // Numbers of views within a chunk while it is filled: all chunks may be under way.
            + count(layout.chunks().len()) * views * 4
            + blocks * 16
            + count(problem.poses.len()) * 32
            + count(problem.cameras.len()) * 48;
        let values = landmarks * 4 * 8 * 3
            + count(problem.poses.len() * size_of::<Se3>())
            + count(problem.cameras.len() * size_of::<Camera>())
            + views * count(size_of::<ViewRecord>() + 8 * (8 * V + 8 * T))
            + count(dimension) * 8 * 12;
        let room = sorted.longest_tile + 32;
        let scratch = count(room) * count(ChunkSums::<D, V, T, R>::OBSERVATION_BYTES);
        let is_robust = problem.observation_loss != Loss::Trivial;
        let inner = if is_robust { count(room) * count(size_of::<[Line; 2]>()) } else { 0 };
        let per_chunk = count(layout.chunks().len()) * (scratch + inner + 4096);
        let sums = chunk_views * count(ChunkSums::<D, V, T, R>::VIEW_BYTES)
            + chunk_views * GROWTH * (4 + 2 * (SOURCE_BYTES + 32));
        // The diagonal, and H of the state factors on its own pattern.
        let tied = if state_factors::has_any(problem) {
            let pairs = state_factors::all(problem).flat_map(|factor| factor.pairs());
            let pair_bytes = |(a, b): (Variable, Variable)| count(8 * a.size() * b.size());
            let pairs: u64 = pairs.map(|pair| pair_bytes(pair) + 16 * GROWTH + 24).sum();
            count(squares) * 8 + pairs + blocks * 64
        } else {
            0
        };
        let diagonal = count(squares) * 8 + blocks * 64;
        let bytes = index + values + per_chunk + sums + tied + diagonal;
        let inner_flops = if is_robust { INNER_FLOPS } else { 0.0 };
        let flops_per_iteration = (OBSERVATION_FLOPS + inner_flops) * observations as f64;
        let products = PRODUCTS * PRODUCT_FLOPS * observations as f64;
        let product_bytes = chunk_views * count(8 * (8 * V + 8 * T))
            + count(layout.chunks().len())
                * count(room)
                * count(ProductSums::<D, V, T, R>::OBSERVATION_BYTES);
        let track = if sorted.pair_count == 0 { 0 } else { sorted.longest_track };
        let tracks = count(layout.chunks().len() * track * 3 * (8 * 8 * V + 8));
        Self {
            common: Price { bytes, flops_per_iteration },
            iterative: product_bytes + count(squares) * 8 + count(dimension) * 8 * 6,
            slot: count(size_of::<Block<D, V, T>>()) + 8 * GROWTH + 2 * SOURCE_BYTES * GROWTH,
            pair: 4,
            lists: observations * 12 + landmarks * 4 * GROWTH + views * 16 + tracks,
            pair_flops: 6.0 * (D * D) as f64,
            pairs: count(sorted.pair_count),
            block_count: blocks,
            values_of_all_blocks: (count(dimension).saturating_mul(count(dimension))
                + count(squares))
                / 2,
            products,
        }
    }

    /// What conjugate gradients take.
    pub(super) fn iterative(&self) -> Price {
        let price = self.common.plus_bytes(self.iterative);
        let flops_per_iteration = price.flops_per_iteration + self.products;
        Price { flops_per_iteration, ..price }
    }

    /// What a solve with the matrix takes that has so many slots, without matrix and factor.
    pub(super) fn paired(&self, slots: u64) -> Price {
        let more = slots
            .saturating_mul(self.slot)
            .saturating_add(self.pairs.saturating_mul(self.pair))
            .saturating_add(self.lists);
        let price = self.common.plus_bytes(more);
        let flops_per_iteration = price.flops_per_iteration + self.pair_flops * self.pairs as f64;
        Price { flops_per_iteration, ..price }
    }

    /// The full reduced matrix with its pattern.
    pub(super) fn full_matrix_bytes(&self) -> u64 {
        let blocks = self.block_count.saturating_mul(self.block_count + 1) / 2;
        self.values_of_all_blocks.saturating_mul(8).saturating_add(blocks.saturating_mul(20))
    }

    /// The lists from which a sparse pattern is made of so many slots.
    pub(super) fn pattern_lists(&self, slots: u64) -> u64 {
        slots.saturating_mul(8 + 16 * GROWTH)
    }
}
