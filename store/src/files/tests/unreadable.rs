//! Events whose bytes are intact and which cannot be read: a journal opens up to them, nothing of it
//! changes, and the doctor cuts it only when that is asked for.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use covis_solvers::geometry::{LieGroup, Se3};
use covis_solvers::information::Information;
use nalgebra::Vector6;

use super::script::{SMALL, event, fold, stored};
use crate::encoding::{encode_event, encode_identity};
use crate::files::record::{header, put_record};
use crate::files::sealed::{Kind, sealed, sealed_map};
use crate::files::{FileStore, Repair, check_up};
use crate::{Store, StoreError};
use covis_map::{Change, ClientIndex, Constraint, ConstraintKind, EntityId, Event};

const UID: [u8; 16] = [7; 16];
/// The event that cannot be read, and the last one.
const BAD: i64 = 8;
const LAST: i64 = 10;

fn constraint() -> Constraint {
    let id = |id| EntityId::new(ClientIndex(0), id);
    Constraint {
        kind: ConstraintKind::LoopClosure,
        keyframe_i: id(4),
        keyframe_j: id(6),
        keyframe_i_from_keyframe_j: Se3::identity(),
        information: Information::identity(),
        loss: None,
    }
}

/// A constraint whose information no constructor takes.
fn impossible_constraint() -> Vec<u8> {
    let id = EntityId::new(ClientIndex(0), 1);
    let change = Change::ConstraintAdded { id, constraint: constraint() };
    let mut payload = Vec::new();
    encode_event(&Event { revision: BAD, time_ns: 8000, cause: None, change }, &mut payload);
    let one = 1.0_f64.to_le_bytes();
    let at = payload.windows(8).rposition(|window| window == one).unwrap();
    payload[at..at + 8].copy_from_slice(&(-1.0_f64).to_le_bytes());
    payload
}

/// An event with a field that no version knows yet.
fn later_event() -> Vec<u8> {
    let mut payload = Vec::new();
    encode_event(&event(BAD, 1), &mut payload);
    payload.extend([0xe0, 0x03, 0x01]);
    payload
}

/// A data directory with the map "walk" of ten events; the eighth has other bytes.
fn left(folder: &Path, bad: &[u8]) -> PathBuf {
    let map = folder.join("maps").join("07".repeat(16));
    fs_err::create_dir_all(&map).unwrap();
    let mut journal = header(&UID, 1);
    for revision in 1..=LAST {
        let mut payload = Vec::new();
        encode_event(&event(revision, 1), &mut payload);
        let payload = if revision == BAD { bad } else { &payload };
        let sequence = revision as u64;
        assert!(put_record(&mut journal, &UID, sequence, sequence - 1, payload));
    }
    fs_err::write(map.join("00000000000000000001.log"), &journal).unwrap();
    let identity = sealed(Kind::Identity, &UID, 0, &encode_identity("walk"));
    fs_err::write(map.join("map"), &identity).unwrap();
    map
}

fn journals(map: &Path) -> BTreeMap<PathBuf, Vec<u8>> {
    let paths = fs_err::read_dir(map).unwrap().map(|entry| entry.unwrap().path());
    let logs = paths.filter(|path| path.extension().is_some_and(|extension| extension == "log"));
    logs.map(|path| (path.clone(), fs_err::read(path).unwrap())).collect()
}

#[tokio::test]
async fn a_journal_opens_up_to_the_event_that_cannot_be_read_and_takes_no_more() {
    for (bad, kind, reason) in [
        (impossible_constraint(), "constraint_added", "an information matrix"),
        (later_event(), "solve_applied", "a later version"),
        (vec![0xff; 30], "unknown", "not a message"),
    ] {
        let folder = tempfile::tempdir().unwrap();
        let map = left(folder.path(), &bad);
        let before = journals(&map);
        let store = FileStore::open(folder.path(), SMALL).await.unwrap();
        let read = stored(&store, "walk").await.unwrap();
        let epoch = store.acquire("walk").await.unwrap();
        assert_eq!(read.state_hash(), fold(BAD - 1, 1).state_hash());
        let damage = store.damage("walk").await.unwrap();
        assert_eq!(damage.len(), 1, "{damage:?}");
        let unreadable = damage[0].unreadable.as_ref().unwrap();
        // A later version's event is named as far as this one knows it.
        assert!(unreadable.kind == kind || reason == "a later version", "{damage:?}");
        assert!(unreadable.reason.contains(reason), "{damage:?}");
        assert_eq!((unreadable.sequence, damage[0].lost), (8, Some((8, 10))));
        let refused = store.append("walk", epoch, 7, vec![event(BAD, 1)]).await.unwrap_err();
        assert!(matches!(refused, StoreError::Damaged { .. }), "{refused}");
        assert!(refused.to_string().contains(reason), "{refused}");
        store.close().await;
        assert_eq!(journals(&map), before, "its files stay as they are");
    }
}

#[tokio::test]
async fn a_snapshot_behind_the_event_makes_it_harmless() {
    let folder = tempfile::tempdir().unwrap();
    let map = left(folder.path(), &impossible_constraint());
    fs_err::write(map.join("00000000000000000009.snap"), sealed_map(&UID, &fold(9, 1))).unwrap();
    let told = check_up(folder.path(), Repair::No).unwrap();
    assert_eq!((told[0].revision, told[0].unreadable.len()), (10, 0), "{told:?}");
    assert!(told[0].damage[0].lost.is_none() && told[0].damage[0].unreadable.is_some(), "{told:?}");
    let store = FileStore::open(folder.path(), SMALL).await.unwrap();
    assert_eq!(stored(&store, "walk").await.unwrap().state_hash(), fold(10, 1).state_hash());
    let epoch = store.acquire("walk").await.unwrap();
    store.append("walk", epoch, 10, vec![event(11, 1)]).await.unwrap();
    // A reader of the history does not make the map read-only.
    assert_eq!(store.read("walk", 5).await.unwrap().len(), 2);
    store.append("walk", epoch, 11, vec![event(12, 1)]).await.unwrap();
    store.close().await;
}

#[tokio::test]
async fn the_doctor_cuts_a_journal_only_on_request_and_lists_what_goes() {
    let folder = tempfile::tempdir().unwrap();
    let map = left(folder.path(), &impossible_constraint());
    let before = journals(&map);
    for repair in [Repair::No, Repair::Damage] {
        let told = check_up(folder.path(), repair).unwrap();
        assert_eq!((told[0].revision, told[0].set_aside.len()), (7, 0), "{told:?}");
        let goes: Vec<_> =
            told[0].unreadable.iter().map(|l| (l.event.revision, l.event.kind)).collect();
        let kinds = ["constraint_added", "keyframe_added", "keyframe_added"];
        assert_eq!(goes, (8..).zip(kinds).collect::<Vec<_>>());
        assert_eq!(told[0].unreadable[1].client.as_deref(), Some("robot"));
        let advice =
            told[0].failure.as_ref().map(|failure| failure.contains("--cut gives up its last 3"));
        assert_eq!(advice, (repair == Repair::Damage).then_some(true), "{told:?}");
        assert_eq!(journals(&map), before);
    }
    let cut = check_up(folder.path(), Repair::Cut).unwrap();
    assert_eq!((cut[0].failure.as_ref(), cut[0].unreadable.len()), (None, 3), "{cut:?}");
    let aside = fs_err::read(&cut[0].set_aside[0]).unwrap();
    assert!(before.values().any(|bytes| *bytes == aside), "nothing is deleted");
    let again = check_up(folder.path(), Repair::No).unwrap();
    assert!(!again[0].is_damaged(), "{again:?}");
    let store = FileStore::open(folder.path(), SMALL).await.unwrap();
    assert_eq!(stored(&store, "walk").await.unwrap().state_hash(), fold(7, 1).state_hash());
    let epoch = store.acquire("walk").await.unwrap();
    store.append("walk", epoch, 7, vec![event(8, 1)]).await.unwrap();
    store.close().await;
}

#[test]
fn what_a_later_version_wrote_is_not_cut() {
    let folder = tempfile::tempdir().unwrap();
    let map = left(folder.path(), &later_event());
    let before = journals(&map);
    let told = check_up(folder.path(), Repair::Cut).unwrap();
    let failure = told[0].failure.as_deref().unwrap_or_default();
    assert!(failure.contains("a later version wrote event 8"), "{told:?}");
    assert_eq!(journals(&map), before);
}

#[tokio::test]
async fn an_event_that_could_not_be_read_again_is_not_journaled() {
    let folder = tempfile::tempdir().unwrap();
    let store = FileStore::open(folder.path(), SMALL).await.unwrap();
    let epoch = store.create_map("walk", None).await.unwrap();
    let first = (1..=6).map(|revision| event(revision, 1)).collect();
    store.append("walk", epoch, 0, first).await.unwrap();
    // Rounding among the least numbers makes a singular matrix indefinite, which no constructor takes.
    let direction = Vector6::new(0.6, -0.3, 0.2, 0.1, 0.5, 0.4);
    let singular = Information::semidefinite(&(direction * direction.transpose())).unwrap();
    let constraint = Constraint { information: singular.scaled(3e-322), ..constraint() };
    let change = Change::ConstraintAdded { id: EntityId::new(ClientIndex(0), 1), constraint };
    let bad = Arc::new(Event { revision: 7, time_ns: 0, cause: None, change });
    let refused = store.append("walk", epoch, 6, vec![bad]).await.unwrap_err();
    let kind = "constraint_added";
    assert!(matches!(&refused, StoreError::NotReadable { kind: k, .. } if *k == kind), "{refused}");
    // The journal is as it was.
    store.append("walk", epoch, 6, vec![event(7, 1)]).await.unwrap();
    store.close().await;
    let store = FileStore::open(folder.path(), SMALL).await.unwrap();
    assert_eq!(stored(&store, "walk").await.unwrap().state_hash(), fold(7, 1).state_hash());
}
