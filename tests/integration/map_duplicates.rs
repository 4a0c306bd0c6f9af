//! Landmarks that are one point: found where a closure joins two places, one variable of bundle
//! adjustment, and apart again once the closure does not count.

#![allow(clippy::unwrap_used, reason = "helpers of tests fail by panicking")]

use std::collections::BTreeSet;

use covis::map::{
    Change, Comparison, ConstraintKind, Edit, EntityId, EntityRef, GlobalOptions, GraphPairs, Item,
    ItemLandmark, ItemObservation, Map, MapPolicy, Reach, SolveKind, Solved, WhenFull, applied,
    find_duplicates, global_problem, retire,
};
use covis_solvers::interrupt::Interrupt;
use nalgebra::Vector3;

use crate::map_fold::assert_consistent;
use crate::map_support::{
    Journal, ROBOT, corner, id, pose_at, relative_pose, street, street_keyframe, window_around,
};

/// Added to the ids of what is seen on the second visit.
pub(crate) const AGAIN: i64 = 1000;

/// A street of four keyframes that is walked twice: ids differ by [`AGAIN`] the second time, and where
/// the client places things by `off`. Closure 0 joins the keyframes 1 of both visits.
pub(crate) fn twice(off: f64) -> Journal {
    let policy = MapPolicy { when_full: WhenFull::Marginalize, ..MapPolicy::default() };
    let mut journal = street(4, policy);
    for index in 0..4 {
        let Item::Keyframe { observations, landmarks, camera, .. } =
            street_keyframe(index, pose_at(index as f64), &Map::new())
        else {
            unreachable!()
        };
        let again = |reference: &EntityRef| EntityRef::own(reference.id + AGAIN);
        let observations = observations
            .into_iter()
            .map(|seen| ItemObservation { landmark: again(&seen.landmark), ..seen });
        let place = |landmark: ItemLandmark| ItemLandmark {
            id: landmark.id + AGAIN,
            position: landmark.position.map(|position| position + Vector3::x() * off),
        };
        let known = journal.map.landmarks();
        let landmarks = landmarks.into_iter().map(place);
        let landmarks = landmarks.filter(|landmark| !known.contains_key(&id(landmark.id)));
        let item = Item::Keyframe {
            id: index + AGAIN,
            capture_time_ns: (index + AGAIN) * 1_000_000,
            camera,
            world_from_camera: pose_at(index as f64 + off),
            odom_from_camera: None,
            observations: observations.collect(),
            landmarks: landmarks.collect(),
            global_descriptor: None,
        };
        journal.send(ROBOT, &item).unwrap();
    }
    let closure = relative_pose(0, ConstraintKind::LoopClosure, 1, 1 + AGAIN, pose_at(0.0));
    journal.send(ROBOT, &closure).unwrap();
    journal
}

/// All pairs of the two visits.
fn pairs(map: &Map) -> Vec<(EntityId, EntityId)> {
    let first = map.landmarks().keys().filter(|landmark| landmark.id < AGAIN);
    first.map(|&landmark| (landmark, id(landmark.id + AGAIN))).collect()
}

/// The pairs of keyframes whose relative pose is measured.
fn measured_pairs(map: &Map) -> Vec<(EntityId, EntityId)> {
    GraphPairs::of(map).ids().collect()
}

/// Unites the landmarks of both visits.
pub(crate) fn found(journal: &mut Journal) {
    let comparison = Comparison { closure: id(0), pairs: pairs(&journal.map) };
    journal.push(Change::DuplicatesFound { comparisons: vec![comparison] });
}

#[test]
fn the_places_that_a_closure_joins_are_compared_by_position() {
    // Points are some decimeters apart and known to some centimeters.
    let journal = twice(0.01);
    let comparison = find_duplicates(&journal.map, id(0), &Interrupt::at(None)).unwrap();
    let right: BTreeSet<_> = pairs(&journal.map).into_iter().collect();
    assert!(comparison.pairs.len() >= 10, "{comparison:?}");
    assert!(comparison.pairs.iter().all(|pair| right.contains(pair)), "{comparison:?}");
}

#[test]
fn nothing_is_found_where_a_closure_joins_different_places() {
    let mut journal = twice(0.01);
    // It claims that the last keyframe of the first visit is where the second visit began.
    let closure = relative_pose(1, ConstraintKind::LoopClosure, 3, AGAIN, pose_at(0.0));
    journal.send(ROBOT, &closure).unwrap();
    let comparison = find_duplicates(&journal.map, id(1), &Interrupt::at(None)).unwrap();
    let right: BTreeSet<_> = pairs(&journal.map).into_iter().collect();
    assert!(comparison.pairs.iter().all(|pair| right.contains(pair)), "{comparison:?}");
    assert_eq!(
        find_duplicates(&journal.map, id(7), &Interrupt::at(None)),
        None,
        "there is no such closure"
    );
}

#[test]
fn duplicates_are_one_variable_and_close_covisibility() {
    let mut journal = twice(0.05);
    let options = GlobalOptions::default();
    let measured = measured_pairs(&journal.map);
    found(&mut journal);
    assert_consistent(&journal.map);
    let map = &journal.map;
    let mut joined = global_problem(map, &options);
    let count = pairs(map).len();
    assert_eq!((joined.landmarks.len(), joined.duplicates.len()), (count, count));
    // Also those that each visit saw once.
    assert_eq!(joined.problem.observation_count() as u64, map.observation_count());
    let constant = joined.problem.constant_poses.iter().filter(|&&constant| constant).count();
    assert_eq!(constant, 1, "the visits are one piece");
    assert_eq!(measured_pairs(map), measured, "relative poses are measured without them");
    let window = window_around(map, &[id(1)]);
    let all: Vec<EntityId> = window.free.iter().chain(&window.fixed).copied().collect();
    assert!(all.contains(&id(1 + AGAIN)), "{all:?}");
    assert!(window.landmarks.contains(&id(10 + AGAIN)));

    joined.problem.landmarks.iter_mut().for_each(|position| position.z += 0.5);
    let solve = applied(
        map,
        Solved::Bundle(&joined),
        SolveKind::Global,
        Vec::new(),
        (2.0, 1.0),
        Reach::All,
    );
    journal.push(Change::SolveApplied { solve });
    for (a, b) in pairs(&journal.map) {
        let position = |id: EntityId| journal.map.landmarks().get(&id).unwrap().position.unwrap();
        assert_eq!(position(a), position(b));
        let expected: Vector3<f64> = corner(a.id) + 0.5 * Vector3::z();
        assert!((position(a) - expected).norm() < 1e-12);
        assert_eq!(journal.map.duplicates().original_of(b), Some(a));
        assert_eq!(journal.map.duplicates().original_of(a), None);
    }
}

#[test]
fn what_a_revoked_closure_found_is_split_and_others_are_compared_again() {
    let mut journal = twice(0.0);
    let other = relative_pose(1, ConstraintKind::LoopClosure, 2, 2 + AGAIN, pose_at(0.0));
    journal.send(ROBOT, &other).unwrap();
    let comparisons =
        [0, 1].map(|closure| Comparison { closure: id(closure), pairs: pairs(&journal.map) });
    journal.push(Change::DuplicatesFound { comparisons: comparisons.into() });
    assert_eq!(journal.map.uncompared_closures().count(), 0);
    assert_eq!(journal.map.false_duplicates(), (Vec::new(), Vec::new()));

    let constraint = EntityRef::own(0);
    journal.send(ROBOT, &Item::Edit(Edit::RevokeConstraint { constraint })).unwrap();
    let (closures, landmarks) = journal.map.false_duplicates();
    assert_eq!(
        (closures.as_slice(), landmarks.len()),
        (&[id(0)][..], journal.map.landmarks().len())
    );
    journal.push(Change::DuplicatesSplit { closures, landmarks });
    assert_consistent(&journal.map);
    assert_eq!(journal.map.duplicates().len(), 0);
    assert_eq!(journal.map.uncompared_closures().collect::<Vec<_>>(), [id(1)]);
}

#[test]
fn duplicates_follow_edits_and_outlast_the_keyframes_of_their_closure() {
    let mut journal = twice(0.0);
    found(&mut journal);
    let all = journal.map.duplicates().len();
    let edits = [
        Edit::RemoveLandmarks { landmarks: vec![EntityRef::own(3)] },
        Edit::FuseLandmarks { kept: EntityRef::own(5), absorbed: vec![EntityRef::own(6)] },
    ];
    for edit in edits {
        journal.send(ROBOT, &Item::Edit(edit)).unwrap();
        assert_consistent(&journal.map);
    }
    let duplicates = journal.map.duplicates();
    assert_eq!(duplicates.len(), all - 1);
    assert!(!duplicates.has(id(3 + AGAIN)) && !duplicates.has(id(6)));
    assert_eq!(duplicates.group(id(6 + AGAIN)), [5, 5 + AGAIN, 6 + AGAIN].map(id));

    // The oldest go: after keyframe 0 that of the closure.
    while journal.map.keyframes().contains_key(&id(1)) {
        let retired = retire(&journal.map).unwrap();
        journal.push(Change::KeyframeRetired { retired });
        assert_consistent(&journal.map);
    }
    assert_eq!(journal.map.false_duplicates(), (Vec::new(), Vec::new()));
    assert!(journal.map.duplicates().has(id(20)), "keyframe 2 sees it");
}
