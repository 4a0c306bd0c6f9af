//! Reading events and snapshots of a map, and writing a snapshot that is known to read back. All of
//! these functions block.
//!
//! [`Reader`] reads a journal one piece at a time while it is written: the last events from memory,
//! older ones from the files. Only one file is open and one piece is in memory. Only durable records
//! are read from files, because they are complete. The writer's locks are held only to copy a list,
//! never during a read.

use std::io::{self, BufReader, Read};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::Instant;

use async_trait::async_trait;

use super::journal::Journal;
use super::record::{HEAD, HEADER, Header, is_record, read_head, read_header, scan};
use super::{blocking, file_error, journal_name, sealed, snapshot_name, whole_file};
use crate::encoding::{EncodingError, decode_event, outline};
use crate::reader::PIECE_EVENTS;
use crate::{Damage, EventOutline, EventReader, Piece, StoreError, UnreadableEvent, sequence_of};
use covis_map::{Event, Map};

/// Snapshots that are kept: if the newest does not open, the previous one and the journal after it
/// still give the whole map.
const KEPT_SNAPSHOTS: usize = 2;

/// Events that follow each other, up to the first one that cannot be read.
pub(super) struct ReadEvents {
    pub(super) events: Vec<Arc<Event>>,
    /// The event after these, where its bytes are intact and are no event that is known here. The events
    /// from it up to the last one that was asked for are lost.
    pub(super) unreadable: Option<Damage>,
}

/// The events after `from` up to `last`, as far as they are contiguous and can be read.
///
/// # Errors
/// [`StoreError::File`].
pub(super) fn events(journal: &Journal, from: u64, last: u64) -> Result<ReadEvents, StoreError> {
    let mut events = Vec::new();
    let mut unreadable = None;
    each_record(journal, from, last, |record| {
        let error = match decode_event(record.payload) {
            Ok(event) => {
                events.push(Arc::new(event));
                return true;
            }
            Err(error) => error,
        };
        let event = UnreadableEvent {
            sequence: record.sequence,
            kind: outline(record.payload).kind,
            is_later: error == EncodingError::Later,
            reason: error.to_string(),
        };
        let (file, lost) = (record.path.display().to_string(), Some((record.sequence, last)));
        unreadable =
            Some(Damage { file, offset: record.offset, lost, unreadable: Some(Box::new(event)) });
        false
    })?;
    Ok(ReadEvents { events, unreadable })
}

/// What the events after `from` up to `last` are, whether or not they can be read.
///
/// # Errors
/// [`StoreError::File`].
pub(super) fn outlines(
    journal: &Journal,
    from: u64,
    last: u64,
) -> Result<Vec<EventOutline>, StoreError> {
    let mut outlines = Vec::new();
    each_record(journal, from, last, |record| {
        outlines.push(outline(record.payload));
        true
    })?;
    Ok(outlines)
}

/// A record of a journal whose checksum fits.
struct Record<'a> {
    sequence: u64,
    payload: &'a [u8],
    path: &'a Path,
    /// Where it begins in the file.
    offset: u64,
}

/// Visits the records after `from` up to `last`, as far as they are contiguous and until `visit` answers
/// `false`.
fn each_record(
    journal: &Journal,
    from: u64,
    last: u64,
    mut visit: impl FnMut(Record<'_>) -> bool,
) -> Result<(), StoreError> {
    let segments = journal.segments();
    let mut next = from + 1;
    // The file that holds `next`, and those after it.
    let start = segments.iter().rposition(|&first| first <= next).unwrap_or(0);
    for &first in &segments[start.min(segments.len())..] {
        let path = &journal.folder.join(journal_name(first));
        let bytes = journal.disk.read(path).map_err(|e| file_error("cannot read", path, &e))?;
        for record in scan(&bytes, &journal.uid, first).records {
            if record.sequence != next || next > last {
                continue;
            }
            let offset = record.payload.start.saturating_sub(HEAD) as u64;
            let (sequence, payload) = (next, &bytes[record.payload]);
            if !visit(Record { sequence, payload, path, offset }) {
                return Ok(());
            }
            next += 1;
        }
    }
    Ok(())
}

/// The event of a record of the file `path`.
fn decoded(payload: &[u8], sequence: u64, path: &Path) -> Result<Arc<Event>, StoreError> {
    decode_event(payload).map(Arc::new).map_err(|error| {
        let message = format!("event {sequence}: {error}");
        StoreError::Content { path: path.display().to_string(), message }
    })
}

/// The newest snapshot that opens; snapshots that do not open are set aside.
///
/// # Errors
/// [`StoreError::File`].
pub(super) fn newest_snapshot(journal: &Journal) -> Result<Option<Arc<Map>>, StoreError> {
    loop {
        let newest = journal.state().snapshots.last().copied();
        let Some(sequence) = newest else { return Ok(None) };
        if let Some(map) = snapshot_at(journal, sequence)? {
            return Ok(Some(map));
        }
    }
}

/// The snapshot at a sequence; `None` where a newer one has replaced it, or where it does not open and is
/// set aside.
///
/// # Errors
/// [`StoreError::File`].
pub(super) fn snapshot_at(
    journal: &Journal,
    sequence: u64,
) -> Result<Option<Arc<Map>>, StoreError> {
    let path = journal.folder.join(snapshot_name(sequence));
    let is_kept = || journal.state().snapshots.contains(&sequence);
    if !is_kept() {
        return Ok(None);
    }
    let mut file = match journal.disk.stream(&path) {
        Ok(file) => file,
        // It was removed in between.
        Err(_gone) if !is_kept() => return Ok(None),
        Err(error) => return Err(file_error("cannot read", &path, &error)),
    };
    let reason = match sealed::read_snapshot(&mut file) {
        Ok(map) => return Ok(Some(map)),
        Err(error) => error.damage(&path)?,
    };
    tracing::error!(file = %path.display(), reason, "a snapshot does not open");
    let mut state = journal.state();
    state.snapshots.retain(|&kept| kept != sequence);
    state.damage.push(whole_file(&path));
    Ok(None)
}

/// Writes a snapshot, reads it back, and removes all but the newest ones.
///
/// It is written and read back part by part. Neither the file nor a third map is ever in memory,
/// besides this map and the engine's newer one.
///
/// # Errors
/// [`StoreError::File`]; [`StoreError::Content`] if it cannot be read back; it is then removed.
pub(super) fn put_snapshot(journal: &Journal, map: &Map) -> Result<(), StoreError> {
    let (start, meters) = (Instant::now(), &journal.meters);
    let written = write_snapshot(journal, map);
    match &written {
        Ok(bytes) => {
            meters.snapshot_ns.observe_time(start.elapsed());
            meters.snapshot_bytes.add(*bytes);
        }
        Err(_) => meters.snapshot_failures.increment(),
    }
    written.map(|_bytes| ())
}

/// Returns its size in bytes.
fn write_snapshot(journal: &Journal, map: &Map) -> Result<u64, StoreError> {
    let sequence = sequence_of(map.revision());
    let path = journal.folder.join(snapshot_name(sequence));
    let bytes = sealed::write_snapshot(&*journal.disk, &path, &journal.uid, map)?;
    let mut snapshots = journal.state().snapshots.clone();
    snapshots.push(sequence);
    let old = snapshots.len().saturating_sub(KEPT_SNAPSHOTS);
    let old: Vec<u64> = snapshots.drain(..old).collect();
    // The snapshot is complete, whether or not older ones can be removed.
    journal.snapshot_taken(sequence, snapshots);
    for old in old {
        let path = journal.folder.join(snapshot_name(old));
        if let Err(error) = journal.disk.remove(&path) {
            tracing::warn!(file = %path.display(), %error, "an old snapshot is left");
        }
    }
    Ok(bytes)
}

/// A piece ends with the event that exceeds this many bytes.
const PIECE_BYTES: u64 = 1 << 20;

/// The position of a reader.
pub(super) struct Reader {
    journal: Arc<Journal>,
    /// The last sequence that was read.
    at: u64,
    through: u64,
    /// The file that is read; positioned after the record of `at`, or before it if it was just
    /// opened.
    file: Option<Open>,
}

struct Open {
    first: u64,
    path: PathBuf,
    input: BufReader<Box<dyn Read + Send>>,
}

impl Reader {
    pub(super) fn new(journal: Arc<Journal>, from: u64, through: u64) -> Self {
        Self { journal, at: from, through, file: None }
    }
}

#[async_trait]
impl EventReader for Reader {
    async fn next(&mut self) -> Result<Piece, StoreError> {
        if self.at >= self.through {
            return Ok(Piece::default());
        }
        let dropped = self.journal.state().dropped;
        if self.at < dropped {
            let map = self.journal.name.clone();
            return Err(StoreError::Truncated { map, through: dropped });
        }
        let piece = match self.journal.recent_piece(self.at, self.through, PIECE_EVENTS) {
            Some(piece) => piece,
            None => {
                // The events of a stopped journal can still be read.
                let _stopped = self.journal.wait_durable().await;
                let (journal, at, through) = (Arc::clone(&self.journal), self.at, self.through);
                let file = self.file.take();
                let disk = Arc::clone(&self.journal.disk);
                let read = blocking(&*disk, move || read_piece(&journal, at, through, file));
                let (piece, file) = read.await?;
                self.file = file;
                piece
            }
        };
        self.at += piece.events.len() as u64;
        Ok(piece)
    }
}

/// The events after `at`, as many as make a piece, and the file positioned after them.
fn read_piece(
    journal: &Journal,
    at: u64,
    through: u64,
    mut file: Option<Open>,
) -> Result<(Piece, Option<Open>), StoreError> {
    let (mut piece, mut next) = (Piece::default(), at + 1);
    let mut payload = Vec::new();
    while next <= through && piece.bytes < PIECE_BYTES && piece.events.len() < PIECE_EVENTS {
        let mut open = match file.take() {
            Some(open) => open,
            None => match open_at(journal, next)? {
                Some(open) => open,
                None => break,
            },
        };
        let failed = |error: &io::Error| file_error("cannot read", &open.path, error);
        let found = read_record(&mut open.input, journal, &mut payload);
        let Some(sequence) = found.map_err(|error| failed(&error))? else {
            // The end of a file: there is more where another one begins with `next`.
            if open.first < next && journal.segments().contains(&next) {
                continue;
            }
            break;
        };
        if sequence == next {
            piece.events.push(decoded(&payload, next, &open.path)?);
            piece.bytes += payload.len() as u64;
            next += 1;
        } else if sequence > next {
            break;
        }
        file = Some(open);
    }
    Ok((piece, file))
}

/// Opens the file that holds `sequence`.
fn open_at(journal: &Journal, sequence: u64) -> Result<Option<Open>, StoreError> {
    let segments = journal.segments();
    let Some(&first) = segments.iter().rev().find(|&&first| first <= sequence) else {
        return Ok(None);
    };
    let path = journal.folder.join(journal_name(first));
    let failed = |error: &io::Error| file_error("cannot read", &path, error);
    let input = journal.disk.stream(&path).map_err(|error| failed(&error))?;
    let mut input = BufReader::with_capacity(1 << 16, input);
    let mut header = [0; HEADER];
    input.read_exact(&mut header).map_err(|error| failed(&error))?;
    if read_header(&header, &journal.uid) != Header::First(first) {
        return Err(failed(&io::ErrorKind::InvalidData.into()));
    }
    Ok(Some(Open { first, path, input }))
}

/// Reads the next record; Returns its sequence; `None` at the end of the complete records.
fn read_record(
    input: &mut impl Read,
    journal: &Journal,
    payload: &mut Vec<u8>,
) -> io::Result<Option<u64>> {
    let mut head = [0; HEAD];
    match input.read_exact(&mut head) {
        Err(error) if error.kind() == io::ErrorKind::UnexpectedEof => return Ok(None),
        read => read?,
    }
    let Some((length, sequence)) = read_head(&head) else { return Ok(None) };
    payload.clear();
    // No more memory is reserved than the file has bytes.
    let read = input.take(length).read_to_end(payload)?;
    let is_whole = read as u64 == length && is_record(&head, payload, &journal.uid);
    Ok(is_whole.then_some(sequence))
}
