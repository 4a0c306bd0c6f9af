//! Converts blocks to bytes that compress well, and back.
//!
//! Blocks that are packed together are stored property by property: keys (3 i32 each), then one plane
//! of bytes for each byte of a voxel's distance, weight and color, each plane over all voxels of all
//! blocks. A value is stored as its difference to the previous voxel, with the sign in the lowest bit,
//! so that even growth and unseen voxels give the same bytes again and again. A page has before them,
//! for each block, the revision of its last change (u64), whether it is solid (u8) and its color change
//! since then (u8), little endian. Independent of files.

use super::block::{Block, BlockKey, VOXELS};
use super::pages::PageError;
use super::volume::{State, Volume};

/// Bytes of a block: key, distances, weights and colors.
const BLOCK: usize = 12 + 8 * VOXELS;
/// Bytes of a block's state.
const STATE: usize = 10;
/// Higher levels take twice the time and save some percent of the bytes.
const COMPRESSION_LEVEL: i32 = 1;

/// The zstd frame of blocks, or [`PageError::Packing`].
pub(super) fn pack(blocks: &[(BlockKey, &Block)]) -> Result<Vec<u8>, PageError> {
    let mut bytes = vec![0; BLOCK * blocks.len()];
    let (heads, voxels) = bytes.split_at_mut(12 * blocks.len());
    for (head, (key, _)) in heads.chunks_exact_mut(12).zip(blocks) {
        for (word, number) in head.chunks_exact_mut(4).zip([key.x, key.y, key.z]) {
            word.copy_from_slice(&number.to_le_bytes());
        }
    }
    let plane = VOXELS * blocks.len();
    for (i, (_, block)) in blocks.iter().enumerate() {
        let at = VOXELS * i;
        let mut before = (0, 0, [0; 4]);
        for k in 0..VOXELS {
            let (distance, weight, color) =
                (block.distances[k].cast_unsigned(), block.weights[k], block.colors[k]);
            let [a, b] = fold(distance.wrapping_sub(before.0)).to_le_bytes();
            let [c, d] = fold(weight.wrapping_sub(before.1)).to_le_bytes();
            let [e, f, g, h] = std::array::from_fn(|i| color[i].wrapping_sub(before.2[i]));
            for (p, byte) in [a, b, c, d, e, f, g, h].into_iter().enumerate() {
                voxels[p * plane + at + k] = byte;
            }
            before = (distance, weight, color);
        }
    }
    zstd::bulk::compress(&bytes, COMPRESSION_LEVEL)
        .map_err(|error| PageError::Packing { message: error.to_string() })
}

/// The blocks of a frame, which must have `blocks` of them, or what is wrong with it.
pub(super) fn unpack(frame: &[u8], blocks: usize) -> Result<Vec<(BlockKey, Block)>, &'static str> {
    let mut bytes = vec![0; BLOCK * blocks];
    match zstd::bulk::decompress_to_buffer(frame, &mut bytes) {
        Ok(length) if length == bytes.len() => {}
        Ok(_) => return Err("has fewer bytes than its blocks need"),
        Err(_reason) => return Err("is not a zstd frame of its blocks' size"),
    }
    let (heads, voxels) = bytes.split_at(12 * blocks);
    let plane = VOXELS * blocks;
    let unpacked = heads.chunks_exact(12).enumerate().map(|(i, head)| {
        let number =
            |at: usize| i32::from_le_bytes([head[at], head[at + 1], head[at + 2], head[at + 3]]);
        let key = BlockKey { x: number(0), y: number(4), z: number(8) };
        let planes: [&[u8]; 8] =
            std::array::from_fn(|p| &voxels[p * plane + VOXELS * i..][..VOXELS]);
        let mut block = Block::EMPTY;
        let mut before = (0_u16, 0_u16, [0_u8; 4]);
        for k in 0..VOXELS {
            let step =
                |low: usize| unfold(u16::from_le_bytes([planes[low][k], planes[low + 1][k]]));
            before.0 = before.0.wrapping_add(step(0));
            before.1 = before.1.wrapping_add(step(2));
            for channel in 0..4 {
                before.2[channel] = before.2[channel].wrapping_add(planes[4 + channel][k]);
            }
            block.distances[k] = before.0.cast_signed();
            block.weights[k] = before.1;
            block.colors[k] = before.2;
        }
        (key, block)
    });
    Ok(unpacked.collect())
}

/// A difference with its sign as the lowest bit.
fn fold(difference: u16) -> u16 {
    let signed = difference.cast_signed();
    (signed << 1 ^ signed >> 15).cast_unsigned()
}

/// The inverse of `fold`.
fn unfold(folded: u16) -> u16 {
    (folded >> 1) ^ (folded & 1).wrapping_neg()
}

/// Blocks of a volume, which must have them, as a page, or [`PageError::Packing`].
pub(super) fn to_page(volume: &Volume, keys: &[BlockKey]) -> Result<Vec<u8>, PageError> {
    let slots = keys.iter().filter_map(|&key| Some((key, volume.slot(key)?)));
    let mut page = Vec::new();
    let mut blocks = Vec::with_capacity(keys.len());
    for (key, slot) in slots {
        let State { changed, is_solid, recolored } = volume.states()[slot];
        page.extend_from_slice(&changed.to_le_bytes());
        page.extend_from_slice(&[u8::from(is_solid), recolored]);
        blocks.push((key, &volume.blocks()[slot]));
    }
    page.extend_from_slice(&pack(&blocks)?);
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
