//! Priors on a pose of any group: all of it, or where it takes one point (GNSS, a surveyed mark).
//!
//! Pose: r = Log(Z⁻¹ · X), Z the measured pose, and ∂r/∂δ = J_r⁻¹(r). Position: r = X · p − z in the
//! world's axes, p the measured point in the pose's own frame (the lever arm, 0 its origin); with the
//! right update X · Exp(δ), ∂r/∂δ = [R | −R [p]×] in SE(3). Nothing here applies a loss.

use nalgebra::{SMatrix, SVector, Vector3};

use crate::geometry::{LieGroup, Se3};
use crate::information::Information;
use crate::loss::Loss;

/// A measured pose.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PosePrior<G = Se3, const N: usize = 6> {
    /// Index of the pose.
    pub pose: usize,
    /// The measurement Z.
    pub world_from_camera: G,
    /// Ω over the tangent, translation first.
    pub information: Information<N>,
    /// ρ of this factor.
    pub loss: Loss,
}

impl<G: LieGroup<N>, const N: usize> PosePrior<G, N> {
    /// The residual and ∂r/∂δ, not whitened.
    #[must_use]
    pub fn linearize(&self, world_from_camera: &G) -> (SVector<f64, N>, SMatrix<f64, N, N>) {
        let residual = world_from_camera.minus(&self.world_from_camera);
        (residual, G::right_jacobian_inverse(&residual))
    }

    /// χ² = rᵀΩr.
    #[must_use]
    pub fn chi2(&self, world_from_camera: &G) -> f64 {
        self.information.squared_norm(&world_from_camera.minus(&self.world_from_camera))
    }
}

/// A measured position of a point that is fixed to a pose.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PositionPrior {
    /// Index of the pose.
    pub pose: usize,
    /// The measurement z, in meters.
    pub position_in_world: Vector3<f64>,
    /// The measured point in the frame of the pose (the lever arm), in meters; 0 is its origin.
    pub point_in_camera: Vector3<f64>,
    /// Ω over (x, y, z) of the world frame, in 1/m².
    pub information: Information<3>,
    /// ρ of this factor.
    pub loss: Loss,
}

impl PositionPrior {
    /// Whether every number of the measurement is finite.
    #[must_use]
    pub fn is_finite(&self) -> bool {
        self.position_in_world.iter().chain(&self.point_in_camera).all(|value| value.is_finite())
    }

    /// The residual, not whitened.
    #[must_use]
    pub fn residual<G: LieGroup<N>, const N: usize>(&self, world_from_camera: &G) -> Vector3<f64> {
        world_from_camera.act(&self.point_in_camera) - self.position_in_world
    }

    /// The residual and ∂r/∂δ, not whitened.
    #[must_use]
    pub fn linearize<G: LieGroup<N>, const N: usize>(
        &self,
        world_from_camera: &G,
    ) -> (Vector3<f64>, SMatrix<f64, 3, N>) {
        let d_pose = world_from_camera.act_jacobian(&self.point_in_camera);
        (self.residual(world_from_camera), d_pose)
    }

    /// χ² = rᵀΩr.
    #[must_use]
    pub fn chi2<G: LieGroup<N>, const N: usize>(&self, world_from_camera: &G) -> f64 {
        self.information.squared_norm(&self.residual(world_from_camera))
    }
}
