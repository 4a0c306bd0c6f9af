//! The algebra that every pose type obeys.
//!
//! A group element acts on the right: `T ⊞ δ = T · Exp(δ)` and `a ⊟ b = Log(b⁻¹ · a)`, so that
//! `b ⊞ (a ⊟ b) = a`. Jacobians follow Solà, Deray and Atchuthan, "A micro Lie theory for state
//! estimation in robotics" (2018), with the tangent ordered translation, rotation, log scale. The trait
//! knows no noise and no factors.

use std::fmt::Debug;

use nalgebra::{SMatrix, SVector, Vector3};

/// A Lie group whose tangent space has `N` dimensions.
pub trait LieGroup<const N: usize>: Copy + Debug + PartialEq + Send + Sync + 'static {
    /// The neutral element.
    fn identity() -> Self;

    /// The product `self · other`: for transforms `c_from_a = c_from_b.compose(&b_from_a)`.
    fn compose(&self, other: &Self) -> Self;

    /// The inverse: `source_from_target` of a `target_from_source`.
    fn inverse(&self) -> Self;

    /// The exponential map of a tangent vector at the identity.
    fn exp(tangent: &SVector<f64, N>) -> Self;

    /// The full logarithm: the tangent vector of least rotation whose exponential is `self`.
    fn log(&self) -> SVector<f64, N>;

    /// The adjoint matrix: `T · Exp(δ) = Exp(Ad_T δ) · T`.
    fn adjoint(&self) -> SMatrix<f64, N, N>;

    /// The inverse of the right Jacobian: `Log(Exp(τ) · Exp(δ)) ≈ τ + J_r⁻¹(τ) δ`.
    fn right_jacobian_inverse(tangent: &SVector<f64, N>) -> SMatrix<f64, N, N>;

    /// Where `self` takes a point of space, in meters. A motion of the plane is one about the z axis,
    /// which leaves z as it is.
    fn act(&self, point: &Vector3<f64>) -> Vector3<f64>;

    /// ∂(self · Exp(δ) · point)/∂δ at δ = 0.
    fn act_jacobian(&self, point: &Vector3<f64>) -> SMatrix<f64, 3, N>;

    /// Whether every stored number is finite.
    fn is_finite(&self) -> bool;

    /// `self ⊞ tangent = self · Exp(tangent)`.
    fn plus(&self, tangent: &SVector<f64, N>) -> Self {
        self.compose(&Self::exp(tangent))
    }

    /// `self ⊟ other = Log(other⁻¹ · self)`.
    fn minus(&self, other: &Self) -> SVector<f64, N> {
        other.inverse().compose(self).log()
    }
}
