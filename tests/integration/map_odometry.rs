//! Odometry as a measurement: what it ties, how far it is believed, and where keyframes start that follow it.

use std::collections::BTreeSet;

use covis::map::{
    Change, ConstraintKind, GlobalOptions, Held, Item, MapPolicy, MapProblem, Noise, OdometryNoise,
    Reach, SolveKind, Solved, Start, applied, choose_window, global_problem, local_problem,
};
use covis_solvers::geometry::{LieGroup, Se3};

use crate::map_support::{
    Journal, ROBOT, id, pose_at, pose_error, relative_pose, solve_of, street, street_keyframe,
    window_around,
};

/// The pairs of keyframes that a window's odometry ties.
fn ties(journal: &Journal, center: i64) -> Vec<(i64, i64)> {
    let problem = local_problem(&journal.map, &window_around(&journal.map, &[id(center)]));
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
    let mut problem = local_problem(&journal.map, &window_around(&journal.map, &[id(6)]));
    let before = OdometryNoise::default();
    for _ in 0..40 {
        problem.learn_odometry_noise();
    }
    let after = problem.noise[&ROBOT].odometry;
    assert!(after.translation_share > 2.0 * before.translation_share, "{after:?}");
    assert!((0.02..0.06).contains(&after.translation_share), "5 % along one of three axes");
    assert!(after.rotation_rad < 1.1 * before.rotation_rad, "rotation is exact: {after:?}");
    let solved = Solved::Bundle(&problem);
    let solve =
        applied(&journal.map, solved, SolveKind::LocalBundle, Vec::new(), (1.0, 0.5), Reach::All);
    assert_eq!(solve.noise, [(ROBOT, problem.noise[&ROBOT])]);
    journal.push(Change::SolveApplied { solve });
    assert_eq!(journal.map.client(ROBOT).unwrap().noise.odometry, after);
}

/// A street whose odometry has no metric scale: a unit of it is `unit` long.
fn scaleless_street(keyframes: i64, unit: f64) -> Journal {
    let policy = MapPolicy { metric_odometry: false, ..MapPolicy::default() };
    let mut journal = Journal::new(policy);
    for k in 0..keyframes {
        let mut item = street_keyframe(k, pose_at(k as f64), &journal.map);
        if let Item::Keyframe { odom_from_camera, .. } = &mut item {
            *odom_from_camera = Some(pose_at(k as f64 / unit));
        }
        journal.send(ROBOT, &item).unwrap();
    }
    journal
}

#[test]
fn odometry_without_metric_scale_continues_that_of_the_map() {
    let journal = scaleless_street(6, 3.0);
    let problem = local_problem(&journal.map, &window_around(&journal.map, &[id(5)]));
    let ties: Vec<_> =
        problem.odometry.iter().map(|&i| problem.problem.relative_poses[i]).collect();
    // Nothing went before the first one that could say how long its step is.
    let ties: Vec<_> = ties.iter().filter(|tie| problem.keyframes[tie.i] != id(0)).collect();
    assert!(ties.len() > 2, "{ties:?}");
    for tie in ties {
        let step = tie.i_from_j.translation;
        assert!((step.norm() - 1.0).abs() < 1e-9, "{step}");
        let along = step.normalize();
        let translation = tie.information.matrix().fixed_view::<3, 3>(0, 0).into_owned();
        let deviation = along.dot(&(translation * along)).sqrt().recip() / step.norm();
        assert!((0.09..0.2).contains(&deviation), "its length is open: {deviation}");
        let across = translation.symmetric_eigenvalues().max().sqrt().recip() / step.norm();
        assert!(across < 0.2 * deviation, "its direction is not: {across}");
    }
}

#[test]
fn noise_learns_nothing_from_lengths_without_metric_scale() {
    let journal = scaleless_street(12, 3.0);
    let mut problem = local_problem(&journal.map, &window_around(&journal.map, &[id(6)]));
    for pose in problem.problem.poses.iter_mut() {
        // The map's scale changes by a tenth.
        pose.translation *= 1.1;
    }
    let before = problem.noise[&ROBOT].odometry;
    problem.learn_odometry_noise();
    let after = problem.noise[&ROBOT].odometry;
    assert!(after.translation_share < 1.1 * before.translation_share, "{after:?}");
}

#[test]
fn a_keyframe_of_odometry_without_metric_scale_starts_a_step_of_the_map_further() {
    let mut journal = scaleless_street(12, 3.0);
    let mut item = street_keyframe(12, pose_at(11.0 + 1.0 / 3.0), &journal.map);
    if let Item::Keyframe { odom_from_camera, .. } = &mut item {
        *odom_from_camera = Some(pose_at(4.0));
    }
    journal.send(ROBOT, &item).unwrap();
    let found = journal.map.keyframes().get(&id(12)).unwrap().world_from_camera;
    assert!(pose_error(&found, &pose_at(12.0)) < 1e-9, "{found:?}");
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
    let window = choose_window(&journal.map, &[id(2)], &waiting);
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
    let solve =
        applied(&journal.map, solved, SolveKind::LocalBundle, Vec::new(), (1.0, 0.5), Reach::All);
    let last = solve.poses.iter().find(|(moved, _)| *moved == id(5)).unwrap().1;
    assert!(pose_error(&last, &shift.compose(&pose_at(5.0))) < 1e-12, "{last:?}");
    // One behind which there is a solved keyframe is no end of a trajectory.
    let middle: BTreeSet<_> = [id(3)].into();
    assert!(choose_window(&journal.map, &[id(2)], &middle).carried.is_empty());
}

#[test]
fn keyframes_that_see_nothing_move_with_those_beside_them() {
    let mut journal = street(3, MapPolicy::default());
    for k in 3..6 {
        let mut item = street_keyframe(k, pose_at(k as f64), &journal.map);
        if k < 5
            && let Item::Keyframe { observations, landmarks, .. } = &mut item
        {
            observations.clear();
            landmarks.clear();
        }
        journal.send(ROBOT, &item).unwrap();
    }
    let window = window_around(&journal.map, &[id(5)]);
    assert!([3, 4].map(id).iter().all(|blind| window.free.contains(blind)), "{window:?}");
    let problem = local_problem(&journal.map, &window);
    assert_eq!(problem.held, [], "odometry measures them");
    let alone = local_problem(&journal.map, &window_around(&journal.map, &[id(3)]));
    assert!(alone.is_solvable());
}

#[test]
fn keyframes_without_views_are_free_before_one_that_waits_and_go_along_behind_it() {
    let mut journal = street(3, MapPolicy::default());
    // 3, 4 and 6 see nothing; 5 and 7 wait.
    for k in 3..8 {
        let mut item = street_keyframe(k, pose_at(k as f64), &journal.map);
        if [3, 4, 6].contains(&k)
            && let Item::Keyframe { observations, landmarks, .. } = &mut item
        {
            observations.clear();
            landmarks.clear();
        }
        journal.send(ROBOT, &item).unwrap();
    }
    let window = choose_window(&journal.map, &[id(5)], &[5, 7].map(id).into());
    assert_eq!(window.carried, [6, 7].map(id).into());
    assert!([3, 4].map(id).iter().all(|blind| window.free.contains(blind)), "{window:?}");
    // The last ones go along with nothing that waits.
    let window = choose_window(&journal.map, &[id(2)], &BTreeSet::new());
    assert!(window.carried.is_empty(), "{window:?}");
}

#[test]
fn the_whole_map_is_tied_by_odometry_but_for_where_it_began_anew() {
    let policy = MapPolicy::default();
    let mut journal = street(3, policy);
    for k in 3..6 {
        // Its odometry begins again somewhere else; its start estimates go on.
        let mut item = street_keyframe(k, pose_at(k as f64), &journal.map);
        if let Item::Keyframe { odom_from_camera, .. } = &mut item {
            *odom_from_camera = Some(pose_at(70.0 + k as f64));
        }
        journal.send(ROBOT, &item).unwrap();
    }
    let whole = |journal: &Journal| global_problem(&journal.map, &GlobalOptions::default());
    assert!(whole(&journal).odometry.is_empty(), "its noise is not known");
    let mut solve = solve_of(SolveKind::LocalBundle);
    let odometry = OdometryNoise { pairs: 28.0, ..Default::default() };
    solve.noise = vec![(ROBOT, Noise { odometry, ..Default::default() })];
    journal.push(Change::SolveApplied { solve });
    let problem = whole(&journal);
    let pair = |&index: &usize| {
        let factor = &problem.problem.relative_poses[index];
        (problem.keyframes[factor.i].id, problem.keyframes[factor.j].id)
    };
    let ties: Vec<_> = problem.odometry.iter().map(pair).collect();
    assert_eq!(ties, [(0, 1), (1, 2), (3, 4), (4, 5)]);
}

/// The window around the last keyframe of a street whose policy is `policy`, and its start.
fn last_window(policy: MapPolicy) -> (MapProblem, Start) {
    let journal = street(6, policy);
    let problem = local_problem(&journal.map, &window_around(&journal.map, &[id(5)]));
    let start = problem.start();
    (problem, start)
}

/// Where a keyframe is in a problem.
fn place(problem: &MapProblem, keyframe: i64) -> usize {
    problem.keyframes.iter().position(|&known| known == id(keyframe)).unwrap()
}

#[test]
fn a_window_without_odometry_reaches_past_those_that_see_the_same() {
    let free = |odometry| {
        let journal = street(12, MapPolicy { odometry, ..MapPolicy::default() });
        let window = window_around(&journal.map, &[id(11)]);
        window.free.iter().map(|id| id.id).collect::<Vec<_>>()
    };
    assert_eq!(free(true), [8, 9, 10, 11], "a keyframe shares corners with three before it");
    assert_eq!(free(false), (1..12).collect::<Vec<_>>(), "the whole way, as its first is held");
}

#[test]
fn a_result_that_is_the_start_is_plausible_and_so_is_one_that_views_determine() {
    let (mut problem, start) = last_window(MapPolicy::default());
    assert_eq!(problem.implausible(&start), []);
    // Everything moves far: exact views still say where the keyframes are to each other.
    let last = place(&problem, 5);
    let truth = problem.problem.poses[last];
    problem.problem.poses[last] = pose_at(40.0);
    let start = problem.start();
    problem.problem.poses[last] = truth;
    assert_eq!(problem.implausible(&start), []);
}

#[test]
fn a_camera_beyond_what_it_sees_is_not_plausible() {
    let (mut problem, start) = last_window(MapPolicy::default());
    let last = place(&problem, 5);
    let back = Se3::exp(&nalgebra::Vector6::new(0.0, 0.0, 0.0, 0.0, std::f64::consts::PI, 0.0));
    problem.problem.poses[last] = problem.problem.poses[last].compose(&back);
    assert_eq!(problem.implausible(&start), [(last, Held::Behind)]);
    problem.restart(&start, &[(last, Held::Behind)]);
    assert_eq!(problem.held, [(id(5), Held::Behind)]);
    assert!(problem.problem.constant_poses[last], "it stays where it started");
    assert_eq!(problem.implausible(&start), []);
}

#[test]
fn a_keyframe_that_goes_far_along_what_nothing_measures_is_not_plausible() {
    let (mut problem, _) =
        last_window(MapPolicy { odometry: false, window_keyframes: 2, ..MapPolicy::default() });
    let last = place(&problem, 5);
    // Its landmarks go with it, and no other keyframe sees them.
    let seen = problem.problem.observations();
    let own: Vec<_> = seen.filter(|seen| seen.pose as usize == last).collect();
    problem.problem.reprojections = Default::default();
    for seen in own {
        problem.problem.push_observation(seen.pose, seen.camera, seen.landmark, seen.seen);
    }
    let start = problem.start();
    let shift = pose_at(100.0);
    problem.problem.poses[last] = shift.compose(&problem.problem.poses[last]);
    problem.problem.landmarks.iter_mut().for_each(|point| *point = shift.transform(point));
    assert_eq!(problem.implausible(&start), [(last, Held::Undetermined)]);
}

#[test]
fn views_that_fit_worse_than_before_are_not_plausible_unless_odometry_holds() {
    for (odometry, expected) in [(false, vec![Held::Worse]), (true, Vec::new())] {
        let policy = MapPolicy { odometry, ..MapPolicy::default() };
        let (mut problem, start) = last_window(policy);
        let last = place(&problem, 5);
        let turn = Se3::exp(&nalgebra::Vector6::new(0.0, 0.0, 0.0, 0.0, 8.5e-3, 0.0));
        problem.problem.poses[last] = problem.problem.poses[last].compose(&turn);
        let found: Vec<Held> =
            problem.implausible(&start).into_iter().map(|(_, why)| why).collect();
        assert_eq!(found, expected);
    }
}
