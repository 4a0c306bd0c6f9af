//! What an engine still does by itself, for readers that wait until their map is settled.
//!
//! A map is settled when no item waits for a solve, no place is to be searched, and nothing that follows
//! loop closures is due or runs. Some of this changes without an event: watchers are woken when the map
//! settles.

use crate::service::engine::PendingWork;
use crate::service::engine::actor::Actor;

impl Actor {
    /// What the engine still does by itself. The work of a map that takes no changes waits.
    pub(crate) fn pending_work(&self) -> PendingWork {
        // They become triggers when the engine may solve.
        let restored = match self.has_pending_solves {
            true => self.map.pending_solves().len(),
            false => 0,
        };
        PendingWork {
            unoptimized_items: restored + self.solving.schedule.item_count(),
            place_searches: self.recognition.pending(&self.map),
            closure_adjustment: self.background.is_pending(&self.map),
            optimization: self.solving.has_job(),
        }
    }

    /// Wakes the watchers when the map has settled.
    pub(crate) fn note_settled(&mut self) {
        let is_settled = self.solving.is_idle()
            && self.recognition.pending(&self.map) == 0
            && self.pending_work().is_settled();
        if is_settled && !self.is_settled {
            self.watching.wake();
        }
        self.is_settled = is_settled;
    }
}
