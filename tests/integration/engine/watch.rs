//! Watching: steps without gaps, joined for a slow reader, from any revision.

use std::collections::{BTreeMap, BTreeSet};
use std::sync::Arc;

use async_trait::async_trait;
use covis::map::{ClientIndex, EntityId, Item, ItemLandmark, Map, MapPolicy};
use covis::service::engine::{EngineConfig, EngineError, MapChange, MapHandle, Maps, SolverPool};
use covis::store::Store;
use covis_solvers::geometry::Se3;
use futures_util::FutureExt;
use nalgebra::Vector3;

use super::staged_store::{Stage, StagedStore};
use super::{Client, Fixture, noisy_keyframe};
use crate::map_support::id;

#[tokio::test]
async fn steps_have_no_gap_and_join_for_a_slow_reader() {
    let fixture = Fixture::lock_step().await;
    let map = fixture.map(MapPolicy::default()).await;
    let mut watch = map.watch(None).await.unwrap();
    let whole = watch.next().await.unwrap();
    assert!(whole.reset);
    let mut client = Client::open(&map).await;
    client.send_street(0..4).await;
    client.received(5).await;
    let first = watch.next().await.unwrap();
    assert!(!first.reset && first.base_revision == whole.revision);
    assert_eq!(first.revision, first.snapshot.revision());
    assert!(first.revision > first.base_revision + 4, "{first:?}");
    assert!(first.touched.keyframes.contains(&id(0)) && first.touched.cameras.contains(&id(0)));
    assert_eq!(first.touched.clients.len(), 1);
    client.send(noisy_keyframe(4)).await;
    client.finish().await;
    let second = watch.next().await.unwrap();
    assert_eq!(second.base_revision, first.revision);
    assert!(second.touched.keyframes.contains(&id(4)));
    // Nothing more comes, and asking in vain loses nothing.
    assert!(watch.next().now_or_never().is_none());
}

#[tokio::test]
async fn a_watcher_goes_on_from_the_revision_that_it_holds() {
    let fixture = Fixture::lock_step().await;
    let map = fixture.map(MapPolicy::default()).await;
    let mut client = Client::open(&map).await;
    client.send_street(0..2).await;
    let revision = client.received(3).await.revision;
    client.finish().await;
    let newest = map.snapshot().await.unwrap().revision();
    assert!(newest > revision);
    let mut watch = map.watch(Some(revision)).await.unwrap();
    let step = watch.next().await.unwrap();
    assert_eq!((step.reset, step.base_revision, step.revision), (false, revision, newest));
    // The solve moved the second keyframe; the camera was there before.
    assert!(step.touched.keyframes.contains(&id(1)) && step.touched.cameras.is_empty());
    let mut current = map.watch(Some(newest)).await.unwrap();
    assert!(current.next().now_or_never().is_none());
    let ahead = map.watch(Some(newest + 1)).await.unwrap_err();
    let expected =
        EngineError::RevisionAhead { map: "house".to_owned(), revision: newest + 1, newest };
    assert_eq!(ahead, expected);
}

/// A store whose journal cannot be read while the test holds it.
#[derive(Default)]
struct HeldReads {
    /// Readers wait while this is true.
    held: tokio::sync::watch::Sender<bool>,
    /// Readers that wait.
    waiting: tokio::sync::watch::Sender<usize>,
}

#[async_trait]
impl Stage for HeldReads {
    async fn reading(&self) {
        self.waiting.send_modify(|count| *count += 1);
        self.held.subscribe().wait_for(|held| !held).await.unwrap();
        self.waiting.send_modify(|count| *count -= 1);
    }
}

type HeldStore = StagedStore<HeldReads>;

async fn maps_on(store: &Arc<HeldStore>) -> (Maps, MapHandle) {
    let store: Arc<dyn Store> = Arc::<HeldStore>::clone(store);
    let config = EngineConfig { lock_step: true, ..EngineConfig::default() };
    let maps = Maps::open(store, SolverPool::new(1).unwrap(), config).await.unwrap();
    maps.create("house", "A house", MapPolicy::default()).await.unwrap();
    let map = maps.get("house").unwrap();
    (maps, map)
}

/// What a reader holds: poses and positions by id.
#[derive(Debug, Default, PartialEq)]
struct Held {
    cameras: BTreeSet<EntityId>,
    poses: BTreeMap<EntityId, Se3>,
    positions: BTreeMap<EntityId, Option<Vector3<f64>>>,
    clients: BTreeSet<ClientIndex>,
}

impl Held {
    fn all(map: &Map) -> Self {
        Self {
            cameras: map.cameras().keys().copied().collect(),
            poses: map.keyframes().iter().map(|(&id, k)| (id, k.world_from_camera)).collect(),
            positions: map.landmarks().iter().map(|(&id, l)| (id, l.position)).collect(),
            clients: (0u32..).zip(map.clients()).map(|(index, _)| ClientIndex(index)).collect(),
        }
    }

    fn take(&mut self, change: &MapChange) {
        let map = &change.snapshot;
        if change.reset {
            *self = Self::all(map);
            return;
        }
        self.cameras.extend(&change.touched.cameras);
        self.clients.extend(&change.touched.clients);
        for &id in &change.touched.keyframes {
            match map.keyframes().get(&id) {
                Some(keyframe) => self.poses.insert(id, keyframe.world_from_camera),
                None => self.poses.remove(&id),
            };
        }
        for &id in &change.touched.landmarks {
            match map.landmarks().get(&id) {
                Some(landmark) => self.positions.insert(id, landmark.position),
                None => self.positions.remove(&id),
            };
        }
    }
}

#[tokio::test]
async fn a_reader_of_the_whole_journal_holds_up_neither_items_nor_other_watchers() {
    let store = HeldStore::of(HeldReads::default());
    let (_maps, map) = maps_on(&store).await;
    let mut client = Client::open(&map).await;
    client.send_street(0..3).await;
    client.received(4).await;
    store.held.send_replace(true);
    let mut other = map.watch(None).await.unwrap();
    let before = other.next().await.unwrap().revision;
    let resuming = tokio::spawn({
        let map = map.clone();
        async move { map.watch(Some(1)).await }
    });
    // It reads, and goes on reading, while the map changes.
    store.waiting.subscribe().wait_for(|&count| count == 1).await.unwrap();
    let sequence = client.send(noisy_keyframe(3)).await;
    client.received(sequence).await;
    let step = other.next().await.unwrap();
    assert!(step.base_revision == before && step.touched.keyframes.contains(&id(3)));
    assert!(!resuming.is_finished());
    store.held.send_replace(false);
    let mut watch = resuming.await.unwrap().unwrap();
    let step = watch.next().await.unwrap();
    assert_eq!((step.reset, step.base_revision), (false, 1));
    // What came before and what came meanwhile.
    assert!([0, 1, 2, 3].iter().all(|&k| step.touched.keyframes.contains(&id(k))));
}

#[tokio::test]
async fn a_map_that_is_deleted_ends_the_watchers_that_read_its_journal() {
    let store = HeldStore::of(HeldReads::default());
    let (maps, map) = maps_on(&store).await;
    let mut client = Client::open(&map).await;
    client.send_street(0..2).await;
    client.finish().await;
    store.held.send_replace(true);
    let resuming = tokio::spawn({
        let map = map.clone();
        async move { map.watch(Some(1)).await }
    });
    store.waiting.subscribe().wait_for(|&count| count == 1).await.unwrap();
    maps.delete("house").await.unwrap();
    store.held.send_replace(false);
    let ended = resuming.await.unwrap().unwrap().next().await.unwrap_err();
    assert_eq!(ended, EngineError::MapNotFound { map: "house".to_owned() });
}

#[tokio::test]
async fn four_readers_resume_and_hold_what_a_reset_gives() {
    let store = HeldStore::of(HeldReads::default());
    let (_maps, map) = maps_on(&store).await;
    let mut client = Client::open(&map).await;
    client.send_street(0..4).await;
    client.received(5).await;
    let old = map.snapshot().await.unwrap();
    let from = old.revision();
    // The map at the revision that they hold.
    let mut held: Vec<Held> = (0..4).map(|_| Held::all(&old)).collect();
    let sequence = client.send(noisy_keyframe(4)).await;
    client.received(sequence).await;
    let _other = Client::open_as(&map, "drone").await;
    store.held.send_replace(true);
    let readers: Vec<_> = (0..4)
        .map(|_| {
            let map = map.clone();
            tokio::spawn(async move { map.watch(Some(from)).await })
        })
        .collect();
    // Two read, the others wait for their turn, and the map goes on.
    store.waiting.subscribe().wait_for(|&count| count == 2).await.unwrap();
    for k in 5..8 {
        let sequence = client.send(noisy_keyframe(k)).await;
        client.received(sequence).await;
    }
    client.finish().await;
    assert_eq!(*store.waiting.subscribe().borrow(), 2);
    store.held.send_replace(false);
    let reset = map.watch(None).await.unwrap().next().await.unwrap().snapshot;
    for (reader, held) in readers.into_iter().zip(&mut held) {
        let mut watch = reader.await.unwrap().unwrap();
        let mut revision = from;
        while revision < reset.revision() {
            let step = watch.next().await.unwrap();
            assert_eq!((step.reset, step.base_revision), (false, revision));
            held.take(&step);
            revision = step.revision;
        }
        assert_eq!(*held, Held::all(&reset));
    }
}

#[tokio::test]
async fn a_reader_that_missed_more_than_the_map_holds_gets_the_full_state() {
    let fixture = Fixture::plain().await;
    let map = fixture.map(MapPolicy::default()).await;
    // Each stream is an event, and the map holds hardly anything.
    for _ in 0..10_001 {
        map.open_stream("robot".to_owned(), 0, false).await.unwrap();
    }
    assert!(map.watch(Some(1)).await.unwrap().next().await.unwrap().reset);
    assert!(!map.watch(Some(2)).await.unwrap().next().await.unwrap().reset);
}

#[tokio::test]
async fn a_watcher_that_is_busy_gathers_what_it_misses() {
    let fixture = Fixture::plain().await;
    let map = fixture.map(MapPolicy::default()).await;
    let mut watch = map.watch(None).await.unwrap();
    let mut client = Client::open(&map).await;
    let mut idle = map.watch(None).await.unwrap();
    assert!(watch.next().await.unwrap().reset && idle.next().await.unwrap().reset);
    for batch in 0..20 {
        let ids = 5000 * batch..5000 * (batch + 1);
        let position = Some(Vector3::new(1.0, 2.0, 3.0));
        let landmarks = ids.map(|id| ItemLandmark { id, position }).collect();
        let sequence = client.send(Item::Landmarks { landmarks }).await;
        client.received(sequence).await;
        // The engine keeps 65,536 ids; this watcher takes them while it is elsewhere.
        assert!(watch.gather().now_or_never().is_none());
    }
    let step = watch.next().await.unwrap();
    assert!(!step.reset);
    assert_eq!(step.touched.landmarks.len(), 100_000);
    // One that does not even gather begins anew.
    assert!(idle.next().await.unwrap().reset);
}
