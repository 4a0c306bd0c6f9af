//! The laws of a Lie group, asserted for any [`LieGroup`].
//!
//! Elements: identity, inverse, associativity, Exp(Log T) = T, T · Exp(δ) = Exp(Ad_T δ) · T, and
//! ⊞ against ⊟. Tangents: Log(Exp τ) = τ inside the injectivity radius, Exp(−τ) = Exp(τ)⁻¹,
//! J_r⁻¹ against central differences, and J_r⁻¹(−τ) Ad_Exp(τ) = J_r⁻¹(τ). Errors are measured on
//! logarithms and divided by the size of the numbers that met in the computation, so that
//! one tolerance serves millimeters and kilometers.

use nalgebra::{SMatrix, SVector};

use super::jacobian::{DEFAULT_STEP, assert_jacobian, central_difference};
use crate::geometry::LieGroup;

/// Absolute error left to Log ∘ Exp: elements hold numbers near 1 (a scale, a cosine), whose own
/// rounding this is.
const STORAGE_FLOOR: f64 = 2.0 * f64::EPSILON;

/// Asserts that two elements agree: |Log(b⁻¹ a)| ≤ `tolerance` × `scale`.
#[track_caller]
fn assert_same<G: LieGroup<N>, const N: usize>(
    law: &str,
    a: &G,
    b: &G,
    scale: f64,
    tolerance: f64,
) {
    let error = a.minus(b).amax() / scale;
    assert!(
        a.is_finite() && b.is_finite() && error <= tolerance,
        "{law}: relative error {error:e} over {tolerance:e}\nleft:  {a:?}\nright: {b:?}"
    );
}

/// Asserts that two matrices agree to `tolerance` × `scale`.
#[track_caller]
fn assert_matrices<const N: usize>(
    law: &str,
    a: &SMatrix<f64, N, N>,
    b: &SMatrix<f64, N, N>,
    scale: f64,
    tolerance: f64,
) {
    let error = (a - b).amax() / scale;
    assert!(error <= tolerance, "{law}: relative error {error:e}\nleft:{a}right:{b}");
}

/// The factor by which an element can enlarge an error: its adjoint's and its inverse's.
fn gain<G: LieGroup<N>, const N: usize>(element: &G) -> f64 {
    element.adjoint().amax().max(element.inverse().adjoint().amax()).max(1.0)
}

/// Asserts the laws that hold for any three elements.
///
/// # Panics
///
/// When a law fails by more than `tolerance` relative to the elements' gains (about 1e-13 suits).
#[track_caller]
pub fn assert_group_laws<G: LieGroup<N>, const N: usize>(a: &G, b: &G, c: &G, tolerance: f64) {
    let identity = G::identity();
    assert!(identity.log().amax() == 0.0, "Log(I) is not zero");
    assert!(G::exp(&SVector::zeros()) == identity, "Exp(0) is not the identity");
    let (gain_a, gain_b, gain_c) = (gain(a), gain(b), gain(c));

    assert_same("I a = a", &identity.compose(a), a, gain_a, tolerance);
    assert_same("a I = a", &a.compose(&identity), a, gain_a, tolerance);
    let scale = gain_a * gain_a;
    assert_same("a a⁻¹ = I", &a.compose(&a.inverse()), &identity, scale, tolerance);
    assert_same("a⁻¹ a = I", &a.inverse().compose(a), &identity, scale, tolerance);

    let scale = (gain_a * gain_b * gain_c).powi(2);
    let left = a.compose(b).compose(c);
    let right = a.compose(&b.compose(c));
    assert_same("(a b) c = a (b c)", &left, &right, scale, tolerance);

    assert_same("Exp(Log a) = a", &G::exp(&a.log()), a, gain_a * gain_a, tolerance);

    let scale = (gain_a * gain_b).powi(2);
    let difference = b.minus(a);
    assert_same("a ⊞ (b ⊟ a) = b", &a.plus(&difference), b, scale, tolerance);

    let tangent = c.log() / (1.0 + c.log().amax());
    let left = a.compose(&G::exp(&tangent));
    let right = G::exp(&(a.adjoint() * tangent)).compose(a);
    assert_same("a Exp(δ) = Exp(Ad_a δ) a", &left, &right, gain_a.powi(3), tolerance);
    let product = a.compose(b).adjoint();
    assert_matrices(
        "Ad_ab = Ad_a Ad_b",
        &product,
        &(a.adjoint() * b.adjoint()),
        gain_a * gain_b,
        tolerance,
    );
}

/// Asserts the laws of one tangent vector whose rotation is below π.
///
/// `tolerance` bounds the algebraic laws (about 1e-13), `numeric_tolerance` the comparison of
/// J_r⁻¹ with central differences (about 1e-10), both relative to the Jacobian's size.
///
/// # Panics
///
/// When a law fails.
#[track_caller]
pub fn assert_tangent_laws<G: LieGroup<N>, const N: usize>(
    tangent: &SVector<f64, N>,
    tolerance: f64,
    numeric_tolerance: f64,
) {
    let element = G::exp(tangent);
    let inverse = G::right_jacobian_inverse(tangent);

    let back = element.log();
    let error = (back - tangent).amax();
    assert!(
        error <= tolerance * tangent.amax() * inverse.amax().max(1.0) + STORAGE_FLOOR,
        "Log(Exp(τ)) = τ: error {error:e}\ntangent:{tangent}back:{back}"
    );
    let scale = gain(&element);
    assert_same("Exp(Log(Exp τ)) = Exp τ", &G::exp(&back), &element, scale, tolerance);
    assert_same("Exp(−τ) = Exp(τ)⁻¹", &G::exp(&-tangent), &element.inverse(), scale, tolerance);

    let negative = G::right_jacobian_inverse(&-tangent);
    assert_matrices(
        "J_r⁻¹(−τ) Ad = J_r⁻¹(τ)",
        &(negative * element.adjoint()),
        &inverse,
        gain(&element) * negative.amax().max(1.0) * inverse.amax().max(1.0),
        tolerance,
    );

    let inverse_element = element.inverse();
    let step = |delta: &SVector<f64, N>| inverse_element.compose(&G::exp(&(tangent + delta))).log();
    let jacobian = central_difference(step, DEFAULT_STEP);
    assert_matrices(
        "J_r⁻¹ times differences of Log(Exp(τ)⁻¹ Exp(τ + δ)) = I",
        &(inverse * jacobian),
        &SMatrix::identity(),
        N as f64 * jacobian.amax().max(1.0) * inverse.amax().max(1.0),
        numeric_tolerance,
    );
    // The logarithm jumps at π, where it has no derivative: skipped within a step of it.
    let stepped = |delta: &SVector<f64, N>| element.plus(delta).log() - tangent;
    let jumps = (0..N).any(|i| {
        let mut delta = SVector::<f64, N>::zeros();
        delta[i] = DEFAULT_STEP;
        let linear = inverse * delta;
        (stepped(&delta) - linear).amax() > 1.0 || (stepped(&-delta) + linear).amax() > 1.0
    });
    if !jumps {
        assert_jacobian(
            "J_r⁻¹ against differences of Log(Exp(τ) Exp(δ))",
            stepped,
            &inverse,
            numeric_tolerance,
        );
    }
}
