//! The chordal cost of a pose graph as one quadratic form.
//!
//! F = Σ κ ‖R_j − R_i R_Z‖² + τ ‖t_j − t_i − R_i t_Z‖² (Rosen, Carlone, Bandeira and Leonard,
//! "SE-Sync", 2019, problem 1) is tr(X M Xᵀ) with X = [R_1 t_1 | R_2 t_2 | …]: M has one block of
//! D + 1 rows a pose and the pattern of the graph. This file makes M and holds X; rows of X are
//! vectors of their own, so that a lifted X only has more of them.

use std::sync::Arc;

use nalgebra::{SMatrix, SVector};

use crate::geometry::RigidMotion;
use crate::initialization::IsotropicPrecision;
use crate::linear::{BlockMatrix, BlockPattern};
use crate::problem::PoseGraph;

/// Rows of a lifted state: `rows[r][(D + 1) i + c]` is entry (r, c) of pose i, its translation last.
#[derive(Clone, Debug)]
pub(super) struct Lifted {
    pub(super) rows: Vec<Vec<f64>>,
}

impl Lifted {
    /// The poses themselves.
    pub(super) fn of<G: RigidMotion<D, N>, const D: usize, const N: usize>(poses: &[G]) -> Self {
        let mut rows = vec![vec![0.0; (D + 1) * poses.len()]; D];
        for (i, pose) in poses.iter().enumerate() {
            let (rotation, translation) = (pose.rotation_matrix(), pose.translation());
            for (r, row) in rows.iter_mut().enumerate() {
                let entries = &mut row[(D + 1) * i..][..=D];
                for c in 0..D {
                    entries[c] = rotation[(r, c)];
                }
                entries[D] = translation[r];
            }
        }
        Self { rows }
    }

    /// Zero, with the shape of `self`.
    pub(super) fn zeros_like(&self) -> Self {
        Self { rows: self.rows.iter().map(|row| vec![0.0; row.len()]).collect() }
    }

    /// Σ of the products of entries.
    pub(super) fn dot(&self, other: &Self) -> f64 {
        let dot = |(a, b): (&Vec<f64>, &Vec<f64>)| a.iter().zip(b).map(|(a, b)| a * b).sum::<f64>();
        self.rows.iter().zip(&other.rows).map(dot).sum()
    }

    /// `self` + `scale` · `other`.
    pub(super) fn add_scaled(&mut self, scale: f64, other: &Self) {
        for (row, other) in self.rows.iter_mut().zip(&other.rows) {
            for (x, y) in row.iter_mut().zip(other) {
                *x += scale * y;
            }
        }
    }

    /// All entries times `scale`.
    pub(super) fn scale(&mut self, scale: f64) {
        self.rows.iter_mut().flatten().for_each(|x| *x *= scale);
    }

    /// The product with a symmetric matrix on the right.
    pub(super) fn times(&self, matrix: &BlockMatrix) -> Self {
        let mut product = self.zeros_like();
        for (row, y) in self.rows.iter().zip(&mut product.rows) {
            matrix.symmetric_multiply(row, y);
        }
        product
    }

    /// The rotation part of pose `i`, as far as it has D rows.
    pub(super) fn rotation<const D: usize>(&self, i: usize) -> SMatrix<f64, D, D> {
        SMatrix::from_fn(|r, c| self.rows[r][(D + 1) * i + c])
    }

    /// The translation of pose `i`, its first D rows.
    pub(super) fn translation<const D: usize>(&self, i: usize) -> SVector<f64, D> {
        SVector::from_fn(|r, _| self.rows[r][(D + 1) * i + D])
    }
}

/// M of the edges of `graph`.
pub(super) fn data_matrix<G: RigidMotion<D, N>, const D: usize, const N: usize>(
    graph: &PoseGraph<G, N>,
) -> BlockMatrix {
    let size = D + 1;
    let edges = || graph.edges.iter().filter(|edge| edge.i != edge.j);
    let pairs = edges().map(|edge| (edge.i, edge.j));
    let mut matrix =
        BlockMatrix::new(Arc::new(BlockPattern::new(vec![size; graph.poses.len()], pairs)));
    for edge in edges() {
        let precision = IsotropicPrecision::of::<D, N>(&edge.information);
        let (kappa, tau) = (precision.rotation, precision.translation);
        let z = edge.i_from_j.rotation_matrix();
        let t = edge.i_from_j.translation();
        // With x_i the columns of pose i: κ ‖R_j − R_i Z‖² + τ ‖t_j − t_i − R_i t‖².
        let entry_ii = |r: usize, c: usize| match (r == D, c == D) {
            (false, false) => kappa * f64::from(u8::from(r == c)) + tau * t[r] * t[c],
            (false, true) => tau * t[r],
            (true, false) => tau * t[c],
            (true, true) => tau,
        };
        let entry_jj = |r: usize, c: usize| match (r == c, r == D) {
            (false, _) => 0.0,
            (true, false) => kappa,
            (true, true) => tau,
        };
        // Row r of pose i, column c of pose j.
        let entry_ij = |r: usize, c: usize| match (r == D, c == D) {
            (false, false) => -kappa * z[(r, c)],
            (false, true) => -tau * t[r],
            (true, false) => 0.0,
            (true, true) => -tau,
        };
        add(&mut matrix, (edge.i, edge.i), size, entry_ii);
        add(&mut matrix, (edge.j, edge.j), size, entry_jj);
        if edge.i > edge.j {
            add(&mut matrix, (edge.i, edge.j), size, entry_ij);
        } else {
            add(&mut matrix, (edge.j, edge.i), size, |r, c| entry_ij(c, r));
        }
    }
    matrix
}

/// Adds `entry(row, column)` to a block at or below the diagonal.
pub(super) fn add(
    matrix: &mut BlockMatrix,
    (i, j): (usize, usize),
    size: usize,
    entry: impl Fn(usize, usize) -> f64,
) {
    if let Some(values) = matrix.block_mut(i, j) {
        for (k, value) in values.iter_mut().enumerate() {
            *value += entry(k % size, k / size);
        }
    }
}
