//! Symmetric matrices of files as their upper triangles, row by row.
//!
//! It checks nothing: whether a matrix is definite is the reader's question.

use nalgebra::SMatrix;

/// Entries of the upper triangle of a 3×3 matrix that a 2×2 matrix has.
pub(super) const PLANE: [usize; 3] = [0, 1, 3];

/// The symmetric matrix of an upper triangle, row by row.
pub(super) fn symmetric<const N: usize, const U: usize>(upper: &[f64; U]) -> SMatrix<f64, N, N> {
    let mut matrix = SMatrix::<f64, N, N>::zeros();
    let entries = (0..N).flat_map(|row| (row..N).map(move |column| (row, column)));
    for ((row, column), &entry) in entries.zip(upper) {
        matrix[(row, column)] = entry;
        matrix[(column, row)] = entry;
    }
    matrix
}

/// The upper triangle of a matrix, row by row.
pub(super) fn upper_triangle<const N: usize, const U: usize>(
    matrix: &SMatrix<f64, N, N>,
) -> [f64; U] {
    let mut upper = [0.0; U];
    let pairs = (0..N).flat_map(|row| (row..N).map(move |column| (row, column)));
    for (entry, at) in upper.iter_mut().zip(pairs) {
        *entry = matrix[at];
    }
    upper
}
