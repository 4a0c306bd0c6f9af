//! A pose graph as the trust-region loop sees it.
//!
//! State: the poses and landmarks that are not constant. Steps solve (H + λD) δ = −g with Marquardt's scaling
//! D = diag(H), kept within bounds, and move X ← X · Exp(δ). Where edges may leave a direction open,
//! λ and D have a floor, so that a pose stays where nothing moves it. The symbolic factorization is
//! made once. Which pose holds the gauge is decided by the caller.

use std::sync::Arc;

use nalgebra::{SVector, Vector3};

use super::assembly::{Incidences, linearize_edges};
use super::landmarks;
use super::priors::{self, cost};
use super::ranges;
use super::rows::Rows;
use crate::factors::{self, RelativePose};
use crate::geometry::LieGroup;
use crate::interrupt::Interrupt;
use crate::linear::{BlockMatrix, BlockPattern, Cholesky, PairTerm};
use crate::optimizer::{Gradient, Step, StepFailure, System, damping_scale, from_linear};
use crate::parallel;
use crate::price::Limits;
use crate::problem::{PoseGraph, SolveError, dimension_of_space};

/// Least damping of a graph whose edges may leave a direction of a pose open: far above the
/// rounding that could pass for information in H, far below the information of any measurement.
const LEAST_DAMPING: f64 = 1e-10;

/// In such a graph D is at least this share of the largest entry of its pose: where H has no
/// information, its diagonal is rounding, of either sign.
const LEAST_SCALE: f64 = 1e-3;

/// Poses that a task moves.
const POSES_PER_TASK: usize = 128;

/// Bytes besides the factor: a term and two incidences an edge, poses, vectors, H.
fn linear_bytes<G, const N: usize>(graph: &PoseGraph<G, N>, pattern: &BlockPattern) -> u64 {
    let edges = graph.edges.len() * (size_of::<PairTerm<N>>() + 24);
    let poses = graph.poses.len() * (2 * size_of::<G>() + 8 * 9 * N + 48);
    let landmarks = graph.landmarks.len() * (2 * 24 + 8 * 9 * 3 + 48);
    (edges + poses + landmarks) as u64 + 8 * pattern.value_count() as u64 + pattern.bytes()
}

/// Only a cost that is not finite is worth a search for the edge behind it.
fn check_start<G: LieGroup<N>, const N: usize>(graph: &PoseGraph<G, N>) -> Result<(), SolveError> {
    let not_finite = |edge: &RelativePose<G, N>| !edge.rho(&graph.poses, graph.loss).is_finite();
    priors::check_finite(graph)?;
    landmarks::check_finite(graph)?;
    ranges::check_finite(graph)?;
    if !factors::cost(&graph.edges, &graph.poses, graph.loss, &Interrupt::NEVER).is_finite()
        && let Some(index) = graph.edges.iter().position(not_finite)
    {
        return Err(SolveError::ResidualNotFinite { factor: "edge", index });
    }
    Ok(())
}

/// The entries of a vector, a slice a block of the matrix.
pub(super) fn blocks_mut<'a>(
    pattern: &'a BlockPattern,
    mut vector: &'a mut [f64],
) -> impl Iterator<Item = &'a mut [f64]> {
    pattern.sizes().iter().map(move |&size| {
        let (block, rest) = std::mem::take(&mut vector).split_at_mut(size);
        vector = rest;
        block
    })
}

pub(super) struct PoseGraphSystem<'a, G, const N: usize> {
    graph: &'a mut PoseGraph<G, N>,
    /// The poses before the last applied step.
    backup: Vec<G>,
    /// The landmarks before it.
    landmark_backup: Vec<Vector3<f64>>,
    rows: Rows,
    edge_blocks: Vec<PairTerm<N>>,
    incidences: Incidences,
    interrupt: &'a Interrupt,
    hessian: BlockMatrix,
    factor: Cholesky,
    gradient: Vec<f64>,
    /// D.
    scaling: Vec<f64>,
    /// λD.
    added_diagonal: Vec<f64>,
    /// −g.
    descent: Vec<f64>,
    /// δ.
    step: Vec<f64>,
    /// Whether the factors determine every pose for certain.
    is_rigid: bool,
    /// Norm of the start's logarithms, at least that of one unit a pose.
    state_norm: f64,
}

impl<'a, G: LieGroup<N>, const N: usize> PoseGraphSystem<'a, G, N> {
    /// The system at the graph's poses; `graph` is valid and has a pose that may move.
    pub(super) fn new(
        graph: &'a mut PoseGraph<G, N>,
        limits: Limits<'a>,
    ) -> Result<Self, SolveError> {
        check_start(graph)?;
        let rows = Rows::new(graph);
        let pattern = Arc::new(rows.pattern(graph));
        let linear = linear_bytes(graph, &pattern);
        let scalars = pattern.dimension();
        let Limits { ceiling, interrupt } = limits.less(linear);
        let factor = Cholesky::within(Arc::clone(&pattern), ceiling, interrupt)
            .map_err(|error| from_linear(error, scalars).beside(linear))?;
        let rows_of_edges = graph.free_indices_of_edges(&rows.of_pose);
        let incidences = Incidences::new(&pattern, rows.free_poses.len(), rows_of_edges);
        let of_poses: f64 = graph.poses.iter().map(|pose| pose.log().norm_squared()).sum();
        let of_landmarks: f64 = graph.landmarks.positions.iter().map(Vector3::norm_squared).sum();
        let norm_squared = of_poses + of_landmarks;
        Ok(Self {
            backup: graph.poses.clone(),
            landmark_backup: graph.landmarks.positions.clone(),
            // Filled by the first linearization: the threads that use the memory touch it first.
            edge_blocks: Vec::new(),
            rows,
            incidences,
            interrupt,
            hessian: BlockMatrix::new(pattern),
            factor,
            gradient: vec![0.0; scalars],
            scaling: vec![0.0; scalars],
            added_diagonal: vec![0.0; scalars],
            descent: vec![0.0; scalars],
            step: vec![0.0; scalars],
            is_rigid: graph.is_rigid(),
            state_norm: norm_squared.max(graph.poses.len() as f64).sqrt(),
            graph,
        })
    }
}

impl<G: LieGroup<N>, const N: usize> System for PoseGraphSystem<'_, G, N> {
    fn cost(&mut self) -> f64 {
        cost(self.graph, &Interrupt::NEVER)
    }

    fn linearize(&mut self, _damping: f64) -> Gradient {
        let graph = &*self.graph;
        let (loss, interrupt) = (graph.loss, self.interrupt);
        linearize_edges(&graph.edges, &graph.poses, loss, interrupt, &mut self.edge_blocks);
        let (hessian, gradient) = (&mut self.hessian, &mut self.gradient);
        self.incidences.assemble(&self.edge_blocks, interrupt, hessian, gradient);
        priors::add(graph, &self.rows.of_pose, hessian, gradient);
        landmarks::add(graph, &self.rows, hessian, gradient);
        ranges::add(graph, &self.rows, hessian, gradient);
        if interrupt.is_due() {
            return Gradient { max_norm: f64::NAN };
        }
        for (scaling, h) in self.scaling.iter_mut().zip(self.hessian.diagonal()) {
            *scaling = damping_scale(h);
        }
        if !self.is_rigid {
            for scaling in blocks_mut(self.hessian.pattern(), &mut self.scaling) {
                let largest = scaling.iter().fold(0.0_f64, |max, &scale| max.max(scale));
                let least = LEAST_SCALE * largest;
                scaling.iter_mut().for_each(|scale| *scale = scale.max(least));
            }
        }
        let mut max_norm = 0.0_f64;
        for k in 0..self.gradient.len() {
            self.descent[k] = -self.gradient[k];
            let scaled = self.gradient[k].abs() / self.scaling[k].sqrt();
            // A NaN compares false with everything and must win.
            if scaled > max_norm || scaled.is_nan() {
                max_norm = scaled;
            }
        }
        Gradient { max_norm }
    }

    fn solve(&mut self, damping: f64) -> Result<Step, StepFailure> {
        let damping = if self.is_rigid { damping } else { damping.max(LEAST_DAMPING) };
        for (added, scaling) in self.added_diagonal.iter_mut().zip(&self.scaling) {
            *added = damping * scaling;
        }
        self.factor
            .factor_until(&self.hessian, &self.added_diagonal, self.interrupt)
            .map_err(|_not_positive_definite| StepFailure)?;
        let linear_residual = self.factor.solve_checked(
            &self.hessian,
            &self.added_diagonal,
            &self.descent,
            &mut self.step,
        );
        let (mut predicted_decrease, mut norm_squared) = (0.0, 0.0);
        for (k, &delta) in self.step.iter().enumerate() {
            predicted_decrease += 0.5 * delta * (self.added_diagonal[k] * delta + self.descent[k]);
            norm_squared += delta * delta;
        }
        Ok(Step {
            predicted_decrease,
            norm: norm_squared.sqrt(),
            state_norm: self.state_norm,
            linear_residual,
            is_inexact: false,
        })
    }

    fn apply(&mut self) -> f64 {
        self.backup.copy_from_slice(&self.graph.poses);
        self.landmark_backup.copy_from_slice(&self.graph.landmarks.positions);
        let step = &self.step;
        let runs = self.graph.poses.chunks_mut(POSES_PER_TASK);
        parallel::for_each(runs.zip(self.rows.of_pose.chunks(POSES_PER_TASK)), |(poses, rows)| {
            for (pose, row) in poses.iter_mut().zip(rows) {
                if let Some(row) = row {
                    *pose = pose.plus(&SVector::from_column_slice(&step[row * N..][..N]));
                }
            }
        });
        let space = dimension_of_space(N);
        let of_landmarks = step[self.rows.free_poses.len() * N..].chunks_exact(space);
        for (&landmark, step) in self.rows.free_landmarks.iter().zip(of_landmarks) {
            let position = &mut self.graph.landmarks.positions[landmark];
            position.iter_mut().zip(step).for_each(|(x, step)| *x += step);
        }
        cost(self.graph, self.interrupt)
    }

    fn restore(&mut self) {
        self.graph.poses.copy_from_slice(&self.backup);
        self.graph.landmarks.positions.copy_from_slice(&self.landmark_backup);
    }
}
