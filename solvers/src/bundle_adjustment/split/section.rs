//! A section of a problem: a problem of its own, and where it meets the others.
//!
//! Plain values, to be sent anywhere. Indices are the section's own; [`Members`] has those of the whole.
//! Cutting is done by `partition`, solving by `worker`.

use nalgebra::Vector3;

use crate::factors::{PosePrior, PositionPrior, RelativePose};
use crate::geometry::{Camera, LieGroup, Se3};
use crate::problem::{BundleProblem, SolveError};

use super::super::layout::NO_BLOCK;
use super::partition::{Members, Partition};

/// A problem that shares poses and cameras, its border, with others.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Section {
    /// The section's variables and factors.
    pub problem: BundleProblem,
    /// Cameras that are never eliminated together with a pose, since the whole does not.
    pub cameras_apart: Vec<bool>,
    /// Poses that other sections have too.
    pub border_poses: Vec<bool>,
    /// Cameras that other sections have too.
    pub border_cameras: Vec<bool>,
}

impl Section {
    /// Checks what the problem's own check does, and that there is a mark for every pose and camera.
    ///
    /// # Errors
    /// The first [`SolveError`] found. A section without observations is none.
    pub fn validate(&self) -> Result<(), SolveError> {
        let (poses, cameras) = (self.problem.poses.len(), self.problem.cameras.len());
        for (what, actual, expected) in [
            ("cameras_apart", self.cameras_apart.len(), cameras),
            ("border_poses", self.border_poses.len(), poses),
            ("border_cameras", self.border_cameras.len(), cameras),
        ] {
            if actual != expected {
                return Err(SolveError::LengthMismatch { what, actual, expected });
            }
        }
        match self.problem.validate() {
            Err(SolveError::Empty(_)) => Ok(()),
            outcome => outcome,
        }
    }
}

/// Variables of a section.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Values {
    /// `world_from_camera` of each pose.
    pub poses: Vec<Se3>,
    /// Intrinsics.
    pub cameras: Vec<Camera>,
    /// `point_in_world` of each landmark, in meters.
    pub landmarks: Vec<Vector3<f64>>,
}

impl Values {
    /// Those of a problem.
    pub(super) fn of(problem: &BundleProblem) -> Self {
        Self {
            poses: problem.poses.clone(),
            cameras: problem.cameras.clone(),
            landmarks: problem.landmarks.clone(),
        }
    }

    /// Those of the whole problem that a section has.
    pub(super) fn gathered(whole: &Self, members: &Members) -> Self {
        Self {
            poses: picked(&whole.poses, &members.poses),
            cameras: picked(&whole.cameras, &members.cameras),
            landmarks: picked(&whole.landmarks, &members.landmarks),
        }
    }

    /// Puts those of a section into the whole; lengths are those of the section.
    pub(super) fn scatter(&self, members: &Members, whole: &mut Self) {
        put(&self.poses, &members.poses, &mut whole.poses);
        put(&self.cameras, &members.cameras, &mut whole.cameras);
        put(&self.landmarks, &members.landmarks, &mut whole.landmarks);
    }

    /// Whether there are as many of each, camera models included.
    pub(super) fn is_like(&self, other: &Self) -> bool {
        let models = |values: &Self| -> Vec<_> {
            values.cameras.iter().map(std::mem::discriminant).collect()
        };
        self.poses.len() == other.poses.len()
            && self.landmarks.len() == other.landmarks.len()
            && models(self) == models(other)
    }

    /// Whether every number is finite.
    pub(super) fn is_finite(&self) -> bool {
        self.poses.iter().all(LieGroup::is_finite)
            && self.cameras.iter().all(Camera::is_finite)
            && self.landmarks.iter().flatten().all(|x| x.is_finite())
    }
}

fn picked<T: Copy>(all: &[T], ids: &[u32]) -> Vec<T> {
    ids.iter().map(|&id| all[id as usize]).collect()
}

fn put<T: Copy>(values: &[T], ids: &[u32], all: &mut [T]) {
    for (value, &id) in values.iter().zip(ids) {
        all[id as usize] = *value;
    }
}

/// The index of `id` among a section's, which ascend.
fn local(ids: &[u32], id: usize) -> usize {
    ids.binary_search(&(id as u32)).unwrap_or_default()
}

impl Partition {
    /// Section `s` of the problem that was cut, with its values.
    pub(super) fn section(&self, problem: &BundleProblem, s: usize) -> Section {
        let members = &self.sections[s];
        let mut part = BundleProblem {
            poses: picked(&problem.poses, &members.poses),
            cameras: picked(&problem.cameras, &members.cameras),
            landmarks: picked(&problem.landmarks, &members.landmarks),
            constant_poses: picked(&problem.constant_poses, &members.poses),
            constant_cameras: picked(&problem.constant_cameras, &members.cameras),
            free_parameters: match problem.free_parameters[..] {
                [] => Vec::new(),
                ref all => picked(all, &members.cameras),
            },
            constant_landmarks: picked(&problem.constant_landmarks, &members.landmarks),
            observation_loss: problem.observation_loss,
            relative_pose_loss: problem.relative_pose_loss,
            ..BundleProblem::default()
        };
        let pose = |id: usize| local(&members.poses, id);
        let plain = problem.reprojections.len();
        part.reprojections.reserve(members.observations.partition_point(|&k| (k as usize) < plain));
        for &k in &members.observations {
            let observation = problem.observation(k as usize);
            let camera = local(&members.cameras, observation.camera as usize) as u32;
            let landmark = local(&members.landmarks, observation.landmark as usize) as u32;
            let pose = pose(observation.pose as usize) as u32;
            part.push_observation(pose, camera, landmark, observation.seen);
        }
        part.relative_poses.extend(members.relative_poses.iter().map(|&k| {
            let factor = &problem.relative_poses[k as usize];
            RelativePose { i: pose(factor.i), j: pose(factor.j), ..*factor }
        }));
        part.pose_priors.extend(members.pose_priors.iter().map(|&k| {
            let factor = &problem.pose_priors[k as usize];
            PosePrior { pose: pose(factor.pose), ..*factor }
        }));
        part.position_priors.extend(members.position_priors.iter().map(|&k| {
            let factor = &problem.position_priors[k as usize];
            PositionPrior { pose: pose(factor.pose), ..*factor }
        }));
        let separates = |block: u32| block != NO_BLOCK && self.is_separator[block as usize];
        let blocks = &self.blocks;
        let cameras = || members.cameras.iter().map(|&id| blocks.of_camera[id as usize]);
        Section {
            problem: part,
            cameras_apart: cameras().map(|(_, column)| column == 0).collect(),
            border_poses: members
                .poses
                .iter()
                .map(|&id| separates(blocks.of_pose[id as usize]))
                .collect(),
            border_cameras: cameras().map(|(block, _)| separates(block)).collect(),
        }
    }
}
