//! Bundle adjustment as the trust-region loop sees it.
//!
//! One fused pass linearizes and eliminates for a damping at once; another damping at the same state
//! runs it again, since nothing of the size of the observations is kept.

use nalgebra::{SVector, Vector3};
use rayon::prelude::*;

use super::LinearSolver;
use super::accumulate::{Accumulate, ChunkSums, Column, LandmarkRecord, damping_scale};
use super::back_substitute::{BackSubstitute, Cost, StepSums};
use super::covisible::{ChunkPairs, covisible_pairs};
use super::layout::{Layout, NO_BLOCK};
use super::models::LaneModel;
use super::observe::{Inputs, ViewRecord, view_record};
use super::pose_factors;
use super::reduce::{ReducedVectors, Reduction};
use super::reduced_solver::{ReducedSolver, Solved, choose};
use crate::geometry::{Camera, LieGroup, Se3};
use crate::linear::BlockMatrix;
use crate::optimizer::{Gradient, Step, StepFailure, System};
use crate::problem::{BundleProblem, SolveError};
use crate::simd::{Class, WIDTH};

/// D columns a view in Q vectors, R rows an observation, camera model M.
pub(super) struct BundleSystem<'a, M, const D: usize, const Q: usize, const R: usize> {
    problem: &'a mut BundleProblem,
    layout: &'a Layout,
    model: M,
    class: Class,
    linear_solver: LinearSolver,
    offsets: Vec<usize>,
    pairs: Vec<ChunkPairs>,
    reduction: Reduction,
    view_records: Vec<ViewRecord>,
    // The elimination for `eliminated_for`.
    sums: Vec<ChunkSums<D, Q>>,
    records: Vec<LandmarkRecord>,
    reduced: BlockMatrix,
    vectors: ReducedVectors,
    eliminated_for: Option<f64>,
    // The step.
    solver: ReducedSolver,
    step: Vec<f64>,
    view_steps: Vec<Column<Q>>,
    landmark_steps: Vec<Vector3<f64>>,
    backup: Values,
}

/// The variables before a trial step.
#[derive(Default)]
struct Values {
    poses: Vec<Se3>,
    cameras: Vec<Camera>,
    landmarks: Vec<Vector3<f64>>,
}

/// Cuts `values` into consecutive pieces of the given lengths.
fn split<T>(mut values: &mut [T], lengths: impl Iterator<Item = usize>) -> Vec<&mut [T]> {
    let mut pieces = Vec::new();
    for length in lengths {
        let (head, tail) = values.split_at_mut(length);
        pieces.push(head);
        values = tail;
    }
    pieces
}

impl<'a, M: LaneModel, const D: usize, const Q: usize, const R: usize>
    BundleSystem<'a, M, D, Q, R>
{
    pub(super) fn new(
        problem: &'a mut BundleProblem,
        layout: &'a Layout,
        model: M,
        (wish, class): (LinearSolver, Class),
    ) -> Result<Self, SolveError> {
        let pairs = covisible_pairs(layout, &problem.constant_landmarks);
        let (linear_solver, pattern, solver) = choose(problem, layout, &pairs, wish)?;
        let dimension = pattern.dimension();
        let count = problem.landmarks.len();
        Ok(Self {
            model,
            class,
            linear_solver,
            offsets: (0..pattern.block_count()).map(|b| pattern.offset(b)).collect(),
            reduction: Reduction::new(layout, &pairs, &pattern),
            view_records: Vec::new(),
            sums: pairs.par_iter().map(|p| ChunkSums::new(layout, p)).collect(),
            records: vec![LandmarkRecord::default(); count],
            reduced: BlockMatrix::new(pattern),
            vectors: ReducedVectors::new(dimension),
            eliminated_for: None,
            solver,
            step: vec![0.0; dimension],
            view_steps: vec![[[0.0; WIDTH]; Q]; layout.views.len()],
            landmark_steps: vec![Vector3::zeros(); count],
            backup: Values::default(),
            pairs,
            problem,
            layout,
        })
    }

    pub(super) fn linear_solver(&self) -> LinearSolver {
        self.linear_solver
    }

    fn fill_view_records(&mut self) {
        let (poses, cameras) = (&self.problem.poses, &self.problem.cameras);
        let record = |v: &super::layout::View| {
            view_record(&poses[v.pose as usize], &cameras[v.camera as usize])
        };
        self.view_records.clear();
        self.view_records.extend(self.layout.views.iter().map(record));
    }

    fn inputs(&self) -> Inputs<'_, M> {
        Inputs {
            sorted: &self.layout.sorted,
            records: &self.view_records,
            cameras: &self.problem.cameras,
            landmarks: &self.problem.landmarks,
            loss: self.problem.observation_loss,
            model: self.model,
        }
    }

    /// The fused pass over all chunks and the reduced system, for `damping`.
    fn eliminate(&mut self, damping: f64) {
        self.fill_view_records();
        let mut sums = std::mem::take(&mut self.sums);
        let mut records = std::mem::take(&mut self.records);
        let inputs = self.inputs();
        let (layout, class) = (self.layout, self.class);
        let constant = &self.problem.constant_landmarks;
        let pieces = split(&mut records, layout.chunks.iter().map(|c| c.landmarks.len()));
        layout.chunks.par_iter().zip(&self.pairs).zip(&mut sums).zip(pieces).for_each(
            |(((chunk, pairs), sums), records)| {
                class.run(Accumulate::<M, D, Q, R> {
                    inputs,
                    layout,
                    constant,
                    chunk,
                    pairs,
                    damping,
                    sums,
                    records,
                });
            },
        );
        self.reduction.sum(layout, &sums, &mut self.reduced, &mut self.vectors);
        self.sums = sums;
        self.records = records;
        let diagonal_before = pose_factors::has_any(self.problem).then(|| self.reduced.diagonal());
        if let Some(before) = diagonal_before {
            let gradient = &mut self.vectors.gradient;
            pose_factors::linearize(self.problem, layout, &mut self.reduced, gradient);
            let after = self.reduced.diagonal();
            for (entry, (b, a)) in self.vectors.diagonal.iter_mut().zip(before.iter().zip(after)) {
                *entry += a - b;
            }
        }
        self.eliminated_for = Some(damping);
    }

    fn backup_values(&mut self) {
        self.backup.poses.clone_from(&self.problem.poses);
        self.backup.cameras.clone_from(&self.problem.cameras);
        self.backup.landmarks.clone_from(&self.problem.landmarks);
    }

    /// Landmark steps for the reduced step, and what they add to the step's figures.
    fn back_substitute(&mut self, damping: f64) -> StepSums {
        for (view, delta) in self.layout.views.iter().zip(&mut self.view_steps) {
            let flat = delta.as_flattened_mut();
            flat.fill(0.0);
            for part in &view.parts {
                let offset = self.offsets[part.block as usize];
                let source = &self.step[offset..offset + part.size];
                flat[part.column..part.column + part.size].copy_from_slice(source);
            }
        }
        let mut steps = std::mem::take(&mut self.landmark_steps);
        let inputs = self.inputs();
        let (layout, class) = (self.layout, self.class);
        let lengths = || layout.chunks.iter().map(|c| c.landmarks.len());
        let pieces = split(&mut steps, lengths());
        let view_steps = &self.view_steps;
        let constant = &self.problem.constant_landmarks;
        let sums: Vec<StepSums> = layout
            .chunks
            .par_iter()
            .zip(pieces)
            .map(|(chunk, steps)| {
                let records = &self.records[chunk.landmarks.clone()];
                class.run(BackSubstitute::<M, D, Q, R> {
                    inputs,
                    layout,
                    constant,
                    chunk,
                    damping,
                    view_steps,
                    records,
                    steps,
                })
            })
            .collect();
        self.landmark_steps = steps;
        sums.iter().fold(StepSums::default(), |a, b| StepSums {
            decrease: a.decrease + b.decrease,
            squared: a.squared + b.squared,
        })
    }

    /// The norm that a step is measured against: positions of poses and landmarks.
    fn state_norm(&self) -> f64 {
        let poses: f64 =
            self.problem.poses.iter().map(|p| p.translation.norm_squared() + 1.0).sum();
        let landmarks: f64 = self.problem.landmarks.iter().map(|l| l.norm_squared()).sum();
        (poses + landmarks).sqrt()
    }
}

impl<M: LaneModel, const D: usize, const Q: usize, const R: usize> System
    for BundleSystem<'_, M, D, Q, R>
{
    fn cost(&mut self) -> f64 {
        self.fill_view_records();
        let inputs = self.inputs();
        let class = self.class;
        let chunks = self.layout.chunks.par_iter();
        let sums: Vec<f64> =
            chunks.map(|chunk| class.run(Cost::<M, R> { inputs, chunk })).collect();
        sums.iter().sum::<f64>() + pose_factors::cost(self.problem)
    }

    fn linearize(&mut self, damping: f64) -> Gradient {
        self.eliminate(damping);
        let mut max_norm = self.sums.iter().map(|s| s.gradient_max_norm).fold(0.0, f64::max);
        for (gradient, diagonal) in self.vectors.gradient.iter().zip(&self.vectors.diagonal) {
            max_norm = f64::max(max_norm, gradient.abs() / damping_scale(*diagonal).sqrt());
        }
        Gradient { max_norm }
    }

    fn solve(&mut self, damping: f64) -> Result<Step, StepFailure> {
        if self.eliminated_for != Some(damping) {
            self.eliminate(damping);
        }
        if self.sums.iter().any(|s| !s.positive_definite) {
            return Err(StepFailure);
        }
        let vectors = &self.vectors;
        let added: Vec<f64> =
            vectors.diagonal.iter().map(|d| damping * damping_scale(*d)).collect();
        let right: Vec<f64> =
            vectors.gradient.iter().zip(&vectors.eliminated).map(|(g, e)| e - g).collect();
        let mut solved = Solved { linear_residual: 0.0, is_inexact: false };
        if !right.is_empty() {
            solved = self
                .solver
                .solve(&self.reduced, &added, &right, &mut self.step)
                .map_err(|_error| StepFailure)?;
        }
        let mut sums = self.back_substitute(damping);
        for ((delta, added), gradient) in self.step.iter().zip(&added).zip(&self.vectors.gradient) {
            sums.decrease += delta * (added * delta - gradient);
            sums.squared += delta * delta;
        }
        let figures = [sums.decrease, sums.squared, solved.linear_residual];
        if !figures.iter().all(|x| x.is_finite()) {
            return Err(StepFailure);
        }
        Ok(Step {
            predicted_decrease: 0.5 * sums.decrease,
            norm: sums.squared.sqrt(),
            state_norm: self.state_norm(),
            linear_residual: solved.linear_residual,
            is_inexact: solved.is_inexact,
        })
    }

    fn apply(&mut self) -> f64 {
        self.backup_values();
        let problem = &mut *self.problem;
        for (pose, &block) in problem.poses.iter_mut().zip(&self.layout.pose_block) {
            if block != NO_BLOCK {
                let offset = self.offsets[block as usize];
                *pose = pose.plus(&SVector::from_column_slice(&self.step[offset..offset + 6]));
            }
        }
        for (camera, &(block, column)) in problem.cameras.iter_mut().zip(&self.layout.camera_block)
        {
            if block != NO_BLOCK {
                let offset = self.offsets[block as usize] + column;
                camera.plus_parameters(&self.step[offset..offset + camera.parameter_count()]);
            }
        }
        for (&landmark, delta) in self.layout.order.iter().zip(&self.landmark_steps) {
            problem.landmarks[landmark as usize] += delta;
        }
        self.eliminated_for = None;
        self.cost()
    }

    fn restore(&mut self) {
        std::mem::swap(&mut self.problem.poses, &mut self.backup.poses);
        std::mem::swap(&mut self.problem.cameras, &mut self.backup.cameras);
        std::mem::swap(&mut self.problem.landmarks, &mut self.backup.landmarks);
        self.eliminated_for = None;
    }
}
