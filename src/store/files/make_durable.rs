//! Makes durable what a start has found in the files.
//!
//! A killed process leaves unsynced writes in the page cache, and the next process reads them as if
//! they were on disk. A sync alone proves nothing: after a failed sync, the system may treat pages
//! as clean that never reached the disk. So the end of the journal is copied to a new file, which
//! is synced and renamed, and the folders are synced. Only the last journal file needs this,
//! because a new file is created only when the previous one is completely synced. Snapshots and the
//! map's name are synced before they are renamed, so that syncing their folder is enough.
//!
//! If the records or the mark show that the end was synced, nothing is copied.

use std::io::{self, ErrorKind};
use std::path::Path;

use super::disk::{Disk, DiskFile};
use super::record::{HEADER, Uid, mark};
use super::{MARK, journal_name};

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
