//! A data directory that an earlier version wrote, under `tests/golden/journal`: it must open, to
//! the recorded hash, for as long as its version is supported. `COVIS_TEST_RECORD_GOLDEN=1` writes
//! the directory again with the present version.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use super::script::{event, fold, stored};
use crate::Store;
use crate::encoding::tests::every_change;
use crate::files::{FileStore, FileStoreOptions};

/// Revisions in the golden journal; the snapshot is in the middle.
const LAST: i64 = 24;

fn hex(bytes: &[u8]) -> String {
    bytes.iter().map(|byte| format!("{byte:02x}")).collect()
}

fn copy(from: &Path, to: &Path) {
    fs_err::create_dir_all(to).unwrap();
    for entry in fs_err::read_dir(from).unwrap() {
        let path = entry.unwrap().path();
        let target = to.join(path.file_name().unwrap());
        if path.is_dir() {
            copy(&path, &target);
        } else {
            fs_err::copy(&path, &target).unwrap();
        }
    }
}

/// Writes two maps: one with a snapshot, one with every kind of change.
async fn write(folder: &Path) {
    let store = FileStore::open(folder, FileStoreOptions::default()).await.unwrap();
    let epoch = store.create_map("walk", None).await.unwrap();
    for revision in 1..=LAST {
        let expected = u64::try_from(revision - 1).unwrap();
        store.append("walk", epoch, expected, vec![event(revision, 1)]).await.unwrap();
        if revision == LAST / 2 {
            store.put_snapshot("walk", epoch, Arc::new(fold(revision, 1))).await.unwrap();
        }
    }
    let last = u64::try_from(LAST).unwrap();
    store.follow("walk").await.unwrap().wait_for(|f| f.through == last).await.unwrap();
    let epoch = store.create_map("all", None).await.unwrap();
    let all: Vec<_> = every_change().into_iter().map(Arc::new).collect();
    let last = all.len() as u64;
    store.append("all", epoch, 0, all).await.unwrap();
    store.follow("all").await.unwrap().wait_for(|f| f.through == last).await.unwrap();
}

#[tokio::test]
async fn what_version_one_wrote_is_read_bit_for_bit() {
    let golden = Path::new(env!("CARGO_MANIFEST_DIR")).join("../tests/golden/journal/v1");
    if std::env::var_os("COVIS_TEST_RECORD_GOLDEN").is_some() {
        let _old = fs_err::remove_dir_all(golden.join("data"));
        write(&golden.join("data")).await;
        fs_err::remove_file(golden.join("data/LOCK")).unwrap();
        let mut replayed = covis_map::Map::new();
        every_change().iter().for_each(|event| replayed.apply(event).unwrap());
        let walk = hex(&fold(LAST, 1).state_hash());
        let hashes = format!(
            "walk {LAST} {walk}\nall {} {}\n",
            replayed.revision(),
            hex(&replayed.state_hash())
        );
        fs_err::write(golden.join("hashes.txt"), hashes).unwrap();
    }
    // Opening repairs and locks, so that the test uses a copy.
    let folder = tempfile::tempdir().unwrap();
    copy(&golden.join("data"), folder.path());
    let store = FileStore::open(folder.path(), FileStoreOptions::default()).await.unwrap();
    let hashes = fs_err::read_to_string(golden.join("hashes.txt")).unwrap();
    for line in hashes.lines() {
        let [name, revision, hash] = line.split(' ').collect::<Vec<_>>()[..] else {
            panic!("{line}")
        };
        let map = stored(&store, name).await.unwrap();
        assert_eq!(
            (map.revision().to_string().as_str(), hex(&map.state_hash()).as_str()),
            (revision, hash)
        );
        assert_eq!(store.damage(name).await.unwrap(), []);
    }
    let folders: Vec<PathBuf> = fs_err::read_dir(folder.path().join("maps"))
        .unwrap()
        .map(|entry| entry.unwrap().path())
        .collect();
    assert_eq!(folders.len(), hashes.lines().count());
}
