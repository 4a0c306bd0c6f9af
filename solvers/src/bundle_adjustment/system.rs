//! Bundle adjustment as the trust-region loop sees it.
//!
//! One fused pass linearizes and eliminates for a damping at once; another damping at the same state
//! runs it again, since nothing of the size of the observations is kept. Landmarks live here in the
//! kernels' order and go back to the problem at the end. It takes no decision of the loop, and
//! `reduced_solver` chooses its linear solver.

use super::back_substitute::StepSums;
use super::covisible::ChunkPairs;
use super::eliminator::Eliminator;
use super::iterative::Linearization;
use super::landmarks::LandmarkGroup;
use super::reduce::{ReducedVectors, Reduction};
use super::reduced_solver::{Choice, Products, choose};
use super::sorted::GROUPS;
use super::state_factors;
use super::variables::{Backup, Move, Variables};
use super::{Keeper, LinearSolver};
use crate::linear::{BlockMatrix, Cholesky, LinearError, Solved};
use crate::loss::Loss;
use crate::optimizer::{
    Gradient, IterationSummary, LoopState, Losses, Step, StepFailure, System, damping_scale,
};
use crate::price::{Ceiling, Limits};
use crate::problem::{BundleProblem, SolveError};

/// A problem with its elimination and the solver of what that leaves.
pub(super) struct BundleSystem<'a> {
    variables: Variables<'a>,
    wish: LinearSolver,
    ceiling: Ceiling,
    linear_solver: LinearSolver,
    /// Whether it was chosen again, as conjugate gradients took too many products.
    left_iterative: bool,
    offsets: Vec<usize>,
    /// None where the reduced system is not formed.
    pairs: Option<Vec<ChunkPairs>>,
    reduction: Reduction,
    // The elimination for `eliminated_for`.
    eliminator: Box<dyn Eliminator>,
    groups: Vec<LandmarkGroup>,
    reduced: BlockMatrix,
    state_hessian: Option<BlockMatrix>,
    vectors: ReducedVectors,
    eliminated_for: Option<f64>,
    // The step.
    solver: Solver,
    step: Vec<f64>,
    point_steps: Vec<f64>,
    backup: Backup,
    /// Whether each step is followed by them.
    has_inner_iterations: bool,
    /// Keeps checkpoints.
    pub(super) keeper: Option<&'a mut (dyn Keeper + 'a)>,
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

/// How the reduced system is solved.
enum Solver {
    /// Exactly.
    Cholesky(Box<Cholesky>),
    /// Inexactly, while a step takes no more products than these.
    Iterative { most_products: f64 },
}

impl<'a> BundleSystem<'a> {
    pub(super) fn new(
        variables: Variables<'a>,
        wish: LinearSolver,
        limits: Limits<'_>,
    ) -> Result<Self, SolveError> {
        let (problem, layout) = (&*variables.problem, &*variables.layout);
        let costs = (variables.kernels.costs)(problem, layout);
        let choice = choose(problem, layout, wish, Products::Unknown, &costs, limits)?;
        let most_products = choice.most_products();
        let Choice { linear_solver, pattern, direct, .. } = choice;
        let (solver, pairs) = match direct {
            Some((cholesky, pairs)) => (Solver::Cholesky(cholesky), Some(pairs)),
            None => (Solver::Iterative { most_products }, None),
        };
        let dimension = pattern.dimension();
        Ok(Self {
            wish,
            ceiling: limits.ceiling,
            linear_solver,
            left_iterative: false,
            offsets: (0..pattern.block_count()).map(|b| pattern.offset(b)).collect(),
            reduction: Reduction::new(layout, pairs.as_deref().unwrap_or(&[]), &pattern),
            eliminator: (variables.kernels.eliminator)(layout, pairs.as_deref()),
            groups: vec![LandmarkGroup::ZERO; layout.sorted.tile_count() * GROUPS],
            state_hessian: state_factors::has_any(problem)
                .then(|| state_factors::hessian(problem, layout)),
            reduced: BlockMatrix::new(pattern),
            vectors: ReducedVectors::new(dimension),
            eliminated_for: None,
            solver,
            step: vec![0.0; dimension],
            point_steps: vec![0.0; variables.points_len()],
            backup: Backup::default(),
            has_inner_iterations: false,
            keeper: None,
            pairs,
            variables,
        })
    }

    pub(super) fn linear_solver(&self) -> LinearSolver {
        self.linear_solver
    }

    /// Chooses again after a step of so many products, where they were too many.
    pub(super) fn reconsider(&mut self, products: usize) {
        let Solver::Iterative { most_products } = &mut self.solver else { return };
        if self.wish != LinearSolver::Auto || products as f64 <= *most_products {
            return;
        }
        let (problem, layout) = (&*self.variables.problem, &*self.variables.layout);
        let costs = (self.variables.kernels.costs)(problem, layout);
        let limits = Limits { ceiling: self.ceiling, interrupt: &self.variables.interrupt };
        // What fails was no better choice: the ceiling is met by conjugate gradients, and a solve that is
        // interrupted ends with them.
        let choice =
            choose(problem, layout, self.wish, Products::Counted(products), &costs, limits);
        let Ok(choice) = choice else { return };
        *most_products = choice.most_products();
        let Choice { linear_solver, pattern, direct: Some((cholesky, pairs)), .. } = choice else {
            return;
        };
        self.reduction = Reduction::new(layout, &pairs, &pattern);
        self.eliminator = (self.variables.kernels.eliminator)(layout, Some(&pairs));
        self.reduced = BlockMatrix::new(pattern);
        self.solver = Solver::Cholesky(cholesky);
        self.pairs = Some(pairs);
        self.linear_solver = linear_solver;
        self.left_iterative = true;
        self.eliminated_for = None;
    }

    /// Puts the landmarks back into the problem.
    pub(super) fn finish(self) {
        self.variables.finish();
    }

    /// The fused pass over all chunks and the reduced system, for `damping`.
    fn eliminate(&mut self, damping: f64) {
        self.variables.fill_records();
        let pass = self.variables.pass();
        self.eliminator.eliminate(&pass, self.pairs.as_deref(), damping, &mut self.groups);
        self.eliminator.reduce(&pass, &self.reduction, &mut self.reduced, &mut self.vectors);
        if let Some(hessian) = &mut self.state_hessian {
            let mut gradient = vec![0.0; self.step.len()];
            let Variables { problem, layout, stiffness, .. } = &self.variables;
            state_factors::linearize(problem, layout, hessian, &mut gradient, *stiffness);
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

    /// Solves the reduced system for the step.
    fn solve_reduced(&mut self, added: &[f64]) -> Result<Solved, LinearError> {
        let right: Vec<f64> = self.vectors.reduced_gradient.iter().map(|g| -g).collect();
        if right.is_empty() {
            return Ok(Solved::default());
        }
        match &mut self.solver {
            Solver::Cholesky(cholesky) => {
                cholesky.factor_until(&self.reduced, added, &self.variables.interrupt)?;
                let relative_residual =
                    cholesky.solve_checked(&self.reduced, added, &right, &mut self.step);
                Ok(Solved { relative_residual, products: 0 })
            }
            Solver::Iterative { .. } => {
                let linearization = Linearization {
                    pass: self.variables.pass(),
                    offsets: &self.offsets,
                    groups: &self.groups,
                    state_hessian: self.state_hessian.as_ref(),
                    added,
                };
                self.eliminator.solve(&linearization, &self.reduced, &right, &mut self.step)
            }
        }
    }

    /// Landmark steps for the reduced step, and what they add to the step's figures.
    fn back_substitute(&mut self, damping: f64) -> StepSums {
        let pass = self.variables.pass();
        self.eliminator.back_substitute(
            &pass,
            damping,
            &self.groups,
            &self.offsets,
            &self.step,
            &mut self.point_steps,
        )
    }

    /// Moves the variables by a multiple of the step and returns the new cost.
    fn move_by(&mut self, length: f64) -> f64 {
        let Self { step, offsets, point_steps, .. } = self;
        self.variables.move_by(length, &Move { step, offsets, points: point_steps });
        self.eliminated_for = None;
        if self.has_inner_iterations {
            self.variables.minimize_landmarks();
        }
        self.variables.cost()
    }
}

impl System for BundleSystem<'_> {
    fn losses(&self) -> Losses {
        losses_of(self.variables.problem)
    }

    fn begin_inner_iterations(&mut self) {
        // Without a loss a step minimizes landmarks to first order as it is.
        self.has_inner_iterations = self.variables.problem.observation_loss != Loss::Trivial;
    }

    fn keep(&mut self, row: &IterationSummary, state: &dyn Fn() -> LoopState) {
        let Some(keeper) = self.keeper.take() else { return };
        if keeper.is_due(row) {
            keeper.keep(self.variables.to_checkpoint(state(), self.left_iterative));
        }
        self.keeper = Some(keeper);
    }

    fn set_stiffness(&mut self, stiffness: f64) {
        self.variables.stiffness = stiffness;
        self.eliminated_for = None;
    }

    fn cost(&mut self) -> f64 {
        self.variables.cost()
    }

    fn linearize(&mut self, damping: f64) -> Gradient {
        self.eliminate(damping);
        let (_, mut max_norm) = self.eliminator.landmarks();
        for (gradient, diagonal) in self.vectors.gradient.iter().zip(&self.vectors.diagonal) {
            max_norm = f64::max(max_norm, gradient.abs() / damping_scale(*diagonal).sqrt());
        }
        Gradient { max_norm }
    }

    fn solve(&mut self, damping: f64) -> Result<Step, StepFailure> {
        if self.eliminated_for != Some(damping) {
            self.eliminate(damping);
        }
        let (is_definite, _) = self.eliminator.landmarks();
        if self.variables.interrupt.is_due() || !is_definite {
            return Err(StepFailure);
        }
        let diagonal = self.vectors.diagonal.iter();
        let added: Vec<f64> = diagonal.map(|d| damping * damping_scale(*d)).collect();
        let solved = self.solve_reduced(&added).map_err(|_error| StepFailure)?;
        let linear_residual = solved.relative_residual;
        let mut sums = self.back_substitute(damping);
        for ((delta, added), gradient) in self.step.iter().zip(&added).zip(&self.vectors.gradient) {
            sums.decrease += delta * (added * delta - gradient);
            sums.squared += delta * delta;
        }
        let figures = [sums.decrease, sums.squared, linear_residual];
        if !figures.iter().all(|x| x.is_finite()) {
            return Err(StepFailure);
        }
        let is_inexact = matches!(self.solver, Solver::Iterative { .. });
        self.reconsider(solved.products);
        Ok(Step {
            predicted_decrease: 0.5 * sums.decrease,
            norm: sums.squared.sqrt(),
            state_norm: self.variables.norm(),
            linear_residual,
            is_inexact,
        })
    }

    fn apply(&mut self) -> f64 {
        self.variables.back_up(&mut self.backup);
        self.move_by(1.0)
    }

    fn apply_lengthened(&mut self, length: f64) -> Option<f64> {
        self.variables.restore(&self.backup);
        Some(self.move_by(length))
    }

    fn restore(&mut self) {
        self.variables.restore(&self.backup);
        self.eliminated_for = None;
    }
}
