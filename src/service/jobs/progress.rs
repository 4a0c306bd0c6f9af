//! How much longer a solve takes, judged by its iterations so far.
//!
//! Near the optimum each step lowers the cost by about the same share of the step before; the solve ends
//! where a step lowers it by less than the tolerance of the cost. Farther away, or where steps are
//! rejected, only the most iterations that the solve may take are known: the estimate is then an upper
//! bound.

use covis_solvers::optimizer::{IterationSummary, Options};

/// The estimate for one solve.
pub(super) struct TimeLeft {
    most: usize,
    last: Option<IterationSummary>,
    /// The share by which the last accepted step lowered the cost.
    decrease: Option<f64>,
}

impl TimeLeft {
    /// For a solve of at most so many iterations.
    pub(super) fn new(most: usize) -> Self {
        Self { most, last: None, decrease: None }
    }

    /// Seconds that are left after an iteration; `None` after the start.
    pub(super) fn after(&mut self, row: &IterationSummary) -> Option<f64> {
        let last = self.last.replace(*row)?;
        let left = self.most.saturating_sub(row.iteration) as f64;
        let mut iterations = left;
        if row.accepted && row.cost > 0.0 {
            let decrease = (last.cost - row.cost) / row.cost;
            if let Some(before) = self.decrease.replace(decrease)
                && decrease > 0.0
                && decrease < before
            {
                let tolerance = Options::default().cost_tolerance;
                let steps = (tolerance / decrease).ln() / (decrease / before).ln();
                iterations = steps.max(0.0).ceil().min(left);
            }
        }
        let mean = row.seconds / row.iteration.max(1) as f64;
        Some(mean * iterations)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn row(iteration: usize, cost: f64, accepted: bool) -> IterationSummary {
        IterationSummary {
            iteration,
            cost,
            seconds: iteration as f64,
            accepted,
            damping: 0.0,
            gradient_max_norm: 0.0,
            step_norm: 0.0,
            step_quality: 1.0,
        }
    }

    #[test]
    fn a_cost_that_falls_by_a_tenth_of_the_fall_before_ends_soon() {
        let mut left = TimeLeft::new(100);
        assert_eq!(left.after(&row(0, 2.0, true)), None);
        assert_eq!(left.after(&row(1, 1.1, true)), Some(99.0), "nothing to compare with");
        // 1e-2, 1e-3, …: the step below 1e-10 is eight further.
        let mut cost = 1.1;
        let mut times = Vec::new();
        for k in 2..6 {
            cost /= 1.0 + 10_f64.powi(-k);
            times.push(left.after(&row(k as usize, cost, true)).unwrap());
        }
        assert!((times[2] - 6.0).abs() <= 1.0 && (times[3] - 5.0).abs() <= 1.0, "{times:?}");
        // After a rejected step only the most iterations are known.
        assert_eq!(left.after(&row(6, cost, false)), Some(94.0));
    }
}
