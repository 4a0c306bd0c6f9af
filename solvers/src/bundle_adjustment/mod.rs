//! Bundle adjustment: poses, cameras and landmarks by Schur elimination of the landmarks.
//!
//! Minimizes ½ Σ ρ(‖r‖²) over the observations of a [`BundleProblem`] plus its other factors.
//! Landmarks are eliminated one by one; the reduced camera system is solved dense for local windows
//! and block-sparse past that (Triggs et al., "Bundle adjustment: a modern synthesis", 2000, §6).
//! The gauge is the caller's: constant poses. Without any, the damping holds it.
//!
//! | file | role |
//! |---|---|
//! | `sorted`, `layout`, `covisible` | index work, done once: the order of observations, blocks, pairs of views |
//! | `variables` | variables as the passes read them |
//! | `observe`, `under_loss` | eight observations at a time, without and with a loss |
//! | `landmarks`, `inner_iterations` | eight landmarks at a time; landmarks minimized each on its own |
//! | `accumulate`, `reduce` | the fused pass; from sums of chunks to the reduced camera system |
//! | `blocks` | blocks and vectors in eights |
//! | `reduced_solver` | dense, sparse or iterative, chosen by estimated cost |
//! | `product`, `iterative` | conjugate gradients without the matrix |
//! | `back_substitute` | landmark steps, and the cost of a state |
//! | `state_factors` | factors beside observations: relative poses and priors |
//! | `eliminator`, `system` | all of these for one size of view and observation; as the loop sees them |
//! | `marginals` | covariances of poses and pairs after a solve |
//! | `price` | memory and work, known before a solve |

mod accumulate;
mod back_substitute;
mod blocks;
mod covisible;
mod distance;
mod eliminator;
mod inner_iterations;
mod iterative;
mod landmarks;
mod layout;
mod marginals;
mod observe;
mod price;
mod product;
mod reduce;
mod reduced_solver;
mod sorted;
mod state_factors;
mod system;
mod under_loss;
mod variables;

pub use marginals::{PairEstimate, pair_covariances, pose_covariances};

use std::sync::Arc;
use std::time::Instant;

use nalgebra::Vector3;

use crate::geometry::{Camera, Se3};
use crate::interrupt::Interrupt;
use crate::optimizer::{
    self, IterationSummary, LoopState, Observer, SolveSummary, Unmoved, minimize, with_threads,
};
use crate::price::{Limits, Price};
use crate::problem::{BundleProblem, SolveError};
use crate::simd::Class;

use eliminator::Kernels;
use layout::Layout;
use system::BundleSystem;
use variables::Variables;

/// How the reduced camera system is stored and factored.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum LinearSolver {
    /// The cheapest: dense for small or well-filled systems, sparse while a factorization costs less than
    /// the products that conjugate gradients are expected to take, iterative past that. A solve changes from
    /// iterative to sparse once it has counted more products than expected.
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
    /// The solver that was used; [`LinearSolver::Auto`] only where the time was up before the choice.
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
/// [`SolveError`] where the problem or an option is invalid, [`SolveError::TooExpensive`] where the
/// estimate passes the ceiling of the options; not converging is no error.
pub fn solve(
    problem: &mut BundleProblem,
    options: &Options,
    observer: &mut Observer<'_>,
) -> Result<BundleSummary, SolveError> {
    solve_until(problem, options, &Interrupt::NEVER, observer)
}

/// As [`solve`], ending once `interrupt` is due as well: within an iteration, at the best state so
/// far. Where it is due before the first, the start is the answer.
///
/// # Errors
/// As [`solve`].
pub fn solve_until(
    problem: &mut BundleProblem,
    options: &Options,
    interrupt: &Interrupt,
    observer: &mut Observer<'_>,
) -> Result<BundleSummary, SolveError> {
    run(problem, options, interrupt, None, None, observer)
}

/// Solves from a state and with a keeper, where they are given.
fn run<'a>(
    problem: &'a mut BundleProblem,
    options: &'a Options,
    interrupt: &Interrupt,
    from: Option<&'a Checkpoint>,
    keeper: Option<&'a mut (dyn Keeper + 'a)>,
    observer: &'a mut Observer<'_>,
) -> Result<BundleSummary, SolveError> {
    let start = Instant::now();
    options.optimizer.validate()?;
    problem.validate()?;
    let interrupt = interrupt.or_after(start, options.optimizer.deadline);
    with_threads(options.optimizer.threads, || {
        let layout = Arc::new(Layout::new(problem)?);
        let kernels = Kernels::of(problem, &layout);
        let class = options.class.unwrap_or_else(Class::detect);
        let loop_options = &options.optimizer;
        let limits = Limits { ceiling: loop_options.ceiling, interrupt: &interrupt };
        let variables = Variables::new(&mut *problem, &layout, kernels, class, interrupt.clone());
        let system = BundleSystem::new(variables, options.linear_solver, limits);
        let (solve, linear_solver) = match system {
            Ok(mut system) => {
                if from.is_some_and(|from| from.left_iterative) {
                    system.reconsider(usize::MAX);
                }
                let from = from.map(|from| &from.state);
                system.keeper = match keeper {
                    Some(keeper) => Some(keeper),
                    None => None,
                };
                let solve = minimize(&mut system, loop_options, start, &interrupt, from, observer);
                let linear_solver = system.linear_solver();
                system.finish();
                (solve, linear_solver)
            }
            Err(SolveError::Interrupted) => {
                let mut variables =
                    Variables::new(&mut *problem, &layout, kernels, class, interrupt.clone());
                let mut unmoved = Unmoved(variables.cost());
                let solve = minimize(&mut unmoved, loop_options, start, &interrupt, None, observer);
                (solve, options.linear_solver)
            }
            Err(error) => return Err(error),
        };
        let behind_camera = problem.behind_camera_count();
        Ok(BundleSummary { solve, linear_solver, behind_camera, class })
    })?
}

/// A solve on its way: from here it comes to the result that it would have come to, to the bit.
#[derive(Clone, Debug, PartialEq)]
pub struct Checkpoint {
    /// Where the loop stands.
    pub state: LoopState,
    /// Whether [`LinearSolver::Auto`] has changed from conjugate gradients to a factorization.
    pub left_iterative: bool,
    /// `world_from_camera` of each pose.
    pub poses: Vec<Se3>,
    /// `point_in_world` of each landmark.
    pub landmarks: Vec<Vector3<f64>>,
    /// Intrinsics.
    pub cameras: Vec<Camera>,
}

/// Keeps checkpoints of a solve.
pub trait Keeper: Send {
    /// Whether a checkpoint is to be kept after the iteration of `row`, whose step was accepted.
    fn is_due(&mut self, row: &IterationSummary) -> bool;

    /// Keeps one.
    fn keep(&mut self, checkpoint: Checkpoint);
}

/// As [`solve`], from `from` on if it is given, with checkpoints kept by `keeper`. Problem and options are
/// those that the checkpoint was made with.
///
/// # Errors
/// As [`solve`], and [`SolveError::LengthMismatch`] where the checkpoint is of another problem.
pub fn solve_kept(
    problem: &mut BundleProblem,
    options: &Options,
    from: Option<&Checkpoint>,
    keeper: &mut dyn Keeper,
    observer: &mut Observer<'_>,
) -> Result<BundleSummary, SolveError> {
    // Before the problem is changed.
    options.optimizer.validate()?;
    if let Some(from) = from {
        for (what, actual, expected) in [
            ("a checkpoint's poses", from.poses.len(), problem.poses.len()),
            ("a checkpoint's landmarks", from.landmarks.len(), problem.landmarks.len()),
            ("a checkpoint's cameras", from.cameras.len(), problem.cameras.len()),
        ] {
            if actual != expected {
                return Err(SolveError::LengthMismatch { what, actual, expected });
            }
        }
        problem.poses.clone_from(&from.poses);
        problem.landmarks.clone_from(&from.landmarks);
        problem.cameras.clone_from(&from.cameras);
    }
    run(problem, options, &Interrupt::NEVER, from, Some(keeper), observer)
}

/// At least what [`solve`] takes with any solver that [`LinearSolver::Auto`] would choose, in the time
/// of one pass over the observations: for telling small problems from others.
#[must_use]
pub fn price_bound(problem: &BundleProblem) -> Price {
    let mut lengths = vec![0_u64; problem.landmarks.len()];
    // A landmark pairs the views with unknowns; those that only hold it cost no more than their observations.
    let is_free = |constant: &[bool], index: u32| constant.get(index as usize) != Some(&true);
    for observation in problem.observations() {
        let pose_is_free = is_free(&problem.constant_poses, observation.pose);
        if (pose_is_free || is_free(&problem.constant_cameras, observation.camera))
            && let Some(length) = lengths.get_mut(observation.landmark as usize)
        {
            *length += 1;
        }
    }
    let pairs: u64 = lengths.iter().map(|k| k.saturating_mul(k.saturating_sub(1)) / 2).sum();
    let observations = problem.observation_count() as u64;
    let variables = problem.poses.len() + problem.landmarks.len() + problem.cameras.len();
    let blocks = problem.constant_poses.iter().filter(|&&constant| !constant).count()
        + problem.constant_cameras.iter().filter(|&&constant| !constant).count();
    // A pose with a camera of its own has up to this many unknowns.
    let dimension = 15.0 * blocks as f64;
    let bytes = 16.0 * dimension * dimension
        + 2200.0 * pairs as f64
        + 1000.0 * observations as f64
        + 4000.0 * variables as f64
        + 1e6;
    let flops_per_iteration =
        1500.0 * observations as f64 + 1400.0 * pairs as f64 + dimension.powi(3) / 3.0;
    Price { bytes: bytes as u64, flops_per_iteration }
}
