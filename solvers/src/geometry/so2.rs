//! Rotations of the plane, stored as the unit complex number cos θ + i sin θ.
//!
//! The tangent is the angle in radians, counterclockwise; the group commutes, so adjoint and
//! Jacobians are 1. Products are pulled back to unit length by one Newton step, which keeps long
//! chains unit to the last place without a square root.

use nalgebra::{Matrix1, Matrix2, Vector1, Vector2, Vector3};

use super::LieGroup;

/// A rotation of the plane.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct So2 {
    cos: f64,
    sin: f64,
}

impl So2 {
    /// The rotation by `angle` radians, counterclockwise.
    #[inline]
    pub fn from_angle(angle: f64) -> Self {
        let (sin, cos) = angle.sin_cos();
        Self { cos, sin }
    }

    /// The angle in [−π, π], radians.
    #[inline]
    pub fn angle(&self) -> f64 {
        self.sin.atan2(self.cos)
    }

    /// `half` · cot(θ/2) where `half` is θ/2, without a tangent and without cancellation; one where `half` is
    /// too small for all its digits.
    #[inline]
    pub(super) fn half_angle_cotangent(&self, half: f64) -> f64 {
        if half.abs() < f64::MIN_POSITIVE {
            1.0
        } else if self.cos < 0.0 {
            half * self.sin / (1.0 - self.cos)
        } else {
            half * (1.0 + self.cos) / self.sin
        }
    }

    /// R p.
    #[inline]
    pub fn rotate(&self, point: &Vector2<f64>) -> Vector2<f64> {
        Vector2::new(
            self.cos * point.x - self.sin * point.y,
            self.sin * point.x + self.cos * point.y,
        )
    }

    /// Rᵀ p.
    #[inline]
    pub fn inverse_rotate(&self, point: &Vector2<f64>) -> Vector2<f64> {
        Vector2::new(
            self.cos * point.x + self.sin * point.y,
            self.cos * point.y - self.sin * point.x,
        )
    }

    /// The 2 × 2 rotation matrix.
    #[inline]
    pub fn matrix(&self) -> Matrix2<f64> {
        Matrix2::new(self.cos, -self.sin, self.sin, self.cos)
    }
}

impl LieGroup<1> for So2 {
    #[inline]
    fn identity() -> Self {
        Self { cos: 1.0, sin: 0.0 }
    }

    #[inline]
    fn compose(&self, other: &Self) -> Self {
        let cos = self.cos * other.cos - self.sin * other.sin;
        let sin = self.sin * other.cos + self.cos * other.sin;
        let unit = 1.5 - 0.5 * (cos * cos + sin * sin);
        Self { cos: cos * unit, sin: sin * unit }
    }

    #[inline]
    fn inverse(&self) -> Self {
        Self { cos: self.cos, sin: -self.sin }
    }

    #[inline]
    fn exp(tangent: &Vector1<f64>) -> Self {
        Self::from_angle(tangent.x)
    }

    #[inline]
    fn log(&self) -> Vector1<f64> {
        Vector1::new(self.angle())
    }

    #[inline]
    fn adjoint(&self) -> Matrix1<f64> {
        Matrix1::new(1.0)
    }

    #[inline]
    fn right_jacobian_inverse(_tangent: &Vector1<f64>) -> Matrix1<f64> {
        Matrix1::new(1.0)
    }

    #[inline]
    fn act(&self, point: &Vector3<f64>) -> Vector3<f64> {
        let turned = self.rotate(&point.xy());
        Vector3::new(turned.x, turned.y, point.z)
    }

    #[inline]
    fn act_jacobian(&self, point: &Vector3<f64>) -> Vector3<f64> {
        self.act(&Vector3::new(-point.y, point.x, 0.0))
    }

    #[inline]
    fn is_finite(&self) -> bool {
        self.cos.is_finite() && self.sin.is_finite()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_half_angle_cotangent_is_that_of_the_tangent_at_all_angles() {
        let tiny = [0.0, -0.0, 5e-324, -1e-310, 1e-200, -1e-20, 1e-9];
        let all = (-3140..=3140).map(|k| f64::from(k) * 1e-3);
        for angle in all.chain(tiny) {
            let half = 0.5 * angle;
            let found = So2::from_angle(angle).half_angle_cotangent(half);
            let expected = if half == 0.0 { 1.0 } else { half / half.tan() };
            assert!((found - expected).abs() <= 1e-15, "{angle}: {found} {expected}");
        }
    }
}
