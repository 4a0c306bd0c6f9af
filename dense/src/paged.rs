//! A volume that may be partly on disk: regions far from the camera are evicted, and read back before a
//! frame may see them (decision 0018).
//!
//! Each frame needs the regions that its frustum intersects, with a margin; `page_cache` decides which
//! others stay. Integration, surfaces and files use ordinary volumes, without pages. Each block is
//! identical to the bit to that of a volume without a ceiling.

use std::io;
use std::path::Path;

use nalgebra::Vector3;

use super::block::{Block, BlockKey};
use super::integrate::{DenseFrame, IntegrateError, Integrator};
pub use super::page_cache::PagingFigures;
use super::page_cache::{Access, PageCache, Region};
use super::pages::PageError;
use super::volume::{Volume, VolumeOptions};

/// Bytes of a block.
const BLOCK: usize = size_of::<Block>();
/// A frame needs the blocks within this many blocks of its frustum, so that those it changes have their
/// neighbors.
const MARGIN: f64 = 2.0;

/// A volume with or without a ceiling on its memory.
#[derive(Debug)]
pub struct PagedVolume {
    /// The part in memory.
    resident: Volume,
    /// Decides what stays, where there is a ceiling.
    cache: Option<PageCache>,
}

impl From<Volume> for PagedVolume {
    /// All of it in memory, without a ceiling.
    fn from(resident: Volume) -> Self {
        Self { resident, cache: None }
    }
}

impl PagedVolume {
    /// An empty one without a ceiling.
    #[must_use]
    pub fn new(options: VolumeOptions) -> Self {
        Volume::new(options).into()
    }

    /// An empty one with at most `ceiling_bytes` of blocks in memory, unless a single frame needs more.
    /// The rest is in a temporary file in `folder`, or in the system's temporary folder. The state of
    /// all blocks, and prepared memory for new ones (8 MB), are not included.
    ///
    /// # Errors
    /// No file can be made there.
    pub fn with_ceiling(
        options: VolumeOptions,
        ceiling_bytes: usize,
        folder: Option<&Path>,
    ) -> io::Result<Self> {
        let cache = Some(PageCache::new(ceiling_bytes / BLOCK, folder)?);
        Ok(Self { resident: Volume::new(options), cache })
    }

    /// Changes the ceiling from the next frame on. A volume without a ceiling stays without one.
    pub fn set_ceiling(&mut self, ceiling_bytes: usize) {
        if let Some(cache) = &mut self.cache {
            cache.ceiling = ceiling_bytes / BLOCK;
        }
    }

    /// The grid's measures.
    #[must_use]
    pub fn options(&self) -> &VolumeOptions {
        self.resident.options()
    }

    /// The part in memory: the whole volume where there is no ceiling.
    #[must_use]
    pub fn resident(&self) -> &Volume {
        &self.resident
    }

    /// How many blocks it has, in memory and on disk.
    #[must_use]
    pub fn len(&self) -> usize {
        self.resident.len() + self.paging().map_or(0, |paging| paging.blocks_on_disk)
    }

    /// Whether it has no blocks.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// Bytes of the page file.
    #[must_use]
    pub fn page_file_bytes(&self) -> u64 {
        self.cache.as_ref().map_or(0, |cache| cache.pages.bytes())
    }

    /// Counts of paging so far; `None` where there is no ceiling.
    #[must_use]
    pub fn paging(&self) -> Option<PagingFigures> {
        self.cache.as_ref().map(|cache| cache.figures)
    }

    /// Integrates a frame into the volume, on the current pool of threads. This is one revision.
    ///
    /// # Errors
    /// The frame or an option is invalid, blocks that it needs cannot be read from disk, or others have
    /// no room there; the volume is unchanged then.
    pub fn integrate(
        &mut self,
        integrator: &mut Integrator,
        frame: &DenseFrame<'_>,
    ) -> Result<(), IntegrateError> {
        let Some(cache) = &mut self.cache else {
            return integrator.integrate(&mut self.resident, frame);
        };
        let options = *self.resident.options();
        let frustum = integrator.frustum(&options, frame)?;
        let margin_m = MARGIN * options.block_m();
        let is_needed = |region: &Region| {
            let (middle, half_m) = region.cube(&options);
            frustum.meets(&middle, half_m + margin_m)
        };
        let needed: Vec<_> = cache.regions().filter(is_needed).collect();
        cache.bring(&mut self.resident, Access::Write, &needed)?;
        let before = self.resident.len();
        integrator.integrate(&mut self.resident, frame)?;
        cache.register_new(&mut self.resident, before);
        Ok(())
    }

    /// Puts a block at a key, replacing any that is there; returns whether there was none.
    ///
    /// # Errors
    /// Its region cannot be read from disk, or others have no room there; the volume is unchanged then.
    pub fn insert(&mut self, key: BlockKey, block: Block) -> Result<bool, PageError> {
        if let Some(cache) = &mut self.cache {
            cache.bring(&mut self.resident, Access::Write, &[Region::of(key)])?;
        }
        let before = self.resident.len();
        self.resident.insert(key, block);
        let is_new = self.resident.len() > before;
        if let Some(cache) = &mut self.cache {
            cache.register_new(&mut self.resident, before);
        }
        Ok(is_new)
    }

    /// Brings regions into memory; others may be evicted. Fails as [`PagedVolume::insert`].
    pub(super) fn bring(&mut self, regions: &[Region]) -> Result<&Volume, PageError> {
        if let Some(cache) = &mut self.cache {
            cache.bring(&mut self.resident, Access::Read, regions)?;
        }
        Ok(&self.resident)
    }

    /// As [`PagedVolume::bring`] for the regions between two places, in voxels.
    pub(super) fn bring_between(
        &mut self,
        low: Vector3<f64>,
        high: Vector3<f64>,
    ) -> Result<&Volume, PageError> {
        let regions = self.cache.iter().flat_map(PageCache::regions);
        let regions: Vec<_> = regions.filter(|region| region.is_between(&low, &high)).collect();
        self.bring(&regions)
    }

    /// The page cache of a volume with a ceiling.
    #[cfg(test)]
    pub(super) fn cache(&mut self) -> &mut PageCache {
        self.cache.as_mut().unwrap()
    }

    /// The regions that are on disk only and have a block that changed after a revision, in order.
    pub(super) fn on_disk_since(&self, revision: u64) -> Vec<Region> {
        self.cache.as_ref().map_or_else(Vec::new, |cache| cache.away_since(revision))
    }

    /// Whether a region is on disk only.
    pub(super) fn is_on_disk(&self, region: Region) -> bool {
        self.cache.as_ref().is_some_and(|cache| cache.is_away(region))
    }

    /// Calls `show` with all blocks, `most` at a time (fewer at the end only): those in memory in the
    /// order of their slots, then those on disk, which stay there. Stops at the first error.
    pub(super) fn visit<E: From<PageError>>(
        &mut self,
        most: usize,
        mut show: impl FnMut(&[(BlockKey, &Block)]) -> Result<(), E>,
    ) -> Result<(), E> {
        let keys = self.resident.keys().iter().copied();
        let resident: Vec<_> = keys.zip(self.resident.blocks().iter()).collect();
        let (whole, rest) = resident.split_at(resident.len() / most * most);
        for blocks in whole.chunks(most) {
            show(blocks)?;
        }
        let mut left: Vec<_> = rest.iter().map(|&(key, block)| (key, block.clone())).collect();
        if let Some(cache) = &mut self.cache {
            cache.visit_away::<E>(|blocks| {
                left.extend(blocks.into_iter().map(|(key, _, block)| (key, block)));
                let whole = left.len() / most * most;
                left[..whole].chunks(most).try_for_each(|blocks| show(&pairs(blocks)))?;
                left.drain(..whole);
                Ok(())
            })?;
        }
        if left.is_empty() { Ok(()) } else { show(&pairs(&left)) }
    }
}

fn pairs(blocks: &[(BlockKey, Block)]) -> Vec<(BlockKey, &Block)> {
    blocks.iter().map(|(key, block)| (*key, block)).collect()
}
