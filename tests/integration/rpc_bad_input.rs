//! Bad items on an ingest stream: each is refused by name, changes nothing, and the stream lives.

use covis::wire::v1;
use v1::ViolationReason as Reason;
use v1::ingest_request::Item;

use crate::common::{
    Stream, TestServer, camera, diagonal, information3, information6, keyframe, landmark,
    observation, relative_pose, run, shift, vector3,
};

/// A keyframe that is new and good, changed by `edit`.
pub(crate) fn bad_keyframe(edit: impl FnOnce(&mut v1::Keyframe)) -> Item {
    let mut frame = keyframe(7);
    edit(&mut frame);
    Item::Keyframe(frame)
}

fn bad_camera(edit: impl FnOnce(&mut v1::Camera)) -> Item {
    let mut camera = camera(7);
    edit(&mut camera);
    Item::Camera(camera)
}

pub(crate) fn bad_constraint(edit: impl FnOnce(&mut v1::RelativePoseConstraint)) -> Item {
    let mut constraint = relative_pose(7, 0, 1);
    edit(&mut constraint);
    Item::RelativePose(constraint)
}

pub(crate) fn position_prior(edit: impl FnOnce(&mut v1::PositionPrior)) -> Item {
    let mut prior = v1::PositionPrior {
        id: 8,
        keyframe: Some(v1::KeyframeRef { id: 0, ..Default::default() }),
        point_in_world: Some(vector3([0.0; 3])),
        information: Some(information3(1.0)),
        ..Default::default()
    };
    edit(&mut prior);
    Item::PositionPrior(prior)
}

pub(crate) fn pose_prior(edit: impl FnOnce(&mut v1::PosePrior)) -> Item {
    let mut prior = v1::PosePrior {
        id: 9,
        keyframe: Some(v1::KeyframeRef { id: 0, ..Default::default() }),
        world_from_camera: Some(shift([0.0; 3])),
        information: Some(information6(1.0)),
        ..Default::default()
    };
    edit(&mut prior);
    Item::PosePrior(prior)
}

/// The rotation of a keyframe's start.
pub(crate) fn rotation(frame: &mut v1::Keyframe) -> &mut v1::Quaternion {
    frame.world_from_camera.as_mut().unwrap().rotation.as_mut().unwrap()
}

fn pinhole(camera: &mut v1::Camera) -> &mut v1::PinholeRadialTangential {
    let Some(v1::camera::Model::PinholeRadialTangential(model)) = &mut camera.model else {
        panic!("the scene's camera is a pinhole");
    };
    model
}

/// Sends each item to a map with two keyframes and checks what is said of it.
pub(crate) fn check(cases: Vec<(Item, &str, Reason)>) {
    run(async move {
        let server = TestServer::start().await;
        // No start is moved to where its views fit.
        let policy = v1::MapPolicy { odometry: Some(false), ..Default::default() };
        server.create_map_with("room", policy).await;
        server.build_map("room", 2).await;
        let revision = async || {
            let request = v1::GetMapRequest { map_id: "room".to_owned(), ..Default::default() };
            server.maps().get_map(request).await.unwrap().into_inner().map.unwrap().revision
        };
        let (mut stream, _) = Stream::open(&server, "room", "robot", 0).await;
        let before = revision().await;
        let mut sequence = 100;
        for (item, field, reason) in cases {
            sequence += 1;
            let text = format!("{item:.80?}");
            let ack = stream.put(sequence, item).await;
            assert_eq!(ack.status(), v1::AckStatus::Rejected, "{field}: {text}");
            assert_eq!(ack.revision, 0);
            let found: Vec<_> =
                ack.violations.iter().map(|v| (v.field.as_str(), v.reason())).collect();
            assert_eq!(found.first(), Some(&(field, reason)), "{found:?}");
            assert!(!ack.violations[0].description.is_empty());
        }
        assert_eq!(revision().await, before, "nothing was changed");
        let good = stream.put(sequence + 1, bad_keyframe(|_| {})).await;
        assert_eq!(good.status(), v1::AckStatus::Received, "the stream lives: {good:?}");
    });
}

#[test]
fn numbers_that_are_not_finite_are_named() {
    let nan = f64::NAN;
    let infinite = f64::INFINITY;
    check(vec![
        (
            bad_camera(|c| pinhole(c).cx = nan),
            "camera.pinhole_radial_tangential.cx",
            Reason::NotFinite,
        ),
        (
            bad_camera(|c| pinhole(c).k3 = infinite),
            "camera.pinhole_radial_tangential.k3",
            Reason::NotFinite,
        ),
        (
            bad_keyframe(|k| {
                k.world_from_camera = Some(shift([0.0, nan, 0.0]));
            }),
            "keyframe.world_from_camera.translation.y",
            Reason::NotFinite,
        ),
        (
            bad_keyframe(|k| k.odom_from_camera = Some(shift([nan, 0.0, 0.0]))),
            "keyframe.odom_from_camera.translation.x",
            Reason::NotFinite,
        ),
        (
            bad_keyframe(|k| rotation(k).w = nan),
            "keyframe.world_from_camera.rotation.w",
            Reason::NotFinite,
        ),
        (
            bad_keyframe(|k| k.observations[3].pixel.as_mut().unwrap().x = nan),
            "keyframe.observations[3].pixel.x",
            Reason::NotFinite,
        ),
        (
            bad_keyframe(|k| k.observations[2].sigma_px = Some(infinite)),
            "keyframe.observations[2].sigma_px",
            Reason::NotFinite,
        ),
        (
            Item::Landmarks(v1::LandmarkBatch {
                landmarks: vec![v1::Landmark {
                    point_in_world: Some(vector3([0.0, 0.0, -infinite])),
                    ..landmark(900)
                }],
            }),
            "landmarks.landmarks[0].point_in_world.z",
            Reason::NotFinite,
        ),
        (
            bad_constraint(|c| c.information.as_mut().unwrap().upper_triangle[4] = nan),
            "relative_pose.information.upper_triangle[4]",
            Reason::NotFinite,
        ),
        (
            position_prior(|p| p.point_in_world = Some(vector3([nan; 3]))),
            "position_prior.point_in_world.x",
            Reason::NotFinite,
        ),
    ]);
}

#[test]
fn rotations_that_are_not_unit_are_refused_and_almost_unit_ones_normalized() {
    check(vec![
        (
            bad_keyframe(|k| *rotation(k) = v1::Quaternion::default()),
            "keyframe.world_from_camera.rotation",
            Reason::NotUnit,
        ),
        (
            bad_keyframe(|k| rotation(k).w = 1.002),
            "keyframe.world_from_camera.rotation",
            Reason::NotUnit,
        ),
        (
            bad_keyframe(|k| {
                k.odom_from_camera = Some(shift([0.0; 3]));
                k.odom_from_camera.as_mut().unwrap().rotation.as_mut().unwrap().w = 0.99;
            }),
            "keyframe.odom_from_camera.rotation",
            Reason::NotUnit,
        ),
        (
            pose_prior(|p| {
                p.world_from_camera.as_mut().unwrap().rotation.as_mut().unwrap().w = 0.99;
            }),
            "pose_prior.world_from_camera.rotation",
            Reason::NotUnit,
        ),
        (
            bad_constraint(|c| {
                let measured = c.keyframe_i_from_keyframe_j.as_mut().unwrap();
                measured.rotation.as_mut().unwrap().x = 1.0;
            }),
            "relative_pose.keyframe_i_from_keyframe_j.rotation",
            Reason::NotUnit,
        ),
    ]);
    run(async {
        let server = TestServer::start().await;
        server.create_map("room").await;
        let (mut stream, _) = Stream::open(&server, "room", "robot", 0).await;
        stream.put(1, Item::Camera(camera(0))).await;
        let mut frame = keyframe(0);
        rotation(&mut frame).w = 1.0009;
        let ack = stream.put(2, Item::Keyframe(frame)).await;
        assert_eq!(ack.status(), v1::AckStatus::Received, "{ack:?}");
    });
}

#[test]
fn information_matrices_must_be_whole_and_positive_definite() {
    let matrix = |upper_triangle| Some(v1::InformationMatrix6 { upper_triangle });
    let mut indefinite = diagonal(6, 1.0);
    indefinite[1] = 2.0;
    check(vec![
        (
            bad_constraint(|c| c.information = matrix(indefinite)),
            "relative_pose.information.upper_triangle",
            Reason::NotPositiveDefinite,
        ),
        (
            bad_constraint(|c| c.information = matrix(diagonal(6, 0.0))),
            "relative_pose.information.upper_triangle",
            Reason::NotPositiveDefinite,
        ),
        (
            // A whole matrix, symmetric or not, is not what travels: the triangle is.
            bad_constraint(|c| c.information = matrix(vec![1.0; 36])),
            "relative_pose.information.upper_triangle",
            Reason::WrongLength,
        ),
        (bad_constraint(|c| c.information = None), "relative_pose.information", Reason::Missing),
        (
            pose_prior(|p| p.information = matrix(diagonal(6, -1.0))),
            "pose_prior.information.upper_triangle",
            Reason::NotPositiveDefinite,
        ),
        (
            position_prior(|p| p.information.as_mut().unwrap().upper_triangle.truncate(5)),
            "position_prior.information.upper_triangle",
            Reason::WrongLength,
        ),
    ]);
}

#[test]
fn references_to_nothing_are_named() {
    let keyframe_ref = |id| Some(v1::KeyframeRef { id, ..Default::default() });
    let landmark_ref = |id| Some(v1::LandmarkRef { id, ..Default::default() });
    check(vec![
        (
            bad_keyframe(|k| k.observations[5].landmark = landmark_ref(999)),
            "keyframe.observations[5].landmark",
            Reason::UnknownReference,
        ),
        (
            bad_keyframe(|k| {
                k.observations[5].landmark =
                    Some(v1::LandmarkRef { client_id: "nobody".to_owned(), id: 0 });
            }),
            "keyframe.observations[5].landmark",
            Reason::UnknownReference,
        ),
        (
            bad_keyframe(|k| k.sensor = Some(v1::keyframe::Sensor::CameraId(42))),
            "keyframe.camera_id",
            Reason::UnknownReference,
        ),
        (
            Item::Observations(v1::ObservationBatch {
                keyframe: keyframe_ref(77),
                observations: vec![observation(0, 0)],
            }),
            "observations.keyframe",
            Reason::UnknownReference,
        ),
        (
            bad_constraint(|c| c.keyframe_j = keyframe_ref(77)),
            "relative_pose.keyframe_j",
            Reason::UnknownReference,
        ),
        (
            bad_constraint(|c| c.keyframe_j = keyframe_ref(0)),
            "relative_pose.keyframe_j",
            Reason::Inconsistent,
        ),
        (position_prior(|p| p.keyframe = None), "position_prior.keyframe", Reason::Missing),
    ]);
}

#[test]
fn ranges_ids_and_contradictions() {
    check(vec![
        (bad_camera(|c| c.id = -1), "camera.id", Reason::OutOfRange),
        (bad_camera(|c| c.width_px = 70_000), "camera.width_px", Reason::OutOfRange),
        (
            bad_camera(|c| pinhole(c).fx = 0.0),
            "camera.pinhole_radial_tangential.fx",
            Reason::OutOfRange,
        ),
        (bad_camera(|c| c.model = None), "camera.model", Reason::Missing),
        (
            bad_camera(|c| c.client_id = "drone".to_owned()),
            "camera.client_id",
            Reason::Inconsistent,
        ),
        (bad_keyframe(|k| k.id = -5), "keyframe.id", Reason::OutOfRange),
        (bad_keyframe(|k| k.capture_time = None), "keyframe.capture_time", Reason::Missing),
        (
            bad_keyframe(|k| k.capture_time.as_mut().unwrap().nanos = -1),
            "keyframe.capture_time.nanos",
            Reason::OutOfRange,
        ),
        (
            bad_keyframe(|k| k.capture_time.as_mut().unwrap().seconds = i64::MAX),
            "keyframe.capture_time.seconds",
            Reason::OutOfRange,
        ),
        (
            bad_keyframe(|k| k.world_from_camera = None),
            "keyframe.world_from_camera",
            Reason::Missing,
        ),
        (bad_keyframe(|k| k.sensor = None), "keyframe.camera_id", Reason::Missing),
        (
            bad_keyframe(|k| k.observations[0].sigma_px = Some(0.0)),
            "keyframe.observations[0].sigma_px",
            Reason::OutOfRange,
        ),
        (
            bad_keyframe(|k| k.observations[0].depth_m = Some(2.0)),
            "keyframe.observations[0].sigma_depth_m",
            Reason::Inconsistent,
        ),
        (
            bad_keyframe(|k| {
                k.observations[0].depth_m = Some(-1.0);
                k.observations[0].sigma_depth_m = Some(0.1);
            }),
            "keyframe.observations[0].depth_m",
            Reason::OutOfRange,
        ),
        (
            bad_keyframe(|k| {
                k.observations[0].depth_m = Some(2.0);
                k.observations[0].sigma_depth_m = Some(0.0);
            }),
            "keyframe.observations[0].sigma_depth_m",
            Reason::OutOfRange,
        ),
        (
            bad_keyframe(|k| k.observations[0].camera_index = 1),
            "keyframe.observations[0].camera_index",
            Reason::OutOfRange,
        ),
        (
            bad_keyframe(|k| k.observations[1] = k.observations[0].clone()),
            "keyframe.observations[1].landmark",
            Reason::Duplicate,
        ),
        (
            bad_keyframe(|k| k.landmarks = vec![landmark(500), landmark(500)]),
            "keyframe.landmarks[1].id",
            Reason::Duplicate,
        ),
        (
            bad_keyframe(|k| {
                k.global_descriptor = Some(v1::Descriptor {
                    kind: v1::DescriptorKind::Binary.into(),
                    name: "orb".to_owned(),
                    data: vec![0; 65_537],
                });
            }),
            "keyframe.global_descriptor.data",
            Reason::TooLarge,
        ),
        (
            bad_keyframe(|k| {
                k.observations[0].descriptor =
                    Some(v1::Descriptor { kind: 9, ..Default::default() });
            }),
            "keyframe.observations[0].descriptor.kind",
            Reason::UnknownValue,
        ),
        (bad_constraint(|c| c.kind = 0), "relative_pose.kind", Reason::Missing),
        (bad_constraint(|c| c.kind = 77), "relative_pose.kind", Reason::UnknownValue),
        (Item::Landmarks(v1::LandmarkBatch::default()), "landmarks.landmarks", Reason::Missing),
        // A start on which the landmark lies in the camera's center plane.
        (
            bad_keyframe(|k| {
                k.world_from_camera = Some(shift([0.0, 0.0, 1.0]));
                k.landmarks = vec![v1::Landmark {
                    id: 800,
                    point_in_world: Some(vector3([1.0, 0.0, 1.0])),
                    ..Default::default()
                }];
                k.observations = vec![v1::Observation {
                    landmark: Some(v1::LandmarkRef { id: 800, ..Default::default() }),
                    ..observation(0, 0)
                }];
            }),
            "keyframe.observations[0].landmark",
            Reason::NotProjectable,
        ),
        (
            Item::Camera(v1::Camera { width_px: 800, ..camera(0) }),
            "camera.id",
            Reason::AlreadyExists,
        ),
    ]);
}

#[test]
fn what_is_not_served_yet_is_refused_as_such() {
    let unserved = |item, field| (item, field, Reason::Unimplemented);
    check(vec![
        unserved(Item::Rig(v1::Rig::default()), "rig"),
        unserved(
            bad_keyframe(|k| k.sensor = Some(v1::keyframe::Sensor::RigId(0))),
            "keyframe.rig_id",
        ),
        unserved(
            bad_keyframe(|k| k.world_from_rig = Some(shift([0.0; 3]))),
            "keyframe.world_from_rig",
        ),
        unserved(
            bad_camera(|c| c.rolling_shutter_readout_ms = 20.0),
            "camera.rolling_shutter_readout_ms",
        ),
        unserved(
            bad_keyframe(|k| k.landmarks = vec![described_landmark(500)]),
            "keyframe.landmarks[0].descriptor",
        ),
        unserved(
            Item::Landmarks(v1::LandmarkBatch {
                landmarks: vec![landmark(500), described_landmark(501)],
            }),
            "landmarks.landmarks[1].descriptor",
        ),
    ]);
}

/// A landmark with a descriptor of its own, where observations have them.
fn described_landmark(id: i64) -> v1::Landmark {
    v1::Landmark {
        descriptor: Some(described(v1::DescriptorKind::Binary, &[7; 32])),
        ..landmark(id)
    }
}

pub(crate) fn described(kind: v1::DescriptorKind, data: &[u8]) -> v1::Descriptor {
    v1::Descriptor { kind: kind.into(), name: "net".to_owned(), data: data.to_vec() }
}

#[test]
fn every_bad_field_of_an_item_is_reported() {
    run(async {
        let server = TestServer::start().await;
        server.create_map("room").await;
        server.build_map("room", 1).await;
        let (mut stream, _) = Stream::open(&server, "room", "robot", 0).await;
        let item = bad_keyframe(|k| {
            k.id = -1;
            k.observations[0].pixel = None;
            k.observations[9].sigma_px = Some(-1.0);
        });
        let ack = stream.put(50, item).await;
        let fields: Vec<&str> = ack.violations.iter().map(|v| v.field.as_str()).collect();
        assert_eq!(
            fields,
            ["keyframe.id", "keyframe.observations[0].pixel", "keyframe.observations[9].sigma_px"]
        );
    });
}

/// Half a million empty entries are a megabyte on the wire and would be fifty in memory.
#[test]
fn a_message_of_empty_entries_is_refused_before_it_is_decoded() {
    run(async {
        let server = TestServer::start().await;
        let observations = vec![v1::BundleObservation::default(); 500_000];
        let problem = v1::BundleProblem { observations, ..Default::default() };
        let request = v1::SolveBundleRequest { problem: Some(problem), ..Default::default() };
        let status = server.optimization().solve_bundle(request).await.unwrap_err();
        assert_eq!(status.code(), tonic::Code::OutOfRange, "{status:?}");
        assert!(status.message().contains("allowed for their length"), "{status:?}");
        server.create_map("m").await;
        let (mut stream, _) = Stream::open(&server, "m", "robot", 0).await;
        let observations = vec![v1::Observation::default(); 400_000];
        let batch = v1::ObservationBatch { keyframe: None, observations };
        stream.send(1, Item::Observations(batch)).await;
        let status = stream.event().await.unwrap_err();
        assert_eq!(status.code(), tonic::Code::OutOfRange, "{status:?}");
    });
}
