//! The volume: a sparse grid of blocks, found by hashing.
//!
//! Blocks stand in the order in which they were allocated, which depends on frames and poses alone:
//! results do not depend on hashes or threads. Knows no cameras.

use std::collections::HashMap;

use super::block::{Block, BlockKey};

/// The grid's measures.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct VolumeOptions {
    /// Edge of a voxel, meters.
    pub voxel_m: f32,
    /// Distances are cut off at this, meters.
    pub truncation_m: f32,
}

/// A truncated signed distance field with color in sparse blocks.
#[derive(Clone, Debug)]
pub struct Volume {
    options: VolumeOptions,
    slots: HashMap<BlockKey, u32>,
    keys: Vec<BlockKey>,
    blocks: Vec<Block>,
    /// The volume's revision at which each block changed last.
    changed: Vec<u64>,
    revision: u64,
}

impl Volume {
    /// An empty one.
    #[must_use]
    pub fn new(options: VolumeOptions) -> Self {
        Self {
            options,
            slots: HashMap::new(),
            keys: Vec::new(),
            blocks: Vec::new(),
            changed: Vec::new(),
            revision: 0,
        }
    }

    /// An empty one with room for so many blocks, and no more.
    #[must_use]
    pub fn with_capacity(options: VolumeOptions, blocks: usize) -> Self {
        let mut volume = Self::new(options);
        volume.slots.reserve(blocks);
        volume.keys.reserve_exact(blocks);
        volume.blocks.reserve_exact(blocks);
        volume.changed.reserve_exact(blocks);
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
        self.blocks.len()
    }

    /// Whether nothing was seen yet.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.blocks.is_empty()
    }

    /// The revision: one more with each frame that was integrated.
    #[must_use]
    pub fn revision(&self) -> u64 {
        self.revision
    }

    /// Which block stands in a slot.
    #[must_use]
    pub fn keys(&self) -> &[BlockKey] {
        &self.keys
    }

    /// The blocks, slot by slot.
    #[must_use]
    pub fn blocks(&self) -> &[Block] {
        &self.blocks
    }

    /// The revision at which the block of each slot changed last.
    #[must_use]
    pub fn changed(&self) -> &[u64] {
        &self.changed
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

    /// Puts a block at a key, in place of the one that is there, and tells its slot. That is a
    /// revision of its own.
    pub fn insert(&mut self, key: BlockKey, block: Block) -> usize {
        self.revision += 1;
        let slot = *self.slots.entry(key).or_insert(self.keys.len() as u32) as usize;
        if slot == self.keys.len() {
            self.keys.push(key);
            self.blocks.push(block);
            self.changed.push(self.revision);
        } else {
            self.blocks[slot] = block;
            self.changed[slot] = self.revision;
        }
        slot
    }
}
