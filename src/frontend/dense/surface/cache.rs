//! Pieces that follow a volume: only what changed is made anew.
//!
//! A piece reads its block and the voxels next to it, so that a changed block makes its own piece and
//! those of its neighbors anew. Volumes may drop blocks and give their slots to others; a slot whose
//! key changed is linked to its neighbors again.

use rayon::prelude::*;

use super::super::block::BlockKey;
use super::super::volume::Volume;
use super::SurfaceOptions;
use super::bits::{Bits, FieldBits, stored_weight};
use super::mesh::{Mesh, join};
use super::piece::{Piece, Source};

/// No slot.
const NONE: u32 = u32::MAX;
/// Slots that a task takes at least.
const SLOTS_A_TASK: usize = 64;

/// The surface of a volume, kept up to date.
#[derive(Clone, Debug)]
pub struct SurfaceCache {
    least_weight: u16,
    /// What is known of each slot's block.
    slots: Vec<Slot>,
    pieces: Vec<Option<Box<Piece>>>,
    /// Which pieces are old.
    stale: Vec<bool>,
}

#[derive(Clone, Debug)]
struct Slot {
    key: BlockKey,
    /// The block's revision that `bits` are of; `None` where they are not made yet.
    revision: Option<u64>,
    bits: Bits,
    sides: u8,
    /// Slots of the blocks around, as in [`FieldBits::of`].
    around: [u32; 27],
}

impl SurfaceCache {
    /// An empty one.
    #[must_use]
    pub fn new(options: SurfaceOptions) -> Self {
        let least_weight = stored_weight(options.least_weight);
        Self { least_weight, slots: Vec::new(), pieces: Vec::new(), stale: Vec::new() }
    }

    /// Follows a volume, always the same one; how many pieces were made anew.
    pub fn update(&mut self, volume: &Volume) -> usize {
        self.link(volume);
        self.look(volume);
        let least = self.stale.iter().filter(|&&stale| stale).count();
        let (slots, voxel_m) = (&self.slots, volume.options().voxel_m);
        let pieces = self.pieces.par_iter_mut().zip(&mut self.stale).enumerate();
        pieces.with_min_len(SLOTS_A_TASK).for_each(|(slot, (piece, stale))| {
            if std::mem::take(stale) {
                remesh(piece, slots, slot, volume, voxel_m);
            }
        });
        least
    }

    /// The whole surface.
    #[must_use]
    pub fn mesh(&self) -> Mesh {
        join(&self.pieces, |slot| {
            // The block itself stands at 13; steps along x, y and z are 1, 3 and 9.
            std::array::from_fn(|k| {
                self.slots[slot].around[13 + (k & 1) + 3 * (k >> 1 & 1) + 9 * (k >> 2)]
            })
        })
    }

    /// Finds neighbors of the blocks that are new or stand in another one's slot.
    fn link(&mut self, volume: &Volume) {
        let keys = volume.keys();
        let kept = keys.len().min(self.slots.len());
        let replaced = (0..kept).filter(|&slot| self.slots[slot].key != keys[slot]);
        let gone: Vec<usize> = replaced.clone().chain(kept..self.slots.len()).collect();
        let new: Vec<usize> = replaced.chain(self.slots.len()..keys.len()).collect();
        for &slot in &gone {
            for (k, neighbor) in self.slots[slot].around.into_iter().enumerate() {
                if neighbor != NONE {
                    self.slots[neighbor as usize].around[26 - k] = NONE;
                    self.stale[neighbor as usize] = true;
                }
            }
        }
        let linked =
            new.par_iter().with_min_len(SLOTS_A_TASK).map(|&slot| Slot::new(volume, keys[slot]));
        let linked: Vec<Slot> = linked.collect();
        self.slots.truncate(keys.len());
        self.pieces.resize_with(keys.len(), || None);
        self.stale.resize(keys.len(), false);
        for (&slot, entry) in new.iter().zip(linked) {
            if slot < self.slots.len() {
                self.slots[slot] = entry;
            } else {
                self.slots.push(entry);
            }
        }
        for &slot in &new {
            for (k, neighbor) in self.slots[slot].around.into_iter().enumerate() {
                if neighbor != NONE {
                    self.slots[neighbor as usize].around[26 - k] = slot as u32;
                }
            }
        }
    }

    /// Takes the bits of blocks that changed, and marks the pieces that read them.
    fn look(&mut self, volume: &Volume) {
        let least_weight = self.least_weight;
        let (blocks, changed) = (volume.blocks(), volume.changed());
        let slots = self.slots.par_iter_mut().enumerate().with_min_len(SLOTS_A_TASK);
        let looked = slots.filter_map(|(slot, entry)| {
            if entry.revision == Some(changed[slot]) {
                return None;
            }
            entry.revision = Some(changed[slot]);
            entry.bits = Bits::of(&blocks[slot], least_weight);
            entry.sides = entry.bits.sides();
            Some(slot)
        });
        for slot in looked.collect::<Vec<_>>() {
            for neighbor in self.slots[slot].around {
                if neighbor != NONE {
                    self.stale[neighbor as usize] = true;
                }
            }
        }
    }
}

impl Slot {
    fn new(volume: &Volume, key: BlockKey) -> Self {
        let around = std::array::from_fn(|k| {
            let step = |coordinate: i32, k: usize| coordinate.checked_add(k as i32 % 3 - 1);
            let slot = (|| {
                let (x, y, z) = (step(key.x, k)?, step(key.y, k / 3)?, step(key.z, k / 9)?);
                volume.slot(BlockKey { x, y, z })
            })();
            slot.map_or(NONE, |slot| slot as u32)
        });
        Self { key, revision: None, bits: Bits::default(), sides: 0, around }
    }
}

/// Makes the piece of a slot anew.
fn remesh(
    piece: &mut Option<Box<Piece>>,
    slots: &[Slot],
    slot: usize,
    volume: &Volume,
    voxel_m: f32,
) {
    let entry = &slots[slot];
    let around = entry.around.map(|neighbor| slots.get(neighbor as usize));
    let sides = around.iter().flatten().fold(0, |sides, entry| sides | entry.sides);
    if sides != 3 {
        *piece = None;
        return;
    }
    let source = Source {
        key: entry.key,
        voxel_m,
        blocks: entry.around.map(|neighbor| volume.blocks().get(neighbor as usize)),
        bits: FieldBits::of(&around.map(|entry| entry.map(|entry| &entry.bits))),
    };
    let mut made = piece.take().unwrap_or_default();
    made.remesh(&source);
    *piece = (!made.is_empty()).then_some(made);
}
