//! The edges of the view graph: relative rotations of pairs of keyframes with what they are worth.
//!
//! Where depth is there, a pair is three-dimensional points against pixels (`resection`), else rays
//! against rays (`two_views`). Pairs are independent of each other and measured side by side; each has a
//! seed of its own. It reads no pose and no landmark of the problem.

use nalgebra::Matrix3;

use super::bearings::Bearings;
use super::resection::{ObservedPoint, resect};
use super::two_views::{RayPair, two_views};
use super::view_graph::Candidate;
use crate::geometric_verification::Numbers;
use crate::geometry::{Camera, LieGroup, So3};
use crate::interrupt::Interrupt;
use crate::parallel;
use crate::relative_motion::PointEstimate;

/// Share of the common landmarks that must agree.
const LEAST_SHARE: f64 = 0.25;

/// A measured pair.
#[derive(Clone, Debug)]
pub(super) struct Edge {
    pub(super) a: usize,
    pub(super) b: usize,
    /// Rotation of `b_from_a`.
    pub(super) rotation: So3,
    /// Information of a left perturbation of it, 1/rad².
    pub(super) information: Matrix3<f64>,
    pub(super) inliers: usize,
    /// Bearings of both keyframes with whether they agree.
    pub(super) votes: Vec<(u32, u32, bool)>,
    /// Whether the rays show a baseline; always true with depth.
    pub(super) has_parallax: bool,
}

/// What pairs are measured by.
#[derive(Clone, Copy, Debug)]
pub(super) struct Measuring<'a> {
    pub(super) bearings: &'a Bearings,
    pub(super) cameras: &'a [Camera],
    pub(super) allowance: f64,
    pub(super) min_common: usize,
    pub(super) seed: u64,
}

impl Measuring<'_> {
    /// Measures pairs; those that fail are missing. `done` is called after each chunk. Ends early, with
    /// the pairs measured so far, where `interrupt` is due or `done` returns false.
    pub(super) fn all(
        &self,
        pairs: &[Candidate],
        interrupt: &Interrupt,
        done: &mut dyn FnMut(usize) -> bool,
    ) -> Vec<Edge> {
        /// Pairs that are measured between two reports.
        const CHUNK: usize = 256;
        let mut edges = Vec::new();
        for (index, chunk) in pairs.chunks(CHUNK).enumerate() {
            let measure = |pair| if interrupt.is_due() { None } else { self.one(pair) };
            let measured = parallel::map(chunk.iter(), measure);
            edges.extend(measured.into_iter().flatten());
            if interrupt.is_due() || !done(index * CHUNK + chunk.len()) {
                break;
            }
        }
        edges
    }

    fn one(&self, pair: &Candidate) -> Option<Edge> {
        let Candidate { a, b, .. } = *pair;
        let common = self.bearings.common(a, b);
        let least = self.min_common.max((common.len() as f64 * LEAST_SHARE) as usize);
        let mut numbers = Numbers::new(
            self.seed ^ (a as u64).wrapping_mul(0x9e37_79b9_7f4a_7c15) ^ (b as u64).rotate_left(32),
        );
        let with_depth = |side: fn(&(u32, u32)) -> u32| {
            let measured = common
                .iter()
                .filter(|pair| self.bearings.get(side(pair)).point_in_camera().is_some());
            measured.count()
        };
        let (depth_a, depth_b) = (with_depth(|p| p.0), with_depth(|p| p.1));
        if depth_a.max(depth_b) >= least && 2 * depth_a.max(depth_b) >= common.len() {
            let edge = self.by_depth(pair, &common, depth_b > depth_a, least, &mut numbers);
            if edge.is_some() {
                return edge;
            }
        }
        self.by_rays(pair, &common, least, &mut numbers)
    }

    fn by_rays(
        &self,
        pair: &Candidate,
        common: &[(u32, u32)],
        least: usize,
        numbers: &mut Numbers,
    ) -> Option<Edge> {
        let rays: Vec<RayPair> = common
            .iter()
            .map(|&(s, t)| {
                let (s, t) = (self.bearings.get(s), self.bearings.get(t));
                RayPair { a: s.ray, b: t.ray, sigma_a: s.sigma_rad, sigma_b: t.sigma_rad }
            })
            .collect();
        let found = two_views(&rays, self.allowance, least, numbers)?;
        let votes = common.iter().zip(&found.inliers).map(|(&(s, t), &agrees)| (s, t, agrees));
        Some(Edge {
            a: pair.a,
            b: pair.b,
            rotation: found.rotation,
            information: found.information,
            inliers: found.inliers.iter().filter(|&&agrees| agrees).count(),
            votes: votes.collect(),
            has_parallax: found.parallax_sigmas > super::LEAST_PARALLAX_SIGMAS,
        })
    }

    /// With the points that one of the two measures, b where `swapped`.
    fn by_depth(
        &self,
        pair: &Candidate,
        common: &[(u32, u32)],
        swapped: bool,
        least: usize,
        numbers: &mut Numbers,
    ) -> Option<Edge> {
        let ordered = |&(s, t): &(u32, u32)| if swapped { (t, s) } else { (s, t) };
        let camera = self.bearings.get(ordered(common.first()?).1).camera;
        let mut seen = Vec::with_capacity(common.len());
        let mut indices = Vec::with_capacity(common.len());
        for pair in common {
            let (from, to) = ordered(pair);
            let (from, to) = (self.bearings.get(from), self.bearings.get(to));
            let Some((point, distance, sigma)) = from.point_in_camera() else { continue };
            if to.camera != camera {
                continue;
            }
            let across = (distance * from.sigma_rad).powi(2);
            let along = from.ray * from.ray.transpose();
            let covariance =
                Matrix3::identity() * across + along * (sigma * sigma - across).max(0.0);
            seen.push(ObservedPoint { point: PointEstimate { point, covariance }, bearing: to });
            indices.push(*pair);
        }
        let found = resect(&self.cameras[camera], &seen, self.allowance, least, numbers).ok()?;
        let a_from_b = found.motion.a_from_b.rotation;
        // The information is of a right perturbation of the pose of the one that sees the points.
        let covariance = found.motion.information.matrix().try_inverse()?;
        let of_turn: Matrix3<f64> = covariance.fixed_view::<3, 3>(3, 3).into_owned();
        let (rotation, information) = if swapped {
            // R Exp(δ) = Exp(R δ) R: into the frame on the left.
            let turn = a_from_b.matrix();
            (a_from_b, (turn * of_turn * turn.transpose()).try_inverse()?)
        } else {
            (a_from_b.inverse(), of_turn.try_inverse()?)
        };
        let votes = indices.iter().zip(&found.inliers).map(|(&(s, t), &agrees)| (s, t, agrees));
        Some(Edge {
            a: pair.a,
            b: pair.b,
            rotation,
            information,
            inliers: found.count,
            votes: votes.collect(),
            has_parallax: true,
        })
    }
}
