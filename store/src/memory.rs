//! The store in memory: every rule of [`Store`], nothing durable.
//!
//! One lock guards all maps and is never held across an await. Each call changes the state in one step,
//! so that a panic leaves no half of one.

use std::collections::BTreeMap;
use std::sync::Arc;

use async_trait::async_trait;
use tokio::sync::watch;

use super::encoding::encode_readable;
use super::{
    Damage, Durability, Epoch, Flushed, Position, Store, StoreError, sequence_of, whole_behind,
};
use crate::sync::Mutex;
use covis_map::{Event, Map};

/// A store that a restart empties.
#[derive(Debug, Default)]
pub struct MemoryStore {
    maps: Mutex<BTreeMap<String, Journal>>,
    /// Epochs rise over the store's whole life, so that one of a deleted map fits no later map.
    last_epoch: Mutex<u64>,
}

#[derive(Debug)]
struct Journal {
    epoch: Epoch,
    /// The event at index i has sequence `dropped + i + 1`.
    events: Vec<Arc<Event>>,
    dropped: u64,
    snapshot: Option<Arc<Map>>,
}

impl Journal {
    fn last_sequence(&self) -> u64 {
        self.dropped + self.events.len() as u64
    }

    fn check_epoch(&self, map: &str, epoch: Epoch) -> Result<(), StoreError> {
        if epoch == self.epoch {
            Ok(())
        } else {
            Err(StoreError::Fenced { map: map.to_owned(), epoch, newest: self.epoch })
        }
    }
}

impl MemoryStore {
    /// A store without maps.
    #[must_use]
    pub fn new() -> Self {
        Self::default()
    }

    fn next_epoch(&self) -> Epoch {
        let mut last = self.last_epoch.lock();
        *last += 1;
        Epoch(*last)
    }

    fn with<R>(
        &self,
        map: &str,
        action: impl FnOnce(&mut Journal) -> Result<R, StoreError>,
    ) -> Result<R, StoreError> {
        match self.maps.lock().get_mut(map) {
            Some(journal) => action(journal),
            None => Err(StoreError::UnknownMap { map: map.to_owned() }),
        }
    }
}

#[async_trait]
impl Store for MemoryStore {
    async fn list_maps(&self) -> Result<Vec<String>, StoreError> {
        Ok(self.maps.lock().keys().cloned().collect())
    }

    async fn create_map(&self, map: &str, snapshot: Option<Arc<Map>>) -> Result<Epoch, StoreError> {
        let epoch = self.next_epoch();
        let mut maps = self.maps.lock();
        if maps.contains_key(map) {
            return Err(StoreError::MapExists { map: map.to_owned() });
        }
        let dropped = snapshot.as_ref().map_or(0, |map| sequence_of(map.revision()));
        let journal = Journal { epoch, events: Vec::new(), dropped, snapshot };
        maps.insert(map.to_owned(), journal);
        Ok(epoch)
    }

    async fn delete_map(&self, map: &str) -> Result<(), StoreError> {
        match self.maps.lock().remove(map) {
            Some(_) => Ok(()),
            None => Err(StoreError::UnknownMap { map: map.to_owned() }),
        }
    }

    async fn acquire(&self, map: &str) -> Result<Epoch, StoreError> {
        let epoch = self.next_epoch();
        self.with(map, |journal| {
            // Two calls may meet here in either order; the newer epoch wins.
            journal.epoch = journal.epoch.max(epoch);
            Ok(epoch)
        })
    }

    async fn append(
        &self,
        map: &str,
        epoch: Epoch,
        expected_sequence: u64,
        batch: Vec<Arc<Event>>,
    ) -> Result<Position, StoreError> {
        self.with(map, |journal| {
            journal.check_epoch(map, epoch)?;
            let last = journal.last_sequence();
            let mismatch = |expected, actual| {
                Err(StoreError::SequenceMismatch { map: map.to_owned(), expected, actual })
            };
            if expected_sequence != last {
                return mismatch(last, expected_sequence);
            }
            for (expected, event) in (last + 1..).zip(&batch) {
                let actual = sequence_of(event.revision);
                if actual != expected {
                    return mismatch(expected, actual);
                }
            }
            // What is in memory is read from there; tests find what could not be read from a disk.
            if cfg!(debug_assertions) {
                for event in &batch {
                    encode_readable(event, &mut Vec::new())
                        .map_err(|error| error.not_readable(map, event))?;
                }
            }
            journal.events.extend(batch);
            let sequence = journal.last_sequence();
            Ok(Position { sequence, durable: false, snapshot_due: false, waiting_bytes: 0 })
        })
    }

    async fn follow(&self, map: &str) -> Result<watch::Receiver<Flushed>, StoreError> {
        self.with(map, |_journal| Ok(watch::channel(Flushed::default()).1))
    }

    async fn read(&self, map: &str, from: u64) -> Result<Vec<Arc<Event>>, StoreError> {
        self.with(map, |journal| {
            let through = journal.dropped;
            let Some(skip) = from.checked_sub(through) else {
                return Err(StoreError::Truncated { map: map.to_owned(), through });
            };
            let skip = usize::try_from(skip).unwrap_or(usize::MAX);
            Ok(journal.events.iter().skip(skip).cloned().collect())
        })
    }

    async fn put_snapshot(
        &self,
        map: &str,
        epoch: Epoch,
        snapshot: Arc<Map>,
    ) -> Result<(), StoreError> {
        self.with(map, |journal| {
            journal.check_epoch(map, epoch)?;
            let last = journal.last_sequence();
            let sequence = sequence_of(snapshot.revision());
            if sequence > last {
                return Err(StoreError::SequenceMismatch {
                    map: map.to_owned(),
                    expected: last,
                    actual: sequence,
                });
            }
            if journal.snapshot.as_ref().is_none_or(|s| s.revision() <= snapshot.revision()) {
                journal.snapshot = Some(snapshot);
            }
            Ok(())
        })
    }

    async fn get_snapshot(&self, map: &str) -> Result<Option<Arc<Map>>, StoreError> {
        self.with(map, |journal| Ok(journal.snapshot.clone()))
    }

    async fn replayable_from(&self, map: &str) -> Result<Vec<u64>, StoreError> {
        self.with(map, |journal| {
            let snapshot = journal.snapshot.as_ref().map(|map| sequence_of(map.revision()));
            Ok(whole_behind(journal.dropped, snapshot.into_iter()))
        })
    }

    async fn snapshot_at(&self, map: &str, sequence: u64) -> Result<Option<Arc<Map>>, StoreError> {
        let is_at = |map: &Arc<Map>| sequence_of(map.revision()) == sequence;
        self.with(map, |journal| Ok(journal.snapshot.clone().filter(is_at)))
    }

    async fn damage(&self, map: &str) -> Result<Vec<Damage>, StoreError> {
        self.with(map, |_journal| Ok(Vec::new()))
    }

    async fn truncate(&self, map: &str, epoch: Epoch, before: u64) -> Result<(), StoreError> {
        self.with(map, |journal| {
            journal.check_epoch(map, epoch)?;
            let through = before.saturating_sub(1);
            if through <= journal.dropped {
                return Ok(());
            }
            if journal.snapshot.as_ref().is_none_or(|s| sequence_of(s.revision()) < through) {
                return Err(StoreError::NoSnapshot { map: map.to_owned(), before });
            }
            let count = usize::try_from(through - journal.dropped).unwrap_or(usize::MAX);
            let count = count.min(journal.events.len());
            journal.events.drain(..count);
            journal.dropped += count as u64;
            Ok(())
        })
    }

    async fn close(&self) {}

    fn durability(&self) -> Durability {
        Durability::Memory
    }
}
