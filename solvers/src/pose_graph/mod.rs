//! Pose-graph optimization: poses of one group, and landmarks, from relative measurements.
//!
//! Minimizes ½ Σ ρ(rᵀΩr), r = Log(Z⁻¹ · X_i⁻¹ · X_j), and the cost of priors, measured landmarks and ranges
//! over the poses and landmarks that are not constant. The normal equations are block-sparse with one
//! block row a pose and a landmark; Gauss-Newton or
//! Levenberg-Marquardt steps come from their Cholesky factorization. This file holds the facade;
//! [`crate::evaluation`] computes the same cost without anything from here.
//!
//! | file | role |
//! |---|---|
//! | `assembly`, `system` | normal equations; the graph as the loop sees it |
//! | `rows` | which block row each variable has |
//! | `priors`, `landmarks`, `ranges` | what priors, measured landmarks and ranges add |
//! | `growing` | a graph that is at a minimum after each update |
//! | `undetermined` | poses that the factors leave open, and in which directions |
//! | `covariance` | of points that are measured |

mod assembly;
mod covariance;
mod growing;
mod landmarks;
mod priors;
mod ranges;
mod rows;
mod system;
mod undetermined;

use std::time::Instant;

pub use covariance::position_covariances;
pub use growing::{GrowingPoseGraph, Growth};
pub(crate) use priors::cost;
use system::PoseGraphSystem;
pub use undetermined::{Undetermined, undetermined};

use crate::geometry::LieGroup;
use crate::interrupt::Interrupt;
use crate::optimizer::{self, Observer, SolveSummary, Unmoved, minimize, with_threads};
use crate::price::{Limits, Price};
use crate::problem::{PoseGraph, SolveError, dimension_of_space};

/// Options of a pose-graph solve.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Options {
    /// Method, limits, tolerances, threads. Pose graphs are close to quadratic once rotations are
    /// right: the damping starts near zero (1e-10), and a bad start costs a few rejected steps.
    pub optimizer: optimizer::Options,
}

impl Default for Options {
    fn default() -> Self {
        Self {
            optimizer: optimizer::Options {
                initial_damping: 1e-10,
                ..optimizer::Options::default()
            },
        }
    }
}

/// Optimizes the poses of `graph` in place.
///
/// Gauge: priors fix the frame. Where there are none and no pose is constant, the one with the lowest
/// id is held fixed and stays marked in [`PoseGraph::constant`], so that the caller can see it. The
/// graph is left at the best state found, whatever the termination; a pose that the factors do not
/// determine stays near its start in the directions that [`undetermined`] names. The result has the
/// same bits at any number of threads. `observer` sees each iteration and may cancel; seconds count
/// from the call.
///
/// # Errors
/// A [`SolveError`] where the problem cannot be solved as posed: those of
/// [`PoseGraph::validate`] and [`optimizer::Options::validate`], [`SolveError::Empty`] where every
/// pose is constant, [`SolveError::ResidualNotFinite`], [`SolveError::Threads`].
pub fn solve<G: LieGroup<N>, const N: usize>(
    graph: &mut PoseGraph<G, N>,
    options: &Options,
    observer: &mut Observer<'_>,
) -> Result<SolveSummary, SolveError> {
    solve_until(graph, options, &Interrupt::NEVER, observer)
}

/// As [`solve`], ending once `interrupt` is due as well: within an iteration, at the best state so
/// far. Where it is due before the first, the start is the answer.
///
/// # Errors
/// As [`solve`].
pub fn solve_until<G: LieGroup<N>, const N: usize>(
    graph: &mut PoseGraph<G, N>,
    options: &Options,
    interrupt: &Interrupt,
    observer: &mut Observer<'_>,
) -> Result<SolveSummary, SolveError> {
    let start = Instant::now();
    options.optimizer.validate()?;
    graph.validate()?;
    graph.hold_gauge();
    if !graph.constant.contains(&false) && !graph.landmarks.constant.contains(&false) {
        return Err(SolveError::Empty("every pose is constant"));
    }
    with_threads(options.optimizer.threads, || {
        let interrupt = interrupt.or_after(start, options.optimizer.deadline);
        let limits = Limits { ceiling: options.optimizer.ceiling, interrupt: &interrupt };
        let options = &options.optimizer;
        match PoseGraphSystem::new(graph, limits) {
            Ok(mut system) => Ok(minimize(&mut system, options, start, &interrupt, None, observer)),
            Err(SolveError::Interrupted) => {
                let mut unmoved = Unmoved(cost(graph, &Interrupt::NEVER));
                Ok(minimize(&mut unmoved, options, start, &interrupt, None, observer))
            }
            Err(error) => Err(error),
        }
    })?
}

/// At least what [`solve`] takes, whatever the edges tie together: for telling small graphs from
/// others.
#[must_use]
pub fn price_bound<G: LieGroup<N>, const N: usize>(graph: &PoseGraph<G, N>) -> Price {
    let landmarks = dimension_of_space(N) * graph.landmarks.len();
    let dimension = (N * graph.poses.len() + landmarks) as f64;
    let edges =
        (graph.edges.len() + graph.landmarks.measurements.len() + graph.ranges.len()) as f64;
    let bytes = 16.0 * dimension * dimension + 3000.0 * edges + 1000.0 * dimension;
    let flops_per_iteration = dimension.powi(3) / 3.0 + (40 * N * N) as f64 * edges;
    Price { bytes: bytes as u64, flops_per_iteration }
}
