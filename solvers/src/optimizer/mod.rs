//! The trust-region loop, written once: Gauss-Newton and Levenberg-Marquardt over [`System`].
//!
//! The loop never sees a matrix. A system linearizes at its state, solves for a damping, applies or
//! restores a step; the loop decides. Every run ends in a [`SolveSummary`] with an honest
//! [`Termination`], and the system is left at the best state that was found.

mod damping;
mod failure;
mod options;
mod summary;
mod threads;
mod trust_region;

pub(crate) use damping::{SCALE_RANGE, damping_scale};
pub(crate) use failure::from_linear;
pub use options::{Method, Options};
pub use summary::{
    Control, IterationSummary, Observer, SolveSummary, Termination, Tolerance, ignore_iterations,
};
pub use threads::with_threads;
pub use trust_region::{Gradient, Step, StepFailure, System, Unmoved, minimize, minimize_until};
