//! What a value must be wherever a map checks one: finite, positive or a rotation where its description
//! says so. Items, events, merges, results of solves and uploaded maps are all checked by these.
//!
//! Plain functions of values; they know no map, no event and no error.

use covis_solvers::geometry::{Camera, LieGroup, Se3, Sim3};
use nalgebra::SVector;

use super::scaling::SCALES;
use super::{Depth, MapPolicy};

/// How far a rotation's norm may be from 1: rounding alone stays far below.
const UNIT_TOLERANCE: f64 = 1e-6;

/// Whether a number is finite and greater than 0.
pub(super) fn is_positive(value: f64) -> bool {
    value.is_finite() && value > 0.0
}

/// The median, of an even count the upper one; `None` of none.
pub(super) fn median(mut values: Vec<f64>) -> Option<f64> {
    let middle = values.len() / 2;
    (middle < values.len()).then(|| *values.select_nth_unstable_by(middle, f64::total_cmp).1)
}

/// Whether all coordinates are finite.
pub(super) fn is_finite<const N: usize>(vector: &SVector<f64, N>) -> bool {
    vector.iter().all(|value| value.is_finite())
}

/// Whether a depth and its deviation are finite and greater than 0.
pub(super) fn is_depth(depth: &Depth) -> bool {
    is_positive(depth.depth_m) && is_positive(depth.sigma_m)
}

/// Whether a pose is of finite numbers and its rotation has norm 1.
pub(super) fn is_pose(pose: &Se3) -> bool {
    let norm = pose.rotation.quaternion().coords.norm();
    pose.is_finite() && (norm - 1.0).abs() <= UNIT_TOLERANCE
}

/// Whether a similarity is a pose with a scale that a map can have.
pub(super) fn is_similarity(similarity: &Sim3) -> bool {
    is_pose(&similarity.rigid()) && SCALES.contains(&similarity.scale)
}

/// Whether a camera's numbers are finite and its focal lengths positive.
pub fn is_valid_camera(camera: &Camera) -> bool {
    let focal_lengths = if matches!(camera, Camera::Snavely(_)) { 1 } else { 2 };
    let parameters = camera.parameters();
    camera.is_finite() && parameters.iter().take(focal_lengths).all(|&f| f > 0.0)
}

/// Whether a policy's losses, threshold and anchor are possible.
pub(super) fn is_policy(policy: &MapPolicy) -> bool {
    let threshold = policy.loop_closure_robustness.threshold;
    policy.observation_loss.is_valid()
        && policy.constraint_loss.is_valid()
        && threshold.is_none_or(|threshold| threshold.is_finite() && threshold >= 0.0)
        && policy.geodetic_anchor.is_none_or(|anchor| anchor.is_valid())
}
