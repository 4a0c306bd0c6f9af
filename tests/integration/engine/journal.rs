//! Stores that are durable, or fail: what is acknowledged is what the journal holds.

use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};

use async_trait::async_trait;
use covis::map::{Event, MapPolicy};
use covis::service::engine::{
    AckStatus, EngineConfig, EngineError, MapHandle, MapState, Maps, SolverPool,
};
use covis::store::{Durability, Epoch, MemoryStore, Position, Snapshot, Store, StoreError};

use super::Client;

/// A store in memory that claims to be durable and refuses events past `last`.
struct DiskStore {
    memory: MemoryStore,
    last: AtomicU64,
}

#[async_trait]
impl Store for DiskStore {
    async fn list_maps(&self) -> Result<Vec<String>, StoreError> {
        self.memory.list_maps().await
    }

    async fn create_map(&self, map: &str) -> Result<Epoch, StoreError> {
        self.memory.create_map(map).await
    }

    async fn delete_map(&self, map: &str) -> Result<(), StoreError> {
        self.memory.delete_map(map).await
    }

    async fn acquire(&self, map: &str) -> Result<Epoch, StoreError> {
        self.memory.acquire(map).await
    }

    async fn append(
        &self,
        map: &str,
        epoch: Epoch,
        expected_sequence: u64,
        batch: Vec<Arc<Event>>,
    ) -> Result<Position, StoreError> {
        if expected_sequence >= self.last.load(Ordering::Relaxed) {
            return Err(StoreError::UnknownMap { map: map.to_owned() });
        }
        let position = self.memory.append(map, epoch, expected_sequence, batch).await?;
        Ok(Position { durable: true, ..position })
    }

    async fn read(&self, map: &str, from: u64) -> Result<Vec<Arc<Event>>, StoreError> {
        self.memory.read(map, from).await
    }

    async fn put_snapshot(
        &self,
        map: &str,
        epoch: Epoch,
        snapshot: Snapshot,
    ) -> Result<(), StoreError> {
        self.memory.put_snapshot(map, epoch, snapshot).await
    }

    async fn get_snapshot(&self, map: &str) -> Result<Option<Snapshot>, StoreError> {
        self.memory.get_snapshot(map).await
    }

    async fn truncate(&self, map: &str, epoch: Epoch, before: u64) -> Result<(), StoreError> {
        self.memory.truncate(map, epoch, before).await
    }

    fn durability(&self) -> Durability {
        Durability::Disk
    }
}

async fn open(last: u64) -> (Arc<DiskStore>, MapHandle) {
    let store = Arc::new(DiskStore { memory: MemoryStore::new(), last: AtomicU64::new(last) });
    let shared: Arc<dyn Store> = Arc::<DiskStore>::clone(&store);
    let pool = SolverPool::new(1).unwrap();
    let maps = Maps::open(shared, pool, EngineConfig::default()).await.unwrap();
    maps.create("house", "", MapPolicy::default()).await.unwrap();
    (store, maps.get("house").unwrap())
}

#[tokio::test]
async fn a_durable_store_is_acknowledged_after_the_receipt() {
    let (_store, map) = open(u64::MAX).await;
    let mut client = Client::open(&map).await;
    client.send_street(0..3).await;
    let acks = client.finish().await;
    for sequence in 1..=4 {
        let of_item: Vec<bool> = acks
            .iter()
            .filter(|ack| ack.sequence == sequence)
            .filter_map(|ack| match ack.status {
                AckStatus::Received { .. } => Some(false),
                AckStatus::Durable => Some(true),
                AckStatus::Optimized { .. } | AckStatus::Rejected(_) => None,
            })
            .collect();
        assert_eq!(of_item, [false, true], "sequence {sequence}");
    }
}

#[tokio::test]
async fn a_failing_journal_ends_the_stream_and_changes_nothing() {
    // Room for the creation, the opening, the camera and one keyframe.
    let (store, map) = open(4).await;
    let mut client = Client::open(&map).await;
    client.send_street(0..2).await;
    assert!(matches!(client.end().await, EngineError::Store(_)));
    let info = map.info().await.unwrap();
    assert_eq!((info.snapshot.revision(), info.state), (4, MapState::Open));
    assert_eq!(info.snapshot.clients()[0].next_sequence, 3);
    // Once the journal works again, so does the map.
    store.last.store(u64::MAX, Ordering::Relaxed);
    let mut client = Client::open(&map).await;
    client.send(super::noisy_keyframe(1)).await;
    client.finish().await;
    assert_eq!(map.snapshot().await.unwrap().keyframes().len(), 2);
}
