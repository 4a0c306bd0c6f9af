//! Priors on a pose: all of it, or the camera's position alone (GPS, survey).
//!
//! Pose: r = Log(Z⁻¹ · T), Z the measured `world_from_camera`, and ∂r/∂δ = J_r⁻¹(r). Position:
//! r = t − z in the world frame; the right update is t ⊞ δ = t + R δ_t to first order, so that
//! ∂r/∂δ = [R | 0].

use nalgebra::{SMatrix, SVector, Vector3};

use crate::geometry::{LieGroup, Se3};
use crate::information::Information;

/// A measured pose.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PosePrior {
    /// Index of the pose.
    pub pose: usize,
    /// The measurement Z.
    pub world_from_camera: Se3,
    /// Ω over the tangent, translation first.
    pub information: Information<6>,
}

impl PosePrior {
    /// The residual and ∂r/∂δ, not whitened.
    #[must_use]
    pub fn linearize(&self, world_from_camera: &Se3) -> (SVector<f64, 6>, SMatrix<f64, 6, 6>) {
        let residual = world_from_camera.minus(&self.world_from_camera);
        (residual, Se3::right_jacobian_inverse(&residual))
    }
}

/// A measured camera position.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PositionPrior {
    /// Index of the pose.
    pub pose: usize,
    /// The measurement z, in meters.
    pub position_in_world: Vector3<f64>,
    /// Ω over (x, y, z) of the world frame, in 1/m².
    pub information: Information<3>,
}

impl PositionPrior {
    /// The residual and ∂r/∂δ, not whitened.
    #[must_use]
    pub fn linearize(&self, world_from_camera: &Se3) -> (Vector3<f64>, SMatrix<f64, 3, 6>) {
        let mut d_pose = SMatrix::<f64, 3, 6>::zeros();
        d_pose.fixed_columns_mut::<3>(0).copy_from(&world_from_camera.rotation.matrix());
        (world_from_camera.translation - self.position_in_world, d_pose)
    }
}
