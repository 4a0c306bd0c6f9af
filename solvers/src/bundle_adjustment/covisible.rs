//! Pairs of views that see a common landmark: where each product of an observation pair goes.
//!
//! Every chunk keeps a block for each pair of views that occurs in it (its *slots*), and every pair
//! of observations knows its slot, so that the hot loop only adds. The pairs of a landmark with
//! track length k are stored row by row: (1,0), (2,0), (2,1), …, with the later view first. It reads
//! indices, no values.

use super::layout::Layout;
use super::sorted::Chunk;
use crate::interrupt::Interrupt;
use crate::lists::Lists;
use crate::parallel;

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

/// Pairs between two checks of the interrupt.
const PAIRS_A_LOOK: usize = 1 << 16;

/// The pairs of every chunk, or `None` where the walk was interrupted.
pub(super) fn covisible_pairs(layout: &Layout, interrupt: &Interrupt) -> Option<Vec<ChunkPairs>> {
    let pairs = |chunk| {
        let mut pairs = ChunkPairs::default();
        walk(layout, chunk, interrupt, &mut pairs).then_some(pairs)
    };
    parallel::map(layout.chunks().iter(), pairs).into_iter().collect()
}

/// How many slots [`covisible_pairs`] would have, without forming them; `None` where the walk was
/// interrupted.
pub(super) fn slot_count(layout: &Layout, interrupt: &Interrupt) -> Option<u64> {
    let count = |chunk| {
        let mut slots = Slots::default();
        walk(layout, chunk, interrupt, &mut slots).then_some(u64::from(slots.0))
    };
    parallel::map(layout.chunks().iter(), count).into_iter().sum()
}

/// At least as many slots as there are: no more than pairs of observations, nor than pairs of views.
pub(super) fn most_slots(layout: &Layout) -> u64 {
    let of = |chunk: &Chunk| {
        let views = chunk.views.len() as u64;
        pair_count(layout, chunk).min(views * (views + 1) / 2)
    };
    layout.chunks().iter().map(of).sum()
}

/// Whether the pairs of every chunk can be numbered.
pub(super) fn can_be_numbered(layout: &Layout) -> bool {
    layout.chunks().iter().all(|chunk| pair_count(layout, chunk) < u64::from(NO_SLOT))
}

fn pair_count(layout: &Layout, chunk: &Chunk) -> u64 {
    let moves = chunk.landmarks.clone().filter(|&k| !layout.sorted.constant[k]);
    let length = |k: usize| layout.track(k).len() as u64;
    moves.map(|k| length(k) * (length(k).saturating_sub(1)) / 2).sum()
}

/// What is done with the pairs that a walk meets.
trait Visitor {
    /// First of all: the first pair of each landmark, and the pairs in all.
    fn begin(&mut self, starts: Vec<u32>, total: u32);
    /// Views that meet for the first time; the number of their slot.
    fn slot(&mut self, later: u32, earlier: u32) -> u32;
    /// A pair of observations.
    fn pair(&mut self, pair: usize, slot: u32);
}

impl Visitor for ChunkPairs {
    fn begin(&mut self, starts: Vec<u32>, total: u32) {
        self.starts = starts;
        self.slot_of = vec![NO_SLOT; total as usize];
    }

    fn slot(&mut self, later: u32, earlier: u32) -> u32 {
        self.slots.push((later, earlier));
        self.slots.len() as u32 - 1
    }

    fn pair(&mut self, pair: usize, slot: u32) {
        self.slot_of[pair] = slot;
    }
}

/// Counts slots.
#[derive(Default)]
struct Slots(u32);

impl Visitor for Slots {
    fn begin(&mut self, _starts: Vec<u32>, _total: u32) {}

    fn slot(&mut self, _later: u32, _earlier: u32) -> u32 {
        self.0 += 1;
        self.0 - 1
    }

    fn pair(&mut self, _pair: usize, _slot: u32) {}
}

/// Shows the pairs of a chunk to `visitor`; false where it was interrupted.
fn walk(layout: &Layout, chunk: &Chunk, interrupt: &Interrupt, visitor: &mut impl Visitor) -> bool {
    let first = chunk.observations.start;
    let locals = &layout.sorted.locals;
    let active: Vec<bool> = chunk.views.iter().map(|&view| layout.active[view as usize]).collect();
    let mut total = 0;
    // Position in the track and first pair of the row, for each observation of the chunk.
    let mut rows = vec![(0_u32, 0_u32); chunk.observations.len()];
    let mut starts = Vec::with_capacity(chunk.landmarks.len());
    for k in chunk.landmarks.clone() {
        starts.push(total);
        if layout.sorted.constant[k] {
            continue;
        }
        for (i, o) in layout.track(k).enumerate() {
            rows[o - first] = (i as u32, total);
            total += i as u32;
        }
    }
    visitor.begin(starts, total);
    // Observations by view, so that one stamp a view tells whether a pair was met.
    let count = chunk.views.len();
    let of_view = chunk.observations.clone().map(|o| (locals[o] as usize, (o - first) as u32));
    let by_view = Lists::new(count, of_view).items;
    let mut stamp = vec![(u32::MAX, 0_u32); count];
    let mut unasked = 0;
    for &o in &by_view {
        let local = locals[first + o as usize];
        if !active[local as usize] {
            continue;
        }
        let (length, row) = rows[o as usize];
        unasked += length as usize;
        if unasked >= PAIRS_A_LOOK {
            unasked = 0;
            if interrupt.is_due() {
                return false;
            }
        }
        for j in 0..length {
            let other = locals[first + (o - length + j) as usize];
            if !active[other as usize] {
                continue;
            }
            let (owner, slot) = &mut stamp[other as usize];
            if *owner != local {
                let later = chunk.views[local as usize];
                *owner = local;
                *slot = visitor.slot(later, chunk.views[other as usize]);
            }
            visitor.pair((row + j) as usize, *slot);
        }
    }
    true
}
