//! Bundle adjustment of what a reconstruction has so far.
//!
//! The bearings that agree become observations; variables without any stay as they are. The lowest placed
//! keyframe is held, and with views alone the damping holds the scale. Which bearings agree was decided
//! by `points`: none is added or dropped here.

use super::Estimate;
use super::bearings::Bearings;
use crate::bundle_adjustment::{self, BundleSummary};
use crate::factors::RelativePose;
use crate::geometry::{FreeParameters, LieGroup, Se3};
use crate::interrupt::Interrupt;
use crate::loss::Loss;
use crate::optimizer;
use crate::problem::{BundleProblem, SolveError};

/// How an estimate is adjusted.
pub(super) struct Adjustment<'a> {
    pub(super) loss: Loss,
    /// Cameras that are held.
    pub(super) constant_cameras: Vec<bool>,
    /// As those of a [`BundleProblem`].
    pub(super) free_parameters: &'a [FreeParameters],
    /// Between keyframes that are placed by them.
    pub(super) relative_poses: &'a [RelativePose<Se3, 6>],
    pub(super) options: bundle_adjustment::Options,
}

/// Adjusts poses, points and cameras in place; `None` where no bearing agrees.
pub(super) fn adjust(
    bearings: &Bearings,
    estimate: &mut Estimate,
    adjustment: Adjustment<'_>,
    interrupt: &Interrupt,
    observer: &mut optimizer::Observer<'_>,
) -> Result<Option<BundleSummary>, SolveError> {
    let mut problem = BundleProblem {
        observation_loss: adjustment.loss,
        constant_cameras: adjustment.constant_cameras,
        free_parameters: adjustment.free_parameters.to_vec(),
        cameras: estimate.cameras.clone(),
        relative_poses: adjustment.relative_poses.to_vec(),
        ..BundleProblem::default()
    };
    let first = estimate.poses.iter().position(Option::is_some);
    for (index, pose) in estimate.poses.iter().enumerate() {
        problem.push_pose(pose.unwrap_or_else(Se3::identity));
        problem.constant_poses[index] = pose.is_none() || Some(index) == first;
    }
    for point in &estimate.points {
        let index = problem.push_landmark(point.unwrap_or_default());
        problem.constant_landmarks[index] = point.is_none();
    }
    for (bearing, _) in bearings.all.iter().zip(&estimate.used).filter(|(_, used)| **used) {
        let (pose, camera) = (bearing.pose as u32, bearing.camera as u32);
        let landmark = bearing.landmark as u32;
        problem.push_observation(pose, camera, landmark, bearing.seen);
    }
    if problem.observation_count() == 0 {
        return Ok(None);
    }
    let summary =
        bundle_adjustment::solve_until(&mut problem, &adjustment.options, interrupt, observer)?;
    for (pose, solved) in estimate.poses.iter_mut().zip(problem.poses) {
        *pose = pose.map(|_| solved);
    }
    for (point, solved) in estimate.points.iter_mut().zip(problem.landmarks) {
        *point = point.map(|_| solved);
    }
    estimate.cameras = problem.cameras;
    Ok(Some(summary))
}
