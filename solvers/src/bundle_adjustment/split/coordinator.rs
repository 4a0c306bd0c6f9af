//! The coordinator: the whole problem as the trust-region loop sees it, its work done by workers.
//!
//! Each linearization asks every section for what it leaves on its border; the sums make the
//! separators' system, whose step goes back. Costs, gradients and the step's figures are sums too, so
//! that the loop decides as it would over the whole. Sums are in the order of the sections.
//!
//! The coordinator has the values of all variables. A worker that is lost is started again and is sent
//! what the pending request needs; results depend on nothing else of a worker's state. It evaluates no
//! residual itself.

use super::SplitError;
use super::crew::{Crew, Opening, Question};
use super::message::{Contribution, Linearize, Motion, Reply, START, Source, StepPart, Version};
use super::partition::Partition;
use super::section::Values;
use super::separator::Separator;
use super::workers::Workers;
use crate::interrupt::Interrupt;
use crate::loss::Loss;
use crate::optimizer::{Gradient, Losses, Step, StepFailure, System};
use crate::price::Ceiling;
use crate::problem::BundleProblem;

/// The whole problem.
pub(super) struct Coordinator<'a> {
    problem: &'a BundleProblem,
    partition: &'a Partition,
    ceiling: Ceiling,
    interrupt: &'a Interrupt,
    pub(super) crew: Crew<'a>,
    separator: Option<Separator>,
    current: Values,
    version: Version,
    before: Values,
    version_before: Version,
    newest: Version,
    stiffness: f64,
    has_inner_iterations: bool,
    /// The linearization that the separators' system is the sum of, and whether it can be solved.
    linearized: Option<(Linearize, bool)>,
    trial: Option<Trial>,
}

/// A step that was solved for.
struct Trial {
    linearize: Linearize,
    /// Over all separators.
    step: Vec<f64>,
    moved: Option<(Version, f64, Vec<Values>)>,
}

impl<'a> Coordinator<'a> {
    pub(super) fn new(
        problem: &'a BundleProblem,
        partition: &'a Partition,
        sources: Vec<Source>,
        workers: &'a mut dyn Workers,
        opening: Opening,
        interrupt: &'a Interrupt,
    ) -> Self {
        Self {
            problem,
            partition,
            ceiling: opening.ceiling,
            interrupt,
            crew: Crew::new(problem, partition, sources, workers, opening, interrupt),
            separator: None,
            current: Values::of(problem),
            version: START,
            before: Values::default(),
            version_before: START,
            newest: START,
            stiffness: 1.0,
            has_inner_iterations: false,
            linearized: None,
            trial: None,
        }
    }

    /// Has every section loaded and plans the separators' system. Without a result where it was
    /// interrupted or the crew's failure says why.
    pub(super) fn load(&mut self) -> Option<()> {
        self.crew.ask(&Question::Load, (START, &self.current))?;
        let borders = self.crew.borders();
        let (problem, partition) = (self.problem, self.partition);
        let planned = Separator::new(problem, partition, &borders, self.ceiling, self.interrupt);
        match planned {
            Ok(Some(separator)) => {
                self.separator = Some(separator);
                Some(())
            }
            Ok(None) => self.crew.fail(SplitError::Answer { what: "border" }),
            Err(error) => self.crew.fail(error.into()),
        }
    }

    /// Unknowns of the separators.
    pub(super) fn separator_dimension(&self) -> usize {
        self.separator.as_ref().map_or(0, Separator::dimension)
    }

    /// The values that were found.
    pub(super) fn into_values(self) -> Values {
        self.current
    }

    fn contribute(&mut self, damping: f64) -> Option<f64> {
        let linearize = Linearize { base: self.version, damping, stiffness: self.stiffness };
        self.linearized = None;
        let replies =
            self.crew.ask(&Question::Contribute(linearize), (self.version, &self.current))?;
        let mut separator = self.separator.take()?;
        separator.clear();
        let (mut max_norm, mut is_definite) = (0.0, true);
        let mut is_sound = true;
        for (s, reply) in replies.iter().enumerate() {
            let Reply::Contributed(contribution) = reply else {
                is_sound = false;
                continue;
            };
            max_norm = f64::max(max_norm, contribution.gradient_max_norm);
            is_definite &= contribution.is_definite;
            is_sound &= is_finite(contribution) && separator.add(s, contribution);
        }
        if !is_sound {
            return self.crew.fail(SplitError::Answer { what: "contribution" });
        }
        let max_norm = f64::max(max_norm, separator.gradient_max_norm());
        self.separator = Some(separator);
        self.linearized = Some((linearize, is_definite));
        Some(max_norm)
    }

    /// Takes the trial's step so far; returns the replies' values and costs summed.
    fn take_step(&mut self, trial: &Trial, length: f64) -> Option<Moved> {
        let motion = Motion { length, has_inner_iterations: self.has_inner_iterations };
        self.newest += 1;
        let (linearize, version) = (trial.linearize, self.newest);
        let separator = self.separator.as_ref()?;
        let sections = 0..self.partition.sections.len();
        let steps: Vec<_> = sections.map(|s| separator.gathered(s, &trial.step)).collect();
        let question = Question::Move(linearize, &steps, motion, version);
        let is_current = linearize.base == self.version;
        let base = if is_current { &self.current } else { &self.before };
        let replies = self.crew.ask(&question, (linearize.base, base))?;
        let mut moved = Moved { version, cost: 0.0, values: Vec::new(), parts: Vec::new() };
        for (reply, members) in replies.into_iter().zip(&self.partition.sections) {
            let Reply::Moved { part, cost, values } = reply else {
                return self.crew.fail(SplitError::Answer { what: "reply" });
            };
            let like = (values.poses.len(), values.cameras.len(), values.landmarks.len());
            if like != (members.poses.len(), members.cameras.len(), members.landmarks.len()) {
                return self.crew.fail(SplitError::Answer { what: "values" });
            }
            moved.cost += cost;
            moved.values.push(values);
            moved.parts.push(part);
        }
        Some(moved)
    }

    /// Puts the sections' values into the current ones.
    fn adopt(&mut self, version: Version, values: &[Values]) {
        for (values, members) in values.iter().zip(&self.partition.sections) {
            values.scatter(members, &mut self.current);
        }
        self.version = version;
        self.linearized = None;
    }

    fn solve_step(&mut self, damping: f64) -> Option<Result<Step, StepFailure>> {
        let wanted = Linearize { base: self.version, damping, stiffness: self.stiffness };
        if self.linearized.is_none_or(|(linearized, _)| linearized != wanted) {
            self.contribute(damping)?;
        }
        if self.linearized.is_none_or(|(_, is_definite)| !is_definite) {
            return Some(Err(StepFailure));
        }
        let separator = self.separator.as_mut()?;
        let added = separator.added(damping);
        let Ok(step) = separator.solve(&added, self.interrupt) else {
            return Some(Err(StepFailure));
        };
        let (mut decrease, mut squared) = separator.decrease(&step, &added);
        let trial = Trial { linearize: wanted, step, moved: None };
        let moved = self.take_step(&trial, 1.0)?;
        let separator = self.separator.as_ref()?;
        let (mut residual_squared, mut right_squared) = (0.0, 0.0);
        let mut residual: Vec<f64> = trial.step.iter().zip(&added).map(|(x, d)| -d * x).collect();
        let mut right = vec![0.0; residual.len()];
        for (s, part) in moved.parts.iter().enumerate() {
            decrease += part.decrease;
            squared += part.squared;
            residual_squared += part.residual_squared;
            right_squared += part.right_squared;
            let size = separator.gathered(s, &right).len();
            if part.border_residual.len() != size || part.border_right.len() != size {
                return self.crew.fail(SplitError::Answer { what: "step" });
            }
            separator.scatter(s, &part.border_residual, &mut residual);
            separator.scatter(s, &part.border_right, &mut right);
        }
        residual_squared += residual.iter().map(|x| x * x).sum::<f64>();
        right_squared += right.iter().map(|x| x * x).sum::<f64>();
        let ratio = if right_squared > 0.0 { residual_squared / right_squared } else { 0.0 };
        let linear_residual = ratio.sqrt();
        self.trial =
            Some(Trial { moved: Some((moved.version, moved.cost, moved.values)), ..trial });
        if ![decrease, squared, linear_residual].iter().all(|x| x.is_finite()) {
            return Some(Err(StepFailure));
        }
        let state_norm = self.current.poses.iter().map(|p| p.translation.norm_squared() + 1.0);
        Some(Ok(Step {
            predicted_decrease: 0.5 * decrease,
            norm: squared.sqrt(),
            state_norm: state_norm.sum::<f64>().sqrt(),
            linear_residual,
            is_inexact: false,
        }))
    }
}

/// What all sections moved to.
struct Moved {
    version: Version,
    cost: f64,
    values: Vec<Values>,
    parts: Vec<StepPart>,
}

fn is_finite(contribution: &Contribution) -> bool {
    // Other numbers may be infinite where the state cannot be linearized; the loop finds that.
    !contribution.is_definite || contribution.matrix.iter().all(|x| x.is_finite())
}

impl System for Coordinator<'_> {
    fn losses(&self) -> Losses {
        super::super::system::losses_of(self.problem)
    }

    fn begin_inner_iterations(&mut self) {
        self.has_inner_iterations = self.problem.observation_loss != Loss::Trivial;
    }

    fn set_stiffness(&mut self, stiffness: f64) {
        self.stiffness = stiffness;
        self.linearized = None;
    }

    fn cost(&mut self) -> f64 {
        let base = (self.version, &self.current);
        let Some(replies) = self.crew.ask(&Question::Cost, base) else { return f64::NAN };
        let cost = |reply: &Reply| if let Reply::Cost(cost) = reply { *cost } else { f64::NAN };
        replies.iter().map(cost).sum()
    }

    fn linearize(&mut self, damping: f64) -> Gradient {
        Gradient { max_norm: self.contribute(damping).unwrap_or(f64::NAN) }
    }

    fn solve(&mut self, damping: f64) -> Result<Step, StepFailure> {
        self.solve_step(damping).unwrap_or(Err(StepFailure))
    }

    fn apply(&mut self) -> f64 {
        let Some(trial) = &mut self.trial else { return f64::NAN };
        let Some((version, cost, values)) = trial.moved.take() else { return f64::NAN };
        self.before.clone_from(&self.current);
        self.version_before = self.version;
        self.adopt(version, &values);
        cost
    }

    fn apply_lengthened(&mut self, length: f64) -> Option<f64> {
        let trial = self.trial.take()?;
        let moved = self.take_step(&trial, length);
        self.trial = Some(trial);
        match moved {
            Some(moved) => {
                self.adopt(moved.version, &moved.values);
                Some(moved.cost)
            }
            None => Some(f64::NAN),
        }
    }

    fn restore(&mut self) {
        std::mem::swap(&mut self.current, &mut self.before);
        std::mem::swap(&mut self.version, &mut self.version_before);
        self.linearized = None;
    }
}
