//! `map.covis`: a whole map as one file that can be moved to another server.
//!
//! ```text
//! "covisexp"  version u32  needs u32  crc32c u32 of the 16 bytes before
//! record: length u32 (at least 1)  crc32c u32 of the part  part [length]: MapPart
//! end:    0 u32  crc32c u32 of all that stands before the end
//! ```
//!
//! Numbers are little-endian. `version` is the writer's; it grows with every field that a map gets.
//! `needs` is the lowest version whose readers get the same map without what they do not know: such a
//! reader skips unknown fields. The state hash is compared where reader and writer have the same
//! version. Written and read part by part. What a reader makes is checked down to each number, since
//! the file comes from outside; nothing here knows disks or messages of the wire.

use std::io::{self, Read};

use super::encoding::{EncodingError, Parts, PartsReader};
use covis_map::{Map, Usage};

/// The name of the file in an export.
pub const MAP_FILE: &str = "map.covis";
const MAGIC: &[u8; 8] = b"covisexp";
/// The version that is written.
const VERSION: u32 = 2;
/// The lowest version that reads it.
const NEEDS: u32 = 1;
const HEAD: usize = 20;
const RECORD_HEAD: usize = 8;
/// A longer record is damage, not a part of a map.
const LONGEST_RECORD: u32 = 1 << 28;
/// Bytes of a record that are read before the caller is asked again: those of a chunk of an upload.
const PIECE: u64 = 1 << 20;

/// Writes a map as a file, piece by piece.
#[derive(Debug, Default)]
pub struct MapFileWriter {
    parts: Parts,
    /// Of the bytes so far; `None` before the first one.
    crc: Option<u32>,
    is_done: bool,
}

impl MapFileWriter {
    /// Appends records to `out` until it has more than `most` bytes; returns whether there are
    /// more. The map is the same at each call.
    pub fn put(&mut self, map: &Map, most: usize, out: &mut Vec<u8>) -> bool {
        while out.len() <= most && !self.is_done {
            let start = out.len();
            let Some(crc) = self.crc else {
                put_head(VERSION, NEEDS, out);
                self.crc = Some(crc32c::crc32c(&out[start..]));
                continue;
            };
            match self.parts.next(map) {
                // No client yet: a record without bytes would be the end.
                Some(part) if part.is_empty() => {}
                Some(part) => {
                    put_record(&part, out);
                    self.crc = Some(crc32c::crc32c_append(crc, &out[start..]));
                }
                None => {
                    put_end(crc, out);
                    self.is_done = true;
                }
            }
        }
        !self.is_done
    }
}

fn put_head(version: u32, needs: u32, out: &mut Vec<u8>) {
    let start = out.len();
    out.extend_from_slice(MAGIC);
    out.extend_from_slice(&version.to_le_bytes());
    out.extend_from_slice(&needs.to_le_bytes());
    let crc = crc32c::crc32c(&out[start..]);
    out.extend_from_slice(&crc.to_le_bytes());
}

fn put_record(part: &[u8], out: &mut Vec<u8>) {
    // A keyframe's observations fill no such record: limits of memory are far below.
    let length = u32::try_from(part.len()).unwrap_or(u32::MAX);
    out.extend_from_slice(&length.to_le_bytes());
    out.extend_from_slice(&crc32c::crc32c(part).to_le_bytes());
    out.extend_from_slice(part);
}

fn put_end(crc: u32, out: &mut Vec<u8>) {
    out.extend_from_slice(&0_u32.to_le_bytes());
    out.extend_from_slice(&crc.to_le_bytes());
}

/// A file of a later version with these parts, each behind its length, as snapshots have them.
#[cfg(any(test, feature = "fuzzing"))]
pub(super) fn with_checksums(mut parts: &[u8]) -> Vec<u8> {
    let mut out = Vec::new();
    put_head(VERSION + 1, VERSION, &mut out);
    while let Some((length, rest)) = parts.split_first_chunk() {
        let length = usize::try_from(u64::from_le_bytes(*length)).unwrap_or(usize::MAX);
        let (part, rest) = rest.split_at(length.min(rest.len()));
        put_record(part, &mut out);
        parts = rest;
    }
    put_end(crc32c::crc32c(&out), &mut out);
    out
}

/// Why bytes are no map.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[allow(missing_docs, reason = "the messages say what the fields are")]
pub enum MapFileError {
    /// The bytes are damaged, or end too early.
    #[error("byte {offset}: {reason}")]
    Damaged {
        /// The first byte of what cannot be read.
        offset: u64,
        reason: String,
    },
    /// A later version wrote the file, and this one cannot read it.
    #[error(
        "the file needs version {needs} of the format, and this covis reads up to version {VERSION}"
    )]
    Later { needs: u32 },
    /// The caller stopped the reading.
    #[error("the reading was stopped")]
    Stopped,
}

/// Reads a file. `more` sees what was read so far, with the file's bytes as the estimate of memory, also
/// within a record; it returns whether to go on.
///
/// # Errors
/// [`MapFileError`].
pub fn read_map_file(
    input: &mut dyn Read,
    more: &mut dyn FnMut(Usage) -> bool,
) -> Result<Map, MapFileError> {
    let mut file = Summed { input, crc: 0, offset: 0 };
    let mut head = [0; HEAD];
    file.fill(&mut head, "the file ends within its head")?;
    let number = |at: usize| head[at..].first_chunk().map_or(0, |&bytes| u32::from_le_bytes(bytes));
    let damaged =
        |offset, reason: &str| MapFileError::Damaged { offset, reason: reason.to_owned() };
    if !head.starts_with(MAGIC) {
        return Err(damaged(0, "it is not a map of covis"));
    }
    if crc32c::crc32c(&head[..16]) != number(16) {
        return Err(damaged(8, "the checksum of the head does not fit"));
    }
    let (version, needs) = (number(8), number(12));
    if needs > VERSION {
        return Err(MapFileError::Later { needs });
    }
    if version == 0 || needs == 0 || needs > version {
        return Err(damaged(8, "there is no such version"));
    }
    let mut joined = PartsReader::default();
    let mut counted = Usage::default();
    let mut part = Vec::new();
    loop {
        let (start, crc) = (file.offset, file.crc);
        let mut record = [0; RECORD_HEAD];
        file.fill(&mut record, "the file ends before its end record")?;
        let number = |at: usize| record[at..].first_chunk().map_or(0, |&b| u32::from_le_bytes(b));
        let (length, sum) = (number(0), number(4));
        if length == 0 {
            if sum != crc {
                return Err(damaged(start, "the checksum of the file does not fit"));
            }
            break;
        }
        if length > LONGEST_RECORD {
            return Err(damaged(start, "the length of a record is invalid"));
        }
        file.part(length, &mut part, &mut |bytes| more(Usage { bytes, ..counted }))?;
        if crc32c::crc32c(&part) != sum {
            return Err(damaged(start, "the checksum of a record does not fit"));
        }
        let added = joined.add(&part, version > VERSION);
        counted = added.map_err(|error| damaged(start, &error.to_string()))?;
        if !more(Usage { bytes: file.offset, ..counted }) {
            return Err(MapFileError::Stopped);
        }
    }
    let end = file.offset;
    if file.input.take(1).read_to_end(&mut part).map_or(true, |read| read > 0) {
        return Err(damaged(end, "the file goes on behind its end record"));
    }
    let whole = |error: EncodingError| damaged(HEAD as u64, &error.to_string());
    let map = joined.finish(version == VERSION).map_err(whole)?;
    map.check_sound().map_err(|error| whole(error.into()))?;
    Ok(map)
}

/// A reader that sums up what passes.
struct Summed<'a> {
    input: &'a mut dyn Read,
    crc: u32,
    offset: u64,
}

impl Summed<'_> {
    fn fill(&mut self, out: &mut [u8], reason: &str) -> Result<(), MapFileError> {
        let offset = self.offset;
        let damaged = |_: io::Error| MapFileError::Damaged { offset, reason: reason.to_owned() };
        self.input.read_exact(out).map_err(damaged)?;
        self.passed(out);
        Ok(())
    }

    /// Reads a part; memory grows with the bytes that are really there, and `more` sees how many of
    /// the file these are.
    fn part(
        &mut self,
        length: u32,
        part: &mut Vec<u8>,
        more: &mut dyn FnMut(u64) -> bool,
    ) -> Result<(), MapFileError> {
        part.clear();
        let mut left = u64::from(length);
        while left > 0 {
            let read = self.input.take(left.min(PIECE)).read_to_end(part).unwrap_or(0) as u64;
            if read == 0 {
                let reason = "the file ends within a record".to_owned();
                return Err(MapFileError::Damaged { offset: self.offset, reason });
            }
            left -= read;
            if !more(self.offset + part.len() as u64) {
                return Err(MapFileError::Stopped);
            }
        }
        self.passed(part);
        Ok(())
    }

    fn passed(&mut self, bytes: &[u8]) {
        self.crc = crc32c::crc32c_append(self.crc, bytes);
        self.offset += bytes.len() as u64;
    }
}

#[cfg(test)]
mod tests;
