//! One map's journal: accepts events in order, writes and syncs them in groups, remembers failures.
//!
//! An append puts its records into a buffer and returns. A map has at most one running flush. It
//! writes all pending records at once, syncs once, and reports the last durable sequence; records
//! that arrive meanwhile are the next group. When a flush leaves nothing pending, a mark is written
//! beside the journal, so that a damaged or missing last record is not taken for an unfinished
//! write.
//!
//! When space, descriptors or memory are used up, the journal accepts nothing new, keeps what it
//! has accepted and tries again later (`writer.rs`). A failed fsync is never tried again: it is not
//! known what the system has written, so the journal stops.

mod flush;

use std::collections::VecDeque;
use std::io;
use std::path::{Path, PathBuf};
use std::sync::{Arc, MutexGuard};

use tokio::sync::watch;

use super::disk::Disk;
use super::load::OpenedFiles;
use super::record::{Uid, put_record};
use super::writer::Writer;
use super::{FileStoreOptions, file_error, journal_name};
use crate::encoding::encode_readable;
use crate::sync::Mutex;
use crate::{
    Damage, Epoch, Flushed, Piece, Position, StoreError, StoreMeters, sequence_of, wait_durable,
};
use covis_map::Event;

/// Bytes that may wait for a flush; beyond that, appends wait too.
const MOST_PENDING: usize = 64 << 20;
/// Bytes of encoded events that are kept in memory for readers that were away briefly.
const RECENT: usize = 4 << 20;

/// A map's journal and the state of its files.
#[derive(Debug)]
pub(super) struct Journal {
    pub(super) name: String,
    pub(super) uid: Uid,
    pub(super) folder: PathBuf,
    /// Where the folder goes when it is set aside: the same place where that is repeated.
    #[cfg(feature = "cluster")]
    pub(super) aside: std::sync::OnceLock<PathBuf>,
    pub(super) disk: Arc<dyn Disk>,
    options: FileStoreOptions,
    pub(super) meters: Arc<StoreMeters>,
    state: Mutex<State>,
    /// Locked before `state` if both are locked.
    writer: Mutex<Writer>,
    flushed: watch::Sender<Flushed>,
    /// Held while the folder is read for the first time, and while a snapshot is written.
    pub(super) exclusive: Arc<tokio::sync::Mutex<()>>,
}

/// The state that an append reads.
#[derive(Debug, Default)]
pub(super) struct State {
    /// Whether the folder was read.
    pub(super) loaded: bool,
    /// The newest writer.
    pub(super) epoch: Epoch,
    /// The last accepted sequence.
    pub(super) last: u64,
    /// Sequences up to this one can no longer be read.
    pub(super) dropped: u64,
    /// Sequences of the snapshots that can be read, in increasing order.
    pub(super) snapshots: Vec<u64>,
    pub(super) damage: Vec<Damage>,
    /// The damage that lost acknowledged events: no change is accepted.
    pub(super) lost: Option<Damage>,
    durable: u64,
    failed: Option<StoreError>,
    /// Which resource is used up for now: nothing new is accepted until the accepted events are
    /// written.
    unavailable: Option<StoreError>,
    /// Tries that failed for this reason since the last write.
    retries: u32,
    flushing: bool,
    /// Encoded records that wait for a flush, and the sequence of the first one.
    pending: Vec<u8>,
    pending_first: u64,
    /// The last events with the size of their payload, and the sum of the sizes.
    recent: VecDeque<(Arc<Event>, usize)>,
    recent_bytes: usize,
    bytes_since_snapshot: u64,
}

impl Journal {
    pub(super) fn new(
        name: &str,
        uid: Uid,
        folder: PathBuf,
        disk: Arc<dyn Disk>,
        options: FileStoreOptions,
        meters: &Arc<StoreMeters>,
    ) -> Self {
        Self {
            name: name.to_owned(),
            uid,
            folder,
            #[cfg(feature = "cluster")]
            aside: std::sync::OnceLock::new(),
            disk,
            options,
            meters: Arc::clone(meters),
            state: Mutex::default(),
            writer: Mutex::default(),
            flushed: watch::Sender::new(Flushed::default()),
            exclusive: Arc::default(),
        }
    }

    pub(super) fn state(&self) -> MutexGuard<'_, State> {
        self.state.lock()
    }

    fn writer(&self) -> MutexGuard<'_, Writer> {
        self.writer.lock()
    }

    /// Takes over what was found on disk. The first [`Journal::flush`] makes it durable if that is not
    /// certain.
    pub(super) fn loaded(&self, found: OpenedFiles) {
        let mut state = self.state();
        state.loaded = true;
        state.last = found.last;
        state.durable = found.durable;
        state.dropped = match found.segments.first() {
            Some(first) => first.saturating_sub(1),
            None => found.last,
        };
        state.snapshots = found.snapshots;
        state.damage = found.damage;
        state.lost = found.lost;
        state.bytes_since_snapshot = found.bytes_since_snapshot;
        // An append before all is durable must not start a second flush.
        state.flushing = true;
        drop(state);
        *self.writer() = Writer::of(found.segments, found.unsynced);
        self.tell();
    }

    /// Notes an event that cannot be read. Unless a snapshot holds it, no change is accepted from here on,
    /// and the files stay as they are.
    pub(super) fn lose(&self, mut damage: Damage) {
        let mut state = self.state();
        let newest = state.snapshots.last().copied().unwrap_or(0);
        if damage.lost.is_some_and(|(first, _)| first <= newest) {
            damage.lost = None;
        }
        if state.damage.contains(&damage) {
            return;
        }
        if damage.lost.is_some() {
            state.lost.get_or_insert_with(|| damage.clone());
        }
        state.damage.push(damage);
    }

    /// Reports to all followers how far the journal is durable.
    fn tell(&self) {
        let state = self.state();
        let (failed, unavailable) = (state.failed.clone(), state.unavailable.clone());
        self.flushed.send_replace(Flushed { through: state.durable, failed, unavailable });
    }

    pub(super) fn follow(&self) -> watch::Receiver<Flushed> {
        self.flushed.subscribe()
    }

    /// Stops the journal permanently: pending events do not become durable.
    pub(super) fn stop(&self, cause: String) -> StoreError {
        let mut state = self.state();
        let (map, durable) = (self.name.clone(), state.durable);
        let error = state.failed.get_or_insert(StoreError::Stopped { map, durable, cause }).clone();
        state.pending = Vec::new();
        state.unavailable = None;
        drop(state);
        self.tell();
        error
    }

    /// Stops the journal once its last write is done. Blocks.
    pub(super) fn close(&self) {
        self.stop("the store was closed".to_owned());
        self.writer().end();
    }

    /// Removes the map's folder, also after a deletion that failed halfway. On failure either
    /// nothing has changed, or the journal has stopped. Blocks.
    pub(super) fn delete(&self) -> Result<(), StoreError> {
        let gone = self.folder.with_extension("deleted");
        self.move_to(&gone, "cannot delete", "the map was deleted")?;
        // The map is deleted by now; the next start removes the rest of its files.
        if let Err(error) = self.disk.remove_folder(&gone) {
            tracing::warn!(folder = %gone.display(), %error, "files of a deleted map are left");
        }
        Ok(())
    }

    /// Moves the map's folder out of `maps/`, also after a move that failed halfway, and stops the
    /// journal for a reason. On failure, which `action` names, either nothing has changed, or the
    /// journal has stopped. Blocks.
    pub(super) fn move_to(
        &self,
        to: &Path,
        action: &'static str,
        reason: &str,
    ) -> Result<(), StoreError> {
        let (disk, folder) = (&*self.disk, &*self.folder);
        let maps = folder.parent().unwrap_or(folder);
        // Locked, so that no group is written and acknowledged while its map is moved.
        let mut writer = self.writer();
        let begun = match is_there(disk, folder)? {
            false => Ok(()),
            true => disk.rename(folder, to).or_else(|error| match is_there(disk, folder) {
                Ok(true) => Err((error, true)),
                Ok(false) => Ok(()),
                Err(_) => Err((error, false)),
            }),
        };
        // The new name first: a loss of power in between must not leave the map without any.
        let beside = to.parent().filter(|folder| *folder != maps);
        let synced = || beside.into_iter().chain([maps]).try_for_each(|f| disk.sync_folder(f));
        let begun = begun.and_then(|()| synced().map_err(|error| (error, false)));
        if let Err((error, is_unchanged)) = begun {
            if !is_unchanged {
                // The next start may find the folder under either name.
                self.stop(format!("{action}: failed half way and can be repeated: {error}"));
                writer.end();
            }
            return Err(file_error(action, folder, &error));
        }
        self.stop(reason.to_owned());
        writer.end();
        Ok(())
    }

    /// Waits until all events accepted so far are durable.
    ///
    /// # Errors
    /// Why they do not become durable, or not soon.
    pub(super) async fn wait_durable(&self) -> Result<(), StoreError> {
        let last = self.state().last;
        wait_durable(self.follow(), last).await
    }

    /// Waits while too much is pending and the journal works.
    pub(super) async fn wait_for_room(&self) {
        let is_full = || {
            let state = self.state();
            state.pending.len() > MOST_PENDING && state.unavailable.is_none()
        };
        let mut flushed = self.follow();
        while is_full() {
            flushed.borrow_and_update();
            if !is_full() || flushed.changed().await.is_err() {
                return;
            }
        }
    }

    /// Accepts events; `true` if the caller must start [`Journal::flush`].
    pub(super) fn accept(
        &self,
        epoch: Epoch,
        expected_sequence: u64,
        batch: Vec<Arc<Event>>,
    ) -> Result<(Position, bool), StoreError> {
        let payloads =
            batch.iter().map(|event| self.readable(event)).collect::<Result<Vec<_>, _>>()?;
        let mut guard = self.state();
        let state = &mut *guard;
        self.check_epoch(state, epoch)?;
        if let Some(error) = &state.failed {
            return Err(error.clone());
        }
        if let Some(damage) = &state.lost {
            return Err(StoreError::Damaged { map: self.name.clone(), damage: damage.clone() });
        }
        if let Some(error) = &state.unavailable {
            return Err(error.clone());
        }
        let mismatch = |expected, actual| {
            Err(StoreError::SequenceMismatch { map: self.name.clone(), expected, actual })
        };
        if expected_sequence != state.last {
            return mismatch(state.last, expected_sequence);
        }
        // At the end of all sequences no event fits, for a revision has a bit less.
        let first = state.last.saturating_add(1);
        for (expected, event) in (first..).zip(&batch) {
            if sequence_of(event.revision) != expected {
                return mismatch(expected, sequence_of(event.revision));
            }
        }
        let rollback = state.pending.len();
        for (sequence, payload) in (first..).zip(&payloads) {
            if !put_record(&mut state.pending, &self.uid, sequence, state.durable, payload) {
                state.pending.truncate(rollback);
                let path = self.name.clone();
                let message = format!("event {sequence} is too large for the journal");
                return Err(StoreError::Content { path, message });
            }
        }
        if rollback == 0 {
            state.pending_first = first;
        }
        state.bytes_since_snapshot += (state.pending.len() - rollback) as u64;
        state.last += batch.len() as u64;
        for (event, payload) in batch.into_iter().zip(payloads) {
            state.remember(event, payload.len());
        }
        let starts = !state.flushing && !state.pending.is_empty();
        state.flushing |= starts;
        let position = Position {
            sequence: state.last,
            durable: state.durable >= state.last,
            snapshot_due: state.bytes_since_snapshot >= self.options.snapshot_bytes,
            waiting_bytes: state.pending.len() as u64,
        };
        Ok((position, starts))
    }

    /// The bytes of an event, which can be read again.
    fn readable(&self, event: &Event) -> Result<Vec<u8>, StoreError> {
        let mut payload = Vec::new();
        encode_readable(event, &mut payload)
            .map_err(|error| error.not_readable(&self.name, event))?;
        Ok(payload)
    }

    pub(super) fn check_epoch(&self, state: &State, epoch: Epoch) -> Result<(), StoreError> {
        if epoch == state.epoch {
            return Ok(());
        }
        Err(StoreError::Fenced { map: self.name.clone(), epoch, newest: state.epoch })
    }

    /// Records a complete snapshot at `sequence`. The next group starts a new file, so that the
    /// files before it can be dropped.
    pub(super) fn snapshot_taken(&self, sequence: u64, snapshots: Vec<u64>) {
        let mut state = self.state();
        state.snapshots = snapshots;
        // Events that arrived while it was written count approximately for the next one.
        let behind = state.last.saturating_sub(sequence);
        let recent = state.recent.iter().rev().take(usize::try_from(behind).unwrap_or(usize::MAX));
        state.bytes_since_snapshot = recent.map(|(_, size)| *size as u64).sum();
        drop(state);
        self.writer().roll = true;
    }

    /// Removes the files that have no event from `before` on. Blocks.
    pub(super) fn drop_before(&self, before: u64) -> io::Result<()> {
        let mut writer = self.writer();
        while let [first, next, ..] = writer.segments[..]
            && next <= before
        {
            self.disk.remove(&self.folder.join(journal_name(first)))?;
            writer.segments.remove(0);
        }
        Ok(())
    }

    /// The first sequence of each file, rising.
    pub(super) fn segments(&self) -> Vec<u64> {
        self.writer().segments.clone()
    }

    /// Some of the events after `from` and up to `through`, if the events in memory reach back that
    /// far.
    pub(super) fn recent_piece(&self, from: u64, through: u64, most: usize) -> Option<Piece> {
        let state = self.state();
        let behind = usize::try_from(state.last.saturating_sub(from)).ok()?;
        let skip = state.recent.len().checked_sub(behind)?;
        let left = usize::try_from(through.saturating_sub(from)).unwrap_or(usize::MAX);
        let mut piece = Piece::default();
        for (event, size) in state.recent.iter().skip(skip).take(left.min(most)) {
            piece.events.push(Arc::clone(event));
            piece.bytes += *size as u64;
        }
        Some(piece)
    }
}

/// Whether a folder exists.
fn is_there(disk: &dyn Disk, folder: &Path) -> Result<bool, StoreError> {
    match disk.list(folder) {
        Ok(_) => Ok(true),
        Err(error) if error.kind() == io::ErrorKind::NotFound => Ok(false),
        Err(error) => Err(file_error("cannot list", folder, &error)),
    }
}

impl State {
    /// Which resource is used up for now.
    pub(super) fn unavailable(&self) -> Option<&StoreError> {
        self.unavailable.as_ref()
    }

    fn remember(&mut self, event: Arc<Event>, size: usize) {
        self.recent_bytes += size;
        self.recent.push_back((event, size));
        while self.recent_bytes > RECENT
            && let Some((_, size)) = self.recent.pop_front()
        {
            self.recent_bytes -= size;
        }
    }
}
