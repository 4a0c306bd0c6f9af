//! A shared map is a `BTreeMap` in what it answers, and two copies differ in memory by what changed.

use std::collections::{BTreeMap, BTreeSet};
use std::sync::Arc;

use proptest::prelude::*;

use super::{BRANCH, LEAF, SharedMap};

type Leaf = Arc<Vec<(i64, i64)>>;

fn leaves(map: &SharedMap<i64, i64>) -> impl Iterator<Item = &Leaf> {
    map.branches.iter().flat_map(|(_, leaves)| leaves.iter().map(|(_, leaf)| leaf))
}

/// Leaves and branches that two maps do not have in common.
fn own_parts(a: &SharedMap<i64, i64>, b: &SharedMap<i64, i64>) -> (usize, usize) {
    let others: BTreeSet<_> = leaves(b).map(Arc::as_ptr).collect();
    let branches: BTreeSet<_> = b.branches.iter().map(|(_, leaves)| Arc::as_ptr(leaves)).collect();
    (
        leaves(a).filter(|leaf| !others.contains(&Arc::as_ptr(leaf))).count(),
        a.branches.iter().filter(|(_, leaves)| !branches.contains(&Arc::as_ptr(leaves))).count(),
    )
}

/// What the comment on parts says.
fn check(map: &SharedMap<i64, i64>) {
    let mut last = None;
    for (branch, leaves) in &map.branches {
        assert!((1..=BRANCH).contains(&leaves.len()));
        assert!(last.is_none_or(|last| last < *branch) && *branch == leaves[0].0);
        for (position, leaf) in leaves.iter() {
            assert!((1..=LEAF).contains(&leaf.len()));
            assert!(last.is_none_or(|last| last < *position) && *position <= leaf[0].0);
            last = leaf.last().map(|entry| entry.0);
        }
    }
    assert_eq!(map.iter().len(), map.iter().count());
}

#[test]
fn a_change_copies_one_leaf_of_a_map_that_is_shared() {
    let mut map: SharedMap<i64, i64> = (0..100_000).map(|key| (key, key)).collect();
    assert_eq!(leaves(&map).count(), 100_000 / LEAF, "rising keys fill their leaves");
    assert_eq!(map.branches.len(), (100_000 / LEAF).div_ceil(BRANCH), "and their branches");
    let held = map.clone();
    assert_eq!(own_parts(&map, &held), (0, 0));
    *map.get_mut(&50_000).unwrap() = -1;
    map.remove(&70_000);
    assert_eq!((held.get(&50_000), held.get(&70_000)), (Some(&50_000), Some(&70_000)));
    assert_eq!((map.get(&50_000), map.get(&70_000)), (Some(&-1), None));
    assert_eq!(own_parts(&map, &held), (2, 2));
    // Nobody else has them now: the next change copies nothing.
    let before = map.clone();
    drop(before);
    let before: Vec<_> = leaves(&map).map(Arc::as_ptr).collect();
    *map.get_mut(&50_001).unwrap() = -1;
    assert!(leaves(&map).map(Arc::as_ptr).eq(before));
}

#[test]
fn what_is_left_of_many_entries_takes_few_leaves() {
    let mut map: SharedMap<i64, i64> = (0..100_000).map(|key| (key, key)).collect();
    for key in (0..100_000).filter(|key| key % LEAF as i64 != 0) {
        map.remove(&key);
    }
    check(&map);
    assert_eq!(map.len(), 100_000 / LEAF);
    let (leaves, branches) = (leaves(&map).count(), map.branches.len());
    assert!(leaves <= map.len() / 8, "{leaves} leaves of {}", map.len());
    assert!(branches <= leaves.div_ceil(BRANCH / 4), "{branches} branches of {leaves} leaves");
}

#[test]
fn keys_between_two_branches_are_found_where_they_belong() {
    let mut map: SharedMap<i64, i64> = (0..5000).map(|key| (key, key)).collect();
    // The first leaf of the second branch goes.
    let second = map.branches[1].0;
    for key in second..second + LEAF as i64 {
        map.remove(&key);
    }
    check(&map);
    assert_eq!(map.range(second + 2..=second + 12).count(), 0);
    assert_eq!(map.insert(second + 2, -1), None);
    check(&map);
    assert_eq!((map.get(&5), map.get(&(second + 2))), (Some(&5), Some(&-1)));
    assert!(map.iter().is_sorted_by_key(|(key, _)| *key));
}

proptest! {
    #[test]
    fn it_answers_as_a_btree_map_does(
        steps in proptest::collection::vec((0..7_u8, -150..150_i64), 0..600),
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
                5 => {
                    let value = *map.get_or_insert(key, || step);
                    prop_assert_eq!(value, *model.entry(key).or_insert(step));
                }
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
                prop_assert_eq!(map.entry_before(&key), model.range(..key).next_back());
            }
        }
    }

    #[test]
    fn it_answers_so_with_many_branches_too(
        runs in proptest::collection::vec((0..3_u8, 0..9000_i64, 1..900_i64), 1..40),
        asked in proptest::collection::vec((0..10_000_i64, 0..200_i64), 20),
    ) {
        let mut model: BTreeMap<i64, i64> = (0..6000).map(|key| (key, key)).collect();
        let mut map: SharedMap<i64, i64> = model.iter().map(|(&key, &value)| (key, value)).collect();
        for (what, first, count) in runs {
            for key in first..first + count {
                match what {
                    // Whole leaves and branches go.
                    0 => prop_assert_eq!(map.remove(&key), model.remove(&key)),
                    1 => prop_assert_eq!(map.insert(key, first), model.insert(key, first)),
                    // Falling keys meet gaps from above.
                    _ => {
                        let key = 2 * first - key + count;
                        prop_assert_eq!(map.insert(key, count), model.insert(key, count));
                    }
                }
            }
            check(&map);
        }
        prop_assert!(map.iter().eq(model.iter()));
        for (first, length) in asked {
            let keys = first..=first + length;
            prop_assert!(map.range(keys.clone()).eq(model.range(keys.clone())));
            let before = model.range(..keys.start()).next_back();
            prop_assert_eq!(map.entry_before(keys.start()), before);
            prop_assert_eq!(map.get(&first), model.get(&first));
        }
    }
}

/// Keys that rise with gaps, those of one map and some that it does not have.
fn rising_keys() -> impl Iterator<Item = i64> {
    (-3..60_000).filter(|key| key % 7 < 4 && key / 500 % 3 != 1)
}

#[test]
fn rising_keys_are_found_as_any_others() {
    // Gaps within leaves, of whole leaves and of whole branches.
    let kept = |key: &i64| key % 3 != 0 && !(9_000..9_100).contains(key) && key / 10_000 != 2;
    let map: SharedMap<i64, i64> = (0..50_000).filter(kept).map(|key| (key, -key)).collect();
    let mut rising = map.rising();
    assert!(rising_keys().all(|key| rising.get(&key) == map.get(&key)));
    // In any other order too.
    for key in [40, 49_999, 3, 41, 41, 40, -1, 60_000, 9_050, 25_000, 40] {
        assert_eq!(rising.get(&key), map.get(&key), "{key}");
    }
    assert_eq!(SharedMap::<i64, i64>::default().rising().get(&3), None);
}

#[test]
fn values_of_rising_keys_are_changed_and_nothing_else() {
    let kept = |key: &i64| key % 3 != 0 && key / 10_000 != 2;
    let first: SharedMap<i64, i64> = (0..50_000).filter(kept).map(|key| (key, 0)).collect();
    let (mut rising, mut one_by_one) = (first.clone(), first.clone());
    let changes = || rising_keys().chain([7, 40_000, 8]).zip(1..);
    rising.update_rising(changes(), |value, change| *value = 10 * *value + change);
    for (key, change) in changes() {
        if let Some(value) = one_by_one.get_mut(&key) {
            *value = 10 * *value + change;
        }
    }
    check(&rising);
    assert_eq!(rising, one_by_one);
    assert!(first.values().all(|&value| value == 0), "a copy stays as it was");
    // A leaf without such a key is not copied.
    let mut few = first.clone();
    few.update_rising([(1, 5), (2, 5), (3, 5), (49_999, 5)], |value, change| *value = change);
    assert_eq!(own_parts(&few, &first).0, 2);
}
