//! Reads a volume from its file, some chunks at a time: the whole file is never in memory.
//!
//! First all chunks are located, so that an incomplete file is refused at once; then they are read,
//! checked and unpacked in order. Blocks are put into a volume that may have a ceiling. The format is
//! described at the head of the folder's `mod.rs`.

use std::fs::File;
use std::io::{Cursor, Read, Seek, SeekFrom};
use std::path::Path;

use rayon::prelude::*;

use super::super::mapper::MemoryCeiling;
use super::super::packing::unpack;
use super::super::paged::PagedVolume;
use super::super::volume::{Volume, VolumeOptions};
use super::{BLOCKS_A_CHUNK, BYTES_A_BLOCK, CHUNK_HEAD, CHUNKS_AT_A_TIME, HEADER};
use super::{MAGIC, VERSION, VolumeFileError};

/// Reads a volume; with a ceiling, the blocks beyond it are in a page file.
///
/// # Errors
/// The file cannot be read, is cut short, damaged or no volume, or no page file can be made.
pub fn load(path: &Path, ceiling: Option<&MemoryCeiling>) -> Result<PagedVolume, VolumeFileError> {
    let failed = |action, path: &Path, error: &std::io::Error| VolumeFileError::File {
        action,
        path: path.display().to_string(),
        message: error.to_string(),
    };
    let open = || {
        let file = File::open(path)?;
        let length = file.metadata()?.len();
        Ok((file, length))
    };
    let (reader, length) = open().map_err(|error| failed("cannot read", path, &error))?;
    let bytes = Bytes { reader, length, path };
    bytes.decode(|options, blocks| match ceiling {
        Some(ceiling) => ceiling.volume(options, 1).map_err(|error| {
            let folder = ceiling.folder.clone().unwrap_or_else(std::env::temp_dir);
            failed("cannot make a page file in", &folder, &error)
        }),
        None => Ok(Volume::with_capacity(options, blocks).into()),
    })
}

/// The volume of a file's bytes, whatever they are.
///
/// # Errors
/// As [`load`], without [`VolumeFileError::File`].
pub fn decode(bytes: &[u8]) -> Result<Volume, VolumeFileError> {
    let volume = Bytes::of(bytes)
        .decode(|options, blocks| Ok(Volume::with_capacity(options, blocks).into()));
    Ok(volume?.into_resident())
}

/// A file, or the bytes of one in memory.
pub(super) struct Bytes<'a, R> {
    reader: R,
    length: u64,
    /// Its name in errors.
    path: &'a Path,
}

impl<'a> Bytes<'a, Cursor<&'a [u8]>> {
    /// Bytes in memory.
    pub(super) fn of(bytes: &'a [u8]) -> Self {
        Self { reader: Cursor::new(bytes), length: bytes.len() as u64, path: Path::new("memory") }
    }
}

impl<R: Read + Seek> Bytes<'_, R> {
    /// Reads `count` bytes from an offset on, which the file must have.
    fn read(&mut self, offset: u64, count: usize) -> Result<Vec<u8>, VolumeFileError> {
        let mut bytes = vec![0; count];
        let read = self.reader.seek(SeekFrom::Start(offset));
        let read = read.and_then(|_| self.reader.read_exact(&mut bytes));
        read.map_err(|error| VolumeFileError::File {
            action: "cannot read",
            path: self.path.display().to_string(),
            message: error.to_string(),
        })?;
        Ok(bytes)
    }

    /// Reads the volume into the one that `empty` makes for the number of blocks.
    fn decode(
        mut self,
        empty: impl FnOnce(VolumeOptions, usize) -> Result<PagedVolume, VolumeFileError>,
    ) -> Result<PagedVolume, VolumeFileError> {
        let Header { options, blocks, mut crc } = self.read_header()?;
        let chunks = self.find_chunks(blocks)?;
        let mut volume = empty(options, blocks)?;
        for (group, some) in chunks.chunks(CHUNKS_AT_A_TIME).enumerate() {
            let first = group * CHUNKS_AT_A_TIME;
            let mut frames = Vec::with_capacity(some.len());
            for (i, chunk) in some.iter().enumerate() {
                let mut bytes = self.read(chunk.start, (chunk.end - chunk.start) as usize)?;
                crc = crc32c::crc32c_append(crc, &bytes[..4]);
                crc = crc32c::crc32c_append(crc, &bytes[CHUNK_HEAD..]);
                if crc != u32_at(&bytes, 4) {
                    return Err(VolumeFileError::Chunk { chunk: first + i, offset: chunk.start });
                }
                bytes.truncate(CHUNK_HEAD + chunk.frame);
                frames.push((bytes, chunk.blocks));
            }
            let unpacked: Vec<_> = frames
                .par_iter()
                .map(|(bytes, blocks)| unpack(&bytes[CHUNK_HEAD..], *blocks))
                .collect();
            for (i, (unpacked, chunk)) in unpacked.into_iter().zip(some).enumerate() {
                let content =
                    |what| VolumeFileError::Content { chunk: first + i, offset: chunk.start, what };
                for (key, block) in unpacked.map_err(content)? {
                    if !volume.insert_new(key, block)? {
                        return Err(content("has a block that was there already"));
                    }
                }
            }
        }
        Ok(volume)
    }

    /// Reads the grid's measures and the number of blocks, for which the bytes must have room.
    fn read_header(&mut self) -> Result<Header, VolumeFileError> {
        let length = self.length;
        let header = self.read(0, length.min(HEADER as u64) as usize)?;
        if !MAGIC.starts_with(&header[..header.len().min(MAGIC.len())]) {
            return Err(VolumeFileError::Magic);
        }
        if header.len() < HEADER {
            return Err(VolumeFileError::CutShort { length, offset: 0, end: HEADER as u64 });
        }
        let found = u32_at(&header, 8);
        if found != VERSION {
            return Err(VolumeFileError::Version { found });
        }
        let crc = crc32c::crc32c(&header[..HEADER - 4]);
        if crc != u32_at(&header, HEADER - 4) {
            return Err(VolumeFileError::Header);
        }
        let measure = |what, at| {
            let value = f32::from_bits(u32_at(&header, at));
            let is_length = value.is_finite() && value > 0.0;
            let error = || VolumeFileError::Measure { what, value: value.to_string() };
            is_length.then_some(value).ok_or_else(error)
        };
        let options = VolumeOptions {
            voxel_m: measure("voxel size", 12)?,
            truncation_m: measure("truncation", 16)?,
        };
        let blocks = u64::from(u32_at(&header, 24)) | u64::from(u32_at(&header, 28)) << 32;
        let chunks = blocks.div_ceil(BLOCKS_A_CHUNK as u64);
        // In 128 bits no product of the file's numbers overflows.
        let least = HEADER as u128
            + u128::from(blocks) * BYTES_A_BLOCK as u128
            + u128::from(chunks) * CHUNK_HEAD as u128;
        if u128::from(length) < least {
            let end = u64::try_from(least).unwrap_or(u64::MAX);
            return Err(VolumeFileError::CutShort { length, offset: HEADER as u64, end });
        }
        Ok(Header { options, blocks: blocks as usize, crc })
    }

    /// Locates the chunks of `blocks` blocks, which must fill the file to its end.
    pub(super) fn find_chunks(&mut self, blocks: usize) -> Result<Vec<Chunk>, VolumeFileError> {
        let length = self.length;
        let mut chunks = Vec::with_capacity(blocks.div_ceil(BLOCKS_A_CHUNK));
        let mut start = HEADER as u64;
        for first in (0..blocks).step_by(BLOCKS_A_CHUNK) {
            let blocks = BLOCKS_A_CHUNK.min(blocks - first);
            let left = length.saturating_sub(start).min(4) as usize;
            let frame = u32_at(&self.read(start, left)?, 0) as usize;
            let end = start + (CHUNK_HEAD + frame.max(BYTES_A_BLOCK * blocks)) as u64;
            if end > length {
                return Err(VolumeFileError::CutShort { length, offset: start, end });
            }
            chunks.push(Chunk { start, end, frame, blocks });
            start = end;
        }
        if start != length {
            return Err(VolumeFileError::Trailing { offset: start });
        }
        Ok(chunks)
    }
}

/// The content of the header.
struct Header {
    options: VolumeOptions,
    blocks: usize,
    crc: u32,
}

/// The place of a chunk.
pub(super) struct Chunk {
    pub(super) start: u64,
    /// The offset after its last byte.
    pub(super) end: u64,
    /// Bytes of its zstd frame.
    frame: usize,
    blocks: usize,
}

pub(super) fn u32_at(bytes: &[u8], at: usize) -> u32 {
    bytes.get(at..).and_then(<[u8]>::first_chunk).map_or(0, |&word| u32::from_le_bytes(word))
}
