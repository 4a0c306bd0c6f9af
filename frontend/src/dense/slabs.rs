//! Stores blocks in slabs of memory: growing moves nothing. Slabs of removed blocks are reused or
//! freed. Independent of keys and of the content of blocks.

use std::ops::{Index, IndexMut, Range};

use rayon::prelude::*;

use super::block::Block;
use super::slab_pool::{SLAB, Slab, SlabPool};

/// The storage of a volume's blocks.
#[derive(Clone, Debug, Default)]
pub(super) struct Slabs {
    slabs: Vec<Slab>,
    len: usize,
    /// Slots from here on were never used.
    used: usize,
    slab_pool: SlabPool,
}

/// The blocks of a volume, slot by slot.
#[derive(Clone, Copy, Debug)]
pub struct Blocks<'a> {
    slabs: &'a Slabs,
}

impl Slabs {
    /// Appends an empty block.
    pub(super) fn push(&mut self) {
        if self.len == self.slabs.len() * SLAB {
            self.slabs.push(self.slab_pool.take());
        }
        let slot = self.len;
        self.len += 1;
        if slot < self.used {
            self[slot] = Block::EMPTY;
        }
        self.used = self.used.max(self.len);
    }

    /// Removes the block in a slot, which must exist; the last block moves to its slot.
    pub(super) fn swap_remove(&mut self, slot: usize) {
        self.len -= 1;
        let (slab, last) = (slot / SLAB, self.len / SLAB);
        if let Ok([slab, last]) = self.slabs.get_disjoint_mut([slab, last]) {
            slab[slot % SLAB].clone_from(&last[self.len % SLAB]);
        } else {
            let (slots, end) = self.slabs[last].split_at_mut(self.len % SLAB);
            if let (Some(slot), Some(end)) = (slots.get_mut(slot % SLAB), end.first()) {
                slot.clone_from(end);
            }
        }
    }

    /// Frees memory that is neither in use nor needed for the first `blocks`.
    pub(super) fn shrink_to(&mut self, blocks: usize) {
        self.slabs.truncate(self.len.max(blocks).div_ceil(SLAB));
        self.used = self.used.min(self.slabs.len() * SLAB);
    }

    /// How many blocks there is memory for.
    #[cfg(test)]
    pub(super) fn capacity(&self) -> usize {
        self.slabs.len() * SLAB
    }

    /// All blocks, slab by slab. Slots that were not pushed yet are last and must not be changed.
    pub(super) fn slabs_mut(&mut self) -> impl IndexedParallelIterator<Item = &mut [Block]> {
        self.slabs.par_iter_mut().map(|slab| &mut slab[..])
    }

    pub(super) fn view(&self) -> Blocks<'_> {
        Blocks { slabs: self }
    }
}

impl Index<usize> for Slabs {
    type Output = Block;

    fn index(&self, slot: usize) -> &Block {
        &self.slabs[slot / SLAB][slot % SLAB]
    }
}

impl IndexMut<usize> for Slabs {
    fn index_mut(&mut self, slot: usize) -> &mut Block {
        &mut self.slabs[slot / SLAB][slot % SLAB]
    }
}

impl<'a> Blocks<'a> {
    /// How many there are.
    #[must_use]
    pub fn len(&self) -> usize {
        self.slabs.len
    }

    /// Whether there are none.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.slabs.len == 0
    }

    /// The block in a slot.
    #[must_use]
    pub fn get(&self, slot: usize) -> Option<&'a Block> {
        (slot < self.slabs.len).then(|| &self.slabs[slot])
    }

    /// All of them.
    pub fn iter(&self) -> impl Iterator<Item = &'a Block> + use<'a> {
        self.range(0..self.slabs.len)
    }

    /// The blocks of these slots; slots past the last are skipped.
    pub fn range(&self, slots: Range<usize>) -> impl Iterator<Item = &'a Block> + use<'a> {
        let slabs = self.slabs;
        (slots.start..slots.end.min(slabs.len)).map(move |slot| &slabs[slot])
    }
}

impl Index<usize> for Blocks<'_> {
    type Output = Block;

    fn index(&self, slot: usize) -> &Block {
        &self.slabs[slot]
    }
}
