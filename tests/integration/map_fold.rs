//! The fold: the same journal gives the same bits, counts stay true, a bad event leaves no trace.

#![allow(clippy::unwrap_used, reason = "helpers of tests fail by panicking")]

use std::collections::BTreeMap;

use covis::map::{
    AppliedSolve, Cause, Change, ClientIndex, ConstraintKind, Depth, EntityId, EntityKind, Event,
    GlobalOptions, Item, Map, MapError, MapParts, MapPolicy, MeasuredPosition, Recall, SolveKind,
    SwitchedOff, WhenFull, global_problem, retire, triangulate,
};
use covis_solvers::geometry::{LieGroup, Se3};
use covis_solvers::information::Information;
use covis_solvers::loss::Loss;
use covis_solvers::testing::random::{normal_vector, seeded};
use nalgebra::Vector3;
use rand::RngExt as _;

use crate::map_support::{
    Journal, ROBOT, assert_covisibility, corner, id, loop_problem, observe, pixel, pose_at,
    relative_pose, solve_of, street, street_keyframe,
};

/// One random, valid step.
fn step(journal: &mut Journal, rng: &mut impl rand::Rng, n: i64) {
    let map = &journal.map;
    let pick = |rng: &mut dyn rand::Rng, ids: Vec<EntityId>| -> Option<EntityId> {
        if ids.is_empty() { None } else { Some(ids[rng.random_range(0..ids.len())]) }
    };
    let keyframe = pick(rng, map.keyframes().keys().copied().collect());
    let landmark = pick(rng, map.landmarks().keys().copied().collect());
    match (rng.random_range(0..21), keyframe, landmark) {
        (0..=6, _, _) | (_, None, _) | (_, _, None) => {
            let center = rng.random_range(0..12);
            let tangent = normal_vector::<6>(rng, 0.05);
            let start = pose_at(center as f64).plus(&tangent);
            let Item::Keyframe { camera, observations, mut landmarks, .. } =
                street_keyframe(center, start, map)
            else {
                unreachable!()
            };
            // Some landmarks come without a position, some observations with a depth.
            landmarks.iter_mut().filter(|l| l.id % 3 == 0).for_each(|l| l.position = None);
            let mut observations = observations;
            for observation in observations.iter_mut().filter(|o| o.landmark.id % 7 == 0) {
                observation.depth = Some(Depth { depth_m: 6.0, sigma_m: 0.1 });
            }
            let item = Item::Keyframe {
                id: n,
                capture_time_ns: rng.random_range(0..1000),
                camera,
                world_from_camera: start,
                odom_from_camera: None,
                observations,
                landmarks,
                global_descriptor: None,
            };
            journal.send(ROBOT, &item).unwrap();
        }
        (7, Some(i), _) => {
            let j = pick(rng, journal.map.keyframes().keys().copied().collect()).unwrap();
            if i != j {
                let item =
                    relative_pose(n, ConstraintKind::Other, i.id, j.id, pose_at(rng.random()));
                journal.send(ROBOT, &item).unwrap();
            }
        }
        (8, Some(k), _) => {
            let keyframe = covis::map::EntityRef::own(k.id);
            let item = if n % 2 == 0 {
                Item::PosePrior {
                    id: n,
                    keyframe,
                    world_from_camera: pose_at(rng.random()),
                    information: Information::identity(),
                    loss: Loss::Huber(1.0),
                }
            } else {
                Item::PositionPrior {
                    id: n,
                    keyframe,
                    position: MeasuredPosition::InWorld(normal_vector(rng, 1.0)),
                    point_in_camera: normal_vector(rng, 1.0),
                    information: Information::identity(),
                    loss: Loss::Trivial,
                }
            };
            journal.send(ROBOT, &item).unwrap();
        }
        (9 | 10, Some(k), _) => {
            let positions = triangulate(&journal.map, k);
            journal.push(Change::LandmarksTriangulated { positions });
        }
        (11 | 12, Some(k), Some(l)) => {
            let solve = AppliedSolve {
                poses: vec![(k, pose_at(1.0).plus(&normal_vector(rng, 0.1)))],
                landmarks: vec![(l, normal_vector(rng, 5.0))],
                covered: vec![(ROBOT, n)],
                ..solve_of(SolveKind::LocalBundle)
            };
            journal.push(Change::SolveApplied { solve });
        }
        (13, Some(k), Some(l)) => {
            let seen = journal.map.keyframes().get(&k).unwrap().observation_of(l).is_some();
            if seen {
                journal.push(Change::ObservationsRemoved { observations: vec![(k, l)] });
            }
        }
        (14, _, Some(l)) => {
            let other = pick(rng, journal.map.landmarks().keys().copied().collect()).unwrap();
            if other != l {
                journal.push(Change::LandmarksFused { kept: l, absorbed: vec![other] });
            }
        }
        (15, _, Some(l)) => journal.push(Change::LandmarksRemoved { landmarks: vec![l] }),
        (16, Some(k), _) => journal.push(Change::KeyframeRemoved { keyframe: k }),
        (17, _, _) => {
            let constraints = journal.map.constraints().keys();
            let ids = constraints.chain(journal.map.priors().keys()).copied().collect();
            if let Some(id) = pick(rng, ids) {
                journal.push(Change::ConstraintRevoked { id });
            }
        }
        (18, Some(k), Some(l)) => {
            let keyframe = &journal.map.keyframes().get(&k).unwrap();
            if keyframe.observation_of(l).is_none() {
                let mut sent = observe(l.id, &pose_at(0.0), &corner(0));
                sent.pixel = pixel(rng.random(), rng.random());
                let keyframe = covis::map::EntityRef::own(k.id);
                // The landmark may happen to have no finite projection; that is not at issue here.
                let _ =
                    journal.send(ROBOT, &Item::Observations { keyframe, observations: vec![sent] });
            }
        }
        (19, _, _) => {
            if let Some(retired) = retire(&journal.map) {
                journal.push(Change::KeyframeRetired { retired });
            }
        }
        _ => {
            let when_full = WhenFull::Marginalize;
            let policy = MapPolicy { window_keyframes: 5, when_full, ..MapPolicy::default() };
            let policy = Some(policy);
            journal.push(Change::MapUpdated { display_name: None, policy, frozen: None });
        }
    }
}

/// Everything that is kept incrementally, from scratch.
pub(crate) fn assert_consistent(map: &Map) {
    assert_covisibility(map);
    let count: usize = map.keyframes().values().map(|k| k.observations.len()).sum();
    assert_eq!(map.observation_count(), count as u64);
    let mut observers: BTreeMap<EntityId, Vec<EntityId>> = BTreeMap::new();
    for (&keyframe, entity) in map.keyframes() {
        for observation in entity.observations.iter() {
            observers.entry(observation.landmark).or_default().push(keyframe);
        }
    }
    for (id, landmark) in map.landmarks() {
        let expected = observers.remove(id).unwrap_or_default();
        assert_eq!(*landmark.observers, expected, "landmark {id}");
        assert_eq!(landmark.reference.is_some(), !expected.is_empty(), "landmark {id}");
        assert!(landmark.reference.is_none_or(|r| expected.contains(&r)), "landmark {id}");
    }
    assert!(observers.is_empty(), "observations of removed landmarks: {observers:?}");
    for constraint in map.constraints().values() {
        assert!(map.keyframes().contains_key(&constraint.keyframe_i));
        assert!(map.keyframes().contains_key(&constraint.keyframe_j));
    }
}

#[test]
fn replaying_a_random_journal_gives_the_same_bits() {
    for seed in 0..12 {
        let mut rng = seeded(seed);
        let mut journal = Journal::new(MapPolicy::default());
        for n in 0..250 {
            step(&mut journal, &mut rng, n);
            if n % 25 == 0 {
                assert_consistent(&journal.map);
            }
        }
        assert_consistent(&journal.map);
        assert!(!journal.map.keyframes().is_empty(), "seed {seed} tests nothing");
        let replayed = Map::replay(journal.events.iter()).unwrap();
        assert_eq!(replayed.state_hash(), journal.map.state_hash(), "seed {seed}");
        assert_eq!(replayed, journal.map, "seed {seed}");
    }
}

#[test]
fn the_hash_sees_the_last_bit_of_a_pose_and_of_a_landmark() {
    let journal = street(3, MapPolicy::default());
    let nudge = |poses: Vec<(EntityId, Se3)>, landmarks: Vec<(EntityId, Vector3<f64>)>| {
        let mut journal = journal.clone();
        journal.push(Change::SolveApplied {
            solve: AppliedSolve { poses, landmarks, ..solve_of(SolveKind::Global) },
        });
        journal.map.state_hash()
    };
    let unchanged = nudge(Vec::new(), Vec::new());
    assert_eq!(unchanged, nudge(vec![(id(1), pose_at(1.0))], vec![(id(5), corner(5))]));
    let next = f64::from_bits(1.0_f64.to_bits() + 1);
    assert_ne!(unchanged, nudge(vec![(id(1), pose_at(next))], Vec::new()));
    let mut point = corner(5);
    point.y = f64::from_bits(point.y.to_bits() + 1);
    assert_ne!(unchanged, nudge(Vec::new(), vec![(id(5), point)]));
}

#[test]
fn the_odometry_pose_is_kept_and_hashed_and_no_solve_moves_it() {
    let with = |odom: Option<Se3>| {
        let mut journal = Journal::new(MapPolicy::default());
        let mut item = street_keyframe(1, pose_at(1.0), &journal.map);
        let Item::Keyframe { odom_from_camera, .. } = &mut item else { unreachable!() };
        *odom_from_camera = odom;
        journal.send(ROBOT, &item).unwrap();
        (journal, item)
    };
    let (bare, bare_item) = with(None);
    let (written, written_item) = with(Some(pose_at(1.0)));
    assert_eq!(bare.map.state_hash(), written.map.state_hash(), "the default, written out");
    assert!(bare.map.holds(ROBOT, &written_item));
    let (mut apart, _) = with(Some(pose_at(5.0)));
    assert_ne!(bare.map.state_hash(), apart.map.state_hash());
    assert!(!apart.map.holds(ROBOT, &bare_item));
    assert_eq!(apart.map.keyframes().get(&id(1)).unwrap().map_from_odom(), pose_at(-4.0));
    let solve = AppliedSolve { poses: vec![(id(1), pose_at(1.5))], ..solve_of(SolveKind::Global) };
    apart.push(Change::SolveApplied { solve });
    let keyframe = &apart.map.keyframes().get(&id(1)).unwrap();
    assert_eq!(keyframe.odom_from_camera, pose_at(5.0));
    assert_eq!(keyframe.map_from_odom(), pose_at(-3.5));
}

#[test]
fn an_event_that_does_not_fit_is_refused_and_changes_nothing() {
    let journal = street(3, MapPolicy::default());
    let revision = journal.map.revision() + 1;
    let event = |change| Event { revision, time_ns: 0, cause: None, change };
    let solve = |poses, landmarks| AppliedSolve { poses, landmarks, ..solve_of(SolveKind::Global) };
    let triangulated = |id| Change::LandmarksTriangulated { positions: vec![(id, corner(1))] };
    let nan = Se3::new(pose_at(0.0).rotation, Vector3::new(f64::NAN, 0.0, 0.0));
    let unknown = |kind, id| MapError::Unknown { revision, kind, id };
    let repeated = journal.events.iter().find(|e| matches!(e.change, Change::KeyframeAdded { .. }));
    let repeated = repeated.unwrap().change.clone();
    let mut blind = repeated.clone();
    if let Change::KeyframeAdded { id: new, camera, .. } = &mut blind {
        (*new, *camera) = (id(8), None);
    }
    let mut astray = repeated.clone();
    if let Change::KeyframeAdded { id: new, odom_from_camera, .. } = &mut astray {
        (*new, odom_from_camera.translation.x) = (id(8), f64::NAN);
    }
    // Depths divide in the solver.
    let mut touching = repeated.clone();
    let mut touched = id(0);
    if let Change::KeyframeAdded { id: new, observations, .. } = &mut touching {
        *new = id(8);
        observations[0].depth = Some(Depth { depth_m: 0.0, sigma_m: 0.01 });
        touched = observations[0].landmark;
    }
    let stale = Cause { client: ROBOT, epoch: 2, sequence: 99, digest: [0; 32] };
    let cases = [
        (
            Event { revision: revision + 1, ..event(triangulated(id(1))) },
            MapError::RevisionGap { expected: revision, actual: revision + 1 },
        ),
        (
            event(Change::Created {
                policy: MapPolicy::default(),
                create_time_ns: 0,
                display_name: String::new(),
            }),
            MapError::Creation { revision },
        ),
        (event(triangulated(id(9999))), unknown(EntityKind::Landmark, id(9999))),
        (
            // The first pose is fine: nothing of a bad event may take effect.
            event(Change::SolveApplied {
                solve: solve(vec![(id(0), pose_at(0.5)), (id(77), pose_at(0.0))], Vec::new()),
            }),
            unknown(EntityKind::Keyframe, id(77)),
        ),
        (
            event(Change::SolveApplied { solve: solve(vec![(id(0), nan)], Vec::new()) }),
            MapError::ImpossibleNumber { revision, kind: EntityKind::Keyframe, id: id(0) },
        ),
        (event(blind), MapError::NoCamera { revision, keyframe: id(8) }),
        (
            event(astray),
            MapError::ImpossibleNumber { revision, kind: EntityKind::Keyframe, id: id(8) },
        ),
        (
            event(touching),
            MapError::ImpossibleNumber { revision, kind: EntityKind::Observation, id: touched },
        ),
        (event(repeated), MapError::Exists { revision, kind: EntityKind::Keyframe, id: id(0) }),
        (event(Change::ConstraintRevoked { id: id(3) }), unknown(EntityKind::Constraint, id(3))),
        (
            event(Change::ClientOpened { name: "robot".to_owned(), epoch: 1 }),
            MapError::Epoch { revision, newest: 1, actual: 1 },
        ),
        (
            Event { cause: Some(stale), ..event(triangulated(id(1))) },
            MapError::Epoch { revision, newest: 1, actual: 2 },
        ),
        (
            Event {
                cause: Some(Cause { epoch: 1, sequence: 1, ..stale }),
                ..event(triangulated(id(1)))
            },
            MapError::SequenceTaken { revision, client: ROBOT, sequence: 1 },
        ),
        (
            Event {
                cause: Some(Cause { client: ClientIndex(4), ..stale }),
                ..event(triangulated(id(1)))
            },
            MapError::UnknownClient { revision, client: ClientIndex(4) },
        ),
    ];
    for (event, expected) in cases {
        let mut map = journal.map.clone();
        assert_eq!(map.apply(&event), Err(expected));
        assert_eq!(map, journal.map);
    }
    assert!(matches!(
        Map::new().apply(&Event {
            revision: 1,
            time_ns: 0,
            cause: None,
            change: Change::ClientOpened { name: "robot".to_owned(), epoch: 1 },
        }),
        Err(MapError::Creation { revision: 1 })
    ));
}

/// An event that switches constraint 7 off or on.
fn verdict(off: Option<SwitchedOff>) -> Change {
    let solve = AppliedSolve {
        switched_off: off.map(|off| (id(7), off)).into_iter().collect(),
        switched_on: if off.is_none() { vec![id(7)] } else { Vec::new() },
        ..solve_of(SolveKind::PoseGraph)
    };
    Change::SolveApplied { solve }
}

#[test]
fn a_switched_off_closure_is_state_and_takes_part_in_no_bundle() {
    let mut journal = street(3, MapPolicy { odometry: false, ..MapPolicy::default() });
    let closure = relative_pose(7, ConstraintKind::LoopClosure, 0, 2, pose_at(9.0));
    journal.send(ROBOT, &closure).unwrap();
    let factors = |journal: &Journal| {
        let problem = global_problem(&journal.map, &GlobalOptions::default());
        problem.problem.relative_poses.len()
    };
    assert_eq!(factors(&journal), 1);
    let off = SwitchedOff { chi2: 900.0, weight: 0.0, is_provisional: false };
    let hash = |off| {
        let mut journal = journal.clone();
        journal.push(verdict(off));
        journal.map.state_hash()
    };
    assert_ne!(hash(Some(off)), hash(None));
    assert_ne!(hash(Some(off)), hash(Some(SwitchedOff { chi2: 901.0, ..off })));
    journal.push(verdict(Some(off)));
    assert_eq!(journal.map.switched_off().get(&id(7)), Some(&off));
    assert_eq!((factors(&journal), journal.map.active_constraints().count()), (0, 0));
    // What was sent is unchanged, and the graph keeps the edge for a later verdict.
    assert!(journal.map.holds(ROBOT, &closure));
    let problem = loop_problem(&journal.map, |_, _| None);
    assert_eq!(problem.closures.len(), 1);
    assert_eq!(problem.closures[0].switched_off, Some(off));
    assert_eq!(problem.trusted().len() + 1, problem.graph.edges.len());
    let replayed = Map::replay(journal.events.iter()).unwrap();
    assert_eq!(replayed.state_hash(), journal.map.state_hash());
    let mut on = journal.clone();
    on.push(verdict(None));
    assert!(on.map.switched_off().is_empty());
    journal.push(Change::KeyframeRemoved { keyframe: id(2) });
    assert!(journal.map.switched_off().is_empty(), "it went with its keyframe");
    // A verdict on nothing fits no map.
    let event = Event {
        revision: journal.map.revision() + 1,
        time_ns: 0,
        cause: None,
        change: verdict(None),
    };
    assert!(matches!(journal.map.apply(&event), Err(MapError::Unknown { .. })));
}

/// Nothing comes behind the largest numbers, and asking for it is an error like another.
#[test]
fn the_last_sequence_and_the_last_revision_are_no_overflow() {
    let mut map =
        Map::from_parts(MapParts { revision: i64::MAX - 2, ..MapParts::default() }).unwrap();
    let event = |revision, cause, change| Event { revision, time_ns: 0, cause, change };
    let opened = Change::ClientOpened { name: "robot".to_owned(), epoch: 1 };
    map.apply(&event(i64::MAX - 1, None, opened.clone())).unwrap();
    let cause = Cause { client: ROBOT, epoch: 1, sequence: i64::MAX, digest: [0; 32] };
    let policy = Some(MapPolicy::default());
    let policy = Change::MapUpdated { display_name: None, policy, frozen: None };
    map.apply(&event(i64::MAX, Some(cause), policy.clone())).unwrap();
    assert_eq!(map.client(ROBOT).unwrap().next_sequence, i64::MAX);
    assert_eq!(map.recall(ROBOT, i64::MAX, &[0; 32]), Recall::Duplicate);
    for revision in [i64::MAX, i64::MIN] {
        assert!(map.apply(&event(revision, None, policy.clone())).is_err());
    }
}

#[test]
fn a_map_whose_last_solve_began_beyond_numbers_equals_itself() {
    let mut journal = street(2, MapPolicy::default());
    let solve = solve_of(SolveKind::Global);
    let solve = AppliedSolve { initial_cost: f64::NAN, request: Some([7; 16]), ..solve };
    journal.push(Change::SolveApplied { solve });
    let map = &journal.map;
    assert_eq!(map.last_request().unwrap().initial_cost, f64::INFINITY);
    assert_eq!(Map::from_parts(map.to_parts()).unwrap(), *map, "as a snapshot is compared");
}
