//! The certificate of a solve: what was solved, how well, and why it ended.
//!
//! Costs before and after come from the solver crate's independent evaluator, not from the solver.

use covis_solvers::bundle_adjustment::LinearSolver;
use covis_solvers::evaluation::CostReport;
use covis_solvers::optimizer::{Method, SolveSummary};

/// What holds the frame where the measurements leave it free.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum GaugeKind {
    /// The first keyframe, and the first one of every further piece of the map.
    #[default]
    FirstKeyframeFixed,
    /// Nothing but the solver's damping.
    Free,
    /// Priors.
    Priors,
    /// The keyframes around a window.
    FixedPoses,
}

/// The linear system of a solve.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum SolverKind {
    /// Landmarks eliminated; [`LinearSolver::Auto`] never stands here.
    Schur(LinearSolver),
    /// Sparse block Cholesky of a pose graph.
    SparseCholesky,
}

/// The certificate of a solve.
#[derive(Clone, Debug, PartialEq)]
pub struct SolveCertificate {
    /// What the loop did.
    pub solve: SolveSummary,
    /// The step that was asked for.
    pub method: Method,
    /// The linear system that was used.
    pub linear_solver: SolverKind,
    /// Cost before, by kind of factor.
    pub before: CostReport,
    /// Cost after.
    pub after: CostReport,
    /// What held the frame.
    pub gauge: GaugeKind,
    /// Poses that could move.
    pub free_poses: usize,
    /// Poses that were held.
    pub fixed_poses: usize,
    /// Landmarks that could move.
    pub free_landmarks: usize,
}
