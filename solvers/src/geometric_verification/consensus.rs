//! The pose that most matches agree on: LO-RANSAC.
//!
//! Fischler and Bolles (1981) with the local optimization of Chum, Matas and Kittler (2003): samples of
//! three matches make poses, by three points against three (Horn 1987) where the query has the depths,
//! and else by three points against their pixels ([`p3p`]); a pose that is better than all before is
//! fitted to its inliers. Poses are compared by Σ w (1 − min(χ²/τ, 1)), the gain of MSAC (Torr and
//! Zisserman 2000), and the search ends when a better sample is improbable. Depends on the seed alone.

use nalgebra::{Matrix3, Vector2, Vector3};

use super::Options;
use super::sampling::{Numbers, Sampler, samples_needed};
use crate::geometry::{Camera, LieGroup, RigidMotion, Se3};
use crate::initialization::p3p;
use crate::relative_motion::{Match, PointEstimate, RelativeMotion, measure, squared_error};
use crate::robust::default_threshold;

/// Rounds of fitting to inliers and choosing them again.
const ROUNDS: usize = 4;
/// Most inliers that such a fit takes, spread over all: its pose decides which matches agree, and is off by
/// a tenth of what a single one is; the last fit takes them all.
const FITTED: usize = 100;
/// A point nearer to the camera than this is not seen by it, m.
const NEAREST: f64 = 1e-3;
/// Median of χ² over its degrees of freedom, for 2 and 3 of them.
const MEDIANS: [f64; 2] = [0.693, 0.789];

/// A match and what it counts.
#[derive(Clone, Copy, Debug)]
pub(super) struct Weighted {
    pub(super) seen: Match,
    pub(super) weight: f64,
}

/// Matches of one query.
pub(super) struct Problem<'a> {
    pub(super) camera: &'a Camera,
    pub(super) matches: &'a [Weighted],
    pub(super) options: &'a Options,
}

/// A pose and what agrees with it.
#[derive(Clone, Debug)]
pub(super) struct Consensus {
    pub(super) pose: Se3,
    /// Indices of the matches, rising.
    pub(super) inliers: Vec<usize>,
    /// Σ w (1 − χ²/τ) over them.
    pub(super) support: f64,
}

/// χ² up to which a match with so many rows is an inlier: the 99 % quantile, for standard deviations
/// that are `allowance` times what they claim.
pub(super) fn gate(rows: usize, allowance: f64) -> f64 {
    default_threshold(rows) * allowance * allowance
}

impl Problem<'_> {
    /// The pose with most support; `None` where no sample gives one with three inliers.
    pub(super) fn search(&self, numbers: &mut Numbers) -> Option<Consensus> {
        let gates = [2, 3].map(|rows| gate(rows, self.options.sigma_allowance));
        let sampler = Sampler::new(self.matches.iter().map(|m| m.weight));
        let total: f64 = self.matches.iter().map(|m| m.weight).sum();
        let mut best: Option<Consensus> = None;
        let (mut most, mut needed, mut drawn) = (0.0, self.options.max_samples, 0);
        while drawn < needed {
            drawn += 1;
            let Some(sample) = sampler.three(numbers) else { break };
            for pose in self.poses(sample) {
                let support = support(self, gates, &pose, total, most);
                if support <= most {
                    continue;
                }
                most = support;
                let found = self.optimized(pose);
                if best.as_ref().is_none_or(|best| found.support > best.support) {
                    let inlying: f64 = found.inliers.iter().map(|&k| self.matches[k].weight).sum();
                    needed =
                        needed.min(samples_needed(inlying / total, 3, self.options.max_samples));
                    // What the fitted pose has is what others must exceed.
                    most = most.max(found.support);
                    best = Some(found);
                }
            }
        }
        best.filter(|best| best.inliers.len() >= 3)
    }

    /// The poses that a sample gives.
    fn poses(&self, sample: [usize; 3]) -> Vec<Se3> {
        let seen = sample.map(|k| &self.matches[k].seen);
        let in_a = seen.map(|seen| seen.landmark.point);
        let [Some(r0), Some(r1), Some(r2)] = seen.map(|seen| self.camera.unproject(&seen.pixel))
        else {
            return Vec::new();
        };
        if let [Some((d0, _)), Some((d1, _)), Some((d2, _))] = seen.map(|seen| seen.depth_m) {
            // A fisheye's rays are not at depth 1.
            let in_b = [r0 * (d0 / r0.z), r1 * (d1 / r1.z), r2 * (d2 / r2.z)];
            return aligned(&in_b, &in_a).into_iter().collect();
        }
        p3p(&[r0, r1, r2], &in_a)
    }

    /// The pose fitted to its inliers, as far as that gains support.
    pub(super) fn optimized(&self, pose: Se3) -> Consensus {
        // Those of a wider gate first: a sample of three is off by more than a fit of all.
        let mut best = self.consensus(pose, 1.0);
        let mut wide = 2.0;
        for _ in 0..ROUNDS {
            let around = if wide > 1.0 { self.consensus(best.pose, wide) } else { best.clone() };
            wide = 1.0;
            let every = around.inliers.len().div_ceil(FITTED).max(1);
            let some: Vec<usize> = around.inliers.iter().copied().step_by(every).collect();
            let Some(fitted) = self.fitted(&some, &best.pose) else { break };
            let next = self.consensus(fitted.motion.a_from_b, 1.0);
            if next.support <= best.support {
                break;
            }
            best = next;
        }
        best
    }

    /// What agrees with a pose, by a gate that is `wide` times as wide.
    pub(super) fn consensus(&self, pose: Se3, wide: f64) -> Consensus {
        let (mut inliers, mut support) = (Vec::new(), 0.0);
        for (index, m) in self.matches.iter().enumerate() {
            let Some((chi2, rows)) = squared_error(self.camera, &m.seen, &pose) else { continue };
            let share = chi2 / gate(rows, self.options.sigma_allowance * wide);
            if share <= 1.0 {
                inliers.push(index);
                support += m.weight * (1.0 - share);
            }
        }
        Consensus { pose, inliers, support }
    }

    /// The least-squares pose of some matches, with their standard deviations as large as their
    /// residuals at `start` and then at the result say, at least as large as claimed.
    pub(super) fn fitted(&self, inliers: &[usize], start: &Se3) -> Option<Fitted> {
        let mut fitted: Option<Fitted> = None;
        for _ in 0..2 {
            let pose = fitted.as_ref().map_or(*start, |fitted| fitted.motion.a_from_b);
            let variance = self.variance(inliers, &pose).max(1.0);
            let matches: Vec<Match> =
                inliers.iter().map(|&k| scaled(&self.matches[k].seen, variance)).collect();
            let motion = measure(self.camera, &matches, &pose)?;
            fitted = Some(Fitted { motion, matches, variance });
        }
        fitted
    }

    /// The median of χ² over what it is of normal errors: wrong matches move it little.
    fn variance(&self, inliers: &[usize], pose: &Se3) -> f64 {
        let mut ratios: Vec<f64> = inliers
            .iter()
            .filter_map(|&k| squared_error(self.camera, &self.matches[k].seen, pose))
            .map(|(chi2, rows)| chi2 / (rows as f64 * MEDIANS[usize::from(rows > 2)]))
            .collect();
        ratios.sort_unstable_by(f64::total_cmp);
        ratios.get(ratios.len() / 2).copied().unwrap_or(1.0)
    }
}

/// A fit, and the matches with the standard deviations that it took.
pub(super) struct Fitted {
    pub(super) motion: RelativeMotion,
    pub(super) matches: Vec<Match>,
    /// By what their variances were multiplied.
    pub(super) variance: f64,
}

/// A match whose covariances are `variance` times as large.
fn scaled(seen: &Match, variance: f64) -> Match {
    let factor = variance.sqrt();
    let mut scaled = *seen;
    scaled.landmark.covariance *= variance;
    scaled.sigma_px *= factor;
    scaled.depth_m = seen.depth_m.map(|(depth, sigma)| (depth, sigma * factor));
    scaled
}

/// The rigid motion that takes three points to three others with the least sum of squares (Horn 1987, by
/// matrices as Umeyama 1991).
fn aligned(from: &[Vector3<f64>; 3], to: &[Vector3<f64>; 3]) -> Option<Se3> {
    let center = |p: &[Vector3<f64>; 3]| (p[0] + p[1] + p[2]) / 3.0;
    let (a, b) = (center(from), center(to));
    let mut covariance = Matrix3::zeros();
    for (x, y) in from.iter().zip(to) {
        covariance += (y - b) * (x - a).transpose();
    }
    // On one line the turn about it is open.
    let normal = (from[1] - from[0]).cross(&(from[2] - from[0])).norm();
    let longest = (from[1] - from[0]).norm_squared().max((from[2] - from[0]).norm_squared());
    if normal.is_nan() || normal <= 1e-3 * longest {
        return None;
    }
    let turn = Se3::from_matrix(&covariance, &Vector3::zeros())?;
    let motion = Se3::new(turn.rotation, b - turn.transform(&a));
    motion.is_finite().then_some(motion)
}

/// Where a point is seen, and how far its own covariance spreads it there.
pub(super) struct Projected {
    pub(super) pixel: Vector2<f64>,
    /// Covariance of (u, v, depth), the query's own noise not included.
    pub(super) c00: f64,
    pub(super) c01: f64,
    pub(super) c11: f64,
    c02: f64,
    c12: f64,
    pub(super) c22: f64,
    pub(super) depth: f64,
    /// From the camera.
    pub(super) distance: f64,
}

impl Projected {
    /// With the projection's derivative without distortion: poses are compared by it, not fitted.
    #[inline]
    pub(super) fn new(
        camera: &Camera,
        estimate: &PointEstimate,
        b_from_a: &Matrix3<f64>,
        origin: &Vector3<f64>,
    ) -> Option<Self> {
        let p = b_from_a * estimate.point + origin;
        if p.z.is_nan() || p.z < NEAREST {
            return None;
        }
        let pixel = camera.project(&p)?;
        let scale = camera.mean_focal_px() / p.z;
        let (x, y) = (p.x / p.z, p.y / p.z);
        let rows = [
            (b_from_a.row(0) - b_from_a.row(2) * x) * scale,
            (b_from_a.row(1) - b_from_a.row(2) * y) * scale,
            b_from_a.row(2).into_owned(),
        ];
        let spread = rows.map(|row| estimate.covariance * row.transpose());
        let entry = |i: usize, j: usize| (rows[i] * spread[j]).x;
        Some(Self {
            pixel,
            c00: entry(0, 0),
            c01: entry(0, 1),
            c11: entry(1, 1),
            c02: entry(0, 2),
            c12: entry(1, 2),
            c22: entry(2, 2),
            depth: p.z,
            distance: p.norm(),
        })
    }

    /// χ² of a match; infinite where the covariance is not definite, which may have a negative one.
    #[inline]
    fn chi2(&self, seen: &Match) -> f64 {
        let noise = seen.sigma_px * seen.sigma_px;
        let error = self.pixel - seen.pixel;
        // Cholesky's decomposition, a row at a time.
        let (c00, c11) = (self.c00 + noise, self.c11 + noise);
        let l10 = self.c01 / c00;
        let d1 = c11 - l10 * self.c01;
        let e1 = error.y - l10 * error.x;
        let chi2 = error.x * error.x / c00 + e1 * e1 / d1;
        let is_definite = c00 > 0.0 && d1 > 0.0;
        if !is_definite {
            return f64::INFINITY;
        }
        let Some((depth, sigma)) = seen.depth_m else { return chi2 };
        let l20 = self.c02 / c00;
        let m21 = self.c12 - l20 * self.c01;
        let l21 = m21 / d1;
        let d2 = self.c22 + sigma * sigma - l20 * self.c02 - l21 * m21;
        let e2 = self.depth - depth - l20 * error.x - l21 * e1;
        if d2 > 0.0 { chi2 + e2 * e2 / d2 } else { f64::INFINITY }
    }
}

/// The gain of a pose; 0 as soon as it cannot exceed `most`.
fn support(problem: &Problem<'_>, gates: [f64; 2], pose: &Se3, total: f64, most: f64) -> f64 {
    let inverse = pose.inverse();
    let (b_from_a, origin) = (inverse.rotation.matrix(), inverse.translation);
    let (mut gained, mut left) = (0.0, total);
    for m in problem.matches {
        let gate = gates[usize::from(m.seen.depth_m.is_some())];
        let at = Projected::new(problem.camera, &m.seen.landmark, &b_from_a, &origin);
        let chi2 = at.map_or(f64::INFINITY, |at| at.chi2(&m.seen));
        // A number that is not one gains nothing.
        if chi2 < gate {
            gained += m.weight * (1.0 - chi2 / gate);
        }
        left -= m.weight;
        if gained + left < most {
            return 0.0;
        }
    }
    gained
}
