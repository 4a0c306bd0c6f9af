//! Observation factor: a landmark at a pixel, without or with a measured depth.
//!
//! r = (π(camera, p) − (u, v)) / σ with p = T⁻¹ X and T = `world_from_camera`. A depth (RGB-D and
//! stereo) adds (p_z − d) / σ_d, d along the optical axis in meters (equation 8 of the reference
//! frontend's paper). With the right update, ∂p/∂δ = [−I | p^] and ∂p/∂X = Rᵀ. A point behind the camera
//! has a residual like any other (BAL's reading); only a projection that is not finite has none. Losses
//! are applied by the caller.

use nalgebra::{Matrix3, Matrix3x6, Vector2, Vector3};

use crate::geometry::{Camera, Se3, hat};

/// A whitened residual (u, v, depth) with its Jacobians; the rows of a depth that was not measured are
/// zero.
#[derive(Clone, Copy, Debug)]
pub struct Linearization {
    /// The whitened residual.
    pub residual: Vector3<f64>,
    /// ∂r/∂δ of the pose, translation first.
    pub d_pose: Matrix3x6<f64>,
    /// ∂r/∂ `point_in_world`.
    pub d_landmark: Matrix3<f64>,
}

/// One observation (u, v) or (u, v, depth).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Reprojection {
    /// Measured pixel (u, v).
    pub pixel: Vector2<f64>,
    /// Standard deviation of u and of v, in pixels.
    pub sigma_px: f64,
    /// Measured depth along the optical axis and its standard deviation, in meters.
    pub depth_m: Option<(f64, f64)>,
}

impl Reprojection {
    /// The whitened residual (u, v, depth), 0 for a depth that was not measured; `None` where the
    /// projection is not finite.
    #[must_use]
    pub fn residual(
        &self,
        world_from_camera: &Se3,
        camera: &Camera,
        point_in_world: &Vector3<f64>,
    ) -> Option<Vector3<f64>> {
        let point_in_camera = world_from_camera.inverse_transform(point_in_world);
        let image = (camera.project(&point_in_camera)? - self.pixel) / self.sigma_px;
        let depth = self.depth_m.map_or(0.0, |(depth, sigma)| (point_in_camera.z - depth) / sigma);
        Some(image.push(depth))
    }

    /// The whitened squared residual; infinite where the projection is not finite.
    pub(crate) fn squared_error(&self, pose: &Se3, camera: &Camera, point: &Vector3<f64>) -> f64 {
        self.residual(pose, camera, point).map_or(f64::INFINITY, |r| r.norm_squared())
    }

    /// The whitened residual with Jacobians; `None` where the projection is not finite.
    #[must_use]
    pub fn linearize(
        &self,
        world_from_camera: &Se3,
        camera: &Camera,
        point_in_world: &Vector3<f64>,
    ) -> Option<Linearization> {
        let point_in_camera = world_from_camera.inverse_transform(point_in_world);
        let projection = camera.project_with_jacobians(&point_in_camera)?;
        let scale = 1.0 / self.sigma_px;
        let mut d_point = Matrix3::zeros();
        d_point.fixed_rows_mut::<2>(0).copy_from(&(projection.d_point * scale));
        let mut residual = ((projection.pixel - self.pixel) * scale).push(0.0);
        if let Some((depth, sigma)) = self.depth_m {
            d_point[(2, 2)] = 1.0 / sigma;
            residual.z = (point_in_camera.z - depth) / sigma;
        }
        let mut d_pose = Matrix3x6::zeros();
        d_pose.fixed_columns_mut::<3>(0).copy_from(&-d_point);
        d_pose.fixed_columns_mut::<3>(3).copy_from(&(d_point * hat(&point_in_camera)));
        let d_landmark = d_point * world_from_camera.rotation.matrix().transpose();
        Some(Linearization { residual, d_pose, d_landmark })
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
        for indices in [&mut self.poses, &mut self.cameras, &mut self.landmarks] {
            indices.reserve(additional);
        }
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
        for indices in [&mut self.poses, &mut self.cameras, &mut self.landmarks] {
            retain_flagged(indices, &kept);
        }
        retain_flagged(&mut self.pixels, &kept);
        retain_flagged(&mut self.sigmas_px, &kept);
    }
}

/// Observations (u, v, depth) as a structure of arrays; entry k of each array is observation k.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct DepthReprojectionBatch {
    /// Index of the observing pose.
    pub poses: Vec<u32>,
    /// Index of the observing camera.
    pub cameras: Vec<u32>,
    /// Index of the observed landmark.
    pub landmarks: Vec<u32>,
    /// Measured pixel (u, v).
    pub pixels: Vec<Vector2<f64>>,
    /// Measured depth in meters.
    pub depths_m: Vec<f64>,
    /// Standard deviation of u and of v, in pixels.
    pub sigmas_px: Vec<f64>,
    /// Standard deviation of the depth, in meters.
    pub sigmas_depth_m: Vec<f64>,
}

impl DepthReprojectionBatch {
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
        for indices in [&mut self.poses, &mut self.cameras, &mut self.landmarks] {
            retain_flagged(indices, &kept);
        }
        retain_flagged(&mut self.pixels, &kept);
        for numbers in [&mut self.depths_m, &mut self.sigmas_px, &mut self.sigmas_depth_m] {
            retain_flagged(numbers, &kept);
        }
    }
}

/// Keeps the entries whose flag is set, in their order; entries past the flags stay.
fn retain_flagged<T>(values: &mut Vec<T>, kept: &[bool]) {
    let mut flags = kept.iter();
    values.retain(|_| flags.next().is_none_or(|&flag| flag));
}
