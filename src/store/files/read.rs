//! Reading events and snapshots of a map, and writing a snapshot that is known to read back.
//! Everything here blocks.

use std::sync::Arc;
use std::time::Instant;

use super::journal::Journal;
use super::record::scan;
use super::{file_error, journal_name, sealed, snapshot_name};
use crate::map::{Event, Map};
use crate::store::encoding::decode_event;
use crate::store::{Damage, StoreError, sequence_of};

/// Snapshots that are kept: if the newest does not open, the previous one and the journal after it
/// still give the whole map.
const KEPT_SNAPSHOTS: usize = 2;

/// The events after `from` up to `last`, as far as they are contiguous.
///
/// # Errors
/// [`StoreError::File`]; [`StoreError::Content`] for an event that cannot be decoded.
pub(super) fn events(
    journal: &Journal,
    from: u64,
    last: u64,
) -> Result<Vec<Arc<Event>>, StoreError> {
    let segments = journal.segments();
    let mut events = Vec::new();
    let mut next = from + 1;
    // The file that holds `next`, and those after it.
    let start = segments.iter().rposition(|&first| first <= next).unwrap_or(0);
    for &first in &segments[start.min(segments.len())..] {
        let path = journal.folder.join(journal_name(first));
        let bytes = journal.disk.read(&path).map_err(|e| file_error("cannot read", &path, &e))?;
        for record in scan(&bytes, &journal.uid, first).records {
            if record.sequence != next || next > last {
                continue;
            }
            let event = decode_event(&bytes[record.payload]).map_err(|error| {
                let message = format!("event {next}: {error}");
                StoreError::Content { path: path.display().to_string(), message }
            })?;
            events.push(Arc::new(event));
            next += 1;
        }
    }
    Ok(events)
}

/// The newest snapshot that opens; snapshots that do not open are set aside.
///
/// # Errors
/// [`StoreError::File`].
pub(super) fn newest_snapshot(journal: &Journal) -> Result<Option<Arc<Map>>, StoreError> {
    loop {
        let newest = journal.state().snapshots.last().copied();
        let Some(sequence) = newest else { return Ok(None) };
        let path = journal.folder.join(snapshot_name(sequence));
        let mut file =
            journal.disk.stream(&path).map_err(|e| file_error("cannot read", &path, &e))?;
        let reason = match sealed::read_snapshot(&mut file) {
            Ok(map) => return Ok(Some(map)),
            Err(error) => error.damage(&path)?,
        };
        tracing::error!(file = %path.display(), reason, "a snapshot does not open");
        let file = path.display().to_string();
        let mut state = journal.state();
        state.snapshots.pop();
        state.damage.push(Damage { file, offset: 0, lost: None });
    }
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
    let mut file = journal.disk.stream(&path).map_err(|e| file_error("cannot read", &path, &e))?;
    if let Err(error) = sealed::compare_snapshot(&mut file, map) {
        let message = error.damage(&path)?;
        journal.disk.remove(&path).map_err(|e| file_error("cannot remove", &path, &e))?;
        return Err(StoreError::Content { path: path.display().to_string(), message });
    }
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
