//! Mutual nearest neighbors, the ratio and ties, on descriptors made by hand.

use super::super::descriptor::Descriptor;
use super::super::matching::{Match, MatchOptions, match_mutual};
use super::super::splitmix::SplitMix64;

/// A descriptor with the first `count` bits set.
fn ones(count: u32) -> Descriptor {
    Descriptor([0, 1, 2, 3].map(|word| {
        let count = count.saturating_sub(64 * word).min(64);
        if count == 64 { u64::MAX } else { (1 << count) - 1 }
    }))
}

const LOOSE: MatchOptions = MatchOptions { max_distance: 256, ratio: 1.0 };

fn pairs(matches: &[Match]) -> Vec<(usize, usize, u32)> {
    matches.iter().map(|m| (m.query, m.candidate, m.distance)).collect()
}

#[test]
fn only_mutual_neighbors_match() {
    // 0 and 10 both are nearest to 8, which prefers 10; 100 and 120 go together.
    let queries = [ones(0), ones(10), ones(100)];
    let candidates = [ones(120), ones(8)];
    assert_eq!(pairs(&match_mutual(&queries, &candidates, &LOOSE)), [(1, 1, 2), (2, 0, 20)]);
}

#[test]
fn a_match_must_be_near_and_clearly_nearer_than_the_next() {
    let queries = [ones(0)];
    let candidates = [ones(20), ones(24)];
    let with = |max_distance, ratio| {
        pairs(&match_mutual(&queries, &candidates, &MatchOptions { max_distance, ratio }))
    };
    assert_eq!(with(20, 0.9), [(0, 0, 20)]);
    assert_eq!(with(19, 0.9), []);
    assert_eq!(with(20, 0.8), []);
    // A lone candidate has no rival.
    assert_eq!(pairs(&match_mutual(&queries, &candidates[..1], &LOOSE)), [(0, 0, 20)]);
}

#[test]
fn ties_and_empty_sides_match_nothing() {
    let twins = [ones(5), ones(5)];
    assert_eq!(match_mutual(&[ones(5)], &twins, &LOOSE), []);
    assert_eq!(pairs(&match_mutual(&twins, &[ones(5)], &LOOSE)), [(0, 0, 0)], "the first");
    assert_eq!(match_mutual(&[], &twins, &LOOSE), []);
    assert_eq!(match_mutual(&twins, &[], &LOOSE), []);
}

#[test]
fn shuffled_and_damaged_descriptors_find_their_partners() {
    let mut generator = SplitMix64(3);
    let queries: Vec<Descriptor> =
        (0..200).map(|_| Descriptor([(); 4].map(|()| generator.bits()))).collect();
    let candidates: Vec<Descriptor> = (0..200)
        .map(|k| {
            let mut words = queries[k * 7 % 200].0;
            for _ in 0..20 {
                let bit = generator.below(256);
                words[bit / 64] ^= 1 << (bit % 64);
            }
            Descriptor(words)
        })
        .collect();
    let matches = match_mutual(&queries, &candidates, &MatchOptions::default());
    assert_eq!(matches.len(), 200);
    assert!(matches.iter().all(|m| m.candidate * 7 % 200 == m.query && m.distance <= 20));
}
