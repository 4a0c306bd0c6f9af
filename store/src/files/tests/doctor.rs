//! The doctor on a directory with snapshots and several journal files: every file, flipped bits and
//! cuts; a check changes nothing, a repair loses nothing.

use crate::Repair;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use super::script::{SMALL, event, fold, stored};
use crate::files::{FileStore, check_up};
use crate::{Store, StoreError};

/// Leaves map "a" at revision 20, with snapshots at 8 and 16 and the journal from 9 on.
async fn left(folder: &Path) {
    let store = FileStore::open(folder, SMALL).await.unwrap();
    let epoch = store.create_map("a", None).await.unwrap();
    for last in 1..=20_u64 {
        store.append("a", epoch, last - 1, vec![event(last as i64, 1)]).await.unwrap();
        store.follow("a").await.unwrap().wait_for(|f| f.through == last).await.unwrap();
        if last % 8 == 0 {
            store.put_snapshot("a", epoch, Arc::new(fold(last as i64, 1))).await.unwrap();
            store.truncate("a", epoch, last - 7).await.unwrap();
        }
    }
    let held = check_up(folder, Repair::No).unwrap_err();
    assert!(matches!(held, StoreError::InUse { .. }), "{held}");
    store.close().await;
}

/// All files by their path inside the folder.
fn files(folder: &Path) -> BTreeMap<PathBuf, Vec<u8>> {
    let mut found = BTreeMap::new();
    let mut folders = vec![folder.to_owned()];
    while let Some(next) = folders.pop() {
        for entry in fs_err::read_dir(next).unwrap() {
            let path = entry.unwrap().path();
            if path.is_dir() {
                folders.push(path);
            } else if !path.ends_with("LOCK") {
                let inside = path.strip_prefix(folder).unwrap().to_owned();
                found.insert(inside, fs_err::read(&path).unwrap());
            }
        }
    }
    found
}

fn write(folder: &Path, files: &BTreeMap<PathBuf, Vec<u8>>) {
    for (path, bytes) in files {
        let path = folder.join(path);
        fs_err::create_dir_all(path.parent().unwrap()).unwrap();
        fs_err::write(path, bytes).unwrap();
    }
}

#[tokio::test]
async fn damage_anywhere_is_told_and_repaired_without_losing_a_byte() {
    let origin = tempfile::tempdir().unwrap();
    left(origin.path()).await;
    let whole = check_up(origin.path(), Repair::No).unwrap();
    assert_eq!((whole.len(), whole[0].revision, whole[0].snapshot), (1, 20, Some(16)));
    assert!(!whole[0].is_damaged() && whole[0].segments.len() > 1, "{whole:?}");
    let good = files(origin.path());
    let mut lost = 0;
    for (path, bytes) in &good {
        for (round, at) in (0..bytes.len()).step_by(61).chain([bytes.len() - 1]).enumerate() {
            let mut hurt = good.clone();
            let file = hurt.get_mut(path).unwrap();
            if round % 2 == 0 {
                file[at] ^= 16
            } else {
                file.truncate(at)
            }
            let what = format!("{} at {at}, round {round}", path.display());
            let folder = tempfile::tempdir().unwrap();
            write(folder.path(), &hurt);
            let told = check_up(folder.path(), Repair::No).unwrap();
            assert_eq!(files(folder.path()), hurt, "{what}: looking changes nothing");
            // The mark is not part of the map's content.
            let is_mark = path.ends_with("durable");
            assert_eq!(told[0].is_damaged(), !is_mark, "{what}: {told:?}");
            lost += usize::from(told[0].damage.iter().any(|damage| damage.lost.is_some()));

            let mended = check_up(folder.path(), Repair::Damage).unwrap();
            assert_eq!(mended[0].failure, None, "{what}");
            let after = files(folder.path());
            for bytes in hurt.values() {
                assert!(after.values().any(|kept| kept == bytes), "{what}: bytes are gone");
            }
            let again = check_up(folder.path(), Repair::No).unwrap();
            assert!(!again[0].is_damaged(), "{what}: {again:?}");
            assert_eq!(again[0].revision, told[0].revision, "{what}");
            let store = FileStore::open(folder.path(), SMALL).await.unwrap();
            let names = store.list_maps().await.unwrap();
            let map = stored(&store, &names[0]).await.unwrap();
            let revision = map.revision();
            assert_eq!(map.state_hash(), fold(revision, 1).state_hash(), "{what}");
            assert_eq!(u64::try_from(revision).unwrap(), told[0].revision, "{what}");
            let epoch = store.acquire(&names[0]).await.unwrap();
            let next = vec![event(revision + 1, 1)];
            store.append(&names[0], epoch, told[0].revision, next).await.unwrap();
            store.close().await;
        }
    }
    assert!(lost > 10, "{lost} of them lost events");
}

#[tokio::test]
async fn a_map_of_which_nothing_is_left_is_moved_away() {
    let folder = tempfile::tempdir().unwrap();
    left(folder.path()).await;
    for (path, bytes) in files(folder.path()) {
        if path.extension().is_some_and(|extension| extension == "snap") {
            fs_err::write(folder.path().join(path), &bytes[..50]).unwrap();
        }
    }
    let mended = check_up(folder.path(), Repair::Damage).unwrap();
    assert!(mended[0].revision == 0 && mended[0].set_aside[0].is_dir(), "{mended:?}");
    assert_eq!(check_up(folder.path(), Repair::No).unwrap(), []);
    let store = FileStore::open(folder.path(), SMALL).await.unwrap();
    assert_eq!(store.list_maps().await.unwrap(), Vec::<String>::new());
    store.create_map("a", None).await.unwrap();
}
