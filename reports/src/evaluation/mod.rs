//! Trajectory errors as evo and the TUM scripts define them: absolute (APE) and relative pose error
//! (RPE); and how well masks of what moves agree.
//!
//! Poses are matched by timestamp. APE aligns the estimate to the truth, by default by the SE(3) that
//! minimizes the squared distances, and compares pose by pose; RPE compares the motions between pairs of
//! matched poses, by default of neighbors and without alignment (Sturm et al., "A benchmark for the
//! evaluation of RGB-D SLAM systems", 2012). Numbers agree with evo 1.38 to rounding. [`rpe_over`] is the
//! drift over a fixed time, as the TUM scripts count it. Nothing here reads files.
//!
//! | file | role |
//! |---|---|
//! | `matching`, `alignment` | pairs by timestamp; the motion or similarity from estimate to truth |
//! | `motions` | the pairs of poses between which an RPE is measured |
//! | `relation`, `statistics` | what of an error is measured; the figures of a list of errors |
//! | `drift` | RPE over a fixed time |
//! | `mask` | overlap of masks |
//! | `paper_table` | the figures of the frontend's paper |

mod alignment;
mod drift;
mod error;
mod mask;
mod matching;
mod motions;
mod paper_table;
mod relation;
mod statistics;
#[cfg(test)]
mod tests;

use std::f64::consts::SQRT_2;

use covis_solvers::geometry::{LieGroup, Se3, Sim3, So3};
use covis_solvers::io::trajectory::Trajectory;
use nalgebra::Vector3;

pub use alignment::{Alignment, Correction, align_poses};
pub use drift::{rpe_over, rpe_over_aligned};
pub use error::EvaluationError;
pub use mask::{LEAST_COVERAGE, MaskEvaluation, MaskOverlap};
use matching::associate;
pub use motions::{DeltaUnit, MotionPairs};
pub use paper_table::{MethodFigures, PAPER_TABLE, PaperRow, paper_row};
pub use relation::PoseRelation;
pub use statistics::Statistics;

/// The outcome of an APE or RPE.
#[derive(Clone, Debug, PartialEq)]
pub struct Evaluation {
    /// How many poses were matched; of [`rpe_over`], how many pairs of poses were compared.
    pub pairs: usize,
    /// What the estimate was moved by: [`Sim3::transform_pose`]. The identity without an alignment.
    pub truth_from_estimate: Sim3,
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
    /// Of a motion the difference of the true length from the estimated one, without its sign; otherwise the
    /// length of the translation error. Both m.
    pub distance_m: f64,
    /// Length of the true motion, m; `None` for the error of a single pose.
    pub true_distance_m: Option<f64>,
}

impl PoseError {
    /// The figures of the error E of a pose. ‖R − I‖ = 2√2 sin(angle/2) = 2√2 ‖v‖, v the vector part of the
    /// error's quaternion.
    fn of_pose(timestamp_s: f64, position: Vector3<f64>, error: &Se3) -> Self {
        let translation_m = error.translation.norm();
        Self {
            timestamp_s,
            position,
            translation_m,
            angle_deg: angle_rad(&error.rotation).to_degrees(),
            rotation_part: 2.0 * SQRT_2 * error.rotation.quaternion().imag().norm(),
            distance_m: translation_m,
            true_distance_m: None,
        }
    }

    /// Those of the error E of a motion between two poses, of the truth and of the estimate.
    fn of_motion(timestamp_s: f64, truth: [&Se3; 2], estimate: [&Se3; 2], error: &Se3) -> Self {
        let length = |[a, b]: [&Se3; 2]| (a.translation - b.translation).norm();
        let true_distance_m = length(truth);
        Self {
            distance_m: (true_distance_m - length(estimate)).abs(),
            true_distance_m: Some(true_distance_m),
            ..Self::of_pose(timestamp_s, truth[0].translation, error)
        }
    }
}

/// The angle of a rotation, radians: 2 atan2(‖v‖, |w|) of its quaternion (v, w). An acos of the trace would
/// lose half of the digits near 0.
fn angle_rad(rotation: &So3) -> f64 {
    let quaternion = rotation.quaternion();
    2.0 * quaternion.imag().norm().atan2(quaternion.w.abs())
}

/// Absolute pose errors after SE(3) alignment by all matched poses: [`ape_aligned`] as evo's `-a` has it.
///
/// # Errors
/// As those of [`ape_aligned`].
pub fn ape(
    truth: &Trajectory,
    estimate: &Trajectory,
    max_difference_s: f64,
) -> Result<Evaluation, EvaluationError> {
    ape_aligned(truth, estimate, max_difference_s, Alignment::default())
}

/// Absolute pose errors of an aligned estimate: E = (S · estimate)⁻¹ · truth, S the alignment.
///
/// Timestamps match within `max_difference_s` seconds, inclusive.
///
/// # Errors
/// [`EvaluationError`] where nothing matches or the alignment is not determined.
pub fn ape_aligned(
    truth: &Trajectory,
    estimate: &Trajectory,
    max_difference_s: f64,
    alignment: Alignment,
) -> Result<Evaluation, EvaluationError> {
    let mut pairs = matched(truth, estimate, max_difference_s)?;
    let truth_from_estimate = alignment.apply(&mut pairs)?;
    let error = |pair: &Pair| {
        let error = pair.estimate.inverse().compose(&pair.truth);
        PoseError::of_pose(pair.estimate_s, pair.estimate.translation, &error)
    };
    Ok(evaluation(pairs.len(), truth_from_estimate, pairs.iter().map(error).collect()))
}

/// Relative pose errors between neighboring matched poses, without alignment: [`rpe_between`] with evo's
/// defaults.
///
/// # Errors
/// As those of [`rpe_between`].
pub fn rpe(
    truth: &Trajectory,
    estimate: &Trajectory,
    max_difference_s: f64,
) -> Result<Evaluation, EvaluationError> {
    rpe_between(truth, estimate, max_difference_s, Alignment::NONE, &MotionPairs::default())
}

/// Relative pose errors between pairs (i, j) of matched poses, after an alignment:
/// E = (truth_i⁻¹ · truth_j)⁻¹ · (estimate_i⁻¹ · estimate_j).
///
/// Timestamps match within `max_difference_s` seconds, inclusive. An alignment in SE(3) changes neither
/// pairs nor errors; one with a scale may change both.
///
/// # Errors
/// [`EvaluationError`] where fewer than two poses match, the alignment is not determined, or `motions`
/// finds no pair.
pub fn rpe_between(
    truth: &Trajectory,
    estimate: &Trajectory,
    max_difference_s: f64,
    alignment: Alignment,
    motions: &MotionPairs,
) -> Result<Evaluation, EvaluationError> {
    let mut pairs = matched(truth, estimate, max_difference_s)?;
    if pairs.len() < 2 {
        return Err(EvaluationError::TooFewPairs { pairs: pairs.len() });
    }
    let truth_from_estimate = alignment.apply(&mut pairs)?;
    let from = |pair: &Pair| if motions.from_truth { pair.truth } else { pair.estimate };
    let poses: Vec<Se3> = pairs.iter().map(from).collect();
    let error = |(i, j): (usize, usize)| {
        let both = [&pairs[i], &pairs[j]];
        let (truth, estimate) = (both.map(|pair| &pair.truth), both.map(|pair| &pair.estimate));
        let motion = |[first, last]: [&Se3; 2]| first.inverse().compose(last);
        let error = motion(truth).inverse().compose(&motion(estimate));
        PoseError::of_motion(both[0].estimate_s, truth, estimate, &error)
    };
    let errors = motions.among(&poses)?.into_iter().map(error).collect();
    Ok(evaluation(pairs.len(), truth_from_estimate, errors))
}

/// Statistics of errors.
fn evaluation(pairs: usize, truth_from_estimate: Sim3, errors: Vec<PoseError>) -> Evaluation {
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
