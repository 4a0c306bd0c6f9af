//! Conversions there and back, field paths, and that all violations are reported.

use std::collections::BTreeMap;
use std::sync::Arc;

use covis_solvers::geometry::{
    Camera, KannalaBrandt, LieGroup, PinholeRadialTangential, Se3, Snavely,
};
use covis_solvers::loss::Loss;
use nalgebra::Vector3;

use super::camera::{camera, to_camera};
use super::geometry::{
    information, rigid_transform, rigid_transform2, to_rigid_transform, to_rigid_transform2,
    to_upper_triangle,
};
use super::item::{digest, item};
use super::map::to_map;
use super::solve::{Systems, loss, options, to_loss};
use super::time::{nanoseconds, timestamp};
use super::{Path, Violations, convert};
use crate::map::{CameraEntity, Change, Event, Item, Map, MapPolicy, Reason};
use crate::service::engine::{MapInfo, MapState, PendingWork};
use crate::wire::v1;
use v1::ingest_request::Item as WireItem;

const AT: Path<'static> = Path::root("field");

/// The value of a conversion that must succeed.
fn good<T>(conversion: impl FnOnce(&mut Violations) -> Option<T>) -> T {
    convert(conversion).unwrap()
}

/// Fields and reasons of a conversion that must fail.
fn bad<T: std::fmt::Debug>(
    conversion: impl FnOnce(&mut Violations) -> Option<T>,
) -> Vec<(String, Reason)> {
    let rejection = convert(conversion).unwrap_err();
    rejection.violations.into_iter().map(|v| (v.field, v.reason)).collect()
}

#[test]
fn paths_are_written_from_the_request_on() {
    let keyframe = Path::root("keyframe");
    let list = keyframe.field("observations");
    let entry = list.index(3);
    let pixel = entry.field("pixel");
    assert_eq!(pixel.field("x").to_string(), "keyframe.observations[3].pixel.x");
}

#[test]
fn cameras_come_back_to_the_bit() {
    let models = [
        Camera::Pinhole(PinholeRadialTangential {
            fx: 500.1,
            fy: 499.9,
            cx: 320.2,
            cy: -3.0,
            k1: 0.1,
            k2: -0.2,
            p1: 1e-3,
            p2: -1e-4,
            k3: 0.01,
        }),
        Camera::Fisheye(KannalaBrandt {
            fx: 300.0,
            fy: 301.0,
            cx: 1.0,
            cy: 2.0,
            k1: 0.1,
            k2: 0.2,
            k3: 0.3,
            k4: 0.4,
        }),
        Camera::Snavely(Snavely { focal: 700.0, k1: -1e-3, k2: 2e-6 }),
    ];
    for model in models {
        let entity = CameraEntity { camera: model, width_px: 640, height_px: 0 };
        let message = to_camera("robot".to_owned(), 3, &entity);
        assert_eq!(good(|out| camera(AT, &message, out)), entity);
    }
}

#[test]
fn transforms_and_matrices_come_back() {
    let message = v1::RigidTransform {
        translation: Some(v1::Vector3 { x: 1.0, y: -2.0, z: 1e9 }),
        rotation: Some(v1::Quaternion { x: 0.5, y: -0.5, z: 0.5, w: 0.5 }),
    };
    let pose = good(|out| rigid_transform(AT, Some(&message), out));
    assert_eq!(to_rigid_transform(&pose), message);
    let flat =
        v1::RigidTransform2 { translation: Some(v1::Vector2 { x: 3.0, y: 4.0 }), angle_rad: -0.75 };
    let pose = good(|out| rigid_transform2(AT, Some(&flat), out));
    assert!((to_rigid_transform2(&pose).angle_rad + 0.75).abs() < 1e-15);
    let mut upper_triangle = vec![0.0; 21];
    for (index, entry) in [0, 6, 11, 15, 18, 20].into_iter().enumerate() {
        upper_triangle[entry] = 2.0 + index as f64;
    }
    upper_triangle[1] = 0.25;
    let information = good(|out| information::<6>(AT, Some(&upper_triangle), out));
    let matrix = information.matrix();
    assert_eq!((matrix[(0, 1)], matrix[(1, 0)], matrix[(5, 5)]), (0.25, 0.25, 7.0));
    assert_eq!(to_upper_triangle(&information), upper_triangle);
}

#[test]
fn quaternions_are_normalized_within_a_thousandth_and_refused_past_it() {
    let with = |w| v1::RigidTransform {
        translation: Some(v1::Vector3::default()),
        rotation: Some(v1::Quaternion { w, ..Default::default() }),
    };
    for w in [0.9991, 1.0, 1.0009, -1.0] {
        let pose = good(|out| rigid_transform(AT, Some(&with(w)), out));
        assert!((pose.rotation.quaternion().norm() - 1.0).abs() < 1e-15);
        assert_eq!(pose.rotation.rotate(&Vector3::x()), Vector3::x());
    }
    for w in [0.0, 0.9989, 1.0011, 1e200] {
        let found = bad(|out| rigid_transform(AT, Some(&with(w)), out));
        assert_eq!(found, [("field.rotation".to_owned(), Reason::NotNormalized)], "{w}");
    }
}

#[test]
fn the_odometry_pose_of_a_keyframe_is_read_and_named_when_bad() {
    let pose = |x, w| v1::RigidTransform {
        translation: Some(v1::Vector3 { x, ..Default::default() }),
        rotation: Some(v1::Quaternion { w, ..Default::default() }),
    };
    let read = |odom_from_camera| {
        let keyframe = v1::Keyframe {
            capture_time: Some(timestamp(5)),
            world_from_camera: Some(pose(1.0, 1.0)),
            odom_from_camera,
            ..Default::default()
        };
        item(WireItem::Keyframe(keyframe), "robot")
    };
    let odometry = |odom| {
        let Item::Keyframe { camera: None, odom_from_camera, .. } = read(odom).unwrap() else {
            panic!("a keyframe without camera was sent");
        };
        odom_from_camera
    };
    assert_eq!(odometry(None), None);
    assert_eq!(odometry(Some(pose(7.0, 1.0))).unwrap().translation, Vector3::new(7.0, 0.0, 0.0));
    let without_rotation = v1::RigidTransform { rotation: None, ..pose(0.0, 1.0) };
    for (odom, field, reason) in [
        (pose(f64::NAN, 1.0), "keyframe.odom_from_camera.translation.x", Reason::NotFinite),
        (pose(0.0, f64::INFINITY), "keyframe.odom_from_camera.rotation.w", Reason::NotFinite),
        (pose(0.0, 0.9), "keyframe.odom_from_camera.rotation", Reason::NotNormalized),
        (without_rotation, "keyframe.odom_from_camera.rotation", Reason::Missing),
    ] {
        let found = read(Some(odom)).unwrap_err().rejection.violations;
        assert_eq!((found[0].field.as_str(), found[0].reason, found.len()), (field, reason, 1));
    }
}

#[test]
fn losses_come_back() {
    for value in [
        Loss::Trivial,
        Loss::Huber(1.5),
        Loss::Cauchy(2.0),
        Loss::Tukey(4.0),
        Loss::GemanMcClure(0.5),
    ] {
        assert_eq!(good(|out| loss(AT, Some(&to_loss(&value)), out)), Some(value));
    }
}

#[test]
fn times_come_back_also_before_the_epoch() {
    for time in [0, 1, -1, 1_700_000_000_123_456_789, i64::MIN + 1_000_000_000, i64::MAX] {
        assert_eq!(good(|out| nanoseconds(AT, Some(&timestamp(time)), out)), time);
    }
}

#[test]
fn absent_options_take_the_defaults_that_the_wire_states() {
    let options = good(|out| options(None, Systems::Bundle, 2, None, out));
    let loop_options = options.optimizer;
    assert_eq!(loop_options.max_iterations, 50);
    assert_eq!(loop_options.cost_tolerance, 1e-10);
    assert_eq!(loop_options.gradient_tolerance, 1e-10);
    assert_eq!(loop_options.step_tolerance, 1e-12);
    assert_eq!(loop_options.initial_damping, 1e-4);
    assert_eq!((loop_options.deadline, loop_options.threads), (None, None));
}

#[test]
fn a_digest_tells_contents_apart() {
    let camera = |id| WireItem::Camera(v1::Camera { id, ..Default::default() });
    assert_eq!(digest(&camera(1)), digest(&camera(1)));
    assert_ne!(digest(&camera(1)), digest(&camera(2)));
    // The same bytes in another member of the oneof are another item.
    let set = WireItem::SetCamera(v1::Camera { id: 1, ..Default::default() });
    assert_ne!(digest(&camera(1)), digest(&set));
}

#[test]
fn one_s_own_name_in_an_item_is_the_same_as_none() {
    let landmark = |client_id: &str| {
        let landmark =
            v1::Landmark { client_id: client_id.to_owned(), id: 4, ..Default::default() };
        WireItem::Landmarks(v1::LandmarkBatch { landmarks: vec![landmark] })
    };
    let read = item(landmark("robot"), "robot").unwrap();
    assert_eq!(read, item(landmark(""), "robot").unwrap());
    assert!(matches!(read, Item::Landmarks { .. }));
    let refused = item(landmark("drone"), "robot").unwrap_err().rejection;
    assert_eq!(refused.violations[0].field, "landmarks.landmarks[0].client_id");
}

#[test]
fn an_item_with_more_entries_than_the_server_takes_is_refused_as_too_large() {
    let landmark = |id| v1::Landmark { id, ..Default::default() };
    let batch = |count| {
        let landmarks = (0..count).map(landmark).collect();
        item(WireItem::Landmarks(v1::LandmarkBatch { landmarks }), "robot")
    };
    assert!(batch(65_536).is_ok());
    let violation = &batch(65_537).unwrap_err().rejection.violations[0];
    assert_eq!((&violation.field[..], violation.reason), ("landmarks.landmarks", Reason::TooLarge));
    let observations = vec![v1::Observation::default(); 65_537];
    let seen = v1::ObservationBatch { keyframe: None, observations };
    let refused = item(WireItem::Observations(seen), "robot").unwrap_err().rejection;
    assert!(refused.violations.iter().any(|v| v.reason == Reason::TooLarge), "{refused}");
}

#[test]
fn each_field_of_an_edit_that_cannot_be_read_is_named() {
    let landmark = |id| v1::LandmarkRef { client_id: String::new(), id };
    let keyframe = Some(v1::KeyframeRef { client_id: "Not A Name".to_owned(), id: 1 });
    let unnamed = v1::ObservationRef { keyframe, landmark: None, camera_index: 1 };
    let fused = |kept, count| {
        let absorbed = vec![landmark(-2); count];
        WireItem::FuseLandmarks(v1::FuseLandmarks { kept, absorbed })
    };
    let constraint = Some(v1::ConstraintRef { client_id: "Not A Name".to_owned(), id: -4096 });
    let cases: [(WireItem, &[(&str, Reason)]); 9] = [
        (
            WireItem::RevokeConstraint(v1::RevokeConstraint::default()),
            &[("revoke_constraint.constraint", Reason::Missing)],
        ),
        (
            WireItem::RevokeConstraint(v1::RevokeConstraint { constraint }),
            &[("revoke_constraint.constraint.client_id", Reason::OutOfRange)],
        ),
        (
            WireItem::RemoveObservations(v1::RemoveObservations { observations: vec![unnamed] }),
            &[
                ("remove_observations.observations[0].keyframe.client_id", Reason::OutOfRange),
                ("remove_observations.observations[0].landmark", Reason::Missing),
                ("remove_observations.observations[0].camera_index", Reason::OutOfRange),
            ],
        ),
        (
            WireItem::RemoveObservations(v1::RemoveObservations::default()),
            &[("remove_observations.observations", Reason::Missing)],
        ),
        (
            fused(None, 1),
            &[
                ("fuse_landmarks.kept", Reason::Missing),
                ("fuse_landmarks.absorbed[0].id", Reason::OutOfRange),
            ],
        ),
        (fused(Some(landmark(1)), 65_537), &[("fuse_landmarks.absorbed", Reason::TooLarge)]),
        (
            WireItem::RemoveLandmarks(v1::RemoveLandmarks::default()),
            &[("remove_landmarks.landmarks", Reason::Missing)],
        ),
        (
            WireItem::RemoveKeyframe(v1::RemoveKeyframe::default()),
            &[("remove_keyframe.keyframe", Reason::Missing)],
        ),
        (
            WireItem::SetCamera(v1::Camera { id: -1, width_px: -2, ..Default::default() }),
            &[
                ("set_camera.id", Reason::OutOfRange),
                ("set_camera.width_px", Reason::OutOfRange),
                ("set_camera.model", Reason::Missing),
            ],
        ),
    ];
    for (message, expected) in cases {
        let refused = item(message, "robot").unwrap_err().rejection.violations;
        let found: Vec<_> = refused.iter().map(|v| (v.field.as_str(), v.reason)).collect();
        assert_eq!(found, expected);
    }
}

#[test]
fn an_edit_names_another_client_s_camera_and_an_empty_name_is_the_sender() {
    let model = v1::Snavely { focal: 500.0, k1: 0.0, k2: 0.0 };
    let set = |client_id: &str| {
        let model = Some(v1::camera::Model::Snavely(model));
        let client_id = client_id.to_owned();
        item(
            WireItem::SetCamera(v1::Camera { client_id, id: 3, model, ..Default::default() }),
            "robot",
        )
    };
    let owner = |read| match read {
        Ok(Item::Edit(crate::map::Edit::SetCamera { id, .. })) => (id.client, id.id),
        other => panic!("{other:?}"),
    };
    assert_eq!(owner(set("")), (None, 3));
    assert_eq!(owner(set("drone")), (Some("drone".to_owned()), 3));
}

#[test]
fn a_map_of_many_merges_is_answered_in_one_message() {
    let push = |map: &mut Map, change| {
        let event = Event { revision: map.revision() + 1, time_ns: 0, cause: None, change };
        map.apply(&event).unwrap();
    };
    let empty = |clients: u32, prefix: &str| {
        let (mut map, policy) = (Map::new(), MapPolicy::default());
        let display_name = String::new();
        push(&mut map, Change::Created { policy, create_time_ns: 1, display_name });
        for client in 0..clients {
            let name = format!("{prefix}-{client:0>50}");
            push(&mut map, Change::ClientOpened { name, epoch: 1 });
        }
        map
    };
    // Each is merged into the next, so that each merge has the clients of all before it.
    let (mut map, mut bytes) = (empty(1000, "robot"), 0);
    for floor in 0..20 {
        let mut target = empty(1, &format!("floor-{floor}"));
        let from = (&*format!("floor-{floor}"), &map);
        let merge = target.merge_of(from, Se3::identity(), &BTreeMap::new(), &[]).unwrap();
        push(&mut target, Change::MapMerged { merge: Box::new(merge) });
        map = target;
        let before = std::mem::replace(&mut bytes, map.usage().bytes);
        assert!(bytes > before + 1000 * 64, "what a merge keeps is counted");
    }
    let info = MapInfo {
        name: "house".to_owned(),
        uid: String::new(),
        snapshot: Arc::new(map),
        state: MapState::Open,
        trouble: None,
        pending: PendingWork::default(),
    };
    let message = to_map(&info, 1);
    assert_eq!((message.merged_map_count, message.merged_maps.len()), (20, 20));
    assert!(message.merged_maps.iter().all(|merged| merged.client_count >= 1000));
    let names: usize = message.merged_maps.iter().map(|merged| merged.client_ids.len()).sum();
    assert!((2000..=4096).contains(&names), "{names} names");
}
