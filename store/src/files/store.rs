//! What every store does, for the maps of a directory: each call finds its map's journal and has blocking
//! work done where the disk runs it. Creating and deleting maps is the work of `changes`.

use std::sync::Arc;
use std::time::SystemTime;

use async_trait::async_trait;
use tokio::sync::watch;

use super::failure::{file_error, of_map};
use super::journal::Journal;
use super::read::ReadEvents;
use super::{Entry, FileStore, Inner, blocking, read};
use crate::{
    Damage, Durability, Epoch, EventReader, Flushed, Position, Store, StoreError, sequence_of,
    whole_behind,
};
use covis_map::{Event, Map};

#[async_trait]
impl Store for FileStore {
    fn now(&self) -> SystemTime {
        self.inner.disk.now()
    }

    async fn list_maps(&self) -> Result<Vec<String>, StoreError> {
        let maps = self.inner.maps.lock();
        let is_map = |entry: &Entry| matches!(entry, Entry::Map(_) | Entry::Refused(_));
        Ok(maps.iter().filter(|(_, entry)| is_map(entry)).map(|(name, _)| name.clone()).collect())
    }

    async fn create_map(&self, map: &str, snapshot: Option<Arc<Map>>) -> Result<Epoch, StoreError> {
        self.create(map, None, snapshot).await
    }

    async fn delete_map(&self, map: &str) -> Result<(), StoreError> {
        self.delete(map).await
    }

    async fn acquire(&self, map: &str) -> Result<Epoch, StoreError> {
        let journal = self.journal(map).await?;
        let epoch = self.inner.next_epoch();
        let mut state = journal.state();
        // Two calls may arrive here in either order; the newer epoch wins.
        state.epoch = state.epoch.max(epoch);
        Ok(epoch)
    }

    async fn append(
        &self,
        map: &str,
        epoch: Epoch,
        expected_sequence: u64,
        batch: Vec<Arc<Event>>,
    ) -> Result<Position, StoreError> {
        let journal = self.journal(map).await?;
        journal.wait_for_room().await;
        let accepted = journal.accept(epoch, expected_sequence, batch);
        let (position, starts) = accepted.map_err(|error| of_map(map, error))?;
        if starts {
            Journal::start_flush(journal, None);
        }
        Ok(position)
    }

    async fn follow(&self, map: &str) -> Result<watch::Receiver<Flushed>, StoreError> {
        Ok(self.journal(map).await?.follow())
    }

    async fn read(&self, map: &str, from: u64) -> Result<Vec<Arc<Event>>, StoreError> {
        let journal = self.journal(map).await?;
        let (dropped, last) = {
            let state = journal.state();
            (state.dropped, state.last)
        };
        if from < dropped {
            return Err(StoreError::Truncated { map: map.to_owned(), through: dropped });
        }
        if let Some(piece) = journal.recent_piece(from, u64::MAX, usize::MAX) {
            return Ok(piece.events);
        }
        // The events of a stopped journal can still be read.
        let _stopped = journal.wait_durable().await;
        let reading = Arc::clone(&journal);
        let events = blocking(&*self.inner.disk, move || read::events(&reading, from, last));
        let ReadEvents { events, unreadable } = events.await.map_err(|error| of_map(map, error))?;
        if let Some(damage) = unreadable {
            journal.lose(damage);
        }
        // If the journal waits for a resource, events that are not written yet would be missing.
        match journal.state().unavailable() {
            Some(error) if from.saturating_add(events.len() as u64) < last => Err(error.clone()),
            Some(_) | None => Ok(events),
        }
    }

    async fn reader(
        &self,
        map: &str,
        from: u64,
        through: u64,
    ) -> Result<Box<dyn EventReader>, StoreError> {
        Ok(Box::new(read::Reader::new(self.journal(map).await?, from, through)))
    }

    async fn put_snapshot(
        &self,
        map: &str,
        epoch: Epoch,
        snapshot: Arc<Map>,
    ) -> Result<(), StoreError> {
        let journal = self.journal(map).await?;
        let sequence = sequence_of(snapshot.revision());
        let exclusive = Arc::clone(&journal.exclusive).lock_owned().await;
        {
            let state = journal.state();
            journal.check_epoch(&state, epoch)?;
            if sequence > state.last {
                let (map, expected) = (map.to_owned(), state.last);
                return Err(StoreError::SequenceMismatch { map, expected, actual: sequence });
            }
            if state.snapshots.last().is_some_and(|&newest| newest >= sequence) {
                return Ok(());
            }
        }
        // A snapshot must not contain events that a crash could still remove from the journal.
        journal.wait_durable().await?;
        let written = blocking(&*self.inner.disk, move || {
            let _exclusive = exclusive;
            read::put_snapshot(&journal, &snapshot)
        });
        written.await.map_err(|error| of_map(map, error))
    }

    async fn get_snapshot(&self, map: &str) -> Result<Option<Arc<Map>>, StoreError> {
        let journal = self.journal(map).await?;
        let newest = blocking(&*self.inner.disk, move || read::newest_snapshot(&journal));
        newest.await.map_err(|error| of_map(map, error))
    }

    async fn replayable_from(&self, map: &str) -> Result<Vec<u64>, StoreError> {
        let journal = self.journal(map).await?;
        let state = journal.state();
        Ok(whole_behind(state.dropped, state.snapshots.iter().copied()))
    }

    async fn snapshot_at(&self, map: &str, sequence: u64) -> Result<Option<Arc<Map>>, StoreError> {
        let journal = self.journal(map).await?;
        let found = blocking(&*self.inner.disk, move || read::snapshot_at(&journal, sequence));
        found.await.map_err(|error| of_map(map, error))
    }

    async fn damage(&self, map: &str) -> Result<Vec<Damage>, StoreError> {
        Ok(self.journal(map).await?.state().damage.clone())
    }

    async fn truncate(&self, map: &str, epoch: Epoch, before: u64) -> Result<(), StoreError> {
        let journal = self.journal(map).await?;
        let through = before.saturating_sub(1);
        {
            let mut state = journal.state();
            journal.check_epoch(&state, epoch)?;
            if through <= state.dropped {
                return Ok(());
            }
            if state.snapshots.last().is_none_or(|&newest| newest < through) {
                return Err(StoreError::NoSnapshot { map: map.to_owned(), before });
            }
            state.dropped = through.min(state.last);
        }
        let dropped = blocking(&*self.inner.disk, move || {
            let dropped = journal.drop_before(before);
            dropped.map_err(|error| file_error("cannot drop files of", &journal.folder, &error))
        });
        dropped.await.map_err(|error| of_map(map, error))
    }

    async fn close(&self) {
        // Runs to its end, even if the caller stops waiting.
        let closed = tokio::spawn(close(Arc::clone(&self.inner))).await;
        if let Err(error) = closed {
            tracing::warn!(%error, "the store was not closed");
        }
    }

    fn durability(&self) -> Durability {
        Durability::Disk
    }
}

/// Closes every journal, and releases the directory.
async fn close(inner: Arc<Inner>) {
    // Nothing is being created or deleted from here on.
    let _changing = Arc::clone(&inner.changing).lock_owned().await;
    let maps: Vec<Arc<Journal>> = {
        let maps = inner.maps.lock();
        maps.values()
            .filter_map(|entry| match entry {
                Entry::Map(journal) | Entry::Unclaimed(journal) => Some(Arc::clone(journal)),
                Entry::Leftover(_) | Entry::Refused(_) => None,
            })
            .collect()
    };
    for journal in maps {
        // No snapshot is being written from here on.
        let _exclusive = Arc::clone(&journal.exclusive).lock_owned().await;
        // A journal that failed has already reported it.
        let _failed = journal.wait_durable().await;
        let closing = Arc::clone(&journal);
        let closed = blocking(&*inner.disk, move || {
            closing.close();
            Ok(())
        });
        if let Err(error) = closed.await {
            tracing::warn!(map = journal.name, %error, "a journal was not closed");
        }
    }
    *inner.lock.lock() = None;
}
