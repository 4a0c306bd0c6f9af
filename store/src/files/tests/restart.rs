//! A killed process leaves unsynced writes: the next start serves them, so that it must sync them
//! before it reports them as durable.

use super::faulty::{Fault, FaultyDisk, Survives};
use super::script::{Model, event, fold, open, session, stored};
use crate::{FileStore, Store, StoreError};

/// How far each map is durable after a start, as the store reports it.
async fn told(store: &FileStore) -> Vec<(String, u64)> {
    let mut told = Vec::new();
    for name in store.list_maps().await.unwrap() {
        store.acquire(&name).await.unwrap();
        let through = store.follow(&name).await.unwrap().borrow().through;
        told.push((name, through));
    }
    told
}

#[tokio::test]
async fn what_a_start_calls_durable_survives_a_loss_of_power() {
    let whole = FaultyDisk::new();
    session(&whole, &mut Model::default()).await.unwrap();
    for fault in [Fault::Crash, Fault::Broken] {
        for (number, operation) in whole.log().iter().enumerate() {
            let disk = FaultyDisk::new();
            disk.stage(number, fault);
            let _ended = session(&disk, &mut Model::default()).await;
            let killed = disk.killed();
            let store = open(&killed).unwrap();
            let told = told(&store).await;
            let later = open(&killed.after(Survives::Nothing)).unwrap();
            for (name, through) in told.into_iter().filter(|&(_, through)| through > 0) {
                let what = format!("{fault:?} at {number} ({operation}), map {name} at {through}");
                let map = stored(&later, &name).await.unwrap_or_else(|e| panic!("{what}: {e}"));
                assert!(map.revision() >= through as i64, "{what}: {}", map.revision());
                let damage = later.damage(&name).await.unwrap();
                assert!(damage.iter().all(|damage| damage.lost.is_none()), "{what}: {damage:?}");
            }
        }
    }
}

/// A journal whose event 2 was written but never synced, opened by a new process.
async fn unsynced() -> FaultyDisk {
    let disk = FaultyDisk::new();
    let store = open(&disk).unwrap();
    let epoch = store.create_map("a", None).await.unwrap();
    store.append("a", epoch, 0, vec![event(1, 1)]).await.unwrap();
    let mut flushed = store.follow("a").await.unwrap();
    flushed.wait_for(|f| f.through == 1).await.unwrap();
    while !disk.files().iter().any(|(path, _)| path.ends_with("/durable")) {
        tokio::task::yield_now().await;
    }
    // An append is a write and a sync.
    disk.stage(disk.log().len() + 1, Fault::Broken);
    store.append("a", epoch, 1, vec![event(2, 1)]).await.unwrap();
    flushed.wait_for(|f| f.failed.is_some()).await.unwrap();
    disk.killed()
}

#[tokio::test]
async fn an_end_that_cannot_be_brought_to_the_disk_is_read_and_not_written_on() {
    let clean = unsynced().await;
    let store = open(&clean).unwrap();
    store.acquire("a").await.unwrap();
    assert_eq!(store.follow("a").await.unwrap().borrow().through, 2);
    let operations = clean.log();
    assert!(operations.contains(&"rename"), "the end is copied: {operations:?}");
    for number in 0..operations.len() {
        let disk = unsynced().await;
        disk.stage(number, Fault::Broken);
        let Ok(store) = open(&disk) else { continue };
        let epoch = store.acquire("a").await.unwrap();
        assert_eq!(stored(&store, "a").await.unwrap(), fold(2, 1));
        let epoch = store.acquire("a").await.unwrap().max(epoch);
        let flushed = store.follow("a").await.unwrap().borrow().clone();
        let appended = store.append("a", epoch, 2, vec![event(3, 1)]).await;
        match flushed.failed {
            Some(StoreError::Stopped { durable, .. }) => {
                assert_eq!((durable, flushed.through), (1, 1));
                assert!(matches!(appended, Err(StoreError::Stopped { .. })), "{appended:?}");
            }
            failed => assert!(failed.is_none() && appended.is_ok(), "{failed:?} {appended:?}"),
        }
    }
}
