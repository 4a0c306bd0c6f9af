//! `MapService`: making, reading, listing, deleting; trajectories and landmarks.

use covis::wire::v1;
use tonic::{Code, Status, Streaming};
use v1::ingest_request::Item;

use crate::common::{
    LANDMARKS, Stream, TestServer, camera, check_field, check_retry, check_status, keyframe,
    keyframe_position, landmark, run, vector3,
};

fn create(map_id: &str) -> v1::CreateMapRequest {
    v1::CreateMapRequest { map_id: map_id.to_owned(), ..Default::default() }
}

/// All messages of a stream.
async fn all<T>(mut stream: Streaming<T>) -> Result<Vec<T>, Status> {
    let mut messages = Vec::new();
    while let Some(message) = stream.message().await? {
        messages.push(message);
    }
    Ok(messages)
}

#[test]
fn a_new_map_has_the_servers_policy_and_its_own_uid() {
    run(async {
        let server = TestServer::start().await;
        let policy = v1::MapPolicy {
            window_keyframe_count: Some(7),
            observation_loss: Some(v1::Loss {
                kind: v1::LossKind::Cauchy.into(),
                width: Some(1.5),
            }),
            local_bundle_adjustment: Some(false),
            limits: Some(v1::MapLimits { max_keyframe_count: Some(50), ..Default::default() }),
            ..Default::default()
        };
        let map = server.create_map_with("room", policy).await;
        assert_eq!((map.map_id.as_str(), map.state()), ("room", v1::MapState::Open));
        assert!(!map.uid.is_empty() && map.create_time.is_some());
        let policy = map.policy.unwrap();
        assert_eq!(policy.window_keyframe_count, Some(7));
        assert_eq!(policy.min_shared_landmark_count, Some(15));
        assert_eq!(policy.local_bundle_adjustment, Some(false));
        assert_eq!(policy.observation_loss.unwrap().width, Some(1.5));
        assert_eq!(policy.constraint_loss.unwrap().kind(), v1::LossKind::Trivial);
        let limits = policy.limits.unwrap();
        assert_eq!(limits.max_keyframe_count, Some(50));
        assert!(limits.max_landmark_count.is_some(), "the server's own");

        let uid = map.uid;
        let delete = v1::DeleteMapRequest { map_id: "room".to_owned() };
        server.maps().delete_map(delete).await.unwrap();
        assert_ne!(server.create_map("room").await.uid, uid);
    });
}

#[test]
fn create_map_refuses_bad_fields_and_taken_names() {
    run(async {
        let server = TestServer::with(|config| config.max_maps = Some(2)).await;
        let mut maps = server.maps();
        for (map_id, reason) in [("", "MISSING"), ("Room", "OUT_OF_RANGE"), ("a b", "OUT_OF_RANGE")]
        {
            let status = maps.create_map(create(map_id)).await.unwrap_err();
            check_field(&status, "map_id", reason);
        }
        let status = maps.create_map(create(&"x".repeat(64))).await.unwrap_err();
        check_field(&status, "map_id", "OUT_OF_RANGE");
        let loss = |kind: v1::LossKind, width| Some(v1::Loss { kind: kind.into(), width });
        let policies: [(v1::MapPolicy, &str, &str); 6] = [
            (
                v1::MapPolicy { window_keyframe_count: Some(1), ..Default::default() },
                "policy.window_keyframe_count",
                "OUT_OF_RANGE",
            ),
            (v1::MapPolicy { gauge: 99, ..Default::default() }, "policy.gauge", "UNKNOWN_VALUE"),
            (
                v1::MapPolicy {
                    observation_loss: loss(v1::LossKind::Huber, Some(f64::NAN)),
                    ..Default::default()
                },
                "policy.observation_loss.width",
                "NOT_FINITE",
            ),
            (
                v1::MapPolicy {
                    constraint_loss: loss(v1::LossKind::Huber, None),
                    ..Default::default()
                },
                "policy.constraint_loss.width",
                "MISSING",
            ),
            (
                v1::MapPolicy {
                    constraint_loss: loss(v1::LossKind::Trivial, Some(1.0)),
                    ..Default::default()
                },
                "policy.constraint_loss.width",
                "INCONSISTENT",
            ),
            (
                v1::MapPolicy {
                    limits: Some(v1::MapLimits {
                        max_landmark_count: Some(0),
                        ..Default::default()
                    }),
                    ..Default::default()
                },
                "policy.limits.max_landmark_count",
                "OUT_OF_RANGE",
            ),
        ];
        for (policy, field, reason) in policies {
            let request = v1::CreateMapRequest { policy: Some(policy), ..create("room") };
            check_field(&maps.create_map(request).await.unwrap_err(), field, reason);
        }
        let request = v1::CreateMapRequest { display_name: "x".repeat(257), ..create("room") };
        check_field(&maps.create_map(request).await.unwrap_err(), "display_name", "TOO_LARGE");

        server.create_map("room").await;
        let status = maps.create_map(create("room")).await.unwrap_err();
        check_status(&status, Code::AlreadyExists, "MAP_EXISTS");
        server.create_map("hall").await;
        let status = maps.create_map(create("third")).await.unwrap_err();
        check_status(&status, Code::ResourceExhausted, "SERVER_LIMIT");
        check_retry(&status);
    });
}

#[test]
fn a_map_has_the_gauge_and_the_anchor_that_its_policy_asked_for() {
    run(async {
        let server = TestServer::start().await;
        let mut maps = server.maps();
        let place = |latitude_deg, longitude_deg| v1::GeodeticPosition {
            latitude_deg,
            longitude_deg,
            height_m: 1600.0,
        };
        for gauge in [
            v1::Gauge::FirstKeyframeFixed,
            v1::Gauge::Free,
            v1::Gauge::Priors,
            v1::Gauge::FixedPoses,
        ] {
            let map_id = format!("map-{}", gauge as i32);
            let policy = v1::MapPolicy {
                gauge: gauge.into(),
                geodetic_anchor: Some(place(40.1, -105.1)),
                ..Default::default()
            };
            let map = server.create_map_with(&map_id, policy).await;
            let policy = map.policy.unwrap();
            assert_eq!(policy.gauge(), gauge);
            assert_eq!(policy.geodetic_anchor, Some(place(40.1, -105.1)));
        }
        let plain = server.create_map_with("plain", v1::MapPolicy::default()).await;
        assert_eq!(plain.policy.as_ref().unwrap().gauge(), v1::Gauge::FirstKeyframeFixed);
        assert_eq!(plain.policy.unwrap().geodetic_anchor, None);
        let nowhere =
            v1::MapPolicy { geodetic_anchor: Some(place(90.5, f64::NAN)), ..Default::default() };
        let request = v1::CreateMapRequest { policy: Some(nowhere), ..create("room") };
        let status = maps.create_map(request).await.unwrap_err();
        check_field(&status, "policy.geodetic_anchor.latitude_deg", "OUT_OF_RANGE");
    });
}

#[test]
fn a_map_tells_its_limits_and_what_happens_there() {
    run(async {
        let server = TestServer::start().await;
        let limits = |bytes, queued| v1::MapLimits {
            max_size_bytes: Some(bytes),
            max_queued_item_count: Some(queued),
            ..Default::default()
        };
        for (when_full, told) in [
            (v1::WhenFull::Unspecified, v1::WhenFull::Reject),
            (v1::WhenFull::Reject, v1::WhenFull::Reject),
            (v1::WhenFull::Marginalize, v1::WhenFull::Marginalize),
            (v1::WhenFull::Sparsify, v1::WhenFull::Sparsify),
        ] {
            let wanted = v1::MapPolicy {
                limits: Some(limits(1 << 30, 3)),
                when_full: when_full.into(),
                ..Default::default()
            };
            let name = format!("room-{}", i32::from(when_full));
            let policy = server.create_map_with(&name, wanted).await.policy.unwrap();
            assert_eq!(policy.when_full(), told);
            let limits = policy.limits.unwrap();
            assert_eq!(
                (limits.max_size_bytes, limits.max_queued_item_count),
                (Some(1 << 30), Some(3))
            );
            assert!(limits.max_keyframe_count.is_some(), "the server's own");
        }
        let many = v1::MapPolicy { limits: Some(limits(1, 65_536)), ..Default::default() };
        let map = server.create_map_with("many", many).await;
        let queued = map.policy.unwrap().limits.unwrap().max_queued_item_count;
        assert_eq!(queued, Some(64), "never above the server's");
        let bad = v1::MapPolicy { when_full: 77, ..Default::default() };
        let request = v1::CreateMapRequest { policy: Some(bad), ..create("bad") };
        let status = server.maps().create_map(request).await.unwrap_err();
        check_field(&status, "policy.when_full", "UNKNOWN_VALUE");
    });
}

#[test]
fn get_map_counts_what_was_sent() {
    run(async {
        let server = TestServer::start().await;
        server.create_map("room").await;
        server.build_map("room", 3).await;
        let request = v1::GetMapRequest { map_id: "room".to_owned(), ..Default::default() };
        let map = server.maps().get_map(request).await.unwrap().into_inner().map.unwrap();
        let counts = map.counts.unwrap();
        assert_eq!((counts.camera_count, counts.keyframe_count), (1, 3));
        assert_eq!(
            (counts.landmark_count, counts.positioned_landmark_count),
            (LANDMARKS, LANDMARKS)
        );
        assert_eq!(counts.observation_count, 3 * LANDMARKS);
        assert!(counts.size_bytes > 0 && map.revision >= 5);
        let bounds = map.landmark_bounds.unwrap();
        assert!(bounds.min.unwrap().z > 3.0 && bounds.max.unwrap().z < 6.0);
        let [client] = map.clients.as_slice() else { panic!("{:?}", map.clients) };
        assert_eq!(
            (client.client_id.as_str(), client.epoch, client.next_sequence),
            ("robot", 1, 5)
        );
        assert!(client.map_from_odom.is_some());

        let request = v1::GetMapRequest { map_id: "none".to_owned(), ..Default::default() };
        let status = server.maps().get_map(request).await.unwrap_err();
        check_status(&status, Code::NotFound, "MAP_NOT_FOUND");
        let request = v1::GetMapRequest { map_id: "/".to_owned(), ..Default::default() };
        check_field(&server.maps().get_map(request).await.unwrap_err(), "map_id", "OUT_OF_RANGE");
    });
}

#[test]
fn list_maps_pages_by_name() {
    run(async {
        let server = TestServer::start().await;
        for name in ["c", "a", "b"] {
            server.create_map(name).await;
        }
        let mut maps = server.maps();
        let mut names = Vec::new();
        let mut page_token = String::new();
        loop {
            let request = v1::ListMapsRequest { page_size: 2, page_token };
            let page = maps.list_maps(request).await.unwrap().into_inner();
            names.push(page.maps.into_iter().map(|m| m.map_id).collect::<Vec<_>>());
            page_token = page.next_page_token;
            if page_token.is_empty() {
                break;
            }
        }
        assert_eq!(names, [vec!["a", "b"], vec!["c"]]);
        let request = v1::ListMapsRequest { page_size: 1001, ..Default::default() };
        check_field(&maps.list_maps(request).await.unwrap_err(), "page_size", "OUT_OF_RANGE");
        // A name is no token: only what a page named is.
        for token in ["?", "a", "a.0000000000000000", "."] {
            let request = v1::ListMapsRequest { page_token: token.to_owned(), page_size: 1 };
            check_field(&maps.list_maps(request).await.unwrap_err(), "page_token", "OUT_OF_RANGE");
        }
    });
}

#[test]
fn deleting_a_map_ends_its_streams_with_not_found() {
    run(async {
        let server = TestServer::start().await;
        server.create_map("room").await;
        let (mut stream, _) = Stream::open(&server, "room", "robot", 0).await;
        let watch = v1::WatchMapRequest { map_id: "room".to_owned(), ..Default::default() };
        let watch = server.maps().watch_map(watch).await.unwrap().into_inner();
        let delete = v1::DeleteMapRequest { map_id: "room".to_owned() };
        server.maps().delete_map(delete.clone()).await.unwrap();
        check_status(&stream.end().await, Code::NotFound, "MAP_NOT_FOUND");
        check_status(&all(watch).await.unwrap_err(), Code::NotFound, "MAP_NOT_FOUND");
        let status = server.maps().delete_map(delete).await.unwrap_err();
        check_status(&status, Code::NotFound, "MAP_NOT_FOUND");
        let request = v1::DeleteMapRequest::default();
        check_field(&server.maps().delete_map(request).await.unwrap_err(), "map_id", "MISSING");
    });
}

#[test]
fn a_trajectory_comes_by_client_then_time() {
    run(async {
        let server = TestServer::start().await;
        server.create_map("room").await;
        let request = v1::GetTrajectoryRequest { map_id: "room".to_owned(), ..Default::default() };
        let empty =
            all(server.maps().get_trajectory(request.clone()).await.unwrap().into_inner()).await;
        let [message] = empty.as_deref().unwrap() else { panic!("{empty:?}") };
        assert!(message.poses.is_empty(), "a map without keyframes answers one empty message");

        server.build_map("room", 4).await;
        let (mut stream, _) = Stream::open(&server, "room", "drone", 0).await;
        stream.put(1, Item::Camera(camera(0))).await;
        let mut late = keyframe(0);
        late.observations.clear();
        late.landmarks.clear();
        stream.put(2, Item::Keyframe(late)).await;

        let messages = all(server.maps().get_trajectory(request).await.unwrap().into_inner()).await;
        let poses: Vec<_> = messages.unwrap().into_iter().flat_map(|m| m.poses).collect();
        let names: Vec<_> = poses
            .iter()
            .map(|p| p.keyframe.as_ref().map(|k| (k.client_id.as_str(), k.id)).unwrap())
            .collect();
        assert_eq!(names, [("drone", 0), ("robot", 0), ("robot", 1), ("robot", 2), ("robot", 3)]);
        for pose in &poses[1..] {
            let id = pose.keyframe.as_ref().unwrap().id;
            assert_eq!(pose.capture_time.unwrap().seconds, 100 + id);
            let t = pose.world_from_camera.unwrap().translation.unwrap();
            let truth = keyframe_position(id);
            assert!((t.x - truth[0]).hypot(t.y - truth[1]) < 0.05, "{t:?} is not {truth:?}");
        }

        let only = |client: &str| v1::GetTrajectoryRequest {
            map_id: "room".to_owned(),
            client_id: client.to_owned(),
        };
        let messages = all(server.maps().get_trajectory(only("drone")).await.unwrap().into_inner());
        assert_eq!(messages.await.unwrap()[0].poses.len(), 1);
        for (request, code, reason) in [
            (only("nobody"), Code::NotFound, "CLIENT_NOT_FOUND"),
            (only("No"), Code::InvalidArgument, "OUT_OF_RANGE"),
            (
                v1::GetTrajectoryRequest { map_id: "none".to_owned(), ..Default::default() },
                Code::NotFound,
                "MAP_NOT_FOUND",
            ),
            (v1::GetTrajectoryRequest::default(), Code::InvalidArgument, "MISSING"),
        ] {
            let answers = server.maps().get_trajectory(request).await.unwrap().into_inner();
            check_status(&all(answers).await.unwrap_err(), code, reason);
        }
    });
}

#[test]
fn landmarks_come_in_pages_that_can_be_resumed_and_masked() {
    run(async {
        let server = TestServer::start().await;
        server.create_map("room").await;
        let request = v1::ListLandmarksRequest { map_id: "room".to_owned(), ..Default::default() };
        let list = async |request: v1::ListLandmarksRequest| {
            all(server.maps().list_landmarks(request).await.unwrap().into_inner()).await
        };
        let empty = list(request.clone()).await.unwrap();
        assert_eq!((empty.len(), empty[0].landmarks.len()), (1, 0));

        server.build_map("room", 2).await;
        let (mut stream, _) = Stream::open(&server, "room", "drone", 0).await;
        let many: i64 = 30_000;
        let landmarks: Vec<_> = (0..many)
            .map(|id| v1::Landmark { id, point_in_world: Some(vector3([1.0; 3])), ..landmark(0) })
            .collect();
        stream.put(1, Item::Landmarks(v1::LandmarkBatch { landmarks })).await;

        let pages = list(request.clone()).await.unwrap();
        assert!(pages.len() > 1, "more than 1 MiB");
        for page in &pages {
            assert!(prost::Message::encoded_len(page) <= (1 << 20) + 200);
            assert_eq!(page.revision, pages[0].revision);
        }
        let landmarks: Vec<_> = pages.iter().flat_map(|p| &p.landmarks).collect();
        assert_eq!(landmarks.len() as i64, many + LANDMARKS);
        assert!(landmarks.is_sorted_by_key(|l| (&l.client_id, l.id)));
        let first = landmarks[many as usize];
        assert_eq!((first.client_id.as_str(), first.id), ("robot", 0));
        assert_eq!(first.observation_count, 2);
        assert_eq!(first.state(), v1::LandmarkState::Positioned);
        assert_eq!(first.reference_keyframe.as_ref().unwrap().id, 0);
        assert_eq!(pages.last().unwrap().next_page_token, "");

        // Going on behind the first page gives exactly the rest.
        let resumed = v1::ListLandmarksRequest {
            page_token: pages[0].next_page_token.clone(),
            page_size: 10_000,
            ..request.clone()
        };
        let rest = list(resumed).await.unwrap();
        assert!(rest.iter().all(|p| p.landmarks.len() <= 10_000));
        let rest: usize = rest.iter().map(|p| p.landmarks.len()).sum();
        assert_eq!(rest + pages[0].landmarks.len(), landmarks.len());

        let mask = |path: &str| {
            let paths = vec![path.to_owned()];
            v1::ListLandmarksRequest {
                read_mask: Some(prost_types::FieldMask { paths }),
                ..request.clone()
            }
        };
        let masked = list(mask("observation_count")).await.unwrap();
        let one = masked.last().unwrap().landmarks.last().unwrap();
        assert_eq!((one.id, one.observation_count), (LANDMARKS - 1, 2));
        assert!(one.point_in_world.is_none() && one.reference_keyframe.is_none());

        let bad = |request: v1::ListLandmarksRequest| async { list(request).await.unwrap_err() };
        check_field(&bad(mask("color")).await, "read_mask", "UNKNOWN_VALUE");
        let request_with = |page_size, token: &str| v1::ListLandmarksRequest {
            page_size,
            page_token: token.to_owned(),
            ..request.clone()
        };
        check_field(&bad(request_with(10_001, "")).await, "page_size", "OUT_OF_RANGE");
        let token = &pages[0].next_page_token;
        for token in ["junk", "7.robot", &token[..token.len() - 1]] {
            check_field(&bad(request_with(0, token)).await, "page_token", "OUT_OF_RANGE");
        }
        // Nor the token of another map or of another call.
        server.create_map("attic").await;
        server.create_map("cellar").await;
        let attic = v1::ListLandmarksRequest {
            map_id: "attic".to_owned(),
            page_token: token.clone(),
            ..Default::default()
        };
        check_field(&bad(attic).await, "page_token", "OUT_OF_RANGE");
        let first = v1::ListMapsRequest { page_size: 1, ..Default::default() };
        let first = server.maps().list_maps(first).await.unwrap().into_inner();
        let of_maps = request_with(0, &first.next_page_token);
        check_field(&bad(of_maps).await, "page_token", "OUT_OF_RANGE");
        let none = v1::ListLandmarksRequest { map_id: "none".to_owned(), ..Default::default() };
        check_status(&bad(none).await, Code::NotFound, "MAP_NOT_FOUND");
        check_field(&bad(v1::ListLandmarksRequest::default()).await, "map_id", "MISSING");
    });
}

#[test]
fn a_fault_of_the_engine_is_internal() {
    run(async {
        let server = TestServer::with_fault("fail-calls").await;
        let status = server.maps().create_map(create("room")).await.unwrap_err();
        check_status(&status, Code::Internal, "BUG");
    });
}
