//! A map that this server serves: its stream, what is on its way there, and its entry in the catalog.
//!
//! Durable is what both have: the own journal and the stream. Once another server has the map, the map has
//! failed: nothing more is acknowledged, also what becomes durable still. While this server has no lease
//! the map is unavailable. When the lease holds again the catalog is asked: where nobody took the map, this
//! server goes on with it as it is, under the same epoch of the stream.

use std::sync::Arc;
use std::time::Duration;

use tokio::sync::{Mutex, MutexGuard, watch};
use tokio::task::AbortHandle;

use super::catalog::{Catalog, Entry, StoredEntry};
use super::map_stream::MapStream;
use super::members::Lease;
use super::publisher::Publisher;
use crate::{Flushed, StoreError};

/// How long a map that is given away waits for the stream.
const LAST_WORDS: Duration = Duration::from_secs(5);
/// How long a catalog that does not answer is left alone.
const AGAIN: Duration = Duration::from_millis(500);

/// A map that this server serves; dropping it ends its publishing.
#[derive(Debug)]
pub(super) struct Owned {
    map: String,
    pub(super) stream: MapStream,
    pub(super) publisher: Publisher,
    known: Arc<Mutex<StoredEntry>>,
    flushed: watch::Receiver<Flushed>,
    joining: AbortHandle,
}

/// What an owner is told by: how far the own journal is durable, and whether this server may serve.
#[derive(Debug)]
pub(super) struct Signals {
    pub(super) local: watch::Receiver<Flushed>,
    pub(super) lease: watch::Receiver<Lease>,
    /// The lapses of the lease before the catalog was last asked.
    pub(super) lapses: u64,
}

impl Owned {
    /// Starts to serve a map whose entry in the catalog is `known`.
    pub(super) fn start(
        stream: MapStream,
        publisher: Publisher,
        known: StoredEntry,
        catalog: Catalog,
        signals: Signals,
    ) -> Arc<Self> {
        let map = known.entry.name.clone();
        let (known, progress) = (Arc::new(Mutex::new(known)), publisher.progress());
        let (sender, flushed) = watch::channel(Flushed::default());
        let mut joined = DurabilityJoin {
            map: map.clone(),
            known: Arc::clone(&known),
            catalog,
            signals,
            progress,
            is_taken: false,
            sender,
        };
        joined.update();
        let joining = tokio::spawn(joined.run()).abort_handle();
        Arc::new(Self { map, stream, publisher, known, flushed, joining })
    }

    pub(super) fn flushed(&self) -> watch::Receiver<Flushed> {
        self.flushed.clone()
    }

    /// The map's entry, held until the guard is dropped.
    pub(super) async fn known(&self) -> MutexGuard<'_, StoredEntry> {
        self.known.lock().await
    }

    /// Refuses changes that would not become durable.
    pub(super) fn check(&self) -> Result<(), StoreError> {
        self.flushed.borrow().trouble().cloned().map_or(Ok(()), Err)
    }

    /// Publishes nothing more.
    pub(super) fn stop(&self) {
        self.publisher.stop();
        self.joining.abort();
    }

    /// Lets another server take the map at once. What is not in the stream by then was not acknowledged.
    pub(super) async fn give_away(&self, catalog: &Catalog) {
        let idle = self.publisher.idle();
        if tokio::time::timeout(LAST_WORDS, idle).await.is_err() {
            tracing::warn!(map = self.map, "the stream lacks items that were not acknowledged");
        }
        self.stop();
        let known = self.known.lock().await;
        let entry = Entry { owner: None, ..known.entry.clone() };
        match catalog.replace(&known, entry).await {
            Ok(Some(_)) => {}
            Ok(None) => tracing::info!(map = self.map, "another server has the map already"),
            Err(error) => tracing::warn!(map = self.map, %error, "the map is free with the lease"),
        }
    }
}

impl Drop for Owned {
    fn drop(&mut self) {
        self.stop();
    }
}

/// Joins what tells of durability.
struct DurabilityJoin {
    map: String,
    known: Arc<Mutex<StoredEntry>>,
    catalog: Catalog,
    signals: Signals,
    /// How far the stream has acknowledged.
    progress: watch::Receiver<Flushed>,
    /// Whether the catalog gives the map to another server.
    is_taken: bool,
    sender: watch::Sender<Flushed>,
}

impl DurabilityJoin {
    async fn run(mut self) {
        while self.update() {
            let lease = *self.signals.lease.borrow();
            if lease.holds && lease.lapses != self.signals.lapses {
                // Nothing is told meanwhile: without the answer nothing counts.
                self.confirm(lease.lapses).await;
                continue;
            }
            let changed = tokio::select! {
                changed = self.signals.local.changed() => changed,
                changed = self.progress.changed() => changed,
                changed = self.signals.lease.changed() => changed,
            };
            if changed.is_err() {
                return;
            }
        }
    }

    /// Asks the catalog whether the map is still this server's, after so many lapses of the lease.
    async fn confirm(&mut self, lapses: u64) {
        match confirm(&self.catalog, &mut *self.known.lock().await).await {
            Ok(true) => {
                tracing::info!(
                    map = self.map,
                    "no other server took the map: this server keeps serving it"
                );
                self.signals.lapses = lapses;
            }
            Ok(false) => self.is_taken = true,
            Err(error) => {
                tracing::warn!(map = self.map, %error, "the owner of the map is not known yet");
                tokio::time::sleep(AGAIN).await;
            }
        }
    }

    /// Tells what holds now; false once the map has failed.
    fn update(&mut self) -> bool {
        let local = self.signals.local.borrow_and_update().clone();
        let progress = self.progress.borrow_and_update().clone();
        let lease = *self.signals.lease.borrow_and_update();
        let is_served = lease.holds && lease.lapses == self.signals.lapses;
        let elsewhere = || StoreError::OwnedElsewhere { map: self.map.clone(), owner: None };
        let taken = self.is_taken.then(elsewhere);
        let failed = taken.or(progress.failed).or(local.failed);
        let lapsed = (!is_served).then(elsewhere);
        let unavailable = lapsed.or(local.unavailable).or(progress.unavailable);
        let has_failed = failed.is_some();
        self.sender.send_modify(|flushed| {
            if is_served && !has_failed {
                flushed.through = flushed.through.max(local.through.min(progress.through));
            }
            flushed.failed = failed;
            flushed.unavailable = unavailable;
        });
        !has_failed
    }
}

/// Whether the catalog still gives a map to the owner in `known`: then the entry is written again,
/// unchanged, so that a claim that another server has begun on it fails.
///
/// # Errors
/// [`StoreError::Unavailable`]: the same call can be repeated.
pub(super) async fn confirm(
    catalog: &Catalog,
    known: &mut StoredEntry,
) -> Result<bool, StoreError> {
    loop {
        if let Some(replaced) = catalog.replace(known, known.entry.clone()).await? {
            *known = replaced;
            return Ok(true);
        }
        // A write of this owner may have been made although its answer was lost.
        let Some(found) = catalog.get(&known.entry.name).await? else { return Ok(false) };
        let is_same = found.entry.uid == known.entry.uid && found.entry.owner == known.entry.owner;
        if !is_same || found.revision == known.revision {
            return Ok(false);
        }
        *known = found;
    }
}
