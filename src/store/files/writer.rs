//! The journal's file: groups are written and synced here, and the rest of a failed write is cut
//! off.
//!
//! A write that fails for lack of space, descriptors or memory loses nothing, because nothing of it
//! was synced: the group stays in memory, the file is truncated, and the group is written again.
//! After a failed fsync, or any other failure, the state of the disk is unknown: such a failure is
//! permanent.

use std::io::{self, ErrorKind};
use std::path::{Path, PathBuf};

use super::disk::{Disk, DiskFile};
use super::failure::{lacks_descriptors, passes};
use super::journal_name;
use super::make_durable::{Unsynced, make_durable};
use super::record::{HEADER, Uid, header};

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
pub(super) struct Place<'a> {
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

    /// Repairs what an earlier failure left, then writes and syncs the group, if there is one;
    /// starts a new file if one is due. The group is kept.
    pub(super) fn write(&mut self, place: &Place<'_>) -> Result<(), WriteError> {
        self.put_right(place)?;
        let Some(group) = &self.group else { return Ok(()) };
        if self.length >= place.segment_bytes || self.roll {
            self.file = None;
        }
        let Some(file) = &mut self.file else { return self.begin(place) };
        if let Err(error) = file.append(&group.bytes) {
            self.repair = Some(Repair::Cut);
            return self.failed(place, error);
        }
        file.sync().map_err(WriteError::Fatal)?;
        self.length += group.bytes.len() as u64;
        Ok(())
    }

    fn begin(&mut self, place: &Place<'_>) -> Result<(), WriteError> {
        let Some(group) = &self.group else { return Ok(()) };
        let path = place.folder.join(journal_name(group.first));
        let mut file = place.disk.create(&path)?;
        let mut bytes = header(place.uid, group.first);
        bytes.extend_from_slice(&group.bytes);
        if let Err(error) = file.append(&bytes) {
            self.repair = Some(Repair::Remove(path));
            return self.failed(place, error);
        }
        file.sync().map_err(WriteError::Fatal)?;
        match place.disk.sync_folder(place.folder) {
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
    fn failed(&mut self, place: &Place<'_>, error: io::Error) -> Result<(), WriteError> {
        if !passes(&error) {
            return Err(WriteError::Fatal(error));
        }
        match self.put_right(place) {
            Err(WriteError::Fatal(error)) => Err(WriteError::Fatal(error)),
            Ok(()) | Err(WriteError::Passes(_)) => Err(WriteError::Passes(error)),
        }
    }

    fn put_right(&mut self, place: &Place<'_>) -> Result<(), WriteError> {
        match &self.repair {
            None => return Ok(()),
            Some(Repair::Cut) => {
                if let Some(file) = &mut self.file {
                    file.truncate(self.length)?;
                }
            }
            Some(Repair::Remove(path)) => match place.disk.remove(path) {
                Err(error) if error.kind() == ErrorKind::NotFound => {}
                removed => removed?,
            },
            Some(Repair::Unsynced(found)) => {
                let tail = make_durable(place.disk, place.folder, place.uid, found)?;
                let (file, length) = tail.map_or((None, 0), |(file, length)| (Some(file), length));
                (self.file, self.length) = (file, length);
            }
        }
        self.repair = None;
        Ok(())
    }
}
