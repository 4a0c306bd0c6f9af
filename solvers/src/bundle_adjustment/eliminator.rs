//! Elimination of the landmarks, for one size of view and observation.
//!
//! What depends on how many columns a view has and how many rows an observation is compiled for each size and
//! is hidden behind [`Eliminator`]; everything else is compiled once. Chunks run side by side on the thread
//! pool. It knows neither the loop nor how the reduced system is solved.

use super::accumulate::{Accumulate, ChunkSums};
use super::back_substitute::{BackSubstitute, Cost, StepSums};
use super::blocks::ViewVector;
use super::covisible::ChunkPairs;
use super::inner_iterations::{InnerIterations, POINT};
use super::iterative::{Iterative, Linearization, gather, split_groups};
use super::landmarks::LandmarkGroup;
use super::layout::Layout;
use super::observe::{Inputs, Model};
use super::price::Costs;
use super::reduce::{ReducedVectors, Reduction};
use super::sorted::{GROUPS, split};
use crate::geometry::Camera;
use crate::interrupt::Interrupt;
use crate::linear::{BlockMatrix, LinearError, Solved};
use crate::parallel;
use crate::problem::BundleProblem;
use crate::simd::Class;

/// What a pass over all observations reads.
#[derive(Clone, Copy)]
pub(super) struct Pass<'a> {
    pub(super) inputs: Inputs<'a>,
    pub(super) layout: &'a Layout,
    pub(super) class: Class,
    pub(super) interrupt: &'a Interrupt,
}

/// Passes over all observations, and what they keep by view.
pub(super) trait Eliminator: Send {
    /// Linearizes and eliminates the landmarks for a damping; `groups` receives what
    /// [`Self::back_substitute`] needs of them.
    fn eliminate(
        &mut self,
        pass: &Pass<'_>,
        pairs: Option<&[ChunkPairs]>,
        damping: f64,
        groups: &mut [LandmarkGroup],
    );

    /// Whether each landmark's block was positive definite, and the largest norm of a landmark's
    /// gradient, in the last elimination.
    fn landmarks(&self) -> (bool, f64);

    /// The reduced system of the last elimination.
    fn reduce(
        &self,
        pass: &Pass<'_>,
        reduction: &Reduction,
        reduced: &mut BlockMatrix,
        vectors: &mut ReducedVectors,
    );

    /// Solves the reduced system of the last elimination by conjugate gradients, of which
    /// `diagonal` has the diagonal blocks.
    ///
    /// # Errors
    /// As [`Iterative::solve`].
    fn solve(
        &mut self,
        linearization: &Linearization<'_>,
        diagonal: &BlockMatrix,
        right: &[f64],
        step: &mut [f64],
    ) -> Result<Solved, LinearError>;

    /// Landmark steps for a step of the reduced system, and what they add to the step's figures.
    /// Takes damping and groups of the last elimination, and the first unknown of each block with the
    /// step.
    fn back_substitute(
        &mut self,
        pass: &Pass<'_>,
        damping: f64,
        groups: &[LandmarkGroup],
        offsets: &[usize],
        step: &[f64],
        point_steps: &mut [f64],
    ) -> StepSums;
}

/// The passes of a problem.
#[derive(Clone, Copy)]
pub(super) struct Kernels {
    pub(super) model: Model,
    /// What a solve takes.
    pub(super) costs: fn(&BundleProblem, &Layout) -> Costs,
    /// Makes an eliminator, for conjugate gradients where there are no pairs.
    pub(super) eliminator: fn(&Layout, Option<&[ChunkPairs]>) -> Box<dyn Eliminator>,
    /// ½ Σ ρ(r²) of the observations.
    pub(super) cost: fn(&Pass<'_>) -> f64,
    /// Minimizes the landmarks, four numbers each, at the poses and cameras as they are.
    pub(super) minimize_landmarks: fn(&Pass<'_>, &mut [f64]),
}

impl Kernels {
    /// Picks them: how many columns a view has, how many rows an observation, which model.
    pub(super) fn of(problem: &BundleProblem, layout: &Layout) -> Self {
        let all = |is: fn(&Camera) -> bool| problem.cameras.iter().all(is);
        let depth = !problem.depth_reprojections.is_empty();
        let known = layout.camera_unknowns == 0;
        let model = if !layout.is_restricted && all(|c| matches!(c, Camera::Snavely(_))) {
            Model::Snavely
        } else if known && all(|c| matches!(c, Camera::Pinhole(_))) {
            Model::Pinhole
        } else {
            Model::Any
        };
        match (known, depth) {
            (true, false) => Self::sized::<6, 1, 0, 2>(model),
            (true, true) => Self::sized::<6, 1, 0, 3>(model),
            (false, false) if layout.camera_unknowns <= 3 => Self::sized::<9, 1, 1, 2>(model),
            (false, false) => Self::sized::<15, 2, 0, 2>(model),
            (false, true) => Self::sized::<15, 2, 0, 3>(model),
        }
    }

    fn sized<const D: usize, const V: usize, const T: usize, const R: usize>(model: Model) -> Self {
        Self {
            model,
            costs: Costs::of::<D, V, T, R>,
            eliminator: |layout, pairs| Box::new(Sized::<D, V, T, R>::new(layout, pairs)),
            cost: cost::<R>,
            minimize_landmarks: minimize_landmarks::<R>,
        }
    }
}

/// D columns a view in V vectors and T tails, R rows an observation.
struct Sized<const D: usize, const V: usize, const T: usize, const R: usize> {
    sums: Vec<ChunkSums<D, V, T, R>>,
    view_steps: Vec<ViewVector<V, T>>,
    /// Where the reduced system is not formed.
    iterative: Option<Iterative<D, V, T, R>>,
}

impl<const D: usize, const V: usize, const T: usize, const R: usize> Sized<D, V, T, R> {
    fn new(layout: &Layout, pairs: Option<&[ChunkPairs]>) -> Self {
        let chunks = layout.chunks().iter().enumerate();
        Self {
            sums: parallel::map(chunks, |(i, chunk)| {
                ChunkSums::new(layout, chunk, pairs.map(|pairs| &pairs[i]))
            }),
            view_steps: vec![ViewVector::ZERO; layout.views.len()],
            iterative: pairs.is_none().then(|| Iterative::new(layout)),
        }
    }
}

impl<const D: usize, const V: usize, const T: usize, const R: usize> Eliminator
    for Sized<D, V, T, R>
{
    fn eliminate(
        &mut self,
        pass: &Pass<'_>,
        pairs: Option<&[ChunkPairs]>,
        damping: f64,
        groups: &mut [LandmarkGroup],
    ) {
        let Pass { inputs, layout, class, interrupt } = *pass;
        let pieces = split_groups(layout, groups);
        let chunks = layout.chunks().iter().enumerate().zip(&mut self.sums).zip(pieces);
        parallel::for_each(chunks, |(((i, chunk), sums), groups)| {
            let pairs = pairs.map(|pairs| &pairs[i]);
            inputs.run(
                class,
                Accumulate::<D, V, T, R> {
                    inputs,
                    layout,
                    chunk,
                    pairs,
                    damping,
                    interrupt,
                    sums,
                    groups,
                },
            );
        });
    }

    fn landmarks(&self) -> (bool, f64) {
        let norms = self.sums.iter().map(|s| s.gradient_max_norm);
        (self.sums.iter().all(|s| s.positive_definite), norms.fold(0.0, f64::max))
    }

    fn reduce(
        &self,
        pass: &Pass<'_>,
        reduction: &Reduction,
        reduced: &mut BlockMatrix,
        vectors: &mut ReducedVectors,
    ) {
        reduction.sum(pass.layout, &self.sums, reduced, vectors, pass.interrupt);
    }

    fn solve(
        &mut self,
        linearization: &Linearization<'_>,
        diagonal: &BlockMatrix,
        right: &[f64],
        step: &mut [f64],
    ) -> Result<Solved, LinearError> {
        let layout = linearization.pass.layout;
        let iterative = self.iterative.get_or_insert_with(|| Iterative::new(layout));
        iterative.solve(linearization, diagonal, right, step)
    }

    fn back_substitute(
        &mut self,
        pass: &Pass<'_>,
        damping: f64,
        groups: &[LandmarkGroup],
        offsets: &[usize],
        step: &[f64],
        point_steps: &mut [f64],
    ) -> StepSums {
        let Pass { inputs, layout, class, interrupt } = *pass;
        gather(layout, offsets, step, &mut self.view_steps);
        let view_steps = &self.view_steps;
        let pieces = split_points(layout, point_steps);
        let sums = parallel::map(layout.chunks().iter().zip(pieces), |(chunk, steps)| {
            let groups = &groups[chunk.tiles.start * GROUPS..chunk.tiles.end * GROUPS];
            inputs.run(
                class,
                BackSubstitute::<D, V, T, R> {
                    inputs,
                    layout,
                    chunk,
                    damping,
                    view_steps,
                    groups,
                    steps,
                    interrupt,
                },
            )
        });
        sums.iter().fold(StepSums::default(), |a, b| StepSums {
            decrease: a.decrease + b.decrease,
            squared: a.squared + b.squared,
        })
    }
}

fn cost<const R: usize>(pass: &Pass<'_>) -> f64 {
    let Pass { inputs, layout, class, .. } = *pass;
    let chunks = layout.chunks().iter();
    let sums = parallel::map(chunks, |chunk| class.run(Cost::<R> { inputs, chunk }));
    sums.iter().sum()
}

fn minimize_landmarks<const R: usize>(pass: &Pass<'_>, points: &mut [f64]) {
    let Pass { inputs, layout, class, interrupt } = *pass;
    let pieces = split_points(layout, points);
    parallel::for_each(layout.chunks().iter().zip(pieces), |(chunk, points)| {
        class.run(InnerIterations::<R> { inputs, layout, chunk, points, interrupt });
    });
}

/// The landmarks of each chunk, four numbers each.
fn split_points<'a>(layout: &Layout, points: &'a mut [f64]) -> Vec<&'a mut [f64]> {
    split(points, layout.chunks().iter().map(|chunk| chunk.landmarks.len() * POINT))
}
