//! The one way in which a map changes: the engine checks an event, journals it, and folds it into the map. Then
//! it counts what the map holds, and wakes the watchers.

use std::panic::{AssertUnwindSafe, catch_unwind, resume_unwind};
use std::sync::Arc;

use super::{Actor, SMALL};
use crate::map::{Cause, Change, Event, Map};
use crate::service::engine::journal::unix_time_ns;
use crate::service::engine::watching::touched::{Touched, size_of_change};
use crate::service::engine::{EngineError, Fault};
use crate::store::{Position, StoreError};

/// A leaf of the map that a reader holds too is copied when it changes: so many times the work.
const COPIED: usize = 4;

impl Actor {
    /// Journals and applies one change.
    ///
    /// # Errors
    /// [`EngineError::Store`], and [`EngineError::Refused`] where the event does not fit the map or could
    /// not be read again. Nothing was changed.
    pub(crate) async fn commit(
        &mut self,
        cause: Option<Cause>,
        change: Change,
    ) -> Result<Position, EngineError> {
        let size = size_of_change(&change);
        self.handled += size;
        let copies = if Arc::strong_count(&self.map) > 1 { COPIED } else { 1 };
        let is_large = size > SMALL / copies;
        let (revision, time_ns) = (self.map.revision() + 1, unix_time_ns(&*self.shared.store));
        let event = Arc::new(Event { revision, time_ns, cause, change });
        let touched = self.check(&event, is_large).await?;
        let position = self.append(&event, is_large).await?;
        self.recognition.changed();
        self.background.changed(&self.map, &event.change);
        self.fold(event, touched, is_large).await;
        if let Some(excess) = self.shared.places.take_excess(&self.map) {
            self.pool.discard(excess);
        }
        self.ingest.count(&self.map);
        self.watching.wake();
        if position.snapshot_due {
            self.journal.keep_snapshot(&self.map);
        }
        Ok(position)
    }

    /// Whether an event fits the map, and what it touches where somebody watches. A large one is checked on
    /// another thread.
    async fn check(
        &self,
        event: &Arc<Event>,
        is_large: bool,
    ) -> Result<Option<Touched>, EngineError> {
        let (checked, is_watched) = (Arc::clone(event), self.watching.is_watched());
        let pairs = Arc::clone(&self.shared.pairs);
        let check = move |map: &Map| {
            let fits = map.fits(&checked);
            if fits.is_ok() {
                pairs.note(map, &checked.change, checked.revision);
            }
            let touched = (is_watched && fits.is_ok()).then(|| Touched::by(&checked.change, map));
            fits.map(|()| touched)
        };
        let fits = if is_large { self.compute(check).await } else { check(&self.map) };
        fits.map_err(|error| self.refuse(&event.change, event.cause.is_some(), error.to_string()))
    }

    /// Appends an event to the journal.
    async fn append(
        &mut self,
        event: &Arc<Event>,
        is_large: bool,
    ) -> Result<Position, EngineError> {
        let appended = self.journal.append(Arc::clone(event), is_large, &self.pool).await;
        appended.map_err(|error| {
            if let StoreError::NotReadable { reason, .. } = error {
                return self.refuse(&event.change, event.cause.is_some(), reason);
            }
            EngineError::Store(error)
        })
    }

    /// Folds an event that is in the journal into the map. A panic in here may leave it half applied.
    async fn fold(&mut self, event: Arc<Event>, touched: Option<Touched>, is_large: bool) {
        self.applying = Some(self.map.revision());
        if self.shared.config.injects(Fault::PanicInEngine) && event.cause.is_some() {
            std::panic::panic_any("staged by a test");
        }
        if let Some(touched) = touched {
            self.watching.tell(touched, &self.map);
        }
        if is_large {
            let mut map = std::mem::take(&mut self.map);
            let fold = move || {
                let fold = AssertUnwindSafe(|| Arc::make_mut(&mut map).fold(&event));
                (catch_unwind(fold), map)
            };
            let folded;
            (folded, self.map) = self.pool.compute(fold).await;
            folded.unwrap_or_else(|panic| resume_unwind(panic));
        } else {
            Arc::make_mut(&mut self.map).fold(&event);
        }
        self.applying = None;
    }

    /// Counts and reports an event that is not possible. Clients are checked before, so that it is a bug or a
    /// result that overflowed.
    pub(crate) fn refuse(&self, change: &Change, is_item: bool, reason: String) -> EngineError {
        self.shared.meters.refuse(change, is_item);
        let (map, change) = (self.shared.name.clone(), change.name());
        tracing::error!(map, change, reason, "an invalid change is refused");
        EngineError::Refused { map, change, reason }
    }

    /// Poisons the map after a panic. If the panic may have left an event half applied, restores
    /// the map.
    pub(super) async fn restore(&mut self, panic: &str) {
        self.poison(panic);
        let Some(revision) = self.applying.take() else { return };
        if let Some(map) = self.journal.restored(revision).await {
            self.map = Arc::new(map);
        }
        self.watching.wake();
    }
}
