//! The matches between two keyframes by their descriptors alone: each is the other's best, and clearly
//! better than the second.
//!
//! All pairs are compared, so what is found does not depend on the index. Knows nothing of islands or
//! scores.

use super::hamming::{Blocks, Kernel, LANES, NONE, ranked};

/// A descriptor that has a second one nearly as near is ambiguous: largest ratio of the two distances.
/// Lowe (2004) takes 0.8 for SIFT, ORB-SLAM up to 0.9 for binary descriptors.
const RATIO: f64 = 0.85;

/// A pair of descriptors, by their indices in the two keyframes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Pair {
    pub(super) a: usize,
    pub(super) b: usize,
    /// Different bits.
    pub(super) distance: u32,
}

/// All matches of `a` and `b`, which hold descriptors of `words` words one behind the other; at most
/// `largest` bits differ.
pub(super) struct Matching<'a> {
    pub(super) a: &'a [u64],
    pub(super) b: &'a [u64],
    pub(super) words: usize,
    pub(super) largest: u32,
}

fn distance_of(rank: u64) -> u32 {
    (rank >> 32) as u32
}

fn index_of(rank: u64) -> usize {
    rank as u32 as usize
}

impl Kernel for Matching<'_> {
    type Output = Vec<Pair>;

    #[inline(always)]
    fn run(self) -> Vec<Pair> {
        let b = Blocks::new(self.b, self.words);
        // Of each b: the nearest a.
        let mut nearest_a = vec![[NONE; LANES]; b.len()];
        let mut of_a = Vec::with_capacity(self.a.len() / self.words);
        for (i, a) in self.a.chunks_exact(self.words).enumerate() {
            let [best, second] = ranked(a, i, &b, &mut nearest_a);
            let nearest = best.iter().copied().fold(NONE, u64::min);
            let others = best.iter().map(|&rank| if rank == nearest { NONE } else { rank });
            let next = others.chain(second).fold(NONE, u64::min);
            of_a.push((nearest, distance_of(next)));
        }
        let matched = of_a.into_iter().enumerate().filter_map(|(a, (nearest, second))| {
            let (distance, b) = (distance_of(nearest), index_of(nearest));
            // Two that are equally near, be it at distance 0, are ambiguous.
            let clear = distance < second && f64::from(distance) <= RATIO * f64::from(second);
            let to_b = nearest_a.get(b / LANES).map(|block| index_of(block[b % LANES]));
            let is_match = distance <= self.largest && clear && to_b == Some(a);
            is_match.then_some(Pair { a, b, distance })
        });
        matched.collect()
    }
}

#[cfg(test)]
mod tests {
    use super::super::hamming::{self, distance};
    use super::*;

    #[test]
    fn a_descriptor_that_is_equal_to_two_others_is_ambiguous() {
        let (one, other) = ([5, 1, 2, 3], [!5, !1, 9, 7]);
        let matched = |a: &[[u64; 4]], b: &[[u64; 4]]| {
            let (a, b) = (a.concat(), b.concat());
            hamming::run(Matching { a: &a, b: &b, words: 4, largest: 90 })
        };
        let pair = |a, b| Pair { a, b, distance: 0 };
        assert_eq!(matched(&[one, other], &[other, one]), [pair(0, 1), pair(1, 0)]);
        assert_eq!(matched(&[one, other], &[one, other, one]), [pair(1, 1)]);
        assert_eq!(matched(&[one], &[]), []);
    }

    /// By the definition, a pair at a time.
    fn one_by_one(a: &[u64], b: &[u64], words: usize, largest: u32) -> Vec<Pair> {
        let (a, b): (Vec<_>, Vec<_>) = (a.chunks(words).collect(), b.chunks(words).collect());
        let nearest = |from: &[u64], all: &[&[u64]]| {
            let mut by: Vec<(u32, usize)> =
                all.iter().enumerate().map(|(k, to)| (distance(from, to), k)).collect();
            by.sort_unstable();
            by
        };
        let pair = |(i, from): (usize, &&[u64])| {
            let to_b = nearest(from, &b);
            let &(distance, j) = to_b.first()?;
            let second = to_b.get(1).map_or(u32::MAX, |&(second, _)| second);
            let clear = distance < second && f64::from(distance) <= RATIO * f64::from(second);
            let mutual = nearest(b[j], &a)[0].1 == i;
            (distance <= largest && clear && mutual).then_some(Pair { a: i, b: j, distance })
        };
        a.iter().enumerate().filter_map(pair).collect()
    }

    #[test]
    fn many_at_once_are_matched_as_one_by_one() {
        let mut word = 7_u64;
        let mut next = || {
            word = word.wrapping_mul(0x5851_f42d_4c95_7f2d).wrapping_add(0x1405_7b7e_f767_814f);
            word ^ (word >> 29)
        };
        for (words, count) in [(2, 1), (4, 7), (4, 8), (4, 133), (8, 65), (64, 20)] {
            let a: Vec<u64> = (0..words * count).map(|_| next()).collect();
            // In another order and number, with some bits changed; some twice.
            let mut b: Vec<u64> = Vec::new();
            for k in (0..count).rev().chain(0..count / 9) {
                let own = a[k * words..(k + 1) * words].iter();
                b.extend(own.map(|word| word ^ (next() & next() & next())));
            }
            b.extend((0..3 * words).map(|_| next()));
            let largest = 22 * words as u32;
            let found = hamming::run(Matching { a: &a, b: &b, words, largest });
            assert_eq!(found, one_by_one(&a, &b, words, largest), "{words} words, {count}");
            assert!(2 * found.len() >= count, "{words} words, {count}: {}", found.len());
        }
    }
}
