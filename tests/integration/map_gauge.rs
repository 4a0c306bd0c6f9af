//! The gauge of a map: its first keyframe stays where it is, to the bit, whatever is solved or changed.

#![allow(clippy::unwrap_used, reason = "helpers of tests fail by panicking")]

use std::collections::{BTreeMap, BTreeSet};

use covis::map::{
    AppliedSolve, Change, ClientIndex, ConstraintKind, Edit, EntityId, EntityRef, Gauge,
    GlobalOptions, Item, Link, Map, MapError, MapPolicy, MapProblem, Reach, SolveKind, Solved,
    SwitchedOff, WhenFull, applied, global_problem, local_problem, observation_problem, retire,
};
use covis_solvers::bundle_adjustment;
use covis_solvers::geometry::{LieGroup, Se3, Sim3};
use covis_solvers::graph_optimization;
use covis_solvers::information::Information;
use covis_solvers::initialization::Start;
use covis_solvers::interrupt::Interrupt;
use covis_solvers::optimizer::ignore_iterations;
use nalgebra::{Vector3, Vector6};

use crate::map_duplicates::{AGAIN, found, twice};
use crate::map_support::{
    Journal, ROBOT, fix, graph_problem, id, pose_at, relative_pose, solve_of, street,
    street_keyframe, window_around,
};

/// The bits of a keyframe's pose.
fn bits(map: &Map, keyframe: EntityId) -> [u64; 7] {
    let pose = map.keyframes().get(&keyframe).unwrap().world_from_camera;
    let (t, q) = (pose.translation, pose.rotation.quaternion());
    [t.x, t.y, t.z, q.i, q.j, q.k, q.w].map(f64::to_bits)
}

/// Solves bundle adjustment; a problem without anything to move stays as it is.
fn bundle(problem: &mut MapProblem) {
    if problem.is_solvable() {
        let options = bundle_adjustment::Options::default();
        bundle_adjustment::solve(&mut problem.problem, &options, &mut ignore_iterations).unwrap();
    }
}

fn take(journal: &mut Journal, solved: Solved<'_>, kind: SolveKind) {
    let solve = applied(&journal.map, solved, kind, Vec::new(), (2.0, 1.0), Reach::All);
    journal.map.keeps_gauge(solved.gauge(&journal.map), &solve).unwrap();
    journal.push(Change::SolveApplied { solve });
}

/// Bundle adjustment of the window around keyframes; answers how many keyframes it moved.
fn window(journal: &mut Journal, centers: &[EntityId]) -> usize {
    let mut problem = local_problem(&journal.map, &window_around(&journal.map, centers));
    bundle(&mut problem);
    take(journal, Solved::Bundle(&problem), SolveKind::LocalBundle);
    problem.problem.constant_poses.iter().filter(|&&constant| !constant).count()
}

fn global(journal: &mut Journal, gauge: Gauge) {
    let options = GlobalOptions { gauge, ..GlobalOptions::default() };
    let mut problem = global_problem(&journal.map, &options);
    bundle(&mut problem);
    take(journal, Solved::Bundle(&problem), SolveKind::Global);
}

fn graph(journal: &mut Journal, gauge: Gauge) {
    let mut problem = graph_problem(&journal.map, gauge, |_, _| None);
    let options = graph_optimization::Options {
        start: Start::Odometry,
        ..graph_optimization::Options::default()
    };
    let never = Interrupt::NEVER;
    let rows = &mut ignore_iterations;
    graph_optimization::optimize(&mut problem.graph, true, &options, &never, rows).unwrap();
    take(journal, Solved::Graph(&problem), SolveKind::PoseGraph);
}

/// The estimates of a reconstruction, which holds nothing and has a frame of its own.
fn rebuild(journal: &mut Journal) {
    let mut problem = observation_problem(&journal.map);
    let turned = Se3::exp(&Vector6::new(0.3, -0.2, 0.1, 0.02, 0.01, -0.03));
    problem.problem.poses.iter_mut().for_each(|pose| *pose = turned.compose(pose));
    problem.problem.landmarks.iter_mut().for_each(|point| *point = turned.transform(point));
    take(journal, Solved::Bundle(&problem), SolveKind::Global);
}

/// Every solve of a map, windows around each keyframe and around the ends of each closure included.
fn every_solve(journal: &mut Journal, name: &str, first: EntityId) {
    let before = bits(&journal.map, first);
    let stays = |journal: &Journal, solve: &str| {
        assert_eq!(bits(&journal.map, first), before, "{name}: {solve}");
    };
    let keyframes: Vec<EntityId> = journal.map.keyframes().keys().copied().collect();
    for &center in &keyframes {
        window(journal, &[center]);
        stays(journal, &format!("the window around {center}"));
    }
    let closures = journal.map.constraints().values();
    let closures: Vec<_> = closures.map(|c| [c.keyframe_i, c.keyframe_j]).collect();
    for ends in closures {
        window(journal, &ends);
        stays(journal, &format!("the window around {ends:?}"));
    }
    for gauge in [Gauge::FirstKeyframeFixed, Gauge::FixedPoses] {
        graph(journal, gauge);
        stays(journal, &format!("the pose graph, {gauge:?}"));
        global(journal, gauge);
        stays(journal, &format!("the whole map, {gauge:?}"));
    }
    rebuild(journal);
    stays(journal, "a reconstruction");
}

/// A change of a map, with what it is called.
type Step<'a> = (&'a str, &'a dyn Fn(&mut Journal));

#[test]
fn the_first_keyframe_stays_to_the_bit_in_every_solve_and_after_each_change() {
    let mut journal = twice(0.05);
    let first = id(0);
    let steps: [Step<'_>; 9] = [
        ("a street that was walked twice", &|_| {}),
        ("landmarks that are one point are united", &found),
        ("two of them become one landmark", &|journal| {
            let (kept, absorbed) = (EntityRef::own(12), vec![EntityRef::own(12 + AGAIN)]);
            journal.send(ROBOT, &Item::Edit(Edit::FuseLandmarks { kept, absorbed })).unwrap();
        }),
        ("keyframes that were captured before all others arrive late", &|journal| {
            for late in 0..2 {
                let start = pose_at(late as f64 + 0.02);
                let mut item = street_keyframe(late, start, &journal.map);
                let Item::Keyframe { id, capture_time_ns, .. } = &mut item else { panic!() };
                (*id, *capture_time_ns) = (500 + late, late - 10_000_000);
                journal.send(ROBOT, &item).unwrap();
            }
        }),
        ("a closure is switched off", &|journal| {
            let off = SwitchedOff { chi2: 99.0, weight: 0.0, is_provisional: false };
            let solve = solve_of(SolveKind::PoseGraph);
            let solve = AppliedSolve { switched_off: vec![(id(0), off)], ..solve };
            journal.push(Change::SolveApplied { solve });
        }),
        ("another map becomes part of it", &|journal| {
            let source = street(5, MapPolicy::default()).map;
            let names = BTreeMap::from([("robot".to_owned(), "other".to_owned())]);
            let at = pose_at(0.05);
            let link = Link {
                target: id(1),
                source: id(1),
                target_from_source: pose_at(0.0),
                information: Information::identity(),
            };
            let merge = journal.map.merge_of(("floor", &source), at, &names, &[link]).unwrap();
            journal.push(Change::MapMerged { merge: Box::new(merge) });
        }),
        ("the merge is undone", &|journal| {
            journal.push(Change::MapTakenOut { name: "floor".to_owned(), clients_leave: true });
        }),
        ("another keyframe is removed", &|journal| {
            let keyframe = EntityRef::own(2);
            journal.send(ROBOT, &Item::Edit(Edit::RemoveKeyframe { keyframe })).unwrap();
        }),
        ("the closure is revoked", &|journal| {
            let constraint = EntityRef::own(0);
            journal.send(ROBOT, &Item::Edit(Edit::RevokeConstraint { constraint })).unwrap();
        }),
    ];
    let before = bits(&journal.map, first);
    for (name, change) in steps {
        change(&mut journal);
        assert_eq!(bits(&journal.map, first), before, "{name}");
        assert_eq!(journal.map.first_keyframe(), Some(first), "{name}");
        every_solve(&mut journal, name, first);
    }
    let replayed = Map::replay(journal.events.iter()).unwrap();
    assert_eq!(bits(&replayed, first), before);
}

#[test]
fn windows_move_the_others_around_the_first_keyframe() {
    let mut journal = twice(0.05);
    found(&mut journal);
    let before = bits(&journal.map, id(1));
    let chosen = window_around(&journal.map, &[id(1 + AGAIN)]);
    assert!(chosen.fixed.contains(&id(0)) && chosen.free.contains(&id(1)), "{chosen:?}");
    assert!(window(&mut journal, &[id(1 + AGAIN)]) > 0);
    assert_ne!(bits(&journal.map, id(1)), before);
    // A gauge that holds nothing frees it; the rim of the window is held all the same.
    let policy = MapPolicy { gauge: Gauge::Free, window_keyframes: 3, ..MapPolicy::default() };
    let free = street(8, policy);
    assert!(window_around(&free.map, &[id(0)]).free.contains(&id(0)));
}

#[test]
fn the_first_keyframe_is_the_one_that_arrived_first() {
    let mut journal = Journal::new(MapPolicy::default());
    for index in [3, 4, 2, 1, 0] {
        let start = pose_at(index as f64).plus(&(0.01 * index as f64 * Vector6::repeat(1.0)));
        let item = street_keyframe(index, start, &journal.map);
        journal.send(ROBOT, &item).unwrap();
    }
    assert_eq!(journal.map.first_keyframe(), Some(id(3)));
    assert_eq!(journal.map.held_keyframes(Gauge::default()), [id(3)]);
    let constant = vec![false, false, false, true, false];
    let options = GlobalOptions::default();
    assert_eq!(global_problem(&journal.map, &options).problem.constant_poses, constant);
    let problem = graph_problem(&journal.map, Gauge::Free, |_, _| None);
    assert_eq!(problem.graph.constant, constant, "a pose graph has no other frame");
    every_solve(&mut journal, "keyframes in another order", id(3));
}

#[test]
fn a_map_that_makes_room_holds_the_next_keyframe_where_it_is() {
    let mut journal = twice(0.05);
    found(&mut journal);
    // Solves that began while keyframe 0 was there.
    let mut window = local_problem(&journal.map, &window_around(&journal.map, &[id(1)]));
    let mut whole = global_problem(&journal.map, &GlobalOptions::default());
    let mut graph = graph_problem(&journal.map, Gauge::default(), |_, _| None);
    bundle(&mut window);
    bundle(&mut whole);
    let turned = Se3::exp(&Vector6::new(0.3, -0.2, 0.1, 0.02, 0.01, -0.03));
    let graph_poses = graph.graph.poses.iter_mut();
    graph_poses.skip(1).for_each(|pose| *pose = turned.compose(pose));

    let retired = retire(&journal.map).unwrap();
    assert_eq!(retired.keyframe, id(0));
    journal.push(Change::KeyframeRetired { retired });
    let before = bits(&journal.map, id(1));
    let pose = |map: &Map, id: EntityId| map.keyframes().get(&id).unwrap().world_from_camera;
    let between = |map: &Map| pose(map, id(1)).inverse().compose(&pose(map, id(3)));

    let mut by_window = journal.clone();
    take(&mut by_window, Solved::Bundle(&window), SolveKind::LocalBundle);
    assert_eq!(bits(&by_window.map, id(1)), before, "in a window it alone keeps its pose");
    let mut by_graph = journal.clone();
    take(&mut by_graph, Solved::Graph(&graph), SolveKind::PoseGraph);
    assert_eq!(bits(&by_graph.map, id(1)), before, "a pose graph is moved onto it");
    let solved = graph.graph.poses[1].inverse().compose(&graph.graph.poses[3]);
    assert!(between(&by_graph.map).minus(&solved).norm() < 1e-12, "and keeps its shape");
    take(&mut journal, Solved::Bundle(&whole), SolveKind::Global);
    assert_eq!(bits(&journal.map, id(1)), before, "and so is the whole map");
    let solved = whole.problem.poses[1].inverse().compose(&whole.problem.poses[3]);
    assert!(between(&journal.map).minus(&solved).norm() < 1e-12);
    let at = |map: &Map| {
        let landmark = map.landmarks().get(&id(25)).unwrap().position.unwrap();
        pose(map, id(1)).inverse_transform(&landmark)
    };
    let index = whole.landmarks.binary_search(&id(25)).unwrap();
    let solved = whole.problem.poses[1].inverse_transform(&whole.problem.landmarks[index]);
    assert!((at(&journal.map) - solved).norm() < 1e-12, "landmarks move with it");
    every_solve(&mut journal, "after the first keyframe has gone", id(1));
}

#[test]
fn priors_take_the_place_of_the_first_keyframe_unless_it_is_to_be_held_beside_them() {
    let mut journal = street(4, MapPolicy::default());
    journal.send(ROBOT, &fix(1, 2, Vector3::new(2.0, 0.3, 0.0))).unwrap();
    for gauge in [Gauge::FirstKeyframeFixed, Gauge::Free, Gauge::Priors] {
        assert_eq!(journal.map.held_keyframes(gauge), [], "{gauge:?}");
    }
    assert_eq!(journal.map.held_keyframes(Gauge::FixedPoses), [id(0)]);
    let before = bits(&journal.map, id(0));
    graph(&mut journal, Gauge::FixedPoses);
    assert_eq!(bits(&journal.map, id(0)), before);
    // The solve of a map with priors began before they were revoked.
    let mut problem = graph_problem(&journal.map, Gauge::FirstKeyframeFixed, |_, _| None);
    assert_eq!(problem.frame(Gauge::FirstKeyframeFixed), Gauge::Priors);
    problem.graph.poses.iter_mut().for_each(|pose| *pose = pose_at(0.5).compose(pose));
    let constraint = EntityRef::own(1);
    journal.send(ROBOT, &Item::Edit(Edit::RevokeConstraint { constraint })).unwrap();
    take(&mut journal, Solved::Graph(&problem), SolveKind::PoseGraph);
    assert_eq!(bits(&journal.map, id(0)), before);
    assert_eq!(journal.map.held_keyframes(Gauge::FirstKeyframeFixed), [id(0)]);
}

#[test]
fn each_piece_holds_its_first_keyframe_until_something_ties_it_to_another_one() {
    let mut journal = street(4, MapPolicy::default());
    let other = ClientIndex(1);
    journal.push(Change::ClientOpened { name: "other".to_owned(), epoch: 1 });
    let from = street(4, MapPolicy::default());
    for event in &from.events[2..] {
        let mut change = event.change.clone();
        let move_to = |id: &mut EntityId| id.client = other;
        if let Change::CameraSet { id, .. } = &mut change {
            move_to(id);
        } else if let Change::KeyframeAdded { id, camera, observations, landmarks, .. } =
            &mut change
        {
            move_to(id);
            camera.iter_mut().for_each(move_to);
            observations.iter_mut().for_each(|seen| move_to(&mut seen.landmark));
            landmarks.iter_mut().for_each(|landmark| move_to(&mut landmark.id));
        } else {
            panic!("{change:?}");
        }
        journal.push(change);
    }
    let begin = EntityId::new(other, 0);
    assert_eq!(journal.map.held_keyframes(Gauge::default()), [id(0), begin]);
    let asked = BTreeSet::from([begin, EntityId::new(other, 1)]);
    assert_eq!(journal.map.held_among(Gauge::default(), &asked), [begin]);
    every_solve(&mut journal, "the other piece", begin);
    every_solve(&mut journal, "the first piece", id(0));

    let mut closure = relative_pose(9, ConstraintKind::LoopClosure, 1, 1, pose_at(0.0));
    let Item::RelativePose { keyframe_j, .. } = &mut closure else { panic!() };
    keyframe_j.client = Some("other".to_owned());
    journal.send(ROBOT, &closure).unwrap();
    assert_eq!(journal.map.held_keyframes(Gauge::default()), [id(0)]);
    every_solve(&mut journal, "both pieces", id(0));
}

#[test]
fn a_map_that_is_taken_out_again_has_its_first_keyframe_where_it_was() {
    for scale in [1.0, 0.5] {
        let mut target = street(4, MapPolicy::default());
        let source = street(5, MapPolicy::default()).map;
        let put = bits(&source, id(0));
        let names = BTreeMap::from([("robot".to_owned(), "other".to_owned())]);
        let at = Se3::exp(&Vector6::new(0.3, -0.2, 0.1, 0.2, 0.1, -0.3));
        let merge = target.map.merge_of(
            ("floor", &source),
            Sim3 { scale, ..at.into() },
            &names,
            &[Link {
                target: id(1),
                source: id(2),
                target_from_source: pose_at(0.0),
                information: Information::identity(),
            }],
        );
        target.push(Change::MapMerged { merge: Box::new(merge.unwrap()) });
        let first = target.map.merged()[0].first.unwrap().0;
        let before = bits(&target.map, first);
        graph(&mut target, Gauge::default());
        assert_ne!(bits(&target.map, first), before, "the closure moves it in the target");
        let shape = |map: &Map, [a, b]: [EntityId; 2]| {
            let pose = |id: EntityId| map.keyframes().get(&id).unwrap().world_from_camera;
            pose(a).inverse().compose(&pose(b))
        };
        let there = shape(&target.map, [first, EntityId { id: 3, ..first }]);
        let out = target.map.taken_out("floor").unwrap().unwrap();
        out.check_sound().unwrap();
        assert_eq!(bits(&out, id(0)), put);
        let there = Se3::new(there.rotation, there.translation / scale);
        assert!(shape(&out, [id(0), id(3)]).minus(&there).norm() < 1e-12);
        let replayed = Map::replay(target.events.iter()).unwrap();
        assert_eq!(replayed.merged(), target.map.merged());
    }
}

#[test]
fn a_result_that_moves_what_the_gauge_holds_is_refused_with_the_keyframe() {
    let journal = street(3, MapPolicy::default());
    let poses = vec![(id(0), pose_at(0.1)), (id(1), pose_at(1.1))];
    let solve = AppliedSolve { poses, ..solve_of(SolveKind::LocalBundle) };
    let refused = journal.map.keeps_gauge(Gauge::FirstKeyframeFixed, &solve);
    assert_eq!(refused, Err(MapError::GaugeMoved { keyframe: id(0) }));
    let text = refused.unwrap_err().to_string();
    assert!(text.contains("the gauge holds keyframe"), "{text}");
    journal.map.keeps_gauge(Gauge::Free, &solve).unwrap();
    let poses = vec![(id(0), pose_at(0.0)), (id(1), pose_at(1.1))];
    let stays = AppliedSolve { poses, ..solve_of(SolveKind::Global) };
    journal.map.keeps_gauge(Gauge::FirstKeyframeFixed, &stays).unwrap();
}

#[test]
fn a_problem_says_what_fixes_its_frame() {
    let policy = MapPolicy { window_keyframes: 3, ..MapPolicy::default() };
    let journal = street(8, policy);
    let window =
        |center| local_problem(&journal.map, &window_around(&journal.map, &[id(center)])).frame;
    assert_eq!(window(7), Gauge::FixedPoses, "the keyframes around it");
    let small = street(3, MapPolicy::default());
    let only = local_problem(&small.map, &window_around(&small.map, &[id(2)])).frame;
    assert_eq!(only, Gauge::FirstKeyframeFixed);
    let whole = |map: &Map, gauge| {
        global_problem(map, &GlobalOptions { gauge, ..GlobalOptions::default() }).frame
    };
    assert_eq!(whole(&journal.map, Gauge::FirstKeyframeFixed), Gauge::FirstKeyframeFixed);
    assert_eq!(whole(&journal.map, Gauge::FixedPoses), Gauge::FixedPoses);
    assert_eq!(whole(&journal.map, Gauge::Priors), Gauge::Free, "there are none");
    let policy = MapPolicy { when_full: WhenFull::Reject, odometry: false, ..MapPolicy::default() };
    let mut placed = street(4, policy);
    placed.send(ROBOT, &fix(1, 2, Vector3::new(2.0, 0.0, 0.0))).unwrap();
    // A keyframe without observations is held, and fixes nothing.
    let blind = Item::Keyframe {
        id: 9,
        capture_time_ns: 9_000_000,
        camera: None,
        world_from_camera: pose_at(9.0),
        odom_from_camera: None,
        observations: Vec::new(),
        landmarks: Vec::new(),
        global_descriptor: None,
    };
    placed.send(ROBOT, &blind).unwrap();
    let problem = global_problem(&placed.map, &GlobalOptions::default());
    assert_eq!(problem.frame, Gauge::Priors);
    assert_eq!(problem.problem.constant_poses, [false, false, false, false, true]);
}
