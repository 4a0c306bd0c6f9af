//! How long each residual of a problem is: what histograms and colored pictures are made of.
//!
//! The numbers are those that [`super::bundle_cost`] and [`super::pose_graph_cost`] sum up. What an index
//! out of range makes of a factor is not a number. Losses are not applied.

use super::cost::{edge_chi2, observed};
use super::reference::ReferencePose;
use crate::problem::{BundleProblem, PoseGraph};

/// The residuals of all observations: those without a depth first, then those with one.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct ObservationLengths {
    /// The pose of each observation.
    pub poses: Vec<u32>,
    /// ‖(u, v) − measured‖ of each observation, pixels, not whitened and without loss.
    pub pixels_px: Vec<f64>,
    /// |z − measured| of each observation that has a depth, meters.
    pub depths_m: Vec<f64>,
}

impl ObservationLengths {
    /// Those of a problem as it stands.
    #[must_use]
    pub fn of(problem: &BundleProblem) -> Self {
        let mut lengths = Self::default();
        for seen in observed(problem) {
            lengths.poses.push(seen.pose);
            lengths.pixels_px.push(seen.square.sqrt());
            lengths.depths_m.extend(seen.depth_error.map(|(error, _)| error.abs()));
        }
        lengths
    }

    /// √(Σ ‖r‖² / N) of the pixels of each of `count` poses; 0 for one without observations.
    #[must_use]
    pub fn rmse_px_by_pose(&self, count: usize) -> Vec<f64> {
        let mut sums = vec![(0.0, 0_usize); count];
        for (&pose, length) in self.poses.iter().zip(&self.pixels_px) {
            if let Some((square, observations)) = sums.get_mut(pose as usize) {
                *square += length * length;
                *observations += 1;
            }
        }
        sums.into_iter().map(|(square, n)| (square / n.max(1) as f64).sqrt()).collect()
    }
}

/// √(rᵀΩr) of each edge of a pose graph, in standard deviations, without loss; 0 where rounding makes rᵀΩr
/// negative.
#[must_use]
pub fn edge_lengths<G: ReferencePose<N>, const N: usize>(graph: &PoseGraph<G, N>) -> Vec<f64> {
    let length = |chi2: f64| if chi2 < 0.0 { 0.0 } else { chi2.sqrt() };
    graph.edges.iter().map(|edge| length(edge_chi2(edge, &graph.poses))).collect()
}
