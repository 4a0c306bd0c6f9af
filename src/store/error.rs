//! What can go wrong in a store.

use super::Epoch;

/// A refused or failed call; the journal is as it was.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum StoreError {
    /// There is no such map.
    #[error("map {map:?} does not exist")]
    UnknownMap {
        /// The map.
        map: String,
    },
    /// The map is there already.
    #[error("map {map:?} exists already")]
    MapExists {
        /// The map.
        map: String,
    },
    /// A newer writer owns the map.
    #[error("map {map:?}: epoch {epoch} is fenced by epoch {newest}")]
    Fenced {
        /// The map.
        map: String,
        /// The caller's epoch.
        epoch: Epoch,
        /// The newest one.
        newest: Epoch,
    },
    /// The journal does not stand where the caller thinks, or an event is not numbered in order.
    #[error("map {map:?}: the journal needs sequence {expected}, the caller gave {actual}")]
    SequenceMismatch {
        /// The map.
        map: String,
        /// What the journal needs.
        expected: u64,
        /// What the caller gave.
        actual: u64,
    },
    /// Events were dropped behind a snapshot.
    #[error("map {map:?}: events up to sequence {through} are only in the snapshot")]
    Truncated {
        /// The map.
        map: String,
        /// The last dropped sequence.
        through: u64,
    },
    /// Events are to be dropped that no snapshot holds.
    #[error("map {map:?}: no snapshot holds the events before sequence {before}")]
    NoSnapshot {
        /// The map.
        map: String,
        /// The first sequence that would stay.
        before: u64,
    },
}
