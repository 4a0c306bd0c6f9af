//! Blocks in slabs of memory: growing moves nothing, and what was handed out stays where it is. Knows no
//! keys and does not look into blocks.

use std::ops::{Index, IndexMut, Range};

use super::block::Block;
use super::supply::{SLAB, Slab, Supply};

/// Where the blocks of a volume stand.
#[derive(Clone, Debug, Default)]
pub(super) struct Slabs {
    slabs: Vec<Slab>,
    len: usize,
    supply: Supply,
}

/// The blocks of a volume, slot by slot.
#[derive(Clone, Copy, Debug)]
pub struct Blocks<'a> {
    slabs: &'a Slabs,
}

impl Slabs {
    /// Appends a block of which nothing was seen.
    pub(super) fn push(&mut self) {
        if self.len == self.slabs.len() * SLAB {
            self.slabs.push(self.supply.take());
        }
        self.len += 1;
    }

    /// All blocks in pieces of at most `size`, which divides a slab; what was not pushed yet comes
    /// last and is not to be changed.
    pub(super) fn pieces_mut(&mut self, size: usize) -> Vec<&mut [Block]> {
        self.slabs.iter_mut().flat_map(|slab| slab.chunks_mut(size)).collect()
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

    /// Those of these slots; slots past the last are passed over.
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
