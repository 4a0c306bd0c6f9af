//! Removing a keyframe for good without forgetting what it measured.
//!
//! Linearized at the current estimates, T ⊞ δ = T · Exp(δ), the factors that touch the removed pose
//! r say of the others what is left when r and its landmarks are eliminated. The other observations
//! of these landmarks stay in the map and must not count twice:
//!
//! Δ = S_with − S_without,  S = H_pp − H_pe H_ee⁺ H_ep,
//!
//! e = (landmarks, r) with the factors of r and e = (landmarks) without them. Factors that neither
//! touch r nor one of its landmarks cancel and are never looked at. Δ is dense and positive
//! semi-definite (the Schur complement is monotone). Factors that a map can keep are recovered from
//! it on a tree (Mazuran, Burgard and Tipaldi, "Nonlinear factor recovery for long-term SLAM", IJRR
//! 2016): edge (i, j) measures X_i⁻¹ X_j at the estimates with the information that Δ has of it, in
//! which all other poses are eliminated. Among the trees, the one with the greatest sum of log
//! determinants loses least (Chow and Liu 1968: it has the least Kullback-Leibler divergence, since
//! the recovered factors keep the trace and adjoints have determinant one).
//!
//! Priors on r tie it to the world, which is then one more node of the tree; its edges are pose
//! priors. So everything is relative, and Δ is free to be singular: no pose is held, and no
//! covariance is formed of a direction that nothing measures.
//!
//! `views` linearizes observations, `knowledge` makes Δ of them, `recovery` the tree; `blocks` eliminates. It solves nothing, and what is
//! removed and when is a caller's to say.

mod blocks;
mod knowledge;
mod recovery;
mod views;

use crate::factors::{PosePrior, RelativePose};
use crate::geometry::Se3;
use crate::problem::{BundleProblem, SolveError};
use knowledge::Knowledge;

/// The factors that replace a removed keyframe. Each residual is zero at the estimates: the information
/// of the keyframe is kept, its gradient is not. Where the other factors pull against it, they move the
/// map as far as the kept information lets them.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Marginal {
    /// Measured motions between poses that stay, i < j as the problem numbers them; a forest.
    pub relative_poses: Vec<RelativePose<Se3, 6>>,
    /// Priors on poses that stay; none unless the removed pose had a prior.
    pub pose_priors: Vec<PosePrior>,
}

/// The factors that stand in for pose `removed` of `problem` when it goes, with all its factors.
///
/// `problem` holds the removed pose, the landmarks that it observes with all their observations, and
/// the relative poses and priors that touch it; other factors and other poses do not matter. Losses
/// weigh each factor as they do at the estimates. Cameras count as known, and the constant flags,
/// which say what a solve may move, not at all. Left out are observations without a finite
/// projection, and those whose landmark is behind its camera, of which the linearization says
/// nothing true.
///
/// Every information is positive definite: a direction that Δ says nothing of has 1e-11 of the
/// strongest one. An edge that says less than 1e-9 of what was measured of its pose is left out, so
/// that poses that only chance ties together have none.
///
/// # Errors
/// Those of [`BundleProblem::validate`], but for [`SolveError::Empty`]: a problem without factors has
/// an empty answer. [`SolveError::IndexOutOfRange`] where there is no pose `removed`;
/// [`SolveError::NotFinite`] where weights are so large that a sum of squares overflows.
pub fn marginalize_pose(problem: &BundleProblem, removed: usize) -> Result<Marginal, SolveError> {
    match problem.validate() {
        Ok(()) | Err(SolveError::Empty(_)) => {}
        Err(error) => return Err(error),
    }
    let count = problem.poses.len();
    if removed >= count {
        return Err(SolveError::IndexOutOfRange {
            factor: "marginalization of pose",
            index: removed,
            variable: "pose",
            value: removed,
            count,
        });
    }
    let knowledge = Knowledge::of(problem, removed)?;
    Ok(recovery::on_a_tree(problem, removed, &knowledge))
}
