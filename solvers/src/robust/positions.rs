//! Pose graphs with false position priors: fixes of a receiver that saw a reflected signal.
//!
//! A false fix bends the odometry before it shows a residual of its own, so that its χ² alone is no
//! evidence. The evidence is by how much the cost of the whole graph drops without it: with the
//! residual r and the covariance C of the point, both at the optimum with it, T = rᵀ (Ω⁻¹ − C)⁻¹ r,
//! which has the χ² distribution of the fix's dimension where it is true (data snooping, Baarda 1968).
//! A fix that is left out fits where T = rᵀ (Ω⁻¹ + C)⁻¹ r is within the threshold. Each round leaves
//! out the worst of each neighborhood, takes back what fits, and solves again, until nothing changes.
//! Edges are trusted: closures are judged by the other files of this module.

use nalgebra::Matrix3;

use super::default_threshold;
use crate::factors::PositionPrior;
use crate::geometry::LieGroup;
use crate::interrupt::Interrupt;
use crate::optimizer::ignore_iterations;
use crate::order;
use crate::pose_graph::{self, position_covariances};
use crate::problem::{PoseGraph, SolveError};

/// Rounds of judging. One leaves out a fix in each neighborhood.
const MAX_ROUNDS: usize = 40;

/// Fixes this near to each other in the order of their poses' ids share the strain of a false one.
const NEIGHBORHOOD: usize = 4;

/// A direction in which the other factors say less than this share of what the fix says is not judged:
/// nothing there contradicts it.
const LEAST_REDUNDANCY: f64 = 1e-8;

/// The verdict on a position prior.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PositionVerdict {
    /// χ² = rᵀΩr at the result.
    pub chi2: f64,
    /// Whether it was found false.
    pub is_switched_off: bool,
}

/// How position priors are judged.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct PositionJudging {
    /// The largest χ² of a true one; `None` takes the 99 % quantile for three dimensions.
    pub threshold: Option<f64>,
    /// Those found false before, rising: they do not count in the first round.
    pub switched_off: Vec<usize>,
}

/// Judges every position prior of `graph` and moves its poses to the optimum of all edges, all pose
/// priors and the position priors that are found true; one verdict a position prior.
///
/// Where more than half of them would be false the odometry is at fault, not they, and all count. A
/// judgment that is interrupted leaves out what it found until then.
///
/// # Errors
/// Those of [`pose_graph::solve`]; [`SolveError::InvalidOption`] for a threshold that is not finite
/// and positive.
pub fn judge_positions<G: LieGroup<N>, const N: usize>(
    graph: &mut PoseGraph<G, N>,
    judging: &PositionJudging,
    options: &pose_graph::Options,
    interrupt: &Interrupt,
) -> Result<Vec<PositionVerdict>, SolveError> {
    let threshold = judging.threshold.unwrap_or_else(|| default_threshold(3));
    if !(threshold.is_finite() && threshold > 0.0) {
        let reason = "must be finite and positive";
        return Err(SolveError::InvalidOption { field: "threshold", reason });
    }
    graph.validate()?;
    let all = graph.position_priors.clone();
    let is_off = |prior: usize| judging.switched_off.binary_search(&prior).is_ok();
    let given = graph.poses.clone();
    let mut counts: Vec<bool> = (0..all.len()).map(|prior| !is_off(prior)).collect();
    let ranks = ranks(graph);
    if !is_one_piece(graph, &counts) {
        counts.fill(true);
    }
    let mut before: Vec<Vec<bool>> = Vec::new();
    let mut solved: Vec<bool> = Vec::new();
    for _ in 0..MAX_ROUNDS {
        let strain = solve(graph, &counts, options, interrupt)?;
        solved.clone_from(&counts);
        // No single fix costs more than all factors together.
        let is_at_ease = strain <= threshold && counts.iter().all(|&counts| counts);
        if is_at_ease || interrupt.is_due() {
            break;
        }
        let costs = match costs(graph, &counts, interrupt) {
            Err(SolveError::Interrupted) => break,
            costs => costs?,
        };
        let next = next_counts(&counts, &costs, &ranks, threshold);
        if next == counts || before.contains(&next) || !is_one_piece(graph, &next) {
            break;
        }
        before.push(std::mem::replace(&mut counts, next));
    }
    if 2 * counts.iter().filter(|&&counts| !counts).count() > all.len() {
        counts.fill(true);
        graph.poses = given;
    }
    if solved != counts {
        solve(graph, &counts, options, interrupt)?;
    }
    let verdict = |(prior, counts): (&PositionPrior, &bool)| {
        let chi2 = prior.chi2(&graph.poses[prior.pose]);
        PositionVerdict { chi2, is_switched_off: !counts && (chi2 > threshold || chi2.is_nan()) }
    };
    Ok(all.iter().zip(&counts).map(verdict).collect())
}

/// Whether the position priors that count leave the graph in one piece.
fn is_one_piece<G: LieGroup<N>, const N: usize>(graph: &PoseGraph<G, N>, counts: &[bool]) -> bool {
    let mut sets = graph.ties();
    graph.edges.iter().for_each(|edge| _ = sets.join(edge.i, edge.j));
    let constant = (0..graph.poses.len()).filter(|&pose| graph.constant[pose]);
    let whole = graph.pose_priors.iter().map(|prior| prior.pose);
    let kept = graph.position_priors.iter().zip(counts).filter(|&(_, &counts)| counts);
    sets.join_all(constant.chain(whole).chain(kept.map(|(prior, _)| prior.pose)));
    (0..graph.poses.len()).all(|pose| sets.root(pose) == 0)
}

/// Solves with the position priors that count; 2 × the cost at the end.
fn solve<G: LieGroup<N>, const N: usize>(
    graph: &mut PoseGraph<G, N>,
    counts: &[bool],
    options: &pose_graph::Options,
    interrupt: &Interrupt,
) -> Result<f64, SolveError> {
    let kept = graph.position_priors.iter().zip(counts).filter(|&(_, &counts)| counts);
    let kept: Vec<PositionPrior> = kept.map(|(prior, _)| *prior).collect();
    let all = std::mem::replace(&mut graph.position_priors, kept);
    let solved = if graph.position_priors.is_empty() && graph.pose_priors.is_empty() {
        // Nothing is left that says where the graph is: it stays.
        Ok(0.0)
    } else {
        let solved = pose_graph::solve_until(graph, options, interrupt, &mut ignore_iterations);
        solved.map(|summary| 2.0 * summary.final_cost)
    };
    graph.position_priors = all;
    solved
}

/// T of each position prior.
pub(super) fn costs<G: LieGroup<N>, const N: usize>(
    graph: &PoseGraph<G, N>,
    counts: &[bool],
    interrupt: &Interrupt,
) -> Result<Vec<f64>, SolveError> {
    let covariances = position_covariances(graph, counts, interrupt)?;
    let cost = |((prior, covariance), &counts): ((&PositionPrior, Option<Matrix3<f64>>), &bool)| {
        let plain = prior.chi2(&graph.poses[prior.pose]);
        let Some(covariance) = covariance else { return plain };
        let Ok(root) = prior.information.sqrt() else { return plain };
        let residual = root.whiten(&prior.residual(&graph.poses[prior.pose]));
        let whitened = root.matrix() * covariance * root.matrix().transpose();
        let sign = if counts { -1.0 } else { 1.0 };
        let eigen = (Matrix3::identity() + whitened * sign).symmetric_eigen();
        let along = eigen.eigenvectors.tr_mul(&residual);
        let judged = (0..3).filter(|&axis| eigen.eigenvalues[axis] > LEAST_REDUNDANCY);
        judged.map(|axis| along[axis] * along[axis] / eigen.eigenvalues[axis]).sum()
    };
    let priors = graph.position_priors.iter().zip(covariances).zip(counts);
    Ok(priors.map(cost).collect())
}

/// The rank of each position prior in the order of its pose's id, then of the priors.
fn ranks<G, const N: usize>(graph: &PoseGraph<G, N>) -> Vec<usize> {
    let mut order: Vec<usize> = (0..graph.position_priors.len()).collect();
    let id = |prior: usize| graph.ids[graph.position_priors[prior].pose];
    order::sort_by(&mut order, &mut |a, b| id(a).cmp(&id(b)));
    let mut ranks = vec![0; order.len()];
    order.into_iter().enumerate().for_each(|(rank, prior)| ranks[prior] = rank);
    ranks
}

/// What counts in the next round.
fn next_counts(counts: &[bool], costs: &[f64], ranks: &[usize], threshold: f64) -> Vec<bool> {
    let mut next = counts.to_vec();
    let mut worst: Vec<usize> = (0..counts.len())
        .filter(|&k| counts[k] && (costs[k] > threshold || costs[k].is_nan()))
        .collect();
    order::sort_by(&mut worst, &mut |a, b| costs[b].total_cmp(&costs[a]));
    let mut left_out = vec![false; counts.len()];
    for k in worst {
        let near = ranks[k].saturating_sub(NEIGHBORHOOD)..=ranks[k] + NEIGHBORHOOD;
        if !near.into_iter().any(|rank| left_out.get(rank).copied().unwrap_or(false)) {
            left_out[ranks[k]] = true;
            next[k] = false;
        }
    }
    for k in (0..counts.len()).filter(|&k| !counts[k] && costs[k] <= threshold) {
        next[k] = true;
    }
    next
}
