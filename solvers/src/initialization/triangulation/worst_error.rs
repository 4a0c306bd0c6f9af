//! The point whose worst whitened error over the views is least: triangulation in the L∞ norm.
//!
//! Kahl and Hartley, "Multiple-view geometry under the L∞-norm", PAMI 2008. Each error is a ratio of
//! convex functions, so that the least worst error γ* = min over v of max over i of ‖Nᵢ v‖ / (hᵢ·v) has
//! no local minima, and points behind a camera are no candidates. Where they bisect over γ, this takes
//! the steps of Dinkelbach's method for ratios (Crouzeix and Ferland, 1991): with γ the worst error of
//! the best v' so far, one cone program minimizes max over i of (‖Nᵢ v‖ − γ hᵢ·v) / (hᵢ·v') over v. Its
//! solution is a better point, and the steps converge quadratically: four to seven programs, where
//! bisection to the same accuracy takes 25, each feasible near γ* only by a hair.
//! γ is lowered a little for each program: once its dual proves that no point reaches that γ, it is
//! the lower bound.

use nalgebra::{Vector3, Vector4};

use super::View;
use super::cone::{Program, Solution};
use super::ratios::{Ratio, ratios};

/// The least t that is used: an optimum at infinity becomes a point about 10¹² scales away, in the same
/// directions up to rounding.
const LEAST_T: f64 = 1e-12;

/// By how much γ is lowered, as a part of 1 + γ: the accuracy of the result.
const ACCURACY: f64 = 1e-7;

/// By how much it is lowered at most, where rounding keeps finer programs from an answer.
const COARSEST: f64 = 1e-3;

/// Cone programs solved at most.
const MOST_PROGRAMS: usize = 30;

/// Errors that enter the programs at most, whose time grows with them.
const MOST_RATIOS: usize = 64;

/// The best that can be done for all views at once.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LeastWorstError {
    /// The best point in the world, in meters: in front of all cameras, maybe very far away.
    pub point_in_world: Vector3<f64>,
    /// Its worst error over the views, in standard deviations.
    pub error: f64,
    /// No point in front of all cameras has a smaller worst error than this, in standard deviations.
    pub lower_bound: f64,
}

/// Finds the point in front of all cameras whose worst error over `views` is least.
///
/// An error is the length of a view's whitened reprojection error, and that of its depth where it has
/// one. A distorted lens counts as linear about the measured pixel. `error` and `lower_bound` differ
/// by 1e-7 of 1 + `error`; where rounding forbids that, by up to 1e-3 or, without a proof, the bound is
/// 0. Of more than 64 errors, 64 spread ones are used: the bound still holds, `error` may be larger.
/// The order of `views` makes no difference.
///
/// `None` where a pixel has no viewing ray, no point lies in front of all cameras, or all views have
/// the same center and none has a depth.
#[must_use]
pub fn least_worst_error(views: &[View]) -> Option<LeastWorstError> {
    least_worst_error_within(views, f64::INFINITY)
}

/// The same, but once no point is proven to have a worst error below `limit`, `lower_bound` is `limit`
/// and the point just some point in front: two programs for views that contradict each other.
pub(super) fn least_worst_error_within(views: &[View], limit: f64) -> Option<LeastWorstError> {
    let (frame, all) = ratios(views)?;
    let stride = all.len().div_ceil(MOST_RATIOS);
    let chosen: Vec<Ratio> = all.iter().step_by(stride).copied().collect();
    let (v, lower_bound) = minimize(&chosen, limit)?;
    let point_in_world = frame.point_in_world(&v);
    let finite = point_in_world.iter().all(|x| x.is_finite());
    finite.then(|| LeastWorstError { point_in_world, error: worst(&all, &v), lower_bound })
}

/// The best v and a value that no worst error is below; `limit` is such a value that is high enough.
fn minimize(ratios: &[Ratio], limit: f64) -> Option<(Vector4<f64>, f64)> {
    // As far in front of the cameras as possible: the least hᵢ·v is largest.
    let ones = vec![1.0; ratios.len()];
    let front = Program { ratios, numerator: 0.0, denominator: 1.0, weights: &ones };
    let mut v = before_infinity(front.solve()?.v);
    let mut error = worst(ratios, &v);
    if !error.is_finite() {
        return None;
    }
    let mut lowered = ACCURACY;
    for _ in 0..MOST_PROGRAMS {
        let target = limit.min(error - lowered * (1.0 + error));
        if target <= 0.0 || lowered > COARSEST {
            break;
        }
        let Some(solution) = step(ratios, &v, target) else { break };
        let trial = before_infinity(solution.v);
        let trial_error = worst(ratios, &trial);
        let better = trial_error < error;
        if better {
            (v, error) = (trial, trial_error);
        }
        // A point below the target would show that rounding made up the proof.
        if solution.slack_bound > 0.0 && error >= target {
            return Some((v, target));
        }
        if !better {
            lowered *= 10.0;
        }
    }
    Some((v, 0.0))
}

/// Goes as far below the worst error `target` as possible, from the best v so far.
fn step(ratios: &[Ratio], v: &Vector4<f64>, target: f64) -> Option<Solution> {
    let weights: Vec<f64> = ratios.iter().map(|ratio| ratio.denominator_at(v)).collect();
    // Divided by 1 + γ, so that s is relative.
    let numerator = 1.0 / (1.0 + target);
    Program { ratios, numerator, denominator: target * numerator, weights: &weights }.solve()
}

/// `v`, not quite at infinity.
fn before_infinity(v: Vector4<f64>) -> Vector4<f64> {
    Vector4::new(v.x, v.y, v.z, v.w.max(LEAST_T))
}

fn worst(ratios: &[Ratio], v: &Vector4<f64>) -> f64 {
    ratios.iter().map(|ratio| ratio.at(v)).fold(0.0, f64::max)
}
