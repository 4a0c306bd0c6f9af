//! All that is wrong with an item comes in one answer, and nothing that follows from what cannot be
//! read.

use covis::wire::v1;
use tonic_types::StatusExt;
use v1::ViolationReason as Reason;
use v1::ingest_request::Item;

use crate::common::{Stream, TestServer, run};
use crate::rpc_bad_input::{bad_constraint, bad_keyframe, position_prior, rotation};

/// All fields that are refused of one item, on a map with two keyframes.
async fn refused_fields(stream: &mut Stream, sequence: i64, item: Item) -> Vec<(String, Reason)> {
    let ack = stream.put(sequence, item).await;
    assert_eq!(ack.status(), v1::AckStatus::Rejected, "{ack:?}");
    ack.violations.iter().map(|v| (v.field.clone(), v.reason())).collect()
}

#[test]
fn all_that_is_wrong_with_an_item_is_reported_at_once() {
    run(async {
        let server = TestServer::start().await;
        server.create_map("room").await;
        server.build_map("room", 2).await;
        let (mut stream, _) = Stream::open(&server, "room", "robot", 0).await;
        let fields = |all: &[(&str, Reason)]| -> Vec<(String, Reason)> {
            all.iter().map(|&(field, reason)| (field.to_owned(), reason)).collect()
        };
        // A number, an unknown camera and an unknown landmark; nothing is said twice, and nothing of
        // the landmark that cannot be read.
        let item = bad_keyframe(|k| {
            k.sensor = Some(v1::keyframe::Sensor::CameraId(99));
            k.observations.truncate(3);
            k.observations[0].pixel.as_mut().unwrap().x = f64::NAN;
            k.observations[1].landmark.as_mut().unwrap().id = 9999;
            k.observations[2].landmark = None;
        });
        let expected = [
            ("keyframe.observations[0].pixel.x", Reason::NotFinite),
            ("keyframe.observations[2].landmark", Reason::Missing),
            ("keyframe.camera_id", Reason::UnknownReference),
            ("keyframe.observations[1].landmark", Reason::UnknownReference),
        ];
        assert_eq!(refused_fields(&mut stream, 101, item).await, fields(&expected));
        // A pose that cannot be read says nothing of projections.
        let item = bad_keyframe(|k| {
            rotation(k).w = 5.0;
            k.sensor = Some(v1::keyframe::Sensor::CameraId(99));
        });
        let expected = [
            ("keyframe.world_from_camera.rotation", Reason::NotUnit),
            ("keyframe.camera_id", Reason::UnknownReference),
        ];
        assert_eq!(refused_fields(&mut stream, 102, item).await, fields(&expected));
        let item = bad_constraint(|c| {
            c.keyframe_i = None;
            c.keyframe_j.as_mut().unwrap().id = 99;
            c.information.as_mut().unwrap().upper_triangle.pop();
        });
        let expected = [
            ("relative_pose.keyframe_i", Reason::Missing),
            ("relative_pose.information.upper_triangle", Reason::WrongLength),
            ("relative_pose.keyframe_j", Reason::UnknownReference),
        ];
        assert_eq!(refused_fields(&mut stream, 103, item).await, fields(&expected));
        let item = position_prior(|p| {
            p.keyframe.as_mut().unwrap().id = 99;
            p.point_in_world = None;
        });
        let expected = [
            ("position_prior.point_in_world", Reason::Missing),
            ("position_prior.keyframe", Reason::UnknownReference),
        ];
        assert_eq!(refused_fields(&mut stream, 104, item).await, fields(&expected));
        let good = stream.put(105, bad_keyframe(|_| {})).await;
        assert_eq!(good.status(), v1::AckStatus::Received, "the stream lives: {good:?}");
    });
}

#[test]
fn a_long_text_that_is_refused_is_not_repeated_at_its_length() {
    run(async {
        let server = TestServer::start().await;
        server.create_map("room").await;
        // More than the headers of an answer may have.
        let update_mask = Some(prost_types::FieldMask { paths: vec!["ö".repeat(20_000); 40] });
        let map_id = "room".to_owned();
        let request = v1::UpdateMapRequest { map_id, update_mask, ..Default::default() };
        let status = server.maps().update_map(request).await.unwrap_err();
        assert_eq!(status.code(), tonic::Code::InvalidArgument, "{status:?}");
        assert!(status.message().starts_with("update_mask: ") && status.message().len() <= 1024);
        let violations = status.get_details_bad_request().unwrap().field_violations;
        assert!(violations.iter().all(|violation| violation.description.len() <= 256));
        assert!(violations.len() > 1);
    });
}
