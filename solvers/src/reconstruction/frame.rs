//! The frame and the scale of a reconstruction, which views alone leave open.
//!
//! By itself: the lowest placed keyframe is the origin, and without a measured length the median depth of
//! the bearings is 1 m. Onto given poses: the similarity, or the rigid motion where the scale is measured,
//! that takes the poses to those given, by a mean of the turns and a fit of the centers that both weigh a
//! pose by one over its distance, so that poses that are wrong do not matter (Weiszfeld 1937). It moves
//! and scales the estimate as a whole.

use nalgebra::{Matrix3, Vector3};

use super::Estimate;
use super::bearings::{Bearing, Bearings};
use super::points::squared_error;
use crate::factors::Reprojection;
use crate::geometry::{LieGroup, Se3, Sim3, So3};
use crate::problem::BundleProblem;

/// Fits; they settle after some ten.
const FITS: usize = 40;
/// A distance below this share of the median weighs as if it were so large.
const LEAST_SHARE: f64 = 1e-3;

fn apply(similarity: &Sim3, estimate: &mut Estimate) {
    for pose in estimate.poses.iter_mut().flatten() {
        *pose = similarity.transform_pose(pose);
    }
    for point in estimate.points.iter_mut().flatten() {
        *point = similarity.transform(point);
    }
}

/// Makes every length `scale` times as long.
pub(super) fn rescale(estimate: &mut Estimate, scale: f64) {
    apply(&Sim3 { scale, ..Sim3::identity() }, estimate);
}

/// The lowest placed keyframe becomes the origin; with `has_scale` lengths stay.
pub(super) fn to_own(bearings: &Bearings, estimate: &mut Estimate, has_scale: bool) {
    let Some(first) = estimate.poses.iter().flatten().next().copied() else { return };
    apply(&first.inverse().into(), estimate);
    if has_scale {
        return;
    }
    let used = bearings.all.iter().zip(&estimate.used).filter(|(_, used)| **used);
    let mut depths: Vec<f64> = used
        .filter_map(|(bearing, _)| {
            let (pose, point) = (estimate.poses[bearing.pose]?, estimate.points[bearing.landmark]?);
            Some(pose.inverse_transform(&point).z)
        })
        .collect();
    let median = super::median(&mut depths);
    if median > 0.0 && median.is_finite() {
        rescale(estimate, 1.0 / median);
    }
}

/// Onto the given poses of the placed keyframes; whether that gave the scale, which takes centers that
/// are not all in one place.
pub(super) fn to_given(given: &[Se3], estimate: &mut Estimate, has_scale: bool) -> bool {
    let pairs: Vec<(Se3, Se3)> = estimate
        .poses
        .iter()
        .zip(given)
        .filter_map(|(own, given)| own.map(|own| (own, *given)))
        .collect();
    if pairs.is_empty() {
        return false;
    }
    let rotation = mean_turn(&pairs);
    let centers: Vec<(Vector3<f64>, Vector3<f64>)> = pairs
        .iter()
        .map(|(own, given)| (rotation.rotate(&own.translation), given.translation))
        .collect();
    let (scale, translation, is_measured) = fit(&centers, has_scale);
    apply(&Sim3 { rotation, translation, scale }, estimate);
    is_measured
}

/// The turn R with the least sum of angles between R R_own and R_given.
fn mean_turn(pairs: &[(Se3, Se3)]) -> So3 {
    let turns: Vec<So3> =
        pairs.iter().map(|(own, given)| given.rotation.compose(&own.rotation.inverse())).collect();
    let mut weights = vec![1.0; turns.len()];
    let mut mean = So3::identity();
    for _ in 0..FITS {
        let sum = turns
            .iter()
            .zip(&weights)
            .fold(Matrix3::zeros(), |sum, (turn, weight)| sum + turn.matrix() * *weight);
        mean = So3::from_matrix(&sum);
        let distances: Vec<f64> =
            turns.iter().map(|turn| mean.inverse().compose(turn).log().norm()).collect();
        weights = inverse(&distances);
    }
    mean
}

/// Scale and shift of the pairs (x, y): s x + t = y.
fn fit(pairs: &[(Vector3<f64>, Vector3<f64>)], has_scale: bool) -> (f64, Vector3<f64>, bool) {
    let mut weights = vec![1.0; pairs.len()];
    let (mut scale, mut shift, mut is_measured) = (1.0, Vector3::zeros(), has_scale);
    for _ in 0..FITS {
        let total: f64 = weights.iter().sum();
        let (mut x, mut y) = (Vector3::zeros(), Vector3::zeros());
        for ((own, given), weight) in pairs.iter().zip(&weights) {
            x += own * (weight / total);
            y += given * (weight / total);
        }
        if !has_scale {
            let (mut product, mut squared) = (0.0, 0.0);
            for ((own, given), weight) in pairs.iter().zip(&weights) {
                product += weight * (own - x).dot(&(given - y));
                squared += weight * (own - x).norm_squared();
            }
            is_measured = product > 0.0 && squared > 0.0 && (product / squared).is_finite();
            if is_measured {
                scale = product / squared;
            }
        }
        shift = y - x * scale;
        let distances: Vec<f64> =
            pairs.iter().map(|(own, given)| (own * scale + shift - given).norm()).collect();
        weights = inverse(&distances);
    }
    (scale, shift, is_measured)
}

/// One over each distance, none larger than the median distance allows.
fn inverse(distances: &[f64]) -> Vec<f64> {
    let least = LEAST_SHARE * super::median(&mut distances.to_vec());
    distances.iter().map(|distance| 1.0 / distance.max(least).max(1e-12)).collect()
}

/// The scale by which the lengths of relative poses between placed keyframes are met: the median of their
/// ratios; `None` where there are none.
pub(super) fn scale_by_relative_poses(problem: &BundleProblem, estimate: &Estimate) -> Option<f64> {
    let mut ratios: Vec<f64> = problem
        .relative_poses
        .iter()
        .filter_map(|factor| {
            let (i, j) = (estimate.poses[factor.i]?, estimate.poses[factor.j]?);
            let own = (j.translation - i.translation).norm();
            let measured = factor.i_from_j.translation.norm();
            (own > 0.0 && measured > 0.0).then(|| measured / own)
        })
        .collect();
    let median = super::median(&mut ratios);
    (!ratios.is_empty() && median > 0.0 && median.is_finite()).then_some(median)
}

/// Median of the whitened errors of the used bearings over what it is of normal noise, at least 1.
pub(super) fn noise_factor(bearings: &Bearings, estimate: &Estimate) -> f64 {
    /// Median of the root of χ² with two degrees of freedom.
    const MEDIAN: f64 = 1.177;
    let used = bearings.all.iter().zip(&estimate.used).filter(|(_, used)| **used);
    let mut errors: Vec<f64> = used
        .filter_map(|(bearing, _)| {
            let (pose, point) = (estimate.poses[bearing.pose]?, estimate.points[bearing.landmark]?);
            let seen = Reprojection { depth_m: None, ..bearing.seen };
            let plain = Bearing { seen, ..*bearing };
            Some(squared_error(&plain, &pose, estimate, &point).sqrt())
        })
        .collect();
    (super::median(&mut errors) / MEDIAN).max(1.0)
}
