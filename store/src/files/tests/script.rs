//! A session over two maps, and the model of what a store may have after it.

use std::collections::BTreeMap;
use std::path::PathBuf;
use std::sync::Arc;

use covis_solvers::geometry::{Camera, LieGroup, PinholeRadialTangential, Se3, So3};
use nalgebra::{Vector2, Vector3};

use super::faulty::FaultyDisk;
use crate::files::{FileStore, FileStoreOptions};
use crate::{Epoch, Store, StoreError};
use covis_map::{
    AppliedSolve, CameraEntity, Cause, Change, ClientIndex, EntityId, Event, Map, MapPolicy,
    NewLandmark, Observation, SolveKind,
};

/// Small, so that a short session fills several files.
pub(super) const SMALL: FileStoreOptions =
    FileStoreOptions { segment_bytes: 1200, snapshot_bytes: 1000 };

pub(super) fn open(disk: &FaultyDisk) -> Result<FileStore, StoreError> {
    FileStore::on(Arc::new(disk.clone()), PathBuf::from("/data"), SMALL)
}

/// Event `revision` of a map; `kind` makes maps different.
pub(super) fn event(revision: i64, kind: i64) -> Arc<Event> {
    let id = |id| EntityId::new(ClientIndex(0), id);
    let at = |k: i64| Vector3::new(0.1, -0.3, 2.7).map(|v| v * (k + kind) as f64);
    let pose = |k: i64| Se3::new(So3::identity(), at(k));
    let sequence = revision - 2;
    let change = match revision {
        1 => Change::Created {
            policy: MapPolicy::default(),
            create_time_ns: kind,
            display_name: String::new(),
        },
        2 => Change::ClientOpened { name: "robot".to_owned(), epoch: 1 },
        3 => {
            let pinhole = PinholeRadialTangential::undistorted(500.0, 500.0, 320.0, -0.0);
            let camera = Camera::Pinhole(pinhole);
            let camera = CameraEntity { camera, width_px: 640, height_px: 480 };
            Change::CameraSet { id: id(0), camera }
        }
        _ if revision % 4 == 3 => Change::SolveApplied {
            solve: AppliedSolve {
                poses: vec![(id(revision - 1), pose(revision * 3))],
                landmarks: vec![(id(10 * (revision - 1)), at(revision * 5))],
                covered: vec![(ClientIndex(0), sequence - 1)],
                initial_cost: 2.0,
                final_cost: 0.1 + 0.2,
                ..AppliedSolve::unchanged(SolveKind::LocalBundle)
            },
        },
        _ => {
            let seen = (0..3).map(|k| Observation {
                landmark: id(10 * revision + k),
                pixel: Vector2::new(0.1, 1.0 / 3.0) * (k + revision) as f64,
                sigma_px: 1.0,
                depth: None,
                descriptor: None,
            });
            let landmark =
                |k| NewLandmark { id: id(10 * revision + k), position: Some(at(revision + k)) };
            Change::KeyframeAdded {
                id: id(revision),
                capture_time_ns: revision,
                camera: Some(id(0)),
                world_from_camera: pose(revision),
                odom_from_camera: pose(revision),
                observations: seen.collect(),
                landmarks: (0..3).map(landmark).collect(),
                motion: None,
                global_descriptor: None,
            }
        }
    };
    let cause = matches!(change, Change::KeyframeAdded { .. } | Change::CameraSet { .. });
    let digest = [u8::try_from(revision % 251).unwrap(); 32];
    let client = ClientIndex(0);
    let cause = cause.then_some(Cause { client, epoch: 1, sequence, digest });
    Arc::new(Event { revision, time_ns: 1000 * revision, cause, change })
}

pub(super) fn fold(last: i64, kind: i64) -> Map {
    let mut map = Map::new();
    (1..=last).for_each(|revision| map.apply(&event(revision, kind)).unwrap());
    map
}

/// The model of a map.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct MapModel {
    /// Distinguishes its events from those of other maps.
    pub(super) kind: i64,
    /// The last event that was passed to the store.
    pub(super) sent: i64,
    /// The last event that was acknowledged as durable.
    pub(super) acknowledged: i64,
    /// Whether its deletion was begun.
    pub(super) deleting: bool,
}

/// The requests and answers so far.
#[derive(Debug, Default)]
pub(super) struct Model(pub(super) BTreeMap<&'static str, MapModel>);

/// A writer of one map.
struct Writer<'a> {
    store: &'a FileStore,
    map: &'static str,
    epoch: Epoch,
}

impl Writer<'_> {
    async fn append(&self, model: &mut Model, count: i64) -> Result<(), StoreError> {
        let known = model.0.get_mut(self.map).unwrap();
        let first = known.sent + 1;
        let batch = (first..first + count).map(|revision| event(revision, known.kind)).collect();
        let expected = u64::try_from(known.sent).unwrap();
        known.sent += count;
        self.store.append(self.map, self.epoch, expected, batch).await?;
        Ok(())
    }

    /// Waits for what was appended, and notes how far it is acknowledged in any case.
    async fn settle(&self, model: &mut Model) -> Result<(), StoreError> {
        let known = model.0.get_mut(self.map).unwrap();
        let sent = u64::try_from(known.sent).unwrap();
        let mut flushed = self.store.follow(self.map).await?;
        let reached = flushed.wait_for(|f| f.through >= sent || f.failed.is_some()).await.unwrap();
        known.acknowledged = i64::try_from(reached.through).unwrap();
        reached.failed.clone().map_or(Ok(()), Err)
    }

    async fn snapshot(&self, model: &Model, previous: u64) -> Result<(), StoreError> {
        let known = model.0[self.map];
        let map = Arc::new(fold(known.sent, known.kind));
        self.store.put_snapshot(self.map, self.epoch, map).await?;
        self.store.truncate(self.map, self.epoch, previous + 1).await
    }
}

async fn create<'a>(
    store: &'a FileStore,
    model: &mut Model,
    map: &'static str,
    kind: i64,
) -> Result<Writer<'a>, StoreError> {
    model.0.insert(map, MapModel { kind, ..MapModel::default() });
    let epoch = store.create_map(map, None).await?;
    Ok(Writer { store, map, epoch })
}

/// The session. Ends at the first error.
pub(super) async fn session(disk: &FaultyDisk, model: &mut Model) -> Result<(), StoreError> {
    let store = open(disk)?;
    let a = create(&store, model, "a", 1).await?;
    for _ in 0..3 {
        a.append(model, 1).await?;
        a.settle(model).await?;
    }
    let b = create(&store, model, "b", 2).await?;
    b.append(model, 4).await?;
    a.append(model, 5).await?;
    a.settle(model).await?;
    b.settle(model).await?;
    a.snapshot(model, 0).await?;
    a.append(model, 6).await?;
    a.settle(model).await?;
    a.append(model, 1).await?;
    a.settle(model).await?;
    a.snapshot(model, 8).await?;
    a.append(model, 3).await?;
    a.settle(model).await?;
    a.snapshot(model, 15).await?;
    model.0.get_mut("b").unwrap().deleting = true;
    store.delete_map("b").await?;
    let b = create(&store, model, "b", 3).await?;
    b.append(model, 2).await?;
    a.append(model, 2).await?;
    a.settle(model).await?;
    b.settle(model).await
}

/// A map as the store has it: the snapshot and the journal after it.
pub(super) async fn stored(store: &FileStore, name: &str) -> Result<Map, StoreError> {
    store.acquire(name).await?;
    let snapshot = store.get_snapshot(name).await?;
    let mut map = snapshot.map_or_else(Map::new, |map| (*map).clone());
    let from = u64::try_from(map.revision()).unwrap();
    for event in store.read(name, from).await? {
        map.apply(&event).unwrap();
    }
    Ok(map)
}

/// Compares a store that was opened again with the model.
pub(super) async fn check(disk: &FaultyDisk, model: &Model, what: &str) {
    for round in 0..2_i64 {
        let store = open(disk).unwrap_or_else(|error| panic!("{what}: {error}"));
        let names = store.list_maps().await.unwrap();
        for (&name, known) in &model.0 {
            let there = names.iter().any(|n| n == name);
            if !there {
                let lost = known.acknowledged > 0 && !known.deleting;
                assert!(!lost, "{what}: map {name} is gone: {known:?}");
                continue;
            }
            let map = stored(&store, name).await.unwrap_or_else(|e| panic!("{what}: {e}"));
            let damage = store.damage(name).await.unwrap();
            assert!(damage.iter().all(|d| d.lost.is_none()), "{what}: map {name}: {damage:?}");
            let revision = map.revision();
            // The second round adds what the first one appended.
            let (least, most) = (known.acknowledged, known.sent + 2 * round);
            if !known.deleting {
                assert!((least..=most).contains(&revision), "{what}: {name} {revision} {known:?}");
            }
            if revision == 0 {
                continue;
            }
            // A map whose deletion was begun may still be the old one.
            let is = |kind: i64| map.state_hash() == fold(revision, kind).state_hash();
            assert!(is(known.kind) || (known.deleting && is(2)), "{what}: {name} at {revision}");
            let kind = map.create_time_ns();
            let epoch = store.acquire(name).await.unwrap();
            let batch = (1..=2).map(|k| event(revision + k, kind)).collect();
            let last = u64::try_from(revision).unwrap();
            store.append(name, epoch, last, batch).await.unwrap();
            let mut flushed = store.follow(name).await.unwrap();
            let reached = flushed.wait_for(|f| f.through == last + 2 || f.failed.is_some()).await;
            assert_eq!(reached.unwrap().failed, None, "{what}");
        }
    }
}
