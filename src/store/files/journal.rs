//! One map's journal: accepts events in order, writes and syncs them in groups, remembers failures.
//!
//! An append puts its records into a buffer and returns. At most one flush runs a map: it takes all
//! that waits, writes it at once, syncs once, and tells how far that reaches; what arrived meanwhile
//! is the next group. After a flush that leaves nothing waiting a mark is written beside the journal,
//! so that a last record that is damaged or gone is not taken for an unfinished write. A write or fsync that fails is
//! never tried again: what the system kept of it is not known, so the journal stops.

use std::collections::VecDeque;
use std::io;
use std::path::PathBuf;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::Instant;

use tokio::sync::watch;

use super::disk::{Disk, DiskFile};
use super::load::Found;
use super::record::{HEADER, Uid, header, mark, put_record};
use super::{FileStoreOptions, MARK, journal_name};
use crate::map::Event;
use crate::store::encoding::encode_event;
use crate::store::{Damage, Epoch, Flushed, Position, StoreError, StoreMeters, sequence_of};

/// Bytes that wait for a flush before appends have to wait too.
const MOST_PENDING: usize = 64 << 20;
/// Bytes of encoded events that are kept for readers who were away for a moment.
const RECENT: usize = 4 << 20;

/// A map's journal and what is known of its files.
#[derive(Debug)]
pub(super) struct Journal {
    pub(super) name: String,
    pub(super) uid: Uid,
    pub(super) folder: PathBuf,
    pub(super) disk: Arc<dyn Disk>,
    options: FileStoreOptions,
    pub(super) meters: Arc<StoreMeters>,
    state: Mutex<State>,
    /// Locked before `state` where both are.
    writer: Mutex<Writer>,
    flushed: watch::Sender<Flushed>,
    /// Held while the folder is read for the first time, and while a snapshot is written.
    pub(super) exclusive: tokio::sync::Mutex<()>,
}

/// What an append looks at.
#[derive(Debug, Default)]
pub(super) struct State {
    /// Whether the folder was read.
    pub(super) loaded: bool,
    /// The newest writer.
    pub(super) epoch: Epoch,
    /// The last accepted sequence.
    pub(super) last: u64,
    /// Sequences up to this one cannot be read any more.
    pub(super) dropped: u64,
    /// Snapshots that can be read, rising.
    pub(super) snapshots: Vec<u64>,
    pub(super) damage: Vec<Damage>,
    pub(super) frozen: Option<Damage>,
    durable: u64,
    failed: Option<StoreError>,
    flushing: bool,
    /// Encoded records that wait, and the sequence of the first of them.
    pending: Vec<u8>,
    pending_first: u64,
    /// The last events with the size of their payload, and the sum of the sizes.
    recent: VecDeque<(Arc<Event>, usize)>,
    recent_bytes: usize,
    bytes_since_snapshot: u64,
}

/// The file that is written.
#[derive(Debug, Default)]
struct Writer {
    file: Option<Box<dyn DiskFile>>,
    length: u64,
    /// Whether the next group begins a new file.
    roll: bool,
    segments: Vec<u64>,
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
            disk,
            options,
            meters: Arc::clone(meters),
            state: Mutex::default(),
            writer: Mutex::default(),
            flushed: watch::Sender::new(Flushed::default()),
            exclusive: tokio::sync::Mutex::new(()),
        }
    }

    pub(super) fn state(&self) -> MutexGuard<'_, State> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn writer(&self) -> MutexGuard<'_, Writer> {
        self.writer.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Takes over what was found on disk.
    pub(super) fn loaded(&self, found: Found) {
        let (file, length) = found.tail.map_or((None, 0), |(file, length)| (Some(file), length));
        let mut state = self.state();
        state.loaded = true;
        state.last = found.last;
        state.durable = found.last;
        state.dropped = match found.segments.first() {
            Some(first) => first.saturating_sub(1),
            None => found.last,
        };
        state.snapshots = found.snapshots;
        state.damage = found.damage;
        state.frozen = found.frozen;
        state.bytes_since_snapshot = found.bytes_since_snapshot;
        drop(state);
        *self.writer() = Writer { file, length, roll: false, segments: found.segments };
        self.flushed.send_replace(Flushed { through: found.last, failed: None });
    }

    pub(super) fn follow(&self) -> watch::Receiver<Flushed> {
        self.flushed.subscribe()
    }

    /// Stops the journal, for good: nothing that waits becomes durable.
    pub(super) fn stop(&self, cause: String) -> StoreError {
        let mut state = self.state();
        let (map, durable) = (self.name.clone(), state.durable);
        let error = state.failed.get_or_insert(StoreError::Stopped { map, durable, cause }).clone();
        state.pending = Vec::new();
        let failed = Some(error.clone());
        self.flushed.send_replace(Flushed { through: durable, failed });
        error
    }

    /// Stops the journal once its last write is done. Blocks.
    pub(super) fn close(&self) {
        self.stop("the store was closed".to_owned());
        let mut writer = self.writer();
        writer.file = None;
    }

    /// Waits until what was accepted by now is durable.
    pub(super) async fn settle(&self) -> Result<(), StoreError> {
        let last = self.state().last;
        let mut flushed = self.follow();
        let reached = flushed.wait_for(|f| f.through >= last || f.failed.is_some()).await;
        // The journal holds the sender, so that the channel is open.
        match reached.ok().and_then(|flushed| flushed.failed.clone()) {
            Some(error) => Err(error),
            None => Ok(()),
        }
    }

    /// Waits while too much waits already.
    pub(super) async fn wait_for_room(&self) {
        let mut flushed = self.follow();
        while self.state().pending.len() > MOST_PENDING {
            flushed.borrow_and_update();
            if self.state().pending.len() <= MOST_PENDING || flushed.changed().await.is_err() {
                return;
            }
        }
    }

    /// Accepts events; `true` where the caller must start [`Journal::flush`].
    pub(super) fn accept(
        &self,
        epoch: Epoch,
        expected_sequence: u64,
        batch: Vec<Arc<Event>>,
    ) -> Result<(Position, bool), StoreError> {
        let mut guard = self.state();
        let state = &mut *guard;
        self.check_epoch(state, epoch)?;
        if let Some(error) = &state.failed {
            return Err(error.clone());
        }
        if let Some(damage) = &state.frozen {
            return Err(StoreError::Damaged { map: self.name.clone(), damage: damage.clone() });
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
        let mut payload = Vec::new();
        let mut sizes = Vec::with_capacity(batch.len());
        for (sequence, event) in (first..).zip(&batch) {
            payload.clear();
            encode_event(event, &mut payload);
            sizes.push(payload.len());
            if !put_record(&mut state.pending, &self.uid, sequence, state.durable, &payload) {
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
        for (event, size) in batch.into_iter().zip(sizes) {
            state.remember(event, size);
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

    pub(super) fn check_epoch(&self, state: &State, epoch: Epoch) -> Result<(), StoreError> {
        if epoch == state.epoch {
            return Ok(());
        }
        Err(StoreError::Fenced { map: self.name.clone(), epoch, newest: state.epoch })
    }

    /// Writes and syncs until nothing waits. Blocks.
    pub(super) fn flush(&self) {
        loop {
            // Taken anew for each group, so that whoever reads or drops files gets a turn.
            let mut writer = self.writer();
            let (batch, first, last) = {
                let mut state = self.state();
                if state.pending.is_empty() {
                    state.flushing = false;
                    return;
                }
                (std::mem::take(&mut state.pending), state.pending_first, state.last)
            };
            let start = Instant::now();
            let written = self.write_group(&mut writer, first, &batch);
            self.meters.sync_ns.observe_time(start.elapsed());
            if let Err(error) = written {
                self.failed_flush(&error);
                return;
            }
            self.meters.group_events.observe(last.saturating_sub(first) + 1);
            self.meters.journal_bytes.add(batch.len() as u64);
            let idle = {
                let mut state = self.state();
                state.durable = last;
                self.flushed.send_replace(Flushed { through: last, failed: state.failed.clone() });
                state.pending.is_empty()
            };
            // Evidence and no promise: without it, damage to the end may go unnoticed.
            if idle
                && let Err(error) =
                    self.disk.overwrite(&self.folder.join(MARK), &mark(&self.uid, last))
            {
                tracing::warn!(map = %self.name, %error, "the mark was not written");
            }
        }
    }

    fn failed_flush(&self, error: &io::Error) {
        // Whoever is told of it may look.
        self.meters.journal_failures.increment();
        let error = self.stop(error.to_string());
        tracing::error!(map = %self.name, %error, "the journal stops");
        self.state().flushing = false;
    }

    /// One write and one sync, in a new file where it is time for one.
    fn write_group(&self, writer: &mut Writer, first: u64, batch: &[u8]) -> io::Result<()> {
        let full = writer.length >= self.options.segment_bytes || writer.roll;
        if full {
            writer.file = None;
        }
        if let Some(file) = &mut writer.file {
            file.append(batch)?;
            file.sync()?;
            writer.length += batch.len() as u64;
            return Ok(());
        }
        let mut file = self.disk.create(&self.folder.join(journal_name(first)))?;
        let mut bytes = header(&self.uid, first);
        bytes.extend_from_slice(batch);
        file.append(&bytes)?;
        file.sync()?;
        self.disk.sync_folder(&self.folder)?;
        writer.segments.push(first);
        let length = (HEADER + batch.len()) as u64;
        (writer.file, writer.length, writer.roll) = (Some(file), length, false);
        Ok(())
    }

    /// A snapshot stands at `sequence`: later files of the journal can be dropped without those
    /// before it.
    pub(super) fn snapshot_taken(&self, sequence: u64, snapshots: Vec<u64>) {
        let mut state = self.state();
        state.snapshots = snapshots;
        // What came while it was written counts for the next one, about.
        let behind = state.last.saturating_sub(sequence);
        let recent = state.recent.iter().rev().take(usize::try_from(behind).unwrap_or(usize::MAX));
        state.bytes_since_snapshot = recent.map(|(_, size)| *size as u64).sum();
        drop(state);
        self.writer().roll = true;
    }

    /// Removes the files that hold nothing from `before` on. Blocks.
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

    /// The events after `from`, where the last ones that are kept reach back so far.
    pub(super) fn recent(&self, from: u64) -> Option<Vec<Arc<Event>>> {
        let state = self.state();
        let behind = usize::try_from(state.last.saturating_sub(from)).ok()?;
        let skip = state.recent.len().checked_sub(behind)?;
        Some(state.recent.iter().skip(skip).map(|(event, _)| Arc::clone(event)).collect())
    }
}

impl State {
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
