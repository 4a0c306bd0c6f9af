//! Rigid motions of space, x ↦ R x + t.
//!
//! The tangent is (ρ, φ), translation first, and the logarithm is the full group logarithm: t =
//! J_l(φ) ρ. The Jacobian is block triangular, J = [J_φ Q; 0 J_φ], with the coupling block Q of
//! Barfoot and Furgale (2014) reduced by a^ b^ a^ = −(a·b) a^ to sums of outer products, and its
//! inverse is [J⁻¹ −J⁻¹QJ⁻¹; 0 J⁻¹]: no matrix is inverted numerically. The rotation stays unit
//! because [`So3::compose`] renormalizes each product.

use nalgebra::{Matrix3, Matrix6, SMatrix, Vector3, Vector6};

use super::coefficients::RotationCoefficients;
use super::coefficients::hat;
use super::{LieGroup, So3};

/// A rigid motion of space, `target_from_source`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Se3 {
    /// Rotation of the target from the source frame.
    pub rotation: So3,
    /// Origin of the source frame, in target coordinates.
    pub translation: Vector3<f64>,
}

impl Se3 {
    /// The motion x ↦ R x + t.
    #[inline]
    pub fn new(rotation: So3, translation: Vector3<f64>) -> Self {
        Self { rotation, translation }
    }

    /// R p + t.
    #[inline]
    pub fn transform(&self, point: &Vector3<f64>) -> Vector3<f64> {
        self.rotation.rotate(point) + self.translation
    }

    /// Rᵀ (p − t).
    #[inline]
    pub fn inverse_transform(&self, point: &Vector3<f64>) -> Vector3<f64> {
        self.rotation.inverse_rotate(&(point - self.translation))
    }
}

/// Splits a tangent into its translation and rotation parts.
#[inline]
fn split(tangent: &Vector6<f64>) -> (Vector3<f64>, Vector3<f64>) {
    (tangent.fixed_rows::<3>(0).into_owned(), tangent.fixed_rows::<3>(3).into_owned())
}

/// The coupling block of the right Jacobian: Barfoot's Q at (−ρ, −φ).
#[inline]
fn right_coupling(
    rho: &Vector3<f64>,
    phi: &Vector3<f64>,
    k: &RotationCoefficients,
) -> Matrix3<f64> {
    let dot = rho.dot(phi);
    let outer = rho * phi.transpose();
    let f = 2.0 * dot * k.f();
    let skew = rho * k.b + phi * (dot * (2.0 * k.e - k.c));
    let mut q = (outer + outer.transpose()) * k.c - hat(&skew) - (phi * f) * phi.transpose();
    let diagonal = f * k.squared_angle - 2.0 * dot * k.c;
    q[(0, 0)] += diagonal;
    q[(1, 1)] += diagonal;
    q[(2, 2)] += diagonal;
    q
}

/// The 6 × 6 matrix [`diagonal` `coupling`; 0 `diagonal`].
#[inline]
fn block_triangular(diagonal: &Matrix3<f64>, coupling: &Matrix3<f64>) -> Matrix6<f64> {
    let mut matrix = Matrix6::zeros();
    matrix.fixed_view_mut::<3, 3>(0, 0).copy_from(diagonal);
    matrix.fixed_view_mut::<3, 3>(0, 3).copy_from(coupling);
    matrix.fixed_view_mut::<3, 3>(3, 3).copy_from(diagonal);
    matrix
}

impl LieGroup<6> for Se3 {
    #[inline]
    fn identity() -> Self {
        Self::new(So3::identity(), Vector3::zeros())
    }

    #[inline]
    fn compose(&self, other: &Self) -> Self {
        Self::new(self.rotation.compose(&other.rotation), self.transform(&other.translation))
    }

    #[inline]
    fn inverse(&self) -> Self {
        Self::new(self.rotation.inverse(), -self.rotation.inverse_rotate(&self.translation))
    }

    #[inline]
    fn exp(tangent: &Vector6<f64>) -> Self {
        let (rho, phi) = split(tangent);
        let k = RotationCoefficients::new(phi.norm_squared());
        Self::new(So3::exp(&phi), k.left_jacobian_times(&phi, &rho))
    }

    #[inline]
    fn log(&self) -> Vector6<f64> {
        let phi = self.rotation.log();
        let k = RotationCoefficients::new(phi.norm_squared());
        let rho = k.left_jacobian_inverse_times(&phi, &self.translation);
        Vector6::new(rho.x, rho.y, rho.z, phi.x, phi.y, phi.z)
    }

    #[inline]
    fn adjoint(&self) -> Matrix6<f64> {
        let rotation = self.rotation.matrix();
        block_triangular(&rotation, &(hat(&self.translation) * rotation))
    }

    #[inline]
    fn right_jacobian_inverse(tangent: &Vector6<f64>) -> Matrix6<f64> {
        let (rho, phi) = split(tangent);
        let k = RotationCoefficients::new(phi.norm_squared());
        let inverse = k.right_jacobian_inverse(&phi);
        let coupling = -(inverse * right_coupling(&rho, &phi, &k) * inverse);
        block_triangular(&inverse, &coupling)
    }

    #[inline]
    fn act(&self, point: &Vector3<f64>) -> Vector3<f64> {
        self.transform(point)
    }

    #[inline]
    fn act_jacobian(&self, point: &Vector3<f64>) -> SMatrix<f64, 3, 6> {
        let rotation = self.rotation.matrix();
        let mut jacobian = SMatrix::<f64, 3, 6>::zeros();
        jacobian.fixed_columns_mut::<3>(0).copy_from(&rotation);
        jacobian.fixed_columns_mut::<3>(3).copy_from(&(-rotation * hat(point)));
        jacobian
    }

    #[inline]
    fn is_finite(&self) -> bool {
        self.rotation.is_finite() && self.translation.iter().all(|v| v.is_finite())
    }
}
