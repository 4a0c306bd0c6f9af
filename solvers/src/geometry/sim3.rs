//! Similarities of space, x ↦ s R x + t with s > 0.
//!
//! The tangent is (ρ, φ, σ), with s = e^σ and t = W(φ, σ) ρ (see `scale_integral`). The left
//! Jacobian is [W Q p; 0 J 0; 0 0 1]; its coupling (Q, p) is summed as a power series at a tangent
//! halved until it is short, then doubled by J(2τ) = ½ (I + Ad_Exp(τ)) J(τ), exact at any size.
//! J_r(τ) = J_l(−τ), and the inverse is taken block by block in closed form. That the scale is positive
//! is not checked here.

use nalgebra::{Matrix3, SMatrix, SVector, Vector3};

use super::coefficients::RotationCoefficients;
use super::coefficients::hat;
use super::scale_integral::ScaleIntegral;
use super::{LieGroup, Se3, So3};

/// |σ| + θ to which a tangent is halved before the coupling's power series is summed.
const SERIES_LENGTH: f64 = 0.5;
/// Terms of that series; the first one left out is below n 0.5ⁿ/(n+1)! ≈ 1e-17 of the sum.
const TERMS: usize = 13;
/// Bound on the halvings, for tangents that are not finite.
const MAX_HALVINGS: u32 = 64;

/// A similarity of space, `target_from_source`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Sim3 {
    /// Rotation of the target from the source frame.
    pub rotation: So3,
    /// Origin of the source frame, in target coordinates.
    pub translation: Vector3<f64>,
    /// Length in the target of a unit length in the source; positive.
    pub scale: f64,
}

impl Sim3 {
    /// The similarity x ↦ s R x + t; `scale` must be positive for a logarithm to exist.
    #[inline]
    pub fn new(rotation: So3, translation: Vector3<f64>, scale: f64) -> Self {
        Self { rotation, translation, scale }
    }

    /// Its rotation and translation: the pose of the source's axes, of unit length, in the target.
    #[inline]
    pub fn rigid(&self) -> Se3 {
        Se3::new(self.rotation, self.translation)
    }

    /// s R p + t.
    #[inline]
    pub fn transform(&self, point: &Vector3<f64>) -> Vector3<f64> {
        self.rotation.rotate(point) * self.scale + self.translation
    }

    /// A pose in the source as it is in the target: its origin is moved, its axes are turned and keep
    /// their unit length.
    #[inline]
    pub fn transform_pose(&self, pose: &Se3) -> Se3 {
        Se3::new(self.rotation.compose(&pose.rotation), self.transform(&pose.translation))
    }
}

impl From<Se3> for Sim3 {
    /// At the same scale.
    #[inline]
    fn from(motion: Se3) -> Self {
        Self::new(motion.rotation, motion.translation, 1.0)
    }
}

/// Splits a tangent into translation, rotation and log scale.
fn split(tangent: &SVector<f64, 7>) -> (Vector3<f64>, Vector3<f64>, f64) {
    (tangent.fixed_rows::<3>(0).into_owned(), tangent.fixed_rows::<3>(3).into_owned(), tangent[6])
}

/// The 7 × 7 matrix [`w` `q` `p`; 0 `j` 0; 0 0 1].
fn assemble(
    w: &Matrix3<f64>,
    q: &Matrix3<f64>,
    p: &Vector3<f64>,
    j: &Matrix3<f64>,
) -> SMatrix<f64, 7, 7> {
    let mut matrix = SMatrix::<f64, 7, 7>::zeros();
    matrix.fixed_view_mut::<3, 3>(0, 0).copy_from(w);
    matrix.fixed_view_mut::<3, 3>(0, 3).copy_from(q);
    matrix.fixed_view_mut::<3, 1>(0, 6).copy_from(p);
    matrix.fixed_view_mut::<3, 3>(3, 3).copy_from(j);
    matrix[(6, 6)] = 1.0;
    matrix
}

/// The blocks Q and p of the left Jacobian at (ρ, φ, σ).
fn left_coupling(
    rho: &Vector3<f64>,
    phi: &Vector3<f64>,
    sigma: f64,
) -> (Matrix3<f64>, Vector3<f64>) {
    let mut halvings = 0;
    let mut factor = 1.0;
    while (sigma.abs() + phi.norm()) * factor > SERIES_LENGTH && halvings < MAX_HALVINGS {
        factor *= 0.5;
        halvings += 1;
    }
    let (mut q, mut p) = coupling_series(&(rho * factor), &(phi * factor), sigma * factor);
    for _ in 0..halvings {
        let (rho, phi, sigma) = (rho * factor, phi * factor, sigma * factor);
        let k = RotationCoefficients::new(phi.norm_squared());
        let rotation = So3::exp(&phi).matrix();
        let translation = ScaleIntegral::new(k.squared_angle, sigma).times(&phi, &rho);
        // J_l(φ) is the transpose of J_r(φ).
        let j = k.right_jacobian(&phi).transpose();
        let half_sum = (Matrix3::identity() + rotation * sigma.exp()) * 0.5;
        q = half_sum * q + hat(&(translation * 0.5)) * rotation * j;
        p = half_sum * p - translation * 0.5;
        factor *= 2.0;
    }
    (q, p)
}

/// Σ adⁿ/(n+1)!, its blocks (Q, p): Sₙ₊₁ = M Sₙ + ρ^ (φ^)ⁿ and pₙ₊₁ = M pₙ, with M = σI + φ^.
fn coupling_series(
    rho: &Vector3<f64>,
    phi: &Vector3<f64>,
    sigma: f64,
) -> (Matrix3<f64>, Vector3<f64>) {
    let phi_hat = hat(phi);
    let m = Matrix3::identity() * sigma + phi_hat;
    let mut tail = hat(rho);
    let (mut term_q, mut term_p) = (tail, -rho);
    let mut weight = 0.5;
    let (mut q, mut p) = (term_q * weight, term_p * weight);
    let mut n = 3.0;
    for _ in 1..TERMS {
        tail *= phi_hat;
        term_q = m * term_q + tail;
        term_p = m * term_p;
        weight /= n;
        n += 1.0;
        q += term_q * weight;
        p += term_p * weight;
    }
    (q, p)
}

impl LieGroup<7> for Sim3 {
    #[inline]
    fn identity() -> Self {
        Self::new(So3::identity(), Vector3::zeros(), 1.0)
    }

    #[inline]
    fn compose(&self, other: &Self) -> Self {
        Self::new(
            self.rotation.compose(&other.rotation),
            self.transform(&other.translation),
            self.scale * other.scale,
        )
    }

    #[inline]
    fn inverse(&self) -> Self {
        Self::new(
            self.rotation.inverse(),
            -self.rotation.inverse_rotate(&self.translation) / self.scale,
            1.0 / self.scale,
        )
    }

    fn exp(tangent: &SVector<f64, 7>) -> Self {
        let (rho, phi, sigma) = split(tangent);
        let w = ScaleIntegral::new(phi.norm_squared(), sigma);
        Self::new(So3::exp(&phi), w.times(&phi, &rho), sigma.exp())
    }

    fn log(&self) -> SVector<f64, 7> {
        let phi = self.rotation.log();
        let sigma = self.scale.ln();
        let w = ScaleIntegral::new(phi.norm_squared(), sigma);
        let rho = w.inverse().times(&phi, &self.translation);
        SVector::from([rho.x, rho.y, rho.z, phi.x, phi.y, phi.z, sigma])
    }

    fn adjoint(&self) -> SMatrix<f64, 7, 7> {
        let rotation = self.rotation.matrix();
        assemble(
            &(rotation * self.scale),
            &(hat(&self.translation) * rotation),
            &-self.translation,
            &rotation,
        )
    }

    fn right_jacobian_inverse(tangent: &SVector<f64, 7>) -> SMatrix<f64, 7, 7> {
        let (rho, phi, sigma) = split(&-tangent);
        let x = phi.norm_squared();
        let (q, p) = left_coupling(&rho, &phi, sigma);
        let j_inverse = RotationCoefficients::new(x).right_jacobian_inverse(&phi).transpose();
        let w_inverse = ScaleIntegral::new(x, sigma).inverse().matrix(&phi);
        assemble(&w_inverse, &-(w_inverse * q * j_inverse), &-(w_inverse * p), &j_inverse)
    }

    #[inline]
    fn act(&self, point: &Vector3<f64>) -> Vector3<f64> {
        self.transform(point)
    }

    #[inline]
    fn act_jacobian(&self, point: &Vector3<f64>) -> SMatrix<f64, 3, 7> {
        let scaled = self.rotation.matrix() * self.scale;
        let mut jacobian = SMatrix::<f64, 3, 7>::zeros();
        jacobian.fixed_columns_mut::<3>(0).copy_from(&scaled);
        jacobian.fixed_columns_mut::<3>(3).copy_from(&(-scaled * hat(point)));
        jacobian.set_column(6, &(scaled * point));
        jacobian
    }

    #[inline]
    fn is_finite(&self) -> bool {
        self.rotation.is_finite()
            && self.translation.iter().all(|v| v.is_finite())
            && self.scale.is_finite()
    }
}
