//! What only files can show: groups, files that follow one another, the lock, names and folders.

use std::sync::Arc;

use super::faulty::{FaultyDisk, Survives};
use super::script::{event, fold, open, stored};
use crate::files::{FileStore, FileStoreOptions};
use crate::meter::Histogram;
use crate::{Store, StoreError};

#[test]
fn what_waits_together_shares_one_sync() {
    let mut runtime = tokio::runtime::Builder::new_current_thread();
    let runtime = runtime.enable_all().max_blocking_threads(1).build().unwrap();
    runtime.block_on(async {
        let disk = FaultyDisk::new();
        let store = open(&disk).unwrap();
        let epoch = store.create_map("a", None).await.unwrap();
        let before = disk.log().iter().filter(|&&o| o == "sync").count();
        // The only thread of the disk is held until all events are accepted.
        let (release, held) = std::sync::mpsc::channel();
        let holding = tokio::task::spawn_blocking(move || held.recv());
        for sequence in 0..40 {
            let batch = vec![event(sequence as i64 + 1, 1)];
            store.append("a", epoch, sequence, batch).await.unwrap();
        }
        release.send(()).unwrap();
        holding.await.unwrap().unwrap();
        store.follow("a").await.unwrap().wait_for(|f| f.through == 40).await.unwrap();
        let syncs = disk.log().iter().filter(|&&o| o == "sync").count() - before;
        assert_eq!(syncs, 1, "of 40 appends");
    });
}

#[tokio::test]
async fn snapshots_let_the_journal_shrink_and_the_last_two_stay() {
    let disk = FaultyDisk::new();
    let store = open(&disk).unwrap();
    let epoch = store.create_map("a", None).await.unwrap();
    let (mut last, mut previous, mut was_due) = (0, 0, false);
    for round in 1..=6_u64 {
        for _ in 0..8 {
            last += 1;
            let batch = vec![event(last as i64, 1)];
            was_due |= store.append("a", epoch, last - 1, batch).await.unwrap().snapshot_due;
            store.follow("a").await.unwrap().wait_for(|f| f.through == last).await.unwrap();
        }
        store.put_snapshot("a", epoch, Arc::new(fold(last as i64, 1))).await.unwrap();
        store.truncate("a", epoch, previous + 1).await.unwrap();
        assert_eq!(store.replayable_from("a").await.unwrap(), [previous, last]);
        let kept = store.snapshot_at("a", previous).await.unwrap();
        let expected = (previous > 0).then(|| Arc::new(fold(previous as i64, 1)));
        assert_eq!(kept, expected);
        assert_eq!(store.snapshot_at("a", last - 1).await.unwrap(), None);
        previous = last;
        let names: Vec<String> = disk.files().into_iter().map(|(path, _)| path).collect();
        let snapshots = names.iter().filter(|name| name.ends_with(".snap")).count();
        assert_eq!(snapshots as u64, round.min(2), "{names:?}");
    }
    assert!(was_due, "48 events are due for a snapshot");
    let meters = store.meters();
    assert_eq!(meters.group_events.sum(), 48);
    assert!(meters.journal_bytes.get() > 48 * 20 && meters.snapshot_bytes.get() > 6 * 20);
    let all = |histogram: &Histogram| histogram.cumulative().last().unwrap().1;
    assert_eq!((all(&meters.group_events), all(&meters.sync_ns)), (48, 48), "one by one");
    assert_eq!((all(&meters.snapshot_ns), meters.snapshot_failures.get()), (6, 0));
    let first = disk.files().iter().find_map(|(path, _)| {
        path.strip_suffix(".log").and_then(|path| path.rsplit_once('/')?.1.parse::<u64>().ok())
    });
    assert!(first.is_some_and(|first| first > 8), "old files are gone: {first:?}");
    // The newest snapshot is not needed.
    drop(store);
    let newest = disk.files().into_iter().map(|(p, _)| p).rfind(|p| p.ends_with(".snap")).unwrap();
    let disk = disk.with_file(&newest, |bytes| bytes[70] ^= 1);
    let store = open(&disk).unwrap();
    let map = stored(&store, "a").await.unwrap();
    assert_eq!(map, fold(48, 1));
    let damage = store.damage("a").await.unwrap();
    assert!(damage[0].file.ends_with(".bad") && damage[0].lost.is_none(), "{damage:?}");
    let epoch = store.acquire("a").await.unwrap();
    store.append("a", epoch, 48, vec![event(49, 1)]).await.unwrap();
}

#[tokio::test]
async fn a_directory_has_one_server_and_no_name_becomes_a_path() {
    let folder = tempfile::tempdir().unwrap();
    let options = FileStoreOptions::default();
    let store = FileStore::open(folder.path(), options).await.unwrap();
    let second = FileStore::open(folder.path(), options).await.unwrap_err();
    let holder = std::process::id().to_string();
    assert!(matches!(&second, StoreError::InUse { holder: told, .. } if *told == holder));
    let names = ["../../etc/passwd", "/abs", "a/b", "nul\0byte", "..", "", "LOCK", "ünïcode"];
    for name in names {
        let epoch = store.create_map(name, None).await.unwrap();
        store.append(name, epoch, 0, vec![event(1, 1)]).await.unwrap();
        store.follow(name).await.unwrap().wait_for(|f| f.through == 1).await.unwrap();
    }
    let exists = store.create_map("..", None).await;
    assert_eq!(exists, Err(StoreError::MapExists { map: "..".to_owned() }));
    store.delete_map("/abs").await.unwrap();
    drop(store);
    for entry in fs_err::read_dir(folder.path().join("maps")).unwrap() {
        let name = entry.unwrap().file_name().into_string().unwrap();
        assert!(name.len() == 32 && name.bytes().all(|b| b.is_ascii_hexdigit()), "{name}");
    }
    let store = FileStore::open(folder.path(), options).await.unwrap();
    let mut left: Vec<&str> = names.into_iter().filter(|&name| name != "/abs").collect();
    left.sort_unstable();
    assert_eq!(store.list_maps().await.unwrap(), left);
    assert_eq!(stored(&store, "a/b").await.unwrap(), fold(1, 1));
}

#[tokio::test]
async fn a_map_of_later_version_is_left_alone() {
    let disk = FaultyDisk::new();
    let store = open(&disk).unwrap();
    let epoch = store.create_map("a", None).await.unwrap();
    store.append("a", epoch, 0, vec![event(1, 1)]).await.unwrap();
    store.follow("a").await.unwrap().wait_for(|f| f.through == 1).await.unwrap();
    drop(store);
    let log = disk.files().into_iter().map(|(p, _)| p).find(|p| p.ends_with(".log")).unwrap();
    let disk = disk.after(Survives::Everything).with_file(&log, |bytes| {
        bytes[8] = 2;
        let crc = crc32c::crc32c(&bytes[..40]).to_le_bytes();
        bytes[40..44].copy_from_slice(&crc);
    });
    let before = disk.files();
    let error = open(&disk).unwrap().acquire("a").await.unwrap_err();
    assert!(error.to_string().contains("version 2"), "{error}");
    assert_eq!(disk.files(), before, "nothing was touched");
}
