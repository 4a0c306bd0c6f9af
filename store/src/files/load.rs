//! Reads a map's folder when the map is opened.
//!
//! The journal must reach, without a gap, from the newest snapshot whose checksum fits. There are
//! three kinds of faults. The `durable` in every record and the mark beside the journal distinguish
//! them apart:
//!
//! - A bad place after which nothing was ever acknowledged is left by a crash: it is cut off
//!   (`writer.rs`).
//! - Lost events that a snapshot contains are reported and do no harm.
//! - Lost events that were acknowledged make the map read-only: it opens with what is contiguous,
//!   accepts no changes, and its files stay as they are.

use std::path::{Path, PathBuf};

use super::disk::Disk;
use super::record::{HEAD, HEADER, Header, Uid, read_header, read_mark, scan};
use super::sealed::{Label, later};
use super::writer::{Tail, Unsynced};
use super::{MARK, file_error, journal_name, sealed, sequence_in, whole_file};
use crate::{Damage, StoreError};

/// A map's files as they are after opening.
#[derive(Debug, Default)]
pub(super) struct OpenedFiles {
    /// The first sequence of each journal file, in increasing order.
    pub(super) segments: Vec<u64>,
    /// Snapshots whose checksum fits, in increasing order.
    pub(super) snapshots: Vec<u64>,
    /// The last sequence that can be read.
    pub(super) last: u64,
    /// The last sequence that is known to have been synced.
    pub(super) durable: u64,
    /// What must be synced before all of it counts as durable; `None` if the files stay as they
    /// are.
    pub(super) unsynced: Option<Unsynced>,
    /// Approximate bytes of the journal after the newest snapshot.
    pub(super) bytes_since_snapshot: u64,
    /// What is damaged.
    pub(super) damage: Vec<Damage>,
    /// The damage that lost acknowledged events: the map accepts no changes.
    pub(super) lost: Option<Damage>,
    /// Snapshots that do not open, and why; they come first in `damage`.
    pub(super) unopened: Vec<(PathBuf, String)>,
    /// What a crash left of files that were being written.
    pub(super) unfinished: Vec<PathBuf>,
}

/// One journal file.
struct Segment {
    first: u64,
    length: u64,
    /// Whole and contiguous from its first record to this sequence (`first` - 1 where none is).
    clean_last: u64,
    /// First and last sequence of each piece without a gap.
    runs: Vec<(u64, u64)>,
    /// Where each piece begins, bytes.
    starts: Vec<u64>,
    bad: Option<u64>,
    durable: u64,
}

/// Reads a map's folder as [`look`] does, renames snapshots that do not open, so that they are not used
/// again, and removes what a crash left of files.
///
/// # Errors
/// [`StoreError::File`] if the disk fails, [`StoreError::Later`] for files of a later version; then
/// nothing was changed.
pub(super) fn load(disk: &dyn Disk, folder: &Path, uid: &Uid) -> Result<OpenedFiles, StoreError> {
    let mut found = look(disk, folder, uid)?;
    for ((path, reason), damage) in found.unopened.iter().zip(&mut found.damage) {
        tracing::error!(file = %path.display(), reason, "a snapshot does not open and is set aside");
        let aside = path.with_extension("bad");
        disk.rename(path, &aside).map_err(|e| file_error("cannot rename", path, &e))?;
        damage.file = aside.display().to_string();
    }
    for path in &found.unfinished {
        // It is no part of the map: the next start tries again, and so does the next write of the
        // file.
        if let Err(error) = disk.remove(path) {
            tracing::warn!(file = %path.display(), %error, "the remains of a crash cannot be removed");
        }
    }
    Ok(found)
}

/// Reads a map's folder, and determines what to do about the traces of a crash. Changes nothing.
///
/// # Errors
/// [`StoreError::File`] if the disk fails, [`StoreError::Later`] for files of a later version.
pub(super) fn look(disk: &dyn Disk, folder: &Path, uid: &Uid) -> Result<OpenedFiles, StoreError> {
    let mut found = OpenedFiles::default();
    let names = disk.list(folder).map_err(|e| file_error("cannot list", folder, &e))?;
    let mut segments = Vec::new();
    for first in names.iter().filter_map(|name| sequence_in(name, ".log")) {
        segments.push(read_segment(disk, &folder.join(journal_name(first)), uid, first)?);
    }
    for (sequence, name) in names.iter().filter_map(|n| Some((sequence_in(n, ".snap")?, n))) {
        let path = folder.join(name);
        match look_at_snapshot(disk, &path, uid, sequence)? {
            None => found.snapshots.push(sequence),
            Some(reason) => {
                found.damage.push(whole_file(&path));
                found.unopened.push((path, reason));
            }
        }
    }
    let unfinished = names.iter().filter(|name| name.ends_with(".tmp"));
    found.unfinished = unfinished.map(|name| folder.join(name)).collect();
    let base = found.snapshots.last().copied().unwrap_or(0);
    found.last = base;
    for &(first, last) in segments.iter().flat_map(|segment| &segment.runs) {
        if first <= found.last.saturating_add(1) {
            found.last = found.last.max(last);
        }
    }
    let mark = if names.iter().any(|name| name == MARK) {
        let path = folder.join(MARK);
        let bytes = disk.read(&path).map_err(|e| file_error("cannot read", &path, &e))?;
        // A crash may leave half a mark, which proves nothing.
        read_mark(&bytes, uid).unwrap_or(0)
    } else {
        0
    };
    let acknowledged = find_damage(folder, &segments, mark, &mut found);
    found.durable = acknowledged.min(found.last);
    found.segments = segments.iter().map(|segment| segment.first).collect();
    let behind = segments.iter().filter(|s| s.runs.last().is_some_and(|&(_, last)| last > base));
    found.bytes_since_snapshot = behind.map(|segment| segment.length).sum();
    if found.lost.is_none() {
        let tail = segments.last().map(|segment| tail(segment, acknowledged, found.last));
        if tail.is_some_and(|tail| tail.write_on && tail.keep < HEADER as u64) {
            found.segments.pop();
        }
        found.unsynced = Some(Unsynced { tail, last: found.last });
    }
    Ok(found)
}

/// The damage of a snapshot, if any.
fn look_at_snapshot(
    disk: &dyn Disk,
    path: &Path,
    uid: &Uid,
    sequence: u64,
) -> Result<Option<String>, StoreError> {
    let mut file = disk.stream(path).map_err(|e| file_error("cannot read", path, &e))?;
    match sealed::check_snapshot(&mut file) {
        Ok(label) if label == Label { uid: *uid, sequence } => Ok(None),
        Ok(_) => Ok(Some("it belongs elsewhere".to_owned())),
        Err(error) => error.damage(path).map(Some),
    }
}

fn read_segment(
    disk: &dyn Disk,
    path: &Path,
    uid: &Uid,
    first: u64,
) -> Result<Segment, StoreError> {
    let bytes = disk.read(path).map_err(|e| file_error("cannot read", path, &e))?;
    if let Header::Later(version) = read_header(&bytes, uid) {
        return Err(later(path, format!("it has version {version}, which this covis cannot read")));
    }
    let scan = scan(&bytes, uid, first);
    let (mut runs, mut starts): (Vec<(u64, u64)>, Vec<u64>) = (Vec::new(), Vec::new());
    for (index, record) in scan.records.iter().enumerate() {
        match runs.last_mut() {
            Some((_, last)) if *last + 1 == record.sequence && index != scan.clean => {
                *last = record.sequence;
            }
            _ => {
                runs.push((record.sequence, record.sequence));
                starts.push(record.payload.start.saturating_sub(HEAD) as u64);
            }
        }
    }
    let clean = scan.records[..scan.clean].last();
    Ok(Segment {
        first,
        length: bytes.len() as u64,
        clean_last: clean.map_or(first.saturating_sub(1), |record| record.sequence),
        runs,
        starts,
        bad: scan.bad.map(|offset| offset as u64),
        durable: scan.durable,
    })
}

/// Determines what is damaged, and whether events are lost. Returns the last sequence that is known
/// to have been synced, even if its event is lost.
fn find_damage(folder: &Path, segments: &[Segment], mark: u64, found: &mut OpenedFiles) -> u64 {
    let last_index = segments.len().saturating_sub(1);
    // Every file but the last was synced whole before the next one was made.
    let whole = segments.iter().take(last_index).filter_map(|s| s.runs.last()).map(|&(_, l)| l);
    let before = segments.iter().skip(1).map(|segment| segment.first.saturating_sub(1));
    let known = segments.iter().map(|segment| segment.durable);
    let acknowledged = known.chain(whole).chain(before).chain([mark]).max().unwrap_or(0);
    let runs = segments.iter().flat_map(|segment| &segment.runs);
    let next = runs.map(|&(first, _)| first).filter(|&first| first > found.last).min();
    let lost = (acknowledged > found.last).then(|| {
        let through = next.map_or(acknowledged, |next| next - 1).min(acknowledged);
        (found.last + 1, through.max(found.last + 1))
    });
    for (index, segment) in segments.iter().enumerate() {
        let Some(offset) = segment.bad else { continue };
        let torn = index == last_index && acknowledged <= segment.clean_last;
        if !torn {
            let file = folder.join(journal_name(segment.first)).display().to_string();
            found.damage.push(Damage::of_bytes(file, offset, None));
        }
    }
    if let Some(lost) = lost {
        // The file in which the first lost event should be.
        let home = segments.iter().rfind(|s| s.first <= lost.0).or(segments.first());
        let file = home.map_or_else(|| folder.to_owned(), |s| folder.join(journal_name(s.first)));
        let file = file.display().to_string();
        let damage = match found.damage.iter_mut().find(|damage| damage.file == file) {
            Some(damage) => {
                damage.lost = Some(lost);
                damage.clone()
            }
            None => {
                // The existing data is intact, but it ends too early.
                let offset = home.map_or(0, |segment| segment.length);
                let damage = Damage::of_bytes(file, offset, Some(lost));
                found.damage.push(damage.clone());
                damage
            }
        };
        found.lost = Some(damage);
    }
    acknowledged
}

/// Decides about the last file: the traces of a crash are cut off, and what may not be synced is
/// made durable.
fn tail(segment: &Segment, acknowledged: u64, last: u64) -> Tail {
    let first = segment.first;
    if segment.clean_last != last {
        // A snapshot reaches further, or the used events are after a bad place: a new file follows.
        // Events after a gap were never acknowledged, but in a file that is not the last they would
        // look acknowledged.
        let mut pieces = segment.runs.iter().zip(&segment.starts);
        let cut = pieces.find(|&(&(first, _), _)| first > last).map(|(_, &start)| start);
        let reached = segment.runs.last().map_or(0, |&(_, last)| last);
        let copy = cut.is_some() || reached > acknowledged;
        return Tail { first, keep: cut.unwrap_or(segment.length), copy, write_on: false };
    }
    let keep = segment.bad.unwrap_or(segment.length);
    let copy = keep < segment.length || last > acknowledged;
    Tail { first, keep, copy, write_on: true }
}
