//! The index of one type of descriptor against a comparison with every descriptor.

use proptest::prelude::*;

use super::*;
use crate::ClientIndex;

/// One of 12 descriptors with up to three bits changed: keyframes have many in common, and others that
/// are two or three bits apart.
fn descriptor(number: u16) -> Vec<u64> {
    let mut words: Vec<u64> = (1..=4)
        .map(|word| {
            (u64::from(number % 12) + 3).wrapping_mul(0x9e37_79b9_7f4a_7c15).rotate_left(word * 11)
        })
        .collect();
    for k in 0..usize::from(number / 12 % 4) {
        let bit = (usize::from(number) * 31 + k * 97) % 256;
        words[bit / 64] ^= 1 << (bit % 64);
    }
    words
}

fn id(k: u8) -> EntityId {
    EntityId::new(ClientIndex(u32::from(k % 3)), i64::from(k / 3))
}

fn nearest(descriptor: &[u64], words: &[u64]) -> u32 {
    words.chunks_exact(4).map(|other| distance(descriptor, other)).min().unwrap_or(u32::MAX)
}

proptest! {
    #[test]
    fn it_answers_as_comparing_everything_does(
        steps in proptest::collection::vec(
            (0..24_u8, proptest::collection::vec(0..u16::MAX, 0..9)),
            1..60,
        ),
        asked in proptest::collection::vec(0..u16::MAX, 1..6),
        excluded in 0..24_u8,
    ) {
        let mut index = DescriptorIndex::new(32);
        let mut model: BTreeMap<EntityId, Box<[u64]>> = BTreeMap::new();
        for (k, numbers) in steps {
            let id = id(k);
            if model.remove(&id).is_some() {
                prop_assert!(index.remove(id));
                prop_assert!(!index.remove(id));
            } else {
                let words: Box<[u64]> = numbers.iter().flat_map(|&n| descriptor(n)).collect();
                let indices = (0..numbers.len() as u16).collect();
                index.add(id, i64::from(k), words.clone(), indices);
                model.insert(id, words);
            }
            prop_assert_eq!(index.len(), model.len());
            prop_assert!(model.keys().all(|&id| index.contains(id)));
        }
        let query: Vec<u64> = asked.iter().flat_map(|&n| descriptor(n)).collect();
        let excluded = id(excluded);
        index.hits(&query, 1024, |id| id == excluded, |at, hits| {
            let asked = &query[4 * at..4 * at + 4];
            let name = |hit: &Hit| index.frames[hit.slot as usize].as_ref().unwrap().id;
            let hits: BTreeMap<EntityId, u32> = hits.iter().map(|hit| (name(hit), hit.distance)).collect();
            for (id, words) in model.iter().filter(|(id, _)| **id != excluded) {
                let least = nearest(asked, words);
                // Up to three different bits: one of the two keys has at most one of them.
                if least <= 3 {
                    assert_eq!(hits.get(id), Some(&least), "{id}");
                }
            }
            for (id, distance) in hits {
                assert_ne!(id, excluded);
                assert!(distance >= nearest(asked, &model[&id]) && distance <= index.largest);
            }
        });
        // Every answer is of keyframes that are there, with the distances that their matches have.
        let numbers: Vec<u16> = (0..asked.len() as u16).collect();
        for found in index.query(&query, &numbers, 1024, 9, &[], |id| id == excluded) {
            prop_assert!(found.keyframe != excluded && found.score > 0.0 && found.score <= 1.0);
            let words = &model[&found.keyframe];
            for PlaceMatch { query: a, candidate: b, distance: d } in found.matches {
                prop_assert_eq!(d, distance(&query[4 * a..4 * a + 4], &words[4 * b..4 * b + 4]));
            }
        }
        for id in model.into_keys() {
            prop_assert!(index.remove(id));
        }
        prop_assert_eq!(index.bytes() - index.order.capacity() * 4, DescriptorIndex::new(32).bytes());
    }
}
