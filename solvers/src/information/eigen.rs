//! Eigenvalues of small symmetric matrices, as information matrices are.
//!
//! Knows nothing of information; allocates nothing.

use nalgebra::{SMatrix, SVector};

/// Sweeps of [`eigen`]; convergence is quadratic, and six are many.
const SWEEPS: usize = 16;

/// Eigenvalues, and eigenvectors by column, of a small symmetric matrix: Jacobi's cyclic rotations, which
/// find tiny eigenvalues of a scaled matrix to their own precision (Demmel and Veselić 1992) and end
/// on any input.
pub(crate) fn eigen<const N: usize>(
    matrix: &SMatrix<f64, N, N>,
) -> (SVector<f64, N>, SMatrix<f64, N, N>) {
    let (mut a, mut vectors) = (*matrix, SMatrix::<f64, N, N>::identity());
    for _ in 0..SWEEPS {
        let mut is_diagonal = true;
        for p in 0..N {
            for q in p + 1..N {
                let off = a[(p, q)];
                if off.abs() <= f64::EPSILON * (a[(p, p)] * a[(q, q)]).abs().sqrt() {
                    continue;
                }
                is_diagonal = false;
                let cotangent = (a[(q, q)] - a[(p, p)]) / (2.0 * off);
                let tangent = cotangent.signum() / (cotangent.abs() + cotangent.hypot(1.0));
                let cosine = 1.0 / tangent.hypot(1.0);
                let sine = tangent * cosine;
                turn(&mut a, p, q, cosine, sine);
                a = a.transpose();
                turn(&mut a, p, q, cosine, sine);
                turn(&mut vectors, p, q, cosine, sine);
            }
        }
        if is_diagonal {
            break;
        }
    }
    (a.diagonal(), vectors)
}

/// Rotates columns p and q.
fn turn<const N: usize>(
    matrix: &mut SMatrix<f64, N, N>,
    p: usize,
    q: usize,
    cosine: f64,
    sine: f64,
) {
    for k in 0..N {
        let (x, y) = (matrix[(k, p)], matrix[(k, q)]);
        matrix[(k, p)] = cosine * x - sine * y;
        matrix[(k, q)] = sine * x + cosine * y;
    }
}
