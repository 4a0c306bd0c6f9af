//! Bugs: a panic while a map changes costs that map its writes, one in a solve that solve, and nothing else.

use covis::map::{MapLimits, MapPolicy, WhenFull};
use covis::service::engine::{
    Ack, AckStatus, EngineError, Fault, MapState, OptimizeOptions, SolveReport,
};
use tokio::sync::mpsc;

use super::{Client, Fixture};
use crate::map_support::camera_item;

async fn check_poisoned(fixture: &Fixture) {
    let map = fixture.maps.get("house").unwrap();
    let poisoned = EngineError::Poisoned { map: "house".to_owned() };
    let refused = map.open_stream("robot".to_owned(), 0, false).await;
    assert_eq!(refused.unwrap_err(), poisoned);
    let (progress, _rows) = mpsc::unbounded_channel();
    let refused = map.optimize(OptimizeOptions::default(), progress).await;
    assert_eq!(refused.unwrap_err(), poisoned);
    let info = map.info().await.unwrap();
    assert_eq!(info.state, MapState::Poisoned);
    // Reads go on, watching too, and other maps do not notice.
    let mut watch = map.watch(None).await.unwrap();
    let whole = watch.next().await.unwrap();
    assert_eq!(whole.snapshot.state_hash(), info.snapshot.state_hash());
    fixture.maps.create("other", "", MapPolicy::default()).await.unwrap();
    let other = fixture.maps.get("other").unwrap();
    Client::open(&other).await;
    fixture.maps.delete("house").await.unwrap();
}

#[tokio::test]
async fn a_panic_in_a_solve_costs_that_solve() {
    for fault in [Fault::PanicInSolve, Fault::PanicInWindow, Fault::PanicInResult] {
        check_lost(fault).await;
    }
}

async fn check_lost(fault: Fault) {
    let fixture = Fixture::faulty(fault).await;
    let map = fixture.map(MapPolicy::default()).await;
    let mut client = Client::open(&map).await;
    client.send_street(0..3).await;
    let acks = client.finish().await;
    let is_told = |ack: &Ack| {
        let status = &ack.status;
        matches!(status, AckStatus::Optimized { outcome: SolveReport::Lost { .. }, .. })
    };
    assert!(acks.iter().any(is_told), "{fault:?}: {acks:?}");
    let info = map.info().await.unwrap();
    assert_eq!((info.state, info.snapshot.keyframes().len()), (MapState::Open, 3));
    // All that was acknowledged is in the journal.
    assert_eq!(fixture.replayed().await.state_hash(), info.snapshot.state_hash());
}

#[tokio::test]
async fn a_panic_in_an_optimization_is_answered_as_a_bug() {
    for fault in [Fault::PanicInSolve, Fault::PanicInResult] {
        check_answered(fault).await;
    }
}

async fn check_answered(fault: Fault) {
    let fixture = Fixture::faulty(fault).await;
    let map = fixture.map(MapPolicy { local_bundle: false, ..MapPolicy::default() }).await;
    let mut client = Client::open(&map).await;
    client.send_street(0..2).await;
    client.finish().await;
    let (progress, _rows) = mpsc::unbounded_channel();
    let outcome = map.optimize(OptimizeOptions::default(), progress).await;
    assert!(matches!(outcome, Err(EngineError::Bug { .. })), "{outcome:?}");
    assert_eq!(map.info().await.unwrap().state, MapState::Open);
    // The request is over; another one is taken.
    let (progress, _rows) = mpsc::unbounded_channel();
    let outcome = map.optimize(OptimizeOptions::default(), progress).await;
    assert!(matches!(outcome, Err(EngineError::Bug { .. })), "{outcome:?}");
}

#[tokio::test]
async fn a_panic_while_room_is_made_ends_the_stream_that_needs_it() {
    let fixture = Fixture::faulty(Fault::PanicInRetirement).await;
    let limits = MapLimits { keyframes: Some(3), ..MapLimits::default() };
    let policy = MapPolicy { limits, when_full: WhenFull::Marginalize, ..MapPolicy::default() };
    let map = fixture.map(policy).await;
    let mut client = Client::open(&map).await;
    client.send_street(0..4).await;
    assert!(matches!(client.end().await, EngineError::Bug { .. }));
    let info = map.info().await.unwrap();
    assert_eq!((info.state, info.snapshot.keyframes().len()), (MapState::Open, 3));
    let mut other = Client::open_as(&map, "other").await;
    let sequence = other.send(camera_item(0)).await;
    let ack = other.received(sequence).await;
    assert!(matches!(ack.status, AckStatus::Received { duplicate: false }), "{ack:?}");
}

#[tokio::test]
async fn a_panic_while_applying_leaves_the_last_whole_revision() {
    let fixture = Fixture::faulty(Fault::PanicInEngine).await;
    let map = fixture.map(MapPolicy::default()).await;
    let mut client = Client::open(&map).await;
    let before = map.snapshot().await.unwrap();
    client.send(camera_item(0)).await;
    assert!(matches!(client.end().await, EngineError::Bug { .. }));
    let after = map.snapshot().await.unwrap();
    assert_eq!(after.state_hash(), before.state_hash());
    check_poisoned(&fixture).await;
}

#[tokio::test]
async fn staged_failures_answer_calls_with_a_bug() {
    let fixture = Fixture::faulty(Fault::FailCalls).await;
    let outcome = fixture.maps.create("house", "", MapPolicy::default()).await;
    assert!(matches!(outcome, Err(EngineError::Bug { .. })));
}
