//! Reads a journal one piece at a time while it is written.
//!
//! The last events are read from memory, older ones from the files. Only one file is open and one
//! piece is in memory. Only durable records are read from files, because they are complete. The
//! writer's locks are held only to copy a list, never during a read.

use std::io::{self, BufReader, Read};
use std::path::PathBuf;
use std::sync::Arc;

use async_trait::async_trait;

use super::journal::Journal;
use super::record::{HEAD, HEADER, Header, is_record, read_head, read_header};
use super::{blocking, file_error, journal_name};
use crate::store::encoding::decode_event;
use crate::store::reader::PIECE_EVENTS;
use crate::store::{EventReader, Piece, StoreError};

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
            let event = decode_event(&payload).map_err(|error| {
                let message = format!("event {next}: {error}");
                StoreError::Content { path: open.path.display().to_string(), message }
            })?;
            piece.events.push(Arc::new(event));
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
