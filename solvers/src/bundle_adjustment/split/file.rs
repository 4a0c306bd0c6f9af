//! Sections in a file, written once, so that a worker reads those that it needs when it needs them.
//!
//! The sections' bytes one after the other, each with its checksum before it. Where each begins is
//! known to who wrote the file. The file belongs to one solve: it is no format to keep.

use std::io::{self, BufWriter, Read, Seek, SeekFrom, Write};
use std::path::Path;

use fs_err::File;

use super::codec::{CodecError, decode, encode};
use super::message::Source;
use super::section::Section;

/// Why a section cannot be read.
#[derive(Debug, thiserror::Error)]
pub(super) enum SectionFileError {
    /// The file cannot be read, or is shorter than it should be.
    #[error("a section cannot be read: {0}")]
    Read(#[from] io::Error),
    /// The bytes are not those that were written.
    #[error("{path}: the section at byte {offset} is damaged")]
    Checksum {
        /// The file.
        path: String,
        /// First byte.
        offset: u64,
    },
    /// The bytes are no section.
    #[error("a section cannot be read: {0}")]
    Codec(#[from] CodecError),
}

/// Writes sections to a new file; returns where each is.
pub(super) fn write_sections(
    path: &Path,
    sections: impl Iterator<Item = Section>,
) -> io::Result<Vec<Source>> {
    let mut file = BufWriter::new(File::create(path)?);
    let (mut sources, mut offset) = (Vec::new(), 0);
    for section in sections {
        let bytes = encode(&section);
        file.write_all(&crc32c::crc32c(&bytes).to_le_bytes())?;
        file.write_all(&bytes)?;
        let length = bytes.len() as u64 + 4;
        sources.push(Source::File { path: path.to_owned(), offset, length });
        offset += length;
    }
    file.flush()?;
    Ok(sources)
}

/// Reads a section.
pub(super) fn read_section(
    path: &Path,
    offset: u64,
    length: u64,
) -> Result<Section, SectionFileError> {
    let mut file = File::open(path)?;
    file.seek(SeekFrom::Start(offset))?;
    let mut bytes = Vec::new();
    file.take(length).read_to_end(&mut bytes)?;
    let Some((checksum, bytes)) = bytes.split_first_chunk::<4>() else {
        return Err(io::Error::from(io::ErrorKind::UnexpectedEof).into());
    };
    if bytes.len() as u64 + 4 != length || crc32c::crc32c(bytes) != u32::from_le_bytes(*checksum) {
        return Err(SectionFileError::Checksum { path: path.display().to_string(), offset });
    }
    Ok(decode(bytes)?)
}
