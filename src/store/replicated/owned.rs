//! A map that this server serves: its stream, what is on its way there, and its entry in the catalog.
//!
//! Durable is what both have: the own journal and the stream. Once another server has the map, or this
//! one has lost its lease, the map has failed: nothing more is acknowledged, also what becomes durable
//! still.

use std::sync::Arc;
use std::time::Duration;

use tokio::sync::{Mutex, MutexGuard, watch};
use tokio::task::AbortHandle;

use super::catalog::{Catalog, Entry, StoredEntry};
use super::map_stream::MapStream;
use super::publisher::Publisher;
use crate::store::{Flushed, StoreError};

/// How long a map that is given away waits for the stream.
const LAST_WORDS: Duration = Duration::from_secs(5);

/// A map that this server serves; dropping it ends its publishing.
#[derive(Debug)]
pub(super) struct Owned {
    map: String,
    pub(super) stream: MapStream,
    pub(super) publisher: Publisher,
    known: Mutex<StoredEntry>,
    flushed: watch::Receiver<Flushed>,
    joining: AbortHandle,
}

impl Owned {
    /// `local` tells how far the own journal is durable, `holds_lease` whether this server may serve.
    pub(super) fn start(
        map: &str,
        stream: MapStream,
        publisher: Publisher,
        known: StoredEntry,
        local: watch::Receiver<Flushed>,
        holds_lease: watch::Receiver<bool>,
    ) -> Arc<Self> {
        let progress = publisher.progress();
        let (sender, flushed) = watch::channel(Flushed::default());
        let mut joined =
            DurabilityJoin { map: map.to_owned(), local, progress, holds_lease, sender };
        joined.update();
        let joining = tokio::spawn(joined.run()).abort_handle();
        let (map, known) = (map.to_owned(), Mutex::new(known));
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
            tracing::warn!(map = self.map, "the stream lacks what was not acknowledged");
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
    local: watch::Receiver<Flushed>,
    /// How far the stream has acknowledged.
    progress: watch::Receiver<Flushed>,
    holds_lease: watch::Receiver<bool>,
    sender: watch::Sender<Flushed>,
}

impl DurabilityJoin {
    async fn run(mut self) {
        while self.update() {
            let changed = tokio::select! {
                changed = self.local.changed() => changed,
                changed = self.progress.changed() => changed,
                changed = self.holds_lease.changed() => changed,
            };
            if changed.is_err() {
                return;
            }
        }
    }

    /// Tells what holds now; false once the map has failed.
    fn update(&mut self) -> bool {
        let local = self.local.borrow_and_update().clone();
        let progress = self.progress.borrow_and_update().clone();
        let lost = !*self.holds_lease.borrow_and_update();
        let elsewhere = || StoreError::OwnedElsewhere { map: self.map.clone(), owner: None };
        let failed = if lost { Some(elsewhere()) } else { progress.failed.or(local.failed) };
        let has_failed = failed.is_some();
        self.sender.send_modify(|flushed| {
            if !has_failed {
                flushed.through = flushed.through.max(local.through.min(progress.through));
            }
            flushed.failed = failed;
            flushed.unavailable = local.unavailable.or(progress.unavailable);
        });
        !has_failed
    }
}
