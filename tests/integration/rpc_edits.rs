//! Edits over the wire: each kind is taken, solved and told to watchers; a re-sent one is harmless; a
//! map on disk that is killed after each of them comes back as it was.

use covis::client::{Client, IngestSession, MapMirror, SessionOptions, WatchOptions};
use covis::wire::v1;
use tokio::sync::mpsc::{UnboundedReceiver, unbounded_channel};
use v1::ingest_request::Item;

use crate::cli_support::{Running, Workspace};
use crate::common::{
    Stream, TestServer, camera, diagonal, keyframe, relative_pose, run, shift, vector3,
};
use crate::durable::on_disk;

fn keyframe_ref(id: i64) -> Option<v1::KeyframeRef> {
    Some(v1::KeyframeRef { client_id: "robot".to_owned(), id })
}

fn landmark_ref(id: i64) -> v1::LandmarkRef {
    v1::LandmarkRef { client_id: "robot".to_owned(), id }
}

fn seen(keyframe: i64, landmark: i64) -> v1::ObservationRef {
    let landmark = Some(landmark_ref(landmark));
    v1::ObservationRef { keyframe: keyframe_ref(keyframe), landmark, camera_index: 0 }
}

fn remove_observations(pairs: &[(i64, i64)]) -> Item {
    let observations = pairs.iter().map(|&(k, l)| seen(k, l)).collect();
    v1::RemoveObservations { observations }.into()
}

fn remove_keyframe(id: i64) -> Item {
    v1::RemoveKeyframe { keyframe: keyframe_ref(id) }.into()
}

fn remove_landmarks(ids: &[i64]) -> Item {
    v1::RemoveLandmarks { landmarks: ids.iter().map(|&id| landmark_ref(id)).collect() }.into()
}

fn fuse(kept: i64, absorbed: i64) -> Item {
    let (kept, absorbed) = (Some(landmark_ref(kept)), vec![landmark_ref(absorbed)]);
    v1::FuseLandmarks { kept, absorbed }.into()
}

fn revoke(id: i64) -> Item {
    let constraint = Some(v1::ConstraintRef { client_id: "robot".to_owned(), id });
    v1::RevokeConstraint { constraint }.into()
}

fn closure(id: i64, i: i64, j: i64) -> Item {
    let kind = v1::ConstraintKind::LoopClosure.into();
    Item::RelativePose(v1::RelativePoseConstraint { kind, ..relative_pose(id, i, j) })
}

fn set_camera(fx: f64) -> Item {
    let model =
        v1::PinholeRadialTangential { fx, fy: 500.0, cx: 319.5, cy: 239.5, ..Default::default() };
    let model = Some(v1::camera::Model::PinholeRadialTangential(model));
    Item::SetCamera(v1::Camera { client_id: "robot".to_owned(), model, ..camera(0) })
}

/// Camera, six keyframes, a constraint, a closure and a prior: sequences 1 to 10.
fn building() -> Vec<Item> {
    let mut items = vec![Item::Camera(camera(0))];
    items.extend((0..6).map(|id| Item::Keyframe(keyframe(id))));
    items.push(Item::RelativePose(relative_pose(1, 0, 1)));
    items.push(closure(2, 0, 5));
    items.push(Item::PosePrior(v1::PosePrior {
        id: 3,
        keyframe: keyframe_ref(2),
        world_from_camera: Some(shift([0.24, 0.06, 0.0])),
        information: Some(v1::InformationMatrix6 { upper_triangle: diagonal(6, 10.0) }),
        ..Default::default()
    }));
    items
}

/// Edits of every kind, and what they removed sent again. The second value tells whether the map has
/// something to solve then.
fn editing() -> Vec<(Item, bool)> {
    vec![
        (remove_observations(&[(1, 3), (1, 4), (2, 3)]), true),
        (remove_observations(&[(3, 5)]), true),
        // Keyframe 3 now sees the first by the second's observation.
        (fuse(5, 6), true),
        (remove_landmarks(&[7, 8]), true),
        (set_camera(501.0), true),
        (revoke(1), false),
        (revoke(2), true),
        // A prior that goes frees what it held.
        (revoke(3), true),
        (remove_keyframe(4), true),
        (closure(2, 0, 5), true),
        (Item::Keyframe(v1::Keyframe { observations: Vec::new(), ..keyframe(4) }), false),
        // The closure goes with its keyframe.
        (remove_keyframe(5), true),
    ]
}

async fn client_of(server: &TestServer) -> Client {
    Client::connect(&format!("http://{}", server.running.local_addr())).await.unwrap()
}

/// A session whose acks come through a channel.
async fn session(client: &Client, name: &str) -> (IngestSession, UnboundedReceiver<v1::IngestAck>) {
    let (sender, acks) = unbounded_channel();
    let options = SessionOptions { lock_step: true, ..SessionOptions::default() };
    let options = options.on_ack(move |ack| _ = sender.send(ack.clone()));
    (client.ingest("house", name, options).await.unwrap(), acks)
}

/// Waits for an ack that covers `sequence`.
async fn wait(
    acks: &mut UnboundedReceiver<v1::IngestAck>,
    status: v1::AckStatus,
    sequence: i64,
) -> v1::IngestAck {
    loop {
        let ack = acks.recv().await.expect("the stream goes on");
        assert!(ack.violations.is_empty(), "{ack:?}");
        if ack.status() == status && ack.sequence >= sequence {
            return ack;
        }
    }
}

/// The map as a new watcher gets it.
async fn fresh(client: &Client) -> MapMirror {
    let mut watch = client.watch("house", WatchOptions::default()).await.unwrap();
    watch.next().await.unwrap().clone()
}

#[test]
fn each_edit_is_solved_and_told_to_watchers() {
    run(async {
        let server = TestServer::lock_step().await;
        let client = client_of(&server).await;
        client.create_map("house", None).await.unwrap();
        let (mut robot, mut robot_acks) = session(&client, "robot").await;
        for item in building() {
            robot.send(item).await.unwrap();
        }
        // The prior has the last one that is solved.
        let mut solves = wait(&mut robot_acks, v1::AckStatus::Optimized, 10).await.solve_id;
        robot.flush().await.unwrap();
        let features = client.server_info().await.unwrap().features;
        for name in ["revoke-constraint", "remove-observations", "fuse-landmarks", "set-camera"] {
            assert!(features.contains(&format!("ingest.{name}")), "{name}");
        }
        let mut watch = client.watch("house", WatchOptions::default()).await.unwrap();
        watch.next().await.unwrap();
        // Another client edits: what it names belongs to the robot.
        let (mut editor, mut editor_acks) = session(&client, "editor").await;
        for (item, is_solved) in editing() {
            let before = client.get_map("house").await.unwrap().counts.unwrap();
            let what = format!("{item:?}");
            let adds = matches!(item, Item::RelativePose(_) | Item::Keyframe(_));
            let (session, acks) = match adds {
                true => (&mut robot, &mut robot_acks),
                false => (&mut editor, &mut editor_acks),
            };
            let sequence = session.send(item).await.unwrap();
            let ack = wait(acks, v1::AckStatus::Optimized, sequence).await;
            assert_eq!(ack.solve_failure, None, "{what}");
            assert_eq!(ack.solve_id > solves, is_solved, "{what}: {ack:?}");
            solves = solves.max(ack.solve_id);
            let after = client.get_map("house").await.unwrap().counts.unwrap();
            let removes = !adds && !what.starts_with("SetCamera");
            assert!(!removes || after.size_bytes < before.size_bytes, "{what}");
        }
        let revision = client.get_map("house").await.unwrap().revision;
        let followed = watch.reach(revision).await.unwrap();
        let now = fresh(&client).await;
        assert_eq!(followed.keyframes, now.keyframes);
        assert_eq!(followed.landmarks, now.landmarks);
        assert_eq!(followed.constraints, now.constraints);
        assert_eq!(
            (&followed.cameras, &followed.client_frames),
            (&now.cameras, &now.client_frames)
        );
        let keyframes: Vec<i64> = now.keyframes.keys().map(|(_, id)| *id).collect();
        assert_eq!((keyframes, now.landmarks.len()), (vec![0, 1, 2, 3, 4], 57));
        assert!(now.constraints.is_empty());
        let count = |id: i64| now.landmarks[&("robot".to_owned(), id)].observation_count;
        // Five keyframes are left, of which the fourth sees nothing any more.
        assert_eq!([count(3), count(4), count(5), count(9)], [2, 3, 4, 4]);
        // The last one takes the robot's frame along.
        assert!(watch.mirror().map_from_odom("robot").is_some());
        for id in 0..5 {
            editor.send(remove_keyframe(id)).await.unwrap();
        }
        editor.flush().await.unwrap();
        let followed = watch.reach(editor.report().revision).await.unwrap();
        assert!(followed.keyframes.is_empty() && followed.map_from_odom("robot").is_none());
        assert_eq!(followed.client_frames, fresh(&client).await.client_frames);
    });
}

#[test]
fn an_edit_that_is_sent_again_is_harmless() {
    run(async {
        let server = TestServer::lock_step().await;
        server.create_map("house").await;
        let (mut stream, _) = Stream::open(&server, "house", "robot", 0).await;
        for (sequence, item) in (1..).zip(building()) {
            assert!(stream.put(sequence, item).await.violations.is_empty());
        }
        stream.put(11, revoke(2)).await;
        stream.put(12, closure(2, 0, 5)).await;
        let revision = stream.put(13, set_camera(502.0)).await.revision;
        drop(stream);
        let (mut stream, opened) = Stream::open(&server, "house", "robot", 0).await;
        assert_eq!(opened.next_sequence, 14);
        // Under its sequence: the closure that was sent after it stays.
        let ack = stream.put(11, revoke(2)).await;
        assert_eq!((ack.status(), ack.duplicate), (v1::AckStatus::Received, true));
        assert!(ack.revision > revision, "the opening of the stream is the newest");
        let other = stream.put(12, revoke(1)).await;
        assert_eq!(other.violations[0].reason(), v1::ViolationReason::AlreadyExists);
        assert!(stream.put(13, set_camera(502.0)).await.duplicate);
        let ack = stream.put(14, set_camera(502.0)).await;
        assert!(ack.duplicate, "it is so already");
        // Under another one it is a new edit.
        assert!(stream.put(15, revoke(2)).await.violations.is_empty());
        let gone = stream.put(16, revoke(2)).await;
        assert_eq!(
            (&gone.violations[0].field[..], gone.violations[0].reason()),
            ("revoke_constraint.constraint", v1::ViolationReason::UnknownReference)
        );
        // The camera that a robot sends when it begins is still the one that it added.
        assert!(stream.put(17, Item::Camera(camera(0))).await.duplicate);
        stream.finish().await.unwrap();
        let counts = client_of(&server).await.get_map("house").await.unwrap().counts.unwrap();
        assert_eq!(counts.constraint_count, 2);
    });
}

#[test]
fn a_landmark_that_was_fused_or_removed_is_unknown_to_later_items() {
    run(async {
        let server = TestServer::lock_step().await;
        server.create_map("house").await;
        let (mut stream, _) = Stream::open(&server, "house", "robot", 0).await;
        for (sequence, item) in (1..).zip(building()) {
            stream.put(sequence, item).await;
        }
        stream.put(11, fuse(5, 6)).await;
        let ack = stream.put(12, Item::Keyframe(keyframe(6))).await;
        assert_eq!(ack.violations[0].field, "keyframe.observations[6].landmark");
        assert_eq!(ack.violations[0].reason(), v1::ViolationReason::UnknownReference);
        // Sent again it is another landmark.
        let landmark = v1::Landmark {
            id: 6,
            point_in_world: Some(vector3([0.0, 0.0, 9.0])),
            ..Default::default()
        };
        let batch = v1::LandmarkBatch { landmarks: vec![landmark] };
        assert!(stream.put(13, Item::Landmarks(batch)).await.violations.is_empty());
        assert!(stream.put(14, Item::Keyframe(keyframe(6))).await.violations.is_empty());
        stream.finish().await.unwrap();
    });
}

/// The hash of the map's content after the whole session on a server that nobody kills.
async fn undisturbed() -> Vec<u8> {
    let server = TestServer::lock_step().await;
    let client = client_of(&server).await;
    client.create_map("house", None).await.unwrap();
    let (mut robot, _acks) = session(&client, "robot").await;
    for item in building().into_iter().chain(editing().into_iter().map(|(item, _)| item)) {
        robot.send(item).await.unwrap();
    }
    let report = robot.finish().await.unwrap();
    assert_eq!(report.rejected, 0, "{report:?}");
    client.get_map_digests("house").await.unwrap().1.state_hash
}

/// Runs the session, one edit a server, each killed once the edit has that status. Returns the hash of
/// the content in the end.
async fn killed_after_each(status: v1::AckStatus) -> Vec<u8> {
    let workspace = Workspace::new();
    let folder = workspace.path("maps");
    let mut server = Running::with(&workspace, &folder, &["--lock-step"]);
    let client = Client::connect(&server.url).await.unwrap();
    client.create_map("house", None).await.unwrap();
    let (mut robot, _acks) = session(&client, "robot").await;
    for item in building() {
        robot.send(item).await.unwrap();
    }
    robot.finish().await.unwrap();
    server.kill();
    for (item, _) in editing() {
        let what = format!("{item:?}");
        let mut server = Running::with(&workspace, &folder, &["--lock-step"]);
        let client = Client::connect(&server.url).await.unwrap();
        let (mut robot, mut acks) = session(&client, "robot").await;
        let sequence = robot.send(item).await.unwrap();
        wait(&mut acks, v1::AckStatus::Durable, sequence).await;
        let mut served = None;
        if status == v1::AckStatus::Optimized {
            robot.optimized(sequence).await.unwrap();
            let (map, digests) = client.get_map_digests("house").await.unwrap();
            served = Some((map.revision, digests.state_hash));
        }
        server.kill();
        let map = on_disk(&folder, "house").await;
        assert!(map.clients()[0].next_sequence > sequence, "{what}");
        if let Some((revision, hash)) = served
            && revision == map.revision()
        {
            assert_eq!(hash, map.content_hash(), "{what}");
        }
    }
    let server = Running::with(&workspace, &folder, &["--lock-step"]);
    let client = Client::connect(&server.url).await.unwrap();
    // What the last kill cut short is solved before this is answered.
    let (mut robot, _acks) = session(&client, "robot").await;
    let last = robot.opened().next_sequence - 1;
    robot.send_as(last, remove_keyframe(5)).await.unwrap();
    let report = robot.finish().await.unwrap();
    assert_eq!((report.duplicates, report.rejected), (1, 0));
    client.get_map_digests("house").await.unwrap().1.state_hash
}

#[test]
fn a_server_that_is_killed_after_each_edit_ends_with_the_same_map() {
    run(async {
        let expected = undisturbed().await;
        for status in [v1::AckStatus::Durable, v1::AckStatus::Optimized] {
            assert_eq!(killed_after_each(status).await, expected, "killed at {status:?}");
        }
    });
}
