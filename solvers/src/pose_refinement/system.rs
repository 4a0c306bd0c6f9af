//! One pose as the trust-region loop sees it: six unknowns and a dense system.
//!
//! Cost, H and g come from one pass, made where a step is tried: most steps are accepted, and then
//! the next linearization is there already. Steps solve (H + λD) δ = −g and move T ← T · Exp(δ). It
//! takes no decision of the loop.

use nalgebra::SVector;

use super::normal_equations::Evaluation;
use super::observations::Observations;
use super::{PointObservation, one_by_one};
use crate::factors::PosePrior;
use crate::geometry::{Camera, LieGroup, Se3};
use crate::loss::Loss;
use crate::optimizer::{Gradient, Step, StepFailure, System, damping_scale};
use crate::problem::SolveError;

/// What the cost is made of.
pub(super) struct Terms<'a> {
    pub(super) camera: &'a Camera,
    pub(super) list: &'a [PointObservation],
    pub(super) packed: &'a Observations<'a>,
    pub(super) prior: Option<PosePrior>,
    pub(super) loss: Loss,
}

impl Terms<'_> {
    /// Cost, H and g at `pose`.
    pub(super) fn evaluate(&self, pose: &Se3) -> Evaluation {
        self.complete(self.packed.evaluate(pose, self.loss), pose)
    }

    /// What the kernels summed, redone where it is not finite, and the prior.
    fn complete(&self, mut sum: Evaluation, pose: &Se3) -> Evaluation {
        if !sum.is_finite() {
            sum = one_by_one::evaluate(self.list, pose, self.camera, self.loss);
        }
        if let Some(prior) = &self.prior {
            let (residual, d_pose) = prior.linearize(pose);
            let left = d_pose.transpose() * prior.information.matrix();
            sum.cost += 0.5 * prior.information.squared_norm(&residual);
            sum.hessian += left * d_pose;
            sum.gradient += left * residual;
        }
        sum
    }
}

/// A pose and what the terms are there.
#[derive(Clone, Copy)]
struct State {
    pose: Se3,
    value: Evaluation,
}

pub(super) struct PoseSystem<'a> {
    terms: Terms<'a>,
    state: State,
    /// The state before the last applied step.
    backup: State,
    step: SVector<f64, 6>,
}

impl<'a> PoseSystem<'a> {
    /// # Errors
    /// [`SolveError`] names the first observation that is invalid or has no finite residual.
    pub(super) fn new(terms: Terms<'a>, pose: Se3) -> Result<Self, SolveError> {
        let sum = terms.packed.evaluate(&pose, terms.loss);
        if !(terms.packed.sound && sum.is_finite()) {
            one_by_one::validate(terms.list, &pose, terms.camera)?;
        }
        let state = State { pose, value: terms.complete(sum, &pose) };
        Ok(Self { terms, state, backup: state, step: SVector::zeros() })
    }

    pub(super) fn pose(&self) -> &Se3 {
        &self.state.pose
    }

    /// Cost, H and g at the pose.
    pub(super) fn value(&self) -> &Evaluation {
        &self.state.value
    }

    fn scale(&self, i: usize) -> f64 {
        damping_scale(self.state.value.hessian[(i, i)])
    }
}

impl System for PoseSystem<'_> {
    fn cost(&mut self) -> f64 {
        self.state.value.cost
    }

    fn linearize(&mut self, _damping: f64) -> Gradient {
        let entry = |i: usize| self.state.value.gradient[i].abs() / self.scale(i).sqrt();
        // A NaN must win: it would claim convergence otherwise.
        let largest = |a: f64, b: f64| if b > a || b.is_nan() { b } else { a };
        Gradient { max_norm: (0..6).map(entry).fold(0.0, largest) }
    }

    fn solve(&mut self, damping: f64) -> Result<Step, StepFailure> {
        let Evaluation { hessian, gradient, .. } = &self.state.value;
        let mut damped = *hessian;
        for i in 0..6 {
            damped[(i, i)] += damping * self.scale(i);
        }
        let factor = damped.cholesky().ok_or(StepFailure)?;
        let step = -factor.solve(gradient);
        let norm = step.norm();
        if !norm.is_finite() {
            return Err(StepFailure);
        }
        let residual = (damped * step + gradient).norm();
        let decrease = |i: usize| step[i] * (damping * self.scale(i) * step[i] - gradient[i]);
        let step_summary = Step {
            predicted_decrease: 0.5 * (0..6).map(decrease).sum::<f64>(),
            norm,
            state_norm: self.state.pose.translation.norm() + 1.0,
            linear_residual: residual / gradient.norm().max(f64::MIN_POSITIVE),
            is_inexact: false,
        };
        self.step = step;
        Ok(step_summary)
    }

    fn apply(&mut self) -> f64 {
        self.backup = self.state;
        let pose = self.state.pose.plus(&self.step);
        self.state = State { pose, value: self.terms.evaluate(&pose) };
        self.state.value.cost
    }

    fn restore(&mut self) {
        self.state = self.backup;
    }
}
