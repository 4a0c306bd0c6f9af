//! The client over a real loopback port: acks, back-pressure, resume, fencing, restarts, watching.

use std::sync::{Arc, Mutex};
use std::time::Duration;

use covis::client::{
    Client, ClientError, IngestSession, MapMirror, RetryPolicy, SessionOptions, WatchOptions,
};
use covis::wire::v1;
use futures_util::FutureExt;
use tonic::Code;

use crate::common::{TestServer, camera, keyframe, landmark, relative_pose, run};
use crate::proxy::Proxy;

/// Retries without waiting.
fn at_once(max_attempts: u32) -> RetryPolicy {
    let first_delay = Duration::ZERO;
    RetryPolicy { max_attempts, first_delay, longest_delay: first_delay, ..RetryPolicy::default() }
}

/// A server with an empty map "room", a link to it and a client on the link.
async fn linked() -> (TestServer, Proxy, Client) {
    let server = TestServer::start().await;
    server.create_map("room").await;
    let proxy = Proxy::to(server.running.local_addr()).await;
    let client = Client::connect(&proxy.url()).await.unwrap();
    (server, proxy, client)
}

async fn session(client: &Client, options: SessionOptions) -> IngestSession {
    let options = SessionOptions { retry: at_once(50), ..options };
    client.ingest("room", "robot", options).await.unwrap()
}

/// A connection past the link.
async fn direct(server: &TestServer) -> Client {
    Client::connect(&format!("http://{}", server.running.local_addr())).await.unwrap()
}

/// Waits until the server's map holds so many keyframes.
async fn hold_keyframes(server: &TestServer, count: i64) {
    let client = direct(server).await;
    let mut watch = client.watch("room", WatchOptions::default()).await.unwrap();
    while watch.mirror().keyframes.len() < usize::try_from(count).unwrap() {
        watch.next().await.unwrap();
    }
}

#[test]
fn a_frontend_that_starts_again_counts_on_from_the_ids_of_its_client() {
    run(async {
        let (_server, _proxy, client) = linked().await;
        let free =
            |session: &IngestSession| (session.next_keyframe_id(), session.next_landmark_id());
        let mut first = session(&client, SessionOptions::default()).await;
        assert_eq!(free(&first), (0, 0));
        first.send(camera(0)).await.unwrap();
        for count in 1..3 {
            first.send(keyframe(first.next_keyframe_id())).await.unwrap();
            assert_eq!(first.next_keyframe_id(), count);
        }
        let landmarks = v1::LandmarkBatch { landmarks: vec![landmark(500)] };
        first.send(landmarks).await.unwrap();
        assert_eq!(free(&first), (2, 501));
        let report = first.finish().await.unwrap();
        assert_eq!((report.acknowledged, report.rejected), (4, 0), "{report:?}");
        let mut second = session(&client, SessionOptions::default()).await;
        assert_eq!(free(&second), (2, 501));
        second.send(keyframe(second.next_keyframe_id())).await.unwrap();
        let report = second.finish().await.unwrap();
        assert_eq!((report.acknowledged, report.rejected), (1, 0), "{report:?}");
        let other = client.ingest("room", "other", SessionOptions::default()).await.unwrap();
        assert_eq!(free(&other), (0, 0));
    });
}

#[test]
fn a_session_sends_takes_acks_and_reports() {
    run(async {
        let (_server, _proxy, client) = linked().await;
        let seen = Arc::new(Mutex::new(Vec::new()));
        let acks = Arc::clone(&seen);
        let options = SessionOptions { lock_step: true, ..SessionOptions::default() };
        let options = options.on_ack(move |ack| acks.lock().unwrap().push(ack.clone()));
        let mut session = session(&client, options).await;
        assert_eq!((session.opened().epoch, session.next_sequence()), (1, 1));
        assert_eq!(session.send(camera(0)).await.unwrap(), 1);
        for id in 0..4 {
            assert_eq!(session.send(keyframe(id)).await.unwrap(), id + 2);
        }
        session.optimized(5).await.unwrap();
        session.send(relative_pose(0, 0, 3)).await.unwrap();
        session.flush().await.unwrap();
        assert_eq!(session.report().acknowledged, 6);
        let report = session.finish().await.unwrap();
        assert_eq!((report.sent, report.acknowledged, report.rejected), (6, 6, 0));
        assert_eq!((report.optimized, report.optimized_through), (4, 5));
        assert_eq!((report.duplicates, report.reconnects, report.unanswered()), (0, 0, 0));
        let seen = std::mem::take(&mut *seen.lock().unwrap());
        let received =
            seen.iter().filter(|ack: &&v1::IngestAck| ack.status() == v1::AckStatus::Received);
        assert_eq!(received.map(|ack| ack.sequence).collect::<Vec<_>>(), [1, 2, 3, 4, 5, 6]);
        assert_eq!(report.revision, client.get_map("room").await.unwrap().revision);
    });
}

#[test]
fn a_refused_item_is_reported_and_the_session_goes_on() {
    run(async {
        let (_server, _proxy, client) = linked().await;
        let mut session = session(&client, SessionOptions::default()).await;
        session.send(camera(0)).await.unwrap();
        let mut bad = keyframe(0);
        bad.observations[3].pixel = Some(v1::Vector2 { x: f64::NAN, y: 1.0 });
        let sequence = session.send(bad).await.unwrap();
        let error = session.optimized(sequence).await.unwrap_err();
        let text = error.to_string();
        assert!(text.contains("keyframe.observations[3].pixel.x"), "{text}");
        assert!(text.contains("NOT_FINITE"), "{text}");
        session.send(keyframe(0)).await.unwrap();
        let report = session.finish().await.unwrap();
        assert_eq!((report.sent, report.acknowledged, report.rejected), (3, 2, 1));
        assert_eq!(report.rejections[0].sequence, sequence);
    });
}

#[test]
fn what_cannot_be_sent_is_told_before_it_is_sent() {
    run(async {
        let server = TestServer::with(|config| config.max_message_bytes = 4096).await;
        server.create_map("room").await;
        let client = direct(&server).await;
        let mut session = session(&client, SessionOptions::default()).await;
        session.send_as(7, camera(0)).await.unwrap();
        let error = session.send_as(7, camera(1)).await.unwrap_err();
        assert!(matches!(error, ClientError::SequenceOrder { sequence: 7, last: 7 }), "{error}");
        let landmarks = (0..200).map(landmark).collect();
        let error = session.send(v1::LandmarkBatch { landmarks }).await.unwrap_err();
        assert!(matches!(error, ClientError::TooLarge { limit: 4096, .. }), "{error}");
        session.send(camera(1)).await.unwrap();
        assert_eq!(session.finish().await.unwrap().acknowledged, 2);
        let error = client.ingest("attic", "robot", SessionOptions::default()).await.unwrap_err();
        assert_eq!(error.code(), Some(Code::NotFound), "{error}");
        assert_eq!(error.reason().as_deref(), Some("MAP_NOT_FOUND"));
        let error = Client::connect("nonsense").await.unwrap_err();
        assert!(matches!(error, ClientError::InvalidUrl { .. }), "{error}");
    });
}

#[test]
fn sending_waits_while_too_many_items_are_unanswered() {
    run(async {
        let (_server, proxy, client) = linked().await;
        let options = SessionOptions { max_unanswered: 2, ..SessionOptions::default() };
        let mut session = session(&client, options).await;
        proxy.hold(true);
        session.send(camera(0)).await.unwrap();
        session.send(keyframe(0)).await.unwrap();
        assert!(session.send(keyframe(1)).now_or_never().is_none(), "the outbox is full");
        proxy.hold(false);
        for id in 1..6 {
            session.send(keyframe(id)).await.unwrap();
        }
        let report = session.finish().await.unwrap();
        // The send that was given up sent nothing.
        assert_eq!((report.sent, report.acknowledged, report.duplicates), (7, 7, 0));
    });
}

#[test]
fn a_broken_link_is_resumed_and_lost_acks_do_no_harm() {
    run(async {
        let (server, proxy, client) = linked().await;
        let mut session = session(&client, SessionOptions::default()).await;
        session.send(camera(0)).await.unwrap();
        session.send(keyframe(0)).await.unwrap();
        session.flush().await.unwrap();
        // The server takes three keyframes whose acks are lost with the link.
        proxy.hold(true);
        for id in 1..4 {
            session.send(keyframe(id)).await.unwrap();
        }
        hold_keyframes(&server, 4).await;
        proxy.cut();
        proxy.hold(false);
        for id in 4..8 {
            session.send(keyframe(id)).await.unwrap();
        }
        let report = session.finish().await.unwrap();
        assert_eq!((report.sent, report.acknowledged, report.rejected), (9, 9, 0));
        assert_eq!(report.duplicates, 3, "sent again and recognized");
        assert!(report.reconnects >= 1);
        let map = client.get_map("room").await.unwrap();
        assert_eq!(map.counts.unwrap().keyframe_count, 8);
        assert!(map.clients[0].epoch >= 2);
        assert_eq!(map.clients[0].next_sequence, 10);
    });
}

#[test]
fn the_retries_are_bounded() {
    run(async {
        let (_server, proxy, client) = linked().await;
        let options = SessionOptions { retry: at_once(3), ..SessionOptions::default() };
        let mut session = client.ingest("room", "robot", options).await.unwrap();
        session.send(camera(0)).await.unwrap();
        session.flush().await.unwrap();
        proxy.close();
        proxy.cut();
        // The session may have given up before the item or after it.
        let sent = session.send(keyframe(0)).await;
        let error =
            if sent.is_ok() { session.flush().await.map(|()| 0) } else { sent }.unwrap_err();
        assert!(matches!(error, ClientError::RetriesExhausted { attempts: 3, .. }), "{error}");
        let error = session.send(keyframe(1)).await.unwrap_err();
        assert!(matches!(error, ClientError::RetriesExhausted { .. }), "{error}");
    });
}

#[test]
fn a_newer_session_takes_over_and_the_older_one_does_not_fight_back() {
    run(async {
        let (_server, _proxy, client) = linked().await;
        let mut old = session(&client, SessionOptions::default()).await;
        old.send(camera(0)).await.unwrap();
        old.flush().await.unwrap();
        let mut new = session(&client, SessionOptions::default()).await;
        assert_eq!((new.opened().epoch, new.next_sequence()), (2, 2));
        let error = old.finish().await.unwrap_err();
        assert!(matches!(error, ClientError::Fenced { .. }), "{error}");
        new.send(keyframe(0)).await.unwrap();
        assert_eq!(new.finish().await.unwrap().acknowledged, 1);
    });
}

#[test]
fn a_server_that_lost_the_map_is_a_clear_error() {
    run(async {
        for is_made_again in [false, true] {
            let (old, proxy, client) = linked().await;
            let mut session = session(&client, SessionOptions::default()).await;
            session.send(camera(0)).await.unwrap();
            session.flush().await.unwrap();
            // Another process with an empty journal answers at the same address.
            let new = TestServer::start().await;
            if is_made_again {
                new.create_map("room").await;
            }
            proxy.lead_to(new.running.local_addr());
            proxy.cut();
            let error = session.finish().await.unwrap_err();
            if is_made_again {
                assert!(matches!(error, ClientError::MapReplaced { .. }), "{error}");
            } else {
                assert!(matches!(error, ClientError::ServerRestarted { .. }), "{error}");
            }
            old.running.shutdown().await;
        }
    });
}

#[test]
fn a_mirror_follows_the_map_over_a_broken_link() {
    run(async {
        let (server, proxy, client) = linked().await;
        let options = WatchOptions { retry: at_once(50), ..WatchOptions::default() };
        let mut watch = client.watch("room", options).await.unwrap();
        let other = direct(&server).await;
        let mut session = session(&other, SessionOptions::default()).await;
        session.send(camera(0)).await.unwrap();
        let sequence = session.send(keyframe(0)).await.unwrap();
        session.optimized(sequence).await.unwrap();
        watch.reach(session.report().revision).await.unwrap();
        assert_eq!((watch.mirror().keyframes.len(), watch.mirror().landmarks.len()), (1, 60));

        proxy.cut();
        for id in 1..4 {
            session.send(keyframe(id)).await.unwrap();
        }
        session.send(relative_pose(0, 0, 3)).await.unwrap();
        let report = session.finish().await.unwrap();
        watch.reach(report.revision).await.unwrap();
        let mirror: &MapMirror = watch.mirror();
        assert_eq!((mirror.keyframes.len(), mirror.constraints.len()), (4, 1));
        assert!(mirror.map_from_odom("robot").is_some());

        let mut fresh = other.watch("room", WatchOptions::default()).await.unwrap();
        assert_eq!(fresh.next().await.unwrap(), watch.mirror(), "as if never broken");
        client.delete_map("room").await.unwrap();
        let error = watch.next().await.unwrap_err();
        assert_eq!(error.code(), Some(Code::NotFound), "{error}");
    });
}

#[test]
fn each_call_has_its_method() {
    run(async {
        let server = TestServer::start().await;
        let client = direct(&server).await;
        let policy = v1::MapPolicy { window_keyframe_count: Some(7), ..Default::default() };
        let map = client.create_map("b", Some(policy)).await.unwrap();
        assert_eq!(map.policy.unwrap().window_keyframe_count, Some(7));
        let error = client.create_map("b", None).await.unwrap_err();
        assert_eq!(error.code(), Some(Code::AlreadyExists), "{error}");
        client.create_map("a", None).await.unwrap();
        let maps = client.list_maps().await.unwrap();
        assert_eq!(maps.iter().map(|m| m.map_id.as_str()).collect::<Vec<_>>(), ["a", "b"]);
        client.delete_map("b").await.unwrap();
        assert!(client.find_map("b").await.unwrap().is_none());
        assert!(!client.server_info().await.unwrap().instance_id.is_empty());

        server.create_map("room").await;
        server.build_map("room", 5).await;
        let trajectory = client.trajectory("room", None).await.unwrap();
        assert_eq!(trajectory.poses.len(), 5);
        assert_eq!(client.trajectory("room", Some("robot")).await.unwrap(), trajectory);
        let landmarks = client.landmarks("room").await.unwrap();
        assert_eq!((landmarks.landmarks.len(), landmarks.revision), (60, trajectory.revision));

        let mut costs = Vec::new();
        let request = v1::OptimizeMapRequest { map_id: "room".to_owned(), ..Default::default() };
        let result = client.optimize_map(request, |row| costs.push(row.cost)).await.unwrap();
        let summary = result.summary.unwrap();
        assert_eq!(
            (costs.first(), costs.last()),
            (Some(&summary.initial_cost), Some(&summary.final_cost))
        );

        let mut export = client.export_map("room", v1::MapFormat::ColmapText).await.unwrap();
        let paths = export.header().paths.clone();
        assert_eq!(paths, ["cameras.txt", "images.txt", "points3D.txt"]);
        let mut ends = Vec::new();
        while let Some(chunk) = export.next().await.unwrap() {
            ends.extend(chunk.last_chunk.then_some(chunk.path));
        }
        assert_eq!(ends, paths);
    });
}
