//! Observation factors: a landmark at a pixel, without and with a measured depth.
//!
//! Reprojection: r = (π(camera, p) − (u, v)) / σ with p = T⁻¹ X and T = `world_from_camera`. Depth
//! reprojection (RGB-D and stereo) adds (p_z − d) / σ_d, d the depth along the optical axis in meters
//! (equation 8 of the reference frontend's paper). With the right update, ∂p/∂δ = [−I | p^] and
//! ∂p/∂X = Rᵀ. A point behind the camera has a residual like any other (BAL's reading); only a
//! projection that is not finite has none. Losses are applied by the caller.

use nalgebra::{RowVector3, SMatrix, SVector, Vector2, Vector3};

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

/// One observation of either kind.
pub(crate) enum Observed {
    /// (u, v).
    Pixel(Reprojection),
    /// (u, v, depth).
    Depth(DepthReprojection),
}

impl Observed {
    /// `depth_m` is the depth and its standard deviation, in meters.
    pub(crate) fn new(pixel: Vector2<f64>, sigma_px: f64, depth_m: Option<(f64, f64)>) -> Self {
        match depth_m {
            None => Self::Pixel(Reprojection { pixel, sigma_px }),
            Some((depth_m, sigma_depth_m)) => {
                Self::Depth(DepthReprojection { pixel, depth_m, sigma_px, sigma_depth_m })
            }
        }
    }

    /// The whitened squared residual; infinite where the projection is not finite.
    pub(crate) fn squared_error(&self, pose: &Se3, camera: &Camera, point: &Vector3<f64>) -> f64 {
        match self {
            Self::Pixel(f) => f.residual(pose, camera, point).map(|r| r.norm_squared()),
            Self::Depth(f) => f.residual(pose, camera, point).map(|r| r.norm_squared()),
        }
        .unwrap_or(f64::INFINITY)
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

    /// Observation `k` without its indices.
    #[must_use]
    pub fn factor(&self, k: usize) -> Reprojection {
        Reprojection { pixel: self.pixels[k], sigma_px: self.sigmas_px[k] }
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
        for indices in [&mut self.poses, &mut self.cameras, &mut self.landmarks] {
            retain_flagged(indices, &kept);
        }
        retain_flagged(&mut self.pixels, &kept);
        for numbers in [&mut self.depths_m, &mut self.sigmas_px, &mut self.sigmas_depth_m] {
            retain_flagged(numbers, &kept);
        }
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

/// Keeps the entries whose flag is set, in their order; entries past the flags stay.
fn retain_flagged<T>(values: &mut Vec<T>, kept: &[bool]) {
    let mut flags = kept.iter();
    values.retain(|_| flags.next().is_none_or(|&flag| flag));
}
