//! W = ∫₀¹ exp(u (σI + φ^)) du, which carries a Sim(3) tangent's translation into the group.
//!
//! W = c I + a φ^ + b φ^², with c = (e^σ − 1)/σ, and a, b from w = (e^z − 1)/z, z = σ + iθ:
//! Im w = aθ and Re w = c − bθ². Below |z| = 1 all three come from the power series Σ zⁿ/(n+1)!,
//! split by a recurrence that never divides by θ. Above it a is a closed form, and b follows from
//! (σI + φ^) W = e^σ R − I, read off where it divides by the larger of σ and θ. It serves `sim3` alone.

use nalgebra::{Matrix3, Vector3};

use super::coefficients::RotationCoefficients;
use super::coefficients::hat;

/// |z|² below which the power series is used.
const SERIES_LIMIT: f64 = 1.0;
/// Terms of the power series; the first one left out is below 1/21! ≈ 2e-20.
const TERMS: usize = 20;

/// The coefficients of W, or of its inverse, in I, φ^ and φ^².
#[derive(Clone, Copy, Debug)]
pub(super) struct ScaleIntegral {
    c: f64,
    a: f64,
    b: f64,
    squared_angle: f64,
}

impl ScaleIntegral {
    /// W at rotation angle² `x` and log scale `sigma`.
    pub(super) fn new(x: f64, sigma: f64) -> Self {
        let squared_modulus = x + sigma * sigma;
        if squared_modulus < SERIES_LIMIT {
            return Self::series(x, sigma);
        }
        let k = RotationCoefficients::new(x);
        let growth = sigma.exp_m1();
        let scale = sigma.exp();
        let c = if sigma == 0.0 { 1.0 } else { growth / sigma };
        let real = growth * (1.0 - x * k.b) - x * k.b;
        let a = (sigma * scale * k.a - real) / squared_modulus;
        let b = if sigma * sigma > x {
            (scale * k.b - a) / sigma
        } else {
            (sigma * a + c - scale * k.a) / x
        };
        Self { c, a, b, squared_angle: x }
    }

    /// zⁿ = rₙ + iθ mₙ and σⁿ − rₙ = θ² dₙ obey a recurrence in σ and θ² alone.
    fn series(x: f64, sigma: f64) -> Self {
        let (mut power, mut r, mut m, mut d) = (1.0, 1.0, 0.0, 0.0);
        let (mut c, mut a, mut b) = (0.0, 0.0, 0.0);
        let mut weight = 1.0;
        let mut n = 2.0;
        for _ in 0..TERMS {
            c += weight * power;
            a += weight * m;
            b += weight * d;
            (d, m, r) = (sigma * d + m, sigma * m + r, sigma * r - x * m);
            power *= sigma;
            weight /= n;
            n += 1.0;
        }
        Self { c, a, b, squared_angle: x }
    }

    /// W⁻¹ in the same basis; singular only at σ = 0, θ = 2πk, k ≠ 0.
    pub(super) fn inverse(&self) -> Self {
        let Self { c, a, b, squared_angle: x } = *self;
        let real = c - b * x;
        let squared_modulus = real * real + a * a * x;
        Self {
            c: 1.0 / c,
            a: -a / squared_modulus,
            b: (a * a + b * b * x - b * c) / (c * squared_modulus),
            squared_angle: x,
        }
    }

    /// The matrix c I + a φ^ + b φ^².
    pub(super) fn matrix(&self, phi: &Vector3<f64>) -> Matrix3<f64> {
        Matrix3::identity() * (self.c - self.b * self.squared_angle)
            + hat(phi) * self.a
            + (phi * self.b) * phi.transpose()
    }

    /// The matrix times `v`.
    pub(super) fn times(&self, phi: &Vector3<f64>, v: &Vector3<f64>) -> Vector3<f64> {
        let cross = phi.cross(v);
        v * self.c + cross * self.a + phi.cross(&cross) * self.b
    }
}
