//! The files of a recording: MCAP and SQLite, told apart by their first bytes. Each is gone through once
//! for the index, and then asked for single messages.
//!
//! No file is held in memory: at most a few decompressed chunks, and one message.

#[cfg(feature = "sqlite")]
mod database;
#[cfg(not(feature = "sqlite"))]
#[path = "no_database.rs"]
mod database;
mod mcap_file;
mod mcap_record;

use std::fs::File;
use std::io::Read;
use std::path::Path;

use super::error::RecordingError;
use super::index::{Index, Place};
use database::Database;
use mcap_file::McapFile;

/// No message that is longer is read: as no image file is.
const MAX_MESSAGE_BYTES: u64 = 256 << 20;

const ZSTD_MAGIC: [u8; 4] = [0x28, 0xb5, 0x2f, 0xfd];

/// An open file.
#[derive(Debug)]
pub(super) enum Storage {
    Mcap(McapFile),
    Database(Database),
}

impl Storage {
    /// Opens a file; what it is, its first bytes say.
    pub(super) fn open(path: &Path) -> Result<Self, RecordingError> {
        let failed = |source| RecordingError::Read { path: path.to_owned(), source };
        let mut begin = Vec::new();
        let mut file = File::open(path).map_err(failed)?;
        file.by_ref().take(16).read_to_end(&mut begin).map_err(failed)?;
        if begin.starts_with(&mcap_record::MAGIC) {
            return Ok(Self::Mcap(McapFile::new(file, path).map_err(failed)?));
        }
        if begin.starts_with(b"SQLite format 3\0") {
            return Ok(Self::Database(Database::open(path)?));
        }
        let path = path.to_owned();
        if begin.starts_with(&ZSTD_MAGIC) {
            return Err(RecordingError::Compressed { path });
        }
        if begin.starts_with(b"#ROSBAG V") {
            return Err(RecordingError::Ros1 { path });
        }
        Err(RecordingError::Format { path })
    }

    /// Adds its topics and messages to the index, as those of the file with this number.
    pub(super) fn scan(&mut self, file: usize, index: &mut Index) -> Result<(), RecordingError> {
        match self {
            Self::Mcap(records) => records.scan(file, index),
            Self::Database(database) => database.scan(file, index),
        }
    }

    /// Reads a message.
    pub(super) fn read(&mut self, place: Place, into: &mut Vec<u8>) -> Result<(), RecordingError> {
        into.clear();
        match self {
            Self::Mcap(records) => records.read(place, into),
            Self::Database(database) => database.read(place, into),
        }
    }
}

/// Refuses messages that are too long.
fn check_length(path: &Path, bytes: u64) -> Result<(), RecordingError> {
    if bytes <= MAX_MESSAGE_BYTES {
        return Ok(());
    }
    Err(RecordingError::TooLong { path: path.to_owned(), bytes, most: MAX_MESSAGE_BYTES })
}

#[cfg(test)]
mod tests;
