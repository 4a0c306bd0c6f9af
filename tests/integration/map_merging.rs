//! Maps that become one and apart again, without a server: what comes, under which ids and in which frame,
//! and what is left when it goes.

use std::collections::BTreeMap;

use covis::map::{
    Change, ClientIndex, ConstraintKind, EntityId, EntityRef, Event, Item, ItemObservation, Link,
    Map, MapParts, MapPolicy, MergeError, Prior,
};
use covis_solvers::geometry::{LieGroup, Se3, So3};
use covis_solvers::information::Information;
use nalgebra::{Matrix3, Vector3};

use crate::map_support::{
    Journal, ROBOT, assert_covisibility, fix, id, pose_at, pose_error, relative_pose, street,
    street_keyframe,
};

/// The street of another robot with a closure and a fix of its own, in a frame of its own.
fn other(name: &str) -> Journal {
    let mut journal = Journal::new(MapPolicy::default());
    journal.push(Change::ClientOpened { name: name.to_owned(), epoch: 3 });
    // The client "robot" of this map is the one that sends; it is renamed by the merges.
    let from = street(5, MapPolicy::default());
    for event in &from.events[3..] {
        journal.push(event.change.clone());
    }
    let far = relative_pose(7, ConstraintKind::LoopClosure, 0, 4, pose_at(4.0));
    journal.send(ROBOT, &far).unwrap();
    journal.send(ROBOT, &fix(8, 2, Vector3::new(2.0, 0.0, 0.0))).unwrap();
    journal
}

fn target_from_source() -> Se3 {
    let turn = So3::from_quaternion_xyzw(0.0, 0.0, 0.5_f64.sqrt(), 0.5_f64.sqrt()).unwrap();
    Se3::new(turn, Vector3::new(10.0, -3.0, 0.5))
}

fn renamed() -> BTreeMap<String, String> {
    BTreeMap::from([("robot".to_owned(), "robot-b".to_owned())])
}

fn link() -> Link {
    Link {
        target: id(1),
        source: id(3),
        target_from_source: pose_at(0.25),
        information: Information::identity(),
    }
}

/// What is merged stands behind the clients of the target.
fn moved(old: EntityId) -> EntityId {
    EntityId::new(ClientIndex(old.client.0 + 1), old.id)
}

fn merged() -> (Journal, Map) {
    let mut target = street(4, MapPolicy::default());
    let source = other("helper").map;
    let merge = target
        .map
        .merge_of(("floor-2", &source), target_from_source(), &renamed(), &[link()])
        .unwrap();
    let (before, growth) = (target.map.usage(), {
        let change = Change::MapMerged { merge: Box::new(merge.clone()) };
        let growth = target.map.growth(&change);
        target.push(change);
        growth
    });
    let added = target.map.usage() - before;
    assert_eq!((added.keyframes, growth.keyframes), (5, 5));
    assert_eq!((added.landmarks, added.priors), (growth.landmarks, growth.priors));
    (target, source)
}

fn is_whole(map: &Map) {
    assert_covisibility(map);
    assert_eq!(Map::from_parts(map.to_parts()).unwrap(), *map);
    map.check_sound().unwrap();
}

#[test]
fn a_merged_map_is_there_in_the_frame_of_the_target() {
    let (target, source) = merged();
    let map = &target.map;
    is_whole(map);
    let names: Vec<&str> = map.clients().iter().map(|client| client.name.as_str()).collect();
    assert_eq!(names, ["robot", "robot-b", "helper"]);
    assert_eq!(map.clients()[2].epoch, 3);
    let pose = target_from_source();
    assert_eq!(map.keyframes().len(), 4 + source.keyframes().len());
    for (&old, keyframe) in source.keyframes() {
        let new = map.keyframes().get(&moved(old)).unwrap();
        let expected = pose.compose(&keyframe.world_from_camera);
        assert!(pose_error(&new.world_from_camera, &expected) < 1e-12);
        // Odometry is the robot's own, and every observation is there.
        assert_eq!(new.odom_from_camera, keyframe.odom_from_camera);
        assert_eq!(new.observations.len(), keyframe.observations.len());
        assert_eq!(new.camera, keyframe.camera.map(moved));
    }
    for (&old, landmark) in source.landmarks() {
        let new = map.landmarks().get(&moved(old)).unwrap();
        let expected = pose.transform(&landmark.position.unwrap());
        assert!((new.position.unwrap() - expected).norm() < 1e-12);
        assert_eq!(new.sent_position, landmark.sent_position);
        let observers: Vec<_> = landmark.observers.iter().map(|&o| moved(o)).collect();
        assert_eq!(*new.observers, observers);
    }
    let prior = map.priors().get(&moved(id(8))).unwrap();
    let Prior::Position { position_in_world, information, .. } = prior else { panic!() };
    let at = pose.transform(&Vector3::new(2.0, 0.0, 0.0));
    assert!((position_in_world - at).norm() < 1e-12);
    assert!((information.matrix() - Matrix3::identity() * 1e4).norm() < 1e-8);
    assert_eq!(map.constraints().get(&moved(id(7))).unwrap().keyframe_j, moved(id(4)));
    let closure = map.constraints().iter().find(|(id, _)| id.id < 0).unwrap();
    assert_eq!((closure.1.keyframe_i, closure.1.keyframe_j), (id(1), moved(id(3))));
    // The pose graph is to take it into account.
    assert_eq!(map.place_searches().unsolved, map.revision());
}

#[test]
fn a_journal_with_a_merge_replays_to_the_bit() {
    let (mut target, _) = merged();
    let before = target.map.clone();
    assert_eq!(Map::replay(target.events.iter()).unwrap(), before);
    target.push(Change::MapTakenOut { name: "floor-2".to_owned(), clients_leave: true });
    assert_eq!(Map::replay(target.events.iter()).unwrap(), target.map);
    is_whole(&target.map);
}

#[test]
fn a_map_that_is_taken_out_is_what_it_was() {
    let (mut target, source) = merged();
    let out = target.map.taken_out("floor-2").unwrap().unwrap();
    is_whole(&out);
    assert!(!out.is_frozen() && out.revision() > source.revision());
    let names = |map: &Map| map.clients().iter().map(|c| c.name.clone()).collect::<Vec<_>>();
    assert_eq!(names(&out), names(&source));
    for (out, source) in out.clients().iter().zip(source.clients()) {
        assert_eq!((out.epoch, out.next_sequence), (source.epoch, source.next_sequence));
        assert_eq!(out.items, source.items);
    }
    assert_eq!(out.keyframes().len(), source.keyframes().len());
    for (id, keyframe) in source.keyframes() {
        let new = out.keyframes().get(id).unwrap();
        assert!(pose_error(&new.world_from_camera, &keyframe.world_from_camera) < 1e-9);
        assert_eq!(new.observations, keyframe.observations);
    }
    assert_eq!(out.landmarks().len(), source.landmarks().len());
    assert_eq!(out.constraints(), source.constraints());
    assert_eq!(out.contents(), source.contents());
    assert_eq!(out.policy(), source.policy());
    // What is left is the target alone, with a client that has nothing.
    let alone = street(4, MapPolicy::default()).map;
    target.push(Change::MapTakenOut { name: "floor-2".to_owned(), clients_leave: true });
    let left = &target.map;
    let ids = |map: &Map| map.keyframes().keys().copied().collect::<Vec<_>>();
    assert_eq!(ids(left), ids(&alone));
    assert_eq!(left.landmarks().len(), alone.landmarks().len());
    assert!(left.constraints().is_empty() && left.priors().is_empty());
    assert!(left.cameras().keys().all(|camera| camera.client == ROBOT));
    assert!(left.merged().is_empty() && left.taken_out("floor-2").unwrap().is_none());
    assert_eq!(left.clients()[1].next_sequence, 1);
    // It may come again, under the names that it had.
    let merge = left.merge_of(("floor-2", &out), Se3::identity(), &renamed(), &[]).unwrap();
    target.push(Change::MapMerged { merge: Box::new(merge) });
    is_whole(&target.map);
    assert_eq!(target.map.clients().len(), 3);
}

#[test]
fn what_clients_see_of_each_other_stays_on_its_side_when_they_part() {
    let (mut target, source) = merged();
    // The robot sees a landmark of the one that came.
    let item = Item::Observations {
        keyframe: EntityRef::own(0),
        observations: vec![ItemObservation {
            landmark: EntityRef { client: Some("robot-b".to_owned()), id: 3 },
            pixel: crate::map_support::pixel(5.0, 5.0),
            sigma_px: 1.0,
            depth: None,
            descriptor: None,
        }],
    };
    target.send(ROBOT, &item).unwrap();
    is_whole(&target.map);
    let out = target.map.taken_out("floor-2").unwrap().unwrap();
    is_whole(&out);
    assert_eq!(out.observation_count(), source.observation_count());
    target.push(Change::MapTakenOut { name: "floor-2".to_owned(), clients_leave: true });
    is_whole(&target.map);
    assert_eq!(
        target.map.observation_count(),
        street(4, MapPolicy::default()).map.observation_count()
    );
}

#[test]
fn a_keyframe_that_stays_loses_a_camera_that_leaves() {
    let (mut target, _) = merged();
    let mut item = street_keyframe(4, pose_at(4.0), &target.map);
    let Item::Keyframe { camera, .. } = &mut item else { panic!() };
    *camera = Some(EntityRef { client: Some("robot-b".to_owned()), id: 0 });
    target.send(ROBOT, &item).unwrap();
    is_whole(&target.map);
    target.push(Change::MapTakenOut { name: "floor-2".to_owned(), clients_leave: true });
    is_whole(&target.map);
    let keyframe = target.map.keyframes().get(&id(4)).unwrap();
    assert!(keyframe.camera.is_none() && keyframe.observations.is_empty());
    assert_eq!(keyframe.world_from_camera, pose_at(4.0));
    assert_eq!(Map::replay(target.events.iter()).unwrap(), target.map);
}

#[test]
fn maps_that_were_merged_into_a_merged_map_come_along() {
    let (middle, _) = merged();
    let mut outer = Journal::new(MapPolicy::default());
    let names = BTreeMap::from([("robot".to_owned(), "robot-a".to_owned())]);
    let merge =
        outer.map.merge_of(("floor-1", &middle.map), target_from_source(), &names, &[]).unwrap();
    outer.push(Change::MapMerged { merge: Box::new(merge) });
    is_whole(&outer.map);
    let [inner, floor] = outer.map.merged() else { panic!() };
    assert_eq!((inner.name.as_str(), floor.name.as_str()), ("floor-2", "floor-1"));
    let twice = target_from_source().compose(&target_from_source());
    assert!(pose_error(&inner.target_from_source.rigid(), &twice) < 1e-12);
    // And leave with it.
    let out = outer.map.taken_out("floor-1").unwrap().unwrap();
    is_whole(&out);
    let [left] = out.merged() else { panic!() };
    let [before] = middle.map.merged() else { panic!() };
    assert_eq!((&left.name, &left.clients), (&before.name, &before.clients));
    assert!(left.target_from_source.minus(&before.target_from_source).norm() < 1e-9);
    outer.push(Change::MapTakenOut { name: "floor-1".to_owned(), clients_leave: true });
    assert!(outer.map.merged().is_empty() && outer.map.keyframes().is_empty());
}

#[test]
fn maps_that_do_not_fit_are_refused() {
    let target = street(2, MapPolicy::default()).map;
    let source = other("helper").map;
    let refused = |renamed: &[(&str, &str)]| {
        let renamed = renamed.iter().map(|&(a, b)| (a.to_owned(), b.to_owned())).collect();
        target.merge_of(("b", &source), Se3::identity(), &renamed, &[]).unwrap_err()
    };
    let client = |name: &str| name.to_owned();
    assert_eq!(refused(&[]), MergeError::ClientInBoth { client: client("robot") });
    let error = refused(&[("robot", "x"), ("nobody", "y")]);
    assert_eq!(error, MergeError::UnknownClient { client: client("nobody") });
    let error = refused(&[("robot", "helper")]);
    assert_eq!(error, MergeError::NameTwice { client: client("helper") });
    let geodetic_anchor = Some(covis_solvers::geometry::Geodetic {
        latitude_deg: 48.0,
        longitude_deg: 9.0,
        height_m: 400.0,
    });
    // The source has a fix of its own.
    let mut anchored = street(2, MapPolicy { geodetic_anchor, ..MapPolicy::default() });
    anchored.send(ROBOT, &fix(0, 0, Vector3::zeros())).unwrap();
    let error = anchored.map.merge_of(("b", &source), Se3::identity(), &renamed(), &[]);
    assert_eq!(error.unwrap_err(), MergeError::Anchors);
}

#[test]
fn what_is_left_of_a_merged_map_is_known_by_what_its_clients_have_sent() {
    let (target, source) = merged();
    let is_rest = |map: &Map| map.is_within(&target.map, target.map.merged_as("floor-2").unwrap());
    assert!(is_rest(&source));
    let out = target.map.taken_out("floor-2").unwrap().unwrap();
    assert!(is_rest(&out), "as an undo leaves it that is cut off before the target's event");
    let mut later = other("helper");
    later.push(Change::MapUpdated { display_name: None, policy: None, frozen: Some(true) });
    assert!(is_rest(&later.map));
    later.push(Change::MapUpdated { display_name: None, policy: None, frozen: Some(false) });
    later.send(ROBOT, &crate::map_support::camera_item(7)).unwrap();
    assert!(!is_rest(&later.map), "it has an item that the target has not");
    // Made later, under the same name.
    let mut parts = source.to_parts();
    parts.create_time_ns += 1;
    assert!(!is_rest(&Map::from_parts(parts).unwrap()));
}

#[test]
fn poses_that_overflow_in_the_target_s_frame_are_refused() {
    let target = street(2, MapPolicy::default()).map;
    let mut source = other("helper");
    let far = Se3::new(So3::identity(), Vector3::new(1.7e308, 0.0, 0.0));
    let keyframe = Item::Keyframe {
        id: 99,
        capture_time_ns: 99,
        camera: None,
        world_from_camera: far,
        odom_from_camera: None,
        observations: Vec::new(),
        landmarks: Vec::new(),
        global_descriptor: None,
    };
    source.send(ROBOT, &keyframe).unwrap();
    let merge = |pose, links: &[Link]| {
        target.merge_of(("b", &source.map), pose, &renamed(), links).map(drop)
    };
    assert_eq!(merge(Se3::identity(), &[]), Ok(()));
    assert_eq!(merge(far, &[]), Err(MergeError::OutOfRange));
    let infinite = Se3::new(So3::identity(), Vector3::new(f64::INFINITY, 0.0, 0.0));
    let link = Link { target_from_source: infinite, ..link() };
    assert_eq!(merge(Se3::identity(), &[link]), Err(MergeError::OutOfRange));
}

#[test]
fn a_constraint_that_an_undo_drops_leaves_no_digest() {
    let (mut target, _) = merged();
    let helper = target.map.client_named("robot-b").unwrap();
    let mut across = relative_pose(60, ConstraintKind::LoopClosure, 0, 0, pose_at(1.0));
    if let Item::RelativePose { keyframe_j, .. } = &mut across {
        *keyframe_j = EntityRef { client: Some("robot".to_owned()), id: 1 };
    }
    let change = target.map.check(helper, &across).unwrap();
    target.push(change);
    assert!(target.map.constraints().contains_key(&EntityId::new(helper, 60)));
    let out = target.map.taken_out("floor-2").unwrap().unwrap();
    is_whole(&out);
    assert!(!out.constraints().contains_key(&id(60)));
}

#[test]
fn a_landmark_that_is_taken_out_moves_with_a_keyframe_that_is_taken_out() {
    let (mut target, _) = merged();
    let seen = |client: &str, id: i64| EntityRef { client: Some(client.to_owned()), id };
    let item = Item::Observations {
        keyframe: EntityRef::own(0),
        observations: vec![ItemObservation {
            landmark: seen("robot-b", 15),
            pixel: crate::map_support::pixel(5.0, 5.0),
            sigma_px: 1.0,
            depth: None,
            descriptor: None,
        }],
    };
    target.send(ROBOT, &item).unwrap();
    let landmark = moved(id(15));
    let reference = |map: &Map, id| map.landmarks().get(&id).unwrap().reference;
    let first = reference(&target.map, landmark).unwrap();
    target.push(Change::KeyframeRemoved { keyframe: first });
    assert_eq!(reference(&target.map, landmark), Some(id(0)), "the lowest one stays here");
    let out = target.map.taken_out("floor-2").unwrap().unwrap();
    is_whole(&out);
    assert!(reference(&out, id(15)).is_some());
}

#[test]
fn a_map_that_left_does_not_leave_again_with_another_one() {
    let (middle, _) = merged();
    let mut outer = Journal::new(MapPolicy::default());
    let names = BTreeMap::from([("robot".to_owned(), "robot-a".to_owned())]);
    let merge = outer.map.merge_of(("floor-1", &middle.map), Se3::identity(), &names, &[]).unwrap();
    outer.push(Change::MapMerged { merge: Box::new(merge) });
    let inner = outer.map.taken_out("floor-2").unwrap().unwrap();
    outer.push(Change::MapTakenOut { name: "floor-2".to_owned(), clients_leave: true });
    let [floor] = outer.map.merged() else { panic!() };
    assert_eq!(floor.clients.len(), 1, "{floor:?}");
    // A map without clients leaves with no other.
    let (policy, display_name) = (MapPolicy::default(), String::new());
    let change = Change::Created { policy, create_time_ns: 5, display_name };
    let mut empty = Map::new();
    empty.apply(&Event { revision: 1, time_ns: 0, cause: None, change }).unwrap();
    let merge = outer.map.merge_of(("empty", &empty), Se3::identity(), &BTreeMap::new(), &[]);
    outer.push(Change::MapMerged { merge: Box::new(merge.unwrap()) });
    let merge = outer.map.merge_of(("floor-2", &inner), Se3::identity(), &renamed(), &[]).unwrap();
    outer.push(Change::MapMerged { merge: Box::new(merge) });
    let out = outer.map.taken_out("floor-1").unwrap().unwrap();
    assert_eq!((out.clients().len(), out.merged().len()), (1, 0));
    outer.push(Change::MapTakenOut { name: "floor-1".to_owned(), clients_leave: true });
    let left = |map: &Map| map.merged().iter().map(|m| m.name.clone()).collect::<Vec<_>>();
    assert_eq!(left(&outer.map), ["empty", "floor-2"]);
    outer.push(Change::MapTakenOut { name: "floor-2".to_owned(), clients_leave: true });
    assert_eq!(left(&outer.map), ["empty"]);
}

/// What was measured in the frame of one place on the Earth is there in both maps.
#[test]
fn priors_of_one_anchor_stay_where_they_are() {
    let geodetic_anchor = Some(covis_solvers::geometry::Geodetic {
        latitude_deg: 48.0,
        longitude_deg: 9.0,
        height_m: 400.0,
    });
    let policy = MapPolicy { geodetic_anchor, ..MapPolicy::default() };
    let mut target = street(2, policy);
    let mut source = street(2, policy);
    source.send(ROBOT, &fix(8, 1, Vector3::new(1.0, 2.0, 3.0))).unwrap();
    let pose = target_from_source();
    let merge = target.map.merge_of(("b", &source.map), pose, &renamed(), &[]).unwrap();
    target.push(Change::MapMerged { merge: Box::new(merge) });
    let prior = |map: &Map, id| match map.priors().get(&id).unwrap() {
        Prior::Position { position_in_world, .. } => *position_in_world,
        Prior::Pose { .. } => panic!(),
    };
    assert_eq!(prior(&target.map, moved(id(8))), Vector3::new(1.0, 2.0, 3.0));
    let out = target.map.taken_out("b").unwrap().unwrap();
    assert_eq!(prior(&out, id(8)), Vector3::new(1.0, 2.0, 3.0));
    // Of another anchor it has no place here, also where the target has none of its own.
    let other = street(
        2,
        MapPolicy {
            geodetic_anchor: geodetic_anchor
                .map(|anchor| covis_solvers::geometry::Geodetic { height_m: 0.0, ..anchor }),
            ..MapPolicy::default()
        },
    );
    let error = other.map.merge_of(("b", &source.map), pose, &renamed(), &[]);
    assert_eq!(error.unwrap_err(), MergeError::Anchors);
}

#[test]
fn an_event_of_a_merge_that_does_not_fit_changes_nothing() {
    let (mut target, source) = merged();
    let before = target.map.clone();
    let merge = street(1, MapPolicy::default())
        .map
        .merge_of(("floor-2", &source), Se3::identity(), &renamed(), &[])
        .unwrap();
    // Its clients are in the map already.
    let change = Change::MapMerged { merge: Box::new(merge) };
    let event = Event { revision: before.revision() + 1, time_ns: 0, cause: None, change };
    assert!(target.map.apply(&event).is_err());
    let change = Change::MapTakenOut { name: "floor-3".to_owned(), clients_leave: true };
    assert!(target.map.apply(&Event { change, ..event }).is_err());
    assert_eq!(target.map, before);
    assert!(MapParts::default().merged.is_empty());
}

#[test]
fn a_merge_that_takes_an_earlier_one_out_of_range_is_refused() {
    let far = |x| Se3::new(So3::identity(), Vector3::new(x, 0.0, 0.0));
    // The inner map has nothing whose place could overflow.
    let inner = Journal::new(MapPolicy::default()).map;
    let mut middle = Map::new();
    let policy = MapPolicy::default();
    let created = Change::Created { policy, create_time_ns: 2, display_name: String::new() };
    middle.apply(&Event { revision: 1, time_ns: 0, cause: None, change: created }).unwrap();
    let merge = middle.merge_of(("inner", &inner), far(1e308), &BTreeMap::new(), &[]).unwrap();
    let change = Change::MapMerged { merge: Box::new(merge) };
    middle.apply(&Event { revision: 2, time_ns: 0, cause: None, change }).unwrap();
    let target = street(4, MapPolicy::default()).map;
    let refused = target.merge_of(("middle", &middle), far(1e308), &renamed(), &[]);
    assert_eq!(refused.unwrap_err(), MergeError::OutOfRange);
    target.merge_of(("middle", &middle), far(-1e308), &renamed(), &[]).unwrap();
}
