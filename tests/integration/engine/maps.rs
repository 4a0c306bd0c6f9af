//! Creating and deleting maps while callers go away and the store fails.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::task::Poll;
use std::time::Duration;

use async_trait::async_trait;
use covis::map::MapPolicy;
use covis::service::engine::{EngineConfig, EngineError, MapState, Maps, SolverPool};
use covis::store::{Flushed, Store, StoreError};
use tokio::sync::{Semaphore, watch};

use super::staged_store::{Stage, StagedStore};

/// A store whose creations and deletions wait until the test lets them go on, or fail.
pub(super) struct HeldChanges {
    /// Calls that wait, for the test.
    entered: Semaphore,
    /// Calls that may go on.
    released: Semaphore,
    /// Calls that fail once they go on.
    pub(super) failing: Semaphore,
    /// Openings that find nothing left of what the system has.
    unavailable: Semaphore,
    /// Whether openings fail for good.
    unreadable: AtomicBool,
    /// How far journals of maps of this name are on the disk, where the test says so.
    pub(super) disk: watch::Sender<(String, Flushed)>,
}

pub(super) type HeldStore = StagedStore<HeldChanges>;

impl HeldStore {
    pub(super) fn new() -> Arc<Self> {
        let none = || Semaphore::new(0);
        let (entered, released, failing, unavailable) = (none(), none(), none(), none());
        let (unreadable, disk) = (AtomicBool::new(false), watch::Sender::default());
        Self::of(HeldChanges { entered, released, failing, unavailable, unreadable, disk })
    }

    pub(super) async fn maps(self: &Arc<Self>) -> Maps {
        let store: Arc<dyn Store> = Arc::<Self>::clone(self);
        Maps::open(store, SolverPool::new(1).unwrap(), EngineConfig::default()).await.unwrap()
    }
}

impl HeldChanges {
    /// Waits until a call waits.
    pub(super) async fn entered(&self) {
        self.entered.acquire().await.unwrap().forget();
    }

    pub(super) fn release(&self, calls: usize) {
        self.released.add_permits(calls);
    }
}

#[async_trait]
impl Stage for HeldChanges {
    async fn changing(&self) -> Result<(), StoreError> {
        self.entered.add_permits(1);
        self.released.acquire().await.unwrap().forget();
        match self.failing.try_acquire() {
            Ok(permit) => {
                permit.forget();
                let (path, message) = ("a map".to_owned(), "staged by a test".to_owned());
                Err(StoreError::File { action: "cannot change", path, message, passes: false })
            }
            Err(_none) => Ok(()),
        }
    }

    fn opening(&self, map: &str) -> Result<(), StoreError> {
        let (map, cause) = (map.to_owned(), "staged by a test".to_owned());
        if self.unreadable.load(Ordering::Relaxed) {
            return Err(StoreError::Failed { map, cause });
        }
        if let Ok(permit) = self.unavailable.try_acquire() {
            permit.forget();
            return Err(StoreError::Unavailable { map, cause });
        }
        Ok(())
    }

    fn followed(&self, map: &str) -> Option<watch::Receiver<Flushed>> {
        let mut disk = self.disk.subscribe();
        if disk.borrow().0 != map {
            return None;
        }
        let (flushed, followed) = watch::channel(disk.borrow_and_update().1.clone());
        tokio::spawn(async move {
            while disk.changed().await.is_ok() {
                flushed.send_replace(disk.borrow_and_update().1.clone());
            }
        });
        Some(followed)
    }
}

/// Begins a call and cuts it off once the store works on it.
async fn cut_off<T>(store: &HeldStore, call: impl Future<Output = Result<T, EngineError>>) {
    tokio::pin!(call);
    let begun = std::future::poll_fn(|context| Poll::Ready(call.as_mut().poll(context).is_ready()));
    assert!(!begun.await, "the store holds the call");
    store.entered().await;
}

fn policy() -> MapPolicy {
    MapPolicy::default()
}

#[tokio::test]
async fn a_creation_that_is_cut_off_runs_to_its_end_and_the_name_is_a_map() {
    let store = HeldStore::new();
    let maps = store.maps().await;
    cut_off(&store, maps.create("house", "", policy())).await;
    assert!(matches!(maps.get("house"), Err(EngineError::MapNotFound { .. })));
    store.release(1);
    // The second one waits for the first.
    let exists = maps.create("house", "", policy()).await;
    assert!(matches!(exists, Err(EngineError::MapExists { .. })), "{exists:?}");
    let handle = maps.get("house").unwrap();
    assert_eq!(handle.info().await.unwrap().snapshot.revision(), 1);
    handle.open_stream("robot".to_owned(), 0, false).await.unwrap();
}

#[tokio::test]
async fn a_deletion_that_is_cut_off_runs_to_its_end_and_the_name_is_free() {
    let store = HeldStore::new();
    let maps = store.maps().await;
    store.release(1);
    let first = maps.create("house", "", policy()).await.unwrap();
    store.entered().await;
    cut_off(&store, maps.delete("house")).await;
    store.release(2);
    let second = maps.create("house", "", policy()).await.unwrap();
    assert_ne!(first.uid, second.uid);
    assert_eq!(maps.list().len(), 1, "the deleted one is not counted");
    maps.get("house").unwrap().info().await.unwrap();
}

#[tokio::test]
async fn of_two_creations_of_a_name_at_once_one_makes_the_map() {
    let store = HeldStore::new();
    let maps = store.maps().await;
    store.release(1);
    let (a, b) =
        tokio::join!(maps.create("house", "", policy()), maps.create("house", "", policy()));
    let outcomes = [a.is_ok(), b.is_ok()];
    assert!(outcomes == [true, false] || outcomes == [false, true], "{outcomes:?}");
}

#[tokio::test]
async fn a_creation_that_fails_leaves_the_name_free() {
    let store = HeldStore::new();
    let maps = store.maps().await;
    store.failing.add_permits(1);
    store.release(2);
    let failed = maps.create("house", "", policy()).await;
    assert!(matches!(failed, Err(EngineError::Store(_))), "{failed:?}");
    assert!(maps.list().is_empty());
    maps.create("house", "", policy()).await.unwrap();
}

/// What a creation left that could be neither ended nor undone does not hold the name.
#[tokio::test]
async fn a_leftover_of_the_store_does_not_hold_the_name() {
    let store = HeldStore::new();
    let maps = store.maps().await;
    store.memory.create_map("house", None).await.unwrap();
    store.release(3);
    maps.create("house", "", policy()).await.unwrap();
    assert_eq!(maps.get("house").unwrap().info().await.unwrap().snapshot.revision(), 1);
}

#[tokio::test]
async fn a_map_whose_deletion_fails_goes_on() {
    let store = HeldStore::new();
    let maps = store.maps().await;
    store.release(3);
    maps.create("house", "", policy()).await.unwrap();
    store.failing.add_permits(1);
    let failed = maps.delete("house").await;
    assert!(matches!(failed, Err(EngineError::Store(_))), "{failed:?}");
    let handle = maps.get("house").unwrap();
    handle.open_stream("robot".to_owned(), 0, false).await.unwrap();
    maps.delete("house").await.unwrap();
    assert!(matches!(maps.get("house"), Err(EngineError::MapNotFound { .. })));
}

#[tokio::test]
async fn a_server_that_stops_waits_for_the_creation_that_has_begun() {
    let store = HeldStore::new();
    let maps = store.maps().await;
    cut_off(&store, maps.create("house", "", policy())).await;
    let stop = maps.shutdown(std::time::Duration::from_secs(600));
    tokio::pin!(stop);
    let stopped = std::future::poll_fn(|cx| Poll::Ready(stop.as_mut().poll(cx).is_ready())).await;
    assert!(!stopped);
    let refused = maps.create("other", "", policy()).await;
    assert!(matches!(refused, Err(EngineError::ShuttingDown)), "{refused:?}");
    store.release(1);
    stop.await;
    assert_eq!(store.memory.read("house", 0).await.unwrap().len(), 1);
}

#[tokio::test(start_paused = true)]
async fn a_map_without_descriptors_at_the_start_opens_once_there_are_some() {
    let store = HeldStore::new();
    store.release(1);
    let before = store.maps().await.create("house", "", policy()).await.unwrap();
    store.unavailable.add_permits(3);
    let maps = store.maps().await;
    let unopened = maps.get("house").unwrap().info().await.unwrap_err();
    assert!(matches!(unopened, EngineError::Store(StoreError::Unavailable { .. })), "{unopened:?}");
    let info = loop {
        match maps.get("house").unwrap().info().await {
            Ok(info) => break info,
            Err(_unopened) => tokio::time::sleep(Duration::from_millis(50)).await,
        }
    };
    assert_eq!((info.uid, info.state), (before.uid, MapState::Open));
    maps.get("house").unwrap().open_stream("robot".to_owned(), 0, false).await.unwrap();
}

#[tokio::test]
async fn a_map_that_cannot_be_opened_says_why_and_is_no_other_map() {
    let store = HeldStore::new();
    store.release(1);
    store.maps().await.create("house", "", policy()).await.unwrap();
    store.unreadable.store(true, Ordering::Relaxed);
    let maps = store.maps().await;
    let house = maps.get("house").unwrap();
    let cause = "staged by a test".to_owned();
    let failed = EngineError::Store(StoreError::Failed { map: "house".to_owned(), cause });
    assert_eq!(house.info().await.unwrap_err(), failed);
    assert_eq!(house.snapshot().await.unwrap_err(), failed);
    assert_eq!(house.watch(None).await.unwrap_err(), failed);
    let listed = house.listed().await.unwrap();
    assert_eq!((listed.uid.as_str(), listed.state), ("", MapState::Poisoned));
    store.release(1);
    maps.delete("house").await.unwrap();
}
