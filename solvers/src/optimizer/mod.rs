//! The trust-region loop, written once: Gauss-Newton and Levenberg-Marquardt over [`System`].
//!
//! The loop never sees a matrix. A system linearizes at its state, solves for a damping, applies or
//! restores a step; the loop decides. Every run ends in a [`SolveSummary`] with an honest
//! [`Termination`], and the system is left at the best state that was found.
//!
//! | file | role |
//! |---|---|
//! | `system` | the trait: linearize, solve for a damping, apply, restore |
//! | `trust_region` | the loop; with losses also a moving bound of their curvature, inner iterations and longer steps (decision 0021) |
//! | `options`, `summary` | how to solve, and what happened |

mod options;
mod summary;
mod system;
mod trust_region;

use crate::linear::LinearError;
use crate::problem::SolveError;

pub use options::{Method, Options, with_threads};
pub use summary::{
    Control, IterationSummary, Observer, SolveSummary, Termination, Tolerance, ignore_iterations,
};
pub use system::{Gradient, Losses, Step, StepFailure, System, Unmoved};
pub use trust_region::{LoopState, minimize};
pub(crate) use trust_region::{SCALE_RANGE, damping_scale};

/// The error of a problem for whose system of `dimension` scalars planning or memory failed. The values
/// at fault are not named here: a caller that knows the variable behind a row names it.
pub(crate) fn from_linear(error: LinearError, dimension: usize) -> SolveError {
    match error {
        LinearError::Interrupted => SolveError::Interrupted,
        LinearError::TooExpensive(error) => SolveError::TooExpensive(error),
        LinearError::NotPositiveDefinite { .. }
        | LinearError::NonFinite { .. }
        | LinearError::DimensionMismatch { .. }
        | LinearError::PatternMismatch { .. }
        | LinearError::TooLarge { .. }
        | LinearError::OutOfMemory { .. } => SolveError::TooLarge { dimension },
    }
}
