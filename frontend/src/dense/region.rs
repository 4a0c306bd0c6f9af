//! Regions of the grid: groups of blocks that are evicted and read back together.
//!
//! A region has 4 × 4 × 4 blocks. Its page has for each block the revision of its last change (u64),
//! whether it is solid (u8) and its color change since then (u8), little endian, and then the packed
//! blocks. Independent of files.

use nalgebra::Vector3;

use super::block::{Block, BlockKey, EDGE};
use super::packing::{pack, unpack};
use super::pages::PageError;
use super::volume::{State, Volume, VolumeOptions};

/// Blocks along an edge of a region, as a power of two.
const SHIFT: i32 = 2;
const BLOCKS: i32 = 1 << SHIFT;
/// Bytes of a block's state.
const STATE: usize = 10;

/// A region of the grid, by its coordinates in regions.
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

/// Blocks of a volume as a page.
///
/// # Errors
/// [`PageError::Packing`].
pub(super) fn to_page(volume: &Volume, keys: &[BlockKey]) -> Result<Vec<u8>, PageError> {
    let (slots, all) =
        (keys.iter().filter_map(|&key| Some((key, volume.slot(key)?))), volume.blocks());
    let mut page = Vec::new();
    let mut blocks = Vec::with_capacity(keys.len());
    for (key, slot) in slots {
        let State { changed, is_solid, recolored } = volume.state(slot);
        page.extend_from_slice(&changed.to_le_bytes());
        page.extend_from_slice(&[u8::from(is_solid), recolored]);
        blocks.extend(all.get(slot).map(|block| (key, block)));
    }
    let packed = pack(&blocks);
    let packed = packed.map_err(|error| PageError::Packing { message: error.to_string() })?;
    page.extend_from_slice(&packed);
    Ok(page)
}

/// The blocks of a page, which must have `blocks` of them; `None` where it is invalid.
pub(super) fn from_page(page: &[u8], blocks: usize) -> Option<Vec<(BlockKey, State, Block)>> {
    let (states, frame) = page.split_at_checked(STATE * blocks)?;
    let states = states.as_chunks::<STATE>().0.iter();
    let states = states.map(|&[a, b, c, d, e, f, g, h, solid, recolored]| {
        let changed = u64::from_le_bytes([a, b, c, d, e, f, g, h]);
        State { changed, is_solid: solid != 0, recolored }
    });
    let unpacked = unpack(frame, blocks).ok()?;
    Some(
        unpacked.into_iter().zip(states).map(|((key, block), state)| (key, state, block)).collect(),
    )
}
