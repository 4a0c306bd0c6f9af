//! Elimination in dense symmetric matrices of 6 × 6 blocks that may be singular.
//!
//! Where H is positive semi-definite the cross terms lie in the range of the eliminated block, so
//! that its pseudo-inverse gives the exact Schur complement, also block after block. Matrices come
//! scaled to diagonals of at most about one: then one threshold tells rounding from information.

use nalgebra::{DMatrix, Matrix6};

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
    let eigen = block.symmetric_eigen();
    let mut inverse = Matrix6::zeros();
    for (direction, &value) in eigen.eigenvectors.column_iter().zip(eigen.eigenvalues.iter()) {
        if value > RANK_THRESHOLD {
            inverse += direction * direction.transpose() / value;
        }
    }
    inverse
}
