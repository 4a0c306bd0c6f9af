//! Making room: which keyframe goes, what goes with it, what stays of it.

use covis::map::{
    Change, ConstraintKind, EntityRef, Item, ItemObservation, Map, MapLimits, MapPolicy, Retired,
    WhenFull, retire,
};
use covis_solvers::geometry::LieGroup;

use crate::map_support::{
    Journal, ROBOT, assert_covisibility, id, landmark, pixel, pose_at, pose_error, relative_pose,
    street,
};

fn policy(when_full: WhenFull) -> MapPolicy {
    let limits = MapLimits { keyframes: Some(10), ..MapLimits::default() };
    MapPolicy { limits, when_full, ..MapPolicy::default() }
}

fn retired(journal: &mut Journal) -> Retired {
    let retired = retire(&journal.map).expect("there is one to retire");
    journal.push(Change::KeyframeRetired { retired: retired.clone() });
    retired
}

/// What the fold keeps is what follows from the entities.
fn check_consistent(journal: &Journal) {
    let map = &journal.map;
    assert_covisibility(map);
    let rebuilt = Map::from_parts(map.to_parts()).unwrap();
    assert_eq!(&rebuilt, map);
    assert_eq!(rebuilt.usage(), map.usage());
    assert_eq!(&Map::replay(journal.events.iter()).unwrap(), map);
}

#[test]
fn the_oldest_goes_and_what_it_told_of_its_neighbors_stays() {
    let mut journal = street(12, policy(WhenFull::Marginalize));
    let gone = retired(&mut journal);
    let map = &journal.map;
    assert_eq!(gone.keyframe, id(0));
    assert!(!map.keyframes().contains_key(&id(0)) && map.keyframes().len() == 11);
    // Keyframe 0 sees corners 0 to 19, keyframe 1 those from 0 on too: none is left alone.
    assert_eq!(gone.landmarks, []);
    assert!(map.landmarks().get(&id(0)).unwrap().observers[..] == [id(1), id(2)]);
    assert!(!gone.constraints.is_empty() && gone.priors.is_empty());
    for (constraint_id, constraint) in map.constraints() {
        assert!(constraint_id.id < 0 && constraint.kind == ConstraintKind::Marginal);
        let (i, j) = (constraint.keyframe_i, constraint.keyframe_j);
        let pose = |id| map.keyframes().get(&id).unwrap().world_from_camera;
        let expected = pose(i).inverse().compose(&pose(j));
        assert!(pose_error(&constraint.keyframe_i_from_keyframe_j, &expected) < 1e-9);
    }
    check_consistent(&journal);
}

#[test]
fn a_map_that_is_kept_small_stays_small_in_every_list() {
    let mut journal = street(10, policy(WhenFull::Marginalize));
    let mut sizes = Vec::new();
    for next in 10..60 {
        let gone = retired(&mut journal);
        assert_eq!(gone.keyframe, id(next - 10));
        let item = crate::map_support::street_keyframe(next, pose_at(next as f64), &journal.map);
        journal.send(ROBOT, &item).unwrap();
        let map = &journal.map;
        assert_eq!(map.keyframes().len(), 10);
        sizes.push((map.landmarks().len(), map.constraints().len(), map.contents().len()));
    }
    check_consistent(&journal);
    let largest = |sizes: &[(usize, usize, usize)]| {
        sizes.iter().copied().reduce(|a, b| (a.0.max(b.0), a.1.max(b.1), a.2.max(b.2))).unwrap()
    };
    assert_eq!(largest(&sizes[20..35]), largest(&sizes[35..]), "{sizes:?}");
    // Pairs that lost several common neighbors have one constraint all the same.
    let map = &journal.map;
    let mut pairs: Vec<_> =
        map.constraints().values().map(|c| (c.keyframe_i, c.keyframe_j)).collect();
    pairs.sort_unstable();
    let count = pairs.len();
    pairs.dedup();
    assert_eq!(pairs.len(), count);
}

#[test]
fn of_the_oldest_the_best_seen_goes_first_where_the_policy_says_so() {
    let mut journal = street(12, policy(WhenFull::Sparsify));
    // The first keyframes of a street are seen by fewer: the middle goes.
    let gone = retired(&mut journal);
    assert!(gone.keyframe > id(1) && gone.keyframe < id(10), "{:?}", gone.keyframe);
    check_consistent(&journal);
}

#[test]
fn the_newest_of_each_client_stay_and_a_policy_that_rejects_retires_none() {
    let mut journal = street(3, policy(WhenFull::Marginalize));
    assert_eq!(retired(&mut journal).keyframe, id(0));
    assert_eq!(retire(&journal.map), None);
    assert_eq!(retire(&street(20, MapPolicy::default()).map), None);
}

#[test]
fn odometry_through_a_keyframe_that_goes_is_composed() {
    let mut journal = Journal::new(policy(WhenFull::Sparsify));
    for k in 0..5 {
        let item = Item::Keyframe {
            id: k,
            capture_time_ns: k,
            camera: None,
            world_from_camera: pose_at(k as f64),
            odom_from_camera: None,
            observations: Vec::new(),
            landmarks: Vec::new(),
            global_descriptor: None,
        };
        journal.send(ROBOT, &item).unwrap();
        if k > 0 {
            let kind = ConstraintKind::Odometry;
            let odometry = relative_pose(k, kind, k - 1, k, pose_at(1.0));
            journal.send(ROBOT, &odometry).unwrap();
        }
    }
    // Nothing is observed: all are seen equally well, and the oldest goes, with its odometry.
    assert_eq!(retired(&mut journal).keyframe, id(0));
    assert_eq!(journal.map.constraints().len(), 3);
    // Its neighbor's other side still hangs on odometry alone.
    assert!(journal.map.constraints().values().all(|c| c.kind == ConstraintKind::Odometry));
    check_consistent(&journal);
}

#[test]
fn landmarks_that_nobody_ever_saw_go_with_older_keyframes_only() {
    let mut journal = street(1, policy(WhenFull::Marginalize));
    let unseen =
        |range: std::ops::Range<i64>| Item::Landmarks { landmarks: range.map(landmark).collect() };
    journal.send(ROBOT, &unseen(1000..1005)).unwrap();
    for k in 1..4 {
        let item = crate::map_support::street_keyframe(k, pose_at(k as f64), &journal.map);
        journal.send(ROBOT, &item).unwrap();
    }
    journal.send(ROBOT, &unseen(2000..2003)).unwrap();
    // Keyframe 0 is older than all of them.
    assert_eq!(retired(&mut journal).landmarks, []);
    let gone = retired(&mut journal);
    assert_eq!(gone.keyframe, id(1));
    assert!((1000..1005).all(|k| gone.landmarks.contains(&id(k))), "{:?}", gone.landmarks);
    assert!(journal.map.landmarks().contains_key(&id(2000)));
    // One that is seen at last stays.
    let seen = ItemObservation {
        landmark: EntityRef::own(2000),
        pixel: pixel(300.0, 200.0),
        sigma_px: 1.0,
        depth: None,
        descriptor: None,
    };
    let seen = Item::Observations { keyframe: EntityRef::own(3), observations: vec![seen] };
    journal.send(ROBOT, &seen).unwrap();
    check_consistent(&journal);
}
