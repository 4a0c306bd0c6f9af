//! The matches between two keyframes by their descriptors alone: each is the other's best, and clearly
//! better than the second.
//!
//! All pairs are compared, so what is found does not depend on the index. Knows nothing of islands or
//! scores.

use super::hamming::{Kernel, distance};

/// A descriptor that has a second one nearly as near is ambiguous: largest ratio of the two distances.
/// Lowe (2004) takes 0.8 for SIFT, ORB-SLAM up to 0.9 for binary descriptors.
const RATIO: f64 = 0.85;

/// A pair of descriptors, by their places in the two keyframes.
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

impl Kernel for Matching<'_> {
    type Output = Vec<Pair>;

    #[inline(always)]
    fn run(self) -> Vec<Pair> {
        // Of each b: the nearest a and its distance. The first of equal ones stays.
        let mut nearest_a = vec![(u32::MAX, 0); self.b.len() / self.words];
        let mut of_a = Vec::with_capacity(self.a.len() / self.words);
        for (i, a) in self.a.chunks_exact(self.words).enumerate() {
            let (mut best, mut second, mut at) = (u32::MAX, u32::MAX, 0);
            for (j, b) in self.b.chunks_exact(self.words).enumerate() {
                let d = distance(a, b);
                if d < second {
                    if d < best {
                        (second, best, at) = (best, d, j);
                    } else {
                        second = d;
                    }
                }
                if d < nearest_a[j].0 {
                    nearest_a[j] = (d, i);
                }
            }
            of_a.push((best, second, at));
        }
        let matched = of_a.into_iter().enumerate().filter_map(|(a, (distance, second, b))| {
            // Two that are equally near, be it at distance 0, are ambiguous.
            let clear = distance < second && f64::from(distance) <= RATIO * f64::from(second);
            let mutual = nearest_a.get(b).is_some_and(|&(_, nearest)| nearest == a);
            (distance <= self.largest && clear && mutual).then_some(Pair { a, b, distance })
        });
        matched.collect()
    }
}

#[cfg(test)]
mod tests {
    use super::super::hamming;
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
    }
}
