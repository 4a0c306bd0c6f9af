//! What happened in a solve: iterations, termination, and the figures that certify it.
//!
//! Not converging is an outcome that is reported here, never an error. Nothing is computed here.

use std::fmt;

/// Which tolerance was met.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Tolerance {
    /// An accepted step lowered the cost by less than `cost_tolerance` of it.
    Cost,
    /// The scaled gradient fell below `gradient_tolerance`.
    Gradient,
    /// The step fell below `step_tolerance` of the state's norm.
    Step,
}

/// Why the loop ended. Only [`Termination::Converged`] claims a minimum.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Termination {
    /// A tolerance was met; cost and state are finite and the linear residual was checked.
    Converged(Tolerance),
    /// `max_iterations` steps were made.
    MaxIterations,
    /// The time was up.
    Deadline,
    /// The observer asked to stop.
    Cancelled,
    /// No damping gave a step that lowers the cost.
    Stalled,
    /// The start has no finite cost, or no damping made the linear system solvable.
    NumericalFailure,
}

impl Termination {
    /// Whether a minimum was reached.
    #[must_use]
    pub fn is_converged(self) -> bool {
        matches!(self, Self::Converged(_))
    }
}

impl fmt::Display for Termination {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Converged(Tolerance::Cost) => "converged: cost tolerance",
            Self::Converged(Tolerance::Gradient) => "converged: gradient tolerance",
            Self::Converged(Tolerance::Step) => "converged: step tolerance",
            Self::MaxIterations => "max iterations",
            Self::Deadline => "deadline",
            Self::Cancelled => "cancelled",
            Self::Stalled => "stalled",
            Self::NumericalFailure => "numerical failure",
        })
    }
}

/// One row of the report. Row 0 is the start; a rejected step repeats the cost before it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct IterationSummary {
    /// 0 for the start, then 1, 2, ….
    pub iteration: usize,
    /// The cost after the row's step was accepted or rejected.
    pub cost: f64,
    /// Seconds since the solve began.
    pub seconds: f64,
    /// Whether the step was accepted; true in row 0.
    pub accepted: bool,
    /// λ of the step; 0 in row 0, and in Gauss-Newton where H is not singular.
    pub damping: f64,
    /// Largest scaled gradient entry where the step started.
    pub gradient_max_norm: f64,
    /// Euclidean norm of the step.
    pub step_norm: f64,
    /// Actual over predicted decrease of the cost, with the inner iterations that follow it under a
    /// loss, before it was lengthened; 0 where it could not be computed.
    pub step_quality: f64,
}

/// The outcome of a solve.
#[derive(Clone, Debug, PartialEq)]
pub struct SolveSummary {
    /// Why it ended.
    pub termination: Termination,
    /// ½ Σ ρ at the unmodified start.
    pub initial_cost: f64,
    /// ½ Σ ρ at the state that is left.
    pub final_cost: f64,
    /// The start and every step.
    pub iterations: Vec<IterationSummary>,
    /// Largest scaled gradient entry at the last linearization; 0 where the time was up before one.
    pub gradient_max_norm: f64,
    /// ‖(H + λD) δ + g‖ / ‖g‖ of the last linear solve.
    pub linear_residual: f64,
    /// Seconds from the call to its return: validation, ordering and threads included.
    pub solve_seconds: f64,
    /// Worker threads.
    pub threads: usize,
}

/// Whether the loop goes on.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Control {
    /// Go on.
    Continue,
    /// End with [`Termination::Cancelled`].
    Cancel,
}

/// Sees every row as it is written and may cancel.
pub type Observer<'a> = dyn FnMut(&IterationSummary) -> Control + Send + 'a;

/// The observer that watches nothing.
pub fn ignore_iterations(_row: &IterationSummary) -> Control {
    Control::Continue
}
