//! The volume: a sparse grid of blocks, found by hashing.
//!
//! Blocks are in the order of their allocation, except that the last one takes the slot of a removed
//! block. The order depends on frames and poses alone: results do not depend on hashes or threads.
//! They are stored in slabs of memory, so that growing moves nothing. Independent of cameras.

use std::collections::HashMap;
use std::hash::{BuildHasher, Hasher, RandomState};
use std::ops::{Index, IndexMut};
use std::sync::mpsc::{Receiver, sync_channel};
use std::sync::{Mutex, PoisonError};
use std::thread;

use rayon::prelude::*;

use super::block::{Block, BlockKey, EDGE};

/// Blocks of a slab: a megabyte.
const SLAB: usize = 256;
/// Most slabs that are ready, besides the one being made.
const AHEAD: usize = 8;

/// The grid's measures.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct VolumeOptions {
    /// Edge of a voxel, meters.
    pub voxel_m: f32,
    /// Distances are cut off at this, meters.
    pub truncation_m: f32,
}

impl VolumeOptions {
    /// Edge of a block, meters.
    #[must_use]
    pub fn block_m(&self) -> f64 {
        f64::from(self.voxel_m) * EDGE as f64
    }
}

/// A truncated signed distance field with color in sparse blocks.
#[derive(Clone, Debug)]
pub struct Volume {
    options: VolumeOptions,
    slots: HashMap<BlockKey, u32, KeyHashes>,
    keys: Vec<BlockKey>,
    blocks: Blocks,
    states: Vec<State>,
    revision: u64,
}

/// The state of a block besides its voxels.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct State {
    /// The volume's revision at which it changed last.
    pub(super) changed: u64,
    /// Whether it may have voxels at a surface or behind it.
    pub(super) is_solid: bool,
    /// Its largest color change since then, summed over frames.
    pub(super) recolored: u8,
}

/// Adjacent slots that may be changed.
pub(super) struct Piece<'a> {
    pub(super) keys: &'a [BlockKey],
    pub(super) blocks: &'a mut [Block],
    pub(super) states: &'a mut [State],
}

impl Volume {
    /// An empty one.
    #[must_use]
    pub fn new(options: VolumeOptions) -> Self {
        Self {
            options,
            slots: HashMap::default(),
            keys: Vec::new(),
            blocks: Blocks::default(),
            states: Vec::new(),
            revision: 0,
        }
    }

    /// An empty one, with room for this many blocks in its index.
    #[must_use]
    pub fn with_capacity(options: VolumeOptions, blocks: usize) -> Self {
        let mut volume = Self::new(options);
        volume.slots.reserve(blocks);
        volume.keys.reserve_exact(blocks);
        volume.states.reserve_exact(blocks);
        volume
    }

    /// The grid's measures.
    #[must_use]
    pub fn options(&self) -> &VolumeOptions {
        &self.options
    }

    /// How many blocks it has.
    #[must_use]
    pub fn len(&self) -> usize {
        self.keys.len()
    }

    /// Whether it has no blocks.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.keys.is_empty()
    }

    /// The revision, which each integrated frame increases by one.
    #[must_use]
    pub fn revision(&self) -> u64 {
        self.revision
    }

    /// The key of the block in each slot.
    #[must_use]
    pub fn keys(&self) -> &[BlockKey] {
        &self.keys
    }

    /// The blocks, slot by slot.
    #[must_use]
    pub fn blocks(&self) -> &Blocks {
        &self.blocks
    }

    /// The revision at which the block in a slot, which must exist, changed last. Invisible changes of
    /// color alone do not count.
    #[must_use]
    pub fn changed(&self, slot: usize) -> u64 {
        self.states[slot].changed
    }

    /// The slot of a block.
    #[must_use]
    pub fn slot(&self, key: BlockKey) -> Option<usize> {
        self.slots.get(&key).map(|&slot| slot as usize)
    }

    /// The block at a key.
    #[must_use]
    pub fn block(&self, key: BlockKey) -> Option<&Block> {
        self.slot(key).map(|slot| &self.blocks[slot])
    }

    /// Puts a block at a key, replacing any that is there, and returns its slot. This is a new
    /// revision.
    pub fn insert(&mut self, key: BlockKey, block: Block) -> usize {
        let changed = self.advance();
        self.put_back(key, block, State { changed, is_solid: true, recolored: 0 })
    }

    /// Removes the block at a key and returns whether there was one; the last block moves to its slot.
    /// Its memory is kept for other blocks.
    pub fn remove(&mut self, key: BlockKey) -> bool {
        let Some(slot) = self.slots.remove(&key) else { return false };
        let slot = slot as usize;
        self.keys.swap_remove(slot);
        self.blocks.swap_remove(slot);
        self.states.swap_remove(slot);
        if let Some(moved) = self.keys.get(slot) {
            self.slots.insert(*moved, slot as u32);
        }
        true
    }

    /// Frees the memory of removed blocks, except for what `blocks` blocks need.
    pub(super) fn shrink_to(&mut self, blocks: usize) {
        self.blocks.shrink_to(blocks);
    }

    /// How many blocks there is memory for.
    #[cfg(test)]
    pub(super) fn capacity(&self) -> usize {
        self.blocks.capacity()
    }

    /// The states of the blocks, slot by slot.
    pub(super) fn states(&self) -> &[State] {
        &self.states
    }

    /// Puts a block back at a key, with the state that it had when it was removed, and returns its slot.
    pub(super) fn put_back(&mut self, key: BlockKey, block: Block, state: State) -> usize {
        let slot = self.slot(key).unwrap_or_else(|| self.allocate(key));
        self.blocks[slot] = block;
        self.states[slot] = state;
        slot
    }

    /// An empty block at a key that has none.
    pub(super) fn allocate(&mut self, key: BlockKey) -> usize {
        let slot = self.keys.len();
        self.slots.insert(key, slot as u32);
        self.keys.push(key);
        self.blocks.push();
        self.states.push(State { changed: self.revision, is_solid: false, recolored: 0 });
        slot
    }

    /// Begins the next revision.
    pub(super) fn advance(&mut self) -> u64 {
        self.revision += 1;
        self.revision
    }

    /// All slots in pieces of `size`, which divides a slab.
    pub(super) fn pieces_mut(&mut self, size: usize) -> impl ParallelIterator<Item = Piece<'_>> {
        let slabs = self.keys.par_chunks(SLAB).zip(self.blocks.slabs_mut());
        let slabs = slabs.zip(self.states.par_chunks_mut(SLAB));
        slabs.flat_map(move |((keys, slab), states)| {
            let blocks = slab[..keys.len()].par_chunks_mut(size);
            let pieces = keys.par_chunks(size).zip(blocks).zip(states.par_chunks_mut(size));
            pieces.map(|((keys, blocks), states)| Piece { keys, blocks, states })
        })
    }
}

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
    fn push(&mut self) {
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
    fn swap_remove(&mut self, slot: usize) {
        self.len -= 1;
        if slot < self.len {
            self[slot] = self[self.len].clone();
        }
    }

    /// Frees memory that is neither in use nor needed for the first `blocks`.
    fn shrink_to(&mut self, blocks: usize) {
        self.slabs.truncate(self.len.max(blocks).div_ceil(SLAB));
        self.used = self.used.min(self.slabs.len() * SLAB);
    }

    /// How many blocks there is memory for.
    #[cfg(test)]
    fn capacity(&self) -> usize {
        self.slabs.len() * SLAB
    }

    /// All blocks, slab by slab. Slots that were not pushed yet are last and must not be changed.
    fn slabs_mut(&mut self) -> impl IndexedParallelIterator<Item = &mut [Block]> {
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

/// Slabs that are ready, prepared on a separate thread: the first access to fresh memory costs more than
/// the work of a frame on it. The thread starts when the first slab is taken and ends with the pool.
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

/// Hashes of three coordinates: the upper half of a sum of their products with random numbers
/// (Dietzfelbinger, STACS 1996). A file cannot choose keys so that many of them collide, except by
/// luck.
#[derive(Clone, Copy, Debug)]
pub(super) struct KeyHashes([u64; 3]);

impl Default for KeyHashes {
    fn default() -> Self {
        Self(std::array::from_fn(|_| RandomState::new().build_hasher().finish()))
    }
}

impl BuildHasher for KeyHashes {
    type Hasher = KeyHasher;

    fn build_hasher(&self) -> KeyHasher {
        KeyHasher { factors: self.0, sum: 0 }
    }
}

/// A sum of products.
#[derive(Clone, Copy, Debug)]
pub(super) struct KeyHasher {
    factors: [u64; 3],
    sum: u64,
}

impl Hasher for KeyHasher {
    fn finish(&self) -> u64 {
        // Hash tables choose buckets by the lowest bits.
        self.sum.rotate_left(32)
    }

    fn write(&mut self, bytes: &[u8]) {
        for &byte in bytes {
            self.write_i32(i32::from(byte));
        }
    }

    fn write_i32(&mut self, coordinate: i32) {
        let [factor, next, last] = self.factors;
        let product = factor.wrapping_mul(u64::from(coordinate.cast_unsigned()));
        self.sum = self.sum.wrapping_add(product);
        self.factors = [next, last, factor];
    }
}

#[cfg(test)]
mod tests {
    use std::hash::BuildHasher;

    use super::*;

    #[test]
    fn keys_that_are_made_to_collide_do_so_in_one_volume_only() {
        // Differences that one choice of factors maps to the same place; another one does not.
        let hashes = KeyHashes([3 << 40, 5 << 40, 7 << 40]);
        let key = |i: i32| BlockKey { x: 1000 + 5 * i, y: 2000 - 3 * i, z: 9 };
        let first = hashes.hash_one(key(0));
        assert!((0..600).all(|i| hashes.hash_one(key(i)) == first));
        // Most random choices of factors spread the keys.
        let spreads = |_: &usize| {
            let other = KeyHashes::default();
            let mut places: Vec<_> = (0..600).map(|i| other.hash_one(key(i)) & 0x3ff).collect();
            places.sort_unstable();
            places.dedup();
            places.len() > 150
        };
        let spread = (0..40).filter(spreads).count();
        assert!(spread >= 20, "{spread} of 40");
    }
}
