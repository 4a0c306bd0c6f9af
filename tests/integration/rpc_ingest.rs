//! `IngestService.Ingest`: acks, resume, duplicates, epochs, protocol errors, ends.

use covis::wire::v1;
use tonic::Code;
use v1::ingest_request::Item;

use crate::common::{
    LANDMARKS, Stream, TestServer, camera, check_field, check_retry, check_status, keyframe,
    landmark, observation, open_item, relative_pose, run,
};

/// The last ack of a status.
fn last(acks: &[v1::IngestAck], status: v1::AckStatus) -> Option<&v1::IngestAck> {
    acks.iter().rev().find(|ack| ack.status() == status)
}

#[test]
fn every_item_is_received_and_keyframes_are_optimized_before_the_stream_ends() {
    run(async {
        let server = TestServer::start().await;
        let uid = server.create_map("room").await.uid;
        let (stream, opened) = Stream::open(&server, "room", "robot", 0).await;
        assert_eq!((opened.next_sequence, opened.epoch), (1, 1));
        assert_eq!(opened.durability(), v1::Durability::InMemory);
        assert_eq!((opened.map_uid, opened.lock_step), (uid, false));
        assert_eq!(opened.max_message_bytes, 4_194_304);
        assert!(opened.limits.unwrap().max_keyframe_count.is_some());
        stream.send(1, Item::Camera(camera(0))).await;
        for id in 0..4 {
            // Gaps are legal.
            stream.send(10 * (id + 1), Item::Keyframe(keyframe(id))).await;
        }
        stream.send(50, Item::RelativePose(relative_pose(0, 0, 1))).await;
        let acks = stream.finish().await.unwrap();
        let received: Vec<i64> = acks
            .iter()
            .filter(|a| a.status() == v1::AckStatus::Received && !a.duplicate)
            .map(|a| a.sequence)
            .collect();
        assert_eq!(received, [1, 10, 20, 30, 40, 50]);
        let optimized =
            last(&acks, v1::AckStatus::Optimized).expect("half-closing waits for solves");
        assert_eq!(optimized.sequence, 40);
        assert!(optimized.solve_id > 0 && optimized.revision > 0);
        let summary = optimized.solve_summary.as_ref().expect("a certificate");
        assert!(summary.final_cost <= summary.initial_cost);
        assert_eq!(summary.factor_costs[0].kind(), v1::FactorKind::Reprojection);
        assert!(summary.linear_solver() != v1::LinearSolver::Auto && summary.thread_count == 1);
        assert!(last(&acks, v1::AckStatus::Durable).is_none(), "never in memory");
    });
}

#[test]
fn lock_step_and_leaving_out_summaries() {
    run(async {
        let server = TestServer::start().await;
        server.create_map("room").await;
        let mut stream = Stream::connect(&server).await;
        let options = v1::IngestOptions { lock_step: true, omit_solve_summary: true };
        let open = v1::IngestOpen {
            map_id: "room".to_owned(),
            client_id: "robot".to_owned(),
            epoch: 5,
            options: Some(options),
        };
        stream.send(0, Item::Open(open)).await;
        let v1::ingest_response::Event::Opened(opened) = stream.event().await.unwrap() else {
            panic!("opened comes first");
        };
        assert_eq!((opened.lock_step, opened.epoch), (true, 5));
        stream.send(1, Item::Camera(camera(0))).await;
        for id in 0..3 {
            stream.send(id + 2, Item::Keyframe(keyframe(id))).await;
        }
        let acks = stream.finish().await.unwrap();
        let optimized = acks.iter().filter(|a| a.status() == v1::AckStatus::Optimized);
        let optimized: Vec<_> = optimized.collect();
        assert_eq!(optimized.iter().map(|a| a.sequence).collect::<Vec<_>>(), [2, 3, 4]);
        assert!(optimized.iter().all(|a| a.solve_summary.is_none()));
    });
}

#[test]
fn resending_after_a_broken_link_is_harmless() {
    run(async {
        let server = TestServer::start().await;
        server.create_map("room").await;
        let (mut first, _) = Stream::open(&server, "room", "robot", 0).await;
        first.put(1, Item::Camera(camera(0))).await;
        first.put(2, Item::Keyframe(keyframe(0))).await;
        drop(first);

        let (mut second, opened) = Stream::open(&server, "room", "robot", 0).await;
        assert_eq!((opened.next_sequence, opened.epoch), (3, 2));
        let again = second.put(1, Item::Camera(camera(0))).await;
        assert!(again.status() == v1::AckStatus::Received && again.duplicate);
        // The start values that were sent are compared, not the estimates since.
        let again = second.put(2, Item::Keyframe(keyframe(0))).await;
        assert!(again.status() == v1::AckStatus::Received && again.duplicate, "{again:?}");
        // The same keyframe under a new sequence too.
        let again = second.put(3, Item::Keyframe(keyframe(0))).await;
        assert!(again.status() == v1::AckStatus::Received && again.duplicate, "{again:?}");
        let mut other = keyframe(0);
        other.observations.pop();
        let refused = second.put(4, Item::Keyframe(other)).await;
        assert_eq!(refused.status(), v1::AckStatus::Rejected);
        assert_eq!(refused.violations[0].field, "keyframe.id");
        assert_eq!(refused.violations[0].reason(), v1::ViolationReason::AlreadyExists);
        drop(second);

        let (mut third, opened) = Stream::open(&server, "room", "robot", 0).await;
        let refused = third.put(2, Item::Camera(camera(7))).await;
        assert_eq!(refused.violations[0].field, "sequence");
        assert_eq!(refused.violations[0].reason(), v1::ViolationReason::AlreadyExists);
        // What was acknowledged as a duplicate under a sequence of its own is covered by it.
        assert_eq!(opened.next_sequence, 4);
    });
}

#[test]
fn a_newer_epoch_fences_the_older_stream() {
    run(async {
        let server = TestServer::start().await;
        server.create_map("room").await;
        let (mut old, _) = Stream::open(&server, "room", "robot", 3).await;
        let (_new, opened) = Stream::open(&server, "room", "robot", 0).await;
        assert_eq!(opened.epoch, 4);
        check_status(&old.end().await, Code::Aborted, "EPOCH_FENCED");
        let mut late = Stream::connect(&server).await;
        late.send(0, open_item("room", "robot", 4)).await;
        check_status(&late.end().await, Code::Aborted, "EPOCH_FENCED");
        // Another client is not touched.
        let (mut other, _) = Stream::open(&server, "room", "drone", 1).await;
        assert!(other.put(1, Item::Camera(camera(0))).await.violations.is_empty());
    });
}

#[test]
fn a_broken_protocol_ends_the_stream_after_the_acks() {
    run(async {
        let server = TestServer::start().await;
        server.create_map("room").await;
        let mut stream = Stream::connect(&server).await;
        stream.send(1, Item::Camera(camera(0))).await;
        check_status(&stream.end().await, Code::InvalidArgument, "PROTOCOL");

        let mut stream = Stream::connect(&server).await;
        stream.send(3, open_item("room", "robot", 0)).await;
        check_field(&stream.end().await, "sequence", "OUT_OF_RANGE");

        for (map_id, client_id, epoch, field, reason) in [
            ("", "robot", 0, "open.map_id", "MISSING"),
            ("room", "", 0, "open.client_id", "MISSING"),
            ("room", "Robot 1", 0, "open.client_id", "OUT_OF_RANGE"),
            ("room", "robot", -1, "open.epoch", "OUT_OF_RANGE"),
        ] {
            let mut stream = Stream::connect(&server).await;
            stream.send(0, open_item(map_id, client_id, epoch)).await;
            check_field(&stream.end().await, field, reason);
        }
        let mut stream = Stream::connect(&server).await;
        stream.send(0, open_item("none", "robot", 0)).await;
        check_status(&stream.end().await, Code::NotFound, "MAP_NOT_FOUND");

        let breaks = [
            v1::IngestRequest { sequence: 2, item: Some(Item::Camera(camera(1))) },
            v1::IngestRequest { sequence: 0, item: Some(Item::Camera(camera(1))) },
            v1::IngestRequest { sequence: 3, item: None },
            v1::IngestRequest { sequence: 0, item: Some(open_item("room", "robot", 0)) },
        ];
        for (client, message) in ["a", "b", "c", "d"].into_iter().zip(breaks) {
            let (mut stream, _) = Stream::open(&server, "room", client, 0).await;
            stream.send(2, Item::Camera(camera(0))).await;
            stream.send_message(message).await;
            assert!(stream.answer(2).await.violations.is_empty(), "what came before is answered");
            check_status(&stream.end().await, Code::InvalidArgument, "PROTOCOL");
        }
    });
}

#[test]
fn past_a_limit_the_stream_ends_and_can_be_tried_again() {
    run(async {
        let server = TestServer::start().await;
        let limits = v1::MapLimits { max_keyframe_count: Some(1), ..Default::default() };
        let policy = v1::MapPolicy { limits: Some(limits), ..Default::default() };
        server.create_map_with("room", policy).await;
        let (mut stream, opened) = Stream::open(&server, "room", "robot", 0).await;
        assert_eq!(opened.limits.unwrap().max_keyframe_count, Some(1));
        stream.put(1, Item::Camera(camera(0))).await;
        stream.put(2, Item::Keyframe(keyframe(0))).await;
        stream.send(3, Item::Keyframe(keyframe(1))).await;
        let status = stream.end().await;
        check_status(&status, Code::ResourceExhausted, "MAP_LIMIT");
        check_retry(&status);
        let (_, opened) = Stream::open(&server, "room", "robot", 0).await;
        assert_eq!(opened.next_sequence, 3, "the item was not taken, those before it were");
    });
}

#[test]
fn a_bug_while_changing_the_map_poisons_it() {
    run(async {
        let server = TestServer::with_poisoned_map("room").await;
        let mut stream = Stream::connect(&server).await;
        stream.send(0, open_item("room", "robot", 0)).await;
        check_status(&stream.end().await, Code::FailedPrecondition, "MAP_POISONED");
    });
}

#[test]
fn observations_and_landmarks_can_follow_their_keyframe() {
    run(async {
        let server = TestServer::start().await;
        server.create_map("room").await;
        let (mut stream, _) = Stream::open(&server, "room", "robot", 0).await;
        stream.put(1, Item::Camera(camera(0))).await;
        let mut frame = keyframe(0);
        frame.landmarks.clear();
        frame.observations.clear();
        stream.put(2, Item::Keyframe(frame)).await;
        // Landmarks without a position are triangulated once two keyframes see them.
        let bare = |id| v1::Landmark { point_in_world: None, ..landmark(id) };
        let landmarks = (0..LANDMARKS).map(bare).collect();
        stream.put(3, Item::Landmarks(v1::LandmarkBatch { landmarks })).await;
        let batch = v1::ObservationBatch {
            keyframe: Some(v1::KeyframeRef { id: 0, ..Default::default() }),
            observations: (0..LANDMARKS).map(|k| observation(0, k)).collect(),
        };
        stream.put(4, Item::Observations(batch)).await;
        for id in 1..6 {
            stream.send(id + 4, Item::Keyframe(keyframe(id))).await;
        }
        stream.finish().await.unwrap();
        let request = v1::GetMapRequest { map_id: "room".to_owned(), ..Default::default() };
        let map = server.maps().get_map(request).await.unwrap().into_inner().map.unwrap();
        let counts = map.counts.unwrap();
        assert_eq!(counts.observation_count, 6 * LANDMARKS);
        assert_eq!(counts.positioned_landmark_count, LANDMARKS);
    });
}

#[test]
fn an_epoch_or_sequence_that_none_could_follow_is_refused_and_closes_nobody_out() {
    run(async {
        let server = TestServer::start().await;
        server.create_map("room").await;
        let mut last = Stream::connect(&server).await;
        last.send(0, open_item("room", "robot", i64::MAX)).await;
        let refused = last.end().await;
        check_field(&refused, "open.epoch", "OUT_OF_RANGE");
        let (mut stream, opened) = Stream::open(&server, "room", "robot", 0).await;
        assert_eq!((opened.epoch, opened.next_sequence), (1, 1));
        let refused = stream.put(i64::MAX, Item::Camera(camera(0))).await;
        assert_eq!(refused.status(), v1::AckStatus::Rejected);
        assert_eq!(refused.violations[0].field, "sequence");
        assert_eq!(refused.violations[0].reason(), v1::ViolationReason::OutOfRange);
        let taken = stream.put(1, Item::Camera(camera(0))).await;
        assert_eq!(taken.status(), v1::AckStatus::Received, "the stream lives: {taken:?}");
        drop(stream);
        // The largest ones that are taken can be followed.
        let most = 1 << 62;
        let (mut stream, _) = Stream::open(&server, "room", "robot", most - 1).await;
        stream.put(most - 1, Item::Camera(camera(1))).await;
        let (_stream, opened) = Stream::open(&server, "room", "robot", most).await;
        assert_eq!(opened.next_sequence, most);
    });
}
