//! Analytic Jacobians against central differences.
//!
//! The closure maps a perturbation δ at zero to the function's value, r(x ⊞ δ), so the same
//! checker serves vectors and groups. The estimate extrapolates two central differences,
//! (4 D(h/2) − D(h))/3, whose error is O(h⁴ f⁽⁵⁾ + ε|f|/h): about 1e-12 of the function at the
//! default step. Differences must be of a vector space: return logarithms, never group elements.

use nalgebra::{SMatrix, SVector};
use thiserror::Error;

/// Step for functions whose variables are of order one.
pub const DEFAULT_STEP: f64 = 1e-3;

/// An analytic Jacobian that differs from the numeric one, with both matrices.
#[derive(Clone, Debug, Error)]
#[error(
    "{label}: Jacobians differ by {error:e} at ({row}, {column}), more than {tolerance:e}\n\
     analytic:{analytic}numeric:{numeric}"
)]
pub struct JacobianMismatch<const M: usize, const N: usize> {
    /// What was checked.
    pub label: String,
    /// The largest absolute difference over the scale, as [`check_jacobian`] defines it.
    pub error: f64,
    /// What the error was held against.
    pub tolerance: f64,
    /// Row of the largest difference.
    pub row: usize,
    /// Column of the largest difference.
    pub column: usize,
    /// The Jacobian under test.
    pub analytic: SMatrix<f64, M, N>,
    /// Its estimate from central differences.
    pub numeric: SMatrix<f64, M, N>,
}

/// The Jacobian at zero of `function`, M values of N variables, from differences of step `step`.
pub fn central_difference<const M: usize, const N: usize>(
    function: impl Fn(&SVector<f64, N>) -> SVector<f64, M>,
    step: f64,
) -> SMatrix<f64, M, N> {
    let mut jacobian = SMatrix::<f64, M, N>::zeros();
    for column in 0..N {
        let difference = |h: f64| {
            let mut delta = SVector::<f64, N>::zeros();
            delta[column] = h;
            let forward = function(&delta);
            delta[column] = -h;
            (forward - function(&delta)) / (2.0 * h)
        };
        let estimate = (difference(0.5 * step) * 4.0 - difference(step)) / 3.0;
        jacobian.set_column(column, &estimate);
    }
    jacobian
}

/// Compares `analytic` with the central differences of `function` at zero.
///
/// Returns the largest absolute difference divided by 1 + max |numeric|.
///
/// # Errors
///
/// [`JacobianMismatch`] when that number exceeds `tolerance` or is not a number.
pub fn check_jacobian<const M: usize, const N: usize>(
    label: &str,
    function: impl Fn(&SVector<f64, N>) -> SVector<f64, M>,
    analytic: &SMatrix<f64, M, N>,
    step: f64,
    tolerance: f64,
) -> Result<f64, Box<JacobianMismatch<M, N>>> {
    let numeric = central_difference(function, step);
    let scale = 1.0 + numeric.iter().fold(0.0_f64, |largest, v| largest.max(v.abs()));
    let (mut error, mut row, mut column) = (0.0_f64, 0, 0);
    for i in 0..M {
        for j in 0..N {
            let difference = (analytic[(i, j)] - numeric[(i, j)]).abs() / scale;
            // A NaN compares false with everything and must win.
            if difference.is_nan() || difference > error {
                (error, row, column) = (difference, i, j);
            }
        }
    }
    if error <= tolerance {
        return Ok(error);
    }
    Err(Box::new(JacobianMismatch {
        label: label.to_owned(),
        error,
        tolerance,
        row,
        column,
        analytic: *analytic,
        numeric,
    }))
}

/// [`check_jacobian`] with the default step; returns the error.
///
/// # Panics
///
/// When the matrices differ by more than `tolerance`; the message shows both.
#[track_caller]
pub fn assert_jacobian<const M: usize, const N: usize>(
    label: &str,
    function: impl Fn(&SVector<f64, N>) -> SVector<f64, M>,
    analytic: &SMatrix<f64, M, N>,
    tolerance: f64,
) -> f64 {
    match check_jacobian(label, function, analytic, DEFAULT_STEP, tolerance) {
        Ok(error) => error,
        Err(mismatch) => panic!("{mismatch}"),
    }
}
