//! What a map remembers of the items that a client sent: their sequences, digests and content.

use covis::map::{AppliedSolve, Change, Item, ItemLandmark, MapPolicy, Recall, SolveKind};
use nalgebra::Vector3;

use crate::map_support::{
    Journal, ROBOT, camera_item, corner, id, pose_at, solve_of, street, street_keyframe,
};

#[test]
fn items_are_recalled_by_sequence_and_digest() {
    let mut journal = street(2, MapPolicy::default());
    assert_eq!(journal.map.client(ROBOT).unwrap().next_sequence, 4);
    assert_eq!(journal.map.recall(ROBOT, 2, &[2; 32]), Recall::Duplicate);
    assert_eq!(journal.map.recall(ROBOT, 2, &[3; 32]), Recall::Conflict);
    assert_eq!(journal.map.recall(ROBOT, 4, &[4; 32]), Recall::New);
    // A newer epoch keeps what older ones journaled.
    journal.push(Change::ClientOpened { name: "robot".to_owned(), epoch: 7 });
    assert_eq!(journal.map.recall(ROBOT, 2, &[2; 32]), Recall::Duplicate);
    assert_eq!(journal.map.clients().len(), 1);
    assert_eq!(journal.map.client(ROBOT).unwrap().epoch, 7);
    assert_eq!(journal.map.client(ROBOT).unwrap().next_sequence, 4);
}

#[test]
fn what_a_client_sent_is_held_past_optimization() {
    let mut journal = street(2, MapPolicy::default());
    let fresh = Journal::new(MapPolicy::default());
    let first = street_keyframe(0, pose_at(0.0), &fresh.map);
    let solve = AppliedSolve {
        poses: vec![(id(0), pose_at(0.25))],
        landmarks: vec![(id(3), Vector3::new(1.0, 2.0, 3.0))],
        cameras: vec![(
            id(0),
            covis_solvers::geometry::Camera::Snavely(covis_solvers::geometry::Snavely {
                focal: 400.0,
                k1: 0.0,
                k2: 0.0,
            }),
        )],
        covered: vec![(ROBOT, 3)],
        ..solve_of(SolveKind::Global)
    };
    journal.push(Change::SolveApplied { solve });
    assert_eq!(journal.map.client(ROBOT).unwrap().optimized_sequence, 3);
    assert!(journal.map.holds(ROBOT, &first));
    assert!(journal.map.check(ROBOT, &first).is_err());
    assert!(journal.map.holds(ROBOT, &camera_item(0)));
    let landmarks = vec![ItemLandmark { id: 3, position: Some(corner(3)) }];
    assert!(journal.map.holds(ROBOT, &Item::Landmarks { landmarks }));
    // The same keyframe from another start pose is another content.
    let other = street_keyframe(0, pose_at(0.25), &fresh.map);
    assert!(!journal.map.holds(ROBOT, &other));
    assert!(!journal.map.holds(ROBOT, &street_keyframe(5, pose_at(5.0), &fresh.map)));
}
