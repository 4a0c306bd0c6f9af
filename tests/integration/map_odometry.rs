//! Odometry as a measurement: what it ties, how far it is believed, and where keyframes start that follow it.

use std::collections::BTreeSet;

use covis::map::{
    Change, ConstraintKind, Item, MapPolicy, OdometryNoise, SolveKind, Solved, applied,
    choose_window, choose_window_while, local_problem,
};
use covis_solvers::geometry::{LieGroup, Se3};

use crate::map_support::{
    Journal, ROBOT, id, pose_at, pose_error, relative_pose, solve_of, street, street_keyframe,
};

/// The pairs of keyframes that a window's odometry ties.
fn ties(journal: &Journal, center: i64) -> Vec<(i64, i64)> {
    let problem = local_problem(&journal.map, &choose_window(&journal.map, &[id(center)]));
    let pair = |&index: &usize| {
        let factor = &problem.problem.relative_poses[index];
        (problem.keyframes[factor.i].id, problem.keyframes[factor.j].id)
    };
    let mut pairs: Vec<_> = problem.odometry.iter().map(pair).collect();
    pairs.sort_unstable();
    pairs
}

#[test]
fn consecutive_keyframes_are_tied_unless_the_client_measured_them() {
    let mut journal = street(4, MapPolicy::default());
    assert_eq!(ties(&journal, 3), [(0, 1), (1, 2), (2, 3)]);
    let own = relative_pose(9, ConstraintKind::Odometry, 2, 1, pose_at(-1.0));
    journal.send(ROBOT, &own).unwrap();
    assert_eq!(ties(&journal, 3), [(0, 1), (2, 3)], "the constraint takes its place");
    let off = street(4, MapPolicy { odometry: false, ..MapPolicy::default() });
    assert_eq!(ties(&off, 3), []);
}

#[test]
fn a_keyframe_without_views_is_in_the_window_of_its_neighbors_surroundings() {
    let mut journal = street(3, MapPolicy::default());
    let mut blind = street_keyframe(3, pose_at(3.0), &journal.map);
    if let Item::Keyframe { observations, landmarks, .. } = &mut blind {
        observations.clear();
        landmarks.clear();
    }
    journal.send(ROBOT, &blind).unwrap();
    let window = choose_window(&journal.map, &[id(2)]);
    assert!(window.fixed.contains(&id(3)), "{window:?}");
    assert!(local_problem(&journal.map, &choose_window(&journal.map, &[id(3)])).is_solvable());
}

#[test]
fn noise_follows_what_exact_views_say_of_odometry() {
    // 5 % too short, which the views contradict.
    let mut journal = Journal::new(MapPolicy::default());
    for k in 0..12 {
        let mut item = street_keyframe(k, pose_at(k as f64), &journal.map);
        if let Item::Keyframe { odom_from_camera, .. } = &mut item {
            *odom_from_camera = Some(pose_at(0.95 * k as f64));
        }
        journal.send(ROBOT, &item).unwrap();
    }
    let mut problem = local_problem(&journal.map, &choose_window(&journal.map, &[id(6)]));
    let before = OdometryNoise::default();
    for _ in 0..40 {
        problem.learn_noise();
    }
    let after = problem.noise[&ROBOT];
    assert!(after.translation_share > 2.0 * before.translation_share, "{after:?}");
    assert!((0.02..0.06).contains(&after.translation_share), "5 % along one of three axes");
    assert!(after.rotation_rad < 1.1 * before.rotation_rad, "rotation is exact: {after:?}");
    let solved = Solved::Bundle(&problem);
    let solve = applied(&journal.map, solved, SolveKind::LocalBundle, Vec::new(), (1.0, 0.5));
    assert_eq!(solve.odometry_noise, [(ROBOT, after)]);
    journal.push(Change::SolveApplied { solve });
    assert_eq!(journal.map.client(ROBOT).unwrap().odometry_noise, after);
}

/// A street whose first four keyframes were moved by `correction`; their landmarks too.
fn corrected(correction: &Se3) -> Journal {
    let mut journal = street(4, MapPolicy::default());
    let known = journal.map.landmarks();
    let landmarks =
        known.iter().filter_map(|(&id, l)| Some((id, correction.transform(&l.position?))));
    let mut solve = solve_of(SolveKind::LocalBundle);
    solve.landmarks = landmarks.collect();
    solve.poses = (0..4).map(|k| (id(k), correction.compose(&pose_at(k as f64)))).collect();
    journal.push(Change::SolveApplied { solve });
    journal
}

#[test]
fn raw_odometry_starts_where_its_views_fit_and_so_does_an_estimate_of_the_map() {
    let correction = pose_at(0.2);
    let expected = correction.compose(&pose_at(4.0));
    // Raw odometry, and the same as a client sends it that has heard of the correction.
    for start in [pose_at(4.0), expected] {
        let mut journal = corrected(&correction);
        let item = street_keyframe(4, start, &journal.map);
        journal.send(ROBOT, &item).unwrap();
        let found = journal.map.keyframes().get(&id(4)).unwrap().world_from_camera;
        assert!(pose_error(&found, &expected) < 1e-9, "{found:?}");
    }
}

#[test]
fn keyframes_that_wait_hold_nothing_and_go_with_the_one_before_them() {
    let journal = street(6, MapPolicy { window_keyframes: 2, ..MapPolicy::default() });
    let waiting: BTreeSet<_> = [3, 4, 5].map(id).into();
    let window = choose_window_while(&journal.map, &[id(2)], &waiting);
    assert!(window.fixed.iter().all(|held| !waiting.contains(held)), "{window:?}");
    assert_eq!(
        window.carried,
        waiting.iter().copied().filter(|k| !window.free.contains(k)).collect()
    );
    let mut problem = local_problem(&journal.map, &window);
    let shift = pose_at(0.1);
    for (pose, constant) in problem.problem.poses.iter_mut().zip(&problem.problem.constant_poses) {
        if !constant {
            *pose = shift.compose(pose);
        }
    }
    let solved = Solved::Bundle(&problem);
    let solve = applied(&journal.map, solved, SolveKind::LocalBundle, Vec::new(), (1.0, 0.5));
    let last = solve.poses.iter().find(|(moved, _)| *moved == id(5)).unwrap().1;
    assert!(pose_error(&last, &shift.compose(&pose_at(5.0))) < 1e-12, "{last:?}");
    // One behind which there is a solved keyframe is no end of a trajectory.
    let middle: BTreeSet<_> = [id(3)].into();
    assert!(choose_window_while(&journal.map, &[id(2)], &middle).carried.is_empty());
}
