//! What measurements of landmarks add to H and g.
//!
//! A measurement touches one pose and one landmark and adds w JᵀΩJ to their three blocks and w JᵀΩr to
//! their gradients, w = ρ' of its loss. They are summed in order on one thread, after the edges and the
//! priors. A graph without landmarks is not touched.

use nalgebra::{Matrix3, SMatrix, SVector, Vector3};

use super::rows::Rows;
use crate::geometry::LieGroup;
use crate::linear::BlockMatrix;
use crate::problem::{PoseGraph, SolveError, dimension_of_space};

/// Names the first measurement that has no finite χ² at the graph's variables.
pub(super) fn check_finite<G: LieGroup<N>, const N: usize>(
    graph: &PoseGraph<G, N>,
) -> Result<(), SolveError> {
    let landmarks = &graph.landmarks;
    let not_finite = |m| !landmarks.chi2(m, &graph.poses).is_finite();
    match landmarks.measurements.iter().position(not_finite) {
        Some(index) => Err(SolveError::ResidualNotFinite { factor: "landmark measurement", index }),
        None => Ok(()),
    }
}

/// Adds what was measured of landmarks to H and g, which hold the edges and the priors already.
pub(super) fn add<G: LieGroup<N>, const N: usize>(
    graph: &PoseGraph<G, N>,
    rows: &Rows,
    hessian: &mut BlockMatrix,
    gradient: &mut [f64],
) {
    let space = dimension_of_space(N);
    let identity = G::identity();
    for measurement in &graph.landmarks.measurements {
        let pose = measurement.pose.map_or(&identity, |pose| &graph.poses[pose]);
        let point = &graph.landmarks.positions[measurement.landmark];
        let at = measurement.linearize(pose, point);
        let loss = measurement.loss.unwrap_or(graph.loss);
        let weight = loss.evaluate(measurement.information.squared_norm(&at.residual)).weight;
        let omega = measurement.information.matrix() * weight;
        let omega_r: Vector3<f64> = omega * at.residual;
        let pose_row = measurement.pose.and_then(|pose| rows.of_pose[pose]);
        if let Some(row) = pose_row {
            let block: SMatrix<f64, N, N> = at.d_pose.tr_mul(&(omega * at.d_pose));
            hessian.add_block(row, row, &block);
            let own: SVector<f64, N> = at.d_pose.tr_mul(&omega_r);
            add_to(gradient, row * N, own.as_slice());
        }
        let Some(row) = rows.of_landmark[measurement.landmark] else { continue };
        let block: Matrix3<f64> = at.d_landmark.tr_mul(&(omega * at.d_landmark));
        if let Some(values) = hessian.block_mut(row, row) {
            add_corner(values, &block, space);
        }
        let own = at.d_landmark.tr_mul(&omega_r);
        let offset = hessian.pattern().offset(row);
        add_to(gradient, offset, &own.as_slice()[..space]);
        if let Some(pose_row) = pose_row {
            let block: SMatrix<f64, 3, N> = at.d_landmark.tr_mul(&(omega * at.d_pose));
            // Rows of landmarks come after those of poses, so that the block is stored as it is.
            if let Some(values) = hessian.block_mut(row, pose_row) {
                add_corner(values, &block, space);
            }
        }
    }
}

/// Adds the first `space` rows of `block`, as far as `values` has columns.
fn add_corner<const C: usize>(values: &mut [f64], block: &SMatrix<f64, 3, C>, space: usize) {
    for (values, column) in values.chunks_exact_mut(space).zip(block.column_iter()) {
        values.iter_mut().zip(column.iter()).for_each(|(value, added)| *value += added);
    }
}

fn add_to(gradient: &mut [f64], offset: usize, own: &[f64]) {
    let entries = gradient[offset..].iter_mut();
    entries.zip(own).for_each(|(entry, value)| *entry += value);
}
