//! A system that is part of a larger one: it meets the rest in a border of poses and cameras.
//!
//! Landmarks and the poses and cameras inside are eliminated here; what that leaves on the border is one
//! of the summands of the whole system's. Once the border's step is known, the rest follows here. With
//! the same damping this is the whole system's own elimination, in another order. It knows no other
//! section and does not solve for the border.

use std::sync::Arc;

use super::super::covisible::{can_be_numbered, covisible_pairs};
use super::super::eliminator::Kernels;
use super::super::layout::{Layout, NO_BLOCK};
use super::super::maybe_owned::MaybeOwned;
use super::super::reduce::block_pairs;
use super::{BundleSystem, Solver, Variables, pose_factors};
use crate::bundle_adjustment::LinearSolver;
use crate::bundle_adjustment::split::{BorderPart, Contribution, Motion, StepPart, Values};
use crate::interrupt::Interrupt;
use crate::linear::{BlockPattern, LinearError, PartialCholesky};
use crate::optimizer::{damping_scale, from_linear};
use crate::price::Limits;
use crate::problem::{BundleProblem, SolveError};
use crate::simd::Class;

/// A system with a border.
pub(in super::super) struct BorderedSystem {
    system: BundleSystem<'static>,
    /// By block of the reduced system.
    is_border: Vec<bool>,
    /// Right-hand side of the last elimination.
    right: Vec<f64>,
}

impl BorderedSystem {
    /// Builds the system of `problem` whose poses and cameras that are marked are its border, and says
    /// what it takes in bytes. Cameras in `is_apart` are not merged into a pose.
    pub(in super::super) fn new(
        problem: Box<BundleProblem>,
        (is_apart, border_poses, border_cameras): (&[bool], &[bool], &[bool]),
        class: Class,
        limits: Limits<'_>,
    ) -> Result<(Self, u64), SolveError> {
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
        let dimension: usize = layout.block_sizes.iter().sum();
        if !can_be_numbered(&layout) {
            return Err(SolveError::TooLarge { dimension });
        }
        let kernels = Kernels::of(&problem, &layout);
        let costs = (kernels.costs)(&problem, &layout);
        let interrupt = limits.interrupt;
        let pairs = covisible_pairs(&layout, interrupt).ok_or(SolveError::Interrupted)?;
        let mut tied = pose_factors::block_pairs(&problem, &layout);
        tied.extend(block_pairs(&layout, &pairs));
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
        let held = MaybeOwned::Owned(problem);
        let variables = Variables::new(held, &layout, kernels, class, interrupt.clone());
        let solver = Solver::Partial(Box::new(partial));
        let parts = (LinearSolver::SparseSchur, pattern, solver, Some(pairs));
        let system = BundleSystem::of_parts(variables, parts);
        Ok((Self { system, is_border, right: Vec::new() }, price.bytes))
    }

    /// The scalars of the border, or those inside.
    fn scalars(&self, border: bool) -> impl Iterator<Item = usize> {
        let sizes = &self.system.variables.layout.block_sizes;
        let blocks = self.is_border.iter().zip(&self.system.offsets).zip(sizes);
        blocks
            .filter(move |((is_border, _), _)| **is_border == border)
            .flat_map(|((_, &offset), &size)| offset..offset + size)
    }

    fn on_border(&self, values: &[f64]) -> Vec<f64> {
        self.scalars(true).map(|i| values[i]).collect()
    }

    /// The unknowns of the border, in order.
    pub(in super::super) fn border(&self) -> Vec<BorderPart> {
        let layout = &self.system.variables.layout;
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

    /// How many unknowns those are.
    pub(in super::super) fn border_dimension(&self) -> usize {
        self.scalars(true).count()
    }

    pub(in super::super) fn set_interrupt(&mut self, interrupt: &Interrupt) {
        self.system.variables.interrupt = interrupt.clone();
    }

    pub(in super::super) fn values(&self) -> Values {
        let variables = &self.system.variables;
        let BundleProblem { poses, cameras, .. } = &*variables.problem;
        let (poses, cameras) = (poses.clone(), cameras.clone());
        Values { poses, cameras, landmarks: variables.landmarks() }
    }

    /// Sets the variables; there are as many as in [`Self::values`].
    pub(in super::super) fn set_values(&mut self, values: &Values) {
        self.system.variables.set(&values.poses, &values.cameras, &values.landmarks);
        self.system.eliminated_for = None;
    }

    pub(in super::super) fn cost(&mut self) -> f64 {
        self.system.variables.cost()
    }

    /// Linearizes and eliminates.
    pub(in super::super) fn contribute(&mut self, damping: f64, stiffness: f64) -> Contribution {
        let system = &mut self.system;
        system.variables.stiffness = stiffness;
        system.eliminate(damping);
        let (mut is_definite, mut gradient_max_norm) = system.eliminator.landmarks();
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
            let outcome =
                partial.factor_until(&system.reduced, &added, &system.variables.interrupt);
            is_definite = outcome.is_ok();
            if is_definite {
                matrix = partial.border_matrix();
                right = partial.reduce(&self.right);
            }
        }
        Contribution { gradient_max_norm, is_definite, matrix, right, gradient, diagonal }
    }

    /// The step inside for that of the border, after [`Self::contribute`].
    pub(in super::super) fn step(&mut self, damping: f64, border: &[f64]) -> StepPart {
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

    /// Moves along the last step, from the values that are set; returns the cost.
    pub(in super::super) fn move_along(&mut self, motion: Motion) -> f64 {
        self.system.has_inner_iterations = motion.has_inner_iterations;
        self.system.move_by(motion.length)
    }
}
