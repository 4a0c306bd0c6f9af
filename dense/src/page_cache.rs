//! Decides which regions stay in memory: those that are needed, and of the others the most recently
//! needed.
//!
//! When there are more blocks in memory than the ceiling allows, the least recently needed regions are
//! evicted to the page file. A region that is read back keeps its page until a frame may have changed
//! it, so that reading a volume writes nothing. Independent of cameras and frames.

use std::collections::BTreeMap;
use std::io;
use std::path::Path;

use nalgebra::Vector3;
use rayon::prelude::*;

use super::block::{Block, BlockKey, EDGE};
use super::packing::{from_page, to_page};
use super::pages::{Page, PageError, PageFile};
use super::volume::{State, Volume, VolumeOptions};

/// Once the ceiling is reached, eviction makes room for this many blocks below it, or an eighth of it
/// where that is less: not every frame pages, and none waits for long.
const SLACK: usize = 512;
/// Regions that are packed or unpacked at a time.
const REGIONS_AT_A_TIME: usize = 32;
/// Blocks along an edge of a region, as a power of two.
const SHIFT: i32 = 2;
const BLOCKS: i32 = 1 << SHIFT;

/// A region of the grid: 4 × 4 × 4 blocks that are evicted and read back together; by its coordinates in
/// regions.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(super) struct Region([i32; 3]);

impl Region {
    /// The region of a block.
    pub(super) fn of(key: BlockKey) -> Self {
        Self([key.x, key.y, key.z].map(|k| k >> SHIFT))
    }

    /// Its middle and half of its edge, meters.
    pub(super) fn cube(self, options: &VolumeOptions) -> (Vector3<f64>, f64) {
        let half = f64::from(BLOCKS) * 0.5;
        let middle = self.0.map(|k| f64::from(k) * f64::from(BLOCKS) + half);
        (Vector3::from(middle) * options.block_m(), half * options.block_m())
    }

    /// Whether it has voxels between two places, in voxels.
    pub(super) fn is_between(self, low: &Vector3<f64>, high: &Vector3<f64>) -> bool {
        let edge = f64::from(BLOCKS) * EDGE as f64;
        (0..3).all(|axis| {
            let first = f64::from(self.0[axis]) * edge;
            first <= high[axis] && first + edge > low[axis]
        })
    }

    /// The keys of its blocks that are in a volume, in the order of z, y, x.
    pub(super) fn keys(self, volume: &Volume) -> Vec<BlockKey> {
        let [x, y, z] = self.0.map(|k| k << SHIFT);
        let all = (0..BLOCKS * BLOCKS * BLOCKS).map(|k| {
            let [i, j, k] = [k % BLOCKS, k / BLOCKS % BLOCKS, k / (BLOCKS * BLOCKS)];
            BlockKey { x: x + i, y: y + j, z: z + k }
        });
        all.filter(|&key| volume.slot(key).is_some()).collect()
    }
}

/// Counts of paging so far.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct PagingFigures {
    /// Blocks that are on disk only.
    pub blocks_on_disk: usize,
    /// Blocks that were evicted, counted each time.
    pub paged_out: usize,
    /// Blocks that were read back, counted each time.
    pub paged_in: usize,
    /// Frames that needed so many blocks that memory was above the ceiling.
    pub frames_above_ceiling: usize,
}

/// Which regions of a volume are in memory, and where the others are.
#[derive(Debug)]
pub(super) struct PageCache {
    /// Most blocks in memory.
    pub(super) ceiling: usize,
    pub(super) pages: PageFile,
    regions: BTreeMap<Region, RegionState>,
    /// Number of requests for regions.
    time: u64,
    pub(super) figures: PagingFigures,
}

/// The state of a region.
#[derive(Debug)]
struct RegionState {
    /// The time at which it was needed last.
    needed: u64,
    residency: Residency,
}

/// Where the blocks of a region are.
#[derive(Debug)]
enum Residency {
    Memory,
    /// In memory, and unchanged on disk.
    Both(Stored),
    Disk(Stored),
}

/// A page, how many blocks it has, and when one of them changed last.
#[derive(Debug)]
struct Stored {
    page: Page,
    blocks: usize,
    changed: u64,
}

/// What regions are needed for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Access {
    Read,
    Write,
}

impl PageCache {
    /// The cache of an empty volume, with at most `ceiling` blocks in memory. Its file is in the folder, or
    /// in the system's temporary one.
    pub(super) fn new(ceiling: usize, folder: Option<&Path>) -> io::Result<Self> {
        Ok(Self {
            ceiling,
            pages: PageFile::new(folder)?,
            regions: BTreeMap::new(),
            time: 0,
            figures: PagingFigures::default(),
        })
    }

    /// All regions, in order.
    pub(super) fn regions(&self) -> impl Iterator<Item = Region> {
        self.regions.keys().copied()
    }

    /// The regions that are on disk only and have a block that changed after a revision, in order.
    pub(super) fn away_since(&self, revision: u64) -> Vec<Region> {
        let changed = self.regions.iter().filter(|(_, standing)| match &standing.residency {
            Residency::Disk(stored) => stored.changed > revision,
            Residency::Both(_) | Residency::Memory => false,
        });
        changed.map(|(&region, _)| region).collect()
    }

    /// Whether a region is on disk only.
    pub(super) fn is_away(&self, region: Region) -> bool {
        self.regions
            .get(&region)
            .is_some_and(|standing| matches!(standing.residency, Residency::Disk(_)))
    }

    /// Calls `show` with the blocks of each region that is on disk only, without keeping them in
    /// memory. Stops at the first error.
    pub(super) fn visit_away<E: From<PageError>>(
        &mut self,
        mut show: impl FnMut(Vec<(BlockKey, State, Block)>) -> Result<(), E>,
    ) -> Result<(), E> {
        for standing in self.regions.values() {
            if let Residency::Disk(stored) = &standing.residency {
                let page = self.pages.read(&stored.page)?;
                let blocks = from_page(&page, stored.blocks);
                show(blocks.ok_or_else(|| self.pages.damaged(&stored.page))?)?;
            }
        }
        Ok(())
    }

    /// Brings regions into memory, after making room for them.
    pub(super) fn bring(
        &mut self,
        resident: &mut Volume,
        access: Access,
        regions: &[Region],
    ) -> Result<(), PageError> {
        self.time += 1;
        let (mut missing, mut incoming) = (Vec::new(), 0);
        for &region in regions {
            let Some(standing) = self.regions.get_mut(&region) else { continue };
            standing.needed = self.time;
            match &standing.residency {
                Residency::Disk(stored) => {
                    incoming += stored.blocks;
                    missing.push(region);
                }
                Residency::Both(stored) if access == Access::Write => {
                    self.pages.free(&stored.page);
                    standing.residency = Residency::Memory;
                }
                Residency::Both(_) | Residency::Memory => {}
            }
        }
        self.make_room(resident, incoming)?;
        for some in missing.chunks(REGIONS_AT_A_TIME) {
            self.fetch(resident, access, some)?;
        }
        Ok(())
    }

    /// Flips a bit of each intact page, or of each damaged one, which repairs it.
    #[cfg(test)]
    pub(super) fn flip_pages(&mut self, whole: bool) {
        for standing in self.regions.values() {
            if let Residency::Both(stored) | Residency::Disk(stored) = &standing.residency
                && self.pages.read(&stored.page).is_ok() == whole
            {
                self.pages.flip(&stored.page);
            }
        }
    }

    /// Uses a disk with `room` bytes for its pages; there must be none yet.
    #[cfg(test)]
    pub(super) fn use_disk_of(&mut self, room: u64, folder: &Path) {
        assert_eq!(self.pages.bytes(), 0);
        self.pages = PageFile::on_disk_of(room, folder);
    }

    /// Reads regions from disk.
    fn fetch(
        &mut self,
        resident: &mut Volume,
        access: Access,
        regions: &[Region],
    ) -> Result<(), PageError> {
        let mut read = Vec::with_capacity(regions.len());
        for region in regions {
            if let Some(RegionState { residency: Residency::Disk(stored), .. }) =
                self.regions.get(region)
            {
                read.push((*region, stored.blocks, self.pages.read(&stored.page)?));
            }
        }
        let unpacked = read.into_par_iter();
        let unpacked: Vec<_> =
            unpacked.map(|(region, blocks, page)| (region, from_page(&page, blocks))).collect();
        for (region, blocks) in unpacked {
            let Some(standing) = self.regions.get_mut(&region) else { continue };
            let Residency::Disk(stored) =
                std::mem::replace(&mut standing.residency, Residency::Memory)
            else {
                continue;
            };
            let Some(blocks) = blocks else {
                let damaged = self.pages.damaged(&stored.page);
                standing.residency = Residency::Disk(stored);
                return Err(damaged);
            };
            self.figures.paged_in += blocks.len();
            self.figures.blocks_on_disk -= blocks.len();
            for (key, state, block) in blocks {
                resident.put_back(key, block, state);
            }
            match access {
                Access::Read => standing.residency = Residency::Both(stored),
                Access::Write => self.pages.free(&stored.page),
            }
        }
        Ok(())
    }

    /// Registers the new blocks from slot `first_new` on, and evicts others to keep the ceiling.
    pub(super) fn register_new(&mut self, resident: &mut Volume, first_new: usize) {
        let mut before = None;
        for &key in &resident.keys()[first_new..] {
            let region = Region::of(key);
            if before.replace(region) != Some(region) {
                let new = RegionState { needed: self.time, residency: Residency::Memory };
                self.regions.entry(region).or_insert(new).needed = self.time;
            }
        }
        // The next frame makes room again, and reports why there is none.
        let _full = self.make_room(resident, 0);
        self.figures.frames_above_ceiling += usize::from(resident.len() > self.ceiling);
    }

    /// If `incoming` more blocks would exceed the ceiling, evicts regions that are not needed now,
    /// until memory is somewhat below it.
    fn make_room(&mut self, resident: &mut Volume, incoming: usize) -> Result<(), PageError> {
        if resident.len() + incoming <= self.ceiling {
            return Ok(());
        }
        let kept = self.ceiling - SLACK.min(self.ceiling / 8);
        let target = kept.saturating_sub(incoming);
        let candidates = self.regions.iter().filter(|(_, standing)| {
            standing.needed < self.time && !matches!(standing.residency, Residency::Disk(_))
        });
        let mut oldest: Vec<_> =
            candidates.map(|(&region, standing)| (standing.needed, region)).collect();
        oldest.sort_unstable();
        let mut oldest = oldest.into_iter().map(|(_, region)| region).peekable();
        while resident.len() > target && oldest.peek().is_some() {
            let (mut some, mut outgoing) = (Vec::new(), 0);
            while some.len() < REGIONS_AT_A_TIME && resident.len() - outgoing > target {
                let Some(region) = oldest.next() else { break };
                let keys = region.keys(resident);
                outgoing += keys.len();
                some.push((region, keys));
            }
            self.evict(resident, &some)?;
        }
        resident.shrink_to(self.ceiling);
        Ok(())
    }

    /// Evicts regions to disk.
    fn evict(
        &mut self,
        resident: &mut Volume,
        regions: &[(Region, Vec<BlockKey>)],
    ) -> Result<(), PageError> {
        let is_changed = |region: &Region| {
            matches!(
                self.regions.get(region),
                Some(RegionState { residency: Residency::Memory, .. })
            )
        };
        let view: &Volume = resident;
        let packed: Vec<_> = regions
            .par_iter()
            .map(|(region, keys)| is_changed(region).then(|| to_page(view, keys)).transpose())
            .collect();
        for ((region, keys), packed) in regions.iter().zip(packed) {
            let page = packed?.map(|bytes| self.pages.put(&bytes)).transpose()?;
            let Some(standing) = self.regions.get_mut(region) else { continue };
            standing.residency =
                match (std::mem::replace(&mut standing.residency, Residency::Memory), page) {
                    (_, Some(page)) => {
                        let slots = keys.iter().filter_map(|&key| resident.slot(key));
                        let changed = slots.map(|slot| resident.changed(slot)).max().unwrap_or(0);
                        Residency::Disk(Stored { page, blocks: keys.len(), changed })
                    }
                    (Residency::Both(stored) | Residency::Disk(stored), None) => {
                        Residency::Disk(stored)
                    }
                    (Residency::Memory, None) => continue,
                };
            self.figures.paged_out += keys.len();
            self.figures.blocks_on_disk += keys.len();
            for &key in keys {
                resident.remove(key);
            }
        }
        Ok(())
    }
}
