//! A system that is part of a larger one: it meets the rest in a border of poses and cameras.
//!
//! Landmarks and the poses and cameras inside are eliminated here; what that leaves on the border is one
//! of the summands of the whole system's. Once the border's step is known, the rest follows here. With
//! the same damping this is the whole system's own elimination, in another order. It knows no other
//! section and does not solve for the border.

use std::sync::Arc;

use super::super::covisible::{can_be_numbered, covisible_pairs};
use super::super::reduce::block_pairs;
use super::super::{Run, dispatch};
use super::{
    BlockPattern, BundleProblem, BundleSystem, Class, Costs, Held, Interrupt, Layout, Limits,
    LinearError, LinearSolver, Model, NO_BLOCK, POINT, PartialCholesky, SolveError, Solver, System,
    damping_scale, pose_factors,
};
use crate::bundle_adjustment::split::{BorderPart, Contribution, Motion, StepPart, Values};
use crate::optimizer::from_linear;

/// A system with a border, whatever its kernels.
pub(in super::super) trait Bordered: Send {
    /// The unknowns of the border, in order.
    fn border(&self) -> Vec<BorderPart>;
    /// How many unknowns those are.
    fn border_dimension(&self) -> usize;
    fn set_interrupt(&mut self, interrupt: &Interrupt);
    fn values(&self) -> Values;
    /// Sets the variables; there are as many as in [`Self::values`].
    fn set_values(&mut self, values: &Values);
    fn cost(&mut self) -> f64;
    /// Linearizes and eliminates.
    fn contribute(&mut self, damping: f64, stiffness: f64) -> Contribution;
    /// The step inside for that of the border, after [`Self::contribute`].
    fn step(&mut self, damping: f64, border: &[f64]) -> StepPart;
    /// Moves along the last step, from the values that are set; returns the cost.
    fn move_along(&mut self, motion: Motion) -> f64;
}

/// Builds the system of `problem` whose poses and cameras that are marked are its border, and what it
/// takes in bytes. Cameras in `is_apart` are not merged into a pose.
pub(in super::super) fn bordered(
    problem: Box<BundleProblem>,
    (is_apart, border_poses, border_cameras): (&[bool], &[bool], &[bool]),
    class: Class,
    limits: Limits<'_>,
) -> Result<(Box<dyn Bordered>, u64), SolveError> {
    let layout = Arc::new(Layout::with_apart(&problem, is_apart));
    let mut is_border = vec![false; layout.block_sizes.len()];
    let cameras = layout.camera_block.iter().map(|&(block, _)| block);
    let marked =
        layout.pose_block.iter().copied().zip(border_poses).chain(cameras.zip(border_cameras));
    for (block, &is_marked) in marked {
        if is_marked && block != NO_BLOCK {
            is_border[block as usize] = true;
        }
    }
    dispatch(&layout, Build { problem, is_border, class, limits })
}

struct Build<'l> {
    problem: Box<BundleProblem>,
    is_border: Vec<bool>,
    class: Class,
    limits: Limits<'l>,
}

impl Run for Build<'_> {
    type Output = (Box<dyn Bordered>, u64);

    fn problem(&self) -> &BundleProblem {
        &self.problem
    }

    fn run<const D: usize, const V: usize, const T: usize, const R: usize>(
        self,
        layout: &Arc<Layout>,
        model: Model,
    ) -> Result<Self::Output, SolveError> {
        let Self { problem, is_border, class, limits } = self;
        let dimension: usize = layout.block_sizes.iter().sum();
        if !can_be_numbered(layout) {
            return Err(SolveError::TooLarge { dimension });
        }
        let costs = Costs::of::<D, V, T, R>(&problem, layout);
        let interrupt = limits.interrupt;
        let pairs = covisible_pairs(layout, interrupt).ok_or(SolveError::Interrupted)?;
        let mut tied = pose_factors::block_pairs(&problem, layout);
        tied.extend(block_pairs(layout, &pairs));
        let border: Vec<usize> = (0..is_border.len()).filter(|&b| is_border[b]).collect();
        for (k, &i) in border.iter().enumerate() {
            tied.extend(border[..k].iter().map(|&j| (i, j)));
        }
        let pattern = Arc::new(BlockPattern::new(layout.block_sizes.clone(), tied));
        let failed = |error: LinearError| from_linear(error, dimension);
        let mut partial =
            PartialCholesky::new(Arc::clone(&pattern), &is_border, interrupt).map_err(failed)?;
        partial.set_class(class);
        let slots = pairs.iter().map(|pairs| pairs.slots.len() as u64).sum();
        let values = 8 * pattern.value_count() as u64 + 24 * pattern.stored_block_count() as u64;
        let price = costs.paired(slots).plus_bytes(values + partial.price().bytes);
        limits.ceiling.admit(&price)?;
        let solver = Solver::<D, V, T, R>::Partial(Box::new(partial));
        let parts = (LinearSolver::SparseSchur, pattern, solver, Some(pairs));
        let kernels = (model, class);
        let interrupt = interrupt.clone();
        let held = Held::Owned(problem);
        let system = BundleSystem::of_parts(held, layout, kernels, parts, interrupt);
        Ok((Box::new(BorderedSystem { system, is_border, right: Vec::new() }), price.bytes))
    }
}

struct BorderedSystem<const D: usize, const V: usize, const T: usize, const R: usize> {
    system: BundleSystem<'static, D, V, T, R>,
    /// By block of the reduced system.
    is_border: Vec<bool>,
    /// Right-hand side of the last elimination.
    right: Vec<f64>,
}

impl<const D: usize, const V: usize, const T: usize, const R: usize> BorderedSystem<D, V, T, R> {
    /// The scalars of the border, or those inside.
    fn scalars(&self, border: bool) -> impl Iterator<Item = usize> {
        let sizes = &self.system.layout.block_sizes;
        let blocks = self.is_border.iter().zip(&self.system.offsets).zip(sizes);
        blocks
            .filter(move |((is_border, _), _)| **is_border == border)
            .flat_map(|((_, &offset), &size)| offset..offset + size)
    }

    fn on_border(&self, values: &[f64]) -> Vec<f64> {
        self.scalars(true).map(|i| values[i]).collect()
    }
}

impl<const D: usize, const V: usize, const T: usize, const R: usize> Bordered
    for BorderedSystem<D, V, T, R>
{
    fn border(&self) -> Vec<BorderPart> {
        let layout = &self.system.layout;
        // Block, first column in it, the part.
        let mut parts = Vec::new();
        for (pose, &block) in layout.pose_block.iter().enumerate() {
            parts.push((block, 0, BorderPart::Pose(pose as u32)));
        }
        for (camera, &(block, column)) in layout.camera_block.iter().enumerate() {
            parts.push((block, column, BorderPart::Camera(camera as u32)));
        }
        parts.retain(|&(block, ..)| block != NO_BLOCK && self.is_border[block as usize]);
        parts.sort_by_key(|&(block, column, _)| (block, column));
        parts.into_iter().map(|(_, _, part)| part).collect()
    }

    fn border_dimension(&self) -> usize {
        self.scalars(true).count()
    }

    fn set_interrupt(&mut self, interrupt: &Interrupt) {
        self.system.interrupt = interrupt.clone();
    }

    fn values(&self) -> Values {
        let problem = &self.system.problem;
        let landmarks = self.system.put_back(problem.landmarks.clone());
        Values { poses: problem.poses.clone(), cameras: problem.cameras.clone(), landmarks }
    }

    fn set_values(&mut self, values: &Values) {
        let system = &mut self.system;
        system.problem.poses.clone_from(&values.poses);
        system.problem.cameras.clone_from(&values.cameras);
        let points = system.points.chunks_mut(POINT);
        for (&landmark, point) in system.layout.sorted.order.iter().zip(points) {
            point[..3].copy_from_slice(values.landmarks[landmark as usize].as_slice());
        }
        system.eliminated_for = None;
    }

    fn cost(&mut self) -> f64 {
        System::cost(&mut self.system)
    }

    fn contribute(&mut self, damping: f64, stiffness: f64) -> Contribution {
        let system = &mut self.system;
        system.stiffness = stiffness;
        system.eliminate(damping);
        let landmarks = system.sums.iter().map(|s| s.gradient_max_norm);
        let mut gradient_max_norm = landmarks.fold(0.0, f64::max);
        let mut is_definite = system.sums.iter().all(|s| s.positive_definite);
        let scales = system.vectors.diagonal.iter().map(|d| damping_scale(*d));
        let mut added: Vec<f64> = scales.map(|scale| damping * scale).collect();
        self.right = system.vectors.reduced_gradient.iter().map(|g| -g).collect();
        for i in self.scalars(true).collect::<Vec<_>>() {
            added[i] = 0.0;
        }
        let vectors = &self.system.vectors;
        for i in self.scalars(false) {
            let scale = damping_scale(vectors.diagonal[i]);
            gradient_max_norm =
                f64::max(gradient_max_norm, vectors.gradient[i].abs() / scale.sqrt());
        }
        let (gradient, diagonal) =
            (self.on_border(&vectors.gradient), self.on_border(&vectors.diagonal));
        let system = &mut self.system;
        let (mut matrix, mut right) = (Vec::new(), Vec::new());
        if let Solver::Partial(partial) = &mut system.solver
            && is_definite
        {
            let outcome = partial.factor_until(&system.reduced, &added, &system.interrupt);
            is_definite = outcome.is_ok();
            if is_definite {
                matrix = partial.border_matrix();
                right = partial.reduce(&self.right);
            }
        }
        Contribution { gradient_max_norm, is_definite, matrix, right, gradient, diagonal }
    }

    fn step(&mut self, damping: f64, border: &[f64]) -> StepPart {
        let mut step = std::mem::take(&mut self.system.step);
        if let Solver::Partial(partial) = &mut self.system.solver {
            partial.expand(border, &mut step);
        }
        let mut product = vec![0.0; step.len()];
        self.system.reduced.symmetric_multiply(&step, &mut product);
        self.system.step = step;
        let sums = self.system.back_substitute(damping);
        let mut part = StepPart {
            decrease: sums.decrease,
            squared: sums.squared,
            border_right: self.on_border(&self.right),
            ..StepPart::default()
        };
        let (system, right) = (&self.system, &self.right);
        let (step, vectors) = (&system.step, &system.vectors);
        for i in self.scalars(false) {
            let (delta, added) = (step[i], damping * damping_scale(vectors.diagonal[i]));
            part.decrease += delta * (added * delta - vectors.gradient[i]);
            part.squared += delta * delta;
            part.residual_squared += (right[i] - product[i] - added * delta).powi(2);
            part.right_squared += right[i].powi(2);
        }
        part.border_residual = self.scalars(true).map(|i| right[i] - product[i]).collect();
        part
    }

    fn move_along(&mut self, motion: Motion) -> f64 {
        self.system.has_inner_iterations = motion.has_inner_iterations;
        self.system.move_by(motion.length)
    }
}
