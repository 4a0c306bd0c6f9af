//! Covisibility of landmarks that many keyframes see: true counts, bounded memory.

#![allow(clippy::unwrap_used, reason = "helpers of tests fail by panicking")]

use covis::map::{Change, EntityId, EntityRef, Item, Map, MapPolicy};
use covis_solvers::testing::random::seeded;
use rand::RngExt as _;

use crate::map_fold::assert_consistent;
use crate::map_support::{Journal, ROBOT, corner, id, landmark, observe, pose_at, window_around};

/// Adds keyframe `id` that sees landmarks `seen` of those that the map holds.
fn see(journal: &mut Journal, id: i64, seen: impl Iterator<Item = i64>) {
    let observations = seen.map(|k| observe(k, &pose_at(0.0), &corner(k))).collect();
    let camera = Some(EntityRef::own(0));
    let (world_from_camera, odom_from_camera) = (pose_at(0.0), None);
    let landmarks = Vec::new();
    let keyframe = Item::Keyframe {
        id,
        capture_time_ns: id,
        camera,
        world_from_camera,
        odom_from_camera,
        observations,
        landmarks,
        global_descriptor: None,
    };
    journal.send(ROBOT, &keyframe).unwrap();
}

#[test]
fn counts_of_landmarks_that_many_keyframes_see_stay_true() {
    for seed in 0..3 {
        let mut rng = seeded(seed);
        let mut journal = Journal::new(MapPolicy::default());
        let landmarks = (0..6).map(landmark).collect();
        journal.send(ROBOT, &Item::Landmarks { landmarks }).unwrap();
        // Ids in no order, so that a newer keyframe may stand before an older one.
        let mut next = (0..160).map(|k| (k * 71) % 163);
        for _ in 0..260 {
            let keyframes: Vec<EntityId> = journal.map.keyframes().keys().copied().collect();
            let any =
                (!keyframes.is_empty()).then(|| keyframes[rng.random_range(0..keyframes.len())]);
            match (rng.random_range(0..8), any) {
                (0, Some(keyframe)) => journal.push(Change::KeyframeRemoved { keyframe }),
                (1, Some(keyframe)) => {
                    let landmark = id(rng.random_range(0..6));
                    let entity = journal.map.keyframes().get(&keyframe).unwrap();
                    if entity.observation_of(landmark).is_some() {
                        let observations = vec![(keyframe, landmark)];
                        journal.push(Change::ObservationsRemoved { observations });
                    } else {
                        let sent = observe(landmark.id, &pose_at(0.0), &corner(landmark.id));
                        let keyframe = EntityRef::own(keyframe.id);
                        let observations = vec![sent];
                        let item = Item::Observations { keyframe, observations };
                        journal.send(ROBOT, &item).unwrap();
                    }
                }
                _ => {
                    let Some(id) = next.next() else { break };
                    let left_out = rng.random_range(0..6);
                    see(&mut journal, id, (0..6).filter(|&k| k != left_out));
                }
            }
            assert_consistent(&journal.map);
        }
        let fused = Change::LandmarksFused { kept: id(0), absorbed: vec![id(1)] };
        journal.push(fused);
        assert_consistent(&journal.map);
        let observers = journal.map.landmarks().get(&id(0)).unwrap().observers.len();
        assert!(observers > 60, "{observers} keyframes see the landmark");
        let map = Map::from_parts(journal.map.to_parts()).unwrap();
        assert_eq!(map, journal.map, "a snapshot gives the map of its journal");
    }
}

#[test]
fn a_landmark_that_thousands_see_takes_memory_in_proportion() {
    const KEYFRAMES: i64 = 4000;
    let mut journal = Journal::new(MapPolicy::default());
    let landmarks = vec![landmark(0)];
    journal.send(ROBOT, &Item::Landmarks { landmarks }).unwrap();
    for id in 0..KEYFRAMES {
        see(&mut journal, id, std::iter::once(0));
    }
    let map = &journal.map;
    // 32 to each side; without a bound there would be 16 million.
    assert!(map.covisibility().entry_count() <= 64 * KEYFRAMES as u64);
    assert!(map.usage().bytes < 20 << 20, "{:?}", map.usage());
    // The newest keyframe has the newest as neighbors, and an old one those of its time.
    let window = window_around(map, &[id(KEYFRAMES - 1)]);
    let all = [window.fixed, window.free].concat();
    // Odometry ties it to one more.
    assert_eq!(all, (KEYFRAMES - 21..KEYFRAMES).map(id).collect::<Vec<_>>());
    let neighbors: Vec<_> = map.covisibility().neighbors(id(1000)).map(|(id, _)| id.id).collect();
    assert_eq!((neighbors.first(), neighbors.last()), (Some(&968), Some(&1032)));
}
