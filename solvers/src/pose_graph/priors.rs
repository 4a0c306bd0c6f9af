//! Priors of a pose graph: the cost of all factors, and what priors add to H and g.
//!
//! A prior touches one pose, so that it adds w JᵀΩJ to that pose's diagonal block and w JᵀΩr to its
//! gradient, w = ρ' of its own loss. There are no more of them than of edges and each is cheap: they
//! are summed in order on one thread. A graph without priors is not touched.

use nalgebra::{SMatrix, SVector};

use crate::factors;
use crate::geometry::LieGroup;
use crate::information::Information;
use crate::interrupt::Interrupt;
use crate::linear::BlockMatrix;
use crate::loss::Loss;
use crate::problem::{PoseGraph, SolveError};

/// ½ Σ ρ over all factors of `graph`. Once `interrupt` is due the rest of the edges count nothing.
pub(crate) fn cost<G: LieGroup<N>, const N: usize>(
    graph: &PoseGraph<G, N>,
    interrupt: &Interrupt,
) -> f64 {
    let edges = factors::cost(&graph.edges, &graph.poses, graph.loss, interrupt);
    let edges = if graph.has_priors() { edges + prior_cost(graph) } else { edges };
    if graph.has_measured() { edges + graph.cost_of_measured() } else { edges }
}

/// ½ Σ ρ over the priors alone.
fn prior_cost<G: LieGroup<N>, const N: usize>(graph: &PoseGraph<G, N>) -> f64 {
    let mut sum = 0.0;
    for prior in &graph.pose_priors {
        sum += prior.loss.evaluate(prior.chi2(&graph.poses[prior.pose])).rho;
    }
    for prior in &graph.position_priors {
        sum += prior.loss.evaluate(prior.chi2(&graph.poses[prior.pose])).rho;
    }
    0.5 * sum
}

/// Names the first prior that has no finite cost at the poses.
pub(super) fn check_finite<G: LieGroup<N>, const N: usize>(
    graph: &PoseGraph<G, N>,
) -> Result<(), SolveError> {
    let not_finite = |factor, index| Err(SolveError::ResidualNotFinite { factor, index });
    for (index, prior) in graph.pose_priors.iter().enumerate() {
        if !prior.chi2(&graph.poses[prior.pose]).is_finite() {
            return not_finite("pose prior", index);
        }
    }
    for (index, prior) in graph.position_priors.iter().enumerate() {
        if !prior.chi2(&graph.poses[prior.pose]).is_finite() {
            return not_finite("position prior", index);
        }
    }
    Ok(())
}

/// Adds what the priors say to H and g, which hold the edges already.
pub(super) fn add<G: LieGroup<N>, const N: usize>(
    graph: &PoseGraph<G, N>,
    row_of: &[Option<usize>],
    hessian: &mut BlockMatrix,
    gradient: &mut [f64],
) {
    let mut sink = Sink { row_of, hessian, gradient };
    for prior in &graph.pose_priors {
        let (residual, d_pose) = prior.linearize(&graph.poses[prior.pose]);
        sink.add(prior.pose, &prior.information, prior.loss, &residual, &d_pose);
    }
    for prior in &graph.position_priors {
        let (residual, d_pose) = prior.linearize(&graph.poses[prior.pose]);
        sink.add(prior.pose, &prior.information, prior.loss, &residual, &d_pose);
    }
}

struct Sink<'a> {
    row_of: &'a [Option<usize>],
    hessian: &'a mut BlockMatrix,
    gradient: &'a mut [f64],
}

impl Sink<'_> {
    fn add<const R: usize, const N: usize>(
        &mut self,
        pose: usize,
        information: &Information<R>,
        loss: Loss,
        residual: &SVector<f64, R>,
        d_pose: &SMatrix<f64, R, N>,
    ) {
        let Some(row) = self.row_of[pose] else { return };
        let weight = loss.evaluate(information.squared_norm(residual)).weight;
        let omega_d = information.matrix() * d_pose * weight;
        let (h, g) = (d_pose.tr_mul(&omega_d), omega_d.tr_mul(residual));
        self.hessian.add_block(row, row, &h);
        let own = &mut self.gradient[row * N..][..N];
        own.iter_mut().zip(g.iter()).for_each(|(entry, value)| *entry += value);
    }
}
