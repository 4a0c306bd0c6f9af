//! The certificate of a solve: what was solved, how well, and why it ended.
//!
//! Costs before and after come from the solver crate's independent evaluator, not from the solver.

use covis_solvers::bundle_adjustment::LinearSolver;
use covis_solvers::evaluation::CostReport;
use covis_solvers::optimizer::{Method, SolveSummary};

/// What fixes the map's frame where the measurements do not determine it.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum GaugeKind {
    /// The first keyframe of each connected piece of the map.
    #[default]
    FirstKeyframeFixed,
    /// Only the solver's damping.
    Free,
    /// Priors.
    Priors,
    /// The fixed keyframes around a window.
    FixedPoses,
}

/// The linear system of a solve.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum SolverKind {
    /// Landmarks are eliminated; the value is never [`LinearSolver::Auto`].
    Schur(LinearSolver),
    /// Sparse block Cholesky of a pose graph.
    SparseCholesky,
}

/// The certificate of a solve.
#[derive(Clone, Debug, PartialEq)]
pub struct SolveCertificate {
    /// Summary of the optimizer's loop.
    pub solve: SolveSummary,
    /// The step method that was requested.
    pub method: Method,
    /// The linear system that was used.
    pub linear_solver: SolverKind,
    /// Cost before, by kind of factor.
    pub before: CostReport,
    /// Cost after.
    pub after: CostReport,
    /// What fixed the frame.
    pub gauge: GaugeKind,
    /// Poses that could move.
    pub free_poses: usize,
    /// Poses that were fixed.
    pub fixed_poses: usize,
    /// Landmarks that could move.
    pub free_landmarks: usize,
}
