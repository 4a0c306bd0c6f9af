//! Stores that are durable, or fail: what is acknowledged is what the journal holds.

use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};

use async_trait::async_trait;
use covis::map::MapPolicy;
use covis::service::engine::{
    AccountLimits, Accounts, AckStatus, EngineConfig, EngineError, MapHandle, MapState, Maps,
    Resource, SolverPool,
};
use covis::store::{Durability, Flushed, Position, Store, StoreError};
use tokio::sync::watch;

use super::Client;
use super::staged_store::{Stage, StagedStore};

/// A store that claims to be durable and refuses events past `last`. What it accepts is durable at once,
/// or when `flushed` says so.
struct Durable {
    last: AtomicU64,
    flushed: Option<watch::Sender<Flushed>>,
}

#[async_trait]
impl Stage for Durable {
    fn appending(&self, map: &str, expected_sequence: u64) -> Result<(), StoreError> {
        if expected_sequence >= self.last.load(Ordering::Relaxed) {
            return Err(StoreError::UnknownMap { map: map.to_owned() });
        }
        Ok(())
    }

    fn appended(&self, position: Position) -> Position {
        let waiting_bytes = if self.flushed.is_some() { 1000 } else { 0 };
        Position { durable: self.flushed.is_none(), waiting_bytes, ..position }
    }

    fn followed(&self, _map: &str) -> Option<watch::Receiver<Flushed>> {
        self.flushed.as_ref().map(watch::Sender::subscribe)
    }

    fn durability(&self) -> Durability {
        Durability::Disk
    }
}

type DiskStore = StagedStore<Durable>;

async fn open(last: u64) -> (Arc<DiskStore>, MapHandle) {
    open_store(last, None).await
}

async fn open_store(
    last: u64,
    flushed: Option<watch::Sender<Flushed>>,
) -> (Arc<DiskStore>, MapHandle) {
    let last = AtomicU64::new(last);
    let store = StagedStore::of(Durable { last, flushed });
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

#[tokio::test]
async fn durable_is_sent_when_the_journal_is_durable_and_a_failure_ends_it() {
    // The creation is on disk.
    let flushed = watch::Sender::new(Flushed { through: 1, ..Flushed::default() });
    let (store, map) = open_store(u64::MAX, Some(flushed)).await;
    let flushed = store.flushed.as_ref().unwrap();
    let mut client = Client::open(&map).await;
    client.send(crate::map_support::camera_item(0)).await;
    client.send(crate::map_support::camera_item(1)).await;
    for sequence in [1, 2] {
        let ack = client.ack().await;
        assert_eq!(ack.sequence, sequence);
        assert!(matches!(ack.status, AckStatus::Received { duplicate: false }), "{ack:?}");
    }
    // The opening and both items, at once: one ack covers both.
    flushed.send_replace(Flushed { through: 4, ..Flushed::default() });
    let ack = client.ack().await;
    assert!(ack.sequence == 2 && matches!(ack.status, AckStatus::Durable), "{ack:?}");
    // A watcher is told what is durable.
    assert_eq!(map.watch(None).await.unwrap().next().await.unwrap().revision, 4);
    client.send(crate::map_support::camera_item(2)).await;
    assert_eq!(client.ack().await.sequence, 3);
    let mut watch = map.watch(None).await.unwrap();
    let (name, cause) = ("house".to_owned(), "staged by a test".to_owned());
    let stopped = StoreError::Stopped { map: name, durable: 4, cause };
    flushed.send_replace(Flushed {
        through: 4,
        failed: Some(stopped.clone()),
        ..Flushed::default()
    });
    let stopped = EngineError::Store(stopped);
    assert_eq!(watch.next().await.unwrap_err(), stopped);
    assert_eq!(client.end().await, stopped);
    let acks = client.seen.iter().filter(|ack| matches!(ack.status, AckStatus::Durable));
    assert!(acks.count() <= 1, "{:?}", client.seen);
    assert_eq!(map.info().await.unwrap().state, MapState::Poisoned);
    assert_eq!(map.open_stream("robot".to_owned(), 0, false).await.unwrap_err(), stopped);
}

#[tokio::test]
async fn journals_that_wait_for_the_disk_have_a_limit_and_the_map_goes_on_behind_it() {
    let flushed = watch::Sender::new(Flushed { through: 1, ..Flushed::default() });
    let last = AtomicU64::new(u64::MAX);
    let store = StagedStore::of(Durable { last, flushed: Some(flushed.clone()) });
    let server = AccountLimits::default().with(Resource::JournalBytes, 1000);
    let accounts = Accounts::new(server, AccountLimits::default(), AccountLimits::default());
    let pool = SolverPool::shared_by(accounts, 1).unwrap();
    let maps = Maps::open(store, pool, EngineConfig::default()).await.unwrap();
    maps.create("house", "", MapPolicy::default()).await.unwrap();
    let map = maps.get("house").unwrap();
    // The opening waits for the disk already.
    let mut client = Client::open(&map).await;
    client.send(crate::map_support::camera_item(0)).await;
    let full = EngineError::ServerLimit { limit: "max_journal_bytes", maximum: 1000 };
    assert_eq!(client.end().await, full);
    flushed.send_replace(Flushed { through: 2, ..Flushed::default() });
    while map.account().held(Resource::JournalBytes) > 0 {
        tokio::task::yield_now().await;
    }
    let mut client = Client::open(&map).await;
    flushed.send_replace(Flushed { through: 3, ..Flushed::default() });
    while map.account().held(Resource::JournalBytes) > 0 {
        tokio::task::yield_now().await;
    }
    let sequence = client.send(crate::map_support::camera_item(0)).await;
    client.received(sequence).await;
}
