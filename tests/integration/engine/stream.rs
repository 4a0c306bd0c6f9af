//! Streams: the order of acks, duplicates, rejections, epochs, resume, limits, ends.

use covis::map::{Depth, Item, ItemObservation, MapLimits, MapPolicy, Reason, Rejection};
use covis::service::engine::{Ack, AckStatus, EngineConfig, EngineError, StreamEvent};
use covis_solvers::geometry::Se3;

use super::{Client, Fixture, digest, noisy_keyframe, noisy_pose, open, optimized};
use crate::map_support::{camera_item, id, landmark, pose_at, pose_error, street_keyframe};

#[tokio::test]
async fn acks_come_in_the_order_of_items_and_solves_cover_the_last() {
    let fixture = Fixture::plain().await;
    // The starts are noisier than odometry counts as.
    let map = fixture.map(MapPolicy { odometry: false, ..MapPolicy::default() }).await;
    let mut client = Client::open(&map).await;
    client.send_street(0..6).await;
    let acks = client.finish().await;
    let received: Vec<(i64, i64)> = acks
        .iter()
        .filter(|a| matches!(a.status, AckStatus::Received { duplicate: false }))
        .map(|a| (a.sequence, a.revision))
        .collect();
    assert_eq!(received.iter().map(|r| r.0).collect::<Vec<_>>(), [1, 2, 3, 4, 5, 6, 7]);
    assert!(received.windows(2).all(|w| w[0].1 < w[1].1), "{received:?}");
    let covered = optimized(&acks);
    assert!(covered.windows(2).all(|w| w[0].0 < w[1].0), "{covered:?}");
    assert_eq!(covered.last().unwrap().0, 7);
    let snapshot = map.snapshot().await.unwrap();
    assert_eq!(snapshot.clients()[0].optimized_sequence, 7);
    assert_eq!((snapshot.keyframes().len(), snapshot.clients()[0].next_sequence), (6, 8));
    // Nothing but the first starts says how long a meter is.
    let errors = |pose: &dyn Fn(i64) -> Se3| -> f64 {
        (1..6).map(|index| pose_error(&pose(index), &pose_at(index as f64))).sum()
    };
    let solved = errors(&|index| snapshot.keyframes().get(&id(index)).unwrap().world_from_camera);
    assert!(solved < 0.8 * errors(&noisy_pose), "{solved}");
}

#[tokio::test]
async fn sending_again_is_harmless() {
    let fixture = Fixture::plain().await;
    let map = fixture.map(MapPolicy::default()).await;
    let mut client = Client::open(&map).await;
    client.send_street(0..2).await;
    client.sequence = 10;
    client.send(noisy_keyframe(2)).await;
    client.received(10).await;
    let revision = map.snapshot().await.unwrap().revision();
    let sends = [
        (2, noisy_keyframe(0), "duplicate"),
        (2, noisy_keyframe(1), "AlreadyExists sequence"),
        (5, noisy_keyframe(5), "OutOfRange sequence"),
        (11, noisy_keyframe(1), "duplicate"),
        (12, camera_item(0), "duplicate"),
        (13, Item::Landmarks { landmarks: vec![landmark(3), landmark(4)] }, "duplicate"),
        (14, street_keyframe(1, pose_at(1.5), &Default::default()), "AlreadyExists keyframe.id"),
    ];
    for (sequence, item, expected) in sends {
        client.sender.send(sequence, digest(&item), item).await.unwrap();
        let ack = client.received(sequence).await;
        let found = match &ack.status {
            AckStatus::Received { duplicate: true } => "duplicate".to_owned(),
            AckStatus::Rejected(Rejection { violations }) => {
                assert_eq!(ack.revision, 0);
                format!("{:?} {}", violations[0].reason, violations[0].field)
            }
            AckStatus::Received { duplicate: false }
            | AckStatus::Durable
            | AckStatus::Optimized { .. } => format!("{:?}", ack.status),
        };
        assert_eq!(found, expected, "sequence {sequence}");
    }
    // Duplicates of keyframes are covered too: nobody waits forever.
    let mut acks = std::mem::take(&mut client.seen);
    acks.extend(client.finish().await);
    assert_eq!(optimized(&acks).last().unwrap().0, 11);
    let after = map.snapshot().await.unwrap();
    // What was acknowledged as a duplicate under a sequence of its own is journaled under it.
    assert_eq!((after.keyframes().len(), after.clients()[0].next_sequence), (3, 14));
    assert_eq!(fixture.replayed().await.clients()[0].next_sequence, 14);
    assert!(after.revision() >= revision);
}

#[tokio::test]
async fn a_bad_item_is_refused_and_the_stream_lives() {
    let fixture = Fixture::plain().await;
    let map = fixture.map(MapPolicy::default()).await;
    let mut client = Client::open(&map).await;
    let orphan = client.send(noisy_keyframe(0)).await;
    let reason = |ack: Ack| {
        let AckStatus::Rejected(rejection) = ack.status else { panic!("{ack:?}") };
        rejection.violations[0].reason
    };
    assert_eq!(reason(client.received(orphan).await), Reason::UnknownReference);
    let refused = Rejection::of("keyframe.rig_id", Reason::Unimplemented, "not served yet");
    client.sender.reject(client.sequence, refused, None).await.unwrap();
    assert_eq!(reason(client.received(client.sequence).await), Reason::Unimplemented);
    client.sequence += 1;
    client.send_street(0..2).await;
    let acks = client.finish().await;
    assert_eq!(optimized(&acks).last().unwrap().0, 5);
}

#[tokio::test]
async fn numbers_that_did_not_come_over_the_wire_cannot_poison_a_map() {
    let fixture = Fixture::plain().await;
    let map = fixture.map(MapPolicy::default()).await;
    let mut client = Client::open(&map).await;
    client.send_street(0..1).await;
    let bad = |change: fn(&mut ItemObservation)| {
        let mut item = noisy_keyframe(1);
        let Item::Keyframe { observations, .. } = &mut item else { panic!("{item:?}") };
        change(&mut observations[0]);
        item
    };
    let items = [
        bad(|seen| seen.pixel.x = f64::NAN),
        bad(|seen| seen.sigma_px = 0.0),
        bad(|seen| seen.depth = Some(Depth { depth_m: -1.0, sigma_m: 0.1 })),
        bad(|seen| seen.depth = Some(Depth { depth_m: 1.0, sigma_m: f64::INFINITY })),
    ];
    for item in items {
        let sequence = client.send(item).await;
        let ack = client.received(sequence).await;
        let AckStatus::Rejected(rejection) = ack.status else { panic!("{ack:?}") };
        assert_eq!(rejection.violations[0].reason, Reason::OutOfRange);
    }
    client.send_street(1..3).await;
    client.finish().await;
    assert_eq!(map.snapshot().await.unwrap().keyframes().len(), 3);
}

#[tokio::test]
async fn a_newer_epoch_fences_the_older_stream_and_resumes() {
    let fixture = Fixture::plain().await;
    let map = fixture.map(MapPolicy::default()).await;
    let mut first = Client::open(&map).await;
    first.send_street(0..2).await;
    first.received(3).await;
    let stream = map.open_stream("robot".to_owned(), 5, false).await.unwrap();
    assert_eq!((stream.opened.next_sequence, stream.opened.epoch), (4, 5));
    let fenced = |epoch| EngineError::EpochFenced {
        map: "house".to_owned(),
        client: "robot".to_owned(),
        epoch,
        newest: 5,
    };
    assert_eq!(first.end().await, fenced(1));
    let item = noisy_keyframe(2);
    assert_eq!(first.sender.send(4, digest(&item), item).await, Err(fenced(1)));
    for epoch in [1, 5] {
        let refused = map.open_stream("robot".to_owned(), epoch, false).await;
        assert_eq!(refused.unwrap_err(), fenced(epoch));
    }
    // Another client is not concerned.
    map.open_stream("drone".to_owned(), 0, false).await.unwrap();
    let mut second = Client::of(stream);
    second.send(noisy_keyframe(2)).await;
    assert!(matches!(second.received(4).await.status, AckStatus::Received { duplicate: false }));
    assert_eq!(optimized(&second.finish().await).last().unwrap().0, 4);
}

#[tokio::test]
async fn a_limit_ends_the_stream_and_rejects_nothing() {
    let fixture = Fixture::plain().await;
    let limits = MapLimits { keyframes: Some(2), ..MapLimits::default() };
    let map = fixture.map(MapPolicy { limits, ..MapPolicy::default() }).await;
    let mut client = Client::open(&map).await;
    client.send_street(0..3).await;
    let expected =
        EngineError::MapLimit { map: "house".to_owned(), limit: "max_keyframe_count", maximum: 2 };
    assert_eq!(client.end().await, expected);
    assert_eq!(map.snapshot().await.unwrap().keyframes().len(), 2);
    assert_eq!(Client::open(&map).await.sequence, 4);
}

#[tokio::test]
async fn deleting_a_map_ends_its_streams_and_watchers() {
    let fixture = Fixture::plain().await;
    let map = fixture.map(MapPolicy::default()).await;
    let uid = map.uid().to_owned();
    let mut client = Client::open(&map).await;
    client.send_street(0..2).await;
    let mut watch = map.watch(None).await.unwrap();
    fixture.maps.delete("house").await.unwrap();
    let gone = EngineError::MapNotFound { map: "house".to_owned() };
    assert_eq!(client.end().await, gone);
    let ended = loop {
        if let Err(error) = watch.next().await {
            break error;
        }
    };
    assert_eq!(ended, gone);
    assert_eq!(map.snapshot().await.unwrap_err(), gone);
    assert_eq!(fixture.maps.get("house").unwrap_err(), gone);
    assert_eq!(fixture.maps.delete("house").await, Err(gone));
    assert!(fixture.maps.list().is_empty());
    let again = fixture.map(MapPolicy::default()).await;
    assert_ne!(again.uid(), uid);
    let taken = fixture.maps.create("house", "", MapPolicy::default()).await.unwrap_err();
    assert_eq!(taken, EngineError::MapExists { map: "house".to_owned() });
}

#[tokio::test]
async fn shutdown_finishes_what_was_queued() {
    let fixture = Fixture::plain().await;
    let map = fixture.map(MapPolicy::default()).await;
    let mut client = Client::open(&map).await;
    client.send_street(0..8).await;
    fixture.maps.shutdown(std::time::Duration::from_secs(60)).await;
    let mut acks = Vec::new();
    let end = loop {
        match client.event().await {
            StreamEvent::Ack(ack) => acks.push(ack),
            StreamEvent::End(error) => break error,
        }
    };
    assert_eq!(end, EngineError::ShuttingDown);
    assert_eq!(optimized(&acks).last().unwrap().0, 9);
    assert_eq!(map.snapshot().await.unwrap_err(), EngineError::ShuttingDown);
    let late = fixture.maps.create("late", "", MapPolicy::default()).await;
    assert_eq!(late.unwrap_err(), EngineError::ShuttingDown);
    let replayed = fixture.replayed().await;
    assert_eq!(replayed.keyframes().len(), 8);
    assert_eq!(replayed.clients()[0].optimized_sequence, 9);
}

#[tokio::test]
async fn a_restart_on_the_same_store_brings_the_map_back() {
    let fixture = Fixture::plain().await;
    let map = fixture.map(MapPolicy::default()).await;
    let mut client = Client::open(&map).await;
    client.send_street(0..4).await;
    client.finish().await;
    let before = map.snapshot().await.unwrap();
    assert_eq!(fixture.replayed().await.state_hash(), before.state_hash());
    fixture.maps.shutdown(std::time::Duration::from_secs(60)).await;
    let maps = open(&fixture.store, EngineConfig::default(), 1).await;
    let again = maps.get("house").unwrap();
    assert_eq!(again.uid(), map.uid());
    assert_eq!(again.snapshot().await.unwrap().state_hash(), before.state_hash());
    let mut client = Client::open(&again).await;
    assert_eq!(client.sequence, 6);
    client.send(noisy_keyframe(4)).await;
    assert_eq!(optimized(&client.finish().await), [(6, fixture.solves().await.len() as i64)]);
}

#[tokio::test]
async fn a_reader_that_does_not_read_slows_its_sender_only() {
    let config = EngineConfig { queue_capacity: 1, ..EngineConfig::default() };
    let fixture = Fixture::new(config, 1).await;
    let map = fixture.map(MapPolicy::default()).await;
    let mut slow = Client::open(&map).await;
    // More items than events have room: the sender stops, the map does not.
    let Client { sender, events, .. } = slow;
    let sending = tokio::spawn(async move {
        for sequence in 1..=40 {
            let item = Item::Landmarks { landmarks: vec![landmark(sequence)] };
            sender.send(sequence, digest(&item), item).await.unwrap();
        }
        sender
    });
    let mut other = Client::of(map.open_stream("drone".to_owned(), 0, false).await.unwrap());
    for index in 0..20 {
        other.send(Item::Landmarks { landmarks: vec![landmark(index)] }).await;
        other.received(index + 1).await;
    }
    assert!(!sending.is_finished());
    slow = Client { events, ..Client::open_as(&map, "unused").await };
    for sequence in 1..=40 {
        slow.received(sequence).await;
    }
    drop(sending.await.unwrap());
    assert_eq!(map.snapshot().await.unwrap().landmarks().len(), 60);
}
