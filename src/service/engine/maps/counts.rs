//! How many maps a server has in each state, and how full their queues are.
//!
//! It reads what engines share with their handles and asks no engine.

use std::sync::atomic::Ordering;

use crate::service::engine::context::{Condition, MapContext};

/// The maps of a server and their queues at one moment.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct MapCounts {
    /// Maps that accept changes.
    pub open: u64,
    /// Maps that are read-only by request.
    pub frozen: u64,
    /// Maps that a bug made read-only.
    pub poisoned: u64,
    /// Maps that are read-only because they lost data or cannot write.
    pub damaged: u64,
    /// Items that wait in all queues.
    pub queued: u64,
    /// Room for items in all queues.
    pub queue_capacity: u64,
    /// How full the fullest queue is, 0 to 1.
    pub fullest: f64,
}

impl MapCounts {
    /// Adds a map with how many items wait in its queue, and for how many it has room.
    pub(super) fn add(&mut self, map: &MapContext, queued: usize, capacity: usize) {
        match *map.condition() {
            Condition::Open if map.frozen.load(Ordering::Relaxed) => self.frozen += 1,
            Condition::Open => self.open += 1,
            Condition::Poisoned => self.poisoned += 1,
            Condition::Damaged(_) => self.damaged += 1,
        }
        self.queued += queued as u64;
        self.queue_capacity += capacity as u64;
        self.fullest = self.fullest.max(queued as f64 / capacity.max(1) as f64);
    }
}
