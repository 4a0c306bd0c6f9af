//! The odometry of a graph, from each id to the next, as relative poses with covariances.
//!
//! A path along it is composed step by step ([`Chain::walk`], for short ones), or is the difference of
//! two paths from the first id ([`Chain::between`], whose cost does not grow with the length). Uses
//! edges and ids, never poses.

use nalgebra::SMatrix;

use crate::factors::{FACTORS_PER_CHUNK, RelativePose};
use crate::geometry::LieGroup;
use crate::parallel;
use crate::problem::PoseGraph;

/// A relative pose with the covariance of its right perturbation.
#[derive(Clone, Copy)]
pub(super) struct UncertainMotion<G, const N: usize> {
    pub(super) motion: G,
    pub(super) covariance: SMatrix<f64, N, N>,
}

impl<G: LieGroup<N>, const N: usize> UncertainMotion<G, N> {
    pub(super) fn exact() -> Self {
        Self { motion: G::identity(), covariance: SMatrix::zeros() }
    }

    pub(super) fn of(edge: &RelativePose<G, N>) -> Option<Self> {
        let covariance = *edge.information.covariance().ok()?.matrix();
        Some(Self { motion: edge.i_from_j, covariance })
    }

    /// Each edge of a graph; `None` for one that leaves a direction open.
    pub(super) fn all(graph: &PoseGraph<G, N>) -> Vec<Option<Self>> {
        parallel::map_in_runs(&graph.edges, FACTORS_PER_CHUNK, None, Self::of)
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

/// The edge from an id to the next.
#[derive(Clone, Copy)]
struct Link {
    from: i64,
    edge: usize,
    /// Whether pose i of the edge has the lower id.
    is_forward: bool,
}

/// The odometry of a graph.
pub(super) struct Chain<'a, G, const N: usize> {
    /// Of each edge.
    measured: &'a [Option<UncertainMotion<G, N>>],
    /// From each id to the next, by id.
    links: Vec<Link>,
    /// By id.
    reached: Vec<(i64, Reached<G, N>)>,
}

impl<'a, G: LieGroup<N>, const N: usize> Chain<'a, G, N> {
    /// The first edge from each id to the next; `measured` is that of each edge.
    pub(super) fn new(
        graph: &PoseGraph<G, N>,
        measured: &'a [Option<UncertainMotion<G, N>>],
    ) -> Self {
        let link = |(edge, measured): (usize, &Option<UncertainMotion<G, N>>)| {
            measured.as_ref()?;
            let RelativePose { i, j, .. } = graph.edges[edge];
            let (i, j) = (graph.ids[i], graph.ids[j]);
            match () {
                () if i.checked_add(1) == Some(j) => Some(Link { from: i, edge, is_forward: true }),
                () if j.checked_add(1) == Some(i) => {
                    Some(Link { from: j, edge, is_forward: false })
                }
                () => None,
            }
        };
        let mut links: Vec<Link> = measured.iter().enumerate().filter_map(link).collect();
        // Nearly always sorted, and stable: of several edges the first stays.
        links.sort_by_key(|link| link.from);
        links.dedup_by_key(|link| link.from);
        let mut chain = Self { measured, links, reached: Vec::new() };
        chain.reach();
        chain
    }

    /// Composes all pieces from their first ids.
    fn reach(&mut self) {
        let mut reached: Vec<(i64, Reached<G, N>)> = Vec::with_capacity(self.links.len() + 1);
        let first = |piece| Reached { piece, pose: G::identity(), covariance: SMatrix::zeros() };
        for link in &self.links {
            let from = match reached.last() {
                Some(&(end, reached)) if end == link.from => reached,
                last => {
                    let begin = first(last.map_or(0, |(_, before)| before.piece + 1));
                    reached.push((link.from, begin));
                    begin
                }
            };
            let Some(step) = self.step(link) else { continue };
            let pose = from.pose.compose(&step.motion);
            // X Exp(δ) = Exp(Ad(X) δ) X.
            let adjoint = pose.adjoint();
            let covariance = from.covariance + adjoint * step.covariance * adjoint.transpose();
            reached.push((link.from + 1, Reached { piece: from.piece, pose, covariance }));
        }
        self.reached = reached;
    }

    /// From the lower id of a link to the higher.
    fn step(&self, link: &Link) -> Option<UncertainMotion<G, N>> {
        let measured = self.measured[link.edge]?;
        Some(if link.is_forward { measured } else { measured.inverse() })
    }

    fn reached(&self, id: i64) -> Option<&Reached<G, N>> {
        let index = self.reached.binary_search_by_key(&id, |entry| entry.0).ok()?;
        Some(&self.reached[index].1)
    }

    /// The odometry from one id to another, step by step; `None` where a step is missing.
    pub(super) fn walk(&self, from: i64, to: i64) -> Option<UncertainMotion<G, N>> {
        if from > to {
            return self.walk(to, from).map(|measured| measured.inverse());
        }
        let mut walked = UncertainMotion::exact();
        for id in from..to {
            let index = self.links.binary_search_by_key(&id, |link| link.from).ok()?;
            walked = walked.compose(&self.step(&self.links[index])?);
        }
        Some(walked)
    }

    /// The same from the ends alone. Rounding leaves an error in the covariance of about 1e-16 of that
    /// of the way from the first id.
    pub(super) fn between(&self, from: i64, to: i64) -> Option<UncertainMotion<G, N>> {
        if from > to {
            return self.between(to, from).map(|measured| measured.inverse());
        }
        let (a, b) = (self.reached(from)?, self.reached(to)?);
        if a.piece != b.piece {
            return None;
        }
        let to_b = b.pose.inverse();
        let adjoint = to_b.adjoint();
        let covariance = adjoint * (b.covariance - a.covariance) * adjoint.transpose();
        Some(UncertainMotion { motion: a.pose.inverse().compose(&b.pose), covariance })
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
        let measured = UncertainMotion::all(&graph);
        let chain = Chain::new(&graph, &measured);
        for (from, to) in [(0, 39), (7, 30), (30, 7), (5, 5), (12, 13)] {
            let (long, short) = (chain.between(from, to).unwrap(), chain.walk(from, to).unwrap());
            assert!(long.motion.inverse().compose(&short.motion).log().norm() < 1e-9);
            let scale = short.covariance.amax().max(1e-3);
            assert!((long.covariance - short.covariance).amax() < 1e-9 * scale, "{from} {to}");
        }
        assert!(chain.between(3, 40).is_none());
    }
}
