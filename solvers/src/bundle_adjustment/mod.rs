//! Bundle adjustment: poses, cameras and landmarks by Schur elimination of the landmarks.
//!
//! Minimizes ½ Σ ρ(‖r‖²) over the observations of a [`BundleProblem`] plus its pose factors.
//! Landmarks are eliminated one by one; the reduced camera system is solved dense for local windows
//! and block-sparse past that (Triggs et al., "Bundle adjustment: a modern synthesis", 2000, §6).
//! The gauge is the caller's: constant poses. Without any, the damping holds it.

mod landmarks;
mod layout;
mod pose_factors;
mod schur;
mod system;

use std::time::Instant;

use crate::optimizer::{self, Observer, SolveSummary, minimize, with_threads};
use crate::problem::{BundleProblem, SolveError};

use layout::Layout;
use system::BundleSystem;

/// How the reduced camera system is stored and factored.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum LinearSolver {
    /// Dense for small or well-filled systems, sparse otherwise.
    #[default]
    Auto,
    /// All blocks, dense Cholesky.
    DenseSchur,
    /// Blocks of covisible poses only, sparse supernodal Cholesky.
    SparseSchur,
}

/// Options of [`solve`].
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Options {
    /// The loop's options.
    pub optimizer: optimizer::Options,
    /// The reduced system's solver.
    pub linear_solver: LinearSolver,
}

/// The outcome of [`solve`].
#[derive(Clone, Debug, PartialEq)]
pub struct BundleSummary {
    /// What the loop did.
    pub solve: SolveSummary,
    /// The solver that was used, never [`LinearSolver::Auto`].
    pub linear_solver: LinearSolver,
    /// Observations whose landmark is at or behind the camera's center plane in the result; they
    /// count in the cost.
    pub behind_camera: usize,
}

/// Minimizes the cost of `problem` in place, from the values that it holds.
///
/// Variables that no factor touches stay as they are. The result's bits do not depend on the number
/// of threads.
///
/// # Errors
/// [`SolveError`] where the problem or an option is invalid; not converging is no error.
pub fn solve(
    problem: &mut BundleProblem,
    options: &Options,
    observer: &mut Observer<'_>,
) -> Result<BundleSummary, SolveError> {
    let start = Instant::now();
    options.optimizer.validate()?;
    problem.validate()?;
    with_threads(options.optimizer.threads, || {
        let layout = Layout::new(problem)?;
        // The width of a view's Jacobian is a constant of the inner loops: 6 with known intrinsics,
        // 9 with Snavely's three, 15 with any model.
        match layout.camera_parameters {
            0 => run::<6>(problem, layout, options, start, observer),
            1..=3 => run::<9>(problem, layout, options, start, observer),
            _ => run::<15>(problem, layout, options, start, observer),
        }
    })?
}

fn run<const D: usize>(
    problem: &mut BundleProblem,
    layout: Layout,
    options: &Options,
    start: Instant,
    observer: &mut Observer<'_>,
) -> Result<BundleSummary, SolveError> {
    let mut system = BundleSystem::<D>::new(problem, layout, options.linear_solver)?;
    let linear_solver = system.linear_solver();
    let solve = minimize(&mut system, &options.optimizer, start, observer);
    let behind_camera = problem.behind_camera_count();
    Ok(BundleSummary { solve, linear_solver, behind_camera })
}
