//! Files that are written once: sealed by a checksum, never visible half written, never whole in
//! memory.
//!
//! ```text
//! "covissnp", "covismap", "covisjob" or "covisjbd"  version u32  0 u32  uid [16]  sequence u64  length u64
//! body [length]  crc32c u32 over all that stands before it
//! ```
//!
//! A file is written under a temporary name, synced and renamed, and its folder is synced: a file
//! with the final name is complete. The head and the checksum at the end are the same in every
//! version, so that a file of a later version is recognized; only the body changes. Snapshots are
//! compressed with zstd; the identity of a map is not. A reader gets the decoded body only after
//! the checksum was verified.

use std::io::{self, BufRead, BufReader, Read, Write};
use std::path::Path;
use std::sync::Arc;

use super::disk::{Disk, DiskFile};
use super::file_error;
use super::record::{Uid, VERSION};
use crate::encoding::{EncodingError, compare_map, decode_map, encode_identity, encode_map};
use crate::{StoreError, sequence_of};
use covis_map::Map;

/// Bytes before the body.
const HEAD: usize = 48;
/// Bytes after the body.
const CHECKSUM: usize = 4;
/// Number of bytes that are read at once.
const READ: u64 = 64 << 10;
/// Fast, and within a few percent of the size that higher levels reach on poses and pixels.
const COMPRESSION_LEVEL: i32 = 1;
/// The compressor looks back this far, and needs about this much memory besides a megabyte; a wider
/// window does not make poses and pixels smaller.
const WINDOW_LOG: u32 = 17;
/// The widest window that is accepted: earlier versions wrote 21; a wider one would only cost
/// memory.
const WIDEST_WINDOW_LOG: u32 = 23;

/// The kinds of sealed file.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Kind {
    /// A map's name.
    Identity,
    /// A map at a sequence.
    Snapshot,
    /// The record of a job.
    Job,
    /// What was uploaded for a job, or what it made.
    JobData,
}

impl Kind {
    fn magic(self) -> &'static [u8; 8] {
        match self {
            Self::Identity => b"covismap",
            Self::Snapshot => b"covissnp",
            Self::Job => b"covisjob",
            Self::JobData => b"covisjbd",
        }
    }
}

/// The label of a file.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Label {
    /// The map that it belongs to.
    pub(super) uid: Uid,
    /// The sequence of a snapshot; 0 for an identity.
    pub(super) sequence: u64,
}

/// Why a file does not open.
#[derive(Debug, thiserror::Error)]
pub(super) enum SealError {
    /// The disk failed, which says nothing about the file.
    #[error("{0}")]
    Disk(io::Error),
    /// A later version wrote the file; which version, or which part is unknown here.
    #[error("{0}")]
    Later(String),
    /// What is wrong with the file.
    #[error("{0}")]
    Damaged(String),
}

impl From<EncodingError> for SealError {
    fn from(error: EncodingError) -> Self {
        let reason = error.to_string();
        if error == EncodingError::Later { Self::Later(reason) } else { Self::Damaged(reason) }
    }
}

impl From<io::Error> for SealError {
    /// Of the stream inside: a failure of the disk is kept by [`Sealed`].
    fn from(error: io::Error) -> Self {
        Self::Damaged(error.to_string())
    }
}

impl SealError {
    /// What is wrong with the file. A failure of the disk and a file of a later version are
    /// returned as errors of the store.
    pub(super) fn damage(self, path: &Path) -> Result<String, StoreError> {
        match self {
            Self::Disk(error) => Err(file_error("cannot read", path, &error)),
            Self::Later(reason) => Err(later(path, reason)),
            Self::Damaged(reason) => Ok(reason),
        }
    }
}

/// The error for a map's file that a later version wrote; the caller knows the map.
pub(super) fn later(path: &Path, reason: String) -> StoreError {
    let file = path.file_name().unwrap_or_default().to_string_lossy().into_owned();
    StoreError::Later { map: String::new(), file, reason }
}

/// Writes the name of a map.
///
/// # Errors
/// [`StoreError::File`].
pub(super) fn write_identity(
    disk: &dyn Disk,
    path: &Path,
    uid: &Uid,
    name: &str,
) -> Result<(), StoreError> {
    let (label, body) = (Label { uid: *uid, sequence: 0 }, encode_identity(name));
    write(disk, path, (Kind::Identity, &label), |out| out.write_all(&body)).map(|_bytes| ())
}

/// Writes a snapshot and reads it back, both part by part; returns its size in bytes.
///
/// # Errors
/// [`StoreError::File`]; [`StoreError::Content`] if it cannot be read back; it is then removed.
pub(super) fn write_snapshot(
    disk: &dyn Disk,
    path: &Path,
    uid: &Uid,
    map: &Map,
) -> Result<u64, StoreError> {
    let label = Label { uid: *uid, sequence: sequence_of(map.revision()) };
    let bytes = write(disk, path, (Kind::Snapshot, &label), |out| put_map(map, out))?;
    let mut file = disk.stream(path).map_err(|e| file_error("cannot read", path, &e))?;
    if let Err(error) = compare_snapshot(&mut file, map) {
        let message = error.damage(path)?;
        disk.remove(path).map_err(|e| file_error("cannot remove", path, &e))?;
        return Err(StoreError::Content { path: path.display().to_string(), message });
    }
    Ok(bytes)
}

fn put_map(map: &Map, out: &mut dyn Write) -> io::Result<()> {
    let mut encoder = zstd::Encoder::new(out, COMPRESSION_LEVEL)?;
    encoder.window_log(WINDOW_LOG)?;
    encode_map(map, &mut encoder).map_err(io::Error::other)?;
    encoder.finish().map(|_out| ())
}

/// Writes a file so that it is complete and durable, or does not exist; returns its size in bytes.
///
/// # Errors
/// [`StoreError::File`].
pub(super) fn write(
    disk: &dyn Disk,
    path: &Path,
    what: (Kind, &Label),
    body: impl FnOnce(&mut dyn Write) -> io::Result<()>,
) -> Result<u64, StoreError> {
    let temporary = path.with_extension("tmp");
    let folder = path.parent().unwrap_or(path);
    let created = disk.create(&temporary).or_else(|error| {
        if error.kind() != io::ErrorKind::AlreadyExists {
            return Err(error);
        }
        // Left by a failed try that could not remove it.
        disk.remove(&temporary)?;
        disk.create(&temporary)
    });
    let written = created.and_then(|mut file| {
        let (head, bytes) = seal(what, &mut Appending(&mut *file), body)?;
        disk.overwrite(&temporary, &head)?;
        file.sync()?;
        Ok(bytes)
    });
    let mut left = &*temporary;
    let named = written.and_then(|bytes| {
        disk.rename(&temporary, path)?;
        left = path;
        disk.sync_folder(folder)?;
        Ok(bytes)
    });
    named.map_err(|error| {
        // Nobody knows of the file yet, so that nothing is lost with it; a name that may not be
        // durable is of no use.
        let _left = disk.remove(left);
        file_error("cannot write", path, &error)
    })
}

struct Appending<'a>(&'a mut dyn DiskFile);

impl Write for Appending<'_> {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        self.0.append(bytes).map(|()| bytes.len())
    }

    fn flush(&mut self) -> io::Result<()> {
        Ok(())
    }
}

/// Counts the bytes that pass through and computes their checksum.
struct Summing<'a> {
    out: &'a mut dyn Write,
    crc: u32,
    bytes: usize,
}

impl Write for Summing<'_> {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        let written = self.out.write(bytes)?;
        self.crc = crc32c::crc32c_append(self.crc, &bytes[..written]);
        self.bytes += written;
        Ok(written)
    }

    fn flush(&mut self) -> io::Result<()> {
        self.out.flush()
    }
}

/// Writes a whole file; `body` writes the body. Returns the size in bytes and the final head, which
/// must overwrite the first one: that was written before the body's length was known.
fn seal(
    (kind, label): (Kind, &Label),
    out: &mut dyn Write,
    body: impl FnOnce(&mut dyn Write) -> io::Result<()>,
) -> io::Result<([u8; HEAD], u64)> {
    out.write_all(&head(kind, label, 0))?;
    let mut summing = Summing { out, crc: 0, bytes: 0 };
    body(&mut summing)?;
    let Summing { out, crc, bytes } = summing;
    let head = head(kind, label, bytes as u64);
    let crc = crc32c::crc32c_combine(crc32c::crc32c(&head), crc, bytes);
    out.write_all(&crc.to_le_bytes())?;
    Ok((head, (HEAD + bytes + CHECKSUM) as u64))
}

fn head(kind: Kind, label: &Label, length: u64) -> [u8; HEAD] {
    let mut head = [0; HEAD];
    head[..8].copy_from_slice(kind.magic());
    head[8..12].copy_from_slice(&VERSION.to_le_bytes());
    head[16..32].copy_from_slice(&label.uid);
    head[32..40].copy_from_slice(&label.sequence.to_le_bytes());
    head[40..].copy_from_slice(&length.to_le_bytes());
    head
}

/// The label, body length and version of a head.
fn read_head(kind: Kind, head: &[u8; HEAD]) -> Result<(Label, u64, u32), SealError> {
    let number = |at: usize| head[at..].first_chunk().map_or(0, |&b| u64::from_le_bytes(b));
    let version = head[8..].first_chunk().map_or(0, |&b| u32::from_le_bytes(b));
    if !head.starts_with(kind.magic()) {
        return Err(SealError::Damaged("it is not a file of this kind".to_owned()));
    }
    if version == 0 {
        return Err(SealError::Damaged("it has version 0, which does not exist".to_owned()));
    }
    let mut uid = Uid::default();
    uid.copy_from_slice(&head[16..32]);
    Ok((Label { uid, sequence: number(32) }, number(40), version))
}

/// Reads a whole file; `read` reads the body.
///
/// # Errors
/// [`SealError`]; a later version has priority over damage of the file, and damage over an error of
/// `read`.
pub(super) fn unseal<T>(
    kind: Kind,
    input: &mut dyn Read,
    read: impl FnOnce(&Label, &mut dyn BufRead) -> Result<T, SealError>,
) -> Result<(Label, T), SealError> {
    unseal_any(kind, input, |label, version, body| {
        if version == VERSION {
            return read(label, body);
        }
        let text =
            format!("it has version {version}, and this covis reads up to version {VERSION}");
        Err(SealError::Later(text))
    })
}

/// Reads a file of any version.
fn unseal_any<T>(
    kind: Kind,
    input: &mut dyn Read,
    read: impl FnOnce(&Label, u32, &mut dyn BufRead) -> Result<T, SealError>,
) -> Result<(Label, T), SealError> {
    let damaged = |reason: &str| Err(SealError::Damaged(reason.to_owned()));
    let mut sealed = Sealed::new(input);
    let mut head = [0; HEAD];
    let begun = match sealed.read_exact(&mut head) {
        Ok(()) => read_head(kind, &head),
        Err(error) => Err(error.into()),
    };
    let begun =
        begun.map(|(label, length, version)| (label, length, read(&label, version, &mut sealed)));
    let (bytes, fits) = sealed.finish().map_err(SealError::Disk)?;
    if bytes < HEAD as u64 {
        return damaged("the file is too short");
    }
    if !fits {
        return damaged("the checksum does not fit");
    }
    let (label, length, body) = begun?;
    if length != bytes - HEAD as u64 {
        return damaged("it is not a file of this kind");
    }
    Ok((label, body?))
}

/// A reader of a file without the checksum at its end; it also sums up what was read.
struct Sealed<'a> {
    input: &'a mut dyn Read,
    /// Bytes that were read; those from `start` on are unused. The last bytes may be the checksum.
    buffer: Vec<u8>,
    start: usize,
    bytes: u64,
    crc: u32,
    /// A failure of the disk, because the reader of the body may take it for damage.
    failure: Option<io::Error>,
}

impl<'a> Sealed<'a> {
    fn new(input: &'a mut dyn Read) -> Self {
        Self { input, buffer: Vec::new(), start: 0, bytes: 0, crc: 0, failure: None }
    }

    /// Reads the rest; returns the number of bytes before the checksum, and whether it matches.
    fn finish(mut self) -> io::Result<(u64, bool)> {
        while let Ok(rest @ [_, ..]) = self.fill_buf() {
            let count = rest.len();
            self.consume(count);
        }
        if let Some(failure) = self.failure {
            return Err(failure);
        }
        Ok((self.bytes, self.buffer[self.start..] == self.crc.to_le_bytes()))
    }
}

impl BufRead for Sealed<'_> {
    fn fill_buf(&mut self) -> io::Result<&[u8]> {
        if let Some(failure) = &self.failure {
            return Err(failure.kind().into());
        }
        while self.buffer.len() - self.start <= CHECKSUM {
            self.buffer.drain(..self.start);
            self.start = 0;
            match (&mut *self.input).take(READ).read_to_end(&mut self.buffer) {
                Ok(0) => break,
                Ok(_) => {}
                Err(failure) => {
                    let kind = failure.kind();
                    self.failure = Some(failure);
                    return Err(kind.into());
                }
            }
        }
        let end = self.buffer.len().saturating_sub(CHECKSUM).max(self.start);
        Ok(&self.buffer[self.start..end])
    }

    fn consume(&mut self, count: usize) {
        let used = &self.buffer[self.start..self.start + count];
        self.crc = crc32c::crc32c_append(self.crc, used);
        self.bytes += count as u64;
        self.start += count;
    }
}

impl Read for Sealed<'_> {
    fn read(&mut self, out: &mut [u8]) -> io::Result<usize> {
        let count = self.fill_buf()?.read(out)?;
        self.consume(count);
        Ok(count)
    }
}

/// The body of an identity, with the version that wrote it.
pub(super) fn read_identity(input: &mut dyn Read) -> Result<(Label, (u32, Vec<u8>)), SealError> {
    unseal_any(Kind::Identity, input, |_label, version, body| {
        let mut bytes = Vec::new();
        body.read_to_end(&mut bytes)?;
        Ok((version, bytes))
    })
}

/// The label of a snapshot whose checksum fits.
pub(super) fn check_snapshot(input: &mut dyn Read) -> Result<Label, SealError> {
    unseal(Kind::Snapshot, input, |_label, _body| Ok(())).map(|(label, ())| label)
}

/// The map of a snapshot, checked down to its state hash.
pub(super) fn read_snapshot(input: &mut dyn Read) -> Result<Arc<Map>, SealError> {
    unseal(Kind::Snapshot, input, |label, body| {
        let map = decode_map(&mut parts(body)?)?;
        check_sequence(label, &map)?;
        Ok(Arc::new(map))
    })
    .map(|(_label, map)| map)
}

/// Whether a snapshot holds this map, or what is wrong with it. Needs little memory besides the
/// map.
pub(super) fn compare_snapshot(input: &mut dyn Read, map: &Map) -> Result<(), SealError> {
    unseal(Kind::Snapshot, input, |label, body| {
        compare_map(&mut parts(body)?, map)?;
        check_sequence(label, map)
    })
    .map(|(_label, ())| ())
}

fn check_sequence(label: &Label, map: &Map) -> Result<(), SealError> {
    if sequence_of(map.revision()) == label.sequence {
        Ok(())
    } else {
        Err(SealError::Damaged("the map has another revision than the file".to_owned()))
    }
}

/// The stream of parts in a snapshot's body.
pub(super) fn parts(body: &mut dyn BufRead) -> io::Result<impl Read> {
    let mut decoder = zstd::Decoder::with_buffer(body)?;
    decoder.window_log_max(WIDEST_WINDOW_LOG)?;
    // A part's length is read separately.
    Ok(BufReader::new(decoder))
}

/// The bytes of a file, for tests.
#[cfg(any(test, feature = "fuzzing"))]
pub(super) fn sealed(kind: Kind, uid: &Uid, sequence: u64, body: &[u8]) -> Vec<u8> {
    let mut bytes = Vec::new();
    let label = Label { uid: *uid, sequence };
    // Writing to a vector does not fail.
    if let Ok((head, _)) = seal((kind, &label), &mut bytes, |out| out.write_all(body)) {
        bytes[..HEAD].copy_from_slice(&head);
    }
    bytes
}

/// The bytes of a snapshot, for tests.
#[cfg(any(test, feature = "fuzzing"))]
pub(super) fn sealed_map(uid: &Uid, map: &Map) -> Vec<u8> {
    let mut body = Vec::new();
    // Writing to a vector does not fail either.
    let _done = put_map(map, &mut body);
    sealed(Kind::Snapshot, uid, sequence_of(map.revision()), &body)
}
