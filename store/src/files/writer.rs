//! The journal's file: groups are written and synced here, and the rest of a failed write is cut
//! off.
//!
//! A write that fails for lack of space, descriptors or memory loses nothing, because nothing of it
//! was synced: the group stays in memory, the file is truncated, and the group is written again.
//! After a failed fsync, or any other failure, the state of the disk is unknown: such a failure is
//! permanent.
//!
//! Before its first group it makes durable what a start has found in the files. A killed process leaves
//! unsynced writes in the page cache, and the next process reads them as if they were on disk. A sync
//! alone proves nothing: after a failed sync, the system may treat pages as clean that never reached
//! the disk. So the end of the journal is copied to a new file, which is synced and renamed, and the
//! folders are synced. Only the last journal file needs this, because a new file is created only when
//! the previous one is completely synced. Snapshots and the map's name are synced before they are
//! renamed, so that syncing their folder is enough. If the records or the mark show that the end was
//! synced, nothing is copied.

use std::io::{self, ErrorKind};
use std::path::{Path, PathBuf};

use super::disk::{Disk, DiskFile};
use super::failure::{lacks_descriptors, passes};
use super::record::{HEADER, Uid, header, mark};
use super::{MARK, journal_name};

/// Records that are written and synced together.
#[derive(Debug)]
pub(super) struct Group {
    pub(super) bytes: Vec<u8>,
    pub(super) first: u64,
    pub(super) last: u64,
}

/// Why a group was not written.
#[derive(Debug)]
pub(super) enum WriteError {
    /// A resource is used up: the same group can be written later.
    Passes(io::Error),
    /// The state of the disk is unknown.
    Fatal(io::Error),
}

impl From<io::Error> for WriteError {
    fn from(error: io::Error) -> Self {
        if passes(&error) { Self::Passes(error) } else { Self::Fatal(error) }
    }
}

/// A repair that must be done before anything is written.
#[derive(Debug)]
enum Repair {
    /// The file's end holds part of a group.
    Cut,
    /// A new file holds part of a group.
    Remove(PathBuf),
    /// The files that were found at the start may not be durable.
    Unsynced(Unsynced),
}

/// The file that is written.
#[derive(Debug, Default)]
pub(super) struct Writer {
    file: Option<Box<dyn DiskFile>>,
    length: u64,
    /// Whether the next group begins a new file.
    pub(super) roll: bool,
    /// The first sequence of each file, in increasing order.
    pub(super) segments: Vec<u64>,
    repair: Option<Repair>,
    /// The group that is being written.
    pub(super) group: Option<Group>,
}

/// Where a map's files are.
#[derive(Clone, Copy, Debug)]
pub(super) struct JournalLocation<'a> {
    pub(super) disk: &'a dyn Disk,
    pub(super) folder: &'a Path,
    pub(super) uid: &'a Uid,
    pub(super) segment_bytes: u64,
}

impl Writer {
    /// The writer of files that were found. It first makes them durable.
    pub(super) fn of(segments: Vec<u64>, unsynced: Option<Unsynced>) -> Self {
        Self { segments, repair: unsynced.map(Repair::Unsynced), ..Self::default() }
    }

    /// Whether there is nothing to do.
    pub(super) fn is_idle(&self) -> bool {
        self.group.is_none() && self.repair.is_none()
    }

    /// Drops the file and the pending group.
    pub(super) fn end(&mut self) {
        (self.file, self.group, self.repair) = (None, None, None);
    }

    /// Repairs what an earlier failure left, then writes the group and calls fsync, if there is one;
    /// starts a new file if one is due. The group is kept.
    pub(super) fn write(&mut self, location: &JournalLocation<'_>) -> Result<(), WriteError> {
        self.put_right(location)?;
        let Some(group) = &self.group else { return Ok(()) };
        if self.length >= location.segment_bytes || self.roll {
            self.file = None;
        }
        let Some(file) = &mut self.file else { return self.begin(location) };
        if let Err(error) = file.append(&group.bytes) {
            self.repair = Some(Repair::Cut);
            return self.failed(location, error);
        }
        file.sync().map_err(WriteError::Fatal)?;
        self.length += group.bytes.len() as u64;
        Ok(())
    }

    fn begin(&mut self, location: &JournalLocation<'_>) -> Result<(), WriteError> {
        let Some(group) = &self.group else { return Ok(()) };
        let path = location.folder.join(journal_name(group.first));
        let mut file = location.disk.create(&path)?;
        let mut bytes = header(location.uid, group.first);
        bytes.extend_from_slice(&group.bytes);
        if let Err(error) = file.append(&bytes) {
            self.repair = Some(Repair::Remove(path));
            return self.failed(location, error);
        }
        file.sync().map_err(WriteError::Fatal)?;
        match location.disk.sync_folder(location.folder) {
            // The folder could not be opened, so that no sync of it has failed.
            Err(error) if lacks_descriptors(&error) => {
                self.repair = Some(Repair::Remove(path));
                return Err(WriteError::Passes(error));
            }
            synced => synced.map_err(WriteError::Fatal)?,
        }
        self.segments.push(group.first);
        self.length = (HEADER + group.bytes.len()) as u64;
        (self.file, self.roll) = (Some(file), false);
        Ok(())
    }

    /// Repairs what a failed write left, at once if possible.
    fn failed(
        &mut self,
        location: &JournalLocation<'_>,
        error: io::Error,
    ) -> Result<(), WriteError> {
        if !passes(&error) {
            return Err(WriteError::Fatal(error));
        }
        match self.put_right(location) {
            Err(WriteError::Fatal(error)) => Err(WriteError::Fatal(error)),
            Ok(()) | Err(WriteError::Passes(_)) => Err(WriteError::Passes(error)),
        }
    }

    fn put_right(&mut self, location: &JournalLocation<'_>) -> Result<(), WriteError> {
        match &self.repair {
            None => return Ok(()),
            Some(Repair::Cut) => {
                if let Some(file) = &mut self.file {
                    file.truncate(self.length)?;
                }
            }
            Some(Repair::Remove(path)) => match location.disk.remove(path) {
                Err(error) if error.kind() == ErrorKind::NotFound => {}
                removed => removed?,
            },
            Some(Repair::Unsynced(found)) => {
                let tail = make_durable(location.disk, location.folder, location.uid, found)?;
                let (file, length) = tail.map_or((None, 0), |(file, length)| (Some(file), length));
                (self.file, self.length) = (file, length);
            }
        }
        self.repair = None;
        Ok(())
    }
}

/// What must be made durable.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(super) struct Unsynced {
    /// The last journal file, if there is one.
    pub(super) tail: Option<Tail>,
    /// The last sequence that can be read; it is durable afterwards.
    pub(super) last: u64,
}

/// The last journal file.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Tail {
    /// Its first sequence.
    pub(super) first: u64,
    /// The number of its bytes that are kept; a file without a header is removed.
    pub(super) keep: u64,
    /// Whether it must be copied: something is cut off, or its end may never have been synced.
    pub(super) copy: bool,
    /// Whether later records are appended to it; otherwise a new file follows.
    pub(super) write_on: bool,
}

/// Makes the end of the journal durable, and opens the file for appending; returns it with its
/// length. On failure the journal is unchanged, and everything can be tried again. Blocks.
fn make_durable(
    disk: &dyn Disk,
    folder: &Path,
    uid: &Uid,
    found: &Unsynced,
) -> io::Result<Option<(Box<dyn DiskFile>, u64)>> {
    let mut is_copied = false;
    let mut open = None;
    if let Some(tail) = &found.tail {
        let path = folder.join(journal_name(tail.first));
        if tail.write_on && tail.keep < HEADER as u64 {
            tracing::warn!(file = %path.display(), "a file that was never used is removed");
            match disk.remove(&path) {
                Err(error) if error.kind() == ErrorKind::NotFound => {}
                removed => removed?,
            }
        } else {
            if tail.copy {
                copy(disk, &path, tail.keep)?;
                is_copied = true;
            }
            open = tail.write_on.then_some((path, tail.keep));
        }
    }
    disk.sync_folder(folder)?;
    if let Some(maps) = folder.parent() {
        disk.sync_folder(maps)?;
    }
    if is_copied {
        // With the mark, the next start needs no copy. The mark is optional, so that this may fail.
        let path = folder.join(MARK);
        let marked = disk
            .overwrite(&path, &mark(uid, found.last))
            .and_then(|()| disk.open(&path)?.sync())
            .and_then(|()| disk.sync_folder(folder));
        if let Err(error) = marked {
            tracing::warn!(file = %path.display(), %error, "the mark was not written");
        }
    }
    open.map(|(path, length)| Ok((disk.open(&path)?, length))).transpose()
}

/// Replaces a file by its first `keep` bytes, synced. The file is complete at every moment, because
/// part of it may have been acknowledged.
fn copy(disk: &dyn Disk, path: &Path, keep: u64) -> io::Result<()> {
    let mut bytes = disk.read(path)?;
    let length = usize::try_from(keep).unwrap_or(usize::MAX);
    if let Some(cut) = bytes.len().checked_sub(length).filter(|&cut| cut > 0) {
        tracing::warn!(file = %path.display(), offset = keep, bytes = cut, "an unfinished write is cut off");
    }
    bytes.truncate(length);
    let temporary = path.with_extension("tmp");
    match disk.remove(&temporary) {
        Err(error) if error.kind() == ErrorKind::NotFound => {}
        removed => removed?,
    }
    let copied = disk.create(&temporary).and_then(|mut file| {
        file.append(&bytes)?;
        file.sync()
    });
    copied.and_then(|()| disk.rename(&temporary, path)).inspect_err(|_error| {
        // The temporary file is removed by the next try, or at the next start.
        let _left = disk.remove(&temporary);
    })
}
