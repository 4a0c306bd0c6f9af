//! The rigid motion that brings one set of points onto another (Umeyama 1991, without scale).
//!
//! T minimizes Σ ‖y − T x‖²: with C = 1/n Σ (y − ȳ)(x − x̄)ᵀ = U D Vᵀ it is
//! R = U diag(1, 1, ±1) Vᵀ, t = ȳ − R x̄, the sign that of det U · det V.

use covis_solvers::geometry::{Se3, So3};
use nalgebra::{Matrix3, SVD, Vector3};

use super::EvaluationError;

/// The motion `truth_from_estimate` that aligns `estimate` to `truth`, point k to point k.
///
/// # Errors
/// [`EvaluationError::Degenerate`] where fewer than two singular values of C exceed the machine
/// epsilon (evo's bound): the points lie on a line, or are fewer than three.
pub fn align(truth: &[Vector3<f64>], estimate: &[Vector3<f64>]) -> Result<Se3, EvaluationError> {
    let pairs = truth.len().min(estimate.len());
    let mean =
        |points: &[Vector3<f64>]| points.iter().take(pairs).sum::<Vector3<f64>>() / pairs as f64;
    let (truth_mean, estimate_mean) = (mean(truth), mean(estimate));
    let centered = truth.iter().zip(estimate).map(|(y, x)| (y - truth_mean, x - estimate_mean));
    let covariance = centered.map(|(y, x)| y * x.transpose()).sum::<Matrix3<f64>>() / pairs as f64;
    let degenerate = |rank| EvaluationError::Degenerate { pairs, rank };
    let svd = SVD::new(covariance, true, true);
    let rank = svd.singular_values.iter().filter(|&&s| s > f64::EPSILON).count();
    let (Some(u), Some(v_transposed)) = (svd.u, svd.v_t) else {
        return Err(degenerate(rank));
    };
    if rank < 2 {
        return Err(degenerate(rank));
    }
    let mut signs = Vector3::new(1.0, 1.0, 1.0);
    if u.determinant() * v_transposed.determinant() < 0.0 {
        // Singular values come in falling order: the last direction is the one that is flipped.
        signs.z = -1.0;
    }
    let rotation = So3::from_matrix(&(u * Matrix3::from_diagonal(&signs) * v_transposed));
    Ok(Se3::new(rotation, truth_mean - rotation.rotate(&estimate_mean)))
}
