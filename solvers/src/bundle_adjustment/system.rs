//! Bundle adjustment as the trust-region loop sees it.
//!
//! Keeps the linearization (H_ll, g_l, W, H_vv, g_v) so that another damping only eliminates again.

use std::sync::Arc;

use nalgebra::{SMatrix, SVector, Vector3};
use rayon::prelude::*;

use super::LinearSolver;
use super::landmarks::{self, ChunkOutput, LandmarkBlock, ViewBlock};
use super::layout::{Layout, NO_BLOCK};
use super::pose_factors;
use super::schur::{Eliminated, Elimination, damping_scale};
use crate::geometry::{Camera, LieGroup, Se3};
use crate::linear::{BlockMatrix, BlockPattern, Cholesky};
use crate::optimizer::{Gradient, Step, StepFailure, System};
use crate::problem::{BundleProblem, SolveError};

/// Reduced systems of at most so many unknowns are dense: their factorization is cheap anyway.
const DENSE_DIMENSION: usize = 300;

/// Fuller reduced systems than this are dense whatever their size.
const DENSE_FILL: f64 = 0.4;

pub(super) struct BundleSystem<'a, const D: usize> {
    problem: &'a mut BundleProblem,
    layout: Layout,
    offsets: Vec<usize>,
    linear_solver: LinearSolver,
    // The linearization.
    landmarks: Vec<LandmarkBlock>,
    cross: Vec<SMatrix<f64, D, 3>>,
    chunk_views: Vec<Vec<ViewBlock<D>>>,
    hessian: BlockMatrix,
    gradient: Vec<f64>,
    scale: Vec<f64>,
    // The elimination for the last damping, and its step.
    eliminated: Vec<Eliminated>,
    whitened: Vec<SMatrix<f64, D, 3>>,
    reduced: BlockMatrix,
    cholesky: Cholesky,
    step: Vec<f64>,
    landmark_steps: Vec<Vector3<f64>>,
    backup: Option<Values>,
}

/// The variables before a trial step.
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

impl<'a, const D: usize> BundleSystem<'a, D> {
    pub(super) fn new(
        problem: &'a mut BundleProblem,
        layout: Layout,
        linear_solver: LinearSolver,
    ) -> Result<Self, SolveError> {
        let sizes = layout.block_sizes.clone();
        let dimension: usize = sizes.iter().sum();
        let sparse = || {
            let mut pairs = pose_factors::block_pairs(problem, &layout);
            push_covisible_pairs(&layout, &problem.constant_landmarks, &mut pairs);
            BlockPattern::new(sizes.clone(), pairs)
        };
        let (linear_solver, pattern) = match linear_solver {
            LinearSolver::DenseSchur => (LinearSolver::DenseSchur, BlockPattern::full(sizes)),
            LinearSolver::SparseSchur => (LinearSolver::SparseSchur, sparse()),
            LinearSolver::Auto if dimension <= DENSE_DIMENSION => {
                (LinearSolver::DenseSchur, BlockPattern::full(sizes))
            }
            LinearSolver::Auto => {
                let pattern = sparse();
                if pattern.density() > DENSE_FILL {
                    (LinearSolver::DenseSchur, BlockPattern::full(sizes))
                } else {
                    (LinearSolver::SparseSchur, pattern)
                }
            }
        };
        let pattern = Arc::new(pattern);
        let cholesky = match linear_solver {
            LinearSolver::SparseSchur => Cholesky::sparse(Arc::clone(&pattern)),
            LinearSolver::DenseSchur | LinearSolver::Auto => Cholesky::dense(Arc::clone(&pattern)),
        }
        .map_err(|_error| SolveError::Empty("the reduced camera system could not be ordered"))?;
        let observations = layout.observations.len();
        let count = problem.landmarks.len();
        Ok(Self {
            offsets: (0..pattern.block_count()).map(|b| pattern.offset(b)).collect(),
            linear_solver,
            landmarks: vec![LandmarkBlock::ZERO; count],
            cross: vec![SMatrix::zeros(); observations],
            chunk_views: layout
                .chunks
                .iter()
                .map(|_| vec![ViewBlock::zero(); layout.views.len()])
                .collect(),
            hessian: BlockMatrix::new(Arc::clone(&pattern)),
            gradient: vec![0.0; dimension],
            scale: vec![0.0; dimension],
            eliminated: vec![Eliminated::NONE; count],
            whitened: vec![SMatrix::zeros(); observations],
            reduced: BlockMatrix::new(pattern),
            cholesky,
            step: vec![0.0; dimension],
            landmark_steps: vec![Vector3::zeros(); count],
            backup: None,
            problem,
            layout,
        })
    }

    pub(super) fn linear_solver(&self) -> LinearSolver {
        self.linear_solver
    }

    /// H_vv and g_v from the chunks' view blocks, summed in chunk order, and the pose factors.
    fn assemble_views(&mut self) {
        self.hessian.set_zero();
        self.gradient.fill(0.0);
        for (index, view) in self.layout.views.iter().enumerate() {
            let mut sum = ViewBlock::<D>::zero();
            for chunk in &self.chunk_views {
                sum.hessian += chunk[index].hessian;
                sum.gradient += chunk[index].gradient;
            }
            for row in &view.parts {
                let offset = self.offsets[row.block as usize];
                for r in 0..row.size {
                    self.gradient[offset + r] += sum.gradient[row.column + r];
                }
                let stride = self.layout.block_sizes[row.block as usize];
                for column in view.parts.iter().filter(|c| c.block <= row.block) {
                    let block = self.hessian.block_mut(row.block as usize, column.block as usize);
                    let Some(block) = block else { continue };
                    for c in 0..column.size {
                        for r in 0..row.size {
                            block[c * stride + r] +=
                                sum.hessian[(row.column + r, column.column + c)];
                        }
                    }
                }
            }
        }
        pose_factors::linearize(self.problem, &self.layout, &mut self.hessian, &mut self.gradient);
        for (scale, diagonal) in self.scale.iter_mut().zip(self.hessian.diagonal()) {
            *scale = damping_scale(diagonal);
        }
    }

    /// Eliminates every landmark for `damping`; `None` where one has no positive-definite block.
    fn eliminate(&mut self, damping: f64) -> Option<()> {
        let layout = &self.layout;
        let eliminated = split(&mut self.eliminated, layout.chunks.iter().map(|c| c.len()));
        let observations = layout.chunks.iter().map(|c| layout.tracks(c).len());
        let whitened = split(&mut self.whitened, observations);
        let (landmarks, cross) = (&self.landmarks, &self.cross);
        let constant = &self.problem.constant_landmarks;
        let done: Vec<Option<()>> = layout
            .chunks
            .par_iter()
            .zip(eliminated)
            .zip(whitened)
            .map(|((chunk, eliminated), whitened)| {
                let first = layout.tracks(chunk).start;
                for landmark in chunk.clone() {
                    let track = layout.track(landmark);
                    if constant[landmark] || track.is_empty() {
                        continue;
                    }
                    let one = Eliminated::new(&landmarks[landmark], damping)?;
                    for index in track {
                        whitened[index - first] = one.whiten(&cross[index]);
                    }
                    eliminated[landmark - chunk.start] = one;
                }
                Some(())
            })
            .collect();
        done.into_iter().collect()
    }

    /// ½ δᵀ(λDδ − g) and ‖δ‖² over poses, cameras and landmarks.
    fn predicted_decrease(&self, damping: f64) -> (f64, f64) {
        let mut decrease = 0.0;
        let mut squared = 0.0;
        for ((&delta, &scale), &gradient) in self.step.iter().zip(&self.scale).zip(&self.gradient) {
            decrease += delta * (damping * scale * delta - gradient);
            squared += delta * delta;
        }
        for (delta, block) in self.landmark_steps.iter().zip(&self.landmarks) {
            for i in 0..3 {
                let scale = damping_scale(block.hessian[(i, i)]);
                decrease += delta[i] * (damping * scale * delta[i] - block.gradient[i]);
            }
            squared += delta.norm_squared();
        }
        (0.5 * decrease, squared)
    }

    /// The norm that a step is measured against: positions of poses and landmarks.
    fn state_norm(&self) -> f64 {
        let poses: f64 =
            self.problem.poses.iter().map(|p| p.translation.norm_squared() + 1.0).sum();
        let landmarks: f64 = self.problem.landmarks.iter().map(|l| l.norm_squared()).sum();
        (poses + landmarks).sqrt()
    }
}

/// Pairs of blocks that see a common free landmark or stand in one view.
fn push_covisible_pairs(layout: &Layout, constant: &[bool], pairs: &mut Vec<(usize, usize)>) {
    let mut seen = std::collections::BTreeSet::new();
    let mut blocks: Vec<u32> = Vec::new();
    let mut insert_all = |blocks: &[u32]| {
        for (k, &a) in blocks.iter().enumerate() {
            seen.extend(blocks[..k].iter().map(|&b| (a.max(b), a.min(b))));
        }
    };
    for view in &layout.views {
        blocks.clear();
        blocks.extend(view.parts.iter().map(|p| p.block));
        insert_all(&blocks);
    }
    for landmark in (0..constant.len()).filter(|&l| !constant[l]) {
        blocks.clear();
        for index in layout.track(landmark) {
            let view = &layout.views[layout.observations[index].view as usize];
            blocks.extend(view.parts.iter().map(|p| p.block));
        }
        blocks.sort_unstable();
        blocks.dedup();
        insert_all(&blocks);
    }
    pairs.extend(seen.into_iter().map(|(a, b)| (a as usize, b as usize)));
}

impl<const D: usize> System for BundleSystem<'_, D> {
    fn cost(&mut self) -> f64 {
        let (problem, layout) = (&*self.problem, &self.layout);
        let sums: Vec<f64> =
            layout.chunks.par_iter().map(|c| landmarks::cost(problem, layout, c)).collect();
        sums.iter().sum::<f64>() + pose_factors::cost(problem)
    }

    fn linearize(&mut self, _damping: f64) -> Gradient {
        let (problem, layout) = (&*self.problem, &self.layout);
        let blocks = split(&mut self.landmarks, layout.chunks.iter().map(|c| c.len()));
        let observations = layout.chunks.iter().map(|c| layout.tracks(c).len());
        let cross = split(&mut self.cross, observations);
        layout.chunks.par_iter().zip(blocks).zip(cross).zip(&mut self.chunk_views).for_each(
            |(((chunk, landmarks), cross), views)| {
                let mut output = ChunkOutput { landmarks, cross, views };
                landmarks::linearize(problem, layout, chunk, &mut output);
            },
        );
        self.assemble_views();
        let mut max_norm: f64 = 0.0;
        for (gradient, scale) in self.gradient.iter().zip(&self.scale) {
            max_norm = max_norm.max(gradient.abs() / scale.sqrt());
        }
        for (landmark, block) in self.landmarks.iter_mut().enumerate() {
            if self.problem.constant_landmarks[landmark] {
                *block = LandmarkBlock::ZERO;
                continue;
            }
            for i in 0..3 {
                let scale = damping_scale(block.hessian[(i, i)]);
                max_norm = max_norm.max(block.gradient[i].abs() / scale.sqrt());
            }
        }
        Gradient { max_norm }
    }

    fn solve(&mut self, damping: f64) -> Result<Step, StepFailure> {
        self.eliminate(damping).ok_or(StepFailure)?;
        let elimination = Elimination {
            layout: &self.layout,
            constant_landmarks: &self.problem.constant_landmarks,
            eliminated: &self.eliminated,
            whitened: &self.whitened,
        };
        let mut right = self.gradient.clone();
        self.reduced.values_mut().copy_from_slice(self.hessian.values());
        elimination.subtract(&mut self.reduced, &mut right);
        let added: Vec<f64> = self.scale.iter().map(|s| damping * s).collect();
        right.iter_mut().for_each(|g| *g = -*g);
        let mut linear_residual = 0.0;
        if !right.is_empty() {
            self.cholesky.factor(&self.reduced, &added).map_err(|_error| StepFailure)?;
            linear_residual =
                self.cholesky.solve_checked(&self.reduced, &added, &right, &mut self.step);
        }
        let (step, offsets, constant) =
            (&self.step, &self.offsets, &self.problem.constant_landmarks);
        let eliminated = &self.eliminated;
        self.landmark_steps.par_iter_mut().enumerate().with_min_len(256).for_each(
            |(landmark, delta)| {
                let still = constant[landmark] || elimination.layout.track(landmark).is_empty();
                *delta = if still {
                    Vector3::zeros()
                } else {
                    eliminated[landmark].step(&elimination.project(landmark, step, offsets))
                };
            },
        );
        let (predicted_decrease, squared) = self.predicted_decrease(damping);
        if !(predicted_decrease.is_finite() && squared.is_finite() && linear_residual.is_finite()) {
            return Err(StepFailure);
        }
        let (norm, state_norm) = (squared.sqrt(), self.state_norm());
        Ok(Step { predicted_decrease, norm, state_norm, linear_residual })
    }

    fn apply(&mut self) -> f64 {
        let problem = &mut *self.problem;
        self.backup = Some(Values {
            poses: problem.poses.clone(),
            cameras: problem.cameras.clone(),
            landmarks: problem.landmarks.clone(),
        });
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
        for (landmark, delta) in problem.landmarks.iter_mut().zip(&self.landmark_steps) {
            *landmark += delta;
        }
        self.cost()
    }

    fn restore(&mut self) {
        if let Some(values) = self.backup.take() {
            self.problem.poses = values.poses;
            self.problem.cameras = values.cameras;
            self.problem.landmarks = values.landmarks;
        }
    }
}
