//! Further matches once a pose is known: the candidate's points are projected, and features that look
//! alike are searched around the projections.
//!
//! A pair is taken where each is the other's most alike within the gate, clearly more alike than the
//! second. Decides nothing about the pose.

use super::consensus::{Projected, gate};
use super::{Input, Options, weighted_once};
use crate::geometry::{LieGroup, Se3};
use crate::point_matching::{Likeness, MutualBest, RATIO};
use crate::relative_motion::{PointEstimate, squared_error};

/// Features that look like a point, in the mean of all points, above which nothing is taken: twice as many
/// as make one point ambiguous in [`crate::point_matching`]. It bounds what equal descriptors cost.
const MOST_ALIKE: usize = 64;

/// Largest ratio of the distances from which a corner is seen and found again: pyramids of features reach
/// over 1.2⁷ = 3.6 (Rublee et al., ORB, 2011).
const LARGEST_RATIO: f64 = 4.0;
/// Largest standard deviation of where a point is in the image, rad. What is spread over more is right before
/// the lens, or hardly known, and any feature fits it.
const MOST_SPREAD: f64 = 0.1;

/// Pairs (point, feature) of those that are in no pair of `taken`, by rising point.
pub(super) fn search(
    input: &Input<'_>,
    taken: &[(usize, usize)],
    pose: &Se3,
    likeness: &dyn Fn(usize, usize) -> Likeness,
    options: &Options,
) -> Vec<(usize, usize)> {
    let mut is_point_free = vec![true; input.points.len()];
    let mut is_feature_free = vec![true; input.features.len()];
    for &(point, feature) in taken {
        (is_point_free[point], is_feature_free[feature]) = (false, false);
    }
    let mut by_u: Vec<usize> =
        (0..input.features.len()).filter(|&feature| is_feature_free[feature]).collect();
    by_u.sort_by(|&a, &b| {
        input.features[a].pixel.x.total_cmp(&input.features[b].pixel.x).then(a.cmp(&b))
    });
    let widest = by_u.iter().map(|&f| input.features[f].sigma_px).fold(0.0, f64::max);
    let inverse = pose.inverse();
    let (b_from_a, origin) = (inverse.rotation.matrix(), inverse.translation);
    let widest_spread = MOST_SPREAD * input.camera.mean_focal_px();
    let mut alike = 0;
    let mut best = MutualBest::new(input.points.len(), input.features.len());
    for (point, estimate) in input.points.iter().enumerate().filter(|&(p, _)| is_point_free[p]) {
        let Some(seen) = Projected::new(input.camera, estimate, &b_from_a, &origin) else {
            continue;
        };
        if !is_informative(estimate, &seen, widest_spread) {
            continue;
        }
        // No error in u is longer than this within the gate, as far as the lens does not distort the
        // covariance.
        let limit = gate(3, options.sigma_allowance);
        let reach = (limit * (seen.c00 + widest * widest)).sqrt();
        let u = |&feature: &usize| input.features[feature].pixel.x;
        let first = by_u.partition_point(|feature| u(feature) < seen.pixel.x - reach);
        for &feature in
            by_u[first..].iter().take_while(|feature| u(feature) <= seen.pixel.x + reach)
        {
            let Likeness::Distance(distance) = likeness(point, feature) else { continue };
            alike += 1;
            if alike > MOST_ALIKE * input.points.len() {
                return Vec::new();
            }
            let m = weighted_once(input, point, feature).seen;
            let fits = squared_error(input.camera, &m, pose)
                .is_some_and(|(chi2, rows)| chi2 <= gate(rows, options.sigma_allowance));
            if fits {
                best.add(point, feature, distance, RATIO);
            }
        }
    }
    best.pairs()
}

/// Whether a match with a point constrains a pose: where the point is in the image is known to some
/// degrees, and it is about as large there as in the candidate's. Others match by chance, and one right before
/// the camera may move a pose more than all that are right.
fn is_informative(estimate: &PointEstimate, seen: &Projected, widest_spread: f64) -> bool {
    let ratio = estimate.point.norm() / seen.distance;
    let is_as_large = (1.0 / LARGEST_RATIO..=LARGEST_RATIO).contains(&ratio);
    is_as_large && seen.c00 + seen.c11 <= widest_spread * widest_spread
}

/// Those of the pairs (point, feature) that constrain a pose.
pub(super) fn informative(
    input: &Input<'_>,
    pairs: impl Iterator<Item = (usize, usize)>,
    pose: &Se3,
) -> Vec<(usize, usize)> {
    let widest_spread = MOST_SPREAD * input.camera.mean_focal_px();
    let inverse = pose.inverse();
    let (b_from_a, origin) = (inverse.rotation.matrix(), inverse.translation);
    let is_kept = |&(point, _): &(usize, usize)| {
        let estimate = &input.points[point];
        Projected::new(input.camera, estimate, &b_from_a, &origin)
            .is_some_and(|seen| is_informative(estimate, &seen, widest_spread))
    };
    pairs.filter(is_kept).collect()
}
