//! Prior on a camera's position (GPS, survey): r = t − z in the world frame.
//!
//! With the right update t ⊞ δ = t + R δ_t to first order: ∂r/∂δ = [R | 0].

use nalgebra::{SMatrix, Vector3};

use crate::geometry::Se3;
use crate::information::Information;

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
