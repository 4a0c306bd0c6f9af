//! Foreign entries of a data directory, and files of a later version: the start, the doctor and the
//! backup do not change them.

use crate::Repair;
use std::path::Path;

use super::faulty::{FaultyDisk, Survives};
use super::script::{SMALL, event, fold, open, stored};
use crate::files::backup::back_up_while;
use crate::files::sealed::{Kind, sealed};
use crate::files::{FileStore, back_up, check_up};
use crate::{Store, StoreError};

fn copy(from: &Path, to: &Path) {
    fs_err::create_dir_all(to).unwrap();
    for entry in fs_err::read_dir(from).unwrap() {
        let path = entry.unwrap().path();
        fs_err::copy(&path, to.join(path.file_name().unwrap())).unwrap();
    }
}

#[tokio::test]
async fn what_is_not_ours_is_left_alone_and_stops_nothing() {
    let root = tempfile::tempdir().unwrap();
    let store = FileStore::open(root.path(), SMALL).await.unwrap();
    let epoch = store.create_map("a", None).await.unwrap();
    store.append("a", epoch, 0, vec![event(1, 1)]).await.unwrap();
    store.follow("a").await.unwrap().wait_for(|f| f.through == 1).await.unwrap();
    store.close().await;
    let maps = root.path().join("maps");
    let map = fs_err::read_dir(&maps).unwrap().next().unwrap().unwrap().path();
    let uid = map.file_name().unwrap().to_str().unwrap().to_owned();
    let other = "0123456789abcdef0123456789abcdef";
    for name in [format!("{uid}.bak"), format!("{uid}-copy"), uid.to_uppercase(), other.to_owned()]
    {
        // A uid of digits alone is the same in capitals.
        if name != uid {
            copy(&map, &maps.join(name));
        }
    }
    fs_err::create_dir(maps.join("lost+found")).unwrap();
    fs_err::write(maps.join("notes.txt"), "mine").unwrap();
    fs_err::write(maps.join("fedcba9876543210fedcba9876543210"), "mine").unwrap();
    #[cfg(unix)]
    {
        use std::os::unix::ffi::OsStrExt as _;
        let name = std::ffi::OsStr::from_bytes(b"\xff.deleted");
        fs_err::create_dir(maps.join(name)).unwrap();
    }
    copy(&map, &maps.join(format!("{other}.deleted")));
    let entries = || fs_err::read_dir(&maps).unwrap().count();
    let before = entries();

    let checkups = check_up(root.path(), Repair::No).unwrap();
    assert_eq!(checkups.len(), 1, "{checkups:?}");
    assert!(!checkups[0].is_damaged() && entries() == before, "{checkups:?}");
    let backup = tempfile::tempdir().unwrap();
    let copied = back_up(root.path(), &backup.path().join("copy")).unwrap();
    assert!(copied.len() == 1 && !copied[0].is_damaged(), "{copied:?}");

    let store = FileStore::open(root.path(), SMALL).await.unwrap();
    assert_eq!(store.list_maps().await.unwrap(), ["a"]);
    assert_eq!(stored(&store, "a").await.unwrap(), fold(1, 1));
    assert_eq!(entries(), before - 1, "only what an unfinished deletion left is gone");
}

/// Maps "a" and "b", which becomes part of "a" while a backup runs; a deletion and an event stand for that.
#[tokio::test]
async fn what_moves_from_map_to_map_while_a_backup_runs_is_in_it() {
    let root = tempfile::tempdir().unwrap();
    let store = FileStore::open(root.path(), SMALL).await.unwrap();
    let mut folders = Vec::new();
    let maps = root.path().join("maps");
    let list = || -> Vec<String> {
        let entries = fs_err::read_dir(&maps).unwrap();
        entries.map(|entry| entry.unwrap().file_name().into_string().unwrap()).collect()
    };
    for name in ["a", "b"] {
        let before = if folders.is_empty() { Vec::new() } else { list() };
        let epoch = store.create_map(name, None).await.unwrap();
        store.append(name, epoch, 0, vec![event(1, 1)]).await.unwrap();
        store.follow(name).await.unwrap().wait_for(|f| f.through == 1).await.unwrap();
        folders.push(list().into_iter().find(|folder| !before.contains(folder)).unwrap());
    }
    store.close().await;
    // The first one is copied first; it is the one that takes the other's content.
    folders.sort();
    let [first, second] = [&folders[0], &folders[1]].map(|folder| maps.join(folder));
    let (backup, mut times) = (tempfile::tempdir().unwrap(), 0);
    let aside = backup.path().join("aside");
    copy(&second, &aside);
    let copied = back_up_while(root.path(), &backup.path().join("copy"), || {
        times += 1;
        if times == 2 {
            // Both were copied: the copy of what goes now is whole.
            fs_err::remove_dir_all(&second).unwrap();
        }
    });
    assert_eq!((copied.unwrap().len(), times), (2, 2));
    copy(&aside, &second);
    times = 0;
    let copied = back_up_while(root.path(), &backup.path().join("other"), || {
        times += 1;
        if times == 1 {
            fs_err::remove_dir_all(&second).unwrap();
            fs_err::write(first.join("content"), "of the second").unwrap();
        }
        if times == 2 {
            copy(&aside, &second);
        }
    });
    // Listed again because one was gone, and because one is new.
    assert_eq!((copied.unwrap().len(), times), (2, 4));
    let copied = backup.path().join("other/maps").join(&folders[0]).join("content");
    assert_eq!(fs_err::read_to_string(copied).unwrap(), "of the second");
}

/// Map "a" with a snapshot, closed.
async fn with_snapshot() -> FaultyDisk {
    let disk = FaultyDisk::new();
    let store = open(&disk).unwrap();
    let epoch = store.create_map("a", None).await.unwrap();
    store.append("a", epoch, 0, vec![event(1, 1), event(2, 1)]).await.unwrap();
    store.put_snapshot("a", epoch, fold(2, 1).into()).await.unwrap();
    store.close().await;
    disk.after(Survives::Everything)
}

/// A disk on which the first file with this ending has version 2.
fn later(disk: &FaultyDisk, ending: &str) -> FaultyDisk {
    let path =
        disk.files().into_iter().map(|(path, _)| path).find(|p| p.ends_with(ending)).unwrap();
    disk.with_file(&path, |bytes| {
        bytes[8] = 2;
        let end = bytes.len() - 4;
        let crc = crc32c::crc32c(&bytes[..end]).to_le_bytes();
        bytes[end..].copy_from_slice(&crc);
    })
}

#[tokio::test]
async fn a_snapshot_of_a_later_version_is_untouched_and_its_map_takes_no_changes() {
    let disk = later(&with_snapshot().await, ".snap");
    let before = disk.files();
    let store = open(&disk).unwrap();
    let refused = store.acquire("a").await.unwrap_err();
    let told = refused.to_string();
    assert!(matches!(&refused, StoreError::Later { map, .. } if map == "a"), "{refused:?}");
    assert!(told.contains("00000000000000000002.snap") && told.contains("version 2"), "{told}");
    assert_eq!(disk.files(), before, "nothing was touched");
}

#[tokio::test]
async fn a_name_that_a_later_version_wrote_stays_taken() {
    let disk = later(&with_snapshot().await, "/map");
    // The same version with a field that is not known here.
    let fields = with_snapshot().await;
    let path = fields.files().into_iter().map(|(path, _)| path).find(|p| p.ends_with("/map"));
    let fields = fields.with_file(&path.unwrap(), |bytes| {
        let uid = *bytes[16..].first_chunk().unwrap();
        *bytes = sealed(Kind::Identity, &uid, 0, &[10, 1, b'a', 16, 7]);
    });
    for disk in [disk, fields] {
        let before = disk.files();
        let store = open(&disk).unwrap();
        assert_eq!(store.list_maps().await.unwrap(), ["a"]);
        let exists = StoreError::MapExists { map: "a".to_owned() };
        assert_eq!(store.create_map("a", None).await, Err(exists));
        for refused in [store.acquire("a").await.map(|_| ()), store.delete_map("a").await] {
            assert!(matches!(refused, Err(StoreError::Later { .. })), "{refused:?}");
        }
        assert_eq!(disk.files(), before, "nothing was touched");
    }
}
