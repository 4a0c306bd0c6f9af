//! Many poses at once: a task a problem, results in their order.
//!
//! Each problem is solved by [`refine`] on one thread, so that a batch gives the bits of its problems
//! one by one, on any number of threads.

use std::time::Instant;

use rayon::prelude::*;

use super::{Options, PointObservation, Prior, Refined, refine};
use crate::geometry::{Camera, Se3};
use crate::optimizer::{self, Control, IterationSummary, with_threads};
use crate::problem::SolveError;

/// One pose of a batch: what [`refine`] takes.
#[derive(Clone, Copy, Debug)]
pub struct PoseProblem<'a> {
    /// The camera.
    pub camera: &'a Camera,
    /// The start.
    pub world_from_camera: Se3,
    /// The landmarks that are seen.
    pub observations: &'a [PointObservation],
    /// What is expected of the pose.
    pub prior: Option<Prior>,
}

/// Sees every row of every problem, by the problem's index, and may cancel that problem. Called from
/// the workers.
pub type BatchObserver<'a> = dyn Fn(usize, &IterationSummary) -> Control + Sync + 'a;

/// Refines each of `problems` as [`refine`] does; entry k of the result belongs to problem k.
///
/// The deadline is the batch's: a problem whose turn comes later answers its start.
///
/// # Errors
/// [`SolveError`] where an option is invalid or the threads cannot be started; what is wrong with a
/// problem stands in its entry.
pub fn refine_batch(
    problems: &[PoseProblem<'_>],
    options: &Options,
    observer: &BatchObserver<'_>,
) -> Result<Vec<Result<Refined, SolveError>>, SolveError> {
    let start = Instant::now();
    options.validate()?;
    let solve = |(index, problem): (usize, &PoseProblem<'_>)| {
        let deadline = options.optimizer.deadline.map(|d| d.saturating_sub(start.elapsed()));
        let optimizer = optimizer::Options { deadline, ..options.optimizer };
        let PoseProblem { camera, world_from_camera, observations, prior } = problem;
        refine(
            camera,
            world_from_camera,
            observations,
            prior.as_ref(),
            &Options { optimizer, ..*options },
            &mut |row| observer(index, row),
        )
    };
    with_threads(options.optimizer.threads, || problems.par_iter().enumerate().map(solve).collect())
}
