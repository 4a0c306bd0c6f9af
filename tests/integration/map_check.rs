//! Bad input: every kind is refused with the path of its field, and the map is unchanged.

#![allow(clippy::unwrap_used, reason = "helpers of tests fail by panicking")]

use std::sync::Arc;

use covis::map::{
    Change, ConstraintKind, Counted, EntityRef, Exceeded, Item, ItemLandmark, ItemObservation,
    MapLimits, MapPolicy, Reason, Usage,
};
use covis_solvers::geometry::{Camera, Se3, Snavely};
use covis_solvers::information::Information;
use covis_solvers::loss::Loss;
use nalgebra::Vector3;

use crate::map_support::{
    Journal, ROBOT, camera_item, corner, fix, id, landmark, observe, pixel, pose_at, relative_pose,
    street, street_keyframe,
};

/// Asserts that `item` is refused for exactly these fields.
fn check(journal: &Journal, item: &Item, expected: &[(&str, Reason)]) {
    let rejection = journal.map.check(ROBOT, item).unwrap_err();
    let found: Vec<_> = rejection.violations.iter().map(|v| (v.field.as_str(), v.reason)).collect();
    assert_eq!(found, expected, "{rejection}");
    assert!(rejection.violations.iter().all(|v| !v.description.is_empty()));
}

/// Keyframe 9 at x = 2 with two good observations, changed by `edit`.
fn keyframe(
    edit: impl FnOnce(&mut Se3, &mut Vec<ItemObservation>, &mut Vec<ItemLandmark>),
) -> Item {
    let mut pose = pose_at(2.0);
    let mut observations = vec![observe(20, &pose, &corner(20)), observe(21, &pose, &corner(21))];
    let mut landmarks = Vec::new();
    edit(&mut pose, &mut observations, &mut landmarks);
    Item::Keyframe {
        id: 9,
        capture_time_ns: 9,
        camera: Some(EntityRef::own(0)),
        world_from_camera: pose,
        odom_from_camera: None,
        observations,
        landmarks,
        global_descriptor: None,
    }
}

fn elsewhere(id: i64) -> EntityRef {
    EntityRef { client: Some("ghost".to_owned()), id }
}

#[test]
fn a_good_keyframe_becomes_a_change_and_checking_changes_nothing() {
    let journal = street(3, MapPolicy::default());
    let before = journal.map.state_hash();
    let change = journal.map.check(ROBOT, &keyframe(|_, _, _| {})).unwrap();
    let Change::KeyframeAdded { id: added, camera, observations, .. } = change else {
        panic!("{change:?}")
    };
    assert_eq!((added, camera, observations.len()), (id(9), Some(id(0)), 2));
    assert_eq!(journal.map.state_hash(), before);
}

#[test]
fn observations_out_of_range_are_named() {
    let journal = street(3, MapPolicy::default());
    check(
        &journal,
        &keyframe(|_, observations, _| {
            observations[1].pixel = pixel(5000.0, 100.0);
        }),
        &[("keyframe.observations[1].pixel.x", Reason::OutOfRange)],
    );
}

#[test]
fn dangling_references_are_named() {
    let journal = street(3, MapPolicy::default());
    check(
        &journal,
        &keyframe(|_, observations, _| {
            observations[0].landmark = EntityRef::own(777);
            observations[1].landmark = elsewhere(21);
        }),
        &[
            ("keyframe.observations[0].landmark", Reason::UnknownReference),
            ("keyframe.observations[1].landmark", Reason::UnknownReference),
        ],
    );
    let Item::Keyframe { capture_time_ns, world_from_camera, observations, landmarks, .. } =
        keyframe(|_, _, _| {})
    else {
        unreachable!()
    };
    let camera = Some(EntityRef::own(5));
    check(
        &journal,
        &Item::Keyframe {
            id: -1,
            capture_time_ns,
            camera,
            world_from_camera,
            odom_from_camera: None,
            observations,
            landmarks,
            global_descriptor: None,
        },
        &[("keyframe.id", Reason::OutOfRange), ("keyframe.camera_id", Reason::UnknownReference)],
    );
    let observations = vec![observe(0, &pose_at(0.0), &corner(0))];
    check(
        &journal,
        &Item::Observations { keyframe: EntityRef::own(50), observations },
        &[("observations.keyframe", Reason::UnknownReference)],
    );
    check(
        &journal,
        &relative_pose(1, ConstraintKind::Odometry, 0, 50, pose_at(1.0)),
        &[("relative_pose.keyframe_j", Reason::UnknownReference)],
    );
}

#[test]
fn a_landmark_in_the_center_plane_is_refused_and_one_behind_is_accepted() {
    let mut journal = street(3, MapPolicy::default());
    let with_point = |point: Vector3<f64>| {
        keyframe(|_, observations, landmarks| {
            landmarks.push(ItemLandmark { id: 1000, position: Some(point) });
            observations[1].landmark = EntityRef::own(1000);
        })
    };
    check(
        &journal,
        &with_point(Vector3::new(2.5, 1.0, 0.0)),
        &[("keyframe.observations[1].landmark", Reason::ProjectionNotFinite)],
    );
    journal.send(ROBOT, &with_point(Vector3::new(2.5, 1.0, -3.0))).unwrap();
    assert_eq!(journal.map.keyframes().get(&id(9)).unwrap().observations.len(), 2);
}

#[test]
fn two_features_of_a_keyframe_may_match_one_landmark() {
    let mut journal = street(3, MapPolicy::default());
    let item = keyframe(|_, observations, _| observations[1].landmark = EntityRef::own(20));
    let before = journal.map.observation_count();
    journal.send(ROBOT, &item).unwrap();
    assert_eq!(journal.map.observation_count(), before + 2);
    let observers = &journal.map.landmarks().get(&id(20)).unwrap().observers;
    assert_eq!(observers.iter().filter(|&&o| o == id(9)).count(), 1);
}

#[test]
fn doubles_are_named() {
    let mut journal = street(3, MapPolicy::default());
    check(
        &journal,
        &keyframe(|_, observations, landmarks| {
            observations[1].landmark = EntityRef::own(20);
            observations[1].pixel = observations[0].pixel;
            landmarks.push(ItemLandmark { id: 1000, position: None });
            landmarks.push(ItemLandmark { id: 1000, position: None });
        }),
        &[
            ("keyframe.landmarks[1].id", Reason::Duplicate),
            ("keyframe.observations[1].landmark", Reason::Duplicate),
        ],
    );
    // Known ids: the same start position is accepted, another one is not.
    journal.send(ROBOT, &keyframe(|_, _, landmarks| landmarks.push(landmark(20)))).unwrap();
    let moved = ItemLandmark { id: 20, position: Some(corner(21)) };
    check(
        &journal,
        &Item::Landmarks { landmarks: vec![moved] },
        &[("landmarks.landmarks[0].id", Reason::AlreadyExists)],
    );
    let fresh = Journal::new(MapPolicy::default());
    let Item::Keyframe { camera, world_from_camera, observations, .. } =
        street_keyframe(0, pose_at(0.0), &fresh.map)
    else {
        unreachable!()
    };
    let again = Item::Keyframe {
        id: 0,
        capture_time_ns: 5,
        camera,
        world_from_camera,
        odom_from_camera: None,
        observations,
        landmarks: Vec::new(),
        global_descriptor: None,
    };
    check(&journal, &again, &[("keyframe.id", Reason::AlreadyExists)]);
    let other = Item::Camera { id: 0, camera: camera_of(300.0), width_px: 0, height_px: 0 };
    check(&journal, &other, &[("camera.id", Reason::AlreadyExists)]);
    assert!(!journal.map.holds(ROBOT, &other));
    assert!(journal.map.holds(ROBOT, &camera_item(0)));
    let seen = vec![observe(20, &pose_at(2.0), &corner(20))];
    check(
        &journal,
        &Item::Observations { keyframe: EntityRef::own(9), observations: seen },
        &[("observations.observations[0].landmark", Reason::Duplicate)],
    );
}

fn camera_of(focal: f64) -> Camera {
    Camera::Snavely(Snavely { focal, k1: 0.0, k2: 0.0 })
}

#[test]
fn constraints_and_priors_are_checked() {
    let mut journal = street(3, MapPolicy::default());
    let kind = ConstraintKind::LoopClosure;
    check(
        &journal,
        &relative_pose(-3, kind, 1, 1, pose_at(1.0)),
        &[
            ("relative_pose.id", Reason::OutOfRange),
            ("relative_pose.keyframe_j", Reason::Inconsistent),
        ],
    );
    let pose_prior = Item::PosePrior {
        id: 1,
        keyframe: EntityRef::own(1),
        world_from_camera: pose_at(1.0),
        information: Information::identity(),
        loss: Loss::Trivial,
    };
    check(
        &journal,
        &fix(1, 8, Vector3::zeros()),
        &[("position_prior.keyframe", Reason::UnknownReference)],
    );
    // Constraints and priors share one id space.
    journal.send(ROBOT, &relative_pose(1, kind, 0, 1, pose_at(1.0))).unwrap();
    check(&journal, &pose_prior, &[("pose_prior.id", Reason::AlreadyExists)]);
    assert!(journal.map.holds(ROBOT, &relative_pose(1, kind, 0, 1, pose_at(1.0))));
    assert!(!journal.map.holds(ROBOT, &relative_pose(1, kind, 0, 1, pose_at(1.1))));
}

#[test]
fn empty_lists_are_missing() {
    let journal = street(1, MapPolicy::default());
    let item = Item::Landmarks { landmarks: Vec::new() };
    check(&journal, &item, &[("landmarks.landmarks", Reason::Missing)]);
    let item = Item::Observations { keyframe: EntityRef::own(0), observations: Vec::new() };
    check(&journal, &item, &[("observations.observations", Reason::Missing)]);
}

#[test]
fn what_an_item_adds_is_counted_before_it_is_taken() {
    let mut journal = street(2, MapPolicy::default());
    // The street of two keyframes has 30 landmarks and 20 + 30 observations.
    let item = keyframe(|pose, observations, landmarks| {
        landmarks.push(landmark(30));
        observations.push(observe(30, pose, &corner(30)));
    });
    let change = journal.map.check(ROBOT, &item).unwrap();
    let (usage, growth) = (journal.map.usage(), journal.map.growth(&change));
    assert_eq!((usage.keyframes, usage.landmarks, usage.observations), (2, 30, 50));
    assert_eq!((growth.keyframes, growth.landmarks, growth.observations), (1, 1, 3));
    let none = MapLimits::default();
    let cases = [
        (Counted::Keyframes, 2, MapLimits { keyframes: Some(2), ..none }),
        (Counted::Landmarks, 30, MapLimits { landmarks: Some(30), ..none }),
        (Counted::Observations, 52, MapLimits { observations: Some(52), ..none }),
        (Counted::Bytes, usage.bytes, MapLimits { bytes: Some(usage.bytes), ..none }),
    ];
    for (counted, maximum, limits) in cases {
        assert_eq!(limits.exceeded(usage, growth), Some(Exceeded { counted, maximum }));
    }
    let roomy = MapLimits {
        keyframes: Some(3),
        landmarks: Some(31),
        observations: Some(53),
        bytes: Some(usage.bytes + growth.bytes),
        ..none
    };
    assert_eq!(roomy.exceeded(usage, growth), None);
    assert_eq!(roomy.exceeded(roomy_usage(), Usage::default()), None, "what adds nothing has room");
    journal.send(ROBOT, &item).unwrap();
    let now = journal.map.usage();
    assert_eq!((now.keyframes, now.landmarks, now.observations), (3, 31, 53));
    // No item takes more than was counted for it before.
    assert!(usage.bytes < now.bytes && now.bytes <= usage.bytes + growth.bytes, "{now:?}");
}

fn roomy_usage() -> Usage {
    let (keyframes, landmarks, observations, bytes) = (9, 99, 999, u64::MAX);
    Usage { keyframes, landmarks, observations, bytes, ..Usage::default() }
}

#[test]
fn a_flood_of_violations_is_cut_off() {
    let journal = street(1, MapPolicy::default());
    let bad = |k: i64| {
        let mut observation = observe(0, &pose_at(0.0), &corner(0));
        observation.landmark = EntityRef::own(10_000 + k);
        observation
    };
    let item = Item::Observations {
        keyframe: EntityRef::own(0),
        observations: (0..500).map(bad).collect(),
    };
    assert_eq!(journal.map.check(ROBOT, &item).unwrap_err().violations.len(), 32);
}

#[test]
fn references_reach_across_clients_and_descriptors_are_kept() {
    let mut journal = street(1, MapPolicy::default());
    journal.push(Change::ClientOpened { name: "drone".to_owned(), epoch: 1 });
    let drone = journal.map.client_named("drone").unwrap();
    let of_robot = |id| EntityRef { client: Some("robot".to_owned()), id };
    let mut observation = observe(0, &pose_at(0.5), &corner(0));
    observation.landmark = of_robot(0);
    let descriptor = covis::map::Descriptor {
        kind: covis::map::DescriptorKind::Binary,
        name: "orb".to_owned(),
        data: vec![1, 2, 3],
    };
    observation.descriptor = Some(Arc::new(descriptor));
    let item = Item::Keyframe {
        id: 0,
        capture_time_ns: 0,
        camera: Some(of_robot(0)),
        world_from_camera: pose_at(0.5),
        odom_from_camera: None,
        observations: vec![observation],
        landmarks: Vec::new(),
        global_descriptor: None,
    };
    journal.send(drone, &item).unwrap();
    assert_eq!(journal.map.keyframes().len(), 2);
    assert_eq!(journal.map.landmarks().get(&id(0)).unwrap().observers.len(), 2);
    let own = journal.map.keyframes().keys().last().copied().unwrap();
    assert_eq!(own.client, drone);
    assert!(journal.map.keyframes().get(&own).unwrap().observations[0].descriptor.is_some());
    assert!(journal.map.holds(drone, &item));
}

#[test]
fn a_keyframe_without_camera_takes_no_observations() {
    let mut journal = street(3, MapPolicy::default());
    let at_two = |camera, observations| Item::Keyframe {
        id: 9,
        capture_time_ns: 9,
        camera,
        world_from_camera: pose_at(2.0),
        odom_from_camera: None,
        observations,
        landmarks: Vec::new(),
        global_descriptor: None,
    };
    let seen = vec![observe(20, &pose_at(2.0), &corner(20))];
    check(&journal, &at_two(None, seen.clone()), &[("keyframe.camera_id", Reason::Missing)]);
    journal.send(ROBOT, &at_two(None, Vec::new())).unwrap();
    assert!(journal.map.holds(ROBOT, &at_two(None, Vec::new())));
    check(
        &journal,
        &Item::Observations { keyframe: EntityRef::own(9), observations: seen },
        &[("observations.keyframe", Reason::Inconsistent)],
    );
    // A camera that is not there is no camera left out.
    let unknown = at_two(Some(EntityRef::own(5)), Vec::new());
    assert!(!journal.map.holds(ROBOT, &unknown));
}

#[test]
fn every_kind_of_entity_counts_before_it_is_taken() {
    let mut journal = street(3, MapPolicy::default());
    let prior = fix(2, 0, Vector3::zeros());
    let constraint = relative_pose(1, ConstraintKind::Odometry, 0, 1, pose_at(1.0));
    for (item, counted) in [
        (camera_item(1), Counted::Cameras),
        (constraint, Counted::Constraints),
        (prior, Counted::Priors),
    ] {
        let change = journal.map.check(ROBOT, &item).unwrap();
        let (usage, growth) = (journal.map.usage(), journal.map.growth(&change));
        assert_eq!(growth.of(counted), 1);
        journal.send(ROBOT, &item).unwrap();
        assert_eq!(journal.map.usage(), usage + growth, "{counted:?}");
    }
    let opened = Change::ClientOpened { name: "drone".to_owned(), epoch: 1 };
    let (usage, growth) = (journal.map.usage(), journal.map.growth(&opened));
    assert_eq!(growth.clients, 1);
    journal.push(opened);
    assert_eq!(journal.map.usage(), usage + growth);
    let again = Change::ClientOpened { name: "drone".to_owned(), epoch: 2 };
    assert_eq!(journal.map.growth(&again), Usage::default(), "a client that comes back is known");
}

#[test]
fn a_pixel_far_outside_is_refused_whether_the_image_is_known_or_not() {
    let mut journal = street(2, MapPolicy::default());
    let Item::Camera { camera, .. } = camera_item(1) else { panic!("a camera") };
    journal.send(ROBOT, &Item::Camera { id: 1, camera, width_px: 0, height_px: 0 }).unwrap();
    // An image of 640 × 480: one image beyond each side is the most. Without a size, that of the
    // largest image.
    for (id, u, v, field) in [
        (0, 1281.0, 0.0, Some("x")),
        (0, 0.0, -481.0, Some("y")),
        (0, 1280.0, -480.0, None),
        (1, 1281.0, -481.0, None),
        (1, 131_073.0, 0.0, Some("x")),
        (1, 0.0, -1e300, Some("y")),
    ] {
        let mut seen = observe(0, &pose_at(0.0), &corner(0));
        seen.pixel = pixel(u, v);
        let item = Item::Keyframe {
            id: 7,
            capture_time_ns: 7,
            camera: Some(EntityRef::own(id)),
            world_from_camera: pose_at(0.0),
            odom_from_camera: None,
            observations: vec![seen],
            landmarks: Vec::new(),
            global_descriptor: None,
        };
        match field {
            None => drop(journal.map.check(ROBOT, &item).unwrap()),
            Some(field) => {
                let field = format!("keyframe.observations[0].pixel.{field}");
                check(&journal, &item, &[(&field, Reason::OutOfRange)]);
            }
        }
    }
}
