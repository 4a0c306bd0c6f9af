//! Pairs of views that see a common landmark: where each product of an observation pair goes.
//!
//! Every chunk keeps a block for each pair of views that occurs in it (its *slots*), and every pair
//! of observations knows its slot, so that the hot loop only adds. The pairs of a landmark with
//! track length k are stored row by row: (1,0), (2,0), (2,1), …, with the later view first.

use rayon::prelude::*;

use super::layout::{Chunk, Layout};

/// Marks a pair of observations that has no block: a view that is constant.
pub(super) const NO_SLOT: u32 = u32::MAX;

/// The pairs of one chunk.
#[derive(Debug, Default)]
pub(super) struct ChunkPairs {
    /// The views (later, earlier) of each slot; later ≥ earlier.
    pub(super) slots: Vec<(u32, u32)>,
    /// First pair of each landmark of the chunk, in [`ChunkPairs::slot_of`].
    pub(super) starts: Vec<u32>,
    /// Slot of each pair of observations.
    pub(super) slot_of: Vec<u32>,
}

/// The pairs of every chunk. `constant` has a flag for each landmark of the problem.
pub(super) fn covisible_pairs(layout: &Layout, constant: &[bool]) -> Vec<ChunkPairs> {
    layout.chunks.par_iter().map(|chunk| chunk_pairs(layout, constant, chunk)).collect()
}

fn chunk_pairs(layout: &Layout, constant: &[bool], chunk: &Chunk) -> ChunkPairs {
    let mut pairs = ChunkPairs::default();
    let first = chunk.observations.start;
    let views = &layout.sorted.views;
    let mut total = 0;
    // Position in the track and first pair of the row, for each observation of the chunk.
    let mut rows = vec![(0_u32, 0_u32); chunk.observations.len()];
    for k in chunk.landmarks.clone() {
        pairs.starts.push(total);
        if constant[layout.order[k] as usize] {
            continue;
        }
        for (i, o) in layout.track(k).enumerate() {
            rows[o - first] = (i as u32, total);
            total += i as u32;
        }
    }
    pairs.slot_of = vec![NO_SLOT; total as usize];
    // Observations by view, so that one stamp a view tells whether a pair was met.
    let count = layout.views.len();
    let mut next = vec![0_u32; count + 1];
    for &view in &views[chunk.observations.clone()] {
        next[view as usize + 1] += 1;
    }
    for v in 0..count {
        next[v + 1] += next[v];
    }
    let mut by_view = vec![0_u32; chunk.observations.len()];
    for o in chunk.observations.clone() {
        let slot = &mut next[views[o] as usize];
        by_view[*slot as usize] = (o - first) as u32;
        *slot += 1;
    }
    let mut stamp = vec![(u32::MAX, 0_u32); count];
    for &o in &by_view {
        let view = views[first + o as usize];
        if !layout.is_active(view) {
            continue;
        }
        let (length, row) = rows[o as usize];
        for j in 0..length {
            let other = views[first + (o - length + j) as usize];
            if !layout.is_active(other) {
                continue;
            }
            let (owner, slot) = &mut stamp[other as usize];
            if *owner != view {
                (*owner, *slot) = (view, pairs.slots.len() as u32);
                pairs.slots.push((view, other));
            }
            pairs.slot_of[(row + j) as usize] = *slot;
        }
    }
    pairs
}
