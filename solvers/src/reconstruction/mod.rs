//! Structure from motion: poses and points from observations alone.
//!
//! [`reconstruct`] takes a [`BundleProblem`] and reads of it the cameras, the observations and the relative
//! poses; the values of its poses and landmarks are not a start and not looked at, but for the frame where
//! [`Frame::Given`] asks for it. It is the global approach, in which no keyframe comes first:
//!
//! 1. `view_graph`: which pairs of keyframes share landmarks, and which of them are worth measuring.
//! 2. `relative_poses`: their relative rotations, by `two_views` (essential matrices over `five_point`
//!    samples) or, with depth, by `resection` (P3P), each with its information.
//! 3. `rotations`: rotation averaging with a robust loss; edges that contradict the rest go.
//! 4. `positions`: centers of cameras and points together, from the rays.
//! 5. `points` and bundle adjustment in turns, with a gate that narrows, then keyframes that are still
//!    without a pose by `resection` to the points.
//! 6. Keyframes that only relative poses reach are placed by composing these, as a last resort.
//! 7. `frame`: scale and frame.
//!
//! What could not be placed is an outcome, named for each keyframe ([`Unplaced`]), as is an end before the
//! time. Bits do not depend on the number of threads. A caller takes the result over with
//! [`Reconstruction::apply_to`], which leaves a problem of what agrees.
//!
//! | file | role |
//! |---|---|
//! | `pipeline`, `refinement` | the order of the stages, the clock, the reasons |
//! | `bearings` | observations as rays |
//! | `view_graph` | pairs that are worth measuring |
//! | `relative_poses`, `two_views`, `five_point`, `real_roots` | relative poses from rays |
//! | `resection` | a pose from points |
//! | `rotations`, `positions` | rotation averaging, global positioning |
//! | `points`, `adjustment` | points and bundle adjustment in turns |
//! | `frame` | scale and frame |

mod adjustment;
mod bearings;
mod five_point;
mod frame;
mod pipeline;
mod points;
mod positions;
mod real_roots;
mod refinement;
mod relative_poses;
mod resection;
mod rotations;
mod two_views;
mod view_graph;

use std::sync::Arc;

use nalgebra::{Matrix3x2, Vector3};

use crate::bundle_adjustment::{BundleSummary, LinearSolver};
use crate::geometry::{Camera, Se3};
use crate::interrupt::{Interrupt, Interruption};
use crate::linear::{BlockPattern, Cholesky, LinearError};
use crate::optimizer::{self, Control, from_linear, with_threads};
use crate::price::Limits;
use crate::problem::{BundleProblem, SolveError};

/// Rays of two keyframes that differ by less than this, in standard deviations of a pair, show no
/// baseline.
const LEAST_PARALLAX_SIGMAS: f64 = 3.0;

/// How a reconstruction is made; each field with its default.
#[derive(Clone, Debug, PartialEq)]
pub struct Options {
    /// Fewest landmarks in common of a pair that is measured, and fewest that must agree (8).
    pub min_common: usize,
    /// Neighbors that a keyframe is measured against, about (12). More make it surer and slower.
    pub max_neighbors: usize,
    /// Fewest observations that hold a keyframe (6).
    pub min_observations: usize,
    /// Standard deviations may be too small by this factor, at least 1 (2).
    pub sigma_allowance: f64,
    /// Least angle between two rays of a landmark without depth, rad (0.5 degrees).
    pub min_parallax_rad: f64,
    /// The frame of the result ([`Frame::Own`]).
    pub frame: Frame,
    /// Of all random numbers (0).
    pub seed: u64,
    /// Of each bundle adjustment; the deadline is that of all together.
    pub optimizer: optimizer::Options,
    /// Of each bundle adjustment.
    pub linear_solver: LinearSolver,
}

impl Default for Options {
    fn default() -> Self {
        Self {
            min_common: 8,
            max_neighbors: 12,
            min_observations: 6,
            sigma_allowance: 2.0,
            min_parallax_rad: 0.5_f64.to_radians(),
            frame: Frame::Own,
            seed: 0,
            optimizer: optimizer::Options::default(),
            linear_solver: LinearSolver::Auto,
        }
    }
}

/// The frame that a reconstruction is told in.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Frame {
    /// The placed keyframe with the lowest index is the origin.
    #[default]
    Own,
    /// That of the problem's poses: the reconstruction is turned and shifted as a whole to lie nearest to
    /// them, and scaled where no length is measured. Some of them may be wrong.
    Given,
}

/// What the unit of length is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Scale {
    /// The meter, by measured depths.
    Depth,
    /// The meter, by the lengths of relative poses.
    RelativePoses,
    /// That of the problem's poses ([`Frame::Given`]).
    Given,
    /// None is measured: the median depth of the observations is 1.
    Convention,
}

impl Scale {
    /// For reports.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Depth => "meters, by measured depths",
            Self::RelativePoses => "meters, by relative poses",
            Self::Given => "that of the given poses",
            Self::Convention => "the median depth is 1",
        }
    }
}

/// How a keyframe came to its pose.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Placement {
    /// By what it sees.
    Views,
    /// By relative poses to keyframes that are placed: what it sees does not tell.
    RelativePoses,
    /// It has none.
    Unplaced(Unplaced),
}

/// Why a keyframe has no pose.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum Unplaced {
    /// It observes no landmark, or none whose pixel has a ray.
    #[error("it has no observations")]
    NoObservations,
    /// It shares too few landmarks with every other keyframe.
    #[error("it shares at most {most} landmarks with another keyframe, {needed} are needed")]
    TooFewCommon {
        /// The most that it shares with one.
        most: usize,
        /// Fewest of a pair.
        needed: usize,
    },
    /// No other keyframe agrees with it on a relative pose.
    #[error(
        "none of {pairs} keyframes shares enough landmarks with it that agree on a relative pose"
    )]
    NoRelativePose {
        /// Pairs that were measured.
        pairs: usize,
    },
    /// It belongs to a smaller piece that nothing ties to the largest one.
    #[error("it is disconnected: it and {others} others share no landmarks with the rest")]
    Disconnected {
        /// Other keyframes of its piece.
        others: usize,
    },
    /// Its rays are those of its neighbors after a turn: without depth it cannot be told where it stands,
    /// nor where the points are.
    #[error("it turned without moving from its neighbors: nothing has parallax")]
    NoParallax,
    /// Too few of its observations agree with the points that others see.
    #[error("{agreeing} of its observations agree with the placed landmarks, {needed} are needed")]
    Inconsistent {
        /// Those that agree.
        agreeing: usize,
        /// Fewest.
        needed: usize,
    },
    /// The time was up, or the caller left, before it was placed.
    #[error("the time limit passed")]
    Interrupted,
}

/// A part of the work.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Stage {
    /// Counting common landmarks; steps are keyframes.
    ViewGraph,
    /// Steps are pairs.
    RelativePoses,
    /// Rotation averaging; steps are rounds, after each of which false edges go.
    Rotations,
    /// Global positioning; steps are iterations, the cost is that of the directions.
    Positions,
    /// Bundle adjustment with a gate that narrows; steps are iterations, the cost is that of its loss.
    Adjustment,
    /// Keyframes without a pose against the points; steps are keyframes that have one.
    Resection,
}

impl Stage {
    /// What it does, for reports.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::ViewGraph => "view graph",
            Self::RelativePoses => "relative poses",
            Self::Rotations => "rotations",
            Self::Positions => "positions",
            Self::Adjustment => "adjustment",
            Self::Resection => "resection",
        }
    }

    /// What its steps are, for reports.
    #[must_use]
    pub fn unit(self) -> &'static str {
        match self {
            Self::ViewGraph | Self::Resection => "keyframes",
            Self::RelativePoses => "pairs",
            Self::Rotations => "rounds",
            Self::Positions | Self::Adjustment => "iterations",
        }
    }
}

/// How far the work is.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Progress {
    /// What is being done.
    pub stage: Stage,
    /// Steps of the stage that are done.
    pub done: usize,
    /// Steps of the stage; of iterations, the most.
    pub total: usize,
    /// The stage's cost, where it has one.
    pub cost: Option<f64>,
    /// Since the beginning, s.
    pub seconds: f64,
}

/// Sees the progress and may cancel: the best state so far is then the answer.
pub type Observer<'a> = dyn FnMut(&Progress) -> Control + Send + 'a;

/// The view graph in numbers.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct ViewGraph {
    /// Pairs of keyframes with enough landmarks in common.
    pub pairs: usize,
    /// Pairs that were measured.
    pub measured: usize,
    /// Pairs whose landmarks agreed on a relative pose.
    pub edges: usize,
    /// Edges between keyframes of the largest piece that agree with its rotations.
    pub agreeing: usize,
}

/// The outcome of [`reconstruct`]; entries stand as in the problem.
#[derive(Clone, Debug, PartialEq)]
pub struct Reconstruction {
    /// How each keyframe came to its pose, or why it has none.
    pub placements: Vec<Placement>,
    /// `world_from_camera` of each keyframe that is placed.
    pub poses: Vec<Option<Se3>>,
    /// `point_in_world` of each landmark that is placed.
    pub landmarks: Vec<Option<Vector3<f64>>>,
    /// Intrinsics: those of the problem, refined where they are not constant.
    pub cameras: Vec<Camera>,
    /// Whether each observation (u, v) agrees.
    pub reprojections: Vec<bool>,
    /// Whether each observation (u, v, depth) agrees.
    pub depth_reprojections: Vec<bool>,
    /// The unit of length.
    pub scale: Scale,
    /// The view graph in numbers.
    pub view_graph: ViewGraph,
    /// The last bundle adjustment, over what agrees; `None` where there was nothing to adjust.
    pub adjustment: Option<BundleSummary>,
    /// Why it ended early; `None` where it came to its end.
    pub ended: Option<Interruption>,
    /// Seconds from the call to its return.
    pub seconds: f64,
}

impl Reconstruction {
    /// Puts poses, landmarks and cameras into the problem, as far as there are any, and removes the
    /// observations that do not agree or whose keyframe or landmark is not placed; returns how many.
    pub fn apply_to(&self, problem: &mut BundleProblem) -> usize {
        for (pose, placed) in problem.poses.iter_mut().zip(&self.poses) {
            *pose = placed.unwrap_or(*pose);
        }
        for (landmark, placed) in problem.landmarks.iter_mut().zip(&self.landmarks) {
            *landmark = placed.unwrap_or(*landmark);
        }
        problem.cameras.clone_from(&self.cameras);
        let before = problem.observation_count();
        let agrees = |flags: &[bool], k: usize| flags.get(k).copied().unwrap_or(false);
        problem.reprojections.retain(|k| agrees(&self.reprojections, k));
        problem.depth_reprojections.retain(|k| agrees(&self.depth_reprojections, k));
        before - problem.observation_count()
    }

    /// How many keyframes are placed.
    #[must_use]
    pub fn placed(&self) -> usize {
        self.poses.iter().flatten().count()
    }
}

/// Reconstructs `problem`'s poses and landmarks from its observations, until `interrupt` is due.
///
/// Constant flags of cameras hold, those of poses and landmarks do not. Priors are not used.
///
/// # Errors
/// Those of [`BundleProblem::validate`] and of [`crate::bundle_adjustment::solve`];
/// [`SolveError::InvalidOption`].
pub fn reconstruct(
    problem: &BundleProblem,
    options: &Options,
    interrupt: &Interrupt,
    observer: &mut Observer<'_>,
) -> Result<Reconstruction, SolveError> {
    options.validate()?;
    problem.validate()?;
    with_threads(options.optimizer.threads, || {
        pipeline::Run::new(problem, options, interrupt, observer).run()
    })?
}

impl Options {
    /// Checks every option's range.
    ///
    /// # Errors
    /// [`SolveError::InvalidOption`] names the first option that is out of range.
    pub fn validate(&self) -> Result<(), SolveError> {
        self.optimizer.validate()?;
        let angle = self.min_parallax_rad;
        for (field, is_valid, reason) in [
            ("min_common", self.min_common >= 6, "must be at least 6"),
            ("max_neighbors", self.max_neighbors >= 1, "must be at least 1"),
            ("min_observations", self.min_observations >= 4, "must be at least 4"),
            (
                "sigma_allowance",
                self.sigma_allowance >= 1.0 && self.sigma_allowance.is_finite(),
                "must be finite and at least 1",
            ),
            ("min_parallax_rad", (0.0..1.5).contains(&angle), "must be from 0 to 1.5"),
        ] {
            if !is_valid {
                return Err(SolveError::InvalidOption { field, reason });
            }
        }
        Ok(())
    }
}

/// What is known so far; entries stand as in the problem, flags as in [`bearings::Bearings`].
#[derive(Clone, Debug)]
struct Estimate {
    poses: Vec<Option<Se3>>,
    points: Vec<Option<Vector3<f64>>>,
    cameras: Vec<Camera>,
    /// Bearings that agree with pose and point.
    used: Vec<bool>,
}

/// Two unit vectors orthogonal to a unit vector and to each other.
fn tangent_basis(direction: &Vector3<f64>) -> Matrix3x2<f64> {
    let mut axis = Vector3::zeros();
    axis[direction.iamin()] = 1.0;
    let first = direction.cross(&axis).normalize();
    Matrix3x2::from_columns(&[first, direction.cross(&first)])
}

/// A factorization on a pattern; `None` where the interrupt is due.
///
/// # Errors
/// [`SolveError::TooExpensive`], [`SolveError::TooLarge`].
fn planned(
    pattern: &Arc<BlockPattern>,
    limits: Limits<'_>,
) -> Result<Option<Cholesky>, SolveError> {
    let dimension = pattern.dimension();
    match Cholesky::within(Arc::clone(pattern), limits.ceiling, limits.interrupt) {
        Ok(factor) => Ok(Some(factor)),
        Err(LinearError::Interrupted) => Ok(None),
        Err(error) => Err(from_linear(error, dimension)),
    }
}

/// The median, the upper one of two; 0 of nothing.
fn median(values: &mut [f64]) -> f64 {
    let middle = values.len() / 2;
    if values.is_empty() {
        return 0.0;
    }
    *values.select_nth_unstable_by(middle, f64::total_cmp).1
}
