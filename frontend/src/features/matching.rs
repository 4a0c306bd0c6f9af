//! Pairs descriptors of two images: each the other's nearest, and clearly nearer than the next.
//!
//! All pairs are compared; deterministic, since of equally near ones the first counts.

use super::descriptor::Descriptor;

/// What makes a match.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MatchOptions {
    /// Bits by which a match may differ, of 256.
    pub max_distance: u32,
    /// The match must differ by less than this share of the bits by which the query's second
    /// nearest differs (Lowe's ratio test); 1 lets all pass but ties.
    pub ratio: f32,
}

impl Default for MatchOptions {
    fn default() -> Self {
        Self { max_distance: 64, ratio: 0.8 }
    }
}

/// A pair of descriptors.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Match {
    /// Index of the query.
    pub query: usize,
    /// Index of its partner.
    pub candidate: usize,
    /// Bits by which they differ.
    pub distance: u32,
}

/// The nearest so far and how far the next one is.
#[derive(Clone, Copy)]
struct Nearest {
    index: usize,
    distance: u32,
    second: u32,
}

const NONE: Nearest = Nearest { index: usize::MAX, distance: u32::MAX, second: u32::MAX };

impl Nearest {
    #[inline]
    fn take(&mut self, index: usize, distance: u32) {
        if distance < self.distance {
            *self = Self { index, distance, second: self.distance };
        } else {
            self.second = self.second.min(distance);
        }
    }
}

/// The matches in the order of `queries`. None of either side is in two of them.
#[must_use]
pub fn match_mutual(
    queries: &[Descriptor],
    candidates: &[Descriptor],
    options: &MatchOptions,
) -> Vec<Match> {
    let mut of_candidate = vec![NONE; candidates.len()];
    let of_query: Vec<Nearest> = queries
        .iter()
        .enumerate()
        .map(|(query, descriptor)| {
            let mut nearest = NONE;
            for (index, candidate) in candidates.iter().enumerate() {
                let distance = descriptor.distance(candidate);
                nearest.take(index, distance);
                of_candidate[index].take(query, distance);
            }
            nearest
        })
        .collect();
    let pair = |(query, nearest): (usize, &Nearest)| {
        let Nearest { index: candidate, distance, second } = *nearest;
        let mutual = of_candidate.get(candidate)?.index == query;
        let near = distance <= options.max_distance;
        let clear = (distance as f32) < options.ratio * second as f32;
        (mutual && near && clear).then_some(Match { query, candidate, distance })
    };
    of_query.iter().enumerate().filter_map(pair).collect()
}
