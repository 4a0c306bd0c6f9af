//! Stores blocks in slabs of memory: growing moves nothing. Slabs of removed blocks are reused or freed.
//!
//! New slabs are prepared on a separate thread: the first access to fresh memory costs more than the
//! work of a frame on it. Independent of keys and of the content of blocks.

use std::ops::{Index, IndexMut};
use std::sync::mpsc::{Receiver, sync_channel};
use std::sync::{Mutex, PoisonError};
use std::thread;

use rayon::prelude::*;

use super::block::Block;

/// Blocks of a slab: a megabyte.
pub(super) const SLAB: usize = 256;
/// Most slabs that are ready, besides the one being made.
const AHEAD: usize = 8;

/// Slabs of empty blocks.
type Slab = Box<[Block]>;

/// The blocks of a volume, slot by slot.
#[derive(Clone, Debug, Default)]
pub struct Blocks {
    slabs: Vec<Slab>,
    len: usize,
    /// Slots from here on were never used.
    used: usize,
    slab_pool: SlabPool,
}

impl Blocks {
    /// How many there are.
    #[must_use]
    pub fn len(&self) -> usize {
        self.len
    }

    /// Whether there are none.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.len == 0
    }

    /// The block in a slot.
    #[must_use]
    pub fn get(&self, slot: usize) -> Option<&Block> {
        (slot < self.len).then(|| &self[slot])
    }

    /// All of them.
    pub fn iter(&self) -> impl Iterator<Item = &Block> {
        (0..self.len).map(|slot| &self[slot])
    }

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
        if slot < self.len {
            self[slot] = self[self.len].clone();
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
}

impl Index<usize> for Blocks {
    type Output = Block;

    fn index(&self, slot: usize) -> &Block {
        &self.slabs[slot / SLAB][slot % SLAB]
    }
}

impl IndexMut<usize> for Blocks {
    fn index_mut(&mut self, slot: usize) -> &mut Block {
        &mut self.slabs[slot / SLAB][slot % SLAB]
    }
}

/// Slabs that are ready. The thread starts when the first slab is taken and ends with the pool.
#[derive(Debug, Default)]
struct SlabPool {
    /// The mutex is never locked: many threads may read a volume, but only one takes slabs.
    ready: Mutex<Option<Receiver<Slab>>>,
}

impl SlabPool {
    /// Takes a slab that is ready, or makes one.
    fn take(&mut self) -> Slab {
        let ready = self.ready.get_mut().unwrap_or_else(PoisonError::into_inner);
        let ready = ready.get_or_insert_with(|| {
            let (give, take) = sync_channel(AHEAD);
            let make = move || while give.send(fresh()).is_ok() {};
            // Without a thread nothing is ever ready.
            let _ = thread::Builder::new().name("blocks".to_owned()).spawn(make);
            take
        });
        ready.try_recv().unwrap_or_else(|_| fresh())
    }
}

impl Clone for SlabPool {
    fn clone(&self) -> Self {
        Self::default()
    }
}

fn fresh() -> Slab {
    vec![Block::EMPTY; SLAB].into_boxed_slice()
}
