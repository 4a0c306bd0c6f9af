//! `UpdateMap`: name, policy by mask, and a map that is frozen and opened again.

use covis::wire::v1;
use tonic::{Code, Status};
use v1::ingest_request::Item;

use crate::common::{
    Stream, TestServer, camera, check_field, check_retry, check_status, information6, keyframe,
    occupy, open_item, run, shift,
};

fn request(paths: &[&str]) -> v1::UpdateMapRequest {
    let paths = paths.iter().map(|&path| path.to_owned()).collect();
    v1::UpdateMapRequest {
        map_id: "room".to_owned(),
        update_mask: Some(prost_types::FieldMask { paths }),
        ..Default::default()
    }
}

async fn update(server: &TestServer, request: v1::UpdateMapRequest) -> Result<v1::Map, Status> {
    Ok(server.maps().update_map(request).await?.into_inner().map.unwrap())
}

async fn set_state(server: &TestServer, state: v1::MapState) -> v1::Map {
    let request = v1::UpdateMapRequest { state: state.into(), ..request(&["state"]) };
    update(server, request).await.unwrap()
}

async fn get(server: &TestServer) -> v1::Map {
    let request = v1::GetMapRequest { map_id: "room".to_owned(), ..Default::default() };
    server.maps().get_map(request).await.unwrap().into_inner().map.unwrap()
}

#[test]
fn a_policy_that_is_sent_back_as_it_was_answered_changes_nothing() {
    run(async {
        let server = TestServer::start().await;
        let before = server.create_map("room").await;
        let same = v1::UpdateMapRequest { policy: before.policy, ..request(&["policy"]) };
        assert_eq!(update(&server, same).await.unwrap(), before);
        let twin = server.create_map_with("twin", before.policy.unwrap()).await;
        assert_eq!(twin.policy, before.policy);
    });
}

#[test]
fn update_map_changes_what_the_mask_names_and_nothing_else() {
    run(async {
        let server = TestServer::start().await;
        let policy = v1::MapPolicy {
            window_keyframe_count: Some(7),
            limits: Some(v1::MapLimits { max_keyframe_count: Some(50), ..Default::default() }),
            ..Default::default()
        };
        let before = server.create_map_with("room", policy).await;
        let wanted = v1::UpdateMapRequest {
            display_name: "Our room".to_owned(),
            policy: Some(v1::MapPolicy {
                max_iteration_count: Some(3),
                // Not named, and so not read.
                window_keyframe_count: Some(-1),
                limits: Some(v1::MapLimits { max_landmark_count: Some(9), ..Default::default() }),
                ..Default::default()
            }),
            expected_revision: Some(before.revision),
            ..request(&[
                "display_name",
                "policy.max_iteration_count",
                "policy.limits.max_landmark_count",
                "policy.when_full",
            ])
        };
        let after = update(&server, wanted.clone()).await.unwrap();
        assert_eq!(
            (after.display_name.as_str(), after.revision),
            ("Our room", before.revision + 1)
        );
        let limits =
            v1::MapLimits { max_landmark_count: Some(9), ..before.policy.unwrap().limits.unwrap() };
        let expected = v1::MapPolicy {
            max_iteration_count: Some(3),
            limits: Some(limits),
            ..before.policy.unwrap()
        };
        assert_eq!(after.policy, Some(expected));
        assert_eq!((after.clone(), after.uid.clone()), (get(&server).await, before.uid));

        // The whole policy: absent fields take the server's defaults.
        let whole = v1::UpdateMapRequest {
            policy: Some(v1::MapPolicy {
                local_bundle_adjustment: Some(false),
                ..Default::default()
            }),
            ..request(&["policy"])
        };
        let policy = update(&server, whole.clone()).await.unwrap().policy.unwrap();
        assert_eq!(policy.local_bundle_adjustment, Some(false));
        assert_eq!(
            (policy.window_keyframe_count, policy.max_iteration_count),
            (Some(20), Some(10))
        );
        // The same again changes nothing, and is no event.
        let revision = get(&server).await.revision;
        assert_eq!(update(&server, whole).await.unwrap().revision, revision);
        let late = v1::UpdateMapRequest { expected_revision: Some(revision - 1), ..wanted };
        let status = update(&server, late).await.unwrap_err();
        check_status(&status, Code::Aborted, "REVISION_MISMATCH");
        assert_eq!(get(&server).await.revision, revision);
    });
}

#[test]
fn update_map_refuses_bad_requests() {
    run(async {
        let server = TestServer::start().await;
        let before = server.create_map("room").await;
        let state = |state: i32| v1::UpdateMapRequest { state, ..request(&["state"]) };
        let policy = |path, policy| v1::UpdateMapRequest {
            policy: Some(policy),
            ..request(&["display_name", path])
        };
        let window = v1::MapPolicy { window_keyframe_count: Some(1), ..Default::default() };
        let cases = [
            (request(&[]), "update_mask", "MISSING"),
            (v1::UpdateMapRequest { update_mask: None, ..request(&[]) }, "update_mask", "MISSING"),
            (request(&["map_id"]), "update_mask", "UNKNOWN_VALUE"),
            // Each stands for all fields.
            (request(&["policy"; 65]), "update_mask", "TOO_LARGE"),
            (request(&["policy.color"]), "update_mask", "UNKNOWN_VALUE"),
            (request(&["policy."]), "update_mask", "UNKNOWN_VALUE"),
            (state(0), "state", "MISSING"),
            (state(v1::MapState::Poisoned.into()), "state", "OUT_OF_RANGE"),
            (state(77), "state", "UNKNOWN_VALUE"),
            (
                v1::UpdateMapRequest {
                    display_name: "x".repeat(257),
                    ..request(&["display_name"])
                },
                "display_name",
                "TOO_LARGE",
            ),
            (
                policy("policy.window_keyframe_count", window),
                "policy.window_keyframe_count",
                "OUT_OF_RANGE",
            ),
            (
                v1::UpdateMapRequest { expected_revision: Some(-1), ..request(&["display_name"]) },
                "expected_revision",
                "OUT_OF_RANGE",
            ),
            (
                v1::UpdateMapRequest { map_id: String::new(), ..request(&["display_name"]) },
                "map_id",
                "MISSING",
            ),
        ];
        for (request, field, reason) in cases {
            check_field(&update(&server, request).await.unwrap_err(), field, reason);
        }
        let none = v1::UpdateMapRequest { map_id: "none".to_owned(), ..request(&["display_name"]) };
        let status = update(&server, none).await.unwrap_err();
        check_status(&status, Code::NotFound, "MAP_NOT_FOUND");
        assert_eq!(get(&server).await.revision, before.revision, "nothing was changed");
    });
}

#[test]
fn a_poisoned_map_is_not_updated() {
    run(async {
        let server = TestServer::with_poisoned_map("room").await;
        let status = update(&server, request(&["display_name"])).await.unwrap_err();
        check_status(&status, Code::FailedPrecondition, "MAP_POISONED");
    });
}

#[test]
fn a_map_keeps_its_anchor_as_long_as_it_holds_priors() {
    run(async {
        let server = TestServer::start().await;
        let anchored = |latitude_deg| v1::UpdateMapRequest {
            policy: Some(v1::MapPolicy {
                geodetic_anchor: Some(v1::GeodeticPosition { latitude_deg, ..Default::default() }),
                ..Default::default()
            }),
            ..request(&["policy.geodetic_anchor"])
        };
        server.create_map("room").await;
        server.build_map("room", 1).await;
        for latitude_deg in [40.0, 41.0] {
            update(&server, anchored(latitude_deg)).await.unwrap();
        }
        let (mut stream, opened) = Stream::open(&server, "room", "robot", 0).await;
        let prior = v1::PosePrior {
            id: 1,
            keyframe: Some(v1::KeyframeRef { id: 0, ..Default::default() }),
            world_from_camera: Some(shift([0.0; 3])),
            information: Some(information6(1.0)),
            ..Default::default()
        };
        stream.put(opened.next_sequence, Item::PosePrior(prior)).await;
        for wanted in [anchored(40.0), request(&["policy.geodetic_anchor"])] {
            let status = update(&server, wanted).await.unwrap_err();
            check_status(&status, Code::FailedPrecondition, "ANCHOR_IN_USE");
        }
        let same = update(&server, anchored(41.0)).await.unwrap();
        assert_eq!(same.counts.unwrap().constraint_count, 1);
    });
}

#[test]
fn a_limit_below_what_the_map_holds_keeps_it_and_lets_nothing_in() {
    run(async {
        let server = TestServer::start().await;
        server.create_map("room").await;
        server.build_map("room", 3).await;
        let limits = v1::MapLimits { max_keyframe_count: Some(1), ..Default::default() };
        let lower = v1::UpdateMapRequest {
            policy: Some(v1::MapPolicy { limits: Some(limits), ..Default::default() }),
            ..request(&["policy.limits.max_keyframe_count"])
        };
        let map = update(&server, lower).await.unwrap();
        assert_eq!(map.counts.unwrap().keyframe_count, 3);
        let (mut stream, _) = Stream::open(&server, "room", "robot", 0).await;
        stream.send(10, Item::Keyframe(keyframe(3))).await;
        let status = stream.end().await;
        check_status(&status, Code::ResourceExhausted, "MAP_LIMIT");
        check_retry(&status);
    });
}

#[test]
fn a_frozen_map_is_read_and_takes_nothing() {
    run(async {
        let server = TestServer::start().await;
        server.create_map("room").await;
        server.build_map("room", 3).await;
        let (mut stream, _) = Stream::open(&server, "room", "drone", 0).await;
        let watch = v1::WatchMapRequest { map_id: "room".to_owned(), ..Default::default() };
        let mut watch = server.maps().watch_map(watch).await.unwrap().into_inner();
        let mut told = async || loop {
            let delta = watch.message().await.unwrap().unwrap().delta.unwrap();
            if delta.last_part {
                return delta.state();
            }
        };
        assert_eq!(told().await, v1::MapState::Open);

        let frozen = set_state(&server, v1::MapState::Frozen).await;
        assert_eq!(frozen.state(), v1::MapState::Frozen);
        assert_eq!(told().await, v1::MapState::Frozen);
        check_status(&stream.end().await, Code::FailedPrecondition, "MAP_FROZEN");
        let mut stream = Stream::connect(&server).await;
        stream.send(0, open_item("room", "robot", 0)).await;
        check_status(&stream.end().await, Code::FailedPrecondition, "MAP_FROZEN");
        let optimize = v1::OptimizeMapRequest { map_id: "room".to_owned(), ..Default::default() };
        let optimized = server.optimization().optimize_map(optimize).await.unwrap();
        let status = optimized.into_inner().message().await.unwrap_err();
        check_status(&status, Code::FailedPrecondition, "MAP_FROZEN");
        let list = v1::ListLandmarksRequest { map_id: "room".to_owned(), ..Default::default() };
        let mut list = server.maps().list_landmarks(list).await.unwrap().into_inner();
        assert!(!list.message().await.unwrap().unwrap().landmarks.is_empty());
        assert_eq!(get(&server).await, frozen);
        // Its name can be changed, and it stays frozen.
        let name = v1::UpdateMapRequest { display_name: "x".into(), ..request(&["display_name"]) };
        assert_eq!(update(&server, name).await.unwrap().state(), v1::MapState::Frozen);

        assert_eq!(set_state(&server, v1::MapState::Open).await.state(), v1::MapState::Open);
        while told().await != v1::MapState::Open {}
        let (mut stream, opened) = Stream::open(&server, "room", "robot", 0).await;
        let ack = stream.put(opened.next_sequence, Item::Keyframe(keyframe(3))).await;
        assert_eq!(ack.status(), v1::AckStatus::Received, "{ack:?}");
    });
}

#[test]
fn a_solve_that_runs_when_its_map_is_frozen_is_applied_after_it_is_opened_only() {
    run(async {
        let server = TestServer::start().await;
        server.create_map("room").await;
        // No solve can begin.
        let occupied = occupy(&server).await;
        let (mut stream, _) = Stream::open(&server, "room", "robot", 0).await;
        stream.put(1, Item::Camera(camera(0))).await;
        for id in 0..3 {
            stream.put(id + 2, Item::Keyframe(keyframe(id))).await;
        }
        let optimize = v1::OptimizeMapRequest { map_id: "room".to_owned(), ..Default::default() };
        let optimized = server.optimization().optimize_map(optimize).await.unwrap();
        let frozen = set_state(&server, v1::MapState::Frozen).await;
        check_status(&stream.end().await, Code::FailedPrecondition, "MAP_FROZEN");
        let status = optimized.into_inner().message().await.unwrap_err();
        check_status(&status, Code::FailedPrecondition, "MAP_FROZEN");
        drop(occupied);
        // The pool takes one after the other: what was begun has ended after this.
        let free = occupy(&server).await;
        // The engine handles the end of a solve between two calls.
        for _ in 0..3 {
            assert_eq!(get(&server).await, frozen);
        }
        drop(free);

        set_state(&server, v1::MapState::Open).await;
        let (stream, opened) = Stream::open(&server, "room", "robot", 0).await;
        let acks = stream.finish().await.unwrap();
        let solved = acks.iter().any(|ack| ack.status() == v1::AckStatus::Optimized);
        assert!(solved || opened.optimized_sequence == 4, "{opened:?} {acks:?}");
        assert!(get(&server).await.revision > frozen.revision + 2, "a solve is an event");
    });
}

#[test]
fn a_map_is_still_frozen_after_a_restart() {
    run(async {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().to_owned();
        let server = TestServer::with(|config| config.data_dir = Some(path.clone())).await;
        server.create_map("room").await;
        server.build_map("room", 2).await;
        let name = v1::UpdateMapRequest {
            display_name: "Attic".to_owned(),
            state: v1::MapState::Frozen.into(),
            ..request(&["display_name", "state"])
        };
        let before = update(&server, name).await.unwrap();
        server.running.shutdown().await;
        let server = TestServer::with(|config| config.data_dir = Some(path.clone())).await;
        assert_eq!(get(&server).await, before);
        let mut stream = Stream::connect(&server).await;
        stream.send(0, open_item("room", "robot", 0)).await;
        check_status(&stream.end().await, Code::FailedPrecondition, "MAP_FROZEN");
        set_state(&server, v1::MapState::Open).await;
        server.running.shutdown().await;
        let server = TestServer::with(|config| config.data_dir = Some(path)).await;
        let (_stream, opened) = Stream::open(&server, "room", "robot", 0).await;
        assert_eq!(opened.next_sequence, 4);
    });
}
