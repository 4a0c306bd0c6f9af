//! Trajectory errors as evo and the TUM scripts define them: absolute (APE) and relative pose error
//! (RPE); and how well masks of what moves agree.
//!
//! Poses are matched by timestamp. APE aligns the estimate to the truth by the SE(3) that minimizes
//! the squared distances and compares pose by pose; RPE compares the motions between neighboring
//! matched poses, without alignment (Sturm et al., "A benchmark for the evaluation of RGB-D SLAM
//! systems", 2012). Numbers agree with evo 1.38 to rounding. [`rpe_over`] is the drift over a fixed
//! time, as the TUM scripts count it. Nothing here reads files.

mod drift;
mod mask;
mod matching;
mod paper_table;
mod statistics;
#[cfg(test)]
mod tests;

use std::f64::consts::SQRT_2;

use covis_solvers::geometry::{LieGroup, Se3};
use covis_solvers::io::trajectory::Trajectory;

pub use drift::rpe_over;
pub use mask::{LEAST_COVERAGE, MaskEvaluation, MaskOverlap};
use matching::{align, associate};
pub use paper_table::{Dynamics, MethodFigures, PAPER_TABLE, PaperRow, paper_row};
pub use statistics::Statistics;

/// Two trajectories, or two masks, that cannot be compared.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum EvaluationError {
    /// No pose of one has a partner in the other.
    #[error("no timestamps of truth and estimate are within {max_difference_s} s of each other")]
    NoMatches {
        /// The largest difference that was allowed, in seconds.
        max_difference_s: f64,
    },
    /// The largest time difference is negative or not finite.
    #[error("the largest time difference is {value} s; it must be finite and not negative")]
    InvalidTimeDifference {
        /// The value.
        value: f64,
    },
    /// An RPE needs at least two matched poses.
    #[error("{pairs} matched poses; a relative error needs two")]
    TooFewPairs {
        /// How many there are.
        pairs: usize,
    },
    /// The time over which a drift is asked for is not positive or not finite.
    #[error("the time between two poses is {value} s; it must be finite and positive")]
    InvalidDelta {
        /// The value.
        value: f64,
    },
    /// Too few poses of the estimate are this far apart and have a truth.
    #[error("{pairs} pairs of poses are {delta_s} s apart and have a truth; two are needed")]
    TooFewApart {
        /// How many there are.
        pairs: usize,
        /// The time between the poses of a pair, in seconds.
        delta_s: f64,
    },
    /// Two masks of one frame differ in size.
    #[error("the true mask has {truth} pixels, the estimated one {estimate}")]
    UnequalMasks {
        /// Pixels of the truth.
        truth: usize,
        /// Pixels of the estimate.
        estimate: usize,
    },
    /// The matched positions do not determine a rotation: they lie on a line or in a point.
    #[error(
        "{pairs} matched positions do not determine a rotation (their covariance has rank {rank})"
    )]
    Degenerate {
        /// How many matched positions there are.
        pairs: usize,
        /// Singular values of their covariance that are not zero.
        rank: usize,
    },
}

/// The outcome of [`ape`], [`rpe`] or [`rpe_over`].
#[derive(Clone, Debug, PartialEq)]
pub struct Evaluation {
    /// How many poses were matched; of [`rpe_over`], how many pairs of poses were compared.
    pub pairs: usize,
    /// What the estimate was multiplied with from the left; the identity for an RPE.
    pub truth_from_estimate: Se3,
    /// Length of the translation error in meters (evo's default, `trans_part`).
    pub translation_m: Statistics,
    /// Angle of the rotation error in degrees (`angle_deg`).
    pub angle_deg: Statistics,
    /// ‖R − I‖ of the rotation error, Frobenius (`rot_part`).
    pub rotation_part: Statistics,
}

/// Absolute pose errors after SE(3) alignment: E = (T · estimate)⁻¹ · truth.
///
/// Timestamps match within `max_difference_s` seconds, inclusive.
///
/// # Errors
/// [`EvaluationError`] where nothing matches or the alignment is not determined.
pub fn ape(
    truth: &Trajectory,
    estimate: &Trajectory,
    max_difference_s: f64,
) -> Result<Evaluation, EvaluationError> {
    let (truth, estimate) = matched(truth, estimate, max_difference_s)?;
    let positions = |poses: &[Se3]| poses.iter().map(|p| p.translation).collect::<Vec<_>>();
    let truth_from_estimate = align(&positions(&truth), &positions(&estimate))?;
    let aligned = estimate.iter().map(|pose| truth_from_estimate.compose(pose));
    let errors = aligned.zip(&truth).map(|(pose, truth)| pose.inverse().compose(truth));
    Ok(evaluation(truth.len(), truth_from_estimate, &errors.collect::<Vec<_>>()))
}

/// Relative pose errors between neighboring matched poses (delta 1 frame), without alignment:
/// E = (truth_i⁻¹ · truth_j)⁻¹ · (estimate_i⁻¹ · estimate_j), j = i + 1.
///
/// Timestamps match within `max_difference_s` seconds, inclusive.
///
/// # Errors
/// [`EvaluationError`] where fewer than two poses match.
pub fn rpe(
    truth: &Trajectory,
    estimate: &Trajectory,
    max_difference_s: f64,
) -> Result<Evaluation, EvaluationError> {
    let (truth, estimate) = matched(truth, estimate, max_difference_s)?;
    if truth.len() < 2 {
        return Err(EvaluationError::TooFewPairs { pairs: truth.len() });
    }
    let motions = |poses: &[Se3]| -> Vec<Se3> {
        poses.windows(2).map(|pair| pair[0].inverse().compose(&pair[1])).collect()
    };
    let both = motions(&truth).into_iter().zip(motions(&estimate));
    let errors: Vec<_> = both.map(|(truth, motion)| truth.inverse().compose(&motion)).collect();
    Ok(evaluation(truth.len(), Se3::identity(), &errors))
}

/// Statistics of errors: length of the translation, angle and norm of the rotation.
///
/// The angle is 2 atan2(‖v‖, |w|) of the error's quaternion (v, w): an acos of the trace would lose
/// half of the digits near 0. ‖R − I‖ = 2√2 sin(angle/2) = 2√2 ‖v‖.
fn evaluation(pairs: usize, truth_from_estimate: Se3, errors: &[Se3]) -> Evaluation {
    let of =
        |figure: fn(&Se3) -> f64| Statistics::of(&errors.iter().map(figure).collect::<Vec<_>>());
    Evaluation {
        pairs,
        truth_from_estimate,
        translation_m: of(|error| error.translation.norm()),
        angle_deg: of(|error| {
            let quaternion = error.rotation.quaternion();
            (2.0 * quaternion.imag().norm().atan2(quaternion.w.abs())).to_degrees()
        }),
        rotation_part: of(|error| 2.0 * SQRT_2 * error.rotation.quaternion().imag().norm()),
    }
}

/// The matched poses of both, in the order of [`associate`].
fn matched(
    truth: &Trajectory,
    estimate: &Trajectory,
    max_difference_s: f64,
) -> Result<(Vec<Se3>, Vec<Se3>), EvaluationError> {
    if !(max_difference_s.is_finite() && max_difference_s >= 0.0) {
        return Err(EvaluationError::InvalidTimeDifference { value: max_difference_s });
    }
    let pairs = associate(&truth.timestamps, &estimate.timestamps, max_difference_s);
    if pairs.is_empty() {
        return Err(EvaluationError::NoMatches { max_difference_s });
    }
    let pose = |(i, j): (usize, usize)| (truth.world_from_body[i], estimate.world_from_body[j]);
    Ok(pairs.into_iter().map(pose).unzip())
}
