//! Keeps the pieces of a volume up to date: only what changed is rebuilt.
//!
//! A piece reads its block and the voxels next to it. When a block changes, its own piece is rebuilt,
//! and those neighboring pieces that read its voxels, or may do so now because a sign or the visibility
//! at the border changed. Each block has an entry here, independent of its slot in the volume: blocks
//! change slots, and those on disk keep their pieces. A block that is read back is processed again only
//! if it changed. How a piece is made is known to `piece`; the volume is only read.

use std::collections::{BTreeMap, BTreeSet, HashMap, VecDeque};

use rayon::prelude::*;

use super::super::block::BlockKey;
use super::super::page_cache::Region;
use super::super::paged::PagedVolume;
use super::super::pages::PageError;
use super::super::volume::{KeyHashes, Volume};
use super::bits::{Bits, FieldBits, borders};
use super::piece::{MIDDLE, Piece, Source, ones};
use super::{Mesh, join};

/// No slot, or no entry.
const NONE: u32 = u32::MAX;
/// All 27 blocks around.
const ALL: u32 = (1 << 27) - 1;
/// The revision of a block that was not processed yet.
const NEVER: u64 = u64::MAX;
/// Least blocks of a task.
const BLOCKS_A_TASK: usize = 32;
/// Regions that are read from disk at a time.
const REGIONS_AT_A_TIME: usize = 32;

/// The surface of a volume, kept up to date.
#[derive(Clone, Debug, Default)]
pub struct SurfaceCache {
    entries: HashMap<BlockKey, u32, KeyHashes>,
    /// Entries without a block.
    vacant: Vec<usize>,
    /// The entry of the block in each of the volume's slots.
    entry_of_slot: Vec<u32>,
    // The state of each entry:
    keys: Vec<BlockKey>,
    /// Where the block is in the volume.
    slots: Vec<u32>,
    /// The revision of the block from which its bits were computed.
    revisions: Vec<u64>,
    bits: Vec<Bits>,
    sides: Vec<u8>,
    /// Entries of the blocks around, as in [`FieldBits::of`].
    around: Vec<[u32; 27]>,
    pieces: Vec<Option<Box<Piece>>>,
    /// Which of the blocks around the piece reads, as in [`borders`].
    reads: Vec<u32>,
    /// Which of the pieces around read the block: the inverse of `reads`.
    read_by: Vec<u32>,
    /// The update since which the piece is outdated, 0 where it is up to date.
    stale: Vec<u64>,
    /// The entries of outdated pieces, in the order in which they became so.
    old: VecDeque<usize>,
    updates: u64,
    /// The volume's revision up to which blocks on disk were processed too.
    looked: u64,
}

impl SurfaceCache {
    /// Follows a volume, always the same one. Returns how many pieces were rebuilt: at most `most` of the
    /// outdated ones, the oldest first. Later updates rebuild the others; until then the surface may have
    /// cracks where old and new pieces meet. Blocks that changed since the last update, and those that
    /// outdated pieces read, are read from disk step by step; after a frame these are few or none. Pieces,
    /// and 300 bytes of each block, stay in memory.
    ///
    /// # Errors
    /// Blocks cannot be read from disk, or others have no room there. What was not processed or rebuilt
    /// stays outdated then.
    pub fn update(&mut self, volume: &mut PagedVolume, most: usize) -> Result<usize, PageError> {
        self.look_at_paged(volume);
        let changed = volume.on_disk_since(self.looked);
        for regions in changed.chunks(REGIONS_AT_A_TIME) {
            volume.bring(regions)?;
            self.look_at_paged(volume);
        }
        self.looked = volume.resident().revision();
        let old = self.oldest(most);
        let (here, away) =
            old.into_iter().partition::<Vec<_>, _>(|&entry| self.is_in_memory(entry));
        let mut made = self.make(volume.resident(), here);
        let mut by_region = BTreeMap::<Region, Vec<usize>>::new();
        for entry in away {
            by_region.entry(Region::of(self.keys[entry])).or_default().push(entry);
        }
        let mut groups = by_region.into_values();
        for group in groups.by_ref() {
            if let Err(error) = volume.bring(&self.regions_around(&group)) {
                self.old.extend(group.into_iter().chain(groups.flatten()));
                return Err(error);
            }
            self.look_at_paged(volume);
            made += self.make(volume.resident(), group);
        }
        Ok(made)
    }

    /// Whether all blocks that a piece reads are in memory.
    fn is_in_memory(&self, entry: usize) -> bool {
        let mut known = self.around[entry].iter().filter(|&&entry| entry != NONE);
        known.all(|&entry| self.slots[entry as usize] != NONE)
    }

    /// The regions that pieces read.
    fn regions_around(&self, entries: &[usize]) -> Vec<Region> {
        let known = entries.iter().flat_map(|&entry| self.around[entry]);
        let known = known.filter(|&entry| entry != NONE);
        let regions: BTreeSet<_> =
            known.map(|entry| Region::of(self.keys[entry as usize])).collect();
        regions.into_iter().collect()
    }

    fn look_at_paged(&mut self, volume: &PagedVolume) {
        self.look_at(volume.resident(), |key| volume.is_on_disk(Region::of(key)));
    }

    /// Registers what changed in a volume. Missing blocks are on disk, or removed.
    fn look_at(&mut self, volume: &Volume, is_on_disk: impl Fn(BlockKey) -> bool) {
        self.updates += 1;
        self.link(volume, is_on_disk);
        self.look(volume);
    }

    /// The entries of at most `most` outdated pieces that must be rebuilt; the rest stays outdated.
    fn oldest(&mut self, most: usize) -> Vec<usize> {
        let mut oldest = Vec::new();
        while oldest.len() < most && !self.old.is_empty() {
            let count = self.old.len().min(most - oldest.len());
            let some: Vec<_> = self.old.drain(..count).collect();
            let tasks = some.par_iter().with_min_len(8 * BLOCKS_A_TASK);
            let both: Vec<bool> = tasks.map(|&entry| self.has_both_sides(entry)).collect();
            for (entry, has_both) in some.into_iter().zip(both) {
                if has_both {
                    oldest.push(entry);
                } else {
                    self.keep(entry, None, 0);
                    self.stale[entry] = 0;
                }
            }
        }
        oldest.sort_unstable();
        oldest
    }

    /// Rebuilds pieces and returns how many.
    fn make(&mut self, volume: &Volume, entries: Vec<usize>) -> usize {
        let mut made = Vec::with_capacity(entries.len());
        for entry in entries {
            self.stale[entry] = 0;
            made.push((entry, self.pieces[entry].take(), 0));
        }
        let tasks = made.par_iter_mut().with_min_len(BLOCKS_A_TASK);
        tasks.for_each(|(entry, piece, reads)| {
            (*piece, *reads) = Piece::new(&self.source(volume, *entry), piece.take());
        });
        let count = made.len();
        for (entry, piece, reads) in made {
            self.keep(entry, piece, reads);
        }
        count
    }

    /// Stores the piece of an entry, and which blocks it reads.
    fn keep(&mut self, entry: usize, piece: Option<Box<Piece>>, reads: u32) {
        let turned = self.reads[entry] ^ reads;
        self.pieces[entry] = piece;
        self.reads[entry] = reads;
        for k in ones(turned.into()) {
            let neighbor = self.around[entry][k];
            if neighbor != NONE {
                self.read_by[neighbor as usize] ^= 1 << (26 - k);
            }
        }
    }

    /// For how many updates the oldest piece has been outdated; 0 where none is.
    #[must_use]
    pub fn lag(&self) -> u64 {
        let oldest = self.old.iter().map(|&entry| self.stale[entry]).min();
        oldest.map_or(0, |since| self.updates - since + 1)
    }

    /// The whole surface.
    #[must_use]
    pub fn mesh(&self) -> Mesh {
        join(&self.pieces, |entry| {
            let step = |k: usize| (k & 1) + 3 * (k >> 1 & 1) + 9 * (k >> 2);
            std::array::from_fn(|k| self.around[entry][MIDDLE + step(k)])
        })
    }

    /// Finds the current slots of the volume's blocks, makes entries for new blocks, and frees those of
    /// removed ones.
    fn link(&mut self, volume: &Volume, is_on_disk: impl Fn(BlockKey) -> bool) {
        let (old, keys) = (self.entry_of_slot.len(), volume.keys());
        let kept = old.min(keys.len());
        let is_other = |&slot: &usize| self.keys[self.entry_of_slot[slot] as usize] != keys[slot];
        let others: Vec<_> = (0..kept).filter(is_other).chain(kept..keys.len()).collect();
        let is_left = |&slot: &usize| slot < old;
        let left = others.iter().copied().filter(is_left).chain(keys.len()..old);
        let left: Vec<_> = left.map(|slot| self.entry_of_slot[slot] as usize).collect();
        left.iter().for_each(|&entry| self.slots[entry] = NONE);
        self.entry_of_slot.resize(keys.len(), NONE);
        self.reserve(others.len());
        let mut new = Vec::new();
        for slot in others {
            let entry = self.entries.get(&keys[slot]).map(|&entry| entry as usize);
            let entry = entry.unwrap_or_else(|| {
                let entry = self.new_entry(keys[slot]);
                new.push(entry);
                entry
            });
            self.slots[entry] = slot as u32;
            self.entry_of_slot[slot] = entry as u32;
        }
        for entry in left {
            if self.slots[entry] == NONE && !is_on_disk(self.keys[entry]) {
                self.give_up(entry);
            }
        }
        let tasks = new.par_iter().with_min_len(BLOCKS_A_TASK);
        let linked: Vec<_> = tasks.map(|&entry| self.places_around(self.keys[entry])).collect();
        for (&entry, around) in new.iter().zip(linked) {
            self.around[entry] = around;
            for (k, neighbor) in around.into_iter().enumerate() {
                if neighbor != NONE {
                    let neighbor = neighbor as usize;
                    self.around[neighbor][26 - k] = entry as u32;
                    self.read_by[entry] |= (self.reads[neighbor] >> (26 - k) & 1) << k;
                }
            }
        }
    }

    /// Reserves memory for `entries` more: growing step by step would touch twice as much.
    fn reserve(&mut self, entries: usize) {
        self.entries.reserve(entries);
        self.keys.reserve(entries);
        self.slots.reserve(entries);
        self.revisions.reserve(entries);
        self.bits.reserve(entries);
        self.sides.reserve(entries);
        self.around.reserve(entries);
        self.pieces.reserve(entries);
        self.reads.reserve(entries);
        self.read_by.reserve(entries);
        self.stale.reserve(entries);
    }

    /// An entry for a block that has none, without neighbors yet.
    fn new_entry(&mut self, key: BlockKey) -> usize {
        let entry = self.vacant.pop().unwrap_or_else(|| {
            let entry = self.keys.len();
            self.keys.push(key);
            self.slots.push(NONE);
            self.revisions.push(NEVER);
            self.bits.push(Bits::default());
            self.sides.push(0);
            self.around.push([NONE; 27]);
            self.pieces.push(None);
            self.reads.push(0);
            self.read_by.push(0);
            self.stale.push(0);
            entry
        });
        self.keys[entry] = key;
        self.entries.insert(key, entry as u32);
        entry
    }

    /// Frees the entry of a block that is gone.
    fn give_up(&mut self, entry: usize) {
        for (k, neighbor) in self.around[entry].into_iter().enumerate() {
            if neighbor != NONE {
                self.around[neighbor as usize][26 - k] = NONE;
                self.read_by[neighbor as usize] &= !(1 << (26 - k));
                self.mark(neighbor as usize);
            }
        }
        self.entries.remove(&self.keys[entry]);
        self.around[entry] = [NONE; 27];
        self.pieces[entry] = None;
        (self.reads[entry], self.read_by[entry]) = (0, 0);
        (self.revisions[entry], self.sides[entry]) = (NEVER, 0);
        self.vacant.push(entry);
    }

    /// Computes the bits of changed blocks, and marks the pieces that read them as outdated.
    fn look(&mut self, volume: &Volume) {
        let (blocks, states) = (volume.blocks(), volume.states());
        let entries = self.entry_of_slot.iter().map(|&entry| entry as usize).enumerate();
        let is_old =
            |&(slot, entry): &(usize, usize)| self.revisions[entry] != states[slot].changed;
        let old: Vec<_> = entries.filter(is_old).collect();
        let tasks = old.par_iter().with_min_len(BLOCKS_A_TASK);
        let looked: Vec<_> = tasks
            .map(|&(slot, entry)| {
                let bits = Bits::of(&blocks[slot]);
                let turned = match self.revisions[entry] {
                    NEVER => ALL,
                    _ => borders(&bits.difference(&self.bits[entry])),
                };
                (bits, bits.sides(), self.fresh_around(entry, turned | self.read_by[entry]))
            })
            .collect();
        for (&(slot, entry), (bits, sides, fresh)) in old.iter().zip(looked) {
            self.revisions[entry] = states[slot].changed;
            self.sides[entry] = sides;
            self.bits[entry] = bits;
            for k in ones(fresh.into()) {
                self.mark(self.around[entry][k] as usize);
            }
        }
    }

    /// The entries around one, itself included, whose pieces are not outdated yet.
    fn fresh_around(&self, entry: usize, which: u32) -> u32 {
        let which = ones((which | 1 << MIDDLE).into());
        which.fold(0, |fresh, k| {
            let neighbor = self.around[entry][k];
            let is_fresh = neighbor != NONE && self.stale[neighbor as usize] == 0;
            fresh | u32::from(is_fresh) << k
        })
    }

    fn mark(&mut self, entry: usize) {
        if self.stale[entry] == 0 {
            self.stale[entry] = self.updates;
            self.old.push_back(entry);
        }
    }

    /// Whether there are voxels in front of the surface and behind it around a block.
    fn has_both_sides(&self, entry: usize) -> bool {
        let known = self.around[entry].iter().filter(|&&entry| entry != NONE);
        known.fold(0, |sides, &entry| sides | self.sides[entry as usize]) == 3
    }

    /// The input for the piece of an entry.
    fn source<'a>(&self, volume: &'a Volume, entry: usize) -> Source<'a> {
        let around = self.around[entry].map(|entry| (entry != NONE).then_some(entry as usize));
        let blocks = volume.blocks();
        let around_blocks =
            around.map(|entry| entry.and_then(|entry| blocks.get(self.slots[entry] as usize)));
        Source {
            key: self.keys[entry],
            voxel_m: volume.options().voxel_m,
            around: around_blocks,
            bits: FieldBits::of(&around.map(|entry| entry.map(|entry| &self.bits[entry]))),
        }
    }

    /// Entries of the blocks around a key, itself in the middle.
    fn places_around(&self, key: BlockKey) -> [u32; 27] {
        let step = |coordinate: i32, k: usize| coordinate.checked_add(k as i32 % 3 - 1);
        std::array::from_fn(|k| {
            let neighbor = step(key.x, k).zip(step(key.y, k / 3)).zip(step(key.z, k / 9));
            let entry = neighbor.and_then(|((x, y), z)| self.entries.get(&BlockKey { x, y, z }));
            entry.copied().unwrap_or(NONE)
        })
    }
}
