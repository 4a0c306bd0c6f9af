//! Depth reprojection factor of RGB-D and stereo: r = ((π(p) − (u, v)) / σ_px, (p_z − d) / σ_d).
//!
//! p = T⁻¹ X is the point in the camera's frame; d is the measured depth along the optical axis in
//! meters (equation 8 of the reference frontend's paper). Jacobians as in the reprojection factor.

use nalgebra::{RowVector3, SMatrix, SVector, Vector2, Vector3};

use super::reprojection::{CAMERA_PARAMETERS, Linearization, Reprojection, retain_flagged};
use crate::geometry::{Camera, Se3, hat};

/// One observation (u, v, depth).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct DepthReprojection {
    /// Measured pixel (u, v).
    pub pixel: Vector2<f64>,
    /// Measured depth along the optical axis, in meters.
    pub depth_m: f64,
    /// Standard deviation of u and of v, in pixels.
    pub sigma_px: f64,
    /// Standard deviation of the depth, in meters.
    pub sigma_depth_m: f64,
}

impl DepthReprojection {
    fn reprojection(&self) -> Reprojection {
        Reprojection { pixel: self.pixel, sigma_px: self.sigma_px }
    }

    /// The whitened residual (u, v, depth); `None` where the projection is not finite.
    #[must_use]
    pub fn residual(
        &self,
        world_from_camera: &Se3,
        camera: &Camera,
        point_in_world: &Vector3<f64>,
    ) -> Option<SVector<f64, 3>> {
        let image = self.reprojection().residual(world_from_camera, camera, point_in_world)?;
        let depth = world_from_camera.inverse_transform(point_in_world).z;
        Some(SVector::from([image.x, image.y, (depth - self.depth_m) / self.sigma_depth_m]))
    }

    /// The whitened residual with Jacobians; `None` where the projection is not finite.
    #[must_use]
    pub fn linearize(
        &self,
        world_from_camera: &Se3,
        camera: &Camera,
        point_in_world: &Vector3<f64>,
    ) -> Option<Linearization<3>> {
        let image = self.reprojection().linearize(world_from_camera, camera, point_in_world)?;
        let point_in_camera = world_from_camera.inverse_transform(point_in_world);
        let d_depth = RowVector3::new(0.0, 0.0, 1.0 / self.sigma_depth_m);
        let depth = (point_in_camera.z - self.depth_m) / self.sigma_depth_m;
        let mut d_pose = SMatrix::<f64, 3, 6>::zeros();
        d_pose.fixed_rows_mut::<2>(0).copy_from(&image.d_pose);
        d_pose.fixed_view_mut::<1, 3>(2, 0).copy_from(&-d_depth);
        d_pose.fixed_view_mut::<1, 3>(2, 3).copy_from(&(d_depth * hat(&point_in_camera)));
        let mut d_camera = SMatrix::<f64, 3, CAMERA_PARAMETERS>::zeros();
        d_camera.fixed_rows_mut::<2>(0).copy_from(&image.d_camera);
        let mut d_landmark = SMatrix::<f64, 3, 3>::zeros();
        d_landmark.fixed_rows_mut::<2>(0).copy_from(&image.d_landmark);
        let camera_from_world = world_from_camera.rotation.matrix().transpose();
        d_landmark.row_mut(2).copy_from(&(d_depth * camera_from_world));
        Some(Linearization {
            residual: SVector::from([image.residual.x, image.residual.y, depth]),
            d_pose,
            d_camera,
            d_landmark,
        })
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
    /// Appends an observation.
    pub fn push(&mut self, pose: u32, camera: u32, landmark: u32, factor: DepthReprojection) {
        self.poses.push(pose);
        self.cameras.push(camera);
        self.landmarks.push(landmark);
        self.pixels.push(factor.pixel);
        self.depths_m.push(factor.depth_m);
        self.sigmas_px.push(factor.sigma_px);
        self.sigmas_depth_m.push(factor.sigma_depth_m);
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
        retain_flagged(&mut self.depths_m, &kept);
        retain_flagged(&mut self.sigmas_px, &kept);
        retain_flagged(&mut self.sigmas_depth_m, &kept);
    }

    /// Observation `k` without its indices.
    #[must_use]
    pub fn factor(&self, k: usize) -> DepthReprojection {
        DepthReprojection {
            pixel: self.pixels[k],
            depth_m: self.depths_m[k],
            sigma_px: self.sigmas_px[k],
            sigma_depth_m: self.sigmas_depth_m[k],
        }
    }
}
