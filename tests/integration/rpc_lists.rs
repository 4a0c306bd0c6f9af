//! `ListKeyframes` and `ListConstraints`: pages, masks, and each code.

use covis::wire::v1;
use tonic::{Code, Status, Streaming};
use v1::constraint::Constraint;
use v1::ingest_request::Item;

use crate::common::{
    LANDMARKS, Stream, TestServer, camera, check_field, check_status, image_descriptor,
    information6, keyframe, landmark, observation, relative_pose, run, shift,
};

async fn all<T>(mut stream: Streaming<T>) -> Result<Vec<T>, Status> {
    let mut messages = Vec::new();
    while let Some(message) = stream.message().await? {
        messages.push(message);
    }
    Ok(messages)
}

async fn keyframes(
    server: &TestServer,
    request: v1::ListKeyframesRequest,
) -> Result<Vec<v1::ListKeyframesResponse>, Status> {
    all(server.maps().list_keyframes(request).await.unwrap().into_inner()).await
}

async fn constraints(
    server: &TestServer,
    request: v1::ListConstraintsRequest,
) -> Result<Vec<v1::ListConstraintsResponse>, Status> {
    all(server.maps().list_constraints(request).await.unwrap().into_inner()).await
}

fn of_room() -> v1::ListKeyframesRequest {
    v1::ListKeyframesRequest { map_id: "room".to_owned(), ..Default::default() }
}

fn masked(paths: &[&str]) -> v1::ListKeyframesRequest {
    let paths = paths.iter().map(|&path| path.to_owned()).collect();
    v1::ListKeyframesRequest { read_mask: Some(prost_types::FieldMask { paths }), ..of_room() }
}

#[test]
fn keyframes_come_by_client_and_id_with_what_the_mask_names() {
    run(async {
        let server = TestServer::start().await;
        server.create_map("room").await;
        let empty = keyframes(&server, of_room()).await.unwrap();
        assert_eq!((empty.len(), empty[0].keyframes.len()), (1, 0));

        server.build_map("room", 3).await;
        let (mut stream, _) = Stream::open(&server, "room", "drone", 0).await;
        stream.put(1, Item::Camera(camera(0))).await;
        let bare = v1::Keyframe {
            sensor: None,
            observations: Vec::new(),
            landmarks: Vec::new(),
            global_descriptor: Some(image_descriptor(&[1.0, -2.0])),
            ..keyframe(7)
        };
        stream.put(2, Item::Keyframe(bare)).await;
        let pages = keyframes(&server, of_room()).await.unwrap();
        let listed: Vec<_> = pages.iter().flat_map(|page| &page.keyframes).collect();
        let names: Vec<_> = listed.iter().map(|k| (k.client_id.as_str(), k.id)).collect();
        assert_eq!(names, [("drone", 7), ("robot", 0), ("robot", 1), ("robot", 2)]);
        assert_eq!((listed[0].sensor, &listed[0].global_descriptor), (None, &None));
        let pictured = keyframes(&server, masked(&["global_descriptor"])).await.unwrap();
        let images = pictured[0].keyframes.iter().map(|k| k.global_descriptor.clone());
        let sent = Some(image_descriptor(&[1.0, -2.0]));
        assert_eq!(images.collect::<Vec<_>>(), [sent, None, None, None]);
        let second = listed[2];
        assert_eq!(second.sensor, Some(v1::keyframe::Sensor::CameraId(0)));
        assert_eq!(second.capture_time.unwrap().seconds, 101);
        assert!(second.world_from_camera.is_some() && second.observations.is_empty());
        // No solve moves the odometry frame.
        assert_eq!(second.odom_from_camera, keyframe(1).world_from_camera);

        let seen = keyframes(&server, masked(&["observations"])).await.unwrap();
        let one = seen[0].keyframes.last().unwrap();
        assert_eq!((one.client_id.as_str(), one.id), ("robot", 2));
        assert!(one.capture_time.is_none() && one.world_from_camera.is_none());
        assert!(one.sensor.is_none() && one.odom_from_camera.is_none());
        let expected = v1::Observation {
            landmark: Some(v1::LandmarkRef { client_id: "robot".to_owned(), id: 3 }),
            sigma_px: Some(1.0),
            ..observation(2, 3)
        };
        assert_eq!((one.observations.len() as i64, &one.observations[3]), (LANDMARKS, &expected));
        let times = keyframes(&server, masked(&["capture_time", "id"])).await.unwrap();
        let one = &times[0].keyframes[1];
        assert!(one.capture_time.is_some() && one.world_from_camera.is_none());
    });
}

#[test]
fn keyframes_come_in_pages_that_can_be_resumed() {
    run(async {
        let server = TestServer::start().await;
        server.create_map("room").await;
        server.build_map("room", 5).await;
        let request = v1::ListKeyframesRequest { page_size: 2, ..of_room() };
        let pages = keyframes(&server, request.clone()).await.unwrap();
        let sizes: Vec<_> = pages.iter().map(|page| page.keyframes.len()).collect();
        assert_eq!(sizes, [2, 2, 1]);
        assert!(pages.iter().all(|page| page.revision == pages[0].revision));
        assert_eq!(pages[2].next_page_token, "");
        let rest = |token: &str| v1::ListKeyframesRequest {
            page_token: token.to_owned(),
            ..request.clone()
        };
        let resumed = keyframes(&server, rest(&pages[0].next_page_token)).await.unwrap();
        assert_eq!(resumed, pages[1..]);
    });
}

#[test]
fn a_keyframe_with_more_observations_than_fit_a_message_comes_in_parts() {
    run(async {
        let server = TestServer::start().await;
        server.create_map("room").await;
        let (mut stream, _) = Stream::open(&server, "room", "robot", 0).await;
        stream.put(1, Item::Camera(camera(0))).await;
        let count: i64 = 30_000;
        let landmarks = (0..count).map(|id| v1::Landmark { id, ..landmark(id % LANDMARKS) });
        let landmarks = landmarks.collect();
        stream.put(2, Item::Landmarks(v1::LandmarkBatch { landmarks })).await;
        let observations = (0..count).map(|id| v1::Observation {
            landmark: Some(v1::LandmarkRef { id, ..Default::default() }),
            ..observation(0, id % LANDMARKS)
        });
        let large = v1::Keyframe {
            observations: observations.collect(),
            landmarks: Vec::new(),
            ..keyframe(0)
        };
        let ack = stream.put(3, Item::Keyframe(large)).await;
        assert!(ack.violations.is_empty(), "{ack:?}");
        let request = masked(&["observations", "capture_time"]);
        let pages = keyframes(&server, request.clone()).await.unwrap();
        assert!(pages.len() > 1);
        for page in &pages {
            assert!(prost::Message::encoded_len(page) <= (1 << 20) + 200);
        }
        let entries: Vec<_> = pages.iter().flat_map(|page| &page.keyframes).collect();
        assert!(entries.iter().all(|entry| (entry.client_id.as_str(), entry.id) == ("robot", 0)));
        assert!(entries[0].capture_time.is_some() && entries[1].capture_time.is_none());
        let ids = entries.iter().flat_map(|entry| &entry.observations);
        let ids: Vec<_> = ids.map(|seen| seen.landmark.as_ref().unwrap().id).collect();
        assert_eq!(ids, (0..count).collect::<Vec<_>>());
        // A token can lie within a keyframe.
        let page_token = pages[0].next_page_token.clone();
        let resumed = v1::ListKeyframesRequest { page_token, ..request };
        assert_eq!(keyframes(&server, resumed).await.unwrap(), pages[1..]);
    });
}

#[test]
fn constraints_of_all_kinds_come_in_one_order_of_ids() {
    run(async {
        // The solve that the prior asks for ends before the next item, and no page is older than another.
        let server = TestServer::lock_step().await;
        server.create_map("room").await;
        let request =
            v1::ListConstraintsRequest { map_id: "room".to_owned(), ..Default::default() };
        let empty = constraints(&server, request.clone()).await.unwrap();
        assert_eq!((empty.len(), empty[0].constraints.len()), (1, 0));
        server.build_map("room", 3).await;
        let (mut stream, _) = Stream::open(&server, "room", "robot", 0).await;
        let prior = v1::PosePrior {
            id: 5,
            keyframe: Some(v1::KeyframeRef { id: 0, ..Default::default() }),
            world_from_camera: Some(shift([0.0; 3])),
            information: Some(information6(1.0)),
            ..Default::default()
        };
        stream.put(10, Item::RelativePose(relative_pose(9, 0, 1))).await;
        stream.put(11, Item::PosePrior(prior)).await;
        stream.put(12, Item::RelativePose(relative_pose(1, 1, 2))).await;
        let pages = constraints(&server, request.clone()).await.unwrap();
        let [page] = pages.as_slice() else { panic!("{pages:?}") };
        let ids = page.constraints.iter().map(|c| match c.constraint.as_ref().unwrap() {
            Constraint::RelativePose(c) => (c.client_id.as_str(), c.id, "relative"),
            Constraint::PosePrior(c) => (c.client_id.as_str(), c.id, "pose"),
            Constraint::PositionPrior(c) => (c.client_id.as_str(), c.id, "position"),
        });
        let ids: Vec<_> = ids.collect();
        assert_eq!(ids, [("robot", 1, "relative"), ("robot", 5, "pose"), ("robot", 9, "relative")]);
        let Some(Constraint::RelativePose(first)) = &page.constraints[0].constraint else {
            panic!("a relative pose");
        };
        assert_eq!(first.kind(), v1::ConstraintKind::Odometry);
        assert_eq!(first.keyframe_j.as_ref().unwrap().id, 2);

        let single = v1::ListConstraintsRequest { page_size: 1, ..request };
        let pages = constraints(&server, single.clone()).await.unwrap();
        assert_eq!(pages.len(), 3);
        let page_token = pages[1].next_page_token.clone();
        let resumed = v1::ListConstraintsRequest { page_token, ..single };
        assert_eq!(constraints(&server, resumed).await.unwrap(), pages[2..]);
    });
}

#[test]
fn lists_refuse_bad_requests() {
    run(async {
        let server = TestServer::start().await;
        server.create_map("room").await;
        server.build_map("room", 2).await;
        let first = v1::ListKeyframesRequest { page_size: 1, ..of_room() };
        let token = keyframes(&server, first).await.unwrap()[0].next_page_token.clone();
        let of_keyframes = [
            (masked(&["color"]), "read_mask", "UNKNOWN_VALUE"),
            (masked(&["observations.pixel"]), "read_mask", "UNKNOWN_VALUE"),
            (masked(&["id"; 65]), "read_mask", "TOO_LARGE"),
            (
                v1::ListKeyframesRequest { page_size: 10_001, ..of_room() },
                "page_size",
                "OUT_OF_RANGE",
            ),
            (v1::ListKeyframesRequest { page_size: -1, ..of_room() }, "page_size", "OUT_OF_RANGE"),
            (
                v1::ListKeyframesRequest { page_token: "0.robot".to_owned(), ..of_room() },
                "page_token",
                "OUT_OF_RANGE",
            ),
            (v1::ListKeyframesRequest::default(), "map_id", "MISSING"),
        ];
        for (request, field, reason) in of_keyframes {
            check_field(&keyframes(&server, request).await.unwrap_err(), field, reason);
        }
        let none = v1::ListKeyframesRequest { map_id: "none".to_owned(), ..Default::default() };
        let status = keyframes(&server, none).await.unwrap_err();
        check_status(&status, Code::NotFound, "MAP_NOT_FOUND");

        let room = v1::ListConstraintsRequest { map_id: "room".to_owned(), ..Default::default() };
        let of_constraints = [
            (
                v1::ListConstraintsRequest { page_size: 10_001, ..room.clone() },
                "page_size",
                "OUT_OF_RANGE",
            ),
            // The token of another call.
            (
                v1::ListConstraintsRequest { page_token: token, ..room },
                "page_token",
                "OUT_OF_RANGE",
            ),
            (v1::ListConstraintsRequest::default(), "map_id", "MISSING"),
        ];
        for (request, field, reason) in of_constraints {
            check_field(&constraints(&server, request).await.unwrap_err(), field, reason);
        }
        let none = v1::ListConstraintsRequest { map_id: "none".to_owned(), ..Default::default() };
        let status = constraints(&server, none).await.unwrap_err();
        check_status(&status, Code::NotFound, "MAP_NOT_FOUND");
    });
}
