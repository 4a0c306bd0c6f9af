//! What the fuzz target `volume` runs: volume files of any bytes, and what is made of their volumes.
//!
//! Built for tests and with the feature `fuzzing` only. A volume that is read is written as the same
//! volume; a small one has a surface whose triangles name its vertices, whatever its voxels are.

use std::io::Cursor;
use std::path::Path;

use super::super::block::{Block, BlockKey, VOXELS};
use super::super::navigation::{NavigationOptions, distance_slice, occupancy_grid};
use super::super::surface::extract;
use super::{BYTES_A_BLOCK, Bytes, CHUNK_HEAD, HEADER, PagedVolume, Volume, VolumeOptions};
use super::{VolumeFileError, encode, u32_at};

/// Most blocks of a volume that is used beyond reading it.
const SMALL: usize = 8;

/// Tests a file as it is, and with matching checksums.
pub fn volume(input: &[u8]) {
    judge(input);
    judge(&resealed(input));
}

fn judge(bytes: &[u8]) {
    let Some(read) = decode(bytes).ok().filter(|volume| volume.len() <= SMALL) else { return };
    let volume = read.resident().clone();
    let again = decode(&bytes_of(read));
    let is_same = |again: &PagedVolume| {
        let again = again.resident();
        let sizes = |volume: &Volume| {
            let VolumeOptions { voxel_m, truncation_m } = *volume.options();
            (voxel_m.to_bits(), truncation_m.to_bits())
        };
        again.keys() == volume.keys()
            && again.blocks().iter().eq(volume.blocks().iter())
            && sizes(again) == sizes(&volume)
    };
    assert!(again.as_ref().is_ok_and(is_same), "what is written is read as another volume");
    let mesh = extract(&mut volume.clone().into()).unwrap_or_default();
    let vertices = mesh.positions.len();
    let corners = mesh.triangles.as_flattened();
    assert!(corners.iter().all(|&corner| (corner as usize) < vertices), "a corner without vertex");
    let options = NavigationOptions::default();
    let is_near = |key: &BlockKey| [key.x, key.y, key.z].iter().all(|k| (-2..=2).contains(k));
    if volume.keys().iter().all(is_near) {
        let mut volume = PagedVolume::from(volume);
        let _refused = occupancy_grid(&mut volume, &options);
        let _refused = distance_slice(&mut volume, &options, 0.0);
    }
}

/// The volume of a file's bytes, whatever they are; all of it in memory.
pub(super) fn decode(bytes: &[u8]) -> Result<PagedVolume, VolumeFileError> {
    in_memory(bytes).decode(|options, blocks| Ok(Volume::with_capacity(options, blocks).into()))
}

/// A file whose bytes are in memory.
pub(super) fn in_memory(bytes: &[u8]) -> Bytes<'_, Cursor<&[u8]>> {
    Bytes { reader: Cursor::new(bytes), length: bytes.len() as u64, path: Path::new("memory") }
}

/// The bytes of a volume's file.
pub(super) fn bytes_of(volume: impl Into<PagedVolume>) -> Vec<u8> {
    let mut all = Vec::new();
    let written = encode(&mut volume.into(), |bytes| {
        all.extend_from_slice(bytes);
        Ok(())
    });
    assert!(written.is_ok(), "a volume is not written: {written:?}");
    all
}

/// A file with checksums that match its content, as far as its chunks are found.
pub(super) fn resealed(bytes: &[u8]) -> Vec<u8> {
    let mut bytes = bytes.to_vec();
    if bytes.len() < HEADER {
        return bytes;
    }
    let mut crc = crc32c::crc32c(&bytes[..HEADER - 4]);
    bytes[HEADER - 4..HEADER].copy_from_slice(&crc.to_le_bytes());
    // Those that the bytes have room for are what a reader looks at.
    let blocks = u32_at(&bytes, 24) as usize;
    let blocks = blocks.min(bytes.len() / BYTES_A_BLOCK);
    for chunk in in_memory(&bytes).find_chunks(blocks).unwrap_or_default() {
        let (start, end) = (chunk.start as usize, chunk.end as usize);
        crc = crc32c::crc32c_append(crc, &bytes[start..start + 4]);
        crc = crc32c::crc32c_append(crc, &bytes[start + CHUNK_HEAD..end]);
        bytes[start + 4..start + 8].copy_from_slice(&crc.to_le_bytes());
    }
    bytes
}

/// Files of at most `length` bytes, whose volumes take as much memory as any can.
pub fn largest(length: usize) -> Vec<Vec<u8>> {
    // Chunks' heads take a byte of a block's share at most.
    let blocks = length.saturating_sub(HEADER) / (BYTES_A_BLOCK + 1);
    vec![bytes_of(made(blocks, |_, _| (0, 0, [0; 4])))]
}

/// The seeds: small files, one of each kind.
#[must_use]
pub fn seeds() -> Vec<(&'static str, Vec<u8>)> {
    let mixed = |block: usize, voxel: usize| {
        let seed = (VOXELS * block + voxel + 1) as u64;
        let mixed = seed.wrapping_mul(0x9e37_79b9_7f4a_7c15);
        let mixed = (mixed ^ mixed >> 29).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        mixed ^ mixed >> 32
    };
    let plane = |_: usize, voxel: usize| {
        let height = (voxel / 8 % 8) as i16;
        (4_000 * height - 14_500, 512, [200, 100, voxel as u8, 0])
    };
    let noise = |block: usize, voxel: usize| {
        let bits = mixed(block, voxel);
        (bits as i16, (bits >> 16) as u16, ((bits >> 32) as u32).to_le_bytes())
    };
    let sparse = |block: usize, voxel: usize| {
        let bits = mixed(block, voxel);
        if bits.is_multiple_of(9) { (bits as i16, 300, [7; 4]) } else { (0, 0, [0; 4]) }
    };
    let mut cut = bytes_of(made(2, plane));
    cut.truncate(HEADER + CHUNK_HEAD + 100);
    vec![
        ("empty", bytes_of(made(0, plane))),
        ("plane", bytes_of(made(3, plane))),
        ("noise", bytes_of(made(1, noise))),
        ("sparse", bytes_of(made(2, sparse))),
        ("nothing", bytes_of(made(5, |_, _| (0, 0, [0; 4])))),
        ("cut", cut),
    ]
}

/// A volume of blocks in a row along x, from a function of block and voxel.
fn made(blocks: usize, voxel: impl Fn(usize, usize) -> (i16, u16, [u8; 4])) -> Volume {
    let options = VolumeOptions { voxel_m: 0.02, truncation_m: 0.16 };
    let mut volume = Volume::with_capacity(options, blocks);
    for x in 0..blocks {
        let mut block = Block::EMPTY;
        for k in 0..VOXELS {
            (block.distances[k], block.weights[k], block.colors[k]) = voxel(x, k);
        }
        volume.insert(BlockKey { x: x as i32, y: 0, z: 0 }, block);
    }
    volume
}
