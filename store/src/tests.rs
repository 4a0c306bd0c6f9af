//! The rules of the store, held against the one in memory.

use std::sync::Arc;

use super::{Durability, Epoch, MemoryStore, Position, Store, StoreError};
use covis_map::{Change, Event, Map, MapParts, MapPolicy};

fn event(revision: i64) -> Arc<Event> {
    let change =
        Change::MapUpdated { display_name: None, policy: Some(MapPolicy::default()), frozen: None };
    Arc::new(Event { revision, time_ns: 0, cause: None, change })
}

fn snapshot(revision: i64) -> Arc<Map> {
    Arc::new(Map::from_parts(MapParts { revision, ..MapParts::default() }).unwrap())
}

fn events(revisions: std::ops::RangeInclusive<i64>) -> Vec<Arc<Event>> {
    revisions.map(event).collect()
}

fn sequences(events: &[Arc<Event>]) -> Vec<i64> {
    events.iter().map(|e| e.revision).collect()
}

#[tokio::test]
async fn a_journal_keeps_its_order_and_refuses_gaps() {
    let store = MemoryStore::new();
    let epoch = store.create_map("a", None).await.unwrap();
    let position = store.append("a", epoch, 0, events(1..=3)).await.unwrap();
    let (durable, snapshot_due) = (false, false);
    assert_eq!(position, Position { sequence: 3, durable, snapshot_due, waiting_bytes: 0 });
    assert!(store.follow("a").await.unwrap().changed().await.is_err(), "nothing ever is durable");
    assert_eq!(store.durability(), Durability::Memory);
    let mismatch = |expected, actual| {
        Err(StoreError::SequenceMismatch { map: "a".to_owned(), expected, actual })
    };
    assert_eq!(store.append("a", epoch, 2, events(3..=4)).await, mismatch(3, 2));
    assert_eq!(store.append("a", epoch, 3, events(5..=6)).await, mismatch(4, 5));
    let torn = vec![event(4), event(6)];
    assert_eq!(store.append("a", epoch, 3, torn).await, mismatch(5, 6));
    store.append("a", epoch, 3, events(4..=5)).await.unwrap();
    assert_eq!(sequences(&store.read("a", 0).await.unwrap()), [1, 2, 3, 4, 5]);
    assert_eq!(sequences(&store.read("a", 3).await.unwrap()), [4, 5]);
    assert!(store.read("a", 9).await.unwrap().is_empty());
}

#[tokio::test]
async fn a_newer_writer_fences_the_older_one() {
    let store = MemoryStore::new();
    let first = store.create_map("a", None).await.unwrap();
    let second = store.acquire("a").await.unwrap();
    assert!(second > first);
    let fenced = StoreError::Fenced { map: "a".to_owned(), epoch: first, newest: second };
    assert_eq!(store.append("a", first, 0, events(1..=1)).await, Err(fenced.clone()));
    assert_eq!(store.truncate("a", first, 1).await, Err(fenced.clone()));
    assert_eq!(store.put_snapshot("a", first, snapshot(0)).await, Err(fenced));
    store.append("a", second, 0, events(1..=1)).await.unwrap();
    // A map made anew under the old name does not know the old writer.
    store.delete_map("a").await.unwrap();
    store.create_map("a", None).await.unwrap();
    assert!(store.append("a", second, 0, events(1..=1)).await.is_err());
}

#[tokio::test]
async fn maps_are_created_listed_and_deleted() {
    let store = MemoryStore::new();
    store.create_map("b", None).await.unwrap();
    store.create_map("a", None).await.unwrap();
    assert_eq!(store.list_maps().await.unwrap(), ["a", "b"]);
    assert_eq!(
        store.create_map("a", None).await,
        Err(StoreError::MapExists { map: "a".to_owned() })
    );
    store.delete_map("b").await.unwrap();
    let unknown = StoreError::UnknownMap { map: "b".to_owned() };
    assert_eq!(store.delete_map("b").await, Err(unknown.clone()));
    assert_eq!(store.acquire("b").await, Err(unknown.clone()));
    assert_eq!(store.read("b", 0).await, Err(unknown.clone()));
    assert_eq!(store.append("b", Epoch(1), 0, Vec::new()).await, Err(unknown.clone()));
    assert_eq!(store.get_snapshot("b").await, Err(unknown));
}

#[tokio::test]
async fn events_are_dropped_only_behind_a_snapshot() {
    let store = MemoryStore::new();
    let epoch = store.create_map("a", None).await.unwrap();
    store.append("a", epoch, 0, events(1..=6)).await.unwrap();
    let map = "a".to_owned();
    let refused = store.truncate("a", epoch, 5).await;
    assert_eq!(refused, Err(StoreError::NoSnapshot { map: map.clone(), before: 5 }));
    let past = store.put_snapshot("a", epoch, snapshot(7)).await;
    assert!(matches!(past, Err(StoreError::SequenceMismatch { expected: 6, actual: 7, .. })));
    store.put_snapshot("a", epoch, snapshot(4)).await.unwrap();
    store.put_snapshot("a", epoch, snapshot(2)).await.unwrap();
    assert_eq!(store.get_snapshot("a").await.unwrap(), Some(snapshot(4)));
    store.truncate("a", epoch, 5).await.unwrap();
    assert_eq!(sequences(&store.read("a", 4).await.unwrap()), [5, 6]);
    assert_eq!(store.read("a", 3).await, Err(StoreError::Truncated { map, through: 4 }));
    store.append("a", epoch, 6, events(7..=7)).await.unwrap();
    assert_eq!(sequences(&store.read("a", 5).await.unwrap()), [6, 7]);
}

#[tokio::test]
async fn later_states_are_replayed_from_the_beginning_and_from_what_is_kept_behind_it() {
    let store = MemoryStore::new();
    let epoch = store.create_map("a", None).await.unwrap();
    store.append("a", epoch, 0, events(1..=5)).await.unwrap();
    assert_eq!(store.replayable_from("a").await.unwrap(), [0]);
    assert_eq!(store.snapshot_at("a", 3).await.unwrap(), None);
    store.put_snapshot("a", epoch, snapshot(3)).await.unwrap();
    assert_eq!(store.replayable_from("a").await.unwrap(), [0, 3]);
    store.truncate("a", epoch, 4).await.unwrap();
    assert_eq!(store.replayable_from("a").await.unwrap(), [3]);
    assert_eq!(store.snapshot_at("a", 3).await.unwrap().unwrap().revision(), 3);
    assert_eq!(store.snapshot_at("a", 4).await.unwrap(), None);
    let unknown = StoreError::UnknownMap { map: "b".to_owned() };
    assert_eq!(store.replayable_from("b").await, Err(unknown));
}
