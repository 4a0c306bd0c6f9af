//! The adjustment of the whole map after a loop closure: windows do not wait for it.

use std::task::Poll;

use covis::wire::v1;
use v1::ingest_request::Item;
use v1::ingest_response::Event;

use crate::common::{
    Stream, TestServer, camera, hold, keyframe, landmark_position, large, relative_pose, run,
    vector3,
};
use crate::sequence::adjusted;

/// So many that a solve of the whole map is a large one; more would not see the landmarks.
const KEYFRAMES: i64 = 48;

async fn map(server: &TestServer) -> v1::Map {
    let request = v1::GetMapRequest { map_id: "hall".to_owned(), ..Default::default() };
    server.maps().get_map(request).await.unwrap().into_inner().map.unwrap()
}

/// The OPTIMIZED ack of an item.
async fn optimized(stream: &mut Stream, sequence: i64) -> v1::IngestAck {
    loop {
        let Event::Ack(ack) = stream.event().await.unwrap() else { panic!("opened twice") };
        if ack.status() == v1::AckStatus::Optimized && ack.sequence >= sequence {
            return ack;
        }
    }
}

/// A keyframe that shares landmarks with others of its kind only: its window is a small solve.
fn elsewhere(id: i64) -> Item {
    let mut keyframe = keyframe(id);
    for observation in &mut keyframe.observations {
        let landmark = observation.landmark.as_mut().unwrap();
        landmark.id += 1000;
        let point = landmark_position(landmark.id - 1000);
        if id == KEYFRAMES {
            let point_in_world = Some(vector3(point));
            let landmark = v1::Landmark { id: landmark.id, point_in_world, ..Default::default() };
            keyframe.landmarks.push(landmark);
        }
    }
    Item::Keyframe(keyframe)
}

#[test]
fn windows_go_on_while_the_whole_map_waits_to_be_adjusted() {
    run(async {
        let server = TestServer::start().await;
        server.create_map("hall").await;
        let (mut stream, _) = Stream::open(&server, "hall", "robot", 0).await;
        stream.send(1, Item::Camera(camera(0))).await;
        for id in 0..KEYFRAMES {
            stream.send(id + 2, Item::Keyframe(keyframe(id))).await;
        }
        let closure = KEYFRAMES + 2;
        optimized(&mut stream, closure - 1).await;

        // The only thread of large solves has work before the pose graph and work behind it.
        let pool = server.running.solver_pool();
        let first = hold(&pool, large()).await;
        let kind = v1::ConstraintKind::LoopClosure.into();
        let item = v1::RelativePoseConstraint { kind, ..relative_pose(0, 0, KEYFRAMES - 1) };
        stream.put(closure, Item::RelativePose(item)).await;
        // Answered behind the item, when the pose graph waits.
        assert!(!map(&server).await.adjustment_due);
        let (release, released) = std::sync::mpsc::channel::<()>();
        let tenant = pool.accounts().tenant("");
        let mut second = Box::pin(pool.run(&tenant, large(), move || released.recv()));
        // Queued at the first poll.
        assert!(
            std::future::poll_fn(|at| Poll::Ready(second.as_mut().poll(at).is_pending())).await
        );
        drop(first);
        optimized(&mut stream, closure).await;
        assert!(map(&server).await.adjustment_due);

        let next = closure + 2;
        stream.send(next - 1, elsewhere(KEYFRAMES)).await;
        stream.send(next, elsewhere(KEYFRAMES + 1)).await;
        let ack = optimized(&mut stream, next).await;
        assert!(ack.solve_id > 0, "{ack:?}");
        assert!(map(&server).await.adjustment_due, "it waits still");
        drop(release);
        assert!(second.await.is_ok());
        adjusted(&server, "hall").await;
        stream.finish().await.unwrap();
    });
}
