//! Linear systems of pose graphs in plain form, for tests and benches of factorizations.

use std::sync::Arc;

use crate::geometry::LieGroup;
use crate::linear::{BlockMatrix, BlockPattern};
use crate::problem::PoseGraph;

/// Hessian and gradient of ½ Σ rᵀΩr over the edges at the poses, without the first pose: a block a pose.
#[must_use]
pub fn normal_equations<G: LieGroup<N>, const N: usize>(
    graph: &PoseGraph<G, N>,
) -> (BlockMatrix, Vec<f64>) {
    let row = |pose: usize| pose.checked_sub(1);
    let pairs = graph.edges.iter().filter_map(|edge| row(edge.i).zip(row(edge.j)));
    let blocks = graph.poses.len().saturating_sub(1);
    let pattern = Arc::new(BlockPattern::new(vec![N; blocks], pairs));
    let mut gradient = vec![0.0; pattern.dimension()];
    let mut matrix = BlockMatrix::new(pattern);
    for edge in &graph.edges {
        let pair = edge.linearize(&graph.poses[edge.i], &graph.poses[edge.j]);
        let omega = edge.information.matrix();
        let ends = [(row(edge.i), pair.d_i), (row(edge.j), pair.d_j)];
        for (a, d_a) in &ends {
            let Some(a) = *a else { continue };
            let g = d_a.tr_mul(&(omega * pair.residual));
            gradient[a * N..][..N].iter_mut().zip(&g).for_each(|(sum, term)| *sum += term);
            for (b, d_b) in &ends {
                if let Some(block) = b.and_then(|b| matrix.block_mut(a, b)) {
                    let h = d_a.tr_mul(&(omega * d_b));
                    block.iter_mut().zip(&h).for_each(|(sum, term)| *sum += term);
                }
            }
        }
    }
    (matrix, gradient)
}

/// Row, column and value of every stored number of the lower triangle.
#[must_use]
pub fn lower_triangle(matrix: &BlockMatrix) -> Vec<(usize, usize, f64)> {
    let pattern = matrix.pattern();
    let mut found = Vec::new();
    for i in 0..pattern.block_count() {
        for j in pattern.row(i).iter().map(|&j| j as usize) {
            let rows = pattern.sizes()[i];
            for (k, &value) in matrix.block(i, j).into_iter().flatten().enumerate() {
                let (r, c) = (pattern.offset(i) + k % rows, pattern.offset(j) + k / rows);
                if r >= c {
                    found.push((r, c, value));
                }
            }
        }
    }
    found
}
