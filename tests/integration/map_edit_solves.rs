//! Edits of a map and solves: what an edit asks to be solved again, and that a solve which ran meanwhile
//! leaves alone what was edited.

#![allow(clippy::unwrap_used, reason = "helpers of tests fail by panicking")]

use covis::map::{
    Affected, AppliedSolve, Change, ConstraintKind, Edit, GlobalOptions, Item, ItemLandmark,
    MapPolicy, Reach, SolveKind, Solved, SwitchedOff, affected, applied, global_problem,
};
use covis_solvers::geometry::{Camera, Snavely};
use nalgebra::Vector3;

use crate::map_edits::{fuse, own, remove_keyframe, revoke, send, set_camera, sighting};
use crate::map_fold::assert_consistent;
use crate::map_support::{
    Journal, ROBOT, fix, id, loop_problem, pinhole, pose_at, relative_pose, solve_of, street,
    street_keyframe, window_around,
};

/// What the next edit of a street asks to be solved.
fn asked(journal: &Journal, edit: Edit) -> Affected {
    let change = journal.map.check(ROBOT, &Item::Edit(edit)).unwrap();
    affected(&journal.map, &change).unwrap()
}

#[test]
fn an_edit_asks_for_its_keyframes_and_a_closure_or_prior_for_the_graph() {
    let mut journal = street(8, MapPolicy::default());
    let closure = relative_pose(7, ConstraintKind::LoopClosure, 0, 6, pose_at(6.0));
    journal.send(ROBOT, &closure).unwrap();
    journal.send(ROBOT, &relative_pose(8, ConstraintKind::Odometry, 0, 1, pose_at(1.0))).unwrap();
    let keyframes = |ids: &[i64]| ids.iter().map(|&k| id(k)).collect::<Vec<_>>();
    // Keyframe k sees the corners from 10 k - 20 to 10 k + 20.
    let graph = |graph, ids: &[i64]| Affected { graph, keyframes: keyframes(ids) };
    assert_eq!(asked(&journal, revoke(7)), graph(true, &[]));
    assert_eq!(asked(&journal, revoke(8)), graph(false, &[]));
    let observations = vec![sighting(3, 30), sighting(1, 10)];
    assert_eq!(asked(&journal, Edit::RemoveObservations { observations }), graph(false, &[1, 3]));
    assert_eq!(asked(&journal, fuse(0, [35])), graph(false, &[0, 1, 2, 3, 4, 5]));
    let landmarks = own([35]);
    assert_eq!(asked(&journal, Edit::RemoveLandmarks { landmarks }), graph(false, &[2, 3, 4, 5]));
    assert_eq!(asked(&journal, remove_keyframe(6)), graph(true, &[0, 3, 4, 5, 7]));
    assert_eq!(asked(&journal, remove_keyframe(3)), graph(false, &[0, 1, 2, 4, 5, 6]));
    let camera = asked(&journal, set_camera(pinhole()));
    assert_eq!(camera, graph(false, &[0, 1, 2, 3, 4, 5, 6, 7]));
    // A closure that does not count asks for nothing.
    let mut solve = AppliedSolve {
        switched_off: vec![(id(7), SwitchedOff { chi2: 50.0, weight: 0.0, is_provisional: false })],
        ..solve_of(SolveKind::PoseGraph)
    };
    journal.push(Change::SolveApplied { solve: solve.clone() });
    assert_eq!(asked(&journal, revoke(7)), graph(false, &[]));
    assert_eq!(asked(&journal, remove_keyframe(6)), graph(false, &[3, 4, 5, 7]));
    // A prior is like a closure.
    journal.send(ROBOT, &fix(9, 6, Vector3::zeros())).unwrap();
    assert_eq!(asked(&journal, revoke(9)), graph(true, &[]));
    assert_eq!(asked(&journal, remove_keyframe(6)), graph(true, &[3, 4, 5, 7]));
    solve.switched_off[0].0 = id(9);
    journal.push(Change::SolveApplied { solve: solve.clone() });
    assert_eq!(asked(&journal, revoke(9)), graph(false, &[]));
    assert_eq!(asked(&journal, remove_keyframe(6)), graph(false, &[3, 4, 5, 7]));
    solve.switched_off.clear();
    assert_eq!(affected(&journal.map, &Change::SolveApplied { solve }), None);
    // Their window holds all of them, however small the policy makes it.
    let small = MapPolicy { window_keyframes: 2, ..MapPolicy::default() };
    journal.push(Change::MapUpdated { display_name: None, policy: Some(small), frozen: None });
    let window = window_around(&journal.map, &keyframes(&[2, 3, 99, 4]));
    assert_eq!(window.free, keyframes(&[2, 3, 4]));
    assert!(window_around(&journal.map, &keyframes(&[99])).free.is_empty());
}

#[test]
fn a_solve_leaves_alone_what_was_edited_while_it_ran() {
    let mut journal = street(6, MapPolicy::default());
    let closure = relative_pose(7, ConstraintKind::LoopClosure, 0, 5, pose_at(5.0));
    journal.send(ROBOT, &closure).unwrap();
    let options = GlobalOptions { fix_intrinsics: false, ..GlobalOptions::default() };
    let mut bundle = global_problem(&journal.map, &options);
    let mut graph = loop_problem(&journal.map, |_, _| None);
    // What solvers would have made of them.
    for pose in bundle.problem.poses.iter_mut().chain(&mut graph.graph.poses) {
        pose.translation.y += 1.0;
    }
    for landmark in &mut bundle.problem.landmarks {
        landmark.y += 1.0;
    }
    bundle.problem.cameras[0] = Camera::Snavely(Snavely { focal: 123.0, k1: 0.0, k2: 0.0 });
    graph.closures[0].switched_off =
        Some(SwitchedOff { chi2: 99.0, weight: 0.0, is_provisional: false });

    let merge = |journal: &Journal| {
        let map = &journal.map;
        let bundle = applied(
            map,
            Solved::Bundle(&bundle),
            SolveKind::Global,
            Vec::new(),
            (2.0, 1.0),
            Reach::All,
        );
        let graph = applied(
            map,
            Solved::Graph(&graph),
            SolveKind::PoseGraph,
            Vec::new(),
            (2.0, 1.0),
            Reach::All,
        );
        for solve in [bundle.clone(), graph.clone()] {
            let mut journal = journal.clone();
            journal.push(Change::SolveApplied { solve });
            assert_consistent(&journal.map);
        }
        (bundle, graph)
    };
    let (bundle_before, graph_before) = merge(&journal);
    assert_eq!((bundle_before.cameras.len(), graph_before.switched_off.len()), (1, 1));
    assert!(bundle_before.poses.iter().any(|(k, _)| *k == id(2)));

    let item = |start| street_keyframe(2, pose_at(start), &journal.map);
    let again = item(2.0);
    send(&mut journal, remove_keyframe(2));
    send(&mut journal, Edit::RemoveLandmarks { landmarks: own([12, 13]) });
    send(&mut journal, fuse(14, [15]));
    send(&mut journal, revoke(7));
    send(&mut journal, set_camera(Camera::Snavely(Snavely { focal: 450.0, k1: 0.0, k2: 0.0 })));
    let (solve, verdicts) = merge(&journal);
    assert!(solve.poses.iter().all(|(k, _)| *k != id(2)));
    assert!(solve.landmarks.iter().all(|(l, _)| ![id(12), id(13), id(15)].contains(l)));
    assert!(solve.landmarks.iter().any(|(l, _)| *l == id(14)));
    assert_eq!((solve.cameras.len(), verdicts.switched_off.len()), (0, 0));

    // The same ids again: they are new, and move with their reference, if at all.
    let landmarks = vec![ItemLandmark { id: 12, position: Some(Vector3::new(9.0, 9.0, 9.0)) }];
    journal.send(ROBOT, &Item::Landmarks { landmarks }).unwrap();
    let Item::Keyframe { world_from_camera, capture_time_ns, camera, .. } = again else {
        unreachable!()
    };
    let again = Item::Keyframe {
        id: 2,
        capture_time_ns,
        camera,
        world_from_camera,
        odom_from_camera: None,
        observations: Vec::new(),
        landmarks: Vec::new(),
        global_descriptor: None,
    };
    journal.send(ROBOT, &again).unwrap();
    journal
        .send(ROBOT, &relative_pose(7, ConstraintKind::LoopClosure, 0, 4, pose_at(9.0)))
        .unwrap();
    let (solve, verdicts) = merge(&journal);
    assert!(solve.landmarks.iter().all(|(l, _)| *l != id(12)), "nothing sees it");
    let moved = solve.poses.iter().find(|(k, _)| *k == id(2)).map(|(_, pose)| pose.translation);
    let by_one = pose_at(2.0).translation + Vector3::new(0.0, 1.0, 0.0);
    assert!((moved.unwrap() - by_one).norm() < 1e-12, "as keyframe 1 moved: {moved:?}");
    assert!(verdicts.switched_off.is_empty(), "the verdict is on another closure");
    // The very same closure again is the one that was judged.
    send(&mut journal, revoke(7));
    journal.send(ROBOT, &closure).unwrap();
    let (_, verdicts) = merge(&journal);
    assert_eq!(verdicts.switched_off.len(), 1);
}
