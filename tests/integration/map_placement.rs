//! Which landmarks a local solve may move: those that their observers pin down.

use covis::map::{
    EntityRef, Item, ItemLandmark, Map, MapPolicy, Reach, SolveKind, Solved, applied,
    global_problem, local_problem,
};
use nalgebra::Vector3;

use crate::map_support::{Journal, ROBOT, id, observe, pose_at, window_around};

/// Keyframe `k` at x meters, which sees landmarks at these points; the first brings them along.
fn keyframe(k: i64, x: f64, points: &[Vector3<f64>]) -> Item {
    let pose = pose_at(x);
    let new = |(index, &position): (usize, &Vector3<f64>)| {
        let (id, position) = (index as i64, Some(position));
        ItemLandmark { id, position }
    };
    Item::Keyframe {
        id: k,
        capture_time_ns: k,
        camera: Some(EntityRef::own(0)),
        world_from_camera: pose,
        odom_from_camera: None,
        observations: (0..).zip(points).map(|(l, p)| observe(l, &pose, p)).collect(),
        landmarks: if k == 0 { points.iter().enumerate().map(new).collect() } else { Vec::new() },
        global_descriptor: None,
    }
}

/// A near landmark, one so far away that two views meet at less than 1°, one behind the cameras.
fn points() -> [Vector3<f64>; 3] {
    [Vector3::new(0.5, 0.0, 4.0), Vector3::new(1.0, 0.5, 400.0), Vector3::new(0.2, 0.1, -3.0)]
}

fn pair() -> Map {
    let mut journal = Journal::new(MapPolicy::default());
    journal.send(ROBOT, &keyframe(0, 0.0, &points())).unwrap();
    journal.send(ROBOT, &keyframe(1, 1.0, &points())).unwrap();
    journal.map
}

#[test]
fn a_window_leaves_out_landmarks_without_parallax_or_behind_a_camera() {
    let map = pair();
    assert_eq!(window_around(&map, &[id(1)]).landmarks, [id(0)]);
    // The whole map's solve takes them all.
    assert_eq!(global_problem(&map, &Default::default()).landmarks, [id(0), id(1), id(2)]);
}

#[test]
fn a_landmark_that_a_window_throws_away_stays_where_it_was() {
    let map = pair();
    let mut problem = local_problem(&map, &window_around(&map, &[id(1)]));
    let mut outcome = |position: Vector3<f64>| {
        problem.problem.landmarks[0] = position;
        let solve = applied(
            &map,
            Solved::Bundle(&problem),
            SolveKind::LocalBundle,
            vec![(ROBOT, 2)],
            (1.0, 0.5),
            Reach::All,
        );
        solve.landmarks.iter().find(|(landmark, _)| *landmark == id(0)).map(|&(_, p)| p)
    };
    let near = Vector3::new(0.5, 0.0, 4.1);
    assert_eq!(outcome(near), Some(near));
    assert_eq!(outcome(Vector3::new(0.5, 0.0, 4000.0)), None);
    assert_eq!(outcome(Vector3::new(0.5, 0.0, -4.0)), None);
}
