//! What moves while a longer solve runs, and what of its result is worth an event.

#![allow(clippy::unwrap_used, reason = "helpers of tests fail by panicking")]

use std::collections::BTreeSet;

use covis::map::{
    AppliedSolve, Change, ConstraintKind, Gauge, GlobalOptions, MapPolicy, Reach, SolveKind,
    Solved, SwitchedOff, applied, global_problem, region_problem,
};
use covis_solvers::geometry::{LieGroup, Se3};
use nalgebra::{Vector3, Vector6};

use crate::map_support::{
    Journal, ROBOT, corner, graph_problem, id, loop_problem, pose_at, pose_error, relative_pose,
    solve_of, street,
};

const COSTS: (f64, f64) = (1.0, 0.5);

fn motion(by: f64) -> Se3 {
    Se3::identity().plus(&Vector6::new(by, -0.5 * by, 0.2 * by, 0.0, 0.1 * by, 0.0))
}

fn pose(journal: &Journal, k: i64) -> Se3 {
    journal.map.keyframes().get(&id(k)).unwrap().world_from_camera
}

fn position(journal: &Journal, k: i64) -> Vector3<f64> {
    journal.map.landmarks().get(&id(k)).unwrap().position.unwrap()
}

/// A window moves keyframe 5 and a corner that keyframe 5 was the first to see.
fn window_moves_5(journal: &mut Journal) -> Se3 {
    let moved = motion(0.01).compose(&pose_at(5.0));
    let solve = AppliedSolve {
        poses: vec![(id(5), moved)],
        landmarks: vec![(id(65), corner(65) + Vector3::new(0.0, 0.02, 0.0))],
        ..solve_of(SolveKind::LocalBundle)
    };
    journal.push(Change::SolveApplied { solve });
    moved
}

#[test]
fn what_a_window_moved_during_a_pose_graph_goes_along_and_the_rest_is_as_it_was_found() {
    let mut journal = street(8, MapPolicy::default());
    let mut problem = graph_problem(&journal.map, Gauge::default(), |_, _| None);
    let found = |k: i64| motion(0.1 * k as f64).compose(&pose_at(k as f64));
    for k in 1..8 {
        problem.graph.poses[k as usize] = found(k);
    }
    let by_window = window_moves_5(&mut journal);
    let solved = Solved::Graph(&problem);
    let solve = applied(&journal.map, solved, SolveKind::PoseGraph, Vec::new(), COSTS, Reach::All);
    journal.push(Change::SolveApplied { solve });
    for k in [1, 2, 3, 4, 6, 7] {
        assert_eq!(pose(&journal, k), found(k));
    }
    assert_eq!(pose(&journal, 0), pose_at(0.0));
    assert!(pose_error(&pose(&journal, 5), &motion(0.5).compose(&by_window)) < 1e-12);
    // Its corner lies where the window saw it from keyframe 5.
    let seen = by_window.inverse_transform(&(corner(65) + Vector3::new(0.0, 0.02, 0.0)));
    let sees = pose(&journal, 5).inverse_transform(&position(&journal, 65));
    assert!((seen - sees).norm() < 1e-12);
}

#[test]
fn what_a_window_moved_during_an_adjustment_goes_along_with_its_landmarks() {
    let mut journal = street(8, MapPolicy::default());
    let mut problem = global_problem(&journal.map, &GlobalOptions::default());
    let found = |k: i64| motion(0.001 * k as f64).compose(&pose_at(k as f64));
    for k in 1..8 {
        problem.problem.poses[k as usize] = found(k);
    }
    for at in &mut problem.problem.landmarks {
        at.z += 0.03;
    }
    let by_window = window_moves_5(&mut journal);
    let solved = Solved::Bundle(&problem);
    let solve = applied(&journal.map, solved, SolveKind::Global, Vec::new(), COSTS, Reach::All);
    journal.push(Change::SolveApplied { solve });
    let moves = motion(0.005);
    assert!(pose_error(&pose(&journal, 5), &moves.compose(&by_window)) < 1e-12);
    let moved = moves.transform(&(corner(65) + Vector3::new(0.0, 0.02, 0.0)));
    assert!((position(&journal, 65) - moved).norm() < 1e-12);
    // What the window left alone is as the adjustment found it, to the bit.
    assert_eq!(pose(&journal, 4), found(4));
    assert_eq!(position(&journal, 40), corner(40) + Vector3::new(0.0, 0.0, 0.03));
}

#[test]
fn a_window_leaves_to_others_what_they_moved_meanwhile() {
    let mut journal = street(8, MapPolicy::default());
    let mut problem = global_problem(&journal.map, &GlobalOptions::default());
    problem.problem.poses[5] = motion(0.3).compose(&pose_at(5.0));
    problem.problem.poses[6] = motion(0.3).compose(&pose_at(6.0));
    let by_other = window_moves_5(&mut journal);
    let solved = Solved::Bundle(&problem);
    let solve =
        applied(&journal.map, solved, SolveKind::LocalBundle, Vec::new(), COSTS, Reach::All);
    journal.push(Change::SolveApplied { solve });
    assert_eq!(pose(&journal, 5), by_other);
    assert_eq!(pose(&journal, 6), motion(0.3).compose(&pose_at(6.0)));
}

#[test]
fn what_no_measurement_could_notice_is_no_part_of_an_event_of_the_maps_own() {
    let mut journal = street(8, MapPolicy::default());
    let mut problem = graph_problem(&journal.map, Gauge::default(), |_, _| None);
    for k in 1..8 {
        let by = if k < 5 { 1e-5 } else { 0.1 };
        problem.graph.poses[k as usize] = motion(by).compose(&pose_at(f64::from(k)));
    }
    let solved = Solved::Graph(&problem);
    let all = applied(&journal.map, solved, SolveKind::PoseGraph, Vec::new(), COSTS, Reach::All);
    assert_eq!(all.poses.len(), 7);
    let kind = SolveKind::PoseGraph;
    let solve = applied(
        &journal.map,
        solved,
        kind,
        Vec::new(),
        COSTS,
        Reach::Noticeable { if_contradicted: false },
    );
    let moved: Vec<_> = solve.poses.iter().map(|&(id, _)| id).collect();
    assert_eq!(moved, [id(5), id(6), id(7)]);
    // Only their own landmarks follow.
    let reference = |l| journal.map.landmarks().get(&l).unwrap().reference.unwrap();
    assert!(solve.landmarks.iter().all(|&(l, _)| moved.contains(&reference(l))));
    assert!(solve.landmarks.iter().any(|&(l, _)| l == id(65)));
    assert!(journal.map.moves_far(&solve, |k| k == id(6)));
    assert!(!journal.map.moves_far(&solve, |k| k == id(3)));
    journal.push(Change::SolveApplied { solve });
    assert_eq!(pose(&journal, 3), pose_at(3.0));
}

#[test]
fn a_region_is_held_by_what_is_around_it_and_most_of_a_map_is_no_region() {
    let mut journal = street(16, MapPolicy::default());
    let closure = relative_pose(0, ConstraintKind::LoopClosure, 1, 12, pose_at(11.0));
    journal.send(ROBOT, &closure).unwrap();
    let region = |ids: std::ops::Range<i64>| ids.map(id).collect::<BTreeSet<_>>();
    let problem = region_problem(&journal.map, &region(11..14)).unwrap();
    let constant = problem.keyframes.iter().zip(&problem.problem.constant_poses);
    let free: Vec<_> = constant.filter(|&(_, &held)| !held).map(|(&id, _)| id).collect();
    assert_eq!(free, [id(11), id(12), id(13)]);
    // Three to each side share corners; the closure ties keyframe 1.
    let held: Vec<_> = problem.keyframes.iter().filter(|id| !free.contains(id)).collect();
    assert_eq!(held, [1, 8, 9, 10, 14, 15].map(id).iter().collect::<Vec<_>>());
    // The first keyframe stays where it is.
    let problem = region_problem(&journal.map, &region(0..3)).unwrap();
    assert!(
        problem.problem.constant_poses[problem.keyframes.iter().position(|k| *k == id(0)).unwrap()]
    );
    assert!(region_problem(&journal.map, &region(0..9)).is_none());
    assert!(region_problem(&journal.map, &region(90..99)).is_none());
}

#[test]
fn a_pose_graph_whose_closures_fit_the_map_moves_nothing() {
    for (off, is_contradicted) in [(0.0, false), (0.3, true)] {
        let mut journal = street(8, MapPolicy::default());
        let measured = pose_at(7.0 + off);
        journal
            .send(ROBOT, &relative_pose(0, ConstraintKind::LoopClosure, 0, 7, measured))
            .unwrap();
        let mut problem = loop_problem(&journal.map, |_, _| None);
        // The graph's own optimum is elsewhere, as it is beside bundle adjustment.
        for k in 1..8 {
            let at = pose_at(k as f64 * (1.0 + off / 7.0));
            problem.graph.poses[k] = at.plus(&Vector6::new(0.0, 0.0, 0.0, 0.0, 0.001, 0.0));
        }
        assert_eq!(problem.contradicts(&journal.map), is_contradicted);
        let (solved, kind) = (Solved::Graph(&problem), SolveKind::PoseGraph);
        let moved = |if_contradicted| {
            let reach = Reach::Noticeable { if_contradicted };
            let solve = applied(&journal.map, solved, kind, Vec::new(), COSTS, reach);
            !solve.poses.is_empty() && !solve.landmarks.is_empty()
        };
        assert_eq!(moved(true), is_contradicted);
        assert!(moved(false), "an edit moves it in any case");
        // A verdict is a reason too.
        let switched_off = Some(SwitchedOff { chi2: 30.0, weight: 0.0, is_provisional: false });
        problem.closures[0].switched_off = switched_off;
        assert!(problem.contradicts(&journal.map));
    }
}
