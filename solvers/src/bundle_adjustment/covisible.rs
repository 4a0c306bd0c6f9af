//! Pairs of views that see a common landmark: where each product of an observation pair goes.
//!
//! Every chunk keeps a block for each pair of views that occurs in it (its *slots*), and every pair
//! of observations knows its slot, so that the hot loop only adds. The pairs of a landmark with
//! track length k are stored row by row: (1,0), (2,0), (2,1), …, with the later view first.

use rayon::prelude::*;

use super::layout::Layout;
use super::sorted::Chunk;

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

/// The pairs of every chunk.
pub(super) fn covisible_pairs(layout: &Layout) -> Vec<ChunkPairs> {
    layout.chunks().par_iter().map(|chunk| chunk_pairs(layout, chunk)).collect()
}

fn chunk_pairs(layout: &Layout, chunk: &Chunk) -> ChunkPairs {
    let mut pairs = ChunkPairs::default();
    let first = chunk.observations.start;
    let locals = &layout.sorted.locals;
    let active: Vec<bool> = chunk.views.iter().map(|&view| layout.active[view as usize]).collect();
    let mut total = 0;
    // Position in the track and first pair of the row, for each observation of the chunk.
    let mut rows = vec![(0_u32, 0_u32); chunk.observations.len()];
    for k in chunk.landmarks.clone() {
        pairs.starts.push(total);
        if layout.sorted.constant[k] {
            continue;
        }
        for (i, o) in layout.track(k).enumerate() {
            rows[o - first] = (i as u32, total);
            total += i as u32;
        }
    }
    pairs.slot_of = vec![NO_SLOT; total as usize];
    // Observations by view, so that one stamp a view tells whether a pair was met.
    let count = chunk.views.len();
    let mut next = vec![0_u32; count + 1];
    for &local in &locals[chunk.observations.clone()] {
        next[local as usize + 1] += 1;
    }
    for v in 0..count {
        next[v + 1] += next[v];
    }
    let mut by_view = vec![0_u32; chunk.observations.len()];
    for o in chunk.observations.clone() {
        let slot = &mut next[locals[o] as usize];
        by_view[*slot as usize] = (o - first) as u32;
        *slot += 1;
    }
    let mut stamp = vec![(u32::MAX, 0_u32); count];
    for &o in &by_view {
        let local = locals[first + o as usize];
        if !active[local as usize] {
            continue;
        }
        let (length, row) = rows[o as usize];
        for j in 0..length {
            let other = locals[first + (o - length + j) as usize];
            if !active[other as usize] {
                continue;
            }
            let (owner, slot) = &mut stamp[other as usize];
            if *owner != local {
                (*owner, *slot) = (local, pairs.slots.len() as u32);
                pairs.slots.push((chunk.views[local as usize], chunk.views[other as usize]));
            }
            pairs.slot_of[(row + j) as usize] = *slot;
        }
    }
    pairs
}
