//! When a map is settled: what GetMap and WatchMap say of the work that is left, and waiting for its end.
//!
//! The threads of the solver pool are held, so that work is pending for as long as a test looks at it.

use std::pin::pin;
use std::task::Poll;

use covis::client::{Client, ClientError, SessionOptions};
use covis::wire::v1;
use v1::ingest_request::Item;

use crate::common::{Stream, TestServer, camera, hold, keyframe, large, relative_pose, run, small};

async fn client(server: &TestServer) -> Client {
    Client::connect(&format!("http://{}", server.running.local_addr())).await.unwrap()
}

async fn pending(client: &Client) -> v1::PendingWork {
    client.get_map("room").await.unwrap().pending_work.unwrap()
}

fn is_settled(pending: &v1::PendingWork) -> bool {
    *pending == v1::PendingWork::default()
}

/// A keyframe whose place can be searched.
fn described(id: i64) -> v1::Keyframe {
    let mut keyframe = keyframe(id);
    for (byte, observation) in (0..).zip(&mut keyframe.observations) {
        let data = (0..32).map(|k: u8| byte ^ k.wrapping_mul(37)).collect();
        let kind = v1::DescriptorKind::Binary.into();
        observation.descriptor = Some(v1::Descriptor { kind, name: "orb".to_owned(), data });
    }
    keyframe
}

/// A map "room" with these keyframes, all of which are optimized, and the stream.
async fn room(server: &TestServer, keyframes: i64) -> Stream {
    server.create_map("room").await;
    let (mut stream, _) = Stream::open(server, "room", "robot", 0).await;
    stream.put(1, Item::Camera(camera(0))).await;
    for id in 0..keyframes {
        stream.put(id + 2, Item::Keyframe(keyframe(id))).await;
    }
    client(server).await.wait_settled("room").await.unwrap();
    stream
}

/// Whether a wait goes on when it is first polled, and after the server has answered a call.
async fn waits(client: &Client, wait: std::pin::Pin<&mut impl Future>) -> bool {
    let mut wait = wait;
    let pending = std::future::poll_fn(|at| Poll::Ready(wait.as_mut().poll(at).is_pending())).await;
    client.get_map("room").await.unwrap();
    pending && std::future::poll_fn(|at| Poll::Ready(wait.as_mut().poll(at).is_pending())).await
}

#[test]
fn an_item_that_no_solve_has_covered_is_pending() {
    run(async {
        let server = TestServer::start().await;
        let mut stream = room(&server, 3).await;
        let client = client(&server).await;
        assert!(is_settled(&pending(&client).await));
        let release = hold(&server.running.solver_pool(), small()).await;
        stream.put(5, Item::Keyframe(keyframe(3))).await;
        let unoptimized_item_count = 1;
        let wanted = v1::PendingWork { unoptimized_item_count, ..Default::default() };
        assert_eq!(pending(&client).await, wanted);
        let mut settled = pin!(client.wait_settled("room"));
        assert!(waits(&client, settled.as_mut()).await);
        drop(release);
        settled.await.unwrap();
        assert!(is_settled(&pending(&client).await));
        stream.finish().await.unwrap();
    });
}

#[test]
fn a_place_that_is_still_to_be_searched_is_pending() {
    run(async {
        let server = TestServer::start().await;
        let mut stream = room(&server, 3).await;
        let client = client(&server).await;
        let release = hold(&server.running.solver_pool(), large()).await;
        for id in 3..5 {
            stream.put(id + 2, Item::Keyframe(described(id))).await;
        }
        let mut watch = pin!(client.wait_settled("room"));
        assert!(waits(&client, watch.as_mut()).await);
        // Acks do not wait for searches.
        while stream.event().await.is_ok_and(|event| match event {
            v1::ingest_response::Event::Ack(ack) => {
                ack.status() != v1::AckStatus::Optimized || ack.sequence < 6
            }
            v1::ingest_response::Event::Opened(_) => true,
        }) {}
        let wanted = v1::PendingWork { place_search_count: 2, ..Default::default() };
        assert_eq!(pending(&client).await, wanted);
        assert!(waits(&client, watch.as_mut()).await);
        drop(release);
        watch.await.unwrap();
        assert!(is_settled(&pending(&client).await));
        let searches = client.place_searches("room").await.unwrap().searches;
        assert_eq!(searches.len(), 2, "both were searched when the map had settled");
        stream.finish().await.unwrap();
    });
}

#[test]
fn a_map_goes_on_and_settles_where_searches_and_adjustments_hit_a_bug() {
    run(async {
        let server = TestServer::with_fault("panic-in-background").await;
        let mut stream = room(&server, 5).await;
        let client = client(&server).await;
        stream.put(7, Item::Keyframe(described(5))).await;
        let kind = v1::ConstraintKind::LoopClosure.into();
        let closure = v1::RelativePoseConstraint { kind, ..relative_pose(0, 0, 4) };
        stream.put(8, Item::RelativePose(closure)).await;
        client.wait_settled("room").await.unwrap();
        stream.put(9, Item::Keyframe(described(6))).await;
        client.wait_settled("room").await.unwrap();
        stream.finish().await.unwrap();
        let map = client.get_map("room").await.unwrap();
        assert_eq!(map.state(), v1::MapState::Open);
        assert!(client.place_searches("room").await.unwrap().searches.is_empty());
    });
}

#[test]
fn an_adjustment_after_a_closure_is_pending_until_it_is_applied() {
    run(async {
        let server = TestServer::start().await;
        // So many that an adjustment of the whole map is a large solve.
        let mut stream = room(&server, 48).await;
        let client = client(&server).await;
        let pool = server.running.solver_pool();
        let release = hold(&pool, large()).await;
        let kind = v1::ConstraintKind::LoopClosure.into();
        let item = v1::RelativePoseConstraint { kind, ..relative_pose(0, 0, 47) };
        stream.put(50, Item::RelativePose(item)).await;
        let mut settled = pin!(client.wait_settled("room"));
        assert!(waits(&client, settled.as_mut()).await, "the pose graph waits");
        drop(release);
        settled.await.unwrap();
        let map = client.get_map("room").await.unwrap();
        assert!(!map.adjustment_due);
        let revision = map.revision;
        stream.finish().await.unwrap();
        assert_eq!(client.get_map("room").await.unwrap().revision, revision, "nothing came later");
    });
}

#[test]
fn a_watch_says_when_the_map_settles_also_where_nothing_else_changes() {
    run(async {
        let server = TestServer::start().await;
        let mut stream = room(&server, 3).await;
        let client = client(&server).await;
        let release = hold(&server.running.solver_pool(), small()).await;
        stream.put(5, Item::Keyframe(keyframe(3))).await;
        let map = client.get_map("room").await.unwrap();
        let request = v1::WatchMapRequest {
            map_id: "room".to_owned(),
            from_revision: Some(map.revision),
            map_uid: map.uid,
            ..Default::default()
        };
        let mut deltas = server.maps().watch_map(request.clone()).await.unwrap().into_inner();
        drop(release);
        let mut last = map.revision;
        loop {
            let delta = deltas.message().await.unwrap().unwrap().delta.unwrap();
            assert_eq!(delta.base_revision, last);
            last = delta.revision;
            if is_settled(&delta.pending_work.unwrap()) {
                break;
            }
        }
        assert!(last > map.revision, "the solve");
        // One that begins at the newest revision is told at once.
        let from_revision = Some(last);
        let request = v1::WatchMapRequest { from_revision, ..request };
        let mut deltas = server.maps().watch_map(request).await.unwrap().into_inner();
        let delta = deltas.message().await.unwrap().unwrap().delta.unwrap();
        assert_eq!((delta.base_revision, delta.revision), (last, last));
        assert!(is_settled(&delta.pending_work.unwrap()) && delta.keyframes.is_empty());
        stream.finish().await.unwrap();
    });
}

#[test]
fn the_work_of_a_frozen_map_waits_and_who_waits_for_it_is_told() {
    run(async {
        let server = TestServer::start().await;
        let mut stream = room(&server, 3).await;
        let client = client(&server).await;
        let release = hold(&server.running.solver_pool(), small()).await;
        stream.put(5, Item::Keyframe(keyframe(3))).await;
        let mut settled = pin!(client.wait_settled("room"));
        assert!(waits(&client, settled.as_mut()).await);
        let update = |state: v1::MapState| v1::UpdateMapRequest {
            map_id: "room".to_owned(),
            state: state.into(),
            update_mask: Some(prost_types::FieldMask { paths: vec!["state".to_owned()] }),
            ..Default::default()
        };
        client.update_map(update(v1::MapState::Frozen)).await.unwrap();
        for error in [settled.await.unwrap_err(), client.wait_settled("room").await.unwrap_err()] {
            assert!(matches!(&error, ClientError::MapNotOpen { state: "frozen", .. }), "{error}");
        }
        drop(release);
        client.update_map(update(v1::MapState::Open)).await.unwrap();
        client.wait_settled("room").await.unwrap();
    });
}

#[test]
fn a_session_waits_for_its_own_items_first() {
    run(async {
        let server = TestServer::start().await;
        server.create_map("room").await;
        let client = client(&server).await;
        let mut session = client.ingest("room", "robot", SessionOptions::default()).await.unwrap();
        session.send(camera(0)).await.unwrap();
        for id in 0..6 {
            session.send(described(id)).await.unwrap();
        }
        session.wait_settled().await.unwrap();
        assert!(is_settled(&pending(&client).await));
        assert_eq!(session.report().optimized_through, 7);
        assert_eq!(client.place_searches("room").await.unwrap().searches.len(), 6);
        session.finish().await.unwrap();
    });
}
