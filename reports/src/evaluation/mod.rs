//! Trajectory errors as evo and the TUM scripts define them: absolute (APE) and relative pose error
//! (RPE); and how well masks of what moves agree.
//!
//! Poses are matched by timestamp. APE aligns the estimate to the truth by the SE(3) that minimizes
//! the squared distances and compares pose by pose; RPE compares the motions between neighboring
//! matched poses, without alignment (Sturm et al., "A benchmark for the evaluation of RGB-D SLAM
//! systems", 2012). Numbers agree with evo 1.38 to rounding. [`rpe_over`] is the drift over a fixed
//! time, as the TUM scripts count it. Nothing here reads files.
//!
//! | file | role |
//! |---|---|
//! | `matching`, `statistics` | pairs by timestamp, alignment; the figures of a list of errors |
//! | `drift` | RPE over a fixed time |
//! | `mask` | overlap of masks |
//! | `paper_table` | the figures of the frontend's paper |

mod drift;
mod error;
mod mask;
mod matching;
mod paper_table;
mod statistics;
#[cfg(test)]
mod tests;

use std::f64::consts::SQRT_2;

use covis_solvers::geometry::{LieGroup, Se3};
use covis_solvers::io::trajectory::Trajectory;
use nalgebra::Vector3;

pub use drift::rpe_over;
pub use error::EvaluationError;
pub use mask::{LEAST_COVERAGE, MaskEvaluation, MaskOverlap};
use matching::{align, associate};
pub use paper_table::{MethodFigures, PAPER_TABLE, PaperRow, paper_row};
pub use statistics::Statistics;

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
    /// Each of the errors, in the order of the truth for [`ape`] and [`rpe`], else of the estimate.
    pub errors: Vec<PoseError>,
}

/// The error of one pose, or of the motion that begins at one pose.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PoseError {
    /// The pose's time in its own trajectory, seconds.
    pub timestamp_s: f64,
    /// Where it is in the frame of the truth, m: of [`ape`] the aligned estimate, otherwise the true pose.
    pub position: Vector3<f64>,
    /// Length of the translation error, m.
    pub translation_m: f64,
    /// Angle of the rotation error, degrees.
    pub angle_deg: f64,
    /// ‖R − I‖ of the rotation error, Frobenius.
    pub rotation_part: f64,
}

impl PoseError {
    /// The figures of an error E.
    ///
    /// The angle is 2 atan2(‖v‖, |w|) of the error's quaternion (v, w): an acos of the trace would lose
    /// half of the digits near 0. ‖R − I‖ = 2√2 sin(angle/2) = 2√2 ‖v‖.
    fn new(timestamp_s: f64, position: Vector3<f64>, error: &Se3) -> Self {
        let quaternion = error.rotation.quaternion();
        let sine = quaternion.imag().norm();
        Self {
            timestamp_s,
            position,
            translation_m: error.translation.norm(),
            angle_deg: (2.0 * sine.atan2(quaternion.w.abs())).to_degrees(),
            rotation_part: 2.0 * SQRT_2 * sine,
        }
    }
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
    let pairs = matched(truth, estimate, max_difference_s)?;
    let positions =
        |of: fn(&Pair) -> &Se3| pairs.iter().map(|p| of(p).translation).collect::<Vec<_>>();
    let truth_from_estimate = align(&positions(|p| &p.truth), &positions(|p| &p.estimate))?;
    let error = |pair: &Pair| {
        let aligned = truth_from_estimate.compose(&pair.estimate);
        let error = aligned.inverse().compose(&pair.truth);
        PoseError::new(pair.estimate_s, aligned.translation, &error)
    };
    Ok(evaluation(pairs.len(), truth_from_estimate, pairs.iter().map(error).collect()))
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
    let pairs = matched(truth, estimate, max_difference_s)?;
    if pairs.len() < 2 {
        return Err(EvaluationError::TooFewPairs { pairs: pairs.len() });
    }
    let error = |both: &[Pair]| {
        let motion = |of: fn(&Pair) -> &Se3| of(&both[0]).inverse().compose(of(&both[1]));
        let error = motion(|p| &p.truth).inverse().compose(&motion(|p| &p.estimate));
        PoseError::new(both[0].estimate_s, both[0].truth.translation, &error)
    };
    Ok(evaluation(pairs.len(), Se3::identity(), pairs.windows(2).map(error).collect()))
}

/// Statistics of errors.
fn evaluation(pairs: usize, truth_from_estimate: Se3, errors: Vec<PoseError>) -> Evaluation {
    let of = |figure: fn(&PoseError) -> f64| {
        Statistics::of(&errors.iter().map(figure).collect::<Vec<_>>())
    };
    Evaluation {
        pairs,
        truth_from_estimate,
        translation_m: of(|error| error.translation_m),
        angle_deg: of(|error| error.angle_deg),
        rotation_part: of(|error| error.rotation_part),
        errors,
    }
}

/// Poses of one time.
struct Pair {
    truth: Se3,
    estimate: Se3,
    /// The estimate's time.
    estimate_s: f64,
}

/// The matched poses of both, in the order of [`associate`].
fn matched(
    truth: &Trajectory,
    estimate: &Trajectory,
    max_difference_s: f64,
) -> Result<Vec<Pair>, EvaluationError> {
    if !(max_difference_s.is_finite() && max_difference_s >= 0.0) {
        return Err(EvaluationError::InvalidTimeDifference { value: max_difference_s });
    }
    let pairs = associate(&truth.timestamps, &estimate.timestamps, max_difference_s);
    if pairs.is_empty() {
        return Err(EvaluationError::NoMatches { max_difference_s });
    }
    let pair = |(i, j): (usize, usize)| Pair {
        truth: truth.world_from_body[i],
        estimate: estimate.world_from_body[j],
        estimate_s: estimate.timestamps[j],
    };
    Ok(pairs.into_iter().map(pair).collect())
}
