//! DURABLE acks, snapshots, and the handling of a journal that fails.
//!
//! The engine does not wait for fsync: it appends an event, applies it and acknowledges it as
//! RECEIVED. The DURABLE ack waits here until the journal reports that the event is on disk.
//! Watchers get no change that a crash could still undo (`handle.rs`). When the journal fails, the
//! streams end: events that are applied but not durable get no DURABLE ack, and the map accepts no
//! further changes.

use std::collections::{BTreeMap, VecDeque};
use std::sync::Arc;

use futures_util::FutureExt;
use tokio::sync::watch;
use tokio::task::JoinHandle;

use super::actor::Actor;
use super::streams::Permit;
use super::{Ack, AckStatus, EngineError, MapState, StreamEvent};
use crate::map::ClientIndex;
use crate::store::{Flushed, StoreError};

/// Number of events after which a failed snapshot is tried again.
const RETRY_EVENTS: i64 = 1000;

/// Outstanding DURABLE acks.
pub(super) struct DurableAcks {
    flushed: watch::Receiver<Flushed>,
    /// Whether the journal reports no more; then nothing further becomes durable.
    closed: bool,
    waiting: VecDeque<(ClientIndex, Ack, Permit)>,
}

impl DurableAcks {
    pub(super) fn new(flushed: watch::Receiver<Flushed>) -> Self {
        Self { flushed, closed: false, waiting: VecDeque::new() }
    }

    pub(super) fn is_empty(&self) -> bool {
        self.waiting.is_empty()
    }

    /// Acknowledges an item once the journal is durable up to `revision`.
    pub(super) fn wait(
        &mut self,
        client: ClientIndex,
        sequence: i64,
        revision: i64,
        permit: Permit,
    ) {
        let ack = Ack { sequence, revision, status: AckStatus::Durable };
        // Waiting acks are sent first. If this event is durable, theirs are too, and `progress`
        // wakes for them.
        if self.reaches(revision) && self.waiting.is_empty() {
            permit.is_durable();
            permit.send(StreamEvent::Ack(ack));
        } else if !self.closed {
            self.waiting.push_back((client, ack, permit));
        }
    }

    /// Whether the journal is durable up to `revision`.
    fn reaches(&self, revision: i64) -> bool {
        self.flushed.borrow().through >= u64::try_from(revision).unwrap_or(0)
    }

    /// Resolves when the journal has made progress or failed.
    pub(super) async fn progress(&mut self) {
        if self.closed {
            return std::future::pending().await;
        }
        if self.flushed.changed().await.is_err() {
            self.closed = true;
            self.waiting.clear();
        }
    }

    /// Sends the acks that are due: for each client the last one, which covers all before it.
    /// Returns the error of a journal that has failed.
    fn send(&mut self) -> Option<StoreError> {
        let Flushed { through, failed, unavailable: _ } = self.flushed.borrow_and_update().clone();
        let mut last = BTreeMap::new();
        while let Some((_, ack, _)) = self.waiting.front()
            && u64::try_from(ack.revision).unwrap_or(0) <= through
            && let Some((client, ack, permit)) = self.waiting.pop_front()
        {
            permit.is_durable();
            last.insert(client, (ack, permit));
        }
        for (ack, permit) in last.into_values() {
            permit.send(StreamEvent::Ack(ack));
        }
        failed
    }
}

/// The snapshots of a map, one at a time in the background.
#[derive(Default)]
pub(super) struct Snapshots {
    /// Revision of the last complete snapshot; 0 without one.
    kept: i64,
    /// Writes a snapshot and returns the revision of the last complete one.
    running: Option<JoinHandle<i64>>,
    not_before: i64,
}

impl Snapshots {
    pub(super) fn new(kept: i64) -> Self {
        Self { kept, ..Self::default() }
    }
}

impl Actor {
    /// Acknowledges what has become durable.
    pub(super) fn flushed(&mut self) {
        if self.durable.reaches(self.map.revision()) {
            self.journal.count(0);
        }
        if let Some(error) = self.durable.send() {
            self.durable.waiting.clear();
            let error = EngineError::Store(error);
            tracing::error!(%error, "the map takes no changes any more");
            self.refusal.get_or_insert(error.clone());
            self.state = MapState::Poisoned;
            self.cancel_solves(&error);
            self.streams.end_all(&error);
            self.watchers.wake();
        }
    }

    /// Starts a snapshot of the map as it is, unless one is being written.
    pub(super) fn take_snapshot(&mut self) {
        let revision = self.map.revision();
        let snapshots = &mut self.snapshots;
        match &mut snapshots.running {
            Some(running) if !running.is_finished() => return,
            Some(running) => {
                if let Some(Ok(kept)) = running.now_or_never() {
                    snapshots.kept = kept;
                }
                snapshots.running = None;
            }
            None => {}
        }
        if revision < snapshots.not_before {
            return;
        }
        snapshots.not_before = revision.saturating_add(RETRY_EVENTS);
        let (store, shared) = (Arc::clone(&self.store), Arc::clone(&self.shared));
        let (epoch, map, kept) = (self.store_epoch, Arc::clone(&self.map), snapshots.kept);
        snapshots.running = Some(tokio::spawn(async move {
            if let Err(error) = store.put_snapshot(&shared.name, epoch, map).await {
                tracing::warn!(%error, "no snapshot was written, the journal grows on");
                return kept;
            }
            // The previous snapshot is kept, with all events after it.
            let before = u64::try_from(kept).unwrap_or(0) + 1;
            if let Err(error) = store.truncate(&shared.name, epoch, before).await {
                tracing::warn!(%error, "the journal was not truncated");
            }
            tracing::debug!(revision, "snapshot written");
            revision
        }));
    }
}
