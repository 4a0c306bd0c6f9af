//! Measurement of a landmark from a pose: its position or its bearing. Its range is a factor of `range`.
//!
//! With q = X⁻¹ · p the landmark in the frame of the pose: position r = q − z, bearing
//! r = atan2(q_y, q_x) − z within half a turn. With the right update X · Exp(δ),
//! ∂q/∂δ = −∂(Exp(δ) · q)/∂δ and ∂q/∂p = Rᵀ. In the plane the third row of everything is zero.
//! Nothing here applies a loss.

use nalgebra::{Matrix3, SMatrix, Vector3};

use crate::geometry::{LieGroup, So2};
use crate::information::{Information, InformationError};
use crate::loss::Loss;

/// What was measured of a landmark.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Sighting {
    /// Where it is in the frame of the pose, in meters; z = 0 in the plane.
    Position(Vector3<f64>),
    /// Its direction about the z axis from the x axis of the pose, in radians.
    Bearing(f64),
}

/// A measured landmark.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LandmarkMeasurement {
    /// Index of the pose that it is measured from; `None` is the world itself, as of a survey.
    pub pose: Option<usize>,
    /// Index of the landmark.
    pub landmark: usize,
    /// The measurement.
    pub sighting: Sighting,
    /// Ω over the rows of the residual: (x, y, z) of a position, of which the plane has two; the first
    /// row alone of a bearing, in 1/rad².
    pub information: Information<3>,
    /// ρ of this factor alone; `None` takes the loss of the graph.
    pub loss: Option<Loss>,
}

/// The residual of a measured landmark with its Jacobians, not yet whitened.
#[derive(Clone, Copy, Debug)]
pub struct LandmarkLinearization<const N: usize> {
    /// The residual; rows that the measurement does not have are zero.
    pub residual: Vector3<f64>,
    /// ∂r/∂δ of the pose, translation first.
    pub d_pose: SMatrix<f64, 3, N>,
    /// ∂r/∂p.
    pub d_landmark: Matrix3<f64>,
}

impl LandmarkMeasurement {
    /// Ω of a bearing with this precision, 1/σ².
    ///
    /// # Errors
    /// [`InformationError`] where the precision is negative or not finite.
    pub fn scalar_information(precision: f64) -> Result<Information<3>, InformationError> {
        Information::semidefinite(&Matrix3::from_diagonal(&Vector3::new(precision, 0.0, 0.0)))
    }

    /// Whether every number of the measurement is finite.
    #[must_use]
    pub fn is_finite(&self) -> bool {
        match self.sighting {
            Sighting::Position(position) => position.iter().all(|value| value.is_finite()),
            Sighting::Bearing(value) => value.is_finite(),
        }
    }

    /// Rows of the residual where a position has `dimension` of them.
    #[must_use]
    pub fn rows(&self, dimension: usize) -> usize {
        match self.sighting {
            Sighting::Position(_) => dimension,
            Sighting::Bearing(_) => 1,
        }
    }

    /// The residual from `world_from_pose`, not whitened.
    #[must_use]
    pub fn residual<G: LieGroup<N>, const N: usize>(
        &self,
        world_from_pose: &G,
        point_in_world: &Vector3<f64>,
    ) -> Vector3<f64> {
        self.residual_in_pose(&world_from_pose.inverse().act(point_in_world))
    }

    fn residual_in_pose(&self, q: &Vector3<f64>) -> Vector3<f64> {
        match self.sighting {
            Sighting::Position(z) => q - z,
            Sighting::Bearing(z) => {
                Vector3::new(So2::from_angle(q.y.atan2(q.x) - z).angle(), 0.0, 0.0)
            }
        }
    }

    /// χ² = rᵀΩr from `world_from_pose`.
    #[must_use]
    pub fn chi2<G: LieGroup<N>, const N: usize>(
        &self,
        world_from_pose: &G,
        point_in_world: &Vector3<f64>,
    ) -> f64 {
        self.information.squared_norm(&self.residual(world_from_pose, point_in_world))
    }

    /// The residual and its Jacobians from `world_from_pose`, not whitened. A landmark at the origin of
    /// the pose has no direction: its bearing then has zero Jacobians.
    #[must_use]
    pub fn linearize<G: LieGroup<N>, const N: usize>(
        &self,
        world_from_pose: &G,
        point_in_world: &Vector3<f64>,
    ) -> LandmarkLinearization<N> {
        let pose_from_world = world_from_pose.inverse();
        let q = pose_from_world.act(point_in_world);
        let origin = pose_from_world.act(&Vector3::zeros());
        let column = |axis: Vector3<f64>| pose_from_world.act(&axis) - origin;
        let axes = [Vector3::x(), Vector3::y(), Vector3::z()].map(column);
        let d_q = self.of_point(&q);
        LandmarkLinearization {
            residual: self.residual_in_pose(&q),
            d_pose: -d_q * G::identity().act_jacobian(&q),
            d_landmark: d_q * Matrix3::from_columns(&axes),
        }
    }

    /// ∂r/∂q.
    fn of_point(&self, q: &Vector3<f64>) -> Matrix3<f64> {
        match self.sighting {
            Sighting::Position(_) => Matrix3::identity(),
            Sighting::Bearing(_) => {
                let square = q.x * q.x + q.y * q.y;
                let around = Vector3::new(-q.y, q.x, 0.0);
                let row = if square > 0.0 { around / square } else { Vector3::zeros() };
                let mut matrix = Matrix3::zeros();
                matrix.set_row(0, &row.transpose());
                matrix
            }
        }
    }
}
