//! How to solve: method, limits and tolerances.
//!
//! Every option says its default; `validate` names the one that is out of range.

use std::time::Duration;

use crate::price::Ceiling;
use crate::problem::SolveError;

/// The step of the trust-region loop.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Method {
    /// Damped steps (H + λ D) δ = −g with Marquardt scaling D and Nielsen's update of λ.
    #[default]
    LevenbergMarquardt,
    /// Full steps H δ = −g, damped from where H is singular; ends as stalled at the first step that
    /// does not lower the cost.
    GaussNewton,
}

/// Options of one solve; each with its default.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Options {
    /// Levenberg-Marquardt.
    pub method: Method,
    /// At most so many steps, rejected ones included (100).
    pub max_iterations: usize,
    /// Converged once an accepted step lowers the cost by less than this share of it, and neither the
    /// model nor the gradient says that there is more to gain (1e-9).
    pub cost_tolerance: f64,
    /// Converged once no entry of the gradient is larger, scaled by the root of its diagonal (1e-10).
    pub gradient_tolerance: f64,
    /// Converged once the step is shorter than this share of the state's norm, and its damping is not
    /// what makes it short (1e-12).
    pub step_tolerance: f64,
    /// λ of the first step, or of Gauss-Newton's first step that must be damped (1e-4).
    pub initial_damping: f64,
    /// Ends after this much time, looked at within steps as well (none).
    pub deadline: Option<Duration>,
    /// A solve that is estimated to take more is not begun (no limit).
    pub ceiling: Ceiling,
    /// Worker threads; `None` uses those of the caller's rayon pool.
    pub threads: Option<usize>,
}

impl Default for Options {
    fn default() -> Self {
        Self {
            method: Method::LevenbergMarquardt,
            max_iterations: 100,
            cost_tolerance: 1e-9,
            gradient_tolerance: 1e-10,
            step_tolerance: 1e-12,
            initial_damping: 1e-4,
            deadline: None,
            ceiling: Ceiling::NONE,
            threads: None,
        }
    }
}

impl Options {
    /// Checks every option's range.
    ///
    /// # Errors
    /// [`SolveError::InvalidOption`] names the first option that is out of range.
    pub fn validate(&self) -> Result<(), SolveError> {
        let reason = "must be finite and not negative";
        for (field, value) in [
            ("cost_tolerance", self.cost_tolerance),
            ("gradient_tolerance", self.gradient_tolerance),
            ("step_tolerance", self.step_tolerance),
        ] {
            if !(value.is_finite() && value >= 0.0) {
                return Err(SolveError::InvalidOption { field, reason });
            }
        }
        if !(self.initial_damping.is_finite() && self.initial_damping > 0.0) {
            let reason = "must be finite and positive";
            return Err(SolveError::InvalidOption { field: "initial_damping", reason });
        }
        if self.threads == Some(0) {
            let reason = "must be at least 1";
            return Err(SolveError::InvalidOption { field: "threads", reason });
        }
        Ok(())
    }
}
