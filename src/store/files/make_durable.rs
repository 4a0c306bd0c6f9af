//! Brings what a start has found to the disk, before it counts as durable.
//!
//! A process that was killed leaves in the page cache what it wrote and never synced: the next one
//! reads it as if it were on disk. A sync alone proves nothing, for after a failed one the system
//! takes pages for clean that never arrived. So the end of the journal is copied to a new file, which
//! is synced and renamed, and the folders are synced. Only the last journal file needs that: the one
//! after a file is made when all of that file is synced. Snapshots and the map's name are synced
//! before they get their names, so that for them the folder is enough.
//!
//! Where the records themselves or the mark tell that the end was synced, nothing is copied.

use std::io::{self, ErrorKind};
use std::path::Path;

use super::disk::{Disk, DiskFile};
use super::record::{HEADER, Uid, mark};
use super::{MARK, journal_name};

/// What is to be brought to the disk.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(super) struct Unsynced {
    /// The last journal file, if there is one.
    pub(super) tail: Option<Tail>,
    /// The last sequence that can be read, which is durable afterwards.
    pub(super) last: u64,
}

/// The last journal file.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Tail {
    /// Its first sequence.
    pub(super) first: u64,
    /// The bytes of it that stay; a file without a header goes.
    pub(super) keep: u64,
    /// Whether it must be copied: something is cut off, or its end may never have been synced.
    pub(super) copy: bool,
    /// Whether it is written on; else another file follows it.
    pub(super) write_on: bool,
}

/// Brings the folder's end to the disk, and opens the file to write on with its length. Where it
/// fails the journal is as it was, and all of it can be tried again. Blocks.
pub(super) fn make_durable(
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
        // The next start needs no copy. Evidence and no promise, so that it may fail.
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

/// Puts the first `keep` bytes of a file, synced, in its place. The file is whole at every moment:
/// some of it may have been acknowledged.
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
        // What is left goes when it is tried again, or at the next start.
        let _left = disk.remove(&temporary);
    })
}
