//! What of an outbox does not fit memory: one file for a client on a map, appended to in order.
//!
//! ```text
//! file  = "COVISSP1" frame(uid of the map) frame(IngestRequest)*
//! frame = length (u32) CRC-32C of length and payload (u32) payload      numbers little-endian
//! ```
//!
//! The file is emptied when all in it is answered and removed with the session. It outlives the end of the
//! process, not that of the machine: nothing is synced. A process holds it by a lock. Whatever a file holds,
//! opening it fails or gives items whose checksums are right and whose sequences rise; the rest is moved to a
//! file beside it and reported in [`LeftOver`].

#[cfg(test)]
pub(super) mod tests;

use std::fmt;
use std::fs::{File, TryLockError};
use std::io::{self, Read, Seek, SeekFrom, Write};
use std::path::PathBuf;
use std::sync::Arc;

use fs_err as fs;
use prost::Message;

use super::{ClientError, NextIds};
use crate::wire::v1;

const MAGIC: &[u8] = b"COVISSP1";
/// Length and checksum before each payload.
const FRAME_HEAD: usize = 8;

/// Where a session keeps what the server has not answered, beyond what memory holds.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct SpillOptions {
    /// The folder; made where it does not exist. Each client on each map has a file of its own.
    pub directory: PathBuf,
    /// Longest file, bytes; past it sending waits, as it does without a folder.
    pub max_bytes: u64,
}

/// What an earlier session left in the file, and the new one sends first.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct LeftOver {
    /// The file.
    pub path: PathBuf,
    /// Its items.
    pub items: u64,
    /// The sequence of the last one.
    pub last_sequence: i64,
    /// Above the ids that they bring.
    pub next_ids: NextIds,
    /// What could not be read.
    pub damage: Option<SpillDamage>,
}

/// The end of a file that could not be read, for instance an item that was half written.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct SpillDamage {
    /// Where it begins, bytes.
    pub offset: u64,
    /// How long it is, bytes.
    pub bytes: u64,
    /// Where it was moved.
    pub moved_to: PathBuf,
}

/// An open file as it is used here.
pub(super) trait Medium: Read + Write + Seek + Send {
    /// Cuts the file off.
    fn set_len(&mut self, length: u64) -> io::Result<()>;
}

impl Medium for File {
    fn set_len(&mut self, length: u64) -> io::Result<()> {
        Self::set_len(self, length)
    }
}

/// The file of one session.
pub(super) struct Spill {
    path: PathBuf,
    medium: Box<dyn Medium>,
    max_bytes: u64,
    map_uid: String,
    /// Bytes that count; what is behind them was not written whole.
    length: u64,
    /// Where the first item stands that is not in memory.
    unread: u64,
    /// Of the last item; 0 without any.
    last_sequence: i64,
    /// Whether the last write failed.
    is_failing: bool,
}

impl fmt::Debug for Spill {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Spill").field("path", &self.path).finish_non_exhaustive()
    }
}

impl Spill {
    /// Opens the file of a client on a map, or makes it. The answer says what was left in it.
    pub(super) fn open(
        options: &SpillOptions,
        map_id: &str,
        client_id: &str,
        map_uid: &str,
    ) -> Result<(Self, Option<LeftOver>), ClientError> {
        let path = options.directory.join(file_name(map_id, client_id));
        let failed = |source| ClientError::Spill { path: path.clone(), source: Arc::new(source) };
        fs::create_dir_all(&options.directory).map_err(failed)?;
        let file = loop {
            let mut how = File::options();
            let file = how.read(true).write(true).create(true).truncate(false).open(&path);
            let file = file.map_err(failed)?;
            match file.try_lock() {
                Ok(()) => {}
                Err(TryLockError::WouldBlock) => return Err(ClientError::SpillInUse { path }),
                Err(TryLockError::Error(error)) => return Err(failed(error)),
            }
            // Who held it before may have removed it in between.
            if path.exists() {
                break file;
            }
        };
        let mut spill = Self::over(Box::new(file), path.clone(), options.max_bytes, map_uid);
        let left = spill.scan().map_err(failed)?;
        let Some((found, items, next_ids)) = left else { return Ok((spill, None)) };
        if found.uid.as_deref().is_some_and(|uid| uid != map_uid) {
            let (expected, uid) = (found.uid.unwrap_or_default(), map_uid.to_owned());
            return Err(ClientError::SpillOfAnotherMap { path, expected, uid });
        }
        let damage = match found.bytes - spill.length {
            0 => None,
            bytes => Some(spill.cut(bytes).map_err(failed)?),
        };
        if items == 0 {
            spill.clear();
        }
        let last_sequence = spill.last_sequence;
        let left = LeftOver { path, items, last_sequence, next_ids, damage };
        Ok((spill, Some(left)))
    }

    /// The file behind `medium`, taken to be empty.
    fn over(medium: Box<dyn Medium>, path: PathBuf, max_bytes: u64, map_uid: &str) -> Self {
        let (length, unread, map_uid) = (0, 0, map_uid.to_owned());
        Self {
            path,
            medium,
            max_bytes,
            map_uid,
            length,
            unread,
            last_sequence: 0,
            is_failing: false,
        }
    }

    /// Whether there are items that are not in memory.
    pub(super) fn has_unread(&self) -> bool {
        self.unread < self.length
    }

    /// Whether the file has items.
    pub(super) fn is_used(&self) -> bool {
        self.length > 0
    }

    /// The sequence of the last item; 0 without any.
    pub(super) fn last_sequence(&self) -> i64 {
        self.last_sequence
    }

    /// Appends an item; false where it does not fit, or cannot be written, which the log tells once.
    pub(super) fn append(&mut self, request: &v1::IngestRequest) -> bool {
        let mut bytes = Vec::new();
        if self.length == 0 {
            bytes.extend_from_slice(MAGIC);
            frame(&mut bytes, self.map_uid.as_bytes());
        }
        let head = bytes.len() as u64;
        frame(&mut bytes, &request.encode_to_vec());
        if self.length + bytes.len() as u64 > self.max_bytes {
            return false;
        }
        let seek = self.medium.seek(SeekFrom::Start(self.length));
        if let Err(error) = seek.and_then(|_| self.medium.write_all(&bytes)) {
            if !std::mem::replace(&mut self.is_failing, true) {
                let path = self.path.display();
                tracing::warn!(%error, "cannot write to {path}: sending waits for the server");
            }
            // What was half written is written over, or cut off when the file is opened again.
            let _kept = self.medium.set_len(self.length);
            return false;
        }
        self.is_failing = false;
        if self.length == 0 {
            self.unread = head;
        }
        self.length += bytes.len() as u64;
        self.last_sequence = request.sequence;
        true
    }

    /// Everything in the file is in memory.
    pub(super) fn mark_read(&mut self) {
        self.unread = self.length;
    }

    /// The next item that is not in memory.
    ///
    /// # Errors
    /// [`ClientError::Spill`] where the file no longer holds what was written.
    pub(super) fn next(&mut self) -> Result<v1::IngestRequest, ClientError> {
        let item = self.read_at(self.unread, self.length).and_then(|payload| {
            let payload = payload.ok_or_else(|| io::Error::from(io::ErrorKind::InvalidData))?;
            let request = v1::IngestRequest::decode(payload.as_slice())?;
            Ok((request, payload.len()))
        });
        let (request, bytes) = item.map_err(|source| ClientError::Spill {
            path: self.path.clone(),
            source: Arc::new(source),
        })?;
        self.unread += (FRAME_HEAD + bytes) as u64;
        Ok(request)
    }

    /// Forgets all items: they are answered.
    pub(super) fn clear(&mut self) {
        if let Err(error) = self.medium.set_len(0) {
            // Sequences tell the old items from those that are written over them.
            tracing::warn!(%error, "{} cannot be emptied", self.path.display());
        }
        (self.length, self.unread, self.last_sequence) = (0, 0, 0);
    }

    /// Reads a file from its beginning up to what is no item, and takes that for its length. `None`
    /// for an empty file.
    fn scan(&mut self) -> io::Result<Option<(ScanResult, u64, NextIds)>> {
        let bytes = self.medium.seek(SeekFrom::End(0))?;
        if bytes == 0 {
            return Ok(None);
        }
        self.medium.seek(SeekFrom::Start(0))?;
        let head = MAGIC.len() as u64;
        let mut magic = Vec::new();
        self.medium.as_mut().take(head).read_to_end(&mut magic)?;
        let uid = if magic == MAGIC { self.read_at(head, bytes)? } else { None };
        let uid = uid.and_then(|uid| String::from_utf8(uid).ok());
        let (mut items, mut next_ids) = (0, NextIds::default());
        let Some(uid) = uid else {
            return Ok(Some((ScanResult { uid: None, bytes }, items, next_ids)));
        };
        let mut at = head + (FRAME_HEAD + uid.len()) as u64;
        (self.unread, self.length) = (at, at);
        while let Some(payload) = self.read_at(at, bytes)? {
            let item = v1::IngestRequest::decode(payload.as_slice()).ok();
            let Some(item) = item.filter(|item| item.sequence > self.last_sequence) else { break };
            at += (FRAME_HEAD + payload.len()) as u64;
            (self.length, self.last_sequence) = (at, item.sequence);
            next_ids.take(item.item.as_ref());
            items += 1;
        }
        Ok(Some((ScanResult { uid: Some(uid), bytes }, items, next_ids)))
    }

    /// The payload of the frame at `offset` in a file of `end` bytes; `None` where there is none.
    fn read_at(&mut self, offset: u64, end: u64) -> io::Result<Option<Vec<u8>>> {
        let left = end.saturating_sub(offset);
        if left < FRAME_HEAD as u64 {
            return Ok(None);
        }
        let mut head = [0; FRAME_HEAD];
        self.medium.seek(SeekFrom::Start(offset))?;
        self.medium.read_exact(&mut head)?;
        let [l0, l1, l2, l3, c0, c1, c2, c3] = head;
        let length = [l0, l1, l2, l3];
        // Never more than the file has.
        let count = u32::from_le_bytes(length);
        if u64::from(count) > left - FRAME_HEAD as u64 {
            return Ok(None);
        }
        let mut payload = vec![0; count as usize];
        self.medium.read_exact(&mut payload)?;
        let is_whole = checksum(length, &payload) == u32::from_le_bytes([c0, c1, c2, c3]);
        Ok(is_whole.then_some(payload))
    }

    /// Moves the last `bytes` of the file, which are no items, to a file of their own.
    fn cut(&mut self, bytes: u64) -> io::Result<SpillDamage> {
        let offset = self.length;
        let mut moved_to = self.path.clone().into_os_string();
        moved_to.push(format!(".damaged-{offset}"));
        let moved_to = PathBuf::from(moved_to);
        self.medium.seek(SeekFrom::Start(offset))?;
        io::copy(&mut self.medium.as_mut().take(bytes), &mut fs::File::create(&moved_to)?)?;
        self.medium.set_len(offset)?;
        tracing::warn!(
            "{}: the rest from byte {offset} cannot be read, its {bytes} bytes were moved to {}",
            self.path.display(),
            moved_to.display()
        );
        Ok(SpillDamage { offset, bytes, moved_to })
    }
}

impl Drop for Spill {
    /// A file without items has nothing to say to the next session.
    fn drop(&mut self) {
        // What could not be read is not gone because of it.
        if self.medium.seek(SeekFrom::End(0)).is_ok_and(|bytes| bytes == 0) {
            let _others = fs::remove_file(&self.path);
        }
    }
}

/// What a scan finds besides items.
struct ScanResult {
    /// The map, where the file's head is whole.
    uid: Option<String>,
    /// The file's size.
    bytes: u64,
}

/// Names of maps and clients hold no dot; whatever else a caller gives stays within the folder.
fn file_name(map_id: &str, client_id: &str) -> String {
    let legal = |c: char| if c.is_ascii_alphanumeric() || c == '-' { c } else { '_' };
    let legal = |name: &str| name.chars().map(legal).collect::<String>();
    format!("{}.{}.spill", legal(map_id), legal(client_id))
}

fn frame(out: &mut Vec<u8>, payload: &[u8]) {
    // A message of 4 GiB does not come this far: the server's limit is below it.
    let length = u32::try_from(payload.len()).unwrap_or(u32::MAX).to_le_bytes();
    out.extend_from_slice(&length);
    out.extend_from_slice(&checksum(length, payload).to_le_bytes());
    out.extend_from_slice(payload);
}

fn checksum(length: [u8; 4], payload: &[u8]) -> u32 {
    crc32c::crc32c_append(crc32c::crc32c(&length), payload)
}
