//! Windows, problems and what comes back: who is free, what is held, what moves along.

#![allow(clippy::unwrap_used, reason = "helpers of tests fail by panicking")]

use covis::map::{
    Change, ConstraintKind, Depth, EntityId, EntityRef, Gauge, GlobalOptions, Item, ItemLandmark,
    ItemObservation, Map, MapPolicy, Reach, SolveKind, Solved, Window, applied, global_problem,
    local_problem, pair_input, triangulate,
};
use covis_solvers::evaluation::bundle_cost;
use covis_solvers::geometry::LieGroup;
use covis_solvers::loss::Loss;
use covis_solvers::relative_motion::RelativeMotion;
use covis_solvers::{bundle_adjustment, pose_graph};
use nalgebra::{Vector3, Vector6};

use crate::map_support::{
    Journal, ROBOT, corner, id, loop_problem, observe, pose_at, pose_error, relative_pose, street,
    street_keyframe, window_around,
};

fn bundle(problem: &mut covis::map::MapProblem) {
    let options = bundle_adjustment::Options::default();
    let summary = bundle_adjustment::solve(
        &mut problem.problem,
        &options,
        &mut covis_solvers::optimizer::ignore_iterations,
    );
    summary.unwrap();
}

#[test]
fn a_window_takes_the_keyframes_that_share_most_and_holds_the_rest() {
    let policy = MapPolicy { window_keyframes: 3, ..MapPolicy::default() };
    let journal = street(8, policy);
    // Keyframe k sees corners 10k − 20 to 10k + 20, so it shares 30, 20, 10 with its neighbors.
    let shared: Vec<_> = journal.map.covisibility().neighbors(id(7)).collect();
    assert_eq!(shared, [(id(4), 10), (id(5), 20), (id(6), 30)]);
    let window = window_around(&journal.map, &[id(7)]);
    assert_eq!(window.free, [id(5), id(6), id(7)]);
    assert_eq!(window.fixed, [id(2), id(3), id(4)]);
    // Corners 80 to 89 are seen once and left out.
    assert_eq!(window.landmarks.first(), Some(&id(30)));
    assert_eq!(window.landmarks.last(), Some(&id(79)));
    // Ties go to the more recent keyframe: 5 shares 30 with 4 and with 6.
    let policy = MapPolicy { window_keyframes: 2, ..MapPolicy::default() };
    let journal = street(8, policy);
    assert_eq!(window_around(&journal.map, &[id(5)]).free, [id(5), id(6)]);
    assert_eq!(window_around(&journal.map, &[id(99)]), Window::default());
}

#[test]
fn a_window_without_outside_views_holds_its_oldest_keyframe() {
    let journal = street(3, MapPolicy::default());
    let window = window_around(&journal.map, &[id(2)]);
    assert_eq!((window.free, window.fixed), (vec![id(1), id(2)], vec![id(0)]));
    let single = street(1, MapPolicy::default());
    let window = window_around(&single.map, &[id(0)]);
    assert_eq!((window.free.len(), window.fixed, window.landmarks.len()), (0, vec![id(0)], 0));
    assert!(!local_problem(&single.map, &window_around(&single.map, &[id(0)])).is_solvable());
}

#[test]
fn a_local_solve_recovers_a_bad_start_and_the_rest_stays() {
    // From a bad start the engine begins with this loss.
    let observation_loss = Loss::Huber(2.0);
    let policy = MapPolicy {
        window_keyframes: 2,
        observation_loss,
        odometry: false,
        ..MapPolicy::default()
    };
    let mut journal = street(7, policy);
    let start = pose_at(7.0).plus(&Vector6::new(0.05, -0.03, 0.04, 0.01, -0.02, 0.01));
    journal.send(ROBOT, &street_keyframe(7, start, &journal.map)).unwrap();
    let mut problem = local_problem(&journal.map, &window_around(&journal.map, &[id(7)]));
    assert!(problem.is_solvable());
    assert_eq!(problem.problem.observation_loss, observation_loss);
    let before = bundle_cost(&problem.problem).total;
    bundle(&mut problem);
    let after = bundle_cost(&problem.problem).total;
    assert!(before > 100.0 && after < 1e-6 * before, "{before} to {after}");
    let covered = vec![(ROBOT, 9)];
    let solve = applied(
        &journal.map,
        Solved::Bundle(&problem),
        SolveKind::LocalBundle,
        covered,
        (before, after),
        Reach::All,
    );
    let moved: Vec<_> = solve.poses.iter().map(|&(id, _)| id).collect();
    assert_eq!(moved, [id(4), id(5), id(6), id(7)], "twice as many, without odometry");
    // Corner 80 is seen by keyframe 7 alone: no part of the solve, but it follows its keyframe.
    let now = solve.poses[3].1;
    let followed = solve.landmarks.iter().find(|(l, _)| *l == id(80)).unwrap().1;
    let in_keyframe = start.inverse_transform(&corner(80));
    assert!((now.inverse_transform(&followed) - in_keyframe).norm() < 1e-12);
    journal.push(Change::SolveApplied { solve });
    for (id, keyframe) in journal.map.keyframes() {
        let error = pose_error(&keyframe.world_from_camera, &pose_at(id.id as f64));
        assert!(error < 1e-5, "keyframe {id}: {error}");
    }
    assert_eq!(journal.map.client(ROBOT).unwrap().optimized_sequence, 9);
}

#[test]
fn the_global_problem_holds_every_observation_of_a_usable_landmark() {
    let mut journal = street(4, MapPolicy { odometry: false, ..MapPolicy::default() });
    let problem = global_problem(&journal.map, &GlobalOptions::default());
    // Of 50 corners, 40 to 49 are seen once.
    assert_eq!(problem.landmarks.len(), 40);
    assert_eq!(problem.problem.observation_count(), 20 + 30 + 40 + 30);
    assert_eq!(problem.problem.constant_poses, [true, false, false, false]);
    assert_eq!(problem.problem.constant_cameras, [true]);
    assert!(bundle_cost(&problem.problem).total < 1e-18);
    problem.problem.validate().unwrap();

    let free = GlobalOptions { fix_intrinsics: false, gauge: Gauge::Free, ..Default::default() };
    let problem = global_problem(&journal.map, &free);
    assert_eq!(problem.problem.constant_poses, [false; 4]);
    assert_eq!(problem.problem.constant_cameras, [false]);

    // A depth makes a single observation enough; constraints and priors come along.
    let mut sent = observe(500, &pose_at(3.0), &corner(30));
    sent.depth = Some(Depth { depth_m: corner(30).z, sigma_m: 0.1 });
    let landmarks = vec![ItemLandmark { id: 500, position: Some(corner(30)) }];
    journal.send(ROBOT, &Item::Landmarks { landmarks }).unwrap();
    let keyframe = EntityRef::own(3);
    journal.send(ROBOT, &Item::Observations { keyframe, observations: vec![sent] }).unwrap();
    let odometry = relative_pose(0, ConstraintKind::Odometry, 0, 1, pose_at(1.0));
    journal.send(ROBOT, &odometry).unwrap();
    let problem = global_problem(&journal.map, &GlobalOptions::default());
    assert_eq!(problem.problem.depth_reprojections.len(), 1);
    assert_eq!(problem.landmarks.len(), 41);
    assert_eq!(problem.problem.relative_poses.len(), 1);
    assert!(bundle_cost(&problem.problem).total < 1e-18);
}

/// The measurement of a pair of keyframes of `map`.
fn measured(map: &Map) -> impl Fn(EntityId, EntityId) -> Option<RelativeMotion> {
    move |a, b| pair_input(map, a, b)?.measure()
}

#[test]
fn every_piece_of_the_map_gets_a_gauge_and_bare_poses_are_held() {
    let mut journal = street(3, MapPolicy { odometry: false, ..MapPolicy::default() });
    for index in [20, 21, 22] {
        let item = street_keyframe(index, pose_at(index as f64), &journal.map);
        journal.send(ROBOT, &item).unwrap();
    }
    let bare = Item::Keyframe {
        id: 50,
        capture_time_ns: 50,
        camera: Some(EntityRef::own(0)),
        world_from_camera: pose_at(50.0),
        odom_from_camera: None,
        observations: Vec::new(),
        landmarks: Vec::new(),
        global_descriptor: None,
    };
    journal.send(ROBOT, &bare).unwrap();
    let problem = global_problem(&journal.map, &GlobalOptions::default());
    let held = [true, false, false, true, false, false, true];
    assert_eq!(problem.problem.constant_poses, held);
    // In the pose graph consecutive keyframes hang together across the gap.
    let graph = loop_problem(&journal.map, measured(&journal.map)).graph;
    assert_eq!(graph.constant, [true, false, false, false, false, false, false]);
    graph.validate().unwrap();
}

#[test]
fn what_arrived_during_a_solve_moves_with_its_reference() {
    let mut journal = street(4, MapPolicy::default());
    let mut problem = global_problem(&journal.map, &GlobalOptions::default());
    let solve_start = journal.map.revision();
    assert_eq!(problem.start_revision, solve_start);
    // While it runs: keyframe 4 (after 3), and 50 whose capture time is between 1 and 2.
    journal.send(ROBOT, &street_keyframe(4, pose_at(4.0), &journal.map)).unwrap();
    let between = Item::Keyframe {
        id: 50,
        capture_time_ns: 1_500_000,
        camera: Some(EntityRef::own(0)),
        world_from_camera: pose_at(1.5),
        odom_from_camera: None,
        observations: Vec::new(),
        landmarks: Vec::new(),
        global_descriptor: None,
    };
    journal.send(ROBOT, &between).unwrap();
    // The solve moves 1 and 3, each by another motion.
    let motion_of_1 = pose_at(0.0).plus(&Vector6::new(0.1, 0.2, 0.3, 0.02, 0.01, -0.03));
    let motion_of_3 = pose_at(0.0).plus(&Vector6::new(-0.2, 0.1, 0.0, 0.0, 0.1, 0.0));
    problem.problem.poses[1] = motion_of_1.compose(&pose_at(1.0));
    problem.problem.poses[3] = motion_of_3.compose(&pose_at(3.0));
    let solve = applied(
        &journal.map,
        Solved::Bundle(&problem),
        SolveKind::Global,
        Vec::new(),
        (1.0, 0.5),
        Reach::All,
    );
    journal.push(Change::SolveApplied { solve });
    let pose = |k| journal.map.keyframes().get(&id(k)).unwrap().world_from_camera;
    assert!(pose_error(&pose(4), &motion_of_3.compose(&pose_at(4.0))) < 1e-12);
    assert!(pose_error(&pose(50), &motion_of_1.compose(&pose_at(1.5))) < 1e-12);
    assert_eq!(pose(2), pose_at(2.0));
    // Corner 55 came with keyframe 4 and moves with it; corner 30 was solved and stays as solved.
    let position = |k| journal.map.landmarks().get(&id(k)).unwrap().position.unwrap();
    assert!((position(55) - motion_of_3.transform(&corner(55))).norm() < 1e-12);
    assert_eq!(position(30), corner(30));
    // Corner 45 was there but seen once, by keyframe 3 first: it follows as well.
    assert!((position(45) - motion_of_3.transform(&corner(45))).norm() < 1e-12);
}

#[test]
fn a_loop_closure_bends_the_street_back_and_landmarks_follow() {
    // A street of 20 that drifts sideways; the closure says where the last keyframe truly is.
    let mut journal = Journal::new(MapPolicy::default());
    let drift = |k: i64| {
        let k = k as f64;
        pose_at(k).plus(&Vector6::new(0.0, 0.0, 0.01 * k * k, 0.0, 0.0, 0.0))
    };
    for k in 0..20 {
        let mut item = street_keyframe(k, drift(k), &journal.map);
        // Corners drift with the keyframe that brings them.
        if let Item::Keyframe { landmarks, .. } = &mut item {
            for landmark in landmarks {
                let in_true = pose_at(k as f64).inverse_transform(&corner(landmark.id));
                landmark.position = Some(drift(k).transform(&in_true));
            }
        }
        journal.send(ROBOT, &item).unwrap();
    }
    let mut no_loop = loop_problem(&journal.map, measured(&journal.map));
    // Consecutive pairs; others share landmarks with them.
    assert_eq!(no_loop.graph.edges.len(), 19);
    let options = pose_graph::Options::default();
    let mut observer = covis_solvers::optimizer::ignore_iterations;
    let summary = pose_graph::solve(&mut no_loop.graph, &options, &mut observer).unwrap();
    assert!(summary.final_cost < 1e-18, "a chain agrees with itself");

    let closure = relative_pose(0, ConstraintKind::LoopClosure, 0, 19, pose_at(19.0));
    journal.send(ROBOT, &closure).unwrap();
    let mut problem = loop_problem(&journal.map, measured(&journal.map));
    assert_eq!(problem.graph.edges.len(), 19 + 1);
    let summary = pose_graph::solve(&mut problem.graph, &options, &mut observer).unwrap();
    let costs = (summary.initial_cost, summary.final_cost);
    let solve = applied(
        &journal.map,
        Solved::Graph(&problem),
        SolveKind::PoseGraph,
        vec![(ROBOT, 22)],
        costs,
        Reach::All,
    );
    assert!(solve.poses.iter().all(|(k, _)| *k != id(0)), "the gauge does not move");
    let before = journal.map.clone();
    journal.push(Change::SolveApplied { solve });
    let error = |map: &covis::map::Map, k: i64| {
        pose_error(&map.keyframes().get(&id(k)).unwrap().world_from_camera, &pose_at(k as f64))
    };
    assert!(error(&journal.map, 19) < 0.1 * error(&before, 19), "{}", error(&journal.map, 19));
    for (landmark_id, landmark) in journal.map.landmarks() {
        let reference = landmark.reference.unwrap();
        let seen_from = |map: &covis::map::Map| {
            let point = map.landmarks().get(landmark_id).unwrap().position.unwrap();
            map.keyframes().get(&reference).unwrap().world_from_camera.inverse_transform(&point)
        };
        assert!((seen_from(&before) - seen_from(&journal.map)).norm() < 1e-9);
    }
}

#[test]
fn what_a_client_measured_replaces_what_landmarks_tell_and_a_closure_stands_beside_it() {
    let mut journal = street(3, MapPolicy::default());
    let edges =
        |journal: &Journal| loop_problem(&journal.map, measured(&journal.map)).graph.edges.len();
    assert_eq!(edges(&journal), 2);
    let closure = relative_pose(0, ConstraintKind::LoopClosure, 0, 1, pose_at(1.0));
    journal.send(ROBOT, &closure).unwrap();
    assert_eq!(edges(&journal), 3);
    let item = relative_pose(1, ConstraintKind::Odometry, 0, 1, pose_at(1.0));
    journal.send(ROBOT, &item).unwrap();
    assert_eq!(edges(&journal), 3);
}

#[test]
fn no_solve_changes_what_a_pair_of_keyframes_measured() {
    let mut journal = street(20, MapPolicy::default());
    let before = loop_problem(&journal.map, measured(&journal.map)).graph.edges;
    let mut problem = global_problem(&journal.map, &GlobalOptions::default());
    for pose in problem.problem.poses.iter_mut().skip(1) {
        *pose = pose.plus(&Vector6::new(0.5, 0.1, -0.3, 0.05, 0.02, 0.1));
    }
    let solve = applied(
        &journal.map,
        Solved::Bundle(&problem),
        SolveKind::Global,
        Vec::new(),
        (1.0, 0.5),
        Reach::All,
    );
    journal.push(Change::SolveApplied { solve });
    assert_eq!(loop_problem(&journal.map, measured(&journal.map)).graph.edges, before);
}

/// Keyframe `k` of the street, which sees corners `seen`; landmarks `new` have no position.
fn bare(k: i64, seen: &[i64], new: &[i64]) -> Item {
    let pose = pose_at(k as f64);
    Item::Keyframe {
        id: k,
        capture_time_ns: k,
        camera: Some(EntityRef::own(0)),
        world_from_camera: pose,
        odom_from_camera: None,
        observations: seen.iter().map(|&l| observe(l, &pose, &corner(l))).collect(),
        landmarks: new.iter().map(|&id| ItemLandmark { id, position: None }).collect(),
        global_descriptor: None,
    }
}

/// Changes the last observation of a keyframe.
fn with_last(mut item: Item, change: impl FnOnce(&mut ItemObservation)) -> Item {
    let Item::Keyframe { observations, .. } = &mut item else { panic!("a keyframe") };
    change(observations.last_mut().unwrap());
    item
}

#[test]
fn landmarks_without_position_are_triangulated_once_views_allow() {
    let mut journal = Journal::new(MapPolicy::default());
    journal.send(ROBOT, &bare(0, &[1, 2, 3], &[1, 2, 3])).unwrap();
    assert!(triangulate(&journal.map, id(0)).is_empty(), "one view without depth");
    let depth = Depth { depth_m: corner(4).z, sigma_m: 0.05 };
    let item = with_last(bare(1, &[1, 2, 4], &[4]), |seen| seen.depth = Some(depth));
    journal.send(ROBOT, &item).unwrap();
    let positions = triangulate(&journal.map, id(1));
    let ids: Vec<_> = positions.iter().map(|&(id, _)| id).collect();
    assert_eq!(ids, [id(1), id(2), id(4)]);
    for (landmark, position) in &positions {
        let error: Vector3<f64> = position - corner(landmark.id);
        assert!(error.norm() < 1e-6, "landmark {landmark}: {error}");
    }
    journal.push(Change::LandmarksTriangulated { positions });
    assert_eq!(
        journal.map.landmarks().get(&id(1)).unwrap().positioned_revision,
        journal.map.revision()
    );
    assert!(triangulate(&journal.map, id(1)).is_empty(), "all have a position now");
    assert!(window_around(&journal.map, &[id(1)]).landmarks.contains(&id(4)), "by its depth");
}

#[test]
fn a_landmark_that_no_point_explains_stays_without_position_and_hinders_no_other() {
    let mut journal = Journal::new(MapPolicy::default());
    journal.send(ROBOT, &bare(0, &[1, 2, 3], &[1, 2, 3])).unwrap();
    // A wrong match: off the epipolar line by far.
    let wrong = with_last(bare(1, &[1, 2, 3], &[]), |seen| seen.pixel.y += 60.0);
    journal.send(ROBOT, &wrong).unwrap();
    let placed = |positions: &[(EntityId, Vector3<f64>)]| -> Vec<_> {
        positions.iter().map(|&(id, _)| id).collect()
    };
    let positions = triangulate(&journal.map, id(1));
    assert_eq!(placed(&positions), [id(1), id(2)]);
    journal.push(Change::LandmarksTriangulated { positions });
    // One more good view does not make the wrong one fit.
    journal.send(ROBOT, &bare(2, &[1, 2, 3, 4], &[4])).unwrap();
    assert_eq!(triangulate(&journal.map, id(2)), []);
    assert_eq!(
        journal.map.landmarks().get(&id(3)).unwrap().observers.len(),
        3,
        "its observations stay"
    );
    let window = window_around(&journal.map, &[id(2)]);
    assert!(window.landmarks.contains(&id(1)) && !window.landmarks.contains(&id(3)));
}
