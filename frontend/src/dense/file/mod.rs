//! A volume as a file, `volume.covis`, exact to the bit.
//!
//! ```text
//! header (36 bytes)  "covisvol"  version u32  voxel m f32  truncation m f32  0 u32
//!                    blocks u64  crc32c u32
//! chunk, one for each 256 blocks, the last for what is left
//!                    frame length u32  crc32c u32  zstd frame, zeros up to 128 bytes a block
//! ```
//!
//! Numbers are little endian. The CRC of a chunk covers its frame length, frame and zeros and goes on
//! from that of the chunk before, the first from the header's, so that no chunk can be missing, stand
//! elsewhere or be of another file. Each block has at least 128 bytes of the file: a reader knows from
//! the file's length how much memory its blocks can take, whatever the numbers in it say, and takes no
//! more than 33 bytes a byte of the file and 20 MiB, or than the ceiling that it is given. Blocks keep
//! their order; those that were on disk when the file was written come last.

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

/// How a file begins.
const MAGIC: &[u8; 8] = b"covisvol";
/// The version that is written, and the only one that is read.
const VERSION: u32 = 1;
/// Bytes of the header, its CRC included.
const HEADER: usize = 36;
/// Bytes before a chunk's frame.
const CHUNK_HEAD: usize = 8;
/// Blocks of a chunk, the last one excepted.
const BLOCKS_A_CHUNK: usize = 256;
/// Bytes of the file that a block has at least.
const BYTES_A_BLOCK: usize = 128;
/// Chunks that are packed or unpacked at a time: each holds two megabytes meanwhile.
const CHUNKS_AT_A_TIME: usize = 4;

/// Why a volume was not written or read. Offsets are bytes from the file's begin.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum VolumeFileError {
    /// The system says no.
    #[error("{action} {path}: {message}")]
    File {
        /// What was tried.
        action: &'static str,
        /// The file.
        path: String,
        /// What the system says.
        message: String,
    },
    /// It begins like another kind of file.
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
        /// Where the part begins that is not whole.
        offset: u64,
        /// Where it would end, at least.
        end: u64,
    },
    /// The header does not have its checksum.
    #[error("the header, bytes 0 to {HEADER}, is damaged")]
    Header,
    /// A size of the header makes no sense.
    #[error("the volume's {what} is {value}")]
    Measure {
        /// Which.
        what: &'static str,
        /// What it is, as text.
        value: String,
    },
    /// A chunk does not have its checksum.
    #[error("chunk {chunk}, at byte {offset}, is damaged")]
    Chunk {
        /// Which chunk, from 0.
        chunk: usize,
        /// Where it begins.
        offset: u64,
    },
    /// A chunk has its checksum and cannot be understood.
    #[error("chunk {chunk}, at byte {offset}, {what}")]
    Content {
        /// Which chunk, from 0.
        chunk: usize,
        /// Where it begins.
        offset: u64,
        /// What is wrong with it.
        what: &'static str,
    },
    /// Something stands behind the last chunk.
    #[error("the volume ends at byte {offset}, the file does not")]
    Trailing {
        /// Where the file should end.
        offset: u64,
    },
    /// The volume cannot be written in this format.
    #[error("the volume cannot be packed: {message}")]
    Packing {
        /// What the packer says.
        message: String,
    },
    /// Blocks that are on disk do not come back.
    #[error(transparent)]
    Pages(#[from] PageError),
}

/// Writes a volume; the file is there whole or not at all, and one that was there is replaced. Blocks on
/// disk stay there but for some megabytes at a time.
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
        // What cannot be removed either stays; the error is what counts.
        let _left = fs_err::remove_file(partial);
    })
}

/// Hands out the bytes of a volume's file, in order.
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
