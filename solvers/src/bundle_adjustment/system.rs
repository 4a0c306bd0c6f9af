//! Bundle adjustment as the trust-region loop sees it.
//!
//! One fused pass linearizes and eliminates for a damping at once; another damping at the same state
//! runs it again, since nothing of the size of the observations is kept. Landmarks live here in the
//! kernels' order and go back to the problem at the end. It takes no decision of the loop, and
//! `reduced_solver` chooses its linear solver.

use std::sync::Arc;

use nalgebra::{SVector, Vector3};

use super::accumulate::{Accumulate, ChunkSums};
use super::back_substitute::{BackSubstitute, Cost, StepSums};
use super::blocks::ViewVector;
use super::covisible::ChunkPairs;
use super::held::Held;
use super::inner_iterations::{INNER_STIFFNESS, InnerIterations, POINT};
use super::iterative::{Iterative, Linearization, gather, split_groups};
use super::landmarks::LandmarkGroup;
use super::layout::{Layout, NO_BLOCK, View};
use super::observe::{Inputs, Model, ViewRecord, view_record};
use super::pose_factors;
use super::price::Costs;
use super::reduce::{ReducedVectors, Reduction};
use super::reduced_solver::{Choice, choose};
use super::sorted::{GROUPS, split};
use super::{Checkpoint, Keeper, LinearSolver};
use crate::geometry::{Camera, LieGroup, Se3};
use crate::interrupt::Interrupt;
use crate::linear::{BlockMatrix, BlockPattern, Cholesky, LinearError, PartialCholesky};
use crate::loss::Loss;
use crate::optimizer::{
    Gradient, IterationSummary, LoopState, Losses, Step, StepFailure, System, damping_scale,
};
use crate::parallel;
use crate::price::Limits;
use crate::problem::{BundleProblem, SolveError};
use crate::simd::Class;

mod border;

pub(super) use border::{Bordered, bordered};

/// D columns a view in V vectors and T tails, R rows an observation.
pub(super) struct BundleSystem<'a, const D: usize, const V: usize, const T: usize, const R: usize> {
    problem: Held<'a>,
    layout: Arc<Layout>,
    model: Model,
    class: Class,
    interrupt: Interrupt,
    linear_solver: LinearSolver,
    offsets: Vec<usize>,
    /// None where the reduced system is not formed.
    pairs: Option<Vec<ChunkPairs>>,
    reduction: Reduction,
    view_records: Vec<ViewRecord>,
    points: Vec<f64>,
    // The elimination for `eliminated_for`.
    sums: Vec<ChunkSums<D, V, T, R>>,
    groups: Vec<LandmarkGroup>,
    reduced: BlockMatrix,
    pose_hessian: Option<BlockMatrix>,
    vectors: ReducedVectors,
    eliminated_for: Option<f64>,
    stiffness: f64,
    // The step.
    solver: Solver<D, V, T, R>,
    step: Vec<f64>,
    view_steps: Vec<ViewVector<V, T>>,
    point_steps: Vec<f64>,
    backup: Values,
    /// Whether each step is followed by them.
    has_inner_iterations: bool,
    /// Keeps checkpoints.
    pub(super) keeper: Option<&'a mut (dyn Keeper + 'a)>,
}

/// The landmarks in the kernels' order, and one more: eight numbers are read from any landmark on.
fn points_in_order(problem: &BundleProblem, layout: &Layout) -> Vec<f64> {
    let order = &layout.sorted.order;
    let mut points = Vec::with_capacity((order.len() + 1) * POINT);
    for &landmark in order {
        let p = &problem.landmarks[landmark as usize];
        points.extend([p.x, p.y, p.z, 0.0]);
    }
    points.extend([0.0; POINT]);
    points
}

fn records(problem: &BundleProblem, layout: &Layout) -> impl Iterator<Item = ViewRecord> {
    let (poses, cameras) = (&problem.poses, &problem.cameras);
    let record = |v: &View| view_record(&poses[v.pose as usize], &cameras[v.camera as usize]);
    layout.views.iter().map(record)
}

/// What losses the factors of a problem have.
pub(super) fn losses_of(problem: &BundleProblem) -> Losses {
    match problem.observation_loss {
        Loss::Tukey(_) | Loss::GemanMcClure(_) => Losses::Bounded,
        Loss::Huber(_) | Loss::Cauchy(_) => Losses::Unbounded,
        Loss::Trivial if problem.relative_poses.is_empty() => Losses::None,
        Loss::Trivial if problem.relative_pose_loss == Loss::Trivial => Losses::None,
        Loss::Trivial => Losses::Unbounded,
    }
}

/// The cost of a problem for which there is no system, to the bit what the system says.
pub(super) fn cost_of<const R: usize>(
    problem: &BundleProblem,
    layout: &Layout,
    (model, class): (Model, Class),
) -> f64 {
    let records: Vec<ViewRecord> = records(problem, layout).collect();
    let points = points_in_order(problem, layout);
    let inputs = Inputs {
        sorted: &layout.sorted,
        records: &records,
        cameras: &problem.cameras,
        points: &points,
        loss: problem.observation_loss,
        stiffness: 1.0,
        model,
        view_cameras: &layout.view_cameras,
    };
    let chunks = layout.chunks().iter();
    let sums = parallel::map(chunks, |chunk| class.run(Cost::<R> { inputs, chunk }));
    sums.iter().sum::<f64>() + pose_factors::cost(problem)
}

/// How the reduced system is solved.
enum Solver<const D: usize, const V: usize, const T: usize, const R: usize> {
    /// Exactly.
    Cholesky(Box<Cholesky>),
    /// Inexactly.
    Iterative(Box<Iterative<D, V, T, R>>),
    /// All but a border, whose system is solved elsewhere.
    Partial(Box<PartialCholesky>),
}

/// What a system is built from beside its problem: the chosen solver's name, blocks of the reduced
/// system that are computed, the solver, and the pairs of views that feed it.
type Parts<const D: usize, const V: usize, const T: usize, const R: usize> =
    (LinearSolver, Arc<BlockPattern>, Solver<D, V, T, R>, Option<Vec<ChunkPairs>>);

/// The variables before a trial step.
#[derive(Default)]
struct Values {
    poses: Vec<Se3>,
    cameras: Vec<Camera>,
    points: Vec<f64>,
}

impl<'a, const D: usize, const V: usize, const T: usize, const R: usize>
    BundleSystem<'a, D, V, T, R>
{
    pub(super) fn new(
        problem: &'a mut BundleProblem,
        layout: &Arc<Layout>,
        model: Model,
        (wish, class): (LinearSolver, Class),
        limits: Limits<'_>,
    ) -> Result<Self, SolveError> {
        let costs = Costs::of::<D, V, T, R>(problem, layout);
        let Choice { linear_solver, pattern, direct } =
            choose(problem, layout, wish, &costs, limits)?;
        let (solver, pairs) = match direct {
            Some((cholesky, pairs)) => (Solver::Cholesky(cholesky), Some(pairs)),
            None => (Solver::Iterative(Box::new(Iterative::new(layout))), None),
        };
        let kernels = (model, class);
        let interrupt = limits.interrupt.clone();
        let parts = (linear_solver, pattern, solver, pairs);
        Ok(Self::of_parts(Held::Borrowed(problem), layout, kernels, parts, interrupt))
    }

    /// With the solver that was chosen, the blocks that it wants and the pairs that feed them.
    fn of_parts(
        problem: Held<'a>,
        layout: &Arc<Layout>,
        (model, class): (Model, Class),
        (linear_solver, pattern, solver, pairs): Parts<D, V, T, R>,
        interrupt: Interrupt,
    ) -> Self {
        let dimension = pattern.dimension();
        let sorted = &layout.sorted;
        let points = points_in_order(&problem, layout);
        let chunk_pairs = |i: usize| pairs.as_ref().map(|pairs| &pairs[i]);
        let chunks = layout.chunks().iter().enumerate();
        let pose_pairs = || pose_factors::block_pairs(&problem, layout);
        Self {
            model,
            class,
            interrupt,
            linear_solver,
            offsets: (0..pattern.block_count()).map(|b| pattern.offset(b)).collect(),
            reduction: Reduction::new(layout, pairs.as_deref().unwrap_or(&[]), &pattern),
            view_records: Vec::new(),
            sums: parallel::map(chunks, |(i, c)| ChunkSums::new(layout, c, chunk_pairs(i))),
            groups: vec![LandmarkGroup::ZERO; sorted.tile_count() * GROUPS],
            pose_hessian: pose_factors::has_any(&problem)
                .then(|| pose_factors::hessian(layout, pose_pairs())),
            reduced: BlockMatrix::new(pattern),
            vectors: ReducedVectors::new(dimension),
            eliminated_for: None,
            stiffness: 1.0,
            solver,
            step: vec![0.0; dimension],
            view_steps: vec![ViewVector::ZERO; layout.views.len()],
            point_steps: vec![0.0; points.len()],
            points,
            backup: Values::default(),
            has_inner_iterations: false,
            keeper: None,
            pairs,
            problem,
            layout: Arc::clone(layout),
        }
    }

    pub(super) fn linear_solver(&self) -> LinearSolver {
        self.linear_solver
    }

    /// Puts the landmarks back into the problem.
    pub(super) fn finish(mut self) {
        let landmarks = std::mem::take(&mut self.problem.landmarks);
        let landmarks = self.put_back(landmarks);
        self.problem.landmarks = landmarks;
    }

    /// Puts the landmarks into their places among `landmarks`.
    fn put_back(&self, mut landmarks: Vec<Vector3<f64>>) -> Vec<Vector3<f64>> {
        for (&landmark, point) in self.layout.sorted.order.iter().zip(self.points.chunks(POINT)) {
            landmarks[landmark as usize] = Vector3::new(point[0], point[1], point[2]);
        }
        landmarks
    }

    fn fill_view_records(&mut self) {
        self.view_records.clear();
        self.view_records.extend(records(&self.problem, &self.layout));
    }

    fn inputs(&self) -> Inputs<'_> {
        Inputs {
            sorted: &self.layout.sorted,
            records: &self.view_records,
            cameras: &self.problem.cameras,
            points: &self.points,
            loss: self.problem.observation_loss,
            stiffness: self.stiffness,
            model: self.model,
            view_cameras: &self.layout.view_cameras,
        }
    }

    /// The fused pass over all chunks and the reduced system, for `damping`.
    fn eliminate(&mut self, damping: f64) {
        self.fill_view_records();
        let mut sums = std::mem::take(&mut self.sums);
        let mut groups = std::mem::take(&mut self.groups);
        let inputs = self.inputs();
        let (layout, class, pairs) = (&*self.layout, self.class, self.pairs.as_ref());
        let interrupt = &self.interrupt;
        let pieces = split_groups(layout, &mut groups);
        let chunks = layout.chunks().iter().enumerate().zip(&mut sums).zip(pieces);
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
        self.reduction.sum(layout, &sums, &mut self.reduced, &mut self.vectors, interrupt);
        self.sums = sums;
        self.groups = groups;
        if let Some(hessian) = &mut self.pose_hessian {
            let mut gradient = vec![0.0; self.step.len()];
            pose_factors::linearize(&self.problem, layout, hessian, &mut gradient, self.stiffness);
            self.reduced.add(hessian);
            let vectors = &mut self.vectors;
            for (i, (g, d)) in gradient.iter().zip(hessian.diagonal()).enumerate() {
                vectors.gradient[i] += g;
                vectors.reduced_gradient[i] += g;
                vectors.diagonal[i] += d;
            }
        }
        self.eliminated_for = Some(damping);
    }

    /// Solves the reduced system for the step; returns the relative residual.
    fn solve_reduced(&mut self, added: &[f64]) -> Result<f64, LinearError> {
        let right: Vec<f64> = self.vectors.reduced_gradient.iter().map(|g| -g).collect();
        if right.is_empty() {
            return Ok(0.0);
        }
        match &mut self.solver {
            Solver::Cholesky(cholesky) => {
                cholesky.factor_until(&self.reduced, added, &self.interrupt)?;
                Ok(cholesky.solve_checked(&self.reduced, added, &right, &mut self.step))
            }
            Solver::Iterative(iterative) => {
                let linearization = Linearization {
                    inputs: Inputs {
                        sorted: &self.layout.sorted,
                        records: &self.view_records,
                        cameras: &self.problem.cameras,
                        points: &self.points,
                        loss: self.problem.observation_loss,
                        stiffness: self.stiffness,
                        model: self.model,
                        view_cameras: &self.layout.view_cameras,
                    },
                    layout: &self.layout,
                    class: self.class,
                    offsets: &self.offsets,
                    groups: &self.groups,
                    pose_hessian: self.pose_hessian.as_ref(),
                    added,
                    interrupt: &self.interrupt,
                };
                iterative.solve(&linearization, &self.reduced, &right, &mut self.step)
            }
            // A system with a border is solved in two halves, not here.
            Solver::Partial(_) => Err(LinearError::Interrupted),
        }
    }

    /// Landmark steps for the reduced step, and what they add to the step's figures.
    fn back_substitute(&mut self, damping: f64) -> StepSums {
        gather(&self.layout, &self.offsets, &self.step, &mut self.view_steps);
        let mut steps = std::mem::take(&mut self.point_steps);
        let inputs = self.inputs();
        let (layout, class, interrupt) = (&*self.layout, self.class, &self.interrupt);
        let pieces = split(&mut steps, layout.chunks().iter().map(|c| c.landmarks.len() * POINT));
        let view_steps = &self.view_steps;
        let chunks = layout.chunks().iter().zip(pieces);
        let sums = parallel::map(chunks, |(chunk, steps)| {
            let groups = &self.groups[chunk.tiles.start * GROUPS..chunk.tiles.end * GROUPS];
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
        self.point_steps = steps;
        sums.iter().fold(StepSums::default(), |a, b| StepSums {
            decrease: a.decrease + b.decrease,
            squared: a.squared + b.squared,
        })
    }

    /// Moves the variables by a multiple of the step and returns the new cost.
    fn move_by(&mut self, length: f64) -> f64 {
        let (problem, layout) = (&mut *self.problem, &*self.layout);
        for (pose, &block) in problem.poses.iter_mut().zip(&layout.pose_block) {
            if block != NO_BLOCK {
                let step = &self.step[self.offsets[block as usize]..];
                *pose = pose.plus(&SVector::from_fn(|i, _| length * step[i]));
            }
        }
        for (camera, &(block, column)) in problem.cameras.iter_mut().zip(&layout.camera_block) {
            if block != NO_BLOCK {
                let step = &self.step[self.offsets[block as usize] + column..];
                let step = step[..camera.parameter_count()].iter().map(|x| length * x);
                camera.plus_parameters(&step.collect::<Vec<f64>>());
            }
        }
        for (x, delta) in self.points.iter_mut().zip(&self.point_steps) {
            *x += length * delta;
        }
        self.eliminated_for = None;
        if self.has_inner_iterations {
            self.minimize_landmarks();
        }
        self.cost()
    }

    /// Minimizes the landmarks at the poses and cameras as they are.
    fn minimize_landmarks(&mut self) {
        self.fill_view_records();
        let mut points = std::mem::take(&mut self.points);
        let inputs = Inputs { stiffness: INNER_STIFFNESS, ..self.inputs() };
        let (layout, class, interrupt) = (&*self.layout, self.class, &self.interrupt);
        let pieces = split(&mut points, layout.chunks().iter().map(|c| c.landmarks.len() * POINT));
        parallel::for_each(layout.chunks().iter().zip(pieces), |(chunk, points)| {
            class.run(InnerIterations::<R> { inputs, layout, chunk, points, interrupt });
        });
        self.points = points;
    }

    /// The norm that a step is measured against: that of the poses' positions, in whose scene a
    /// landmark at infinity would make every step look short.
    fn state_norm(&self) -> f64 {
        self.problem.poses.iter().map(|p| p.translation.norm_squared() + 1.0).sum::<f64>().sqrt()
    }
}

impl<const D: usize, const V: usize, const T: usize, const R: usize> System
    for BundleSystem<'_, D, V, T, R>
{
    fn losses(&self) -> Losses {
        losses_of(&self.problem)
    }

    fn begin_inner_iterations(&mut self) {
        // Without a loss a step minimizes landmarks to first order as it is.
        self.has_inner_iterations = self.problem.observation_loss != Loss::Trivial;
    }

    fn keep(&mut self, row: &IterationSummary, state: &dyn Fn() -> LoopState) {
        let Some(keeper) = self.keeper.take() else { return };
        if keeper.is_due(row) {
            keeper.keep(Checkpoint {
                state: state(),
                poses: self.problem.poses.clone(),
                landmarks: self.put_back(self.problem.landmarks.clone()),
                cameras: self.problem.cameras.clone(),
            });
        }
        self.keeper = Some(keeper);
    }

    fn set_stiffness(&mut self, stiffness: f64) {
        self.stiffness = stiffness;
        self.eliminated_for = None;
    }

    fn cost(&mut self) -> f64 {
        self.fill_view_records();
        let inputs = self.inputs();
        let class = self.class;
        let chunks = self.layout.chunks().iter();
        let sums = parallel::map(chunks, |chunk| class.run(Cost::<R> { inputs, chunk }));
        sums.iter().sum::<f64>() + pose_factors::cost(&self.problem)
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
        if self.interrupt.is_due() {
            return Err(StepFailure);
        }
        if self.sums.iter().any(|s| !s.positive_definite) {
            return Err(StepFailure);
        }
        let diagonal = self.vectors.diagonal.iter();
        let added: Vec<f64> = diagonal.map(|d| damping * damping_scale(*d)).collect();
        let linear_residual = self.solve_reduced(&added).map_err(|_error| StepFailure)?;
        let mut sums = self.back_substitute(damping);
        for ((delta, added), gradient) in self.step.iter().zip(&added).zip(&self.vectors.gradient) {
            sums.decrease += delta * (added * delta - gradient);
            sums.squared += delta * delta;
        }
        let figures = [sums.decrease, sums.squared, linear_residual];
        if !figures.iter().all(|x| x.is_finite()) {
            return Err(StepFailure);
        }
        Ok(Step {
            predicted_decrease: 0.5 * sums.decrease,
            norm: sums.squared.sqrt(),
            state_norm: self.state_norm(),
            linear_residual,
            is_inexact: matches!(self.solver, Solver::Iterative(_)),
        })
    }

    fn apply(&mut self) -> f64 {
        self.backup.poses.clone_from(&self.problem.poses);
        self.backup.cameras.clone_from(&self.problem.cameras);
        self.backup.points.clone_from(&self.points);
        self.move_by(1.0)
    }

    fn apply_lengthened(&mut self, length: f64) -> Option<f64> {
        self.problem.poses.clone_from(&self.backup.poses);
        self.problem.cameras.clone_from(&self.backup.cameras);
        self.points.clone_from(&self.backup.points);
        Some(self.move_by(length))
    }

    fn restore(&mut self) {
        std::mem::swap(&mut self.problem.poses, &mut self.backup.poses);
        std::mem::swap(&mut self.problem.cameras, &mut self.backup.cameras);
        std::mem::swap(&mut self.points, &mut self.backup.points);
        self.eliminated_for = None;
    }
}
