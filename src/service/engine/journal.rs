//! Commits events, and restores a map after a panic.
//!
//! The journal accepts an event before the event changes the map, and makes it durable while the
//! engine continues (`durable.rs`). A panic poisons the map: streams and solves end, reads still
//! work. If the panic may have left an event half applied, the map is replayed from the journal.

use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::Arc;
use std::sync::atomic::Ordering;
use std::time::UNIX_EPOCH;

use super::actor::{Actor, report_bug};
use super::{EngineError, MapState};
use crate::map::{Cause, Change, Event, Map};
use crate::store::{Position, Store, StoreError};

impl Actor {
    /// Journals and applies one change.
    ///
    /// # Errors
    /// [`EngineError::Store`]: nothing was changed. [`EngineError::Bug`]: the event does not fit and
    /// the map is now poisoned.
    pub(super) async fn commit(
        &mut self,
        cause: Option<Cause>,
        change: Change,
    ) -> Result<Position, EngineError> {
        let revision = self.map.revision();
        let time_ns = unix_time_ns(&*self.store);
        let event = Arc::new(Event { revision: revision + 1, time_ns, cause, change });
        if let Err(error) = self.map.fits(&event) {
            let details = format!("an event does not fit: {error}");
            return Err(self.poisoned(&details));
        }
        let sequence = u64::try_from(revision).unwrap_or(0);
        let (store, name) = (&self.store, &self.shared.name);
        let batch = vec![Arc::clone(&event)];
        let position = store.append(name, self.store_epoch, sequence, batch).await?;
        self.journal.count(position.waiting_bytes);
        let snapshot_due = position.snapshot_due;
        self.applying = Some(revision);
        if self.config.panics_in_engine() && event.cause.is_some() {
            std::panic::panic_any("staged by a test");
        }
        self.watchers.tell(&event.change, &self.map);
        Arc::make_mut(&mut self.map).fold(&event);
        self.applying = None;
        self.entities.update(self.map.usage());
        self.watchers.wake();
        if snapshot_due {
            self.take_snapshot();
        }
        Ok(position)
    }

    /// Poisons the map after a panic. If the panic may have left an event half applied, restores
    /// the map.
    pub(super) async fn poison(&mut self, panic: &str) {
        self.poisoned(panic);
        let Some(revision) = self.applying.take() else { return };
        if let Ok((map, events)) = stored(&*self.store, &self.shared.name).await
            && map.revision() <= revision
        {
            let events = events.iter().map(AsRef::as_ref).filter(|e| e.revision <= revision);
            let (map, _stopped) = replay(map, events);
            if map.revision() == revision {
                self.map = Arc::new(map);
            }
        }
        self.watchers.wake();
    }

    /// Poisons the map: ends streams and solves, and returns the bug that was reported.
    pub(super) fn poisoned(&mut self, details: &str) -> EngineError {
        let bug = report_bug(details);
        self.state = MapState::Poisoned;
        self.entities.update(self.map.usage());
        self.cancel_solves(&bug);
        self.streams.end_all(&bug);
        self.watchers.wake();
        bug
    }

    /// Cancels every running or waiting solve.
    pub(super) fn cancel_solves(&mut self, error: &EngineError) {
        if let Some(running) = self.running.take() {
            running.cancel.store(true, Ordering::Relaxed);
        }
        if let Some(job) = self.job.take() {
            job.answer(Err(error.clone()));
        }
        self.schedule.clear();
    }
}

/// The newest snapshot of a map, or an empty map, and the events after it.
///
/// # Errors
/// [`StoreError`].
pub(super) async fn stored(
    store: &dyn Store,
    name: &str,
) -> Result<(Map, Vec<Arc<Event>>), StoreError> {
    let snapshot = store.get_snapshot(name).await?;
    let map = snapshot.map(Arc::unwrap_or_clone).unwrap_or_default();
    let events = store.read(name, u64::try_from(map.revision()).unwrap_or(0)).await?;
    Ok((map, events))
}

/// Applies events one by one until one is refused or panics; the second value is then the reason.
pub(super) fn replay<'a>(
    mut map: Map,
    events: impl Iterator<Item = &'a Event>,
) -> (Map, Option<String>) {
    for event in events {
        // A refused event changes nothing; only a panic may leave an event half applied.
        match catch_unwind(AssertUnwindSafe(|| map.apply(event))) {
            Ok(Ok(())) => {}
            Ok(Err(error)) => return (map, Some(error.to_string())),
            Err(panic) => return (map, Some(super::pool::panic_message(panic.as_ref()))),
        }
    }
    (map, None)
}

/// Nanoseconds since 1970 by the store's clock; 0 for earlier times.
pub(super) fn unix_time_ns(store: &dyn Store) -> i64 {
    let since = store.now().duration_since(UNIX_EPOCH).unwrap_or_default();
    i64::try_from(since.as_nanos()).unwrap_or(i64::MAX)
}
