//! A bundle adjustment problem: poses, cameras and landmarks tied by observations.
//!
//! Poses are `world_from_camera`, landmarks `point_in_world`. Besides the two observation batches a
//! problem may hold relative-pose factors, pose priors and position priors, which touch poses only. It
//! holds and checks; no cost is computed here.

use nalgebra::Vector3;

use super::SolveError;
use super::pose_factors::{check_priors, check_relative_poses};
use crate::factors::{
    DepthReprojectionBatch, PosePrior, PositionPrior, RelativePose, Reprojection, ReprojectionBatch,
};
use crate::geometry::{Camera, FreeParameters, LieGroup, Se3};
use crate::loss::Loss;

/// Variables and factors of a bundle adjustment. Every `constant_*` has one flag a variable.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct BundleProblem {
    /// `world_from_camera` of each pose.
    pub poses: Vec<Se3>,
    /// Intrinsics; several poses may share one camera.
    pub cameras: Vec<Camera>,
    /// `point_in_world` of each landmark, in meters.
    pub landmarks: Vec<Vector3<f64>>,
    /// Poses that stay where they are.
    pub constant_poses: Vec<bool>,
    /// Cameras whose parameters stay as they are.
    pub constant_cameras: Vec<bool>,
    /// Which parameters of the other cameras are free: one entry a camera, or none at all where every
    /// parameter is free.
    pub free_parameters: Vec<FreeParameters>,
    /// Landmarks that stay where they are.
    pub constant_landmarks: Vec<bool>,
    /// Observations (u, v).
    pub reprojections: ReprojectionBatch,
    /// Observations (u, v, depth).
    pub depth_reprojections: DepthReprojectionBatch,
    /// Relative-pose factors between poses.
    pub relative_poses: Vec<RelativePose<Se3, 6>>,
    /// Priors on whole poses.
    pub pose_priors: Vec<PosePrior>,
    /// Priors on the positions of cameras, or of points fixed to them.
    pub position_priors: Vec<PositionPrior>,
    /// The loss of both observation batches.
    pub observation_loss: Loss,
    /// The loss of the relative-pose factors that have none of their own.
    pub relative_pose_loss: Loss,
}

/// One observation of either batch.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Observation {
    /// Index of the observing pose.
    pub pose: u32,
    /// Index of the observing camera.
    pub camera: u32,
    /// Index of the observed landmark.
    pub landmark: u32,
    /// What was measured.
    pub seen: Reprojection,
}

impl BundleProblem {
    /// Appends a pose that may move and returns its index.
    pub fn push_pose(&mut self, world_from_camera: Se3) -> usize {
        self.poses.push(world_from_camera);
        self.constant_poses.push(false);
        self.poses.len() - 1
    }

    /// Appends a camera and returns its index.
    pub fn push_camera(&mut self, camera: Camera, constant: bool) -> usize {
        self.cameras.push(camera);
        self.constant_cameras.push(constant);
        if !self.free_parameters.is_empty() {
            self.free_parameters.push(FreeParameters::ALL);
        }
        self.cameras.len() - 1
    }

    /// The free parameters of a camera: none where it is constant.
    ///
    /// # Panics
    /// Where there is no such camera.
    #[must_use]
    pub fn free_parameters_of(&self, camera: usize) -> FreeParameters {
        if self.constant_cameras[camera] {
            return FreeParameters::NONE;
        }
        self.free_parameters.get(camera).copied().unwrap_or(FreeParameters::ALL)
    }

    /// The number of unknowns of a camera: 0 where it is constant.
    ///
    /// # Panics
    /// Where there is no such camera.
    #[must_use]
    pub fn camera_unknowns(&self, camera: usize) -> usize {
        self.free_parameters_of(camera).count(self.cameras[camera].parameter_count())
    }

    /// Sets which parameters of a camera are free, unless it is constant as a whole.
    pub fn set_free_parameters(&mut self, camera: usize, free: FreeParameters) {
        self.free_parameters.resize(self.cameras.len(), FreeParameters::ALL);
        if let Some(entry) = self.free_parameters.get_mut(camera) {
            *entry = free;
        }
    }

    /// Appends a landmark that may move and returns its index.
    pub fn push_landmark(&mut self, point_in_world: Vector3<f64>) -> usize {
        self.landmarks.push(point_in_world);
        self.constant_landmarks.push(false);
        self.landmarks.len() - 1
    }

    /// Appends an observation to the batch of its kind.
    pub fn push_observation(&mut self, pose: u32, camera: u32, landmark: u32, seen: Reprojection) {
        let Reprojection { pixel, sigma_px, depth_m } = seen;
        let Some((depth_m, sigma_depth_m)) = depth_m else {
            self.reprojections.push(pose, camera, landmark, pixel, sigma_px);
            return;
        };
        let batch = &mut self.depth_reprojections;
        batch.poses.push(pose);
        batch.cameras.push(camera);
        batch.landmarks.push(landmark);
        batch.pixels.push(pixel);
        batch.depths_m.push(depth_m);
        batch.sigmas_px.push(sigma_px);
        batch.sigmas_depth_m.push(sigma_depth_m);
    }

    /// Observations of both batches together.
    #[must_use]
    pub fn observation_count(&self) -> usize {
        self.reprojections.len() + self.depth_reprojections.len()
    }

    /// Observation `k`, those (u, v) first, then those (u, v, depth).
    ///
    /// # Panics
    /// Where there is none, or the arrays of its batch differ in length.
    #[must_use]
    #[inline]
    pub fn observation(&self, k: usize) -> Observation {
        let (plain, deep) = (&self.reprojections, &self.depth_reprojections);
        match k.checked_sub(plain.len()) {
            None => Observation {
                pose: plain.poses[k],
                camera: plain.cameras[k],
                landmark: plain.landmarks[k],
                seen: Reprojection {
                    pixel: plain.pixels[k],
                    sigma_px: plain.sigmas_px[k],
                    depth_m: None,
                },
            },
            Some(k) => Observation {
                pose: deep.poses[k],
                camera: deep.cameras[k],
                landmark: deep.landmarks[k],
                seen: Reprojection {
                    pixel: deep.pixels[k],
                    sigma_px: deep.sigmas_px[k],
                    depth_m: Some((deep.depths_m[k], deep.sigmas_depth_m[k])),
                },
            },
        }
    }

    /// All observations, as [`Self::observation`] numbers them.
    pub fn observations(&self) -> impl Iterator<Item = Observation> + Clone + '_ {
        (0..self.observation_count()).map(|k| self.observation(k))
    }

    /// The whitened residual of an observation at the present values, as [`Reprojection::residual`] has it.
    ///
    /// # Panics
    /// Where it names a variable that is not there.
    #[must_use]
    pub fn residual(&self, observation: &Observation) -> Option<Vector3<f64>> {
        let pose = &self.poses[observation.pose as usize];
        let camera = &self.cameras[observation.camera as usize];
        observation.seen.residual(pose, camera, &self.landmarks[observation.landmark as usize])
    }

    /// Observations whose landmark is at or behind the camera's center plane (z ≤ 0).
    #[must_use]
    pub fn behind_camera_count(&self) -> usize {
        let (plain, depth) = self.behind_camera();
        plain.iter().chain(&depth).filter(|&&behind| behind).count()
    }

    /// Removes the observations whose landmark is at or behind the camera's center plane (z ≤ 0, as
    /// [`Self::behind_camera_count`] has it) at the current values, and returns how many they were.
    ///
    /// The other observations keep their order and every variable stays, also one that is left
    /// without observations. The choice is made here and once: what is left is a problem like any
    /// other, in which a landmark that comes to lie behind its camera later counts.
    pub fn drop_behind_camera(&mut self) -> usize {
        let before = self.observation_count();
        let (plain, depth) = self.behind_camera();
        self.reprojections.retain(|k| !plain[k]);
        self.depth_reprojections.retain(|k| !depth[k]);
        before - self.observation_count()
    }

    /// For each observation (u, v), then (u, v, depth), whether its landmark is behind its camera;
    /// false where an index has no variable, which is for [`Self::validate`] to tell.
    fn behind_camera(&self) -> (Vec<bool>, Vec<bool>) {
        let flags = |poses: &[u32], landmarks: &[u32], count: usize| {
            let mut flags = vec![false; count];
            for (flag, (&pose, &landmark)) in flags.iter_mut().zip(poses.iter().zip(landmarks)) {
                let pose = self.poses.get(pose as usize);
                let point = self.landmarks.get(landmark as usize);
                let in_camera = pose.zip(point).map(|(pose, point)| pose.inverse_transform(point));
                *flag = in_camera.is_some_and(|p| p.z <= 0.0);
            }
            flags
        };
        let (plain, depth) = (&self.reprojections, &self.depth_reprojections);
        (
            flags(&plain.poses, &plain.landmarks, plain.len()),
            flags(&depth.poses, &depth.landmarks, depth.len()),
        )
    }

    /// Checks that lengths and indices agree and that every number is finite.
    ///
    /// # Errors
    /// The first [`SolveError`] found.
    pub fn validate(&self) -> Result<(), SolveError> {
        check_length("constant_poses", self.constant_poses.len(), self.poses.len())?;
        check_length("constant_cameras", self.constant_cameras.len(), self.cameras.len())?;
        if !self.free_parameters.is_empty() {
            check_length("free_parameters", self.free_parameters.len(), self.cameras.len())?;
        }
        check_length("constant_landmarks", self.constant_landmarks.len(), self.landmarks.len())?;
        check_finite("pose", &self.poses, Se3::is_finite)?;
        check_finite("camera", &self.cameras, Camera::is_finite)?;
        check_finite("landmark", &self.landmarks, |l| l.iter().all(|x| x.is_finite()))?;
        for (field, loss) in [
            ("observation_loss", self.observation_loss),
            ("relative_pose_loss", self.relative_pose_loss),
        ] {
            if !loss.is_valid() {
                let reason = "the width must be finite and positive";
                return Err(SolveError::InvalidOption { field, reason });
            }
        }
        let counts = (self.poses.len(), self.cameras.len(), self.landmarks.len());
        check_reprojections(&self.reprojections, counts)?;
        check_depth_reprojections(&self.depth_reprojections, counts)?;
        let count = self.poses.len();
        check_relative_poses("relative pose", &self.relative_poses, count)?;
        check_priors(&self.pose_priors, &self.position_priors, count)?;
        if self.observation_count() == 0 && self.relative_poses.is_empty() {
            return Err(SolveError::Empty("the problem has no observations"));
        }
        Ok(())
    }
}

/// How many poses, cameras and landmarks there are.
type Counts = (usize, usize, usize);

/// Checks lengths, indices and that every number is finite, sigmas positive.
fn check_reprojections(batch: &ReprojectionBatch, counts: Counts) -> Result<(), SolveError> {
    let factor = "reprojection";
    check_indices(factor, [&batch.poses, &batch.cameras, &batch.landmarks], batch.len(), counts)?;
    check_sigmas(factor, &batch.sigmas_px, batch.len())?;
    check_finite(factor, &batch.pixels, |p| p.x.is_finite() && p.y.is_finite())
}

/// As [`check_reprojections`], and the depths.
fn check_depth_reprojections(
    batch: &DepthReprojectionBatch,
    counts: Counts,
) -> Result<(), SolveError> {
    let factor = "depth reprojection";
    check_indices(factor, [&batch.poses, &batch.cameras, &batch.landmarks], batch.len(), counts)?;
    check_sigmas(factor, &batch.sigmas_px, batch.len())?;
    check_sigmas(factor, &batch.sigmas_depth_m, batch.len())?;
    check_finite(factor, &batch.pixels, |p| p.x.is_finite() && p.y.is_finite())?;
    check_length("depths_m", batch.depths_m.len(), batch.len())?;
    check_finite(factor, &batch.depths_m, |depth| depth.is_finite())
}

fn check_length(what: &'static str, actual: usize, expected: usize) -> Result<(), SolveError> {
    if actual == expected {
        Ok(())
    } else {
        Err(SolveError::LengthMismatch { what, actual, expected })
    }
}

fn check_indices(
    factor: &'static str,
    indices: [&[u32]; 3],
    expected: usize,
    counts: Counts,
) -> Result<(), SolveError> {
    let names = [("pose", counts.0), ("camera", counts.1), ("landmark", counts.2)];
    for ((variable, count), indices) in names.into_iter().zip(indices) {
        check_length(variable, indices.len(), expected)?;
        if let Some(index) = indices.iter().position(|&v| v as usize >= count) {
            let value = indices[index] as usize;
            return Err(SolveError::IndexOutOfRange { factor, index, variable, value, count });
        }
    }
    Ok(())
}

fn check_sigmas(factor: &'static str, sigmas: &[f64], expected: usize) -> Result<(), SolveError> {
    check_length("sigmas", sigmas.len(), expected)?;
    match sigmas.iter().position(|&s| !(s.is_finite() && s > 0.0)) {
        Some(index) => Err(SolveError::NotPositiveDefinite { factor, index }),
        None => Ok(()),
    }
}

/// Names the first of `values` that is not finite.
fn check_finite<T>(
    what: &'static str,
    values: &[T],
    is_finite: impl Fn(&T) -> bool,
) -> Result<(), SolveError> {
    match values.iter().position(|value| !is_finite(value)) {
        Some(index) => Err(SolveError::NotFinite { what, index: index as i64 }),
        None => Ok(()),
    }
}
