//! Refinement of a vertex separator, after Fiduccia and Mattheyses (1982).
//!
//! A vertex of the separator moves to a side; its neighbors on the other side take its place. Moves
//! are tried best first, also some that make the separator heavier, and what came after the best
//! state is taken back. Each vertex moves at most once a pass. It starts from a given separator and
//! makes none.

use std::cmp::Reverse;
use std::collections::BinaryHeap;

use super::graph::Level;

/// The side of the vertices that part the other two.
pub(super) const SEPARATOR: u8 = 2;

/// A side may have at most so many times half of the weight.
const SLACK: f64 = 1.3;

/// Passes, and moves in a row without a better state.
const PASSES: usize = 6;
const PATIENCE: usize = 40;

/// A cut under refinement.
pub(super) struct Cut<'a> {
    level: &'a Level,
    pub(super) sides: Vec<u8>,
    /// Weight of side 0, side 1, and the separator.
    weights: [i64; 3],
}

/// A vertex to be moved to a side, by gain; ties go to the lower index.
type Candidate = (i64, Reverse<u32>);

impl<'a> Cut<'a> {
    pub(super) fn new(level: &'a Level, sides: Vec<u8>) -> Self {
        let mut weights = [0; 3];
        for (&side, &weight) in sides.iter().zip(&level.weights) {
            weights[usize::from(side)] += i64::from(weight);
        }
        Self { level, sides, weights }
    }

    fn total(&self) -> i64 {
        self.weights.iter().sum()
    }

    /// The most weight that a side may have.
    fn limit(&self) -> i64 {
        (SLACK / 2.0 * self.total() as f64) as i64
    }

    /// Less is better: what a side has too much, the separator's weight, how much the sides differ.
    pub(super) fn score(&self) -> (i64, i64, i64) {
        let [left, right, separator] = self.weights;
        let excess = (left.max(right) - self.limit()).max(0);
        (excess, separator, (left - right).abs())
    }

    fn weight(&self, v: u32) -> i64 {
        i64::from(self.level.weights[v as usize])
    }

    /// How much lighter the separator gets when `v` moves to `side`.
    fn gain(&self, v: u32, side: u8) -> i64 {
        let others = self.level.graph.of(v as usize).iter();
        let pulled = others.filter(|&&w| self.sides[w as usize] == 1 - side);
        self.weight(v) - pulled.map(|&w| self.weight(w)).sum::<i64>()
    }

    /// Passes until one finds nothing better.
    pub(super) fn refine(&mut self) {
        for _ in 0..PASSES {
            let before = self.score();
            self.pass();
            if self.score() >= before {
                return;
            }
        }
    }

    fn pass(&mut self) {
        let count = self.sides.len();
        let mut is_moved = vec![false; count];
        let mut heaps: [BinaryHeap<Candidate>; 2] = Default::default();
        for v in 0..count as u32 {
            if self.sides[v as usize] == SEPARATOR {
                for side in [0, 1] {
                    heaps[usize::from(side)].push((self.gain(v, side), Reverse(v)));
                }
            }
        }
        // The moves so far, and the vertices that each pulled into the separator.
        let mut moves: Vec<(u32, u8, usize)> = Vec::new();
        let mut pulled: Vec<u32> = Vec::new();
        let (mut best, mut best_length) = (self.score(), 0);
        while let Some((v, side)) = self.best_move(&mut heaps, &is_moved) {
            let other = 1 - side;
            is_moved[v as usize] = true;
            self.put(v, side);
            let begin = pulled.len();
            moves.push((v, side, begin));
            let neighbors = self.level.graph.of(v as usize);
            for &w in neighbors {
                if self.sides[w as usize] == other {
                    self.put(w, SEPARATOR);
                    pulled.push(w);
                }
            }
            // Gains changed around what left and what came; old entries no longer match.
            for &w in neighbors {
                if self.sides[w as usize] == SEPARATOR && !is_moved[w as usize] {
                    heaps[usize::from(other)].push((self.gain(w, other), Reverse(w)));
                }
            }
            for &w in &pulled[begin..] {
                if !is_moved[w as usize] {
                    for side in [0, 1] {
                        heaps[usize::from(side)].push((self.gain(w, side), Reverse(w)));
                    }
                }
                for &x in self.level.graph.of(w as usize) {
                    if self.sides[x as usize] == SEPARATOR && !is_moved[x as usize] {
                        heaps[usize::from(side)].push((self.gain(x, side), Reverse(x)));
                    }
                }
            }
            let score = self.score();
            if score < best {
                (best, best_length) = (score, moves.len());
            } else if moves.len() - best_length > PATIENCE {
                break;
            }
        }
        for (v, side, begin) in moves.drain(best_length..).rev() {
            for w in pulled.drain(begin..) {
                self.put(w, 1 - side);
            }
            self.put(v, SEPARATOR);
        }
    }

    /// The move of the largest gain that keeps the balance, ties to the lighter side. It stays in
    /// its heap, where it is no candidate any more.
    fn best_move(
        &self,
        heaps: &mut [BinaryHeap<Candidate>; 2],
        is_moved: &[bool],
    ) -> Option<(u32, u8)> {
        let limit = self.limit();
        let mut best: Option<(i64, i64, u32, u8)> = None;
        for side in [0u8, 1] {
            let heap = &mut heaps[usize::from(side)];
            while let Some(&(gain, Reverse(v))) = heap.peek() {
                let is_candidate = self.sides[v as usize] == SEPARATOR
                    && !is_moved[v as usize]
                    && gain == self.gain(v, side);
                if !is_candidate {
                    heap.pop();
                    continue;
                }
                let (own, other) =
                    (self.weights[usize::from(side)], self.weights[usize::from(1 - side)]);
                let heavier = own + self.weight(v);
                let candidate = (gain, -own, v, side);
                if (heavier <= limit || heavier <= other)
                    && best.is_none_or(|best| (candidate.0, candidate.1) > (best.0, best.1))
                {
                    best = Some(candidate);
                }
                break;
            }
        }
        best.map(|(_, _, v, side)| (v, side))
    }

    fn put(&mut self, v: u32, side: u8) {
        let weight = self.weight(v);
        let slot = &mut self.sides[v as usize];
        self.weights[usize::from(*slot)] -= weight;
        *slot = side;
        self.weights[usize::from(side)] += weight;
    }
}
