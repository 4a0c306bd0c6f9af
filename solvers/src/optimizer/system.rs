//! A nonlinear least-squares problem as the loop of [`super::trust_region`] sees it.
//!
//! Only the interface between the two is here: no matrix, and no decision about steps.

use super::summary::IterationSummary;
use super::trust_region::LoopState;

/// What the loop reads of a linearization.
#[derive(Clone, Copy, Debug)]
pub struct Gradient {
    /// Largest |g_i| / √D_i, the gradient in the scale that the damping uses.
    pub max_norm: f64,
}

/// A step that was solved for and not yet applied.
#[derive(Clone, Copy, Debug)]
pub struct Step {
    /// ½ δᵀ(λDδ − g): by how much the quadratic model falls.
    pub predicted_decrease: f64,
    /// ‖δ‖.
    pub norm: f64,
    /// Norm of the state that the step is to be compared with.
    pub state_norm: f64,
    /// ‖(H + λD) δ + g‖ / ‖g‖.
    pub linear_residual: f64,
    /// Whether the linear system was solved inexactly on purpose, so that the residual is large.
    pub is_inexact: bool,
}

/// The linear system had no solution at this damping.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct StepFailure;

/// A nonlinear least-squares problem as the loop sees it: state, linearization, step.
///
/// A system that was given the loop's [`Interrupt`](crate::interrupt::Interrupt) may return early from
/// any of these once it is due, with any numbers: the loop checks it too, and then uses none of these
/// numbers.
pub trait System {
    /// ½ Σ ρ at the current state; may be infinite or NaN where it cannot be evaluated.
    fn cost(&mut self) -> f64;

    /// Linearizes at the current state. May eliminate for `damping` in the same pass.
    fn linearize(&mut self, damping: f64) -> Gradient;

    /// Solves (H + λD) δ = −g at the last linearization; called again with another λ after a
    /// rejected step, when only what depends on λ is computed anew.
    ///
    /// # Errors
    /// [`StepFailure`] where the damped matrix is not positive definite or not finite.
    fn solve(&mut self, damping: f64) -> Result<Step, StepFailure>;

    /// Applies the last step, keeping the state before it, and returns the new cost.
    fn apply(&mut self) -> f64;

    /// Takes the applied step back, to the bit.
    fn restore(&mut self);

    /// What losses the factors have.
    fn losses(&self) -> Losses {
        Losses::None
    }

    /// From now on, follows each step by inner iterations: variables that are independent of each other
    /// are minimized with the others held. They count as part of the step.
    fn begin_inner_iterations(&mut self) {}

    /// Sets the least curvature of a factor along its residual that linearizations take from now on,
    /// as a share of that across it: 1 is reweighted least squares, 0 the curvature of the loss where
    /// it is not negative. The last linearization is to be made again. 1 at first.
    fn set_stiffness(&mut self, _stiffness: f64) {}

    /// The loop goes on from here after an accepted step, `row` being its last row: the system may keep its
    /// values with `state`, to go on from there another time.
    fn keep(&mut self, _row: &IterationSummary, _state: &dyn Fn() -> LoopState) {}

    /// Takes the applied step back and applies `length` times it instead; returns the new cost. `None`
    /// where it cannot.
    fn apply_lengthened(&mut self, _length: f64) -> Option<f64> {
        None
    }
}

/// The losses of a problem's factors.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Losses {
    /// There are none.
    None,
    /// Costs grow without bound, as Huber's and Cauchy's.
    Unbounded,
    /// Costs stay below a constant, as Tukey's and Geman and McClure's.
    Bounded,
}

/// A state of this cost that is not to be moved: what is left to a loop whose time is up.
#[derive(Clone, Copy, Debug)]
pub struct Unmoved(pub f64);

impl System for Unmoved {
    fn cost(&mut self) -> f64 {
        self.0
    }

    fn linearize(&mut self, _damping: f64) -> Gradient {
        Gradient { max_norm: 0.0 }
    }

    fn solve(&mut self, _damping: f64) -> Result<Step, StepFailure> {
        Err(StepFailure)
    }

    fn apply(&mut self) -> f64 {
        self.0
    }

    fn restore(&mut self) {}
}
