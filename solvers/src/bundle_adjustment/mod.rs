//! Bundle adjustment: poses, cameras and landmarks by Schur elimination of the landmarks.
//!
//! Minimizes ½ Σ ρ(‖r‖²) over the observations of a [`BundleProblem`] plus its pose factors.
//! Landmarks are eliminated one by one; the reduced camera system is solved dense for local windows
//! and block-sparse past that (Triggs et al., "Bundle adjustment: a modern synthesis", 2000, §6).
//! The gauge is the caller's: constant poses. Without any, the damping holds it.

mod accumulate;
mod back_substitute;
mod blocks;
mod covisible;
mod iterative;
mod landmarks;
mod layout;
mod observe;
mod pose_factors;
mod product;
mod reduce;
mod reduced_solver;
mod sorted;
mod system;

use std::time::Instant;

use crate::geometry::Camera;
use crate::lanes::models::{AnyLanes, LaneModel, PinholeLanes, SnavelyLanes};
use crate::optimizer::{self, Observer, SolveSummary, minimize, with_threads};
use crate::problem::{BundleProblem, SolveError};
pub use crate::simd::Class;

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
    /// No blocks but the diagonal ones, which precondition conjugate gradients (Schur-Jacobi);
    /// steps are inexact.
    IterativeSchur,
}

/// Options of [`solve`].
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Options {
    /// The loop's options.
    pub optimizer: optimizer::Options,
    /// The reduced system's solver.
    pub linear_solver: LinearSolver,
    /// The instruction set of the kernels; `None` takes the widest of this processor.
    pub class: Option<Class>,
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
    /// The instruction set that was used.
    pub class: Class,
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
        dispatch(problem, &layout, options, start, observer)
    })?
}

/// Picks the kernels: how many columns a view has, how many rows an observation, which model.
fn dispatch(
    problem: &mut BundleProblem,
    layout: &Layout,
    options: &Options,
    start: Instant,
    observer: &mut Observer<'_>,
) -> Result<BundleSummary, SolveError> {
    let all = |is: fn(&Camera) -> bool| problem.cameras.iter().all(is);
    let snavely = all(|c| matches!(c, Camera::Snavely(_)));
    let pinhole = all(|c| matches!(c, Camera::Pinhole(_)));
    let depth = !problem.depth_reprojections.is_empty();
    let known = layout.camera_parameters == 0;
    let run = (layout, options, start);
    if snavely && !depth && known {
        solve_with::<_, 6, 1, 0, 2>(problem, run, SnavelyLanes, observer)
    } else if snavely && !depth {
        solve_with::<_, 9, 1, 1, 2>(problem, run, SnavelyLanes, observer)
    } else if pinhole && known && !depth {
        solve_with::<_, 6, 1, 0, 2>(problem, run, PinholeLanes, observer)
    } else if pinhole && known {
        solve_with::<_, 6, 1, 0, 3>(problem, run, PinholeLanes, observer)
    } else {
        let view_cameras: Vec<u32> = layout.views.iter().map(|v| v.camera).collect();
        let model = AnyLanes { view_cameras: &view_cameras };
        match (known, depth) {
            (true, false) => solve_with::<_, 6, 1, 0, 2>(problem, run, model, observer),
            (true, true) => solve_with::<_, 6, 1, 0, 3>(problem, run, model, observer),
            (false, false) => solve_with::<_, 15, 2, 0, 2>(problem, run, model, observer),
            (false, true) => solve_with::<_, 15, 2, 0, 3>(problem, run, model, observer),
        }
    }
}

fn solve_with<M: LaneModel, const D: usize, const V: usize, const T: usize, const R: usize>(
    problem: &mut BundleProblem,
    (layout, options, start): (&Layout, &Options, Instant),
    model: M,
    observer: &mut Observer<'_>,
) -> Result<BundleSummary, SolveError> {
    let choice = (options.linear_solver, options.class.unwrap_or_else(Class::detect));
    let mut system = BundleSystem::<M, D, V, T, R>::new(problem, layout, model, choice)?;
    let linear_solver = system.linear_solver();
    let solve = minimize(&mut system, &options.optimizer, start, observer);
    system.finish();
    let behind_camera = problem.behind_camera_count();
    Ok(BundleSummary { solve, linear_solver, behind_camera, class: choice.1 })
}
