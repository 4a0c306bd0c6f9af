//! Pieces that follow a volume: only what changed is made anew.
//!
//! A piece reads its block and the voxels next to it. A block that changed makes its own piece anew,
//! and of its neighbors' those that read its voxels or, where a sign at their border or the sight of it
//! changed, may come to do so. Volumes may drop blocks and give their slots to others; a slot whose key
//! changed is linked to its neighbors again.

use rayon::prelude::*;

use super::super::block::BlockKey;
use super::super::volume::Volume;
use super::SurfaceOptions;
use super::bits::{Bits, FieldBits, borders, stored_weight};
use super::mesh::{Mesh, join};
use super::piece::{MIDDLE, Piece, Source, ones};

/// No slot.
const NONE: u32 = u32::MAX;
/// All 27 blocks around.
const ALL: u32 = (1 << 27) - 1;
/// The revision of a block that was not looked at.
const NEVER: u64 = u64::MAX;
/// Blocks that a task takes at least.
const BLOCKS_A_TASK: usize = 32;

/// The surface of a volume, kept up to date.
#[derive(Clone, Debug)]
pub struct SurfaceCache {
    least_weight: u16,
    // What is known of each slot:
    keys: Vec<BlockKey>,
    /// The revision of the block that its bits are of.
    revisions: Vec<u64>,
    bits: Vec<Bits>,
    sides: Vec<u8>,
    /// Slots of the blocks around, as in [`FieldBits::of`].
    around: Vec<[u32; 27]>,
    pieces: Vec<Option<Box<Piece>>>,
    /// Which of the blocks around have voxels that the piece was made of, as in [`borders`].
    reads: Vec<u32>,
    /// Which of the pieces around are made of the block's voxels: the same, the other way around.
    read_by: Vec<u32>,
    /// The update since which the piece is old, 0 where it is not.
    stale: Vec<u64>,
    /// The slots of old pieces.
    old: Vec<usize>,
    updates: u64,
}

impl SurfaceCache {
    /// An empty one.
    #[must_use]
    pub fn new(options: SurfaceOptions) -> Self {
        Self {
            least_weight: stored_weight(options.least_weight),
            keys: Vec::new(),
            revisions: Vec::new(),
            bits: Vec::new(),
            sides: Vec::new(),
            around: Vec::new(),
            pieces: Vec::new(),
            reads: Vec::new(),
            read_by: Vec::new(),
            stale: Vec::new(),
            old: Vec::new(),
            updates: 0,
        }
    }

    /// Follows a volume, always the same one; how many pieces were made anew.
    pub fn update(&mut self, volume: &Volume) -> usize {
        self.update_oldest(volume, usize::MAX)
    }

    /// As [`SurfaceCache::update`], for a bounded time: of the pieces that are old, `most` are made
    /// anew, those that have been old for longest first. The others' turn comes with later updates;
    /// until then the surface may be torn where old and new meet.
    pub fn update_oldest(&mut self, volume: &Volume, most: usize) -> usize {
        self.updates += 1;
        self.link(volume);
        self.look(volume);
        let mut old = std::mem::take(&mut self.old);
        let tasks = old.par_iter().with_min_len(8 * BLOCKS_A_TASK);
        let both: Vec<bool> = tasks.map(|&slot| self.has_both_sides(slot)).collect();
        for (&slot, _) in old.iter().zip(&both).filter(|(_, both)| !**both) {
            self.keep(slot, None, 0);
            self.stale[slot] = 0;
        }
        let mut both = both.into_iter();
        old.retain(|_| both.next().unwrap_or(false));
        if most < old.len() {
            old.select_nth_unstable_by_key(most, |&slot| (self.stale[slot], slot));
            self.old = old.split_off(most);
        }
        old.sort_unstable();
        let mut made = Vec::with_capacity(old.len());
        for slot in old {
            self.stale[slot] = 0;
            made.push((slot, self.pieces[slot].take(), 0));
        }
        let tasks = made.par_iter_mut().with_min_len(BLOCKS_A_TASK);
        tasks.for_each(|(slot, piece, reads)| {
            (*piece, *reads) = Piece::new(&self.source(volume, *slot), piece.take());
        });
        let count = made.len();
        for (slot, piece, reads) in made {
            self.keep(slot, piece, reads);
        }
        count
    }

    /// Takes over the piece of a slot, and from which blocks it is.
    fn keep(&mut self, slot: usize, piece: Option<Box<Piece>>, reads: u32) {
        let turned = self.reads[slot] ^ reads;
        self.pieces[slot] = piece;
        self.reads[slot] = reads;
        for k in ones(turned.into()) {
            let neighbor = self.around[slot][k];
            if neighbor != NONE {
                self.read_by[neighbor as usize] ^= 1 << (26 - k);
            }
        }
    }

    /// Whether pieces are old that [`SurfaceCache::update_oldest`] left for later.
    #[must_use]
    pub fn is_behind(&self) -> bool {
        !self.old.is_empty()
    }

    /// The whole surface.
    #[must_use]
    pub fn mesh(&self) -> Mesh {
        join(&self.pieces, |slot| {
            let step = |k: usize| (k & 1) + 3 * (k >> 1 & 1) + 9 * (k >> 2);
            std::array::from_fn(|k| self.around[slot][MIDDLE + step(k)])
        })
    }

    /// Finds neighbors of the blocks that are new or stand in another one's slot.
    fn link(&mut self, volume: &Volume) {
        let (old, keys) = (self.keys.len(), volume.keys());
        let kept = old.min(keys.len());
        let replaced: Vec<_> = (0..kept).filter(|&slot| self.keys[slot] != keys[slot]).collect();
        for slot in replaced.iter().copied().chain(kept..old) {
            for (k, neighbor) in self.around[slot].into_iter().enumerate() {
                if neighbor != NONE {
                    self.around[neighbor as usize][26 - k] = NONE;
                    self.read_by[neighbor as usize] &= !(1 << (26 - k));
                    self.mark(neighbor as usize);
                }
            }
        }
        replaced.iter().for_each(|&slot| self.keys[slot] = keys[slot]);
        self.keys.truncate(kept);
        self.keys.extend_from_slice(&keys[kept..]);
        self.revisions.resize(keys.len(), NEVER);
        self.bits.resize(keys.len(), Bits::default());
        self.sides.resize(keys.len(), 0);
        self.around.resize(keys.len(), [NONE; 27]);
        self.pieces.resize_with(keys.len(), || None);
        self.reads.resize(keys.len(), 0);
        self.read_by.resize(keys.len(), 0);
        self.stale.resize(keys.len(), 0);
        self.old.retain(|&slot| slot < keys.len());
        let new: Vec<_> = replaced.into_iter().chain(kept..keys.len()).collect();
        for &slot in &new {
            (self.reads[slot], self.read_by[slot]) = (0, 0);
        }
        let tasks = new.par_iter().with_min_len(BLOCKS_A_TASK);
        let linked: Vec<_> = tasks.map(|&slot| slots_around(volume, keys[slot])).collect();
        for (&slot, around) in new.iter().zip(linked) {
            self.revisions[slot] = NEVER;
            self.around[slot] = around;
            for (k, neighbor) in around.into_iter().enumerate() {
                if neighbor != NONE {
                    let neighbor = neighbor as usize;
                    self.around[neighbor][26 - k] = slot as u32;
                    self.read_by[slot] |= (self.reads[neighbor] >> (26 - k) & 1) << k;
                }
            }
        }
    }

    /// Takes the bits of blocks that changed, and marks the pieces that read them.
    fn look(&mut self, volume: &Volume) {
        let (blocks, changed) = (volume.blocks(), volume.changed());
        let is_old = |&slot: &usize| self.revisions[slot] != changed[slot];
        let old: Vec<_> = (0..changed.len()).filter(is_old).collect();
        let tasks = old.par_iter().with_min_len(BLOCKS_A_TASK);
        let looked: Vec<_> = tasks
            .map(|&slot| {
                let bits = Bits::of(&blocks[slot], self.least_weight);
                let turned = match self.revisions[slot] {
                    NEVER => ALL,
                    _ => borders(&bits.difference(&self.bits[slot])),
                };
                (bits, bits.sides(), turned)
            })
            .collect();
        for (&slot, (bits, sides, turned)) in old.iter().zip(looked) {
            self.revisions[slot] = changed[slot];
            self.sides[slot] = sides;
            self.bits[slot] = bits;
            self.mark(slot);
            for k in ones((turned | self.read_by[slot]).into()) {
                let neighbor = self.around[slot][k];
                if neighbor != NONE {
                    self.mark(neighbor as usize);
                }
            }
        }
    }

    fn mark(&mut self, slot: usize) {
        if self.stale[slot] == 0 {
            self.stale[slot] = self.updates;
            self.old.push(slot);
        }
    }

    /// Whether there are voxels in front of the surface and behind it around a block.
    fn has_both_sides(&self, slot: usize) -> bool {
        let known = self.around[slot].iter().filter(|&&slot| slot != NONE);
        known.fold(0, |sides, &slot| sides | self.sides[slot as usize]) == 3
    }

    /// What the piece of a slot is made of.
    fn source<'a>(&self, volume: &'a Volume, slot: usize) -> Source<'a> {
        let around = self.around[slot].map(|slot| (slot != NONE).then_some(slot as usize));
        let blocks = volume.blocks();
        let around_blocks = around.map(|slot| slot.and_then(|slot| blocks.get(slot)));
        Source {
            key: self.keys[slot],
            voxel_m: volume.options().voxel_m,
            around: around_blocks,
            bits: FieldBits::of(&around.map(|slot| slot.map(|slot| &self.bits[slot]))),
        }
    }
}

/// Slots of the blocks around a key, itself in the middle.
fn slots_around(volume: &Volume, key: BlockKey) -> [u32; 27] {
    let step = |coordinate: i32, k: usize| coordinate.checked_add(k as i32 % 3 - 1);
    std::array::from_fn(|k| {
        let neighbor = step(key.x, k).zip(step(key.y, k / 3)).zip(step(key.z, k / 9));
        let slot = neighbor.and_then(|((x, y), z)| volume.slot(BlockKey { x, y, z }));
        slot.map_or(NONE, |slot| slot as u32)
    })
}
