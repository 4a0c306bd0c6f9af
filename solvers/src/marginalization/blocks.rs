//! Elimination in dense symmetric matrices of 6 × 6 blocks that may be singular.
//!
//! Where H is positive semi-definite the cross terms lie in the range of the eliminated block, so
//! that its pseudo-inverse gives the exact Schur complement, also block after block. Matrices come
//! scaled to diagonals of at most about one: then one threshold separates rounding from
//! information. It knows neither poses nor factors.

use nalgebra::{DMatrix, Matrix6};

use crate::information::eigen;

/// The side of a block.
pub(super) const BLOCK: usize = 6;

/// Eigenvalues of a scaled block below this are zero with their rounding.
const RANK_THRESHOLD: f64 = 1e-11;

/// Block (`row`, `column`).
pub(super) fn block(matrix: &DMatrix<f64>, row: usize, column: usize) -> Matrix6<f64> {
    matrix.fixed_view::<BLOCK, BLOCK>(BLOCK * row, BLOCK * column).into_owned()
}

/// (H + Hᵀ) / 2.
pub(super) fn symmetrize(matrix: &mut DMatrix<f64>) {
    for column in 0..matrix.ncols() {
        for row in 0..column {
            let mean = 0.5 * (matrix[(row, column)] + matrix[(column, row)]);
            matrix[(row, column)] = mean;
            matrix[(column, row)] = mean;
        }
    }
}

/// The information of the blocks `kept`, in their order, when all others are eliminated.
pub(super) fn marginal(matrix: &DMatrix<f64>, kept: &[usize]) -> DMatrix<f64> {
    let count = matrix.nrows() / BLOCK;
    let others = (0..count).filter(|block| !kept.contains(block));
    let order: Vec<usize> = kept.iter().copied().chain(others).collect();
    let from = |k: usize| BLOCK * order[k / BLOCK] + k % BLOCK;
    let mut left =
        DMatrix::from_fn(BLOCK * count, BLOCK * count, |r, c| matrix[(from(r), from(c))]);
    for last in (kept.len()..count).rev() {
        let side = BLOCK * last;
        let cross = left.view((0, side), (side, BLOCK)).into_owned();
        let gain = &cross * pseudo_inverse(&block(&left, last, last));
        left.view_mut((0, 0), (side, side)).gemm(-1.0, &gain, &cross.transpose(), 1.0);
    }
    let side = BLOCK * kept.len();
    let mut left = left.resize(side, side, 0.0);
    symmetrize(&mut left);
    left
}

/// The inverse over the directions that have information.
fn pseudo_inverse(block: &Matrix6<f64>) -> Matrix6<f64> {
    spectral(block, |value| if value > RANK_THRESHOLD { 1.0 / value } else { 0.0 }).1
}

/// The largest eigenvalue of a symmetric block, and V f(Λ) Vᵀ.
pub(super) fn spectral(block: &Matrix6<f64>, f: impl Fn(f64) -> f64) -> (f64, Matrix6<f64>) {
    let (values, vectors) = eigen(block);
    let mapped = vectors * Matrix6::from_diagonal(&values.map(f)) * vectors.transpose();
    (values.max(), (mapped + mapped.transpose()) * 0.5)
}

#[cfg(test)]
mod tests {
    use nalgebra::{Matrix6, Vector6};

    use super::{eigen, spectral};

    #[test]
    fn eigenvectors_diagonalize_what_has_a_rank_too_low() {
        let direction = |k: usize| Vector6::from_fn(|r, _| ((r * r * (k + 1) + k) as f64).sin());
        let mut matrix = Matrix6::zeros();
        for rank in 0..=6 {
            let (values, vectors) = eigen(&matrix);
            assert!((vectors.transpose() * vectors - Matrix6::identity()).amax() < 1e-14);
            let again = vectors * Matrix6::from_diagonal(&values) * vectors.transpose();
            assert!((again - matrix).amax() < 1e-13);
            let found = values.iter().filter(|v| v.abs() > 1e-9).count();
            assert_eq!(found, rank, "{values}");
            matrix += direction(rank) * direction(rank).transpose();
        }
        // A block of zeros beside one that is not; nothing finite in it.
        matrix.fixed_view_mut::<3, 6>(0, 0).fill(0.0);
        matrix.fixed_view_mut::<6, 3>(0, 0).fill(0.0);
        assert!((spectral(&matrix, |value| value).1 - matrix).amax() < 1e-13);
        assert!(eigen(&Matrix6::repeat(f64::NAN)).0.iter().all(|x| x.is_nan()));
    }
}
