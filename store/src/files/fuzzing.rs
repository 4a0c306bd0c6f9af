//! Functions on files for the fuzz targets: build, seal, open, append.
//!
//! Built for tests and with the feature `fuzzing` only. Checksums are corrected here, so that the
//! code after the checksum test is reached. The fuzz targets check what was read.

use std::collections::BTreeMap;
use std::io::{self, ErrorKind, Read as _};
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use super::disk::{Disk, DiskFile};
use super::journal::Journal;
use super::load::load;
use super::record::{HEADER, Uid, header, mark as mark_of, put_record, scan};
use super::sealed::{Kind, parts, read_identity, read_snapshot, sealed, sealed_map, unseal};
use super::{FileStoreOptions, MARK, StoreError, journal_name, read, snapshot_name};
use crate::Epoch;
use crate::encoding::{decode_event, decode_identity, encode_identity};
use crate::fuzzing::fold;
use covis_map::{Change, Event, Map};

/// Most decompressed bytes of a snapshot that a target reads.
const MOST_BYTES: u64 = 1 << 20;

/// The uid that a journal file claims.
pub(crate) fn uid_of(bytes: &[u8]) -> Uid {
    bytes.get(16..).and_then(|rest| rest.first_chunk()).copied().unwrap_or_default()
}

/// The first sequence that a journal file claims.
pub(crate) fn first_of(bytes: &[u8]) -> u64 {
    let number = bytes.get(32..).and_then(|rest| rest.first_chunk()).copied();
    number.map_or(1, u64::from_le_bytes)
}

/// A journal file of payloads. Before each payload are its length (two bytes; all ones mean the
/// rest of the input) and its step in the sequence (one byte; 0 means 1, 255 leads to the last
/// possible sequence).
pub(crate) fn built(uid: &Uid, first: u64, mut parts: &[u8]) -> Vec<u8> {
    let mut bytes = header(uid, first);
    let mut sequence = first.saturating_sub(1);
    let mut durable = 0;
    while let Some((&[low, high, step], rest)) = parts.split_first_chunk::<3>() {
        let length = u16::from_le_bytes([low, high]);
        let length = if length == u16::MAX { rest.len() } else { usize::from(length) };
        let payload = &rest[..length.min(rest.len())];
        sequence = match step {
            u8::MAX => u64::MAX,
            step => sequence.saturating_add(u64::from(step.max(1))),
        };
        put_record(&mut bytes, uid, sequence, durable, payload);
        durable = sequence;
        parts = &rest[payload.len()..];
    }
    bytes
}

/// The payloads that a scan finds; checks the guarantees of the scan.
pub(crate) fn payloads<'a>(bytes: &'a [u8], uid: &Uid, first: u64) -> Vec<&'a [u8]> {
    let found = scan(bytes, uid, first);
    let rising = found.records.windows(2).all(|pair| {
        pair[0].sequence < pair[1].sequence && pair[0].payload.end < pair[1].payload.start
    });
    assert!(rising, "records are out of order: {found:?}");
    let clean = found.records[..found.clean].iter().zip(first..);
    assert!(clean.clone().all(|(record, sequence)| record.sequence == sequence), "{found:?}");
    assert!(found.bad.is_some() || found.clean == found.records.len(), "{found:?}");
    assert!(found.bad.is_none_or(|bad| bad < bytes.len().max(HEADER)), "{found:?}");
    found.records.into_iter().map(|record| &bytes[record.payload]).collect()
}

/// A snapshot file around a body, which is compressed here if it has plain parts. Its sequence is
/// the revision in the first part, if that is one byte.
pub(crate) fn sealed_snapshot(body: &[u8], compress: bool) -> Vec<u8> {
    let mut compressed = Vec::new();
    // The offset after the part's length, the head's tag and length, and the field's own tag.
    let at = if body.get(9).is_some_and(|length| length & 128 != 0) { 12 } else { 11 };
    let sequence = body.get(at).copied().filter(|&byte| byte < 128).map_or(0, u64::from);
    if compress {
        compressed = zstd::encode_all(body, 1).unwrap_or_default();
    }
    let body = if compress { &compressed } else { body };
    sealed(Kind::Snapshot, &[7; 16], sequence, body)
}

/// The map of a snapshot file, if it is one. Files that decompress to more than a target should try
/// are skipped, because covis holds the decompressed snapshot in memory.
pub(crate) fn unsealed(bytes: &[u8]) -> Option<Arc<Map>> {
    let length = unseal(Kind::Snapshot, &mut &*bytes, |_label, body| {
        Ok(io::copy(&mut parts(body)?.take(MOST_BYTES + 1), &mut io::sink()))
    });
    let (_label, length) = length.ok()?;
    let is_long = length.is_ok_and(|length| length > MOST_BYTES);
    if is_long { None } else { read_snapshot(&mut &*bytes).ok() }
}

/// The map that payloads (as [`built`] takes them) lead to, up to a revision.
fn folded(parts: &[u8], through: u64) -> Map {
    let bytes = built(&Uid::default(), 1, parts);
    let mut map = Map::new();
    for payload in payloads(&bytes, &Uid::default(), 1) {
        let Ok(event) = decode_event(payload) else { break };
        if map.revision() as u64 >= through || map.apply(&event).is_err() {
            break;
        }
    }
    map
}

/// An identity around a body: its content is written and read back.
pub(crate) fn identity(body: &[u8]) {
    let bytes = sealed(Kind::Identity, &[7; 16], 0, body);
    let name = match read_identity(&mut &*bytes) {
        Ok((_label, (_version, body))) => decode_identity(&body),
        Err(reason) => panic!("what was sealed does not open: {reason}"),
    };
    if let Ok(name) = name {
        assert_eq!(decode_identity(&encode_identity(&name)), Ok(name));
    }
}

/// A map's folder, opened and read.
struct Opened {
    journal: Journal,
    /// The last sequence that can be read.
    last: u64,
    /// Whether acknowledged events are lost, so that the map accepts no changes.
    is_damaged: bool,
    /// The newest snapshot.
    map: Option<Arc<Map>>,
    /// The events after it; none if a payload is not an event.
    events: Vec<Arc<Event>>,
}

/// Opens the folder `/map` of a disk; `None` if it is of a later version.
fn open(disk: &MemoryDisk, uid: &Uid) -> Option<Opened> {
    let folder = Path::new("/map");
    let disk: Arc<dyn Disk> = Arc::new(disk.clone());
    let options = FileStoreOptions::default();
    let journal =
        Journal::new("map", *uid, folder.to_owned(), Arc::clone(&disk), options, &Arc::default());
    let found = match load(&*disk, folder, uid) {
        Ok(found) => found,
        Err(StoreError::Later { .. }) => return None,
        Err(error) => panic!("a sound disk fails: {error}"),
    };
    let (last, mut is_damaged) = (found.last, found.lost.is_some());
    journal.loaded(found);
    assert_eq!(journal.flush(), None, "a sound disk has room");
    let map = match read::newest_snapshot(&journal) {
        Ok(map) => map,
        Err(StoreError::Later { .. }) => return None,
        Err(error) => panic!("a sound disk fails: {error}"),
    };
    let base = map.as_ref().map_or(0, |map| crate::sequence_of(map.revision()));
    let (events, unreadable) = match read::events(&journal, base, last) {
        Ok(read) => (read.events, read.unreadable),
        Err(_) => (Vec::new(), None),
    };
    if let Some(damage) = unreadable {
        is_damaged = true;
        journal.lose(damage);
    }
    assert!(events.len() as u64 <= last.saturating_sub(base), "more events than there can be");
    Some(Opened { journal, last, is_damaged, map, events })
}

/// Appends an event and flushes; returns how far the journal is then durable.
fn append(opened: &Opened, epoch: Epoch, event: Event) -> Result<u64, StoreError> {
    let journal = &opened.journal;
    journal.accept(epoch, opened.last, vec![Arc::new(event)])?;
    assert_eq!(journal.flush(), None, "a sound disk has room");
    let flushed = journal.follow().borrow().clone();
    flushed.failed.map_or(Ok(flushed.through), Err)
}

/// A map's folder with two journal files, a mark and a snapshot. The input's first eight bytes say
/// how it is cut and which parts get valid checksums. The first opening repairs; the second finds
/// nothing to repair and the same events. A map that lost nothing accepts an event and still has
/// it afterwards.
pub fn journal_folder(input: &[u8]) {
    let Some((head, rest)) = input.split_first_chunk::<8>() else { return };
    let [flags, second, snapshot, mark, a, b, c, d] = *head;
    let numbered = |byte: u8| if byte == u8::MAX { u64::MAX } else { u64::from(byte) };
    let cut = |share: u16| usize::from(share).min(rest.len());
    let one = cut(u16::from_le_bytes([a, b]));
    let two = cut(u16::from_le_bytes([c, d])).max(one);
    let uid = [7; 16];
    let segment = |first: u64, bytes: &[u8], build: bool| {
        if build { built(&uid, first, bytes) } else { bytes.to_vec() }
    };
    let disk = MemoryDisk::default();
    let put = |name: String, bytes: Vec<u8>| {
        disk.files().insert(Path::new("/map").join(name), bytes);
    };
    put(journal_name(1), segment(1, &rest[..one], flags & 1 != 0));
    if second > 1 {
        let first = numbered(second);
        put(journal_name(first), segment(first, &rest[one..two], flags & 2 != 0));
    }
    if flags & 8 != 0 {
        let map = folded(&rest[..one], numbered(snapshot));
        put(snapshot_name(numbered(snapshot)), sealed_map(&uid, &map));
    } else if snapshot > 0 {
        put(snapshot_name(numbered(snapshot)), rest[two..].to_vec());
    }
    if flags & 4 != 0 {
        put(MARK.to_owned(), mark_of(&uid, numbered(mark)));
    }
    let Some(opened) = open(&disk, &uid) else { return };
    let mut map = opened.map.as_deref().cloned().unwrap_or_default();
    fold(&mut map, opened.events.iter().map(|event| (**event).clone()));
    let Some(again) = open(&disk, &uid) else { panic!("what was mended does not open") };
    assert_eq!(
        (again.last, again.is_damaged),
        (opened.last, opened.is_damaged),
        "opening changes a map"
    );
    assert_eq!(again.events.len(), opened.events.len());
    if again.is_damaged {
        return;
    }
    let Some(revision) = again.last.checked_add(1).and_then(|r| i64::try_from(r).ok()) else {
        return;
    };
    let change = Change::ClientOpened { name: "robot".to_owned(), epoch: 1 };
    let event = Event { revision, time_ns: 0, cause: None, change };
    let durable = append(&again, Epoch(0), event);
    assert_eq!(durable, Ok(again.last + 1), "an event is accepted and does not become durable");
    let Some(third) = open(&disk, &uid) else { panic!("what was written does not open") };
    assert_eq!(
        (third.last, third.is_damaged),
        (again.last + 1, false),
        "an appended event is lost"
    );
}

/// A flat file system in memory on which no operation tears or fails, so that every error on it is a
/// bug of covis. Clones share it.
#[derive(Clone, Debug, Default)]
struct MemoryDisk(Arc<Mutex<BTreeMap<PathBuf, Vec<u8>>>>);

impl MemoryDisk {
    /// Its files by path.
    fn files(&self) -> MutexGuard<'_, BTreeMap<PathBuf, Vec<u8>>> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn with<R>(&self, path: &Path, action: impl FnOnce(&mut Vec<u8>) -> R) -> io::Result<R> {
        self.files().get_mut(path).map(action).ok_or_else(|| ErrorKind::NotFound.into())
    }

    fn file(&self, path: &Path) -> Box<dyn DiskFile> {
        Box::new(MemoryFile { disk: self.clone(), path: path.to_owned() })
    }
}

impl Disk for MemoryDisk {
    fn create_folder(&self, _path: &Path) -> io::Result<()> {
        Ok(())
    }

    fn list(&self, folder: &Path) -> io::Result<Vec<String>> {
        let files = self.files();
        let inside = files.keys().filter(|path| path.parent() == Some(folder));
        Ok(inside.filter_map(|p| Some(p.file_name()?.to_str()?.to_owned())).collect())
    }

    fn read(&self, path: &Path) -> io::Result<Vec<u8>> {
        self.with(path, |bytes| bytes.clone())
    }

    fn create(&self, path: &Path) -> io::Result<Box<dyn DiskFile>> {
        if self.files().contains_key(path) {
            return Err(ErrorKind::AlreadyExists.into());
        }
        self.files().insert(path.to_owned(), Vec::new());
        Ok(self.file(path))
    }

    fn open(&self, path: &Path) -> io::Result<Box<dyn DiskFile>> {
        self.with(path, |_bytes| ())?;
        Ok(self.file(path))
    }

    fn overwrite(&self, path: &Path, bytes: &[u8]) -> io::Result<()> {
        let mut files = self.files();
        let file = files.entry(path.to_owned()).or_default();
        file.resize(file.len().max(bytes.len()), 0);
        file[..bytes.len()].copy_from_slice(bytes);
        Ok(())
    }

    fn rename(&self, from: &Path, to: &Path) -> io::Result<()> {
        let mut files = self.files();
        let bytes = files.remove(from).ok_or(ErrorKind::NotFound)?;
        files.insert(to.to_owned(), bytes);
        Ok(())
    }

    fn remove(&self, path: &Path) -> io::Result<()> {
        self.files().remove(path).map(|_bytes| ()).ok_or_else(|| ErrorKind::NotFound.into())
    }

    fn remove_folder(&self, path: &Path) -> io::Result<()> {
        self.files().retain(|file, _bytes| !file.starts_with(path));
        Ok(())
    }

    fn sync_folder(&self, _path: &Path) -> io::Result<()> {
        Ok(())
    }
}

#[derive(Debug)]
struct MemoryFile {
    disk: MemoryDisk,
    path: PathBuf,
}

impl DiskFile for MemoryFile {
    fn append(&mut self, bytes: &[u8]) -> io::Result<()> {
        self.disk.with(&self.path, |file| file.extend_from_slice(bytes))
    }

    fn sync(&mut self) -> io::Result<()> {
        Ok(())
    }

    fn truncate(&mut self, length: u64) -> io::Result<()> {
        let length = usize::try_from(length).unwrap_or(usize::MAX);
        self.disk.with(&self.path, |file| file.truncate(length))
    }
}
