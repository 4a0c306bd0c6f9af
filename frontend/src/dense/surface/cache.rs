//! Keeps the pieces of a volume up to date: only what changed is rebuilt.
//!
//! A piece reads its block and the voxels next to it. When a block changes, its own piece is rebuilt,
//! and those neighboring pieces that read its voxels, or may do so now because a sign or the visibility
//! at the border changed. Each block has a place here, independent of its slot in the volume: blocks
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

/// No slot, or no place.
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
    places: HashMap<BlockKey, u32, KeyHashes>,
    /// Places without a block.
    vacant: Vec<usize>,
    /// The place of the block in each of the volume's slots.
    place_of_slot: Vec<u32>,
    // The state of each place:
    keys: Vec<BlockKey>,
    /// Where the block is in the volume.
    slots: Vec<u32>,
    /// The revision of the block from which its bits were computed.
    revisions: Vec<u64>,
    bits: Vec<Bits>,
    sides: Vec<u8>,
    /// Places of the blocks around, as in [`FieldBits::of`].
    around: Vec<[u32; 27]>,
    pieces: Vec<Option<Box<Piece>>>,
    /// Which of the blocks around the piece reads, as in [`borders`].
    reads: Vec<u32>,
    /// Which of the pieces around read the block: the inverse of `reads`.
    read_by: Vec<u32>,
    /// The update since which the piece is outdated, 0 where it is up to date.
    stale: Vec<u64>,
    /// The places of outdated pieces, in the order in which they became so.
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
            old.into_iter().partition::<Vec<_>, _>(|&place| self.is_in_memory(place));
        let mut made = self.make(volume.resident(), here);
        let mut by_region = BTreeMap::<Region, Vec<usize>>::new();
        for place in away {
            by_region.entry(Region::of(self.keys[place])).or_default().push(place);
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
    fn is_in_memory(&self, place: usize) -> bool {
        let mut known = self.around[place].iter().filter(|&&place| place != NONE);
        known.all(|&place| self.slots[place as usize] != NONE)
    }

    /// The regions that pieces read.
    fn regions_around(&self, places: &[usize]) -> Vec<Region> {
        let known = places.iter().flat_map(|&place| self.around[place]);
        let known = known.filter(|&place| place != NONE);
        let regions: BTreeSet<_> =
            known.map(|place| Region::of(self.keys[place as usize])).collect();
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

    /// The places of at most `most` outdated pieces that must be rebuilt; the rest stays outdated.
    fn oldest(&mut self, most: usize) -> Vec<usize> {
        let mut oldest = Vec::new();
        while oldest.len() < most && !self.old.is_empty() {
            let count = self.old.len().min(most - oldest.len());
            let some: Vec<_> = self.old.drain(..count).collect();
            let tasks = some.par_iter().with_min_len(8 * BLOCKS_A_TASK);
            let both: Vec<bool> = tasks.map(|&place| self.has_both_sides(place)).collect();
            for (place, has_both) in some.into_iter().zip(both) {
                if has_both {
                    oldest.push(place);
                } else {
                    self.keep(place, None, 0);
                    self.stale[place] = 0;
                }
            }
        }
        oldest.sort_unstable();
        oldest
    }

    /// Rebuilds pieces and returns how many.
    fn make(&mut self, volume: &Volume, places: Vec<usize>) -> usize {
        let mut made = Vec::with_capacity(places.len());
        for place in places {
            self.stale[place] = 0;
            made.push((place, self.pieces[place].take(), 0));
        }
        let tasks = made.par_iter_mut().with_min_len(BLOCKS_A_TASK);
        tasks.for_each(|(place, piece, reads)| {
            (*piece, *reads) = Piece::new(&self.source(volume, *place), piece.take());
        });
        let count = made.len();
        for (place, piece, reads) in made {
            self.keep(place, piece, reads);
        }
        count
    }

    /// Stores the piece of a place, and which blocks it reads.
    fn keep(&mut self, place: usize, piece: Option<Box<Piece>>, reads: u32) {
        let turned = self.reads[place] ^ reads;
        self.pieces[place] = piece;
        self.reads[place] = reads;
        for k in ones(turned.into()) {
            let neighbor = self.around[place][k];
            if neighbor != NONE {
                self.read_by[neighbor as usize] ^= 1 << (26 - k);
            }
        }
    }

    /// For how many updates the oldest piece has been outdated; 0 where none is.
    #[must_use]
    pub fn lag(&self) -> u64 {
        let oldest = self.old.iter().map(|&place| self.stale[place]).min();
        oldest.map_or(0, |since| self.updates - since + 1)
    }

    /// The whole surface.
    #[must_use]
    pub fn mesh(&self) -> Mesh {
        join(&self.pieces, |place| {
            let step = |k: usize| (k & 1) + 3 * (k >> 1 & 1) + 9 * (k >> 2);
            std::array::from_fn(|k| self.around[place][MIDDLE + step(k)])
        })
    }

    /// Finds the current slots of the volume's blocks, makes places for new blocks, and frees those of
    /// removed ones.
    fn link(&mut self, volume: &Volume, is_on_disk: impl Fn(BlockKey) -> bool) {
        let (old, keys) = (self.place_of_slot.len(), volume.keys());
        let kept = old.min(keys.len());
        let is_other = |&slot: &usize| self.keys[self.place_of_slot[slot] as usize] != keys[slot];
        let others: Vec<_> = (0..kept).filter(is_other).chain(kept..keys.len()).collect();
        let is_left = |&slot: &usize| slot < old;
        let left = others.iter().copied().filter(is_left).chain(keys.len()..old);
        let left: Vec<_> = left.map(|slot| self.place_of_slot[slot] as usize).collect();
        left.iter().for_each(|&place| self.slots[place] = NONE);
        self.place_of_slot.resize(keys.len(), NONE);
        self.reserve(others.len());
        let mut new = Vec::new();
        for slot in others {
            let place = self.places.get(&keys[slot]).map(|&place| place as usize);
            let place = place.unwrap_or_else(|| {
                let place = self.new_place(keys[slot]);
                new.push(place);
                place
            });
            self.slots[place] = slot as u32;
            self.place_of_slot[slot] = place as u32;
        }
        for place in left {
            if self.slots[place] == NONE && !is_on_disk(self.keys[place]) {
                self.give_up(place);
            }
        }
        let tasks = new.par_iter().with_min_len(BLOCKS_A_TASK);
        let linked: Vec<_> = tasks.map(|&place| self.places_around(self.keys[place])).collect();
        for (&place, around) in new.iter().zip(linked) {
            self.around[place] = around;
            for (k, neighbor) in around.into_iter().enumerate() {
                if neighbor != NONE {
                    let neighbor = neighbor as usize;
                    self.around[neighbor][26 - k] = place as u32;
                    self.read_by[place] |= (self.reads[neighbor] >> (26 - k) & 1) << k;
                }
            }
        }
    }

    /// Reserves memory for `places` more: growing step by step would touch twice as much.
    fn reserve(&mut self, places: usize) {
        self.places.reserve(places);
        self.keys.reserve(places);
        self.slots.reserve(places);
        self.revisions.reserve(places);
        self.bits.reserve(places);
        self.sides.reserve(places);
        self.around.reserve(places);
        self.pieces.reserve(places);
        self.reads.reserve(places);
        self.read_by.reserve(places);
        self.stale.reserve(places);
    }

    /// A place for a block that has none, without neighbors yet.
    fn new_place(&mut self, key: BlockKey) -> usize {
        let place = self.vacant.pop().unwrap_or_else(|| {
            let place = self.keys.len();
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
            place
        });
        self.keys[place] = key;
        self.places.insert(key, place as u32);
        place
    }

    /// Frees the place of a block that is gone.
    fn give_up(&mut self, place: usize) {
        for (k, neighbor) in self.around[place].into_iter().enumerate() {
            if neighbor != NONE {
                self.around[neighbor as usize][26 - k] = NONE;
                self.read_by[neighbor as usize] &= !(1 << (26 - k));
                self.mark(neighbor as usize);
            }
        }
        self.places.remove(&self.keys[place]);
        self.around[place] = [NONE; 27];
        self.pieces[place] = None;
        (self.reads[place], self.read_by[place]) = (0, 0);
        (self.revisions[place], self.sides[place]) = (NEVER, 0);
        self.vacant.push(place);
    }

    /// Computes the bits of changed blocks, and marks the pieces that read them as outdated.
    fn look(&mut self, volume: &Volume) {
        let (blocks, states) = (volume.blocks(), volume.states());
        let places = self.place_of_slot.iter().map(|&place| place as usize).enumerate();
        let is_old =
            |&(slot, place): &(usize, usize)| self.revisions[place] != states[slot].changed;
        let old: Vec<_> = places.filter(is_old).collect();
        let tasks = old.par_iter().with_min_len(BLOCKS_A_TASK);
        let looked: Vec<_> = tasks
            .map(|&(slot, place)| {
                let bits = Bits::of(&blocks[slot]);
                let turned = match self.revisions[place] {
                    NEVER => ALL,
                    _ => borders(&bits.difference(&self.bits[place])),
                };
                (bits, bits.sides(), self.fresh_around(place, turned | self.read_by[place]))
            })
            .collect();
        for (&(slot, place), (bits, sides, fresh)) in old.iter().zip(looked) {
            self.revisions[place] = states[slot].changed;
            self.sides[place] = sides;
            self.bits[place] = bits;
            for k in ones(fresh.into()) {
                self.mark(self.around[place][k] as usize);
            }
        }
    }

    /// The places around one, itself included, whose pieces are not outdated yet.
    fn fresh_around(&self, place: usize, which: u32) -> u32 {
        let which = ones((which | 1 << MIDDLE).into());
        which.fold(0, |fresh, k| {
            let neighbor = self.around[place][k];
            let is_fresh = neighbor != NONE && self.stale[neighbor as usize] == 0;
            fresh | u32::from(is_fresh) << k
        })
    }

    fn mark(&mut self, place: usize) {
        if self.stale[place] == 0 {
            self.stale[place] = self.updates;
            self.old.push_back(place);
        }
    }

    /// Whether there are voxels in front of the surface and behind it around a block.
    fn has_both_sides(&self, place: usize) -> bool {
        let known = self.around[place].iter().filter(|&&place| place != NONE);
        known.fold(0, |sides, &place| sides | self.sides[place as usize]) == 3
    }

    /// The input for the piece of a place.
    fn source<'a>(&self, volume: &'a Volume, place: usize) -> Source<'a> {
        let around = self.around[place].map(|place| (place != NONE).then_some(place as usize));
        let blocks = volume.blocks();
        let around_blocks =
            around.map(|place| place.and_then(|place| blocks.get(self.slots[place] as usize)));
        Source {
            key: self.keys[place],
            voxel_m: volume.options().voxel_m,
            around: around_blocks,
            bits: FieldBits::of(&around.map(|place| place.map(|place| &self.bits[place]))),
        }
    }

    /// Places of the blocks around a key, itself in the middle.
    fn places_around(&self, key: BlockKey) -> [u32; 27] {
        let step = |coordinate: i32, k: usize| coordinate.checked_add(k as i32 % 3 - 1);
        std::array::from_fn(|k| {
            let neighbor = step(key.x, k).zip(step(key.y, k / 3)).zip(step(key.z, k / 9));
            let place = neighbor.and_then(|((x, y), z)| self.places.get(&BlockKey { x, y, z }));
            place.copied().unwrap_or(NONE)
        })
    }
}
