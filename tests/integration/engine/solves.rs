//! Solves beside the stream: coalesced, superseded, in lock-step, on request.

use covis::map::{ConstraintKind, EntityRef, Item, ItemLandmark, Map, MapPolicy, SolveKind};
use covis::service::engine::{
    AckStatus, EngineConfig, EngineError, OptimizeOptions, SolveReport, SolveStep,
};
use covis::store::Store;
use covis_solvers::geometry::{LieGroup, Se3};
use futures_util::FutureExt;
use tokio::sync::mpsc;

use super::{Client, Fixture, noisy_keyframe, noisy_pose, open, optimized};
use crate::common::{Occupied, hold, large};
use crate::map_support::{
    camera_item, corner, id, observe, pose_at, relative_pose, street_keyframe,
};

fn closure(item_id: i64, i: i64, j: i64) -> Item {
    let measured: Se3 = pose_at((j - i) as f64);
    relative_pose(item_id, ConstraintKind::LoopClosure, i, j, measured)
}

#[tokio::test]
async fn keyframes_that_wait_get_the_windows_that_one_by_one_would_have() {
    let fixture = Fixture::plain().await;
    let map = fixture.map(MapPolicy::default()).await;
    let mut client = Client::open(&map).await;
    let blocker = Occupied::new(fixture.maps.pool()).await;
    client.send_street(0..5).await;
    // RECEIVED does not wait for solves.
    let mut acks = Vec::new();
    while acks.len() < 7 {
        acks.push(client.ack().await);
    }
    // The first keyframe alone is nothing to solve; the second one's window waits for the pool.
    assert_eq!(optimized(&acks), [(2, 0)]);
    drop(blocker);
    let each = (3..=6).zip(1..);
    assert_eq!(optimized(&client.finish().await), each.collect::<Vec<_>>());
    assert_eq!(fixture.solves().await, [SolveKind::LocalBundle; 4]);
}

#[tokio::test]
async fn keyframes_without_views_ask_for_no_window_and_a_burst_with_them_ends_as_one_by_one() {
    let fixture = Fixture::plain().await;
    let map = fixture.map(MapPolicy::default()).await;
    let mut client = Client::open(&map).await;
    let blocker = Occupied::new(fixture.maps.pool()).await;
    client.send_street(0..3).await;
    let sequence = client.send(without_views(noisy_keyframe(3))).await;
    client.send(noisy_keyframe(4)).await;
    client.received(sequence).await;
    drop(blocker);
    let acks = client.finish().await;
    // Keyframes 1, 2 and 4; the first one alone is nothing to solve, nor is the blind one.
    assert_eq!(fixture.solves().await, [SolveKind::LocalBundle; 3]);
    assert_eq!(optimized(&acks).last(), Some(&(sequence + 1, 3)));
    let burst = map.snapshot().await.unwrap();

    // One by one they end at the same place, and the blind one is nearer to the truth than it was sent.
    let fixture = Fixture::plain().await;
    let map = fixture.map(MapPolicy::default()).await;
    let mut client = Client::open(&map).await;
    client.send(camera_item(0)).await;
    for k in 0..5 {
        let item = if k == 3 { without_views(noisy_keyframe(k)) } else { noisy_keyframe(k) };
        let sequence = client.send(item).await;
        while optimized(&client.seen).last().is_none_or(|&(mark, _)| mark < sequence) {
            client.ack().await;
        }
    }
    let paced = map.snapshot().await.unwrap();
    let pose = |map: &Map, k| map.keyframes().get(&id(k)).unwrap().world_from_camera;
    for k in 0..5 {
        let apart = pose(&burst, k).minus(&pose(&paced, k)).norm();
        // Each solve ends within its tolerance.
        assert!(apart < 1e-6, "keyframe {k}: {apart}");
    }
    let truth: Se3 = pose_at(3.0);
    let error = |pose: &Se3| truth.minus(pose).fixed_rows::<3>(0).norm();
    assert!(error(&pose(&burst, 3)) < error(&noisy_pose(3)));
}

/// A keyframe that sees nothing.
fn without_views(mut keyframe: Item) -> Item {
    if let Item::Keyframe { observations, landmarks, .. } = &mut keyframe {
        observations.clear();
        landmarks.clear();
    }
    keyframe
}

#[tokio::test]
async fn a_window_that_runs_when_a_loop_closure_comes_keeps_its_result() {
    let fixture = Fixture::plain().await;
    // What follows a closure in the background may end before the solves are counted.
    let policy = MapPolicy { closure_adjustment: false, ..MapPolicy::default() };
    let map = fixture.map(policy).await;
    let mut client = Client::open(&map).await;
    let blocker = Occupied::new(fixture.maps.pool()).await;
    client.send_street(0..4).await;
    let sequence = client.send(closure(1, 0, 3)).await;
    client.received(sequence).await;
    drop(blocker);
    let acks = client.finish().await;
    // Solve 1 is the window, 2 the graph behind it on the same thread, 3 the window of the keyframes that
    // came meanwhile.
    assert_eq!(optimized(&acks).first(), Some(&(3, 1)));
    assert_eq!(optimized(&acks).last().map(|&(sequence, _)| sequence), Some(6));
    let mut solves = fixture.solves().await;
    assert_eq!(solves.remove(0), SolveKind::LocalBundle);
    assert!(solves.contains(&SolveKind::PoseGraph) && solves.contains(&SolveKind::LocalBundle));
    assert_eq!(fixture.replayed().await.state_hash(), map.snapshot().await.unwrap().state_hash());
}

/// The street's keyframes `ids` and a closure between the first and the last. `large` holds what follows.
async fn street_with_closure(client: &mut Client, keyframes: i64) {
    client.send_street(0..keyframes).await;
    while optimized(&client.seen).last().is_none_or(|&(mark, _)| mark <= keyframes) {
        client.ack().await;
    }
}

/// So many keyframes that a solve of the whole is a large one.
const MANY: i64 = 48;

#[tokio::test]
async fn windows_are_solved_while_a_pose_graph_and_an_adjustment_are_held() {
    let fixture = Fixture::plain().await;
    let map = fixture.map(MapPolicy::default()).await;
    let mut client = Client::open(&map).await;
    street_with_closure(&mut client, MANY).await;
    let mut other = Client::open_as(&map, "other").await;
    other.send_street(0..1).await;
    let pool = fixture.maps.pool();
    let release = hold(pool, large()).await;
    let sequence = client.send(closure(1, 0, MANY - 1)).await;
    client.received(sequence).await;
    let before = fixture.solves().await.len();
    // The pose graph waits behind what holds the threads of large solves.
    for k in 1..4 {
        let sequence = other.send(noisy_keyframe(k)).await;
        while optimized(&other.seen).last().is_none_or(|&(mark, _)| mark < sequence) {
            other.ack().await;
        }
    }
    assert_eq!(fixture.solves().await[before..], [SolveKind::LocalBundle; 3]);
    let first = map.snapshot().await.unwrap().keyframes().get(&id(0)).unwrap().world_from_camera;
    drop(release);
    while optimized(&client.seen).last().is_none_or(|&(mark, _)| mark < sequence) {
        client.ack().await;
    }
    // Of what follows, the comparison, the adjustment begins at once or is due.
    let mut settled = map.snapshot().await.unwrap();
    while settled.is_adjustment_due() {
        tokio::task::yield_now().await;
        settled = map.snapshot().await.unwrap();
    }
    assert_eq!(settled.keyframes().get(&id(0)).unwrap().world_from_camera, first);
    assert!(fixture.solves().await.contains(&SolveKind::Global));
    client.finish().await;
    other.finish().await;
    let map = map.snapshot().await.unwrap();
    assert_eq!(fixture.replayed().await.state_hash(), map.state_hash());
}

#[tokio::test]
async fn a_loop_closure_pulls_the_keyframes_and_is_certified() {
    let fixture = Fixture::lock_step().await;
    let policy = MapPolicy { local_bundle: false, ..MapPolicy::default() };
    let map = fixture.map(policy).await;
    let mut client = Client::open(&map).await;
    client.send_street(0..6).await;
    client.received(7).await;
    let before = map.snapshot().await.unwrap();
    let drifted = pose_at(5.2);
    client.send(relative_pose(1, ConstraintKind::LoopClosure, 0, 5, drifted)).await;
    let acks = client.finish().await;
    // Without local bundle adjustment the last keyframe has nothing to wait for.
    assert_eq!(optimized(&acks), [(7, 0), (8, 1)]);
    let Some(AckStatus::Optimized { outcome: SolveReport::Solved(certificate), .. }) =
        acks.last().map(|a| &a.status)
    else {
        panic!("{acks:?}")
    };
    assert!(certificate.after.total < certificate.before.total);
    assert_eq!((certificate.free_poses, certificate.fixed_poses), (5, 1));
    let after = map.snapshot().await.unwrap();
    let x = |m: &Map, k| m.keyframes().get(&id(k)).unwrap().world_from_camera.translation.x;
    assert!((x(&after, 5) - 5.2).abs() < (x(&before, 5) - 5.2).abs());
    // A landmark moves with its first observer.
    let seen = id(65);
    let moved = after.landmarks().get(&seen).unwrap().position
        != before.landmarks().get(&seen).unwrap().position;
    assert!(moved);
}

#[tokio::test]
async fn a_false_closure_is_switched_off_and_replay_gives_the_same_bits() {
    let fixture = Fixture::lock_step().await;
    let map = fixture.map(MapPolicy::default()).await;
    let mut client = Client::open(&map).await;
    client.send_street(0..12).await;
    client.send(closure(1, 0, 8)).await;
    client.send(relative_pose(2, ConstraintKind::LoopClosure, 2, 11, pose_at(3.0))).await;
    client.send(closure(3, 1, 9)).await;
    client.finish().await;
    let snapshot = map.snapshot().await.unwrap();
    let off = snapshot.switched_off();
    assert_eq!(off.keys().copied().collect::<Vec<_>>(), [id(2)]);
    assert!(off[&id(2)].chi2 > 1000.0 && off[&id(2)].weight == 0.0, "{off:?}");
    for k in 0..12 {
        let x = snapshot.keyframes().get(&id(k)).unwrap().world_from_camera.translation.x;
        assert!((x - k as f64).abs() < 0.05, "keyframe {k} at {x}");
    }
    // The verdicts are in the events: nothing is judged again.
    let replayed = fixture.replayed().await;
    assert_eq!(replayed.switched_off(), off);
    assert_eq!(replayed.state_hash(), snapshot.state_hash());
}

/// The street with a closure and an optimization; the map's hash at the end.
async fn lock_step_run(threads: usize) -> ([u8; 32], Vec<(i64, i64)>, u64) {
    let config = EngineConfig { lock_step: true, ..EngineConfig::default() };
    let fixture = Fixture::new(config, threads).await;
    let map = fixture.map(MapPolicy::default()).await;
    let mut client = Client::open(&map).await;
    client.send_street(0..10).await;
    client.send(closure(1, 0, 9)).await;
    client.send(noisy_keyframe(10)).await;
    let acks = client.finish().await;
    let (progress, mut rows) = mpsc::unbounded_channel();
    let reading = tokio::spawn(async move {
        let mut costs = Vec::new();
        while let Some(SolveStep::Iteration(row)) = rows.recv().await {
            costs.push(row.cost);
        }
        costs
    });
    let outcome = map.optimize(OptimizeOptions::default(), progress).await.unwrap();
    let costs = reading.await.unwrap();
    let summary = &outcome.certificate.solve;
    assert_eq!(costs, summary.iterations.iter().map(|i| i.cost).collect::<Vec<_>>());
    assert!(summary.final_cost <= summary.initial_cost);
    assert_eq!((outcome.counts.keyframes, outcome.counts.cameras), (11, 1));
    let snapshot = map.snapshot().await.unwrap();
    assert_eq!(snapshot.revision(), outcome.revision);
    assert_eq!(fixture.replayed().await.state_hash(), snapshot.state_hash());
    (snapshot.state_hash(), optimized(&acks), summary.final_cost.to_bits())
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn lock_step_gives_the_same_bits_at_any_thread_count() {
    let one = lock_step_run(1).await;
    // Each keyframe and the closure has an ack of its own, as nothing is joined.
    assert_eq!(one.1.len(), 12);
    assert_eq!(lock_step_run(2).await, one);
    assert_eq!(lock_step_run(4).await, one);
}

#[tokio::test]
async fn landmarks_without_position_are_triangulated() {
    let fixture = Fixture::lock_step().await;
    let map = fixture.map(MapPolicy::default()).await;
    let mut client = Client::open(&map).await;
    client.send(camera_item(0)).await;
    for index in 0..2 {
        let mut item = street_keyframe(index, pose_at(index as f64), &Map::new());
        if let Item::Keyframe { landmarks, .. } = &mut item {
            landmarks.iter_mut().for_each(|l| *l = ItemLandmark { id: l.id, position: None });
        }
        client.send(item).await;
    }
    client.finish().await;
    let snapshot = map.snapshot().await.unwrap();
    let landmarks = snapshot.landmarks();
    let placed = landmarks.values().filter(|l| l.position.is_some()).count();
    assert!(landmarks.get(&id(0)).unwrap().observers.len() == 2 && placed >= 15, "{placed}");
    let found = landmarks.get(&id(12)).unwrap().position.unwrap();
    assert!((found - corner(12)).norm() < 1e-3);
}

#[tokio::test]
async fn more_observations_start_a_solve() {
    let fixture = Fixture::lock_step().await;
    let map = fixture.map(MapPolicy::default()).await;
    let mut client = Client::open(&map).await;
    client.send_street(0..4).await;
    // Keyframe 3 begins with landmark 10.
    let observations = [0, 1].map(|k| observe(k, &pose_at(3.0), &corner(k)));
    let keyframe = EntityRef::own(3);
    client.send(Item::Observations { keyframe, observations: observations.to_vec() }).await;
    assert_eq!(optimized(&client.finish().await).last(), Some(&(6, 4)));
}

#[tokio::test]
async fn a_canceled_optimization_leaves_the_map_as_it_was() {
    let fixture = Fixture::plain().await;
    let map = fixture.map(MapPolicy::default()).await;
    let mut client = Client::open(&map).await;
    client.send_street(0..6).await;
    client.finish().await;
    let before = map.snapshot().await.unwrap();
    let blocker = Occupied::new(fixture.maps.pool()).await;
    let (progress, rows) = mpsc::unbounded_channel();
    let mut running = Box::pin(map.optimize(OptimizeOptions::default(), progress));
    // Polled once, so that its request comes before the second one.
    assert!((&mut running).now_or_never().is_none());
    let (progress, _rows) = mpsc::unbounded_channel();
    let refused = map.optimize(OptimizeOptions::default(), progress).await.unwrap_err();
    assert_eq!(refused, EngineError::OptimizationRunning { map: "house".to_owned() });
    drop(rows);
    drop(blocker);
    let canceled = running.await.unwrap_err();
    assert_eq!(canceled, EngineError::Cancelled { map: "house".to_owned() });
    let after = map.snapshot().await.unwrap();
    assert_eq!(after.state_hash(), before.state_hash());
    assert_eq!(after.revision(), before.revision());
}

#[tokio::test]
async fn keyframes_that_arrive_during_an_optimization_are_carried_along() {
    let fixture = Fixture::plain().await;
    let policy = MapPolicy { local_bundle: false, ..MapPolicy::default() };
    let map = fixture.map(policy).await;
    let mut client = Client::open(&map).await;
    client.send_street(0..4).await;
    client.received(5).await;
    let blocker = Occupied::new(fixture.maps.pool()).await;
    let (progress, mut rows) = mpsc::unbounded_channel();
    let mut optimizing = Box::pin(map.optimize(OptimizeOptions::default(), progress));
    assert!((&mut optimizing).now_or_never().is_none());
    // The engine takes requests before items.
    let sequence = client.send(noisy_keyframe(4)).await;
    client.received(sequence).await;
    let start = map.snapshot().await.unwrap();
    drop(blocker);
    optimizing.await.unwrap();
    assert!(rows.recv().await.is_some());
    let after = map.snapshot().await.unwrap();
    assert_eq!(fixture.solves().await, [SolveKind::Global]);
    let pose = |m: &Map, k| m.keyframes().get(&id(k)).unwrap().world_from_camera;
    let relative = |m: &Map| pose(m, 3).inverse().compose(&pose(m, 4));
    assert_ne!(pose(&start, 4), pose(&after, 4));
    assert!(relative(&start).minus(&relative(&after)).norm() < 1e-9);
}

#[tokio::test]
async fn an_empty_map_holds_nothing_to_solve() {
    let fixture = Fixture::plain().await;
    let map = fixture.map(MapPolicy::default()).await;
    let (progress, _rows) = mpsc::unbounded_channel();
    let outcome = map.optimize(OptimizeOptions::default(), progress).await;
    assert_eq!(outcome.unwrap_err(), EngineError::NothingToSolve { map: "house".to_owned() });
}

#[tokio::test]
async fn a_restart_from_a_snapshot_goes_on_with_the_solves_that_were_outstanding_at_it() {
    let fixture = Fixture::plain().await;
    let map = fixture.map(MapPolicy::default()).await;
    let mut client = Client::open(&map).await;
    let blocker = Occupied::new(fixture.maps.pool()).await;
    client.send_street(0..4).await;
    let last = client.send(closure(1, 0, 3)).await;
    client.received(last).await;
    let snapshot = map.snapshot().await.unwrap();
    assert_eq!(snapshot.solve_count(), 0);

    // Another server takes the map over, from the snapshot alone.
    let epoch = fixture.store.acquire("house").await.unwrap();
    let revision = snapshot.revision();
    fixture.store.put_snapshot("house", epoch, snapshot).await.unwrap();
    assert!(fixture.store.read("house", revision as u64).await.unwrap().is_empty());
    let maps = open(&fixture.store, EngineConfig::default(), 1).await;
    let again = maps.get("house").unwrap();
    let client = Client::open(&again).await;
    assert_eq!(client.sequence, last + 1);
    // A stream ends when the solves of its client have ended.
    client.finish().await;
    let solved = again.snapshot().await.unwrap();
    assert_eq!(solved.clients()[0].optimized_sequence, last);
    assert!(solved.solve_count() > 0 && solved.pending_solves().is_empty());
    drop(blocker);
}
