//! Rigid motions of the plane, x ↦ R x + t.
//!
//! The tangent is (v_x, v_y, ω) and the logarithm is the full group logarithm: t = V(ω) v with V =
//! ∫₀¹ R(uω) du, not the pair (t, ω). Jacobians are those of Solà et al. (2018), section "The 2D
//! rigid motion group", written with the cancellation-free coefficients A to D. That the rotation
//! stays unit is the work of `So2`.

use nalgebra::{Matrix3, Vector2, Vector3};

use super::coefficients::RotationCoefficients;
use super::{LieGroup, So2};

/// A rigid motion of the plane, `target_from_source`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Se2 {
    /// Rotation of the target from the source frame.
    pub rotation: So2,
    /// Origin of the source frame, in target coordinates.
    pub translation: Vector2<f64>,
}

impl Se2 {
    /// The motion x ↦ R x + t.
    #[inline]
    pub fn new(rotation: So2, translation: Vector2<f64>) -> Self {
        Self { rotation, translation }
    }

    /// The pose with origin (`x`, `y`) and heading `theta` radians.
    #[inline]
    pub fn from_xy_angle(x: f64, y: f64, theta: f64) -> Self {
        Self::new(So2::from_angle(theta), Vector2::new(x, y))
    }

    /// R p + t.
    #[inline]
    pub fn transform(&self, point: &Vector2<f64>) -> Vector2<f64> {
        self.rotation.rotate(point) + self.translation
    }
}

/// The 3 × 3 matrix of three columns above the row (0, 0, 1).
#[inline]
fn columns(x: [f64; 2], y: [f64; 2], omega: [f64; 2]) -> Matrix3<f64> {
    Matrix3::new(x[0], y[0], omega[0], x[1], y[1], omega[1], 0.0, 0.0, 1.0)
}

impl LieGroup<3> for Se2 {
    #[inline]
    fn identity() -> Self {
        Self::new(So2::identity(), Vector2::zeros())
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
    fn exp(tangent: &Vector3<f64>) -> Self {
        let (vx, vy, omega) = (tangent.x, tangent.y, tangent.z);
        let k = RotationCoefficients::new(omega * omega);
        let turn = k.b * omega;
        Self::new(So2::from_angle(omega), Vector2::new(k.a * vx - turn * vy, turn * vx + k.a * vy))
    }

    #[inline]
    fn log(&self) -> Vector3<f64> {
        let omega = self.rotation.angle();
        let h = 0.5 * omega;
        let g = self.rotation.half_angle_cotangent(h);
        let t = &self.translation;
        Vector3::new(g * t.x + h * t.y, g * t.y - h * t.x, omega)
    }

    #[inline]
    fn adjoint(&self) -> Matrix3<f64> {
        let r = self.rotation.matrix();
        let t = &self.translation;
        columns([r[(0, 0)], r[(1, 0)]], [r[(0, 1)], r[(1, 1)]], [t.y, -t.x])
    }

    #[inline]
    fn right_jacobian_inverse(tangent: &Vector3<f64>) -> Matrix3<f64> {
        let (vx, vy, omega) = (tangent.x, tangent.y, tangent.z);
        let k = RotationCoefficients::new(omega * omega);
        let (bend, h) = (k.d * omega, 0.5 * omega);
        let g = k.half_angle_cotangent();
        columns([g, h], [-h, g], [bend * vx + 0.5 * vy, bend * vy - 0.5 * vx])
    }

    #[inline]
    fn act(&self, point: &Vector3<f64>) -> Vector3<f64> {
        let moved = self.transform(&point.xy());
        Vector3::new(moved.x, moved.y, point.z)
    }

    #[inline]
    fn act_jacobian(&self, point: &Vector3<f64>) -> Matrix3<f64> {
        let turn = self.rotation.rotate(&Vector2::new(-point.y, point.x));
        let r = self.rotation.matrix();
        Matrix3::new(r.m11, r.m12, turn.x, r.m21, r.m22, turn.y, 0.0, 0.0, 0.0)
    }

    #[inline]
    fn is_finite(&self) -> bool {
        self.rotation.is_finite() && self.translation.iter().all(|v| v.is_finite())
    }
}
