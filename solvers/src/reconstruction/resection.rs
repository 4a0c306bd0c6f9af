//! The pose of a keyframe from points that it sees: P3P within RANSAC, then least squares.
//!
//! The points are those of a map, in its world, or those that another keyframe measures by depth, in the
//! frame of that keyframe: the relative pose of two keyframes with depth is a resection. Hypotheses are
//! judged by the whitened error in the image; the last fit is [`crate::relative_motion`]'s, in which the
//! points' own covariances and the depths of the keyframe count. The keyframe's own pose is never read.

use nalgebra::Vector3;

use super::bearings::Bearing;
use crate::factors::Reprojection;
use crate::geometric_verification::{Numbers, distinct, samples_needed};
use crate::geometry::{Camera, LieGroup, Se3};
use crate::initialization::p3p;
use crate::relative_motion::{Match, PointEstimate, RelativeMotion, measure};
use crate::robust::default_threshold;

/// Fewest samples, since noise in a sample hides what agrees.
const MIN_SAMPLES: usize = 16;
/// Most samples.
const MAX_SAMPLES: usize = 400;
/// A sample of three is off by more than a fit of all: what is fitted first may be so many times as far.
const WIDE: f64 = 3.0;

/// A point and how the keyframe sees it.
#[derive(Clone, Copy, Debug)]
pub(super) struct ObservedPoint<'a> {
    pub(super) point: PointEstimate,
    pub(super) bearing: &'a Bearing,
}

/// A pose and the indices of what agrees with it.
#[derive(Clone, Debug)]
pub(super) struct Resected {
    pub(super) motion: RelativeMotion,
    pub(super) inliers: Vec<bool>,
    pub(super) count: usize,
}

/// Searches and refines. All bearings are of one camera.
///
/// # Errors
/// How many agree at best, where those are fewer than `min_inliers` or leave the pose open.
pub(super) fn resect(
    camera: &Camera,
    seen: &[ObservedPoint<'_>],
    allowance: f64,
    min_inliers: usize,
    numbers: &mut Numbers,
) -> Result<Resected, usize> {
    let count = seen.len();
    if count < min_inliers.max(crate::relative_motion::MIN_MATCHES) {
        return Err(0);
    }
    let gate = default_threshold(2) * allowance * allowance;
    let mut best: Option<Se3> = None;
    let (mut most, mut most_wide, mut agreeing_most) = (0.0, 0.0, 0);
    let (mut needed, mut drawn) = (MAX_SAMPLES, 0);
    while drawn < needed.max(MIN_SAMPLES) {
        drawn += 1;
        let sample = distinct::<3>(numbers, count);
        let rays = sample.map(|k| seen[k].bearing.ray);
        for pose in p3p(&rays, &sample.map(|k| seen[k].point.point)) {
            let (gained, _) = support(camera, seen, &pose, gate * WIDE * WIDE);
            if gained <= most_wide {
                continue;
            }
            most_wide = gained;
            let pose = fitted(camera, seen, &pose, gate * WIDE * WIDE)
                .map_or(pose, |motion| motion.a_from_b);
            let (gained, agreeing) = support(camera, seen, &pose, gate);
            if gained > most {
                (most, agreeing_most) = (gained, agreeing);
                needed = samples_needed(agreeing as f64 / count as f64, 3, MAX_SAMPLES);
                best = Some(pose);
            }
        }
    }
    let best = best.ok_or(0_usize)?;
    let motion = fitted(camera, seen, &best, gate).ok_or(agreeing_most)?;
    let inliers: Vec<bool> =
        seen.iter().map(|s| squared(camera, s, &motion.a_from_b) < gate).collect();
    let count = inliers.iter().filter(|&&agrees| agrees).count();
    if count >= min_inliers { Ok(Resected { motion, inliers, count }) } else { Err(count) }
}

/// The least-squares pose of what is within a gate.
fn fitted(
    camera: &Camera,
    seen: &[ObservedPoint<'_>],
    pose: &Se3,
    gate: f64,
) -> Option<RelativeMotion> {
    let matches: Vec<Match> = seen
        .iter()
        .filter(|s| squared(camera, s, pose) < gate)
        .map(|s| Match {
            landmark: s.point,
            pixel: s.bearing.seen.pixel,
            sigma_px: s.bearing.seen.sigma_px,
            depth_m: s.bearing.seen.depth_m,
        })
        .collect();
    measure(camera, &matches, pose)
}

/// χ² in the image, two degrees of freedom, with the point's own covariance as far as it spreads
/// across the ray.
fn squared(camera: &Camera, seen: &ObservedPoint<'_>, pose: &Se3) -> f64 {
    let in_camera = pose.inverse_transform(&seen.point.point);
    if in_camera.z.is_nan() || in_camera.z <= 0.0 {
        return f64::INFINITY;
    }
    let bearing = seen.bearing;
    let factor = Reprojection { depth_m: None, ..bearing.seen };
    let chi2 = factor.squared_error(&Se3::identity(), camera, &in_camera);
    // As if the covariance were a ball as large as its mean.
    let spread = seen.point.covariance.trace() / 3.0 / in_camera.norm_squared();
    chi2 / (1.0 + spread / (bearing.sigma_rad * bearing.sigma_rad))
}

/// The gain of MSAC and how many agree.
fn support(camera: &Camera, seen: &[ObservedPoint<'_>], pose: &Se3, gate: f64) -> (f64, usize) {
    seen.iter()
        .map(|s| squared(camera, s, pose))
        .filter(|&chi2| chi2 < gate)
        .fold((0.0, 0), |(gained, count), chi2| (gained + 1.0 - chi2 / gate, count + 1))
}

/// A point that is taken for exact.
pub(super) fn exact(point: Vector3<f64>) -> PointEstimate {
    PointEstimate { point, covariance: nalgebra::Matrix3::zeros() }
}
