//! The expected cost of a solve, before it starts. It decides on which threads the solve runs and
//! how much memory is reserved for it.
//!
//! The costs are upper bounds that take one pass over the problem. The exact price, which is
//! compared with the limit of a solve, is computed when the solve starts. No values of the problem
//! are read.

use covis_solvers::price::{Ceiling, Price};

use crate::map::Usage;

/// Most work of a small solve in all its iterations, flop. By the bound, a window of ten keyframes
/// with 400 observations each takes a tenth of this in ten iterations.
const SMALL_FLOPS: f64 = 4e9;
/// Most memory of a small solve, bytes.
const SMALL_BYTES: u64 = 64 << 20;

/// An upper bound of the cost of a solve.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Estimate {
    bytes: u64,
    is_small: bool,
}

impl Estimate {
    /// The estimate of a solve that costs at most `bound`. A solve that costs more than `ceiling`
    /// is refused, so that no more is reserved.
    #[must_use]
    pub fn new(bound: Price, max_iterations: usize, ceiling: &Ceiling) -> Self {
        let flops = bound.flops_per_iteration * max_iterations.max(1) as f64;
        let is_small = bound.bytes <= SMALL_BYTES && flops <= SMALL_FLOPS;
        let bytes = ceiling.bytes.map_or(bound.bytes, |limit| bound.bytes.min(limit));
        Self { bytes, is_small }
    }

    /// The estimate of bundle adjustment or a pose graph over a whole map that holds `usage`.
    #[must_use]
    pub fn of_map(usage: Usage, max_iterations: usize, ceiling: &Ceiling) -> Self {
        let (poses, observations) = (usage.keyframes as f64, usage.observations as f64);
        // Each observation is paired with every other keyframe. This is a bound as long as no
        // keyframe sees a landmark twice.
        let pairs = 0.5 * observations * poses;
        let edges = usage.constraints as f64 + pairs.min(0.5 * poses * poses);
        let dimension = 15.0 * poses;
        let flops_per_iteration =
            1500.0 * (observations + edges) + 1400.0 * pairs + dimension.powi(3) / 3.0;
        let bytes = 16.0 * dimension * dimension + 2200.0 * pairs + 3000.0 * (observations + edges);
        Self::new(Price { bytes: bytes as u64, flops_per_iteration }, max_iterations, ceiling)
    }

    /// Memory that is reserved for it while it runs, bytes.
    #[must_use]
    pub fn bytes(&self) -> u64 {
        self.bytes
    }

    /// Whether it is short and may run on the threads for small solves.
    #[must_use]
    pub fn is_small(&self) -> bool {
        self.is_small
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn of_map(keyframes: u64, observations: u64) -> Estimate {
        let usage = Usage { keyframes, observations, ..Usage::default() };
        Estimate::of_map(usage, 100, &Ceiling { bytes: Some(1 << 30), ..Ceiling::NONE })
    }

    #[test]
    fn a_map_of_some_keyframes_is_small_and_a_building_is_not() {
        assert!(of_map(8, 3200).is_small());
        let building = of_map(10_000, 2_000_000);
        assert!(!building.is_small());
        assert_eq!(building.bytes(), 1 << 30, "no more than a solve may take");
    }

    #[test]
    fn a_small_problem_that_may_iterate_forever_is_not_small() {
        let bound = Price { bytes: 1000, flops_per_iteration: 1e6 };
        assert!(Estimate::new(bound, 100, &Ceiling::NONE).is_small());
        assert!(!Estimate::new(bound, 1_000_000, &Ceiling::NONE).is_small());
    }
}
