//! How well a pose graph knows the points whose positions are measured.
//!
//! C = J P Jᵀ with P the marginal covariance of the pose, a block of H⁻¹ at the graph's poses, and J
//! the Jacobian of the point. Three solves a point with the factor of H, which has the damping of a
//! solve where the factors leave a direction open: C is then as large as that allows. No pose moves.

use std::sync::Arc;

use nalgebra::{Matrix3, SMatrix, SVector};

use super::rows::Rows;
use super::system::blocks_mut;
use super::undetermined::hessian;
use crate::geometry::LieGroup;
use crate::interrupt::Interrupt;
use crate::linear::Cholesky;
use crate::problem::{PoseGraph, SolveError};

/// Added to H, as a share of the largest information of the pose: far above rounding, far below
/// that of any measurement.
const SHIFT: f64 = 1e-12;

/// Covariance in the world's axes of each point whose position `graph` has a prior on, in their
/// order, in m²: by all edges and those priors that `counts` is true of. 0 on constant poses; `None`
/// where the graph has no finite covariance.
///
/// # Errors
/// Those of [`PoseGraph::validate`]; [`SolveError::TooLarge`], [`SolveError::Interrupted`].
pub fn position_covariances<G: LieGroup<N>, const N: usize>(
    graph: &PoseGraph<G, N>,
    counts: &[bool],
    interrupt: &Interrupt,
) -> Result<Vec<Option<Matrix3<f64>>>, SolveError> {
    graph.validate()?;
    let mut counted = graph.clone();
    let mut index = 0;
    counted.position_priors.retain(|_| {
        index += 1;
        counts.get(index - 1).copied().unwrap_or(false)
    });
    let rows = Rows::new(graph);
    let unknown = || vec![None; graph.position_priors.len()];
    if rows.count() == 0 {
        return Ok(vec![Some(Matrix3::zeros()); graph.position_priors.len()]);
    }
    let hessian = hessian(&counted, &rows);
    let pattern = Arc::clone(hessian.pattern());
    let dimension = pattern.dimension();
    let mut factor = Cholesky::new(pattern).map_err(|_error| SolveError::TooLarge { dimension })?;
    let mut shift = hessian.diagonal();
    for block in blocks_mut(hessian.pattern(), &mut shift) {
        let largest = block.iter().fold(0.0_f64, |max, &h| max.max(h));
        block.fill(SHIFT * if largest > 0.0 { largest } else { 1.0 });
    }
    if factor.factor(&hessian, &shift).is_err() {
        return Ok(unknown());
    }
    let mut column = vec![0.0; dimension];
    let mut covariances = Vec::with_capacity(graph.position_priors.len());
    for prior in &graph.position_priors {
        if interrupt.is_due() {
            return Err(SolveError::Interrupted);
        }
        let Some(row) = rows.of_pose[prior.pose] else {
            covariances.push(Some(Matrix3::zeros()));
            continue;
        };
        let d_pose: SMatrix<f64, 3, N> =
            graph.poses[prior.pose].act_jacobian(&prior.point_in_camera);
        let mut covariance = Matrix3::zeros();
        for axis in 0..3 {
            column.fill(0.0);
            let own = row * N..row * N + N;
            column[own.clone()].copy_from_slice(d_pose.row(axis).transpose().as_slice());
            factor.solve(&mut column);
            let moved: SVector<f64, N> = SVector::from_column_slice(&column[own]);
            covariance.set_column(axis, &(d_pose * moved));
        }
        let covariance = (covariance + covariance.transpose()) * 0.5;
        covariances.push(covariance.iter().all(|c| c.is_finite()).then_some(covariance));
    }
    Ok(covariances)
}
