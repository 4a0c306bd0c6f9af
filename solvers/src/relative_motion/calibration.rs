//! What an error of the calibration does to a measured relative pose.
//!
//! It is the same for all matches, so that more of them do not make it smaller, and the pose absorbs most
//! of it, so that the residuals do not show it. The parameters are considered, not estimated (Schmidt
//! 1966): with r the residual and c the parameters, δ = −H⁻¹ Σ w JᵀC⁻¹ (∂r/∂c) dc, and the covariance
//! of δ adds to H⁻¹. Reads what `measure` reads and changes nothing.

use nalgebra::{Matrix3, Matrix6, SMatrix, SVector, Vector3};

use super::{Match, huber_weight, residual};
use crate::geometry::{Camera, LieGroup, Se3};

/// Parameters of one camera: focal length, u and v of the center, scale of the depth.
const PARAMETERS: usize = 4;

/// How well the cameras of both keyframes are calibrated: standard deviations.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Calibration {
    /// Of the focal length, as a share of it.
    pub focal: f64,
    /// Of the direction of the optical axis in the image, each of u and v, in radians: pixels over the
    /// focal length.
    pub center_rad: f64,
    /// Of the scale of measured depths, as a share of it; 0 where the points do not come from depths.
    pub depth: f64,
    /// Whether both keyframes are of one camera: their errors are the same then.
    pub same_camera: bool,
}

impl Calibration {
    /// Without errors.
    #[cfg(test)]
    pub(crate) const EXACT: Self =
        Self { focal: 0.0, center_rad: 0.0, depth: 0.0, same_camera: true };

    fn sigmas(&self) -> SVector<f64, PARAMETERS> {
        SVector::from([self.focal, self.center_rad, self.center_rad, self.depth])
    }
}

/// The covariance by which errors of `calibration` add to that of the pose `a_from_b`, over a right
/// perturbation, translation first. `None` where the matches do not determine the pose.
#[must_use]
pub fn calibration_covariance(
    camera_b: &Camera,
    matches: &[Match],
    a_from_b: &Se3,
    calibration: &Calibration,
) -> Option<Matrix6<f64>> {
    let mut hessian = Matrix6::zeros();
    let mut of_a = SMatrix::<f64, 6, PARAMETERS>::zeros();
    let mut of_b = SMatrix::<f64, 6, PARAMETERS>::zeros();
    let focal = camera_b.mean_focal_px();
    let b_from_a = a_from_b.rotation.inverse().matrix();
    for seen in matches {
        let Some(r) = residual(camera_b, seen, a_from_b) else { continue };
        let weighted = r.jacobian.transpose() * r.information * huber_weight(r.squared);
        hessian += weighted * r.jacobian;
        // The pose's Jacobian by translation is −∂r/∂(point in b).
        let of_point: Matrix3<f64> = -r.jacobian.fixed_view::<3, 3>(0, 0);
        of_a += weighted * (of_point * b_from_a * point_by_parameters(&seen.landmark.point));
        let point = a_from_b.inverse_transform(&seen.landmark.point);
        of_b += weighted * residual_by_parameters(focal, &point, seen.depth_m.is_some());
    }
    let inverse = hessian.cholesky()?.inverse();
    let spread = |by_parameters: SMatrix<f64, 6, PARAMETERS>| {
        let moved = inverse * by_parameters * SMatrix::from_diagonal(&calibration.sigmas());
        moved * moved.transpose()
    };
    let covariance =
        if calibration.same_camera { spread(of_a + of_b) } else { spread(of_a) + spread(of_b) };
    covariance.iter().all(|v| v.is_finite()).then_some(covariance)
}

/// ∂(point in a)/∂c of a point that was made from a pixel and a depth.
fn point_by_parameters(point: &Vector3<f64>) -> SMatrix<f64, 3, PARAMETERS> {
    SMatrix::from_columns(&[
        Vector3::new(-point.x, -point.y, 0.0),
        Vector3::new(-point.z, 0.0, 0.0),
        Vector3::new(0.0, -point.z, 0.0),
        *point,
    ])
}

/// ∂r/∂c of a match that b sees at `point`; its depth has a residual only where it was measured.
fn residual_by_parameters(
    focal: f64,
    point: &Vector3<f64>,
    has_depth: bool,
) -> SMatrix<f64, 3, PARAMETERS> {
    SMatrix::from_columns(&[
        Vector3::new(focal * point.x / point.z, focal * point.y / point.z, 0.0),
        Vector3::new(focal, 0.0, 0.0),
        Vector3::new(0.0, focal, 0.0),
        Vector3::new(0.0, 0.0, if has_depth { -point.z } else { 0.0 }),
    ])
}

#[cfg(test)]
mod tests {
    use nalgebra::Vector2;

    use super::*;
    use crate::geometry::PinholeRadialTangential;
    use crate::testing::assert_jacobian;
    use crate::testing::random::{seeded, uniform_vector};

    fn pinhole(focal: f64, cx: f64, cy: f64) -> Camera {
        Camera::Pinhole(PinholeRadialTangential::undistorted(focal, focal, cx, cy))
    }

    /// The camera and the depth that are true if those of 500 px are off by `c`.
    fn corrected(c: &SVector<f64, PARAMETERS>) -> (Camera, f64) {
        (pinhole(500.0 * (1.0 + c[0]), 320.0 + 500.0 * c[1], 240.0 + 500.0 * c[2]), 1.0 + c[3])
    }

    #[test]
    fn the_jacobians_by_the_parameters_are_those_of_differences() {
        let mut rng = seeded(1);
        for _ in 0..50 {
            let spread: Vector3<f64> = uniform_vector(&mut rng, 1.0);
            let point = Vector3::new(spread.x, spread.y, 2.5 + spread.z);
            let pixel = pinhole(500.0, 320.0, 240.0).project(&point).unwrap();
            let made = |c: &SVector<f64, PARAMETERS>| {
                let (camera, scale) = corrected(c);
                camera.unproject(&pixel).unwrap() * (point.z * scale)
            };
            assert_jacobian("point", made, &point_by_parameters(&point), 1e-8);
            let residual = |c: &SVector<f64, PARAMETERS>| {
                let (camera, scale) = corrected(c);
                let predicted: Vector2<f64> = camera.project(&point).unwrap();
                let error = predicted - pixel;
                Vector3::new(error.x, error.y, point.z - point.z * scale)
            };
            let analytic = residual_by_parameters(500.0, &point, true);
            assert_jacobian("residual", residual, &analytic, 1e-8);
        }
    }
}
