//! Start estimates of a frame that the map has left: after a large correction a robot's next keyframes
//! still come as if there had been none.

use covis::map::{
    AppliedSolve, Change, EntityRef, Gauge, Item, ItemLandmark, Map, MapPolicy, Reach, SolveKind,
    Solved, applied,
};
use covis_solvers::geometry::{LieGroup, Se3, So3};
use nalgebra::Vector3;

use crate::map_support::{
    Journal, ROBOT, corner, graph_problem, id, observe, pose_at, pose_error, solve_of, street,
    street_keyframe,
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
        poses: (0..4).map(|k| (id(k), moved_to().compose(&pose_at(k as f64)))).collect(),
        landmarks: journal
            .map
            .landmarks()
            .keys()
            .map(|&id| (id, moved_to().transform(&corner(id.id))))
            .collect(),
        left_frames: vec![(ROBOT, Se3::identity())],
        ..solve_of(SolveKind::PoseGraph)
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
fn a_start_estimate_that_the_odometry_does_not_lead_to_stays_as_it_was_sent() {
    let mut journal = corrected();
    // The robot began anew with its odometry, and knows the present frame. Its pose is nearer to what the
    // frame of before gives than to what the present one does.
    let world = moved_to().compose(&pose_at(4.0));
    let mut item = next(&journal.map, &moved_to(), true);
    if let Item::Keyframe { odom_from_camera, .. } = &mut item {
        *odom_from_camera =
            Some(Se3::new(world.rotation, world.translation + Vector3::new(2.0, 0.0, 0.0)));
    }
    journal.send(ROBOT, &item).unwrap();
    let keyframe = journal.map.keyframes().get(&id(4)).unwrap();
    assert!(pose_error(&keyframe.world_from_camera, &world) < 1e-9, "{keyframe:?}");
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
        let solve = applied(
            &journal.map,
            Solved::Graph(&problem),
            SolveKind::PoseGraph,
            Vec::new(),
            costs,
            Reach::All,
        );
        assert_eq!(solve.left_frames.len(), usize::from(leaves), "{shift} m");
    }
}

/// A frame that overflows is none: what it would move stays as it was sent, and the map takes it.
#[test]
fn frames_that_overflow_are_not_kept_and_move_nothing() {
    let at = |x: f64| Se3::new(So3::identity(), Vector3::new(x, 0.0, 0.0));
    let blind = |id: i64, world: Se3, odom: Se3, landmarks: Vec<ItemLandmark>| Item::Keyframe {
        id,
        capture_time_ns: id,
        camera: None,
        world_from_camera: world,
        odom_from_camera: Some(odom),
        observations: Vec::new(),
        landmarks,
        global_descriptor: None,
    };
    let mut journal = Journal::new(MapPolicy::default());
    for id in 0..2 {
        journal.send(ROBOT, &blind(id, at(1.7e308), at(-1.7e308), Vec::new())).unwrap();
    }
    let mut problem = graph_problem(&journal.map, Gauge::default(), |_, _| None);
    for pose in &mut problem.graph.poses {
        pose.translation.y += 10.0;
    }
    let solve = applied(
        &journal.map,
        Solved::Graph(&problem),
        SolveKind::PoseGraph,
        Vec::new(),
        (1.0, 0.0),
        Reach::All,
    );
    assert!(!solve.poses.is_empty() && solve.left_frames.is_empty(), "{solve:?}");
    journal.push(Change::SolveApplied { solve });
    // The landmark overflows where the keyframe would be moved.
    let mut journal = corrected();
    let far = Vector3::repeat(1.7e308);
    let landmarks = vec![ItemLandmark { id: 77, position: Some(far) }];
    journal.send(ROBOT, &blind(4, pose_at(4.0), pose_at(4.0), landmarks)).unwrap();
    assert_eq!(journal.map.landmarks().get(&id(77)).unwrap().position, Some(far));
    journal.map.check_sound().unwrap();
}

#[test]
fn the_newest_keyframe_is_the_latest_of_the_sixteen_that_arrived_last() {
    let mut journal = street(4, MapPolicy::default());
    // By capture time, then id, of all; but of those that arrived last where 16 came since that one.
    let expected = |map: &Map| {
        let own =
            || map.keyframes().iter().map(|(&id, k)| (k.capture_time_ns, id, k.added_revision));
        let latest = own().max().unwrap();
        let mut arrivals: Vec<i64> = own().map(|(.., revision)| revision).collect();
        arrivals.sort_unstable();
        if arrivals.iter().filter(|&&revision| revision > latest.2).count() < 16 {
            return latest.1;
        }
        let since = arrivals[arrivals.len() - 16];
        own().filter(|&(.., revision)| revision >= since).max().unwrap().1
    };
    // A time in the future, then a clock that goes on as it should, and goes back once.
    let times = (4..50_i64).map(|k| match k {
        6 => 1_000_000_000,
        30.. => k - 20,
        _ => k,
    });
    for (k, time_ms) in (4..).zip(times) {
        let mut item = street_keyframe(k, pose_at(k as f64), &journal.map);
        if let Item::Keyframe { capture_time_ns, .. } = &mut item {
            *capture_time_ns = time_ms * 1_000_000;
        }
        journal.send(ROBOT, &item).unwrap();
        let map = &journal.map;
        assert_eq!(map.newest_keyframe(ROBOT).unwrap().0, expected(map), "{k}");
    }
    assert_eq!(Map::from_parts(journal.map.to_parts()).unwrap(), journal.map);
    assert_eq!(Map::replay(journal.events.iter()).unwrap(), journal.map);
}
