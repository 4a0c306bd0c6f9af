//! Edits of a map: what they name is checked, and what they change stays consistent.

#![allow(clippy::unwrap_used, reason = "helpers of tests fail by panicking")]

use std::collections::BTreeSet;

use covis::map::{
    CameraEntity, Change, ConstraintKind, Edit, EntityId, EntityRef, Item, ItemLandmark, Map,
    MapPolicy, Reason, Sighting,
};
use covis_solvers::geometry::{Camera, KannalaBrandt, PinholeRadialTangential, Snavely};
use covis_solvers::testing::random::seeded;
use rand::RngExt as _;

use crate::map_fold::assert_consistent;
use crate::map_support::{
    Journal, ROBOT, corner, id, landmark, loop_problem, observe, pinhole, pose_at, relative_pose,
    street, street_keyframe,
};

pub(crate) fn own(ids: impl IntoIterator<Item = i64>) -> Vec<EntityRef> {
    ids.into_iter().map(EntityRef::own).collect()
}

pub(crate) fn sighting(keyframe: i64, landmark: i64) -> Sighting {
    Sighting { keyframe: EntityRef::own(keyframe), landmark: EntityRef::own(landmark) }
}

pub(crate) fn remove_keyframe(id: i64) -> Edit {
    Edit::RemoveKeyframe { keyframe: EntityRef::own(id) }
}

pub(crate) fn fuse(kept: i64, absorbed: impl IntoIterator<Item = i64>) -> Edit {
    Edit::FuseLandmarks { kept: EntityRef::own(kept), absorbed: own(absorbed) }
}

pub(crate) fn set_camera(camera: Camera) -> Edit {
    let camera = CameraEntity { camera, width_px: 640, height_px: 480 };
    Edit::SetCamera { id: EntityRef::own(0), camera }
}

pub(crate) fn revoke(id: i64) -> Edit {
    Edit::RevokeConstraint { constraint: EntityRef::own(id) }
}

pub(crate) fn send(journal: &mut Journal, edit: Edit) {
    journal.send(ROBOT, &Item::Edit(edit)).unwrap();
}

/// Asserts that an edit is refused for exactly these fields.
fn check(journal: &Journal, edit: Edit, expected: &[(&str, Reason)]) {
    let rejection = journal.map.check(ROBOT, &Item::Edit(edit)).unwrap_err();
    let found: Vec<_> = rejection.violations.iter().map(|v| (v.field.as_str(), v.reason)).collect();
    assert_eq!(found, expected, "{rejection}");
    assert!(rejection.violations.iter().all(|v| !v.description.is_empty()));
}

#[test]
fn each_part_of_an_edit_that_does_not_fit_is_named() {
    let journal = street(4, MapPolicy::default());
    let unknown = Reason::UnknownReference;
    check(&journal, revoke(1), &[("revoke_constraint.constraint", unknown)]);
    check(&journal, remove_keyframe(9), &[("remove_keyframe.keyframe", unknown)]);
    let ghost = EntityRef { client: Some("ghost".to_owned()), id: 1 };
    check(
        &journal,
        Edit::RemoveKeyframe { keyframe: ghost.clone() },
        &[("remove_keyframe.keyframe", unknown)],
    );
    let path = "remove_observations.observations";
    check(
        &journal,
        Edit::RemoveObservations { observations: Vec::new() },
        &[(path, Reason::Missing)],
    );
    let observations =
        vec![sighting(1, 10), sighting(9, 10), sighting(1, 999), sighting(0, 45), sighting(1, 10)];
    check(
        &journal,
        Edit::RemoveObservations { observations },
        &[
            ("remove_observations.observations[1].keyframe", unknown),
            ("remove_observations.observations[2].landmark", unknown),
            // Both are there, but keyframe 0 does not see that landmark.
            ("remove_observations.observations[3]", unknown),
            ("remove_observations.observations[4]", Reason::Duplicate),
        ],
    );
    check(
        &journal,
        fuse(999, [1, 1, 998]),
        &[
            ("fuse_landmarks.kept", unknown),
            ("fuse_landmarks.absorbed[2]", unknown),
            ("fuse_landmarks.absorbed[1]", Reason::Duplicate),
        ],
    );
    check(&journal, fuse(1, [2, 1]), &[("fuse_landmarks.absorbed[1]", Reason::Inconsistent)]);
    check(&journal, fuse(1, []), &[("fuse_landmarks.absorbed", Reason::Missing)]);
    let landmarks = vec![EntityRef::own(1), ghost, EntityRef::own(1)];
    check(
        &journal,
        Edit::RemoveLandmarks { landmarks },
        &[
            ("remove_landmarks.landmarks[1]", unknown),
            ("remove_landmarks.landmarks[2]", Reason::Duplicate),
        ],
    );
    let camera = CameraEntity { camera: pinhole(), width_px: 640, height_px: 480 };
    check(
        &journal,
        Edit::SetCamera { id: EntityRef::own(5), camera },
        &[("set_camera.id", unknown)],
    );
}

#[test]
fn a_new_camera_must_project_what_the_old_one_projects() {
    let mut journal = street(3, MapPolicy::default());
    // Distortion of this size overflows for points off the axis.
    let absurd = Camera::Pinhole(PinholeRadialTangential {
        fx: 500.0,
        fy: 500.0,
        cx: 320.0,
        cy: 240.0,
        k1: f64::MAX,
        k2: f64::MAX,
        p1: 0.0,
        p2: 0.0,
        k3: f64::MAX,
    });
    let rejection = journal.map.check(ROBOT, &Item::Edit(set_camera(absurd))).unwrap_err();
    let first = &rejection.violations[0];
    assert_eq!(
        (&first.field[..], first.reason, rejection.violations.len()),
        ("set_camera.model", Reason::ProjectionNotFinite, 1)
    );
    assert!(first.description.contains("keyframe 0 of client \"robot\""), "{first:?}");
    let small = CameraEntity { camera: pinhole(), width_px: 640, height_px: 16 };
    check(
        &journal,
        Edit::SetCamera { id: EntityRef::own(0), camera: small },
        &[("set_camera.height_px", Reason::Inconsistent)],
    );
    let before = journal.map.keyframes().clone();
    for camera in [
        Camera::Fisheye(KannalaBrandt {
            fx: 400.0,
            fy: 400.0,
            cx: 320.0,
            cy: 240.0,
            k1: 0.0,
            k2: 0.0,
            k3: 0.0,
            k4: 0.0,
        }),
        Camera::Snavely(Snavely { focal: 500.0, k1: 0.0, k2: 0.0 }),
    ] {
        send(&mut journal, set_camera(camera));
        assert_eq!(journal.map.cameras()[&id(0)].camera, camera);
        assert!(journal.map.holds(ROBOT, &Item::Edit(set_camera(camera))), "it is so already");
    }
    assert_eq!(journal.map.keyframes(), &before);
    // The camera as it was added is still recognized, and another one is still refused.
    let added = crate::map_support::camera_item(0);
    assert!(journal.map.holds(ROBOT, &added));
    assert!(!journal.map.holds(ROBOT, &Item::Edit(set_camera(pinhole()))));
    let other = Item::Camera { id: 0, camera: absurd, width_px: 640, height_px: 480 };
    assert!(!journal.map.holds(ROBOT, &other));
}

#[test]
fn an_edit_may_name_entities_of_another_client() {
    let mut journal = street(3, MapPolicy::default());
    journal.send(ROBOT, &relative_pose(4, ConstraintKind::Odometry, 0, 1, pose_at(1.0))).unwrap();
    journal.push(Change::ClientOpened { name: "editor".to_owned(), epoch: 1 });
    let editor = journal.map.client_named("editor").unwrap();
    let of = |id| EntityRef { client: Some("robot".to_owned()), id };
    let edits = [
        Edit::RevokeConstraint { constraint: of(4) },
        Edit::RemoveObservations {
            observations: vec![Sighting { keyframe: of(1), landmark: of(10) }],
        },
        Edit::FuseLandmarks { kept: of(1), absorbed: vec![of(2)] },
        Edit::RemoveLandmarks { landmarks: vec![of(3)] },
        Edit::RemoveKeyframe { keyframe: of(2) },
        Edit::SetCamera {
            id: of(0),
            camera: CameraEntity { camera: pinhole(), width_px: 800, height_px: 600 },
        },
    ];
    for edit in edits {
        // Without the client it would be the editor's own, which does not exist.
        journal.send(editor, &Item::Edit(edit)).unwrap();
        assert_consistent(&journal.map);
    }
    assert!(journal.map.constraints().is_empty());
    assert_eq!(journal.map.keyframes().len(), 2);
    assert!(journal.map.check(editor, &Item::Edit(remove_keyframe(1))).is_err());
}

#[test]
fn fused_landmarks_have_one_observation_a_keyframe_and_the_first_position() {
    let mut journal = Journal::new(MapPolicy::default());
    let unplaced = |id| ItemLandmark { id, position: None };
    let landmarks = vec![unplaced(0), unplaced(1), landmark(2), landmark(3)];
    journal.send(ROBOT, &Item::Landmarks { landmarks }).unwrap();
    let see = |journal: &mut Journal, keyframe: i64, seen: &[i64]| {
        let pose = pose_at(0.0);
        let item = Item::Keyframe {
            id: keyframe,
            capture_time_ns: keyframe,
            camera: Some(EntityRef::own(0)),
            world_from_camera: pose,
            odom_from_camera: None,
            observations: seen.iter().map(|&k| observe(k, &pose, &corner(k))).collect(),
            landmarks: Vec::new(),
            global_descriptor: None,
        };
        journal.send(ROBOT, &item).unwrap();
    };
    see(&mut journal, 5, &[3]);
    see(&mut journal, 1, &[3, 2]);
    see(&mut journal, 2, &[1, 2, 3]);
    see(&mut journal, 3, &[0, 3]);
    see(&mut journal, 4, &[1]);
    let before = journal.map.usage();
    send(&mut journal, fuse(0, [1, 3, 2]));
    let pixel = |keyframe| {
        let seen = &journal.map.keyframes().get(&id(keyframe)).unwrap().observations;
        assert_eq!((seen.len(), seen[0].landmark), (1, id(0)), "keyframe {keyframe}");
        seen[0].pixel
    };
    let of = |k: i64| observe(k, &pose_at(0.0), &corner(k)).pixel;
    // Its own observation stays; else the first of 1, 3, 2.
    assert_eq!(pixel(3), of(0));
    assert_eq!([pixel(1), pixel(2), pixel(4), pixel(5)], [of(3), of(1), of(1), of(3)]);
    let kept = journal.map.landmarks().get(&id(0)).unwrap();
    assert_eq!(kept.position, Some(corner(3)), "the first that has one");
    assert_eq!(kept.positioned_revision, journal.map.revision());
    assert_eq!((kept.sent_position, kept.reference), (None, Some(id(3))));
    assert_eq!(journal.map.landmarks().len(), 1);
    assert!(journal.map.usage().observations < before.observations);
    assert_consistent(&journal.map);
    // A landmark that nobody saw takes over the reference of the first absorbed one.
    journal.send(ROBOT, &Item::Landmarks { landmarks: vec![landmark(9)] }).unwrap();
    send(&mut journal, fuse(9, [0]));
    let kept = journal.map.landmarks().get(&id(9)).unwrap();
    assert_eq!((kept.reference, kept.position), (Some(id(3)), Some(corner(9))));
    assert_consistent(&journal.map);
}

#[test]
fn what_was_removed_is_free_to_be_sent_again() {
    let mut journal = street(3, MapPolicy::default());
    let fresh = journal.map.clone();
    let closure = relative_pose(7, ConstraintKind::LoopClosure, 0, 2, pose_at(2.0));
    journal.send(ROBOT, &closure).unwrap();
    send(&mut journal, revoke(7));
    assert!(!journal.map.holds(ROBOT, &closure));
    check(&journal, revoke(7), &[("revoke_constraint.constraint", Reason::UnknownReference)]);
    journal.send(ROBOT, &relative_pose(7, ConstraintKind::Other, 0, 1, pose_at(1.0))).unwrap();

    let again = street_keyframe(2, pose_at(2.5), &fresh);
    assert!(journal.map.check(ROBOT, &again).is_err(), "another content while it is there");
    send(&mut journal, remove_keyframe(2));
    journal.send(ROBOT, &again).unwrap();
    assert_eq!(journal.map.keyframes().get(&id(2)).unwrap().world_from_camera, pose_at(2.5));

    let landmarks = vec![ItemLandmark { id: 5, position: Some(corner(6)) }];
    let other = Item::Landmarks { landmarks };
    assert!(journal.map.check(ROBOT, &other).is_err());
    send(&mut journal, Edit::RemoveLandmarks { landmarks: own([5]) });
    journal.send(ROBOT, &other).unwrap();
    assert_consistent(&journal.map);
}

#[test]
fn every_keyframe_may_go_and_takes_its_memory_along() {
    let mut journal = street(6, MapPolicy::default());
    journal.send(ROBOT, &relative_pose(1, ConstraintKind::Odometry, 4, 5, pose_at(1.0))).unwrap();
    let mut bytes = journal.map.usage().bytes;
    for keyframe in [3, 0, 5, 1, 4, 2] {
        send(&mut journal, remove_keyframe(keyframe));
        assert_consistent(&journal.map);
        let now = journal.map.usage().bytes;
        assert!(now < bytes, "keyframe {keyframe}: {bytes} to {now}");
        bytes = now;
    }
    let usage = journal.map.usage();
    assert_eq!((usage.keyframes, usage.observations, usage.constraints), (0, 0, 0));
    assert!(usage.landmarks > 0, "they stay");
    let all: Vec<i64> = journal.map.landmarks().keys().map(|id| id.id).collect();
    send(&mut journal, Edit::RemoveLandmarks { landmarks: own(all) });
    assert!(journal.map.landmarks().is_empty() && journal.map.usage().bytes < bytes);
    assert!(!loop_problem(&journal.map, |_, _| None).is_solvable());
    journal.send(ROBOT, &street_keyframe(0, pose_at(0.0), &Map::new())).unwrap();
    assert_consistent(&journal.map);
}

/// A random edit that the map takes.
fn edit(map: &Map, rng: &mut impl rand::Rng) -> Option<Edit> {
    let pick = |rng: &mut dyn rand::Rng, ids: &[EntityId]| -> Option<i64> {
        (!ids.is_empty()).then(|| ids[rng.random_range(0..ids.len())].id)
    };
    let keyframes: Vec<EntityId> = map.keyframes().keys().copied().collect();
    let landmarks: Vec<EntityId> = map.landmarks().keys().copied().collect();
    let some = |rng: &mut dyn rand::Rng| -> BTreeSet<i64> {
        let count = rng.random_range(1..6);
        (0..count).filter_map(|_| pick(rng, &landmarks)).collect()
    };
    Some(match rng.random_range(0..6) {
        0 if keyframes.len() > 3 => remove_keyframe(pick(rng, &keyframes)?),
        1 => {
            let mut absorbed = some(rng);
            let kept = absorbed.pop_first()?;
            if absorbed.is_empty() {
                return None;
            }
            fuse(kept, absorbed.into_iter().rev())
        }
        2 => Edit::RemoveLandmarks { landmarks: own(some(rng)) },
        3 => {
            let constraints = map.constraints().keys().chain(map.priors().keys());
            revoke(pick(rng, &constraints.copied().collect::<Vec<_>>())?)
        }
        4 => {
            let focal = rng.random_range(300.0..600.0);
            set_camera(Camera::Snavely(Snavely { focal, k1: 0.0, k2: 0.0 }))
        }
        _ => {
            let mut named = BTreeSet::new();
            for _ in 0..rng.random_range(1..8) {
                let keyframe = pick(rng, &keyframes)?;
                let seen = &map.keyframes().get(&id(keyframe))?.observations;
                if !seen.is_empty() {
                    named.insert((keyframe, seen[rng.random_range(0..seen.len())].landmark.id));
                }
            }
            let observations: Vec<_> = named.into_iter().map(|(k, l)| sighting(k, l)).collect();
            if observations.is_empty() {
                return None;
            }
            Edit::RemoveObservations { observations }
        }
    })
}

#[test]
fn after_random_edits_everything_that_is_kept_is_as_from_scratch() {
    let mut taken = [0; 6];
    for seed in 0..6 {
        let mut rng = seeded(100 + seed);
        let mut journal = street(8, MapPolicy::default());
        // A landmark that more keyframes see than count for each other.
        let landmarks = vec![ItemLandmark { id: 500, position: Some(corner(0)) }];
        journal.send(ROBOT, &Item::Landmarks { landmarks }).unwrap();
        let mut next = 8;
        for n in 0..160 {
            if rng.random_range(0..2) == 0 {
                let pose = pose_at(0.0);
                let seen: BTreeSet<i64> = (0..6).map(|_| rng.random_range(0..60)).collect();
                let known = |k: &i64| journal.map.landmarks().contains_key(&id(*k));
                let seen: Vec<i64> = seen.into_iter().chain([500]).filter(known).collect();
                let item = Item::Keyframe {
                    id: next,
                    capture_time_ns: next,
                    camera: Some(EntityRef::own(0)),
                    world_from_camera: pose,
                    odom_from_camera: None,
                    observations: seen
                        .iter()
                        .map(|&k| observe(k, &pose, &corner(k % 500)))
                        .collect(),
                    landmarks: Vec::new(),
                    global_descriptor: None,
                };
                journal.send(ROBOT, &item).unwrap();
                next += 1;
                let (i, kind) = (n % 5, ConstraintKind::LoopClosure);
                if journal.map.keyframes().contains_key(&id(i)) {
                    let item = relative_pose(n, kind, i, next - 1, pose_at(1.0));
                    journal.send(ROBOT, &item).unwrap();
                }
            } else if let Some(edit) = edit(&journal.map, &mut rng) {
                taken[match &edit {
                    Edit::RevokeConstraint { .. } => 0,
                    Edit::RemoveObservations { .. } => 1,
                    Edit::FuseLandmarks { .. } => 2,
                    Edit::RemoveLandmarks { .. } => 3,
                    Edit::RemoveKeyframe { .. } => 4,
                    Edit::SetCamera { .. } => 5,
                }] += 1;
                send(&mut journal, edit);
            }
            assert_consistent(&journal.map);
        }
        assert_eq!(Map::from_parts(journal.map.to_parts()).unwrap(), journal.map, "seed {seed}");
        let replayed = Map::replay(journal.events.iter()).unwrap();
        assert_eq!(replayed, journal.map, "seed {seed}");
        assert_eq!(replayed.state_hash(), journal.map.state_hash(), "seed {seed}");
    }
    assert!(taken.iter().all(|&count| count > 5), "of each kind some: {taken:?}");
}
