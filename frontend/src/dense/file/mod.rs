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

#[cfg(any(test, feature = "fuzzing"))]
pub mod fuzzing;
mod reading;
#[cfg(test)]
mod tests;

use std::io::Write;
use std::path::Path;

use rayon::prelude::*;

use super::block::{Block, BlockKey};
use super::packing::pack;
use super::paged::PagedVolume;
use super::pages::PageError;
use super::volume::VolumeOptions;
pub use reading::{decode, load};

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
    #[error("this is no volume: it does not begin with \"covisvol\"")]
    Magic,
    /// Another version of covis wrote it.
    #[error("the volume has version {found}, and {VERSION} is the only one known here")]
    Version {
        /// The file's version.
        found: u32,
    },
    /// Bytes are missing at the end.
    #[error(
        "the volume is cut short: it has {length} bytes, what begins at byte {offset} ends at {end}"
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
    /// The checksum of a chunk does not match.
    #[error("chunk {chunk}, at byte {offset}, is damaged")]
    Chunk {
        /// Which chunk, from 0.
        chunk: usize,
        /// Where it begins.
        offset: u64,
    },
    /// The checksum of a chunk matches, but its content is invalid.
    #[error("chunk {chunk}, at byte {offset}, {what}")]
    Content {
        /// Which chunk, from 0.
        chunk: usize,
        /// Where it begins.
        offset: u64,
        /// What is wrong with it.
        what: &'static str,
    },
    /// There are bytes after the last chunk.
    #[error("the volume ends at byte {offset}, the file does not")]
    Trailing {
        /// Where the file should end.
        offset: u64,
    },
    /// The volume cannot be written in this format.
    #[error("the volume cannot be packed: {message}")]
    Packing {
        /// The packer's message.
        message: String,
    },
    /// Blocks cannot be read from disk.
    #[error(transparent)]
    Pages(#[from] PageError),
}

/// Writes a volume. The file is written completely or not at all, and replaces an existing one. Blocks
/// on disk stay there, except for some megabytes at a time.
///
/// # Errors
/// [`VolumeFileError::File`], [`VolumeFileError::Packing`] and [`VolumeFileError::Pages`].
pub fn save(volume: &mut PagedVolume, path: &Path) -> Result<(), VolumeFileError> {
    let mut partial = path.as_os_str().to_owned();
    partial.push(".partial");
    let partial = Path::new(&partial);
    let failed = |action, error: std::io::Error| VolumeFileError::File {
        action,
        path: path.display().to_string(),
        message: error.to_string(),
    };
    let mut write = || {
        let mut file =
            fs_err::File::create(partial).map_err(|error| failed("cannot create", error))?;
        encode(volume, |bytes| {
            file.write_all(bytes).map_err(|error| failed("cannot write", error))
        })?;
        file.sync_all().map_err(|error| failed("cannot write", error))?;
        fs_err::rename(partial, path).map_err(|error| failed("cannot name", error))
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
    header.extend_from_slice(&VERSION.to_le_bytes());
    header.extend_from_slice(&voxel_m.to_le_bytes());
    header.extend_from_slice(&truncation_m.to_le_bytes());
    header.extend_from_slice(&[0; 4]);
    header.extend_from_slice(&(volume.len() as u64).to_le_bytes());
    let mut crc = crc32c::crc32c(&header);
    header.extend_from_slice(&crc.to_le_bytes());
    write(&header)?;
    volume.visit(CHUNKS_AT_A_TIME * BLOCKS_A_CHUNK, |blocks: &[(BlockKey, &Block)]| {
        let chunks = blocks.par_chunks(BLOCKS_A_CHUNK);
        let packed: Vec<_> =
            chunks.map(|chunk| (pack(chunk), BYTES_A_BLOCK * chunk.len())).collect();
        for (frame, least) in packed {
            let packing =
                |error: std::io::Error| VolumeFileError::Packing { message: error.to_string() };
            let mut frame = frame.map_err(packing)?;
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
