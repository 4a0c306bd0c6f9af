//! Creating and deleting maps: canceled at any moment, failing at any operation, with duplicate
//! names.

use std::path::Path;
use std::sync::Arc;

use futures_util::FutureExt;

use super::faulty::{Fault, FaultyDisk, Survives};
use super::script::{event, fold, open, stored};
use crate::encoding::{encode_event, encode_identity};
use crate::files::disk::Disk as _;
use crate::files::folders::name_of;
use crate::files::record::{header, put_record};
use crate::files::sealed::{Kind, sealed};
use crate::{FileStore, Store, StoreError};

async fn append(store: &FileStore, map: &str, revision: i64) -> Result<(), StoreError> {
    let epoch = store.acquire(map).await?;
    let last = u64::try_from(revision).unwrap();
    store.append(map, epoch, last - 1, vec![event(revision, 1)]).await?;
    let mut flushed = store.follow(map).await?;
    let reached = flushed.wait_for(|f| f.through >= last || f.trouble().is_some()).await.unwrap();
    reached.trouble().cloned().map_or(Ok(()), Err)
}

fn folders(disk: &FaultyDisk) -> usize {
    disk.list(Path::new("/data/maps")).unwrap().len()
}

#[tokio::test]
async fn a_creation_that_nobody_waits_for_leaves_the_name_free_and_one_folder() {
    let disk = FaultyDisk::new();
    let store = open(&disk).unwrap();
    for _ in 0..3 {
        if store.create_map("a", None).now_or_never().is_some() {
            // Its thread ended before it could be canceled.
            return;
        }
    }
    let epoch = store.create_map("a", None).await.unwrap();
    assert_eq!(
        store.create_map("a", None).await,
        Err(StoreError::MapExists { map: "a".to_owned() })
    );
    assert_eq!(folders(&disk), 1);
    store.append("a", epoch, 0, vec![event(1, 1)]).await.unwrap();
    store.follow("a").await.unwrap().wait_for(|f| f.through == 1).await.unwrap();
    let again = open(&disk.after(Survives::Nothing)).unwrap();
    assert_eq!(again.list_maps().await.unwrap(), ["a"]);
    assert_eq!(stored(&again, "a").await.unwrap(), fold(1, 1));
}

#[tokio::test]
async fn a_deletion_that_nobody_waits_for_is_done() {
    let disk = FaultyDisk::new();
    let store = open(&disk).unwrap();
    store.create_map("a", None).await.unwrap();
    append(&store, "a", 1).await.unwrap();
    let _cut_off = store.delete_map("a").now_or_never();
    let unknown = StoreError::UnknownMap { map: "a".to_owned() };
    assert_eq!(store.delete_map("a").await, Err(unknown));
    store.create_map("a", None).await.unwrap();
    append(&store, "a", 1).await.unwrap();
    assert_eq!(open(&disk.after(Survives::Nothing)).unwrap().list_maps().await.unwrap(), ["a"]);
}

#[tokio::test]
async fn a_map_without_an_event_is_no_map_after_a_restart() {
    let disk = FaultyDisk::new();
    open(&disk).unwrap().create_map("a", None).await.unwrap();
    let disk = disk.after(Survives::Everything);
    let store = open(&disk).unwrap();
    assert_eq!(store.list_maps().await.unwrap(), Vec::<String>::new());
    store.create_map("a", None).await.unwrap();
    assert_eq!(folders(&disk), 1);
}

#[tokio::test]
async fn a_creation_that_fails_at_any_operation_can_be_repeated() {
    for number in 0.. {
        let disk = FaultyDisk::new();
        let store = open(&disk).unwrap();
        let before = disk.log().len();
        disk.stage(before + number, Fault::NoSpace);
        let Err(error) = store.create_map("a", None).await else {
            assert!(number > 5, "{number} operations make a map");
            return;
        };
        assert!(matches!(error, StoreError::Unavailable { .. }), "{error}");
        assert!(!error.to_string().contains('/'), "{error}");
        store.create_map("a", None).await.unwrap();
        append(&store, "a", 1).await.unwrap();
        assert_eq!(folders(&disk), 1);
    }
}

#[tokio::test]
async fn a_deletion_that_fails_either_changes_nothing_or_ends_acknowledging() {
    for number in 0..3 {
        let disk = FaultyDisk::new();
        let store = open(&disk).unwrap();
        store.create_map("a", None).await.unwrap();
        append(&store, "a", 1).await.unwrap();
        while !disk.files().iter().any(|(path, _)| path.ends_with("/durable")) {
            tokio::task::yield_now().await;
        }
        disk.stage(disk.log().len() + number, Fault::Broken);
        let deleted = store.delete_map("a").await;
        if deleted.is_ok() {
            assert_eq!(number, 2, "what is left of the files is no reason");
            continue;
        }
        let is_open = append(&store, "a", 2).await.is_ok();
        for survives in [Survives::Nothing, Survives::Everything] {
            let later = open(&disk.killed().after(survives)).unwrap();
            if is_open {
                assert_eq!(stored(&later, "a").await.unwrap(), fold(2, 1), "fault at {number}");
            }
        }
        assert_eq!(is_open, number == 0);
        if !is_open {
            let told = store.follow("a").await.unwrap().borrow().clone();
            assert!(matches!(told.failed, Some(StoreError::Stopped { .. })), "{told:?}");
        }
        store.delete_map("a").await.unwrap();
        store.create_map("a", None).await.unwrap();
        append(&store, "a", 1).await.unwrap();
        let later = open(&disk.after(Survives::Nothing)).unwrap();
        assert_eq!(stored(&later, "a").await.unwrap(), fold(1, 1));
    }
}

#[cfg(feature = "cluster")]
#[tokio::test]
async fn what_was_set_aside_is_where_a_repeated_call_says() {
    let aside = Path::new("/data/set-aside");
    for number in 0.. {
        let disk = FaultyDisk::new();
        let store = open(&disk).unwrap();
        let mut repeated = 0;
        // The first copy takes the name that the second one would have.
        for copy in 1..=2 {
            store.create("a", Some([7; 16]), None).await.unwrap();
            append(&store, "a", 1).await.unwrap();
            let is_idle = |(path, _): &(String, _)| {
                path.starts_with("/data/maps") && path.ends_with("/durable")
            };
            while !disk.files().iter().any(is_idle) {
                tokio::task::yield_now().await;
            }
            if copy == 2 {
                disk.stage(disk.log().len() + number, Fault::Broken);
            }
            let mut folder = store.set_aside("a").await;
            if folder.is_err() {
                repeated += 1;
                folder = store.set_aside("a").await;
            }
            let files = disk.list(&folder.unwrap()).unwrap();
            assert!(files.contains(&"map".to_owned()), "fault at {number}: {files:?}");
            assert_eq!(disk.list(aside).unwrap().len(), copy);
        }
        if repeated == 0 {
            assert!(number > 3, "{number} operations set a map aside");
            return;
        }
    }
}

#[tokio::test]
async fn two_folders_of_one_name_are_told_and_neither_is_served() {
    let disk = FaultyDisk::new();
    for uid in [[1; 16], [2; 16]] {
        let folder = Path::new("/data/maps").join(name_of(&uid));
        disk.create_folder(&folder).unwrap();
        let put = |name: &str, bytes: &[u8]| disk.create(&folder.join(name)).unwrap().append(bytes);
        let (mut journal, mut payload) = (header(&uid, 1), Vec::new());
        encode_event(&event(1, 1), &mut payload);
        assert!(put_record(&mut journal, &uid, 1, 0, &payload));
        put("00000000000000000001.log", &journal).unwrap();
        put("map", &sealed(Kind::Identity, &uid, 0, &encode_identity("walk"))).unwrap();
    }
    let before = disk.files();
    let store = open(&disk).unwrap();
    assert_eq!(store.list_maps().await.unwrap(), ["walk"]);
    let folders = vec![name_of(&[1; 16]), name_of(&[2; 16])];
    let refused = StoreError::Ambiguous { map: "walk".to_owned(), folders };
    assert_eq!(store.acquire("walk").await, Err(refused.clone()));
    assert_eq!(store.delete_map("walk").await, Err(refused));
    let exists = StoreError::MapExists { map: "walk".to_owned() };
    assert_eq!(store.create_map("walk", None).await, Err(exists));
    assert_eq!(disk.files(), before, "both stay as they are");
}

#[tokio::test]
async fn a_map_with_content_is_there_whole_or_not_at_all_after_a_crash() {
    let mut crashed = 0;
    for number in 0.. {
        let disk = FaultyDisk::new();
        let store = open(&disk).unwrap();
        disk.stage(disk.log().len() + number, Fault::Crash);
        let created = store.create_map("a", Some(Arc::new(fold(7, 1)))).await;
        for survives in [Survives::Nothing, Survives::Everything, Survives::Some(3)] {
            let disk = disk.after(survives);
            let later = open(&disk).unwrap();
            let maps = later.list_maps().await.unwrap();
            if created.is_ok() {
                assert_eq!(maps, ["a"], "a crash at {number}, {survives:?} survives");
            }
            if maps.is_empty() {
                later.create_map("a", Some(Arc::new(fold(7, 1)))).await.unwrap();
            }
            assert_eq!(stored(&later, "a").await.unwrap(), fold(7, 1), "a crash at {number}");
            assert_eq!(later.damage("a").await.unwrap(), []);
            append(&later, "a", 8).await.unwrap();
            let again = open(&disk.after(Survives::Nothing)).unwrap();
            assert_eq!(stored(&again, "a").await.unwrap(), fold(8, 1));
            assert_eq!(folders(&disk), 1);
        }
        if created.is_ok() {
            break;
        }
        crashed += 1;
    }
    assert!(crashed > 8, "{crashed} operations make a map");
}

#[tokio::test]
async fn a_creation_with_content_that_fails_at_any_operation_can_be_repeated() {
    for number in 0.. {
        let disk = FaultyDisk::new();
        let store = open(&disk).unwrap();
        disk.stage(disk.log().len() + number, Fault::NoSpace);
        let content = || Arc::new(fold(7, 1));
        if store.create_map("a", Some(content())).await.is_ok() {
            assert!(number > 8, "{number} operations make a map");
            let exists = StoreError::MapExists { map: "a".to_owned() };
            assert_eq!(store.create_map("a", Some(content())).await, Err(exists.clone()));
            assert_eq!(store.create_map("a", None).await, Err(exists));
            return;
        }
        assert_eq!(store.list_maps().await.unwrap(), Vec::<String>::new());
        store.create_map("a", Some(content())).await.unwrap();
        append(&store, "a", 8).await.unwrap();
        assert_eq!(stored(&store, "a").await.unwrap(), fold(8, 1));
        assert_eq!(folders(&disk), 1, "after a failure at {number}");
    }
}
