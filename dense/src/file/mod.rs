//! A volume as a file, `volume.covis`, exact to the bit.
//!
//! ```text
//! header (36 bytes)  "covisvol"  version u32  voxel m f32  truncation m f32  0 u32
//!                    blocks u64  crc32c u32
//! chunk, one for each 256 blocks, the last for what is left
//!                    frame length u32  crc32c u32  zstd frame, zeros up to 128 bytes a block
//! ```
//!
//! Numbers are little endian. The CRC of a chunk covers its frame length, frame and zeros. It continues
//! the CRC of the previous chunk, the first that of the header, so that a chunk that is missing,
//! misplaced or from another file is detected. Each block has at least 128 bytes of the file, so that
//! the file's length limits the memory of its blocks, whatever the numbers in it are. A reader uses at
//! most 33 bytes per byte of the file and 20 MiB, or the ceiling that it is given. Blocks keep their
//! order; those that were on disk when the file was written are last.
//!
//! A reader locates all chunks first, so that an incomplete file is refused at once; then they are read,
//! checked and unpacked in order, some at a time: the whole file is never in memory.

#[cfg(any(test, feature = "fuzzing"))]
pub mod fuzzing;
#[cfg(test)]
mod tests;

use std::fs::File;
use std::io::{self, Read, Seek, SeekFrom, Write};
use std::path::Path;

use rayon::prelude::*;

use super::block::{Block, BlockKey};
use super::mapper::MemoryCeiling;
use super::packing::{pack, unpack};
use super::paged::PagedVolume;
use super::pages::PageError;
use super::volume::{Volume, VolumeOptions};

/// The first bytes of a file.
const MAGIC: &[u8; 8] = b"covisvol";
/// The version that is written, and the only one that is read.
const VERSION: u32 = 1;
/// Bytes of the header, its CRC included.
const HEADER: usize = 36;
/// Bytes before a chunk's frame.
const CHUNK_HEAD: usize = 8;
/// Blocks of each chunk except the last.
const BLOCKS_A_CHUNK: usize = 256;
/// Least bytes of a block in the file.
const BYTES_A_BLOCK: usize = 128;
/// Chunks that are packed or unpacked at a time: each holds two megabytes meanwhile.
const CHUNKS_AT_A_TIME: usize = 4;

/// Why a volume was not written or read. Offsets are bytes from the file's start.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum VolumeFileError {
    /// An error of the system.
    #[error("{action} {path}: {message}")]
    File {
        /// The action that failed.
        action: &'static str,
        /// The file.
        path: String,
        /// The system's message.
        message: String,
    },
    /// The file is of another kind.
    #[error("this is not a volume: it does not begin with \"covisvol\"")]
    Magic,
    /// Another version of covis wrote it.
    #[error("the volume has version {found}, and this covis reads version {VERSION} only")]
    Version {
        /// The file's version.
        found: u32,
    },
    /// Bytes are missing at the end.
    #[error(
        "the volume is truncated: it has {length} bytes, and the part that begins at byte \
         {offset} ends at {end}"
    )]
    CutShort {
        /// Bytes of the file.
        length: u64,
        /// Where the incomplete part begins.
        offset: u64,
        /// The least offset at which it would end.
        end: u64,
    },
    /// The checksum of the header does not match.
    #[error("the header, bytes 0 to {HEADER}, is damaged")]
    Header,
    /// A size in the header is invalid.
    #[error("the volume's {what} is {value}")]
    Measure {
        /// The name of the size.
        what: &'static str,
        /// Its value, as text.
        value: String,
    },
    /// A chunk is damaged, or its checksum matches but its content is invalid.
    #[error("chunk {chunk}, at byte {offset}, {what}")]
    Chunk {
        /// Which chunk, from 0.
        chunk: usize,
        /// Where it begins.
        offset: u64,
        /// What is wrong with it.
        what: &'static str,
    },
    /// There are bytes after the last chunk.
    #[error("the volume ends at byte {offset}, and the file does not")]
    Trailing {
        /// Where the file should end.
        offset: u64,
    },
    /// Blocks cannot be packed or read from disk.
    #[error(transparent)]
    Pages(#[from] PageError),
}

fn failed(action: &'static str, path: &Path, error: &io::Error) -> VolumeFileError {
    let (path, message) = (path.display().to_string(), error.to_string());
    VolumeFileError::File { action, path, message }
}

/// Writes a volume. The file is written completely or not at all, and replaces an existing one. Blocks
/// on disk stay there, except for some megabytes at a time.
///
/// # Errors
/// [`VolumeFileError::File`] and [`VolumeFileError::Pages`].
pub fn save(volume: &mut PagedVolume, path: &Path) -> Result<(), VolumeFileError> {
    let mut partial = path.as_os_str().to_owned();
    partial.push(".partial");
    let partial = Path::new(&partial);
    let mut write = || {
        let mut file =
            fs_err::File::create(partial).map_err(|error| failed("cannot create", path, &error))?;
        let unwritten = |error| failed("cannot write", path, &error);
        encode(volume, |bytes| file.write_all(bytes).map_err(unwritten))?;
        file.sync_all().map_err(unwritten)?;
        fs_err::rename(partial, path).map_err(|error| failed("cannot name", path, &error))
    };
    write().inspect_err(|_| {
        // A partial file that cannot be removed stays; the first error is returned.
        let _left = fs_err::remove_file(partial);
    })
}

/// Passes the bytes of a volume's file to `write`, in order.
fn encode(
    volume: &mut PagedVolume,
    mut write: impl FnMut(&[u8]) -> Result<(), VolumeFileError>,
) -> Result<(), VolumeFileError> {
    let VolumeOptions { voxel_m, truncation_m } = *volume.options();
    let mut header = Vec::with_capacity(HEADER);
    header.extend_from_slice(MAGIC);
    for word in [VERSION, voxel_m.to_bits(), truncation_m.to_bits(), 0] {
        header.extend_from_slice(&word.to_le_bytes());
    }
    header.extend_from_slice(&(volume.len() as u64).to_le_bytes());
    let mut crc = crc32c::crc32c(&header);
    header.extend_from_slice(&crc.to_le_bytes());
    write(&header)?;
    volume.visit(CHUNKS_AT_A_TIME * BLOCKS_A_CHUNK, |blocks: &[(BlockKey, &Block)]| {
        let chunks = blocks.par_chunks(BLOCKS_A_CHUNK);
        let packed: Vec<_> =
            chunks.map(|chunk| (pack(chunk), BYTES_A_BLOCK * chunk.len())).collect();
        for (frame, least) in packed {
            let mut frame = frame?;
            let length = (frame.len() as u32).to_le_bytes();
            frame.resize(frame.len().max(least), 0);
            crc = crc32c::crc32c_append(crc32c::crc32c_append(crc, &length), &frame);
            write(&length)?;
            write(&crc.to_le_bytes())?;
            write(&frame)?;
        }
        Ok(())
    })
}

/// Reads a volume; with a ceiling, the blocks beyond it are in a page file.
///
/// # Errors
/// The file cannot be read, is cut short, damaged or no volume, or no page file can be made.
pub fn load(path: &Path, ceiling: Option<&MemoryCeiling>) -> Result<PagedVolume, VolumeFileError> {
    let unread = |error| failed("cannot read", path, &error);
    let reader = File::open(path).map_err(unread)?;
    let length = reader.metadata().map_err(unread)?.len();
    Bytes { reader, length, path }.decode(|options, blocks| match ceiling {
        Some(ceiling) => ceiling.volume(options, 1).map_err(|error| {
            let folder = ceiling.folder.clone().unwrap_or_else(std::env::temp_dir);
            failed("cannot make a page file in", &folder, &error)
        }),
        None => Ok(Volume::with_capacity(options, blocks).into()),
    })
}

/// A file, or the bytes of one in memory.
struct Bytes<'a, R> {
    reader: R,
    length: u64,
    /// Its name in errors.
    path: &'a Path,
}

impl<R: Read + Seek> Bytes<'_, R> {
    /// Reads `count` bytes from an offset on, which the file must have.
    fn read(&mut self, offset: u64, count: usize) -> Result<Vec<u8>, VolumeFileError> {
        let mut bytes = vec![0; count];
        let read = self.reader.seek(SeekFrom::Start(offset));
        let read = read.and_then(|_| self.reader.read_exact(&mut bytes));
        read.map_err(|error| failed("cannot read", self.path, &error))?;
        Ok(bytes)
    }

    /// Reads the volume into the one that `empty` makes for the number of blocks.
    fn decode(
        mut self,
        empty: impl FnOnce(VolumeOptions, usize) -> Result<PagedVolume, VolumeFileError>,
    ) -> Result<PagedVolume, VolumeFileError> {
        let (options, blocks, mut crc) = self.read_header()?;
        let chunks = self.find_chunks(blocks)?;
        let mut volume = empty(options, blocks)?;
        for (group, some) in chunks.chunks(CHUNKS_AT_A_TIME).enumerate() {
            let first = group * CHUNKS_AT_A_TIME;
            let mut frames = Vec::with_capacity(some.len());
            let refused = |i: usize, what| {
                let offset = some[i].start;
                VolumeFileError::Chunk { chunk: first + i, offset, what }
            };
            for (i, chunk) in some.iter().enumerate() {
                let mut bytes = self.read(chunk.start, (chunk.end - chunk.start) as usize)?;
                crc = crc32c::crc32c_append(crc, &bytes[..4]);
                crc = crc32c::crc32c_append(crc, &bytes[CHUNK_HEAD..]);
                if crc != u32_at(&bytes, 4) {
                    return Err(refused(i, "is damaged"));
                }
                bytes.truncate(CHUNK_HEAD + chunk.frame);
                frames.push((bytes, chunk.blocks));
            }
            let unpacked: Vec<_> = frames
                .par_iter()
                .map(|(bytes, blocks)| unpack(&bytes[CHUNK_HEAD..], *blocks))
                .collect();
            for (i, unpacked) in unpacked.into_iter().enumerate() {
                for (key, block) in unpacked.map_err(|what| refused(i, what))? {
                    if !volume.insert(key, block)? {
                        return Err(refused(i, "has a block that was there already"));
                    }
                }
            }
        }
        Ok(volume)
    }

    /// Reads the grid's measures, the number of blocks, for which the bytes must have room, and the CRC.
    fn read_header(&mut self) -> Result<(VolumeOptions, usize, u32), VolumeFileError> {
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
        Ok((options, blocks as usize, crc))
    }

    /// Locates the chunks of `blocks` blocks, which must fill the file to its end.
    fn find_chunks(&mut self, blocks: usize) -> Result<Vec<Chunk>, VolumeFileError> {
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

/// Where a chunk is in the file.
struct Chunk {
    start: u64,
    /// The offset after its last byte.
    end: u64,
    /// Bytes of its zstd frame.
    frame: usize,
    blocks: usize,
}

fn u32_at(bytes: &[u8], at: usize) -> u32 {
    bytes.get(at..).and_then(<[u8]>::first_chunk).map_or(0, |&word| u32::from_le_bytes(word))
}
