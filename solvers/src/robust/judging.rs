//! The stages by which the closures of a graph get their weights.
//!
//! First weights by the neighbors, then graduated non-convexity, then the judgment of every closure at
//! the solution, repeated until no verdict changes; where the odometry may be trusted, a second judgment
//! from what it explains. Solves go through [`Weighted::solve`]; nothing here looks at the options of
//! callers.

use super::Weighted;
use super::screening::Screened;
use crate::geometry::LieGroup;
use crate::optimizer::{self, Observer};
use crate::pose_graph;
use crate::problem::SolveError;

/// Rounds of judging all closures after the weights have settled.
const MAX_JUDGMENTS: usize = 20;

impl<G: LieGroup<N>, const N: usize> Weighted<'_, G, N> {
    /// Begins with the supported closures. If none is supported, they cannot be distinguished, and all
    /// count.
    pub(super) fn weigh_by_support(&mut self) {
        let any = self.has_support();
        let counts = |(seen, &is_held_back): (&Screened, &bool)| {
            f64::from(u8::from(seen.is_supported || !(any || is_held_back)))
        };
        self.weights = self.screened.iter().zip(&self.held_back).map(counts).collect();
    }

    /// Weight for what the odometry explains.
    fn weights_by_odometry(&self) -> Vec<f64> {
        let explained = |seen: &Screened| {
            seen.odometry_chi2.map_or(seen.is_supported, |chi2| chi2 <= self.threshold)
        };
        self.screened.iter().map(|seen| f64::from(u8::from(explained(seen)))).collect()
    }

    pub(super) fn has_support(&self) -> bool {
        self.screened.iter().any(|seen| seen.is_supported)
    }

    /// Computes the weights of the supported closures, from a convex cost to the kernel.
    pub(super) fn graduate(&mut self, observer: &mut Observer<'_>) -> Result<(), SolveError> {
        let active: Vec<usize> =
            (0..self.weights.len()).filter(|&k| self.weights[k] > 0.0).collect();
        let options = pose_graph::Options {
            optimizer: optimizer::Options {
                max_iterations: 4,
                cost_tolerance: 1e-3,
                ..self.options.optimizer
            },
        };
        self.solve(&options, observer)?;
        let largest = |chi2: &[f64]| active.iter().map(|&k| chi2[k]).fold(0.0, f64::max);
        let mut chi2 = self.chi2();
        let Some(mut schedule) = self.kernel.schedule(largest(&chi2), self.threshold) else {
            return Ok(());
        };
        while !self.is_stopped {
            let mut change = 0.0_f64;
            for &k in &active {
                let weight = schedule.weight(chi2[k]);
                change = change.max((weight - self.weights[k]).abs());
                self.weights[k] = weight;
            }
            if change > 0.0 {
                self.solve(&options, observer)?;
                chi2 = self.chi2();
            }
            let is_decided = self.weights.iter().all(|w| *w == 0.0 || *w == 1.0);
            if !schedule.advance() || (is_decided && self.kernel.is_binary()) {
                break;
            }
        }
        Ok(())
    }

    /// Judges every closure at the poses and solves, until no verdict changes; the weights are then
    /// those of the last verdicts.
    pub(super) fn judge_closures(&mut self, observer: &mut Observer<'_>) -> Result<(), SolveError> {
        let options = self.options;
        let mut before: Vec<Vec<bool>> = Vec::new();
        for _ in 0..MAX_JUDGMENTS {
            let chi2 = self.chi2();
            let kept: Vec<bool> = chi2.iter().map(|&chi2| chi2 <= self.threshold).collect();
            for (weight, &chi2) in self.weights.iter_mut().zip(&chi2) {
                *weight = self.kernel.final_weight(chi2, self.threshold);
            }
            if before.contains(&kept) || self.is_stopped {
                break;
            }
            before.push(kept);
            self.solve(&options, observer)?;
        }
        Ok(())
    }

    /// All stages, from the present poses.
    pub(super) fn judge(
        &mut self,
        trust_odometry: bool,
        observer: &mut Observer<'_>,
    ) -> Result<(), SolveError> {
        let begin = self.graph.poses.clone();
        self.graduate(observer)?;
        self.judge_closures(observer)?;
        let weights = self.weights_by_odometry();
        if !trust_odometry || self.is_stopped || weights == self.weights {
            return Ok(());
        }
        let cost = self.objective();
        let poses = std::mem::replace(&mut self.graph.poses, begin);
        let kept = std::mem::replace(&mut self.weights, weights);
        let options = self.options;
        self.solve(&options, observer)?;
        self.judge_closures(observer)?;
        if self.is_stopped || self.objective() >= cost {
            (self.graph.poses, self.weights) = (poses, kept);
        }
        Ok(())
    }

    /// Σ χ² of the trusted edges and priors and the kernel's cost of the closures at the poses.
    pub(super) fn objective(&self) -> f64 {
        let mut closures = self.closures.iter().copied().peekable();
        let cost = |edge: usize| {
            let is_closure = closures.next_if_eq(&edge).is_some();
            let chi2 = self.chi2_of(edge);
            if is_closure { self.kernel.cost(chi2, self.threshold) } else { chi2 }
        };
        let edges: f64 = (0..self.graph.edges.len()).map(cost).sum();
        let poses = &self.graph.poses;
        let whole = self.graph.pose_priors.iter().map(|prior| prior.chi2(&poses[prior.pose]));
        let points = self.graph.position_priors.iter().map(|prior| prior.chi2(&poses[prior.pose]));
        edges + whole.chain(points).sum::<f64>()
    }
}
