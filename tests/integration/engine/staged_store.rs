//! A store in memory of which a test stages some calls; all others are those of [`MemoryStore`].

use std::ops::Deref;
use std::sync::Arc;

use async_trait::async_trait;
use covis::map::{Event, Map};
use covis::store::{Damage, Durability, Epoch, Flushed, MemoryStore, Position, Store, StoreError};
use tokio::sync::watch;

/// What a test stages.
#[async_trait]
pub(super) trait Stage: Send + Sync + 'static {
    /// Before a map is created or deleted.
    async fn changing(&self) -> Result<(), StoreError> {
        Ok(())
    }

    /// Before a map is opened.
    fn opening(&self, _map: &str) -> Result<(), StoreError> {
        Ok(())
    }

    /// Before events are appended.
    fn appending(&self, _map: &str, _expected_sequence: u64) -> Result<(), StoreError> {
        Ok(())
    }

    /// What an append answers.
    fn appended(&self, position: Position) -> Position {
        position
    }

    /// How far a map's journal is durable, where the test says so.
    fn followed(&self, _map: &str) -> Option<watch::Receiver<Flushed>> {
        None
    }

    /// Before a journal is read.
    async fn reading(&self) {}

    fn durability(&self) -> Durability {
        Durability::Memory
    }
}

pub(super) struct StagedStore<S> {
    pub(super) memory: MemoryStore,
    stage: S,
}

impl<S> StagedStore<S> {
    pub(super) fn of(stage: S) -> Arc<Self> {
        Arc::new(Self { memory: MemoryStore::new(), stage })
    }
}

impl<S> Deref for StagedStore<S> {
    type Target = S;

    fn deref(&self) -> &S {
        &self.stage
    }
}

#[async_trait]
impl<S: Stage> Store for StagedStore<S> {
    async fn list_maps(&self) -> Result<Vec<String>, StoreError> {
        self.memory.list_maps().await
    }

    async fn create_map(&self, map: &str, snapshot: Option<Arc<Map>>) -> Result<Epoch, StoreError> {
        self.stage.changing().await?;
        self.memory.create_map(map, snapshot).await
    }

    async fn delete_map(&self, map: &str) -> Result<(), StoreError> {
        self.stage.changing().await?;
        self.memory.delete_map(map).await
    }

    async fn acquire(&self, map: &str) -> Result<Epoch, StoreError> {
        self.stage.opening(map)?;
        self.memory.acquire(map).await
    }

    async fn append(
        &self,
        map: &str,
        epoch: Epoch,
        expected_sequence: u64,
        batch: Vec<Arc<Event>>,
    ) -> Result<Position, StoreError> {
        self.stage.appending(map, expected_sequence)?;
        let position = self.memory.append(map, epoch, expected_sequence, batch).await?;
        Ok(self.stage.appended(position))
    }

    async fn follow(&self, map: &str) -> Result<watch::Receiver<Flushed>, StoreError> {
        match self.stage.followed(map) {
            Some(flushed) => Ok(flushed),
            None => self.memory.follow(map).await,
        }
    }

    async fn damage(&self, map: &str) -> Result<Vec<Damage>, StoreError> {
        self.memory.damage(map).await
    }

    async fn read(&self, map: &str, from: u64) -> Result<Vec<Arc<Event>>, StoreError> {
        self.stage.reading().await;
        self.memory.read(map, from).await
    }

    async fn put_snapshot(
        &self,
        map: &str,
        epoch: Epoch,
        snapshot: Arc<Map>,
    ) -> Result<(), StoreError> {
        self.memory.put_snapshot(map, epoch, snapshot).await
    }

    async fn get_snapshot(&self, map: &str) -> Result<Option<Arc<Map>>, StoreError> {
        self.memory.get_snapshot(map).await
    }

    async fn replayable_from(&self, map: &str) -> Result<Vec<u64>, StoreError> {
        self.memory.replayable_from(map).await
    }

    async fn snapshot_at(&self, map: &str, sequence: u64) -> Result<Option<Arc<Map>>, StoreError> {
        self.memory.snapshot_at(map, sequence).await
    }

    async fn truncate(&self, map: &str, epoch: Epoch, before: u64) -> Result<(), StoreError> {
        self.memory.truncate(map, epoch, before).await
    }

    async fn close(&self) {
        self.memory.close().await;
    }

    fn durability(&self) -> Durability {
        self.stage.durability()
    }
}
