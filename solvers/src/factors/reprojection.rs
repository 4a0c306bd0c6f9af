//! Reprojection factor: r = (π(camera, T⁻¹ X) − (u, v)) / σ, T = `world_from_camera`.
//!
//! With p = T⁻¹ X and the right update, ∂p/∂δ = [−I | p^] and ∂p/∂X = Rᵀ. A point behind the camera
//! has a residual like any other (BAL's reading); only a projection that is not finite has none.

use nalgebra::{SMatrix, SVector, Vector2, Vector3};

use crate::geometry::{Camera, Se3, hat};

/// The most parameters a camera model has.
pub(crate) const CAMERA_PARAMETERS: usize = 9;

/// A whitened residual with its Jacobians; camera columns past the model's parameters are zero.
#[derive(Clone, Copy, Debug)]
pub struct Linearization<const R: usize> {
    /// The whitened residual.
    pub residual: SVector<f64, R>,
    /// ∂r/∂δ of the pose, translation first.
    pub d_pose: SMatrix<f64, R, 6>,
    /// ∂r/∂ camera parameters.
    pub d_camera: SMatrix<f64, R, CAMERA_PARAMETERS>,
    /// ∂r/∂ `point_in_world`.
    pub d_landmark: SMatrix<f64, R, 3>,
}

/// One observation (u, v).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Reprojection {
    /// Measured pixel (u, v).
    pub pixel: Vector2<f64>,
    /// Standard deviation of u and of v, in pixels.
    pub sigma_px: f64,
}

impl Reprojection {
    /// The whitened residual; `None` where the projection is not finite.
    #[must_use]
    pub fn residual(
        &self,
        world_from_camera: &Se3,
        camera: &Camera,
        point_in_world: &Vector3<f64>,
    ) -> Option<SVector<f64, 2>> {
        let predicted = camera.project(&world_from_camera.inverse_transform(point_in_world))?;
        Some((predicted - self.pixel) / self.sigma_px)
    }

    /// The whitened residual with Jacobians; `None` where the projection is not finite.
    #[must_use]
    pub fn linearize(
        &self,
        world_from_camera: &Se3,
        camera: &Camera,
        point_in_world: &Vector3<f64>,
    ) -> Option<Linearization<2>> {
        let point_in_camera = world_from_camera.inverse_transform(point_in_world);
        let projection = camera.project_with_jacobians(&point_in_camera)?;
        let scale = 1.0 / self.sigma_px;
        let d_point = projection.d_point * scale;
        let mut d_pose = SMatrix::<f64, 2, 6>::zeros();
        d_pose.fixed_columns_mut::<3>(0).copy_from(&-d_point);
        d_pose.fixed_columns_mut::<3>(3).copy_from(&(d_point * hat(&point_in_camera)));
        Some(Linearization {
            residual: (projection.pixel - self.pixel) * scale,
            d_pose,
            d_camera: projection.d_parameters * scale,
            d_landmark: d_point * world_from_camera.rotation.matrix().transpose(),
        })
    }
}

/// Observations (u, v) as a structure of arrays; entry k of each array is observation k.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct ReprojectionBatch {
    /// Index of the observing pose.
    pub poses: Vec<u32>,
    /// Index of the observing camera.
    pub cameras: Vec<u32>,
    /// Index of the observed landmark.
    pub landmarks: Vec<u32>,
    /// Measured pixel (u, v).
    pub pixels: Vec<Vector2<f64>>,
    /// Standard deviation of u and of v, in pixels.
    pub sigmas_px: Vec<f64>,
}

impl ReprojectionBatch {
    /// Makes room for `additional` observations.
    pub fn reserve(&mut self, additional: usize) {
        self.poses.reserve(additional);
        self.cameras.reserve(additional);
        self.landmarks.reserve(additional);
        self.pixels.reserve(additional);
        self.sigmas_px.reserve(additional);
    }

    /// Appends an observation.
    pub fn push(
        &mut self,
        pose: u32,
        camera: u32,
        landmark: u32,
        pixel: Vector2<f64>,
        sigma_px: f64,
    ) {
        self.poses.push(pose);
        self.cameras.push(camera);
        self.landmarks.push(landmark);
        self.pixels.push(pixel);
        self.sigmas_px.push(sigma_px);
    }

    /// The number of observations.
    #[must_use]
    pub fn len(&self) -> usize {
        self.pixels.len()
    }

    /// Whether there are none.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.pixels.is_empty()
    }

    /// Keeps the observations `k` for which `keep(k)`, in their order; asks once for each.
    pub fn retain(&mut self, keep: impl FnMut(usize) -> bool) {
        let kept: Vec<bool> = (0..self.len()).map(keep).collect();
        retain_flagged(&mut self.poses, &kept);
        retain_flagged(&mut self.cameras, &kept);
        retain_flagged(&mut self.landmarks, &kept);
        retain_flagged(&mut self.pixels, &kept);
        retain_flagged(&mut self.sigmas_px, &kept);
    }

    /// Observation `k` without its indices.
    #[must_use]
    pub fn factor(&self, k: usize) -> Reprojection {
        Reprojection { pixel: self.pixels[k], sigma_px: self.sigmas_px[k] }
    }
}

/// Keeps the entries whose flag is set, in their order; entries past the flags stay.
pub(super) fn retain_flagged<T>(values: &mut Vec<T>, kept: &[bool]) {
    let mut flags = kept.iter();
    values.retain(|_| flags.next().is_none_or(|&flag| flag));
}
