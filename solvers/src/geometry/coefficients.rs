//! Scalar functions of the squared angle that exponentials and Jacobians of rotations share.
//!
//! With x = θ²: A = sin θ / θ, B = (1 − cos θ)/θ², C = (θ − sin θ)/θ³,
//! D = (1 − (θ/2) cot(θ/2))/θ², E = (θ²/2 + cos θ − 1)/θ⁴, F = (2θ − 3 sin θ + θ cos θ)/(2θ⁵).
//! Below θ² = 2 the cancelling functions C, E, F come from their Taylor series (ten terms leave a
//! remainder under 1e-19) and the rest follow from A = 1 − xC, B = ½ − xE, D = (C − 2E)/(2B),
//! none of which cancels. Above it the closed forms lose at most a few units in the last place.
//! B, and so D's denominator, vanishes at θ = 2π: tangents stay inside that ball.

use nalgebra::{Matrix3, Vector3};

/// θ² below which the Taylor series are used.
const SERIES_LIMIT: f64 = 2.0;
/// Number of Taylor terms; the first one left out is below 2¹⁰/23! ≈ 4e-20.
const TERMS: usize = 10;

/// Coefficients (−1)^k / (2k + 3)! of C.
const C_SERIES: [f64; TERMS] = alternating_inverse_factorials(3);
/// Coefficients (−1)^k / (2k + 4)! of E.
const E_SERIES: [f64; TERMS] = alternating_inverse_factorials(4);
/// Coefficients (−1)^k (k + 1) / (2k + 5)! of F.
const F_SERIES: [f64; TERMS] = {
    let mut series = alternating_inverse_factorials(5);
    let mut factor = 1.0;
    let mut k = 0;
    while k < TERMS {
        series[k] *= factor;
        factor += 1.0;
        k += 1;
    }
    series
};

/// The numbers (−1)^k / (2k + first)!.
const fn alternating_inverse_factorials(first: usize) -> [f64; TERMS] {
    let mut series = [0.0; TERMS];
    let mut factorial = 1.0;
    let mut n = 1.0;
    let mut i = 0;
    while i < first {
        factorial *= n;
        n += 1.0;
        i += 1;
    }
    let mut sign = 1.0;
    let mut k = 0;
    while k < TERMS {
        series[k] = sign / factorial;
        factorial *= n * (n + 1.0);
        n += 2.0;
        sign = -sign;
        k += 1;
    }
    series
}

/// Horner evaluation of a power series in `x`.
#[inline]
fn horner(series: &[f64; TERMS], x: f64) -> f64 {
    series.iter().rev().fold(0.0, |sum, coefficient| sum * x + coefficient)
}

/// The skew-symmetric matrix v^ with v^ w = v × w.
#[inline]
pub fn hat(v: &Vector3<f64>) -> Matrix3<f64> {
    Matrix3::new(0.0, -v.z, v.y, v.z, 0.0, -v.x, -v.y, v.x, 0.0)
}

/// The functions A to F at one angle; see the head of the file.
#[derive(Clone, Copy, Debug)]
pub(super) struct RotationCoefficients {
    pub(super) squared_angle: f64,
    pub(super) a: f64,
    pub(super) b: f64,
    pub(super) c: f64,
    pub(super) d: f64,
    pub(super) e: f64,
}

impl RotationCoefficients {
    /// Evaluates A to E at θ² = `x`.
    #[inline]
    pub(super) fn new(x: f64) -> Self {
        let (a, b, c, e) = if x < SERIES_LIMIT {
            let c = horner(&C_SERIES, x);
            let e = horner(&E_SERIES, x);
            (1.0 - x * c, 0.5 - x * e, c, e)
        } else {
            let theta = x.sqrt();
            let half_sin = (0.5 * theta).sin();
            let a = theta.sin() / theta;
            let b = 2.0 * half_sin * half_sin / x;
            (a, b, (1.0 - a) / x, (0.5 - b) / x)
        };
        Self { squared_angle: x, a, b, c, d: 0.5 * (c - 2.0 * e) / b, e }
    }

    /// F, which only the coupling block of the SE(3) Jacobian needs.
    #[inline]
    pub(super) fn f(&self) -> f64 {
        let x = self.squared_angle;
        if x < SERIES_LIMIT {
            horner(&F_SERIES, x)
        } else {
            let cos = 1.0 - x * self.b;
            (2.0 - 3.0 * self.a + cos) / (2.0 * x * x)
        }
    }

    /// (θ/2) cot(θ/2) = 1 − θ² D; by the tangent at large angles, where that cancels.
    #[inline]
    pub(super) fn half_angle_cotangent(&self) -> f64 {
        let x = self.squared_angle;
        if x < SERIES_LIMIT {
            1.0 - x * self.d
        } else {
            let half = 0.5 * x.sqrt();
            half / half.tan()
        }
    }

    /// J_r(φ) = I − B φ^ + C φ^².
    #[inline]
    pub(super) fn right_jacobian(&self, phi: &Vector3<f64>) -> Matrix3<f64> {
        self.quadratic(phi, -self.b, self.c)
    }

    /// J_r⁻¹(φ) = I + ½ φ^ + D φ^².
    #[inline]
    pub(super) fn right_jacobian_inverse(&self, phi: &Vector3<f64>) -> Matrix3<f64> {
        self.quadratic(phi, 0.5, self.d)
    }

    /// J_l(φ) v, the translation of an SE(3) exponential.
    #[inline]
    pub(super) fn left_jacobian_times(&self, phi: &Vector3<f64>, v: &Vector3<f64>) -> Vector3<f64> {
        let cross = phi.cross(v);
        v + cross * self.b + phi.cross(&cross) * self.c
    }

    /// J_l⁻¹(φ) v, the translation part of an SE(3) logarithm.
    #[inline]
    pub(super) fn left_jacobian_inverse_times(
        &self,
        phi: &Vector3<f64>,
        v: &Vector3<f64>,
    ) -> Vector3<f64> {
        let cross = phi.cross(v);
        v - cross * 0.5 + phi.cross(&cross) * self.d
    }

    /// I + `linear` φ^ + `square` φ^², with φ^² = φφᵀ − θ²I.
    #[inline]
    fn quadratic(&self, phi: &Vector3<f64>, linear: f64, square: f64) -> Matrix3<f64> {
        let mut matrix = hat(phi) * linear + (phi * square) * phi.transpose();
        let diagonal = 1.0 - square * self.squared_angle;
        matrix[(0, 0)] += diagonal;
        matrix[(1, 1)] += diagonal;
        matrix[(2, 2)] += diagonal;
        matrix
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Series and closed forms meet at the threshold, so neither is off.
    #[test]
    fn branches_agree_at_the_threshold() {
        let below = RotationCoefficients::new(SERIES_LIMIT * (1.0 - 1e-15));
        let above = RotationCoefficients::new(SERIES_LIMIT * (1.0 + 1e-15));
        for (s, c) in [
            (below.a, above.a),
            (below.b, above.b),
            (below.c, above.c),
            (below.d, above.d),
            (below.e, above.e),
            (below.f(), above.f()),
            (below.half_angle_cotangent(), above.half_angle_cotangent()),
        ] {
            assert!((s - c).abs() <= 1e-13 * c.abs(), "series {s:e}, closed form {c:e}");
        }
    }

    #[test]
    fn values_at_zero_and_pi() {
        let zero = RotationCoefficients::new(0.0);
        assert_eq!((zero.a, zero.b, zero.c), (1.0, 0.5, 1.0 / 6.0));
        assert!((zero.d - 1.0 / 12.0).abs() < 1e-17);
        assert_eq!((zero.e, zero.f()), (1.0 / 24.0, 1.0 / 120.0));
        let pi = std::f64::consts::PI;
        let at_pi = RotationCoefficients::new(pi * pi);
        assert!(at_pi.a.abs() < 1e-15);
        assert!((at_pi.b - 2.0 / (pi * pi)).abs() < 1e-16);
        assert!((at_pi.d - 1.0 / (pi * pi)).abs() < 1e-16);
    }
}
