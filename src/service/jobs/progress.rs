//! How much longer a solve takes, judged by its iterations so far, and a reconstruction by its stages.
//!
//! Near the optimum each step lowers the cost by about the same share of the step before; the solve ends
//! where a step lowers it by less than the tolerance of the cost. Farther away, or where steps are
//! rejected, only the most iterations that the solve may take are known: the estimate is then an upper
//! bound. The estimate is for people: no decision depends on it.

use covis_solvers::optimizer::{IterationSummary, Options};
use covis_solvers::reconstruction::{Progress, Stage};

use crate::service::convert::small;
use crate::wire::v1;

/// The stages of a reconstruction with the share of the time that each ends at, as measured on maps of some
/// hundred keyframes. A stage may be much longer in another map: the share is a rough one.
const STAGES: [(Stage, f64); 6] = [
    (Stage::ViewGraph, 0.02),
    (Stage::RelativePoses, 0.40),
    (Stage::Rotations, 0.42),
    (Stage::Positions, 0.60),
    (Stage::Adjustment, 0.95),
    (Stage::Resection, 0.97),
];

/// How far a reconstruction is. Its stages come in turns near the end, so that the share stays where it is
/// rather than to fall.
#[derive(Default)]
pub(super) struct StagesLeft {
    share: f64,
}

impl StagesLeft {
    /// Share of the work that is done, and seconds that are left; none before there is a share.
    fn after(&mut self, step: &Progress) -> (f64, Option<f64>) {
        let mut begin = 0.0;
        for (stage, end) in STAGES {
            if stage == step.stage {
                let done = step.done as f64 / step.total.max(1) as f64;
                self.share = self.share.max(begin + (end - begin) * done.min(1.0));
            }
            begin = end;
        }
        let left = (self.share > 0.0).then(|| step.seconds * (1.0 - self.share) / self.share);
        (self.share, left)
    }

    /// Shows a step as the progress of a job that does `what`.
    pub(super) fn show(&mut self, step: &Progress, what: &str, progress: &mut v1::JobProgress) {
        let &Progress { stage, done, total, cost, seconds } = step;
        let (share, time_left_s) = self.after(step);
        let (name, unit) = (stage.name(), stage.unit());
        progress.phase = format!("{what}: {name}, {done} of {total} {unit}");
        progress.share = Some(share);
        progress.time_left_s = time_left_s;
        progress.iteration = cost.map(|cost| v1::IterationSummary {
            iteration: small(done),
            cost,
            elapsed_us: (seconds * 1e6) as i64,
            ..v1::IterationSummary::default()
        });
    }
}

/// The estimate for one solve.
pub(super) struct TimeLeft {
    most: Option<usize>,
    last: Option<IterationSummary>,
    /// The share by which the last accepted step lowered the cost.
    decrease: Option<f64>,
}

impl TimeLeft {
    /// For a solve of at most so many iterations, where that says how long it takes.
    pub(super) fn new(most: Option<usize>) -> Self {
        Self { most, last: None, decrease: None }
    }

    /// Seconds that are left after an iteration; `None` after the start, and where neither the
    /// costs nor a number of iterations says it.
    pub(super) fn after(&mut self, row: &IterationSummary) -> Option<f64> {
        let last = self.last.replace(*row)?;
        let left = self.most.map(|most| most.saturating_sub(row.iteration) as f64);
        let mut iterations = left;
        if row.accepted && row.cost > 0.0 {
            let decrease = (last.cost - row.cost) / row.cost;
            if let Some(before) = self.decrease.replace(decrease)
                && decrease > 0.0
                && decrease < before
            {
                let tolerance = Options::default().cost_tolerance;
                let steps = (tolerance / decrease).ln() / (decrease / before).ln();
                iterations = Some(steps.max(0.0).ceil().min(left.unwrap_or(f64::INFINITY)));
            }
        }
        let mean = row.seconds / row.iteration.max(1) as f64;
        iterations.map(|iterations| mean * iterations)
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
    fn the_share_of_a_reconstruction_rises_while_its_stages_take_turns() {
        let mut left = StagesLeft::default();
        let mut step = |stage, done, seconds| {
            left.after(&Progress { stage, done, total: 10, cost: None, seconds })
        };
        assert_eq!(step(Stage::ViewGraph, 0, 0.0), (0.0, None));
        let (share, time) = step(Stage::RelativePoses, 5, 21.0);
        assert!((share - 0.21).abs() < 1e-12 && (time.unwrap() - 79.0).abs() < 1e-9);
        let (last, _) = step(Stage::Resection, 5, 40.0);
        assert!(last > 0.95);
        let (share, time) = step(Stage::Adjustment, 1, 48.0);
        assert_eq!(share, last, "another adjustment after a resection");
        assert!(time.unwrap() > 0.0);
    }

    #[test]
    fn a_cost_that_falls_by_a_tenth_of_the_fall_before_ends_soon() {
        let mut left = TimeLeft::new(Some(100));
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
        let mut left = TimeLeft::new(None);
        assert_eq!([2.0, 1.1].map(|cost| left.after(&row(0, cost, true))), [None, None]);
        assert!(left.after(&row(2, 1.09, true)).is_some());
    }
}
