//! Merging and undoing while the store holds calls up, fails, or has a full disk.

use std::sync::Arc;

use covis::map::{ConstraintKind, EntityRef, Item, MapPolicy, MergeError};
use covis::service::engine::{
    AccountLimits, Accounts, AckStatus, EngineConfig, EngineError, MapHandle, MapState, Maps,
    MergeOutcome, MergeRequest, Resource, SolverPool,
};
use covis::store::{Flushed, MemoryStore, Store, StoreError};
use covis_solvers::geometry::{LieGroup, Se3};
use covis_solvers::interrupt::Interrupt;

use super::Client;
use super::maps::HeldStore;

/// The maps "floor" and "run", with a robot's keyframes each.
async fn two_maps(store: &Arc<HeldStore>) -> Maps {
    let maps = store.maps().await;
    store.release(2);
    fill(&maps).await;
    store.entered().await;
    store.entered().await;
    maps
}

async fn fill(maps: &Maps) {
    for (map, robot) in [("floor", "a"), ("run", "b")] {
        maps.create(map, "", MapPolicy::default()).await.unwrap();
        street(&maps.get(map).unwrap(), robot).await;
    }
}

async fn street(map: &MapHandle, robot: &str) {
    let mut client = Client::open_as(map, robot).await;
    client.send_street(0..3).await;
    client.finish().await;
}

fn request() -> MergeRequest {
    MergeRequest {
        target: "floor".to_owned(),
        source: "run".to_owned(),
        target_from_source: Some(Se3::identity()),
        ..MergeRequest::default()
    }
}

async fn merge(maps: &Maps) -> Result<MergeOutcome, EngineError> {
    maps.merge(request(), Interrupt::at(None)).await
}

/// "run" is part of "floor".
async fn merged(store: &Arc<HeldStore>) -> Maps {
    let maps = two_maps(store).await;
    store.release(1);
    merge(&maps).await.unwrap();
    store.entered().await;
    maps
}

async fn open(map: &MapHandle) -> Result<i64, EngineError> {
    let stream = map.open_stream("b".to_owned(), 0, false).await?;
    Ok(stream.opened.next_sequence)
}

/// The disk under "floor" is full from here on, or it is not.
async fn set_full(store: &HeldStore, maps: &Maps, is_full: bool) {
    let through = maps.get("floor").unwrap().snapshot().await.unwrap().revision();
    let (map, cause) = ("floor".to_owned(), "staged by a test".to_owned());
    let flushed = match is_full {
        true => Flushed {
            through: u64::try_from(through).unwrap(),
            unavailable: Some(StoreError::Unavailable { map: map.clone(), cause }),
            ..Flushed::default()
        },
        false => Flushed { through: u64::MAX, ..Flushed::default() },
    };
    store.disk.send_replace((map, flushed));
}

/// A store whose disk under "floor" can become full.
fn with_disk() -> Arc<HeldStore> {
    let store = HeldStore::new();
    let flushed = Flushed { through: u64::MAX, ..Flushed::default() };
    store.disk.send_replace(("floor".to_owned(), flushed));
    store
}

/// Both names lead to one map, which has the content of both once.
async fn is_one(maps: &Maps) {
    assert_eq!(maps.list().len(), 1);
    let run = maps.get("run").unwrap();
    assert_eq!(run.name(), "floor");
    assert_eq!(run.snapshot().await.unwrap().keyframes().len(), 6);
    assert_eq!(open(&run).await.unwrap(), 5);
}

fn is_moving<T: std::fmt::Debug>(answer: &Result<T, EngineError>) -> bool {
    matches!(answer, Err(EngineError::Moving { map }) if map == "run")
}

#[tokio::test]
async fn a_merge_that_a_full_disk_cut_off_is_finished_by_the_next_call() {
    let store = with_disk();
    let maps = two_maps(&store).await;
    set_full(&store, &maps, true).await;
    let failed = merge(&maps).await;
    let unavailable = matches!(&failed, Err(EngineError::Store(StoreError::Unavailable { .. })));
    assert!(unavailable, "{failed:?}");
    // What the robot sent now would be in the copy that is to go.
    let waits = open(&maps.get("run").unwrap()).await;
    assert!(is_moving(&waits), "{waits:?}");
    set_full(&store, &maps, false).await;
    store.release(1);
    merge(&maps).await.unwrap();
    is_one(&maps).await;
}

#[tokio::test]
async fn a_merge_whose_source_could_not_be_deleted_is_finished_by_the_next_call() {
    let store = HeldStore::new();
    let maps = two_maps(&store).await;
    store.failing.add_permits(1);
    store.release(2);
    let failed = merge(&maps).await;
    assert!(matches!(failed, Err(EngineError::Store(_))), "{failed:?}");
    merge(&maps).await.unwrap();
    is_one(&maps).await;
}

#[tokio::test]
async fn a_source_goes_on_when_the_target_that_has_its_content_is_deleted() {
    let store = HeldStore::new();
    let maps = two_maps(&store).await;
    store.failing.add_permits(1);
    store.release(2);
    merge(&maps).await.unwrap_err();
    maps.delete("floor").await.unwrap();
    assert_eq!(open(&maps.get("run").unwrap()).await.unwrap(), 5);
}

#[tokio::test]
async fn a_merge_that_is_refused_leaves_a_map_that_takes_items_and_nothing_in_its_journal() {
    let store = HeldStore::new();
    let maps = two_maps(&store).await;
    let (run, floor) = (maps.get("run").unwrap(), maps.get("floor").unwrap());
    let mut client = Client::open_as(&floor, "b").await;
    client.send(crate::map_support::camera_item(0)).await;
    client.finish().await;
    let mut robot = Client::open_as(&run, "b").await;
    let before = run.snapshot().await.unwrap().revision();
    let refused = merge(&maps).await;
    let in_both = EngineError::CannotMerge {
        map: "run".to_owned(),
        error: MergeError::ClientInBoth { client: "b".to_owned() },
    };
    assert_eq!(refused.unwrap_err(), in_both);
    assert_eq!(run.snapshot().await.unwrap().revision(), before);
    // Its stream has not even ended.
    let sequence = robot.send(crate::map_support::camera_item(9)).await;
    let ack = robot.received(sequence).await;
    assert!(matches!(ack.status, AckStatus::Received { duplicate: false }), "{ack:?}");
}

#[tokio::test]
async fn a_robot_at_work_that_has_sent_nothing_is_not_taken_for_another_one() {
    let store = HeldStore::new();
    let maps = two_maps(&store).await;
    let _at_work = Client::open_as(&maps.get("floor").unwrap(), "b").await;
    let refused = merge(&maps).await;
    let in_both = EngineError::CannotMerge {
        map: "run".to_owned(),
        error: MergeError::ClientInBoth { client: "b".to_owned() },
    };
    assert_eq!(refused.unwrap_err(), in_both);
    assert_eq!(open(&maps.get("run").unwrap()).await.unwrap(), 5);
}

#[tokio::test]
async fn a_merge_that_is_larger_than_what_may_wait_for_the_disk_is_refused() {
    let server = AccountLimits::default().with(Resource::JournalBytes, 1000);
    let accounts = Accounts::new(server, AccountLimits::default(), AccountLimits::default());
    let pool = SolverPool::shared_by(accounts, 1).unwrap();
    let store = Arc::new(MemoryStore::new());
    let maps = Maps::open(store, pool, EngineConfig::default()).await.unwrap();
    fill(&maps).await;
    let full = EngineError::ServerLimit { limit: "max_journal_bytes", maximum: 1000 };
    assert_eq!(merge(&maps).await.unwrap_err(), full);
    assert_eq!(open(&maps.get("run").unwrap()).await.unwrap(), 5);
}

/// Two robots of the source know each other by the names that they had.
#[tokio::test]
async fn a_robot_by_the_old_name_names_the_others_of_its_map_as_before() {
    let store = HeldStore::new();
    let maps = two_maps(&store).await;
    // Of the same name as the one of the target.
    street(&maps.get("run").unwrap(), "a").await;
    let renamed = [("a".to_owned(), "a-run".to_owned())].into();
    store.release(1);
    maps.merge(MergeRequest { renamed, ..request() }, Interrupt::at(None)).await.unwrap();
    let run = maps.get("run").unwrap();
    let mut robot = Client::open_as(&run, "b").await;
    let mut pose =
        crate::map_support::relative_pose(50, ConstraintKind::LoopClosure, 0, 2, Se3::identity());
    if let Item::RelativePose { keyframe_j, .. } = &mut pose {
        *keyframe_j = EntityRef { client: Some("a".to_owned()), id: 2 };
    }
    let sequence = robot.send(pose).await;
    robot.received(sequence).await;
    let map = run.snapshot().await.unwrap();
    let of = |name: &str| map.client_named(name).unwrap();
    let (_, added) = map.constraints().iter().find(|(id, _)| id.id == 50).unwrap();
    assert_eq!((added.keyframe_i.client, added.keyframe_j.client), (of("b"), of("a-run")));
    // A watch would tell it of "a", which is another one here.
    let refused = run.watch(None).await.map(drop);
    assert!(matches!(refused, Err(EngineError::MergedAway { .. })), "{refused:?}");
    maps.get("floor").unwrap().watch(None).await.unwrap();
}

/// A delta cannot say that cameras went.
#[tokio::test]
async fn a_watcher_gets_the_full_state_when_a_map_leaves() {
    let store = HeldStore::new();
    let maps = merged(&store).await;
    let mut watch = maps.get("floor").unwrap().watch(None).await.unwrap();
    assert!(watch.next().await.unwrap().reset);
    store.release(1);
    maps.undo_merge("floor", "run").await.unwrap();
    let mut has_reset = false;
    loop {
        let change = watch.next().await.unwrap();
        has_reset |= change.reset;
        if change.snapshot.merged().is_empty() {
            break;
        }
    }
    assert!(has_reset);
}

/// A server that died between the event of the target and the deletion of the source.
#[tokio::test]
async fn the_rest_of_a_merge_stays_until_the_target_is_on_the_disk() {
    let store = with_disk();
    let maps = two_maps(&store).await;
    set_full(&store, &maps, true).await;
    merge(&maps).await.unwrap_err();
    let maps = store.maps().await;
    assert_eq!(store.memory.list_maps().await.unwrap(), ["floor", "run"]);
    let waits = open(&maps.get("run").unwrap()).await;
    assert!(is_moving(&waits), "{waits:?}");
    set_full(&store, &maps, false).await;
    store.release(1);
    let maps = store.maps().await;
    assert_eq!(store.memory.list_maps().await.unwrap(), ["floor"]);
    is_one(&maps).await;
}

#[tokio::test]
async fn a_robot_that_comes_by_the_old_name_while_its_map_leaves_is_told_to_come_again() {
    let store = HeldStore::new();
    let maps = merged(&store).await;
    let by_name = maps.get("run").unwrap();
    let undo = tokio::spawn({
        let maps = maps.clone();
        async move { maps.undo_merge("floor", "run").await }
    });
    store.entered().await;
    // Both wait for the engine, which waits for the store.
    let (opening, watching) = (open(&by_name), by_name.watch(None));
    let release = async { store.release(1) };
    let (opened, watched, ()) = tokio::join!(opening, watching, release);
    assert!(is_moving(&opened), "{opened:?}");
    assert!(is_moving(&watched.map(drop)));
    undo.await.unwrap().unwrap();
    assert_eq!(open(&maps.get("run").unwrap()).await.unwrap(), 5);
}

#[tokio::test]
async fn a_target_is_not_deleted_while_a_map_leaves_it() {
    let store = HeldStore::new();
    let maps = merged(&store).await;
    let undo = tokio::spawn({
        let maps = maps.clone();
        async move { maps.undo_merge("floor", "run").await }
    });
    store.entered().await;
    let delete = tokio::spawn({
        let maps = maps.clone();
        async move { maps.delete("floor").await }
    });
    store.release(2);
    undo.await.unwrap().unwrap();
    delete.await.unwrap().unwrap();
    assert_eq!(maps.get("run").unwrap().snapshot().await.unwrap().keyframes().len(), 3);
}

#[tokio::test]
async fn an_undo_waits_for_a_full_disk_and_a_crash_meanwhile_leaves_two_open_maps() {
    let store = with_disk();
    let maps = merged(&store).await;
    set_full(&store, &maps, true).await;
    let undo = tokio::spawn({
        let maps = maps.clone();
        async move { maps.undo_merge("floor", "run").await }
    });
    store.entered().await;
    store.release(1);
    let floor = maps.get("floor").unwrap();
    while !floor.snapshot().await.unwrap().merged().is_empty() {
        tokio::task::yield_now().await;
    }
    // The store as it is now, under another server.
    let after = HeldStore::new();
    for name in ["floor", "run"] {
        let snapshot = match name {
            "floor" => floor.snapshot().await.unwrap(),
            _ => store.memory.get_snapshot(name).await.unwrap().unwrap(),
        };
        after.memory.create_map(name, Some(snapshot)).await.unwrap();
    }
    let restarted = after.maps().await;
    for name in ["floor", "run"] {
        let info = restarted.get(name).unwrap().info().await.unwrap();
        let found = (info.name.as_str(), info.state, info.snapshot.keyframes().len());
        assert_eq!(found, (name, MapState::Open, 3));
    }
    assert!(!undo.is_finished());
    set_full(&store, &maps, false).await;
    let (_, run) = undo.await.unwrap().unwrap();
    assert_eq!((run.name.as_str(), run.state), ("run", MapState::Open));
}

/// What a failed creation left is made way for only where nothing is in it.
#[tokio::test]
async fn a_map_with_content_that_has_no_engine_is_not_deleted_by_a_creation() {
    let store = HeldStore::new();
    let maps = two_maps(&store).await;
    let content = maps.get("run").unwrap().snapshot().await.unwrap();
    store.memory.create_map("lost", Some(content)).await.unwrap();
    store.release(1);
    let refused = maps.create("lost", "", MapPolicy::default()).await;
    assert!(matches!(refused, Err(EngineError::MapExists { .. })), "{refused:?}");
    assert!(store.memory.get_snapshot("lost").await.unwrap().is_some());
}
