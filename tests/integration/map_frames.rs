//! Start estimates of a frame that the map has left: after a large correction a robot's next keyframes
//! still come as if there had been none.

use covis::map::{
    AppliedSolve, Change, EntityRef, Gauge, Item, ItemLandmark, Map, MapPolicy, SolveKind, applied,
    graph_problem,
};
use covis_solvers::geometry::{LieGroup, Se3, So3};
use nalgebra::Vector3;

use crate::map_support::{
    Journal, ROBOT, corner, id, observe, pose_at, pose_error, street, street_keyframe,
};

/// Another robot's frame lies here.
fn moved_to() -> Se3 {
    let turn = So3::from_quaternion_xyzw(0.0, 0.0, 0.5_f64.sqrt(), 0.5_f64.sqrt()).unwrap();
    Se3::new(turn, Vector3::new(20.0, 5.0, 1.0))
}

/// A street all of which a pose graph has moved far.
fn corrected() -> Journal {
    let mut journal = street(4, MapPolicy::default());
    let solve = AppliedSolve {
        kind: SolveKind::PoseGraph,
        poses: (0..4).map(|k| (id(k), moved_to().compose(&pose_at(k as f64)))).collect(),
        landmarks: journal
            .map
            .landmarks()
            .keys()
            .map(|&id| (id, moved_to().transform(&corner(id.id))))
            .collect(),
        cameras: Vec::new(),
        switched_off: Vec::new(),
        switched_on: Vec::new(),
        closure_variances: Vec::new(),
        left_frames: vec![(ROBOT, Se3::identity())],
        covered: Vec::new(),
        initial_cost: 1.0,
        final_cost: 0.0,
    };
    journal.push(Change::SolveApplied { solve });
    journal
}

/// The next keyframe of the street, seen from where it is, as a robot sends it that holds its frame to lie
/// at `frame`.
fn next(known: &Map, frame: &Se3, has_odometry: bool) -> Item {
    let mut item = street_keyframe(4, frame.compose(&pose_at(4.0)), known);
    if let Item::Keyframe { odom_from_camera, landmarks, .. } = &mut item {
        *odom_from_camera = has_odometry.then(|| pose_at(4.0));
        for landmark in landmarks {
            landmark.position = landmark.position.map(|point| frame.transform(&point));
        }
    }
    item
}

#[test]
fn a_keyframe_of_the_frame_before_a_large_correction_comes_to_where_it_belongs() {
    for (frame, has_odometry) in [
        (Se3::identity(), true),
        (moved_to(), true),
        // Without odometry of its own the sent pose stands for it.
        (Se3::identity(), false),
        (moved_to(), false),
    ] {
        let mut journal = corrected();
        let item = next(&journal.map, &frame, has_odometry);
        journal.send(ROBOT, &item).unwrap();
        let map = &journal.map;
        let expected = moved_to().compose(&pose_at(4.0));
        let keyframe = map.keyframes().get(&id(4)).unwrap();
        assert!(pose_error(&keyframe.world_from_camera, &expected) < 1e-9, "{keyframe:?}");
        let sent = if has_odometry { pose_at(4.0) } else { frame.compose(&pose_at(4.0)) };
        assert_eq!(keyframe.odom_from_camera, sent);
        // What it brings along comes with it.
        for landmark in keyframe.observations.iter().map(|seen| seen.landmark) {
            let position = map.landmarks().get(&landmark).unwrap().position.unwrap();
            let expected = moved_to().transform(&corner(landmark.id));
            assert!((position - expected).norm() < 1e-9, "{landmark:?}");
        }
        // As it was sent it is known.
        assert!(map.holds(ROBOT, &item));
        assert_eq!(Map::replay(journal.events.iter()).unwrap(), *map);
        assert_eq!(Map::from_parts(map.to_parts()).unwrap(), *map);
        map.check_sound().unwrap();
    }
}

#[test]
fn a_landmark_that_is_sent_again_need_not_be_in_the_new_frame() {
    let mut journal = corrected();
    let item = next(&journal.map, &Se3::identity(), true);
    journal.send(ROBOT, &item).unwrap();
    let pose = pose_at(5.0);
    // Landmark 55 came with the last keyframe; the robot sends what it sent.
    let again = Item::Keyframe {
        id: 5,
        capture_time_ns: 5_000_000,
        camera: Some(EntityRef::own(0)),
        world_from_camera: pose,
        odom_from_camera: Some(pose),
        observations: vec![observe(55, &pose, &corner(55))],
        landmarks: vec![ItemLandmark { id: 55, position: Some(corner(55)) }],
        global_descriptor: None,
    };
    journal.send(ROBOT, &again).unwrap();
    let expected = moved_to().compose(&pose);
    let keyframe = journal.map.keyframes().get(&id(5)).unwrap();
    assert!(pose_error(&keyframe.world_from_camera, &expected) < 1e-9);
}

#[test]
fn small_corrections_leave_start_estimates_as_they_are_sent() {
    let journal = street(4, MapPolicy::default());
    for (shift, leaves) in [(0.3, false), (0.8, true)] {
        let mut problem = graph_problem(&journal.map, Gauge::default(), |_, _| None);
        for pose in &mut problem.graph.poses {
            *pose = Se3::new(So3::identity(), Vector3::new(0.0, shift, 0.0)).compose(pose);
        }
        let costs = (1.0, 0.0);
        let solve = applied(&journal.map, &problem, SolveKind::PoseGraph, Vec::new(), costs);
        assert_eq!(solve.left_frames.len(), usize::from(leaves), "{shift} m");
    }
}
