//! The journal of every map: events in order, snapshots, and epochs that fence stale writers.
//!
//! A writer acquires a map and gets an [`Epoch`]; from then on writes of earlier epochs are refused.
//! Event number n of a map has sequence n, which is its revision; an append says how far the writer
//! believes the journal to be, so that two writers can never interleave. No type of a particular
//! database shows through.

use std::fmt;
use std::sync::Arc;

use async_trait::async_trait;

use crate::map::Event;

mod error;
mod memory;

pub use error::StoreError;
pub use memory::MemoryStore;

/// Counts the writers that a map has had; a newer one fences the older ones.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct Epoch(pub u64);

impl fmt::Display for Epoch {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.0.fmt(f)
    }
}

/// What the store withstands.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Durability {
    /// Nothing: a restart loses it.
    Memory,
    /// Loss of power, once an append has returned a durable position.
    Disk,
}

/// How far a journal reaches after an append.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Position {
    /// The sequence of the last event.
    pub sequence: u64,
    /// Whether the events survive what [`Durability`] promises.
    pub durable: bool,
}

/// A map's state at one sequence, in the caller's encoding.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Snapshot {
    /// The last event that it holds.
    pub sequence: u64,
    /// Opaque to the store.
    pub data: Arc<[u8]>,
}

/// Keeps the journals and snapshots of many maps.
#[async_trait]
pub trait Store: Send + Sync + 'static {
    /// The names of the maps, sorted.
    ///
    /// # Errors
    /// [`StoreError`] when the store cannot be read.
    async fn list_maps(&self) -> Result<Vec<String>, StoreError>;

    /// Creates a map with an empty journal and acquires it.
    ///
    /// # Errors
    /// [`StoreError::MapExists`].
    async fn create_map(&self, map: &str) -> Result<Epoch, StoreError>;

    /// Deletes a map with its journal and snapshot.
    ///
    /// # Errors
    /// [`StoreError::UnknownMap`].
    async fn delete_map(&self, map: &str) -> Result<(), StoreError>;

    /// Makes the caller the map's writer: appends of every earlier epoch fail from now on.
    ///
    /// # Errors
    /// [`StoreError::UnknownMap`].
    async fn acquire(&self, map: &str) -> Result<Epoch, StoreError>;

    /// Appends events behind `expected_sequence`, the sequence of the journal's last event (0 for an
    /// empty journal): all of them or none.
    ///
    /// # Errors
    /// [`StoreError::UnknownMap`], [`StoreError::Fenced`] after a newer writer acquired the map,
    /// [`StoreError::SequenceMismatch`] when the journal does not end at `expected_sequence` or an
    /// event's revision is not its sequence.
    async fn append(
        &self,
        map: &str,
        epoch: Epoch,
        expected_sequence: u64,
        batch: Vec<Arc<Event>>,
    ) -> Result<Position, StoreError>;

    /// The events with sequence greater than `from`; 0 reads from the first.
    ///
    /// # Errors
    /// [`StoreError::UnknownMap`], [`StoreError::Truncated`] when some of them are gone.
    async fn read(&self, map: &str, from: u64) -> Result<Vec<Arc<Event>>, StoreError>;

    /// Keeps a snapshot, unless a later one is kept already.
    ///
    /// # Errors
    /// [`StoreError::UnknownMap`], [`StoreError::Fenced`], and [`StoreError::SequenceMismatch`] when
    /// the snapshot is past the journal's end.
    async fn put_snapshot(
        &self,
        map: &str,
        epoch: Epoch,
        snapshot: Snapshot,
    ) -> Result<(), StoreError>;

    /// The latest snapshot.
    ///
    /// # Errors
    /// [`StoreError::UnknownMap`].
    async fn get_snapshot(&self, map: &str) -> Result<Option<Snapshot>, StoreError>;

    /// Drops the events with sequence below `before`, which a snapshot must hold.
    ///
    /// # Errors
    /// [`StoreError::UnknownMap`], [`StoreError::Fenced`], and [`StoreError::NoSnapshot`] when no
    /// snapshot holds the last of them.
    async fn truncate(&self, map: &str, epoch: Epoch, before: u64) -> Result<(), StoreError>;

    /// What the store withstands.
    fn durability(&self) -> Durability;
}

#[cfg(test)]
mod tests;
