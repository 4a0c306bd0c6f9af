//! Prior on a whole pose: r = Log(Z⁻¹ · T), Z = the measured `world_from_camera`.
//!
//! ∂r/∂δ = J_r⁻¹(r).

use nalgebra::{SMatrix, SVector};

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
