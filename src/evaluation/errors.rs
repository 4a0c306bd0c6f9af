//! Errors between matched poses: length of the translation, angle and norm of the rotation.
//!
//! The angle is 2 atan2(‖v‖, |w|) of the error's quaternion (v, w): an acos of the trace would lose
//! half of the digits near 0. ‖R − I‖ = 2√2 sin(angle/2) = 2√2 ‖v‖.

use std::f64::consts::SQRT_2;

use covis_solvers::geometry::{LieGroup, Se3};

/// One entry per pose (absolute) or per pair of neighbors (relative).
#[derive(Clone, Debug, Default, PartialEq)]
pub struct PoseErrors {
    /// Length of the translation in meters.
    pub translation_m: Vec<f64>,
    /// Rotation angle in degrees, 0 to 180.
    pub angle_deg: Vec<f64>,
    /// Frobenius norm of R − I.
    pub rotation_part: Vec<f64>,
}

impl PoseErrors {
    /// E = estimate⁻¹ · truth, pose by pose.
    #[must_use]
    pub fn absolute(truth: &[Se3], estimate: &[Se3]) -> Self {
        let mut errors = Self::default();
        for (truth, estimate) in truth.iter().zip(estimate) {
            errors.push(&estimate.inverse().compose(truth));
        }
        errors
    }

    /// E = (truth_i⁻¹ · truth_j)⁻¹ · (estimate_i⁻¹ · estimate_j) for all j = i + 1.
    #[must_use]
    pub fn relative(truth: &[Se3], estimate: &[Se3]) -> Self {
        let mut errors = Self::default();
        for (truth, estimate) in truth.windows(2).zip(estimate.windows(2)) {
            let true_motion = truth[0].inverse().compose(&truth[1]);
            let motion = estimate[0].inverse().compose(&estimate[1]);
            errors.push(&true_motion.inverse().compose(&motion));
        }
        errors
    }

    /// Appends one error.
    pub(super) fn push(&mut self, error: &Se3) {
        let quaternion = error.rotation.quaternion();
        let sine = quaternion.imag().norm();
        self.translation_m.push(error.translation.norm());
        self.angle_deg.push((2.0 * sine.atan2(quaternion.w.abs())).to_degrees());
        self.rotation_part.push(2.0 * SQRT_2 * sine);
    }
}
