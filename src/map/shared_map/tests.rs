//! A shared map is a `BTreeMap` in what it answers, and two copies differ in memory by what changed.

use std::collections::BTreeMap;
use std::sync::Arc;

use proptest::prelude::*;

use super::{LEAF, SharedMap};

/// Leaves that two maps do not have in common.
fn own_leaves(a: &SharedMap<i64, i64>, b: &SharedMap<i64, i64>) -> usize {
    let shared = |leaf: &Arc<_>| b.leaves.values().any(|other| Arc::ptr_eq(leaf, other));
    a.leaves.values().filter(|leaf| !shared(leaf)).count()
}

/// What the type's comment says of leaves.
fn check(map: &SharedMap<i64, i64>) {
    let mut last = None;
    for (&place, leaf) in &map.leaves {
        assert!((1..=LEAF).contains(&leaf.len()));
        assert!(last.is_none_or(|last| last < place) && place <= leaf[0].0);
        last = leaf.last().map(|entry| entry.0);
    }
    assert_eq!(map.iter().len(), map.iter().count());
}

#[test]
fn a_change_copies_one_leaf_of_a_map_that_is_shared() {
    let mut map: SharedMap<i64, i64> = (0..100_000).map(|key| (key, key)).collect();
    assert_eq!(map.leaves.len(), 100_000 / LEAF, "rising keys fill their leaves");
    let held = map.clone();
    assert_eq!(own_leaves(&map, &held), 0);
    *map.get_mut(&50_000).unwrap() = -1;
    map.remove(&70_000);
    assert_eq!((held.get(&50_000), held.get(&70_000)), (Some(&50_000), Some(&70_000)));
    assert_eq!((map.get(&50_000), map.get(&70_000)), (Some(&-1), None));
    assert_eq!(own_leaves(&map, &held), 2);
    // Nobody else has them now: the next change copies nothing.
    let before = map.clone();
    drop(before);
    let leaf = Arc::as_ptr(map.leaves.range(..=50_000).next_back().unwrap().1);
    *map.get_mut(&50_001).unwrap() = -1;
    assert_eq!(Arc::as_ptr(map.leaves.range(..=50_001).next_back().unwrap().1), leaf);
}

#[test]
fn what_is_left_of_many_entries_takes_few_leaves() {
    let mut map: SharedMap<i64, i64> = (0..100_000).map(|key| (key, key)).collect();
    for key in (0..100_000).filter(|key| key % LEAF as i64 != 0) {
        map.remove(&key);
    }
    check(&map);
    assert_eq!(map.len(), 100_000 / LEAF);
    assert!(map.leaves.len() <= map.len() / 8, "{} leaves of {}", map.leaves.len(), map.len());
}

proptest! {
    #[test]
    fn it_answers_as_a_btree_map_does(
        steps in proptest::collection::vec((0..6_u8, -150..150_i64), 0..600),
        first in -160..160_i64,
        last in -160..160_i64,
    ) {
        let mut model = BTreeMap::new();
        let mut map = SharedMap::default();
        let mut copies = Vec::new();
        for (step, (what, key)) in (0..).zip(steps) {
            match what {
                0..3 => prop_assert_eq!(map.insert(key, step), model.insert(key, step)),
                3 => prop_assert_eq!(map.remove(&key), model.remove(&key)),
                4 => prop_assert_eq!(map.get_mut(&key), model.get_mut(&key)),
                _ if key < -140 => prop_assert_eq!(map.pop_first(), model.pop_first()),
                _ if key > 140 => copies.push((map.clone(), model.clone())),
                _ => prop_assert_eq!(map.contains_key(&key), model.contains_key(&key)),
            }
            check(&map);
        }
        copies.push((map, model));
        for (map, model) in copies {
            prop_assert!(map.iter().eq(model.iter()));
            prop_assert_eq!(map.last_key_value(), model.last_key_value());
            if first <= last {
                prop_assert!(map.range(first..=last).eq(model.range(first..=last)));
            } else {
                prop_assert_eq!(map.range(first..=last).count(), 0);
            }
            for key in -150..150 {
                prop_assert_eq!(map.get(&key), model.get(&key));
            }
        }
    }
}
