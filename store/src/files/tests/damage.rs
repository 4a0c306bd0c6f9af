//! Flipped bits and lost files: found, named, confined to their map, never a wrong map.

use std::path::Path;

use super::faulty::{FaultyDisk, Survives};
use super::script::{Model, event, fold, open, session, stored};
use crate::encoding::{encode_event, encode_identity, encode_map};
use crate::files::disk::Disk as _;
use crate::files::record::{header, put_record};
use crate::files::sealed::{Kind, read_snapshot, sealed, sealed_map};
use crate::{Store, StoreError};

/// A closed session, with the last revision of each map.
async fn closed() -> FaultyDisk {
    let disk = FaultyDisk::new();
    let mut model = Model::default();
    session(&disk, &mut model).await.unwrap();
    // The last marks are written after the acknowledgment.
    let marks = || {
        let files = disk.files().into_iter().filter(|(path, _)| path.ends_with("/durable"));
        let mut last: Vec<u8> = files.map(|(_, bytes)| bytes[8]).collect();
        last.sort_unstable();
        last
    };
    while marks() != [2, 20] {
        tokio::task::yield_now().await;
    }
    disk.after(Survives::Everything)
}

/// A journal lost events that a snapshot contains, and a crash left an event after a gap. That
/// event was never acknowledged and is removed; otherwise it would look acknowledged once another
/// file follows.
#[tokio::test]
async fn what_a_crash_left_behind_a_gap_does_not_stop_a_damaged_map_later() {
    let (disk, uid) = (FaultyDisk::new(), [7; 16]);
    let folder = Path::new("/data/maps").join("07".repeat(16));
    disk.create_folder(&folder).unwrap();
    let put = |name: &str, bytes: &[u8]| disk.create(&folder.join(name)).unwrap().append(bytes);
    let mut journal = header(&uid, 1);
    for sequence in [1, 2, 5, 6, 7, 9] {
        let mut payload = Vec::new();
        encode_event(&event(sequence, 1), &mut payload);
        let sequence = u64::try_from(sequence).unwrap();
        assert!(put_record(&mut journal, &uid, sequence, 5.min(sequence - 1), &payload));
    }
    put("00000000000000000001.log", &journal).unwrap();
    put("00000000000000000007.snap", &sealed_map(&uid, &fold(7, 1))).unwrap();
    put("map", &sealed(Kind::Identity, &uid, 0, &encode_identity("walk"))).unwrap();
    let store = open(&disk).unwrap();
    let epoch = store.acquire("walk").await.unwrap();
    store.append("walk", epoch, 7, vec![event(8, 1)]).await.unwrap();
    store.follow("walk").await.unwrap().wait_for(|flushed| flushed.through == 8).await.unwrap();
    let again = open(&disk.after(Survives::Everything)).unwrap();
    assert_eq!(stored(&again, "walk").await.unwrap().state_hash(), fold(8, 1).state_hash());
    let lost = again.damage("walk").await.unwrap().into_iter().filter_map(|d| d.lost);
    assert_eq!(lost.collect::<Vec<_>>(), []);
    let epoch = again.acquire("walk").await.unwrap();
    assert!(again.append("walk", epoch, 8, vec![event(9, 1)]).await.is_ok());
}

#[tokio::test]
async fn a_flipped_bit_anywhere_is_found_and_named() {
    let disk = closed().await;
    let (mut stopped, mut mended) = (0, 0);
    for (path, bytes) in disk.files() {
        // Every byte of a head, and some of the rest.
        let offsets = (0..bytes.len()).filter(|&at| at < 160 || at % 7 == 0);
        for at in offsets {
            let disk = disk.with_file(&path, |bytes| bytes[at] ^= 1 << (at % 8));
            let what = format!("{path} at {at}");
            let store = open(&disk).unwrap_or_else(|error| panic!("{what}: {error}"));
            let names = store.list_maps().await.unwrap();
            let lost_name = path.ends_with("/map") && names.len() == 1;
            assert!(lost_name || names == ["a", "b"], "{what}: {names:?}");
            let mut hurt = 0;
            for name in names {
                let (kind, last) = if name == "a" { (1, 20) } else { (3, 2) };
                let map = match stored(&store, &name).await {
                    Ok(map) => map,
                    // An unknown version: the file is not changed.
                    Err(StoreError::Content { .. }) => {
                        hurt += 1;
                        continue;
                    }
                    Err(error) => panic!("{what}: {error}"),
                };
                let revision = map.revision();
                assert_eq!(map.state_hash(), fold(revision, kind).state_hash(), "{what}");
                let damage = store.damage(&name).await.unwrap();
                hurt += usize::from(!damage.is_empty());
                if revision == last {
                    mended += usize::from(!damage.is_empty());
                    continue;
                }
                // What is missing is reported, and nothing is overwritten.
                let lost = damage.iter().find_map(|damage| damage.lost);
                let first = u64::try_from(revision).unwrap() + 1;
                let through = u64::try_from(last).unwrap();
                let told = lost.is_some_and(|(from, to)| from == first && to <= through);
                assert!(told, "{what}: at {revision} of {last}, told {damage:?}");
                let epoch = store.acquire(&name).await.unwrap();
                let next = vec![event(revision + 1, kind)];
                let refused = store.append(&name, epoch, first - 1, next).await;
                assert!(matches!(refused, Err(StoreError::Damaged { .. })), "{what}: {refused:?}");
                stopped += 1;
            }
            assert!(hurt <= 1, "{what}: damage in one file hurts one map");
        }
    }
    assert!(stopped > 20 && mended > 20, "{stopped} stopped, {mended} mended");
}

#[tokio::test]
async fn a_lost_file_is_named() {
    let whole = closed().await;
    let mut logs: Vec<String> = whole.files().into_iter().map(|(path, _)| path).collect();
    logs.retain(|path| path.ends_with(".log"));
    for path in logs {
        let disk = whole.with_file(&path, Vec::clear);
        let store = open(&disk).unwrap();
        for (name, kind, last) in [("a", 1, 20), ("b", 3, 2)] {
            let map = stored(&store, name).await.unwrap();
            assert_eq!(map.state_hash(), fold(map.revision(), kind).state_hash(), "{path}");
            let damage = store.damage(name).await.unwrap();
            let told = damage.iter().any(|damage| damage.lost.is_some());
            assert_eq!(told, map.revision() < last, "{path}: {damage:?}");
        }
    }
}

#[tokio::test]
async fn both_snapshots_gone_is_told() {
    let disk = closed().await;
    let mut hurt = disk.clone();
    for (path, _) in disk.files().iter().filter(|(path, _)| path.ends_with(".snap")) {
        hurt = hurt.with_file(path, |bytes| bytes.truncate(bytes.len() / 2));
    }
    let store = open(&hurt).unwrap();
    store.acquire("a").await.unwrap();
    let damage = store.damage("a").await.unwrap();
    assert!(damage.iter().any(|damage| damage.lost.is_some_and(|(first, _)| first == 1)));
    assert!(store.get_snapshot("a").await.unwrap().is_none());
}

/// A window is allocated before anything is decompressed, whatever the file contains.
#[test]
fn a_snapshot_that_asks_for_a_wide_window_is_refused() {
    let compressed = |window| {
        let mut encoder = zstd::Encoder::new(Vec::new(), 3).unwrap();
        encoder.window_log(window).unwrap();
        encode_map(&fold(3, 1), &mut encoder).unwrap();
        sealed(Kind::Snapshot, &[7; 16], 3, &encoder.finish().unwrap())
    };
    assert!(read_snapshot(&mut &*compressed(21)).is_ok());
    assert!(read_snapshot(&mut &*compressed(25)).is_err());
}
