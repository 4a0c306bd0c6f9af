//! The bytes of a journal file: a header, then records one after another. All numbers little-endian.
//!
//! ```text
//! header (44 bytes)   "covisjrn"  version u32  0 u32  uid [16]  first sequence u64  crc32c u32
//! record (24 + n)     crc32c u32  length n u32  sequence u64  durable u64  payload [n], n > 0
//! ```
//!
//! A record's checksum covers the map's uid, the rest of its head and the payload, so that bytes of
//! another map or place are not a valid record. `durable` is the last sequence that was synced when
//! the record was written: records after a bad place show by it whether anything there was ever
//! acknowledged. A record without payload is a mark: it is alone in its own file and says how far
//! the journal was synced when nothing was pending. Reading never fails, and never allocates a
//! length that exceeds the file.

use std::ops::Range;

/// Names a map's files, independent of the map's name.
pub(super) type Uid = [u8; 16];

/// The format that is written, and the latest that is read.
pub(super) const VERSION: u32 = 1;
/// Bytes of a file's header.
pub(super) const HEADER: usize = 44;
/// Bytes of a record before its payload.
pub(super) const HEAD: usize = 24;

const MAGIC: &[u8; 8] = b"covisjrn";

/// The header of a file whose first record has `first_sequence`.
pub(super) fn header(uid: &Uid, first_sequence: u64) -> Vec<u8> {
    let mut bytes = Vec::with_capacity(HEADER);
    bytes.extend_from_slice(MAGIC);
    bytes.extend_from_slice(&VERSION.to_le_bytes());
    bytes.extend_from_slice(&0_u32.to_le_bytes());
    bytes.extend_from_slice(uid);
    bytes.extend_from_slice(&first_sequence.to_le_bytes());
    bytes.extend_from_slice(&crc32c::crc32c(&bytes).to_le_bytes());
    bytes
}

/// What a header says.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Header {
    /// A journal of this map that begins with this sequence.
    First(u64),
    /// A later version, which is not known here.
    Later(u32),
    /// No header.
    Bad,
}

/// Reads a header.
pub(super) fn read_header(bytes: &[u8], uid: &Uid) -> Header {
    let (Some(head), Some(crc)) = (bytes.get(..HEADER - 4), u32_at(bytes, HEADER - 4)) else {
        return Header::Bad;
    };
    if crc32c::crc32c(head) != crc || !head.starts_with(MAGIC) {
        return Header::Bad;
    }
    match (u32_at(head, 8), u64_at(head, 32)) {
        (Some(VERSION), Some(first)) if head.get(16..32) == Some(uid) => Header::First(first),
        (Some(version), _) if version > VERSION => Header::Later(version),
        _ => Header::Bad,
    }
}

/// The mark of a journal that is durable up to `sequence`, encoded.
pub(super) fn mark(uid: &Uid, sequence: u64) -> Vec<u8> {
    let mut bytes = Vec::with_capacity(HEAD);
    put_record(&mut bytes, uid, sequence, sequence, &[]);
    bytes
}

/// The sequence up to which a journal was durable, from its mark.
pub(super) fn read_mark(bytes: &[u8], uid: &Uid) -> Option<u64> {
    let is_whole = bytes.len() == HEAD && u32_at(bytes, 0)? == checksum(uid, &bytes[4..]);
    if is_whole { u64_at(bytes, 8) } else { None }
}

/// Appends a record. `false` if the payload is too long.
pub(super) fn put_record(
    out: &mut Vec<u8>,
    uid: &Uid,
    sequence: u64,
    durable: u64,
    payload: &[u8],
) -> bool {
    let Ok(length) = u32::try_from(payload.len()) else { return false };
    let start = out.len();
    out.extend_from_slice(&[0; 4]);
    out.extend_from_slice(&length.to_le_bytes());
    out.extend_from_slice(&sequence.to_le_bytes());
    out.extend_from_slice(&durable.to_le_bytes());
    out.extend_from_slice(payload);
    let crc = checksum(uid, &out[start + 4..]).to_le_bytes();
    out[start..start + 4].copy_from_slice(&crc);
    true
}

fn checksum(uid: &Uid, rest: &[u8]) -> u32 {
    crc32c::crc32c_append(crc32c::crc32c(uid), rest)
}

/// The length of the payload and the sequence in a record's head; `None` if no payload follows.
/// Nothing is checked.
pub(super) fn read_head(head: &[u8; HEAD]) -> Option<(u64, u64)> {
    let length = u64::from(u32_at(head, 4)?);
    Some((length, u64_at(head, 8)?)).filter(|&(length, _)| length > 0)
}

/// Whether head and payload are those of one record of the map `uid`.
pub(super) fn is_record(head: &[u8; HEAD], payload: &[u8], uid: &Uid) -> bool {
    let crc = crc32c::crc32c_append(checksum(uid, &head[4..]), payload);
    u32_at(head, 0) == Some(crc)
}

/// A record that was found.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct Record {
    /// Its event's sequence.
    pub(super) sequence: u64,
    /// The last sequence that was durable when it was written.
    pub(super) durable: u64,
    /// Its payload.
    pub(super) payload: Range<usize>,
}

/// The contents of a file.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct Scan {
    /// In the order of the file.
    pub(super) records: Vec<Record>,
    /// How many records are before the first bad place.
    pub(super) clean: usize,
    /// The first byte that belongs to no record, if there is one.
    pub(super) bad: Option<usize>,
    /// The last durable sequence that any record gives.
    pub(super) durable: u64,
}

/// Reads a file whose records begin with `first_sequence`, past bad places too.
pub(super) fn scan(bytes: &[u8], uid: &Uid, first_sequence: u64) -> Scan {
    let mut scan = Scan { records: Vec::new(), clean: 0, bad: None, durable: 0 };
    let mut last = first_sequence.saturating_sub(1);
    let mut at = HEADER;
    // After a bad place the search goes byte by byte; the budget bounds its cost to a multiple of
    // reading.
    let mut budget = bytes.len().saturating_mul(64);
    if read_header(bytes, uid) != Header::First(first_sequence) {
        scan.bad = Some(0);
        at = HEADER.min(bytes.len());
    }
    while at < bytes.len() {
        let record = record_at(bytes, at, uid, last, &mut budget);
        let record =
            record.filter(|r| scan.bad.is_some() || Some(r.sequence) == last.checked_add(1));
        let Some(record) = record else {
            scan.bad.get_or_insert(at);
            at += 1;
            continue;
        };
        at = record.payload.end;
        last = record.sequence;
        scan.durable = scan.durable.max(record.durable);
        scan.clean += usize::from(scan.bad.is_none());
        scan.records.push(record);
    }
    scan
}

/// The record at `at`, if there is one that may follow the sequence `last`.
fn record_at(bytes: &[u8], at: usize, uid: &Uid, last: u64, budget: &mut usize) -> Option<Record> {
    let length = usize::try_from(u32_at(bytes, at + 4)?).ok()?;
    let sequence = u64_at(bytes, at + 8)?;
    // The cheap checks are first, because a bad place is searched byte by byte.
    let start = at.checked_add(HEAD)?;
    let end = start.checked_add(length)?;
    if length == 0 || sequence <= last || end > bytes.len() {
        return None;
    }
    *budget = budget.checked_sub(end - at)?;
    if u32_at(bytes, at)? != checksum(uid, &bytes[at + 4..end]) {
        return None;
    }
    Some(Record { sequence, durable: u64_at(bytes, at + 16)?, payload: start..end })
}

fn u32_at(bytes: &[u8], at: usize) -> Option<u32> {
    bytes.get(at..)?.first_chunk().map(|&b| u32::from_le_bytes(b))
}

fn u64_at(bytes: &[u8], at: usize) -> Option<u64> {
    bytes.get(at..)?.first_chunk().map(|&b| u64::from_le_bytes(b))
}
