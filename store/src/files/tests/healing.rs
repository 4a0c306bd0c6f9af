//! No space, no descriptors: the journal waits, accepts nothing new, and continues by itself.

use std::path::Path;
use std::sync::Arc;

use super::faulty::{FaultyDisk, Shortage, Survives};
use super::script::{event, fold, open, stored};
use crate::files::disk::Disk;
use crate::files::folders::{self, Folder};
use crate::{Store, StoreError};

#[tokio::test]
async fn a_journal_goes_on_once_there_is_room_again() {
    for lack in [Shortage::Space, Shortage::Descriptors] {
        let disk = FaultyDisk::new();
        let store = open(&disk).unwrap();
        let epoch = store.create_map("a", None).await.unwrap();
        let mut flushed = store.follow("a").await.unwrap();
        let (mut last, mut waited) = (0, 0);
        // Files of a few events each: some of the writes begin a new one.
        for round in 0..12_u64 {
            disk.lack(Some(lack));
            last += 1;
            store.append("a", epoch, last - 1, vec![event(last as i64, 1)]).await.unwrap();
            let told = flushed.wait_for(|f| f.through == last || f.trouble().is_some()).await;
            let told = told.unwrap().clone();
            assert_eq!(told.failed, None, "{lack:?}");
            if let Some(unavailable) = told.unavailable {
                waited += 1;
                assert!(matches!(unavailable, StoreError::Unavailable { .. }), "{unavailable}");
                let next = vec![event(last as i64 + 1, 1)];
                assert_eq!(store.append("a", epoch, last, next).await, Err(unavailable));
                let map = Arc::new(fold(last as i64, 1));
                let refused = store.put_snapshot("a", epoch, map).await;
                assert!(matches!(refused, Err(StoreError::Unavailable { .. })), "{refused:?}");
                let refused = store.create_map("b", None).await;
                assert!(matches!(refused, Err(StoreError::Unavailable { .. })), "{refused:?}");
                assert!(flushed.borrow().through < last, "{lack:?}, round {round}");
            }
            disk.lack(None);
            let told = flushed.wait_for(|f| f.through == last).await.unwrap().clone();
            assert_eq!((told.failed, told.unavailable), (None, None));
        }
        assert!(waited > 1, "{lack:?} was met {waited} times");
        assert!(store.meters().journal_retries.get() >= waited);
        let map = Arc::new(fold(last as i64, 1));
        store.put_snapshot("a", epoch, map).await.unwrap();
        store.create_map("b", None).await.unwrap();
        store.delete_map("b").await.unwrap();
        let later = open(&disk.after(Survives::Nothing)).unwrap();
        assert_eq!(stored(&later, "a").await.unwrap(), fold(last as i64, 1), "{lack:?}");
        assert_eq!(later.damage("a").await.unwrap(), [], "{lack:?}");
    }
}

#[tokio::test]
async fn a_read_without_descriptors_fails_that_call_only() {
    let disk = FaultyDisk::new();
    let store = open(&disk).unwrap();
    let epoch = store.create_map("a", None).await.unwrap();
    store.append("a", epoch, 0, vec![event(1, 1)]).await.unwrap();
    store.follow("a").await.unwrap().wait_for(|f| f.through == 1).await.unwrap();
    // A start: nothing is kept in memory yet.
    let disk = disk.after(Survives::Everything);
    let store = open(&disk).unwrap();
    let epoch = store.acquire("a").await.unwrap();
    disk.lack(Some(Shortage::Descriptors));
    let refused = store.read("a", 0).await;
    assert!(matches!(refused, Err(StoreError::Unavailable { .. })), "{refused:?}");
    disk.lack(None);
    assert_eq!(store.read("a", 0).await.unwrap().len(), 1);
    store.append("a", epoch, 1, vec![event(2, 1)]).await.unwrap();
}

#[tokio::test]
async fn a_folder_that_cannot_be_looked_at_for_want_of_descriptors_is_not_taken_for_nameless() {
    let disk = FaultyDisk::new();
    let store = open(&disk).unwrap();
    let epoch = store.create_map("a", None).await.unwrap();
    store.append("a", epoch, 0, vec![event(1, 1)]).await.unwrap();
    store.follow("a").await.unwrap().wait_for(|f| f.through == 1).await.unwrap();
    let maps = Path::new("/data/maps");
    let names = disk.list(maps).unwrap();
    disk.lack(Some(Shortage::Descriptors));
    for name in &names {
        let found = folders::look(&disk, maps, name);
        assert!(
            matches!(&found, Folder::Unknown(StoreError::File { passes: true, .. })),
            "{found:?}"
        );
    }
    // A start that treated the name as free would give it to another map.
    let refused = folders::at_start(&disk, maps).unwrap_err();
    assert!(matches!(refused, StoreError::File { passes: true, .. }), "{refused:?}");
    disk.lack(None);
    assert!(matches!(folders::look(&disk, maps, &names[0]), Folder::Map { .. }));
}
