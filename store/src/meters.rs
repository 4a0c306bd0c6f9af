//! What a store counts while it works.
//!
//! Their names on the page for Prometheus are known in `service/telemetry` alone.

use crate::meter::{Counter, Histogram};

/// Upper bounds of the number of events in a group.
const EVENTS: &[u64] = &[1, 2, 4, 8, 16, 32, 64, 128, 256, 512, 1024];

/// Instruments of a store; one set for all its maps.
#[derive(Debug)]
pub struct StoreMeters {
    /// Bytes of journals that were written and synced.
    pub journal_bytes: Counter,
    /// Events of one write and one fsync.
    pub group_events: Histogram,
    /// How long they took together, ns.
    pub sync_ns: Histogram,
    /// Journals that stopped because a write or fsync failed.
    pub journal_failures: Counter,
    /// Writes that found no space, descriptors or memory and are tried again.
    pub journal_retries: Counter,
    /// How long a snapshot took, ns: encoded, written, synced and read back.
    pub snapshot_ns: Histogram,
    /// Bytes of the snapshots that were written.
    pub snapshot_bytes: Counter,
    /// Snapshots that could not be written.
    pub snapshot_failures: Counter,
}

impl Default for StoreMeters {
    fn default() -> Self {
        Self {
            journal_bytes: Counter::default(),
            group_events: Histogram::new(EVENTS),
            sync_ns: Histogram::default(),
            journal_failures: Counter::default(),
            journal_retries: Counter::default(),
            snapshot_ns: Histogram::default(),
            snapshot_bytes: Counter::default(),
            snapshot_failures: Counter::default(),
        }
    }
}
