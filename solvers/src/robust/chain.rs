//! The odometry of a graph, from each id to the next, as relative poses with covariances.
//!
//! A path along it is composed step by step ([`Chain::walk`], for short ones), or is the difference of
//! two paths from the first id ([`Chain::between`], whose cost does not grow with the length). Uses
//! edges and ids, never poses.

use std::collections::BTreeMap;

use nalgebra::SMatrix;

use crate::factors::RelativePose;
use crate::geometry::LieGroup;
use crate::problem::PoseGraph;

/// A relative pose with the covariance of its right perturbation.
#[derive(Clone, Copy)]
pub(super) struct Measured<G, const N: usize> {
    pub(super) motion: G,
    pub(super) covariance: SMatrix<f64, N, N>,
}

impl<G: LieGroup<N>, const N: usize> Measured<G, N> {
    pub(super) fn exact() -> Self {
        Self { motion: G::identity(), covariance: SMatrix::zeros() }
    }

    pub(super) fn of(edge: &RelativePose<G, N>) -> Option<Self> {
        let covariance = *edge.information.covariance().ok()?.matrix();
        Some(Self { motion: edge.i_from_j, covariance })
    }

    /// Z⁻¹: Exp(−δ) Z⁻¹ = Z⁻¹ Exp(−Ad(Z) δ).
    pub(super) fn inverse(&self) -> Self {
        let adjoint = self.motion.adjoint();
        let covariance = adjoint * self.covariance * adjoint.transpose();
        Self { motion: self.motion.inverse(), covariance }
    }

    /// X Y: X Exp(δ) Y = X Y Exp(Ad(Y⁻¹) δ).
    pub(super) fn compose(&self, other: &Self) -> Self {
        let adjoint = other.motion.inverse().adjoint();
        let moved = adjoint * self.covariance * adjoint.transpose();
        Self { motion: self.motion.compose(&other.motion), covariance: moved + other.covariance }
    }
}

/// A pose in the frame of the first id of its piece, with the covariance of its left perturbation.
#[derive(Clone, Copy)]
struct Reached<G, const N: usize> {
    piece: usize,
    pose: G,
    covariance: SMatrix<f64, N, N>,
}

/// The odometry of a graph.
pub(super) struct Chain<G, const N: usize> {
    /// From each id to the next.
    steps: BTreeMap<i64, Measured<G, N>>,
    reached: BTreeMap<i64, Reached<G, N>>,
}

impl<G: LieGroup<N>, const N: usize> Chain<G, N> {
    /// The first edge from each id to the next.
    pub(super) fn new(graph: &PoseGraph<G, N>) -> Self {
        let mut steps = BTreeMap::new();
        for edge in &graph.edges {
            let (i, j) = (graph.ids[edge.i], graph.ids[edge.j]);
            let Some(measured) = Measured::of(edge) else { continue };
            if i.checked_add(1) == Some(j) {
                steps.entry(i).or_insert(measured);
            } else if j.checked_add(1) == Some(i) {
                steps.entry(j).or_insert_with(|| measured.inverse());
            }
        }
        let mut reached = BTreeMap::new();
        let first = |piece| Reached { piece, pose: G::identity(), covariance: SMatrix::zeros() };
        let mut last: Option<(i64, Reached<G, N>)> = None;
        for (&id, step) in &steps {
            let from = match last {
                Some((end, reached)) if end == id => reached,
                Some((_, before)) => first(before.piece + 1),
                None => first(0),
            };
            reached.insert(id, from);
            let pose = from.pose.compose(&step.motion);
            // X Exp(δ) = Exp(Ad(X) δ) X.
            let adjoint = pose.adjoint();
            let covariance = from.covariance + adjoint * step.covariance * adjoint.transpose();
            let to = Reached { piece: from.piece, pose, covariance };
            reached.insert(id + 1, to);
            last = Some((id + 1, to));
        }
        Self { steps, reached }
    }

    /// The odometry from one id to another, step by step; `None` where a step is missing.
    pub(super) fn walk(&self, from: i64, to: i64) -> Option<Measured<G, N>> {
        if from > to {
            return self.walk(to, from).map(|measured| measured.inverse());
        }
        let mut walked = Measured::exact();
        for id in from..to {
            walked = walked.compose(self.steps.get(&id)?);
        }
        Some(walked)
    }

    /// The same from the ends alone. Rounding leaves an error in the covariance of about 1e-16 of that
    /// of the way from the first id.
    pub(super) fn between(&self, from: i64, to: i64) -> Option<Measured<G, N>> {
        if from > to {
            return self.between(to, from).map(|measured| measured.inverse());
        }
        let (a, b) = (self.reached.get(&from)?, self.reached.get(&to)?);
        if a.piece != b.piece {
            return None;
        }
        let to_b = b.pose.inverse();
        let adjoint = to_b.adjoint();
        let covariance = adjoint * (b.covariance - a.covariance) * adjoint.transpose();
        Some(Measured { motion: a.pose.inverse().compose(&b.pose), covariance })
    }
}

#[cfg(test)]
mod tests {
    use nalgebra::Vector6;

    use super::*;
    use crate::geometry::Se3;
    use crate::information::Information;
    use crate::testing::random::{element, seeded};

    #[test]
    fn a_path_by_its_ends_is_the_path_step_by_step() {
        let mut rng = seeded(1);
        let mut graph: PoseGraph<Se3, 6> = PoseGraph::new();
        let poses: Vec<usize> = (0..40).map(|id| graph.push_pose(id, Se3::identity())).collect();
        let sigmas = Vector6::new(0.1, 0.2, 0.1, 0.01, 0.02, 0.03);
        let information = Information::from_sigmas(&sigmas).unwrap();
        for pair in poses.windows(2) {
            let i_from_j = element(&mut rng, 0.3);
            graph.edges.push(RelativePose {
                i: pair[0],
                j: pair[1],
                i_from_j,
                information,
                loss: None,
            });
        }
        let chain = Chain::new(&graph);
        for (from, to) in [(0, 39), (7, 30), (30, 7), (5, 5), (12, 13)] {
            let (long, short) = (chain.between(from, to).unwrap(), chain.walk(from, to).unwrap());
            assert!(long.motion.inverse().compose(&short.motion).log().norm() < 1e-9);
            let scale = short.covariance.amax().max(1e-3);
            assert!((long.covariance - short.covariance).amax() < 1e-9 * scale, "{from} {to}");
        }
        assert!(chain.between(3, 40).is_none());
    }
}
