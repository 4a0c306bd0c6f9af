//! Checks around a factorization: of the matrix before it, and of each solution.
//!
//! A checked solve measures ‖(H + D) x − g‖ / ‖g‖ with the matrix itself, not with the factor, so
//! that a wrong kernel or a hopeless condition is seen; one step of iterative refinement
//! (x ← x + L⁻ᵀL⁻¹ r) follows where the residual is above 1e-10. A solution that stays inaccurate is
//! returned with its residual; the caller judges it.

use std::sync::Arc;

use super::error::LinearError;
use super::matrix::{BlockMatrix, check_added_diagonal};
use super::pattern::BlockPattern;

/// Relative residual above which a solution is refined once.
const REFINE_ABOVE: f64 = 1e-10;

/// Refuses a matrix that is not on the pattern planned for, a diagonal of another length, and NaN
/// and infinity, which the kernels would spread silently.
pub(super) fn check_system(
    planned: &Arc<BlockPattern>,
    matrix: &BlockMatrix,
    added_diagonal: &[f64],
) -> Result<(), LinearError> {
    let pattern = matrix.pattern();
    if !Arc::ptr_eq(planned, pattern) && **planned != **pattern {
        let (expected, found) = (planned.stored_block_count(), pattern.stored_block_count());
        return Err(LinearError::PatternMismatch { expected, found });
    }
    check_added_diagonal(pattern.dimension(), added_diagonal)?;
    // Chunks without an early exit inside, so that the scan is vectorized.
    let finite = |values: &[f64]| {
        values.chunks(256).all(|chunk| chunk.iter().fold(true, |ok, v| ok & v.is_finite()))
    };
    if !finite(matrix.values()) {
        for i in 0..pattern.block_count() {
            for block in pattern.row_range(i) {
                if !finite(&matrix.values()[pattern.value_range(block)]) {
                    return Err(LinearError::NonFinite { block: i });
                }
            }
        }
    }
    match added_diagonal.iter().position(|d| !d.is_finite()) {
        Some(scalar) => Err(LinearError::NonFinite { block: pattern.block_of(scalar) }),
        None => Ok(()),
    }
}

/// The checked solve over any `solve`; see [`super::Cholesky::solve_checked`].
pub(super) fn solve_checked(
    mut solve: impl FnMut(&mut [f64]),
    matrix: &BlockMatrix,
    added_diagonal: &[f64],
    rhs: &[f64],
    x: &mut [f64],
) -> f64 {
    if x.len() != rhs.len() || rhs.len() != matrix.pattern().dimension() {
        x.fill(f64::NAN);
        return f64::INFINITY;
    }
    x.copy_from_slice(rhs);
    solve(x);
    let mut residual = vec![0.0; rhs.len()];
    let before = relative_residual(matrix, added_diagonal, rhs, x, &mut residual);
    if before <= REFINE_ABOVE || !before.is_finite() {
        return before;
    }
    solve(&mut residual);
    let refined: Vec<f64> = x.iter().zip(&residual).map(|(x, dx)| x + dx).collect();
    let after = relative_residual(matrix, added_diagonal, rhs, &refined, &mut residual);
    if after < before {
        x.copy_from_slice(&refined);
    }
    after.min(before)
}

/// ‖g − (H + D) x‖ / ‖g‖, infinite rather than NaN; `r` receives the residual.
fn relative_residual(
    matrix: &BlockMatrix,
    added_diagonal: &[f64],
    g: &[f64],
    x: &[f64],
    r: &mut [f64],
) -> f64 {
    if matrix.residual(added_diagonal, x, g, r).is_err() {
        return f64::INFINITY;
    }
    let norm = |v: &[f64]| {
        let scale = v.iter().fold(0.0f64, |m, x| m.max(x.abs()));
        let scale = if scale > 0.0 { scale } else { 1.0 };
        scale * v.iter().map(|x| (x / scale).powi(2)).sum::<f64>().sqrt()
    };
    let (r, g) = (norm(r), norm(g));
    let relative = if g > 0.0 { r / g } else { r };
    if relative.is_nan() { f64::INFINITY } else { relative }
}
