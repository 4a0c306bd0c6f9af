//! How to solve: method, limits, tolerances, threads.
//!
//! Every option says its default; `validate` names the one that is out of range. Options of one kind of
//! problem are in that problem's module.

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
    /// gradient nor the model, without heavy damping, says that there is more to gain (1e-9).
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
        let is_finite = |value: f64| value.is_finite() && value >= 0.0;
        let (finite, positive) = ("must be finite and not negative", "must be finite and positive");
        let damping = self.initial_damping;
        for (field, is_valid, reason) in [
            ("cost_tolerance", is_finite(self.cost_tolerance), finite),
            ("gradient_tolerance", is_finite(self.gradient_tolerance), finite),
            ("step_tolerance", is_finite(self.step_tolerance), finite),
            ("initial_damping", is_finite(damping) && damping > 0.0, positive),
            ("threads", self.threads != Some(0), "must be at least 1"),
        ] {
            if !is_valid {
                return Err(SolveError::InvalidOption { field, reason });
            }
        }
        Ok(())
    }
}

/// Runs `work` in a rayon pool of `threads` threads, or in the caller's pool for `None`.
///
/// # Errors
/// [`SolveError::Threads`] where the pool cannot be started.
pub fn with_threads<R: Send>(
    threads: Option<usize>,
    work: impl FnOnce() -> R + Send,
) -> Result<R, SolveError> {
    match threads {
        None => Ok(work()),
        Some(count) => rayon::ThreadPoolBuilder::new()
            .num_threads(count)
            .build()
            .map(|pool| pool.install(work))
            .map_err(|_error| SolveError::Threads { count }),
    }
}
