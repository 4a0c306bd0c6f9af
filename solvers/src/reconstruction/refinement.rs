//! The stages of a reconstruction after the first poses: adjustments, resection, relative poses.
//!
//! Points are triangulated anew before each adjustment, with a gate that narrows; keyframes that too few
//! observations hold lose their poses, and may get others by resection. What it adjusts is `pipeline`'s
//! estimate; the order of the stages is described there.

use super::adjustment::{Adjustment, adjust};
use super::bearings::{Bearing, Bearings};
use super::pipeline::Run;
use super::points::{Acceptance, triangulate_all};
use super::resection::{ObservedPoint, exact, resect};
use super::{Estimate, Options, Stage, Unplaced, frame};
use crate::bundle_adjustment;
use crate::factors::RelativePose;
use crate::geometric_verification::Numbers;
use crate::geometry::{LieGroup, Se3};
use crate::loss::Loss;
use crate::optimizer::{self, IterationSummary};
use crate::parallel;
use crate::problem::SolveError;

/// Rays that are off by more than this are not adjusted at first, rad.
const FIRST_GATE_RAD: f64 = 0.05;
/// Whitened error of an observation that agrees: normal noise is so long in one of 9·10⁶.
const LAST_GATE: f64 = 5.66;
/// The gate narrows by this factor from round to round.
const NARROWING: f64 = 4.0;
/// Iterations of an adjustment but the last.
const ROUND_ITERATIONS: usize = 25;
/// Passes over the keyframes without a pose.
const RESECTION_PASSES: usize = 12;
/// Share of a keyframe's placed landmarks that must agree with its resection.
const LEAST_SHARE: f64 = 0.25;

impl Run<'_, '_> {
    /// Points anew, with the gate in standard deviations.
    fn triangulate(&mut self, gate: f64) {
        let acceptance = Acceptance {
            gate,
            min_parallax_rad: self.options.min_parallax_rad,
            seed: self.options.seed,
        };
        triangulate_all(&self.bearings, &mut self.estimate, &acceptance, &self.interrupt);
    }

    /// The gate of observations that agree.
    fn last_gate(&self) -> f64 {
        LAST_GATE
            * frame::noise_factor(&self.bearings, &self.estimate).min(self.options.sigma_allowance)
    }

    /// Stage 5, its first part.
    pub(super) fn adjust_narrowing(&mut self) -> Result<(), SolveError> {
        let mut sigmas: Vec<f64> =
            self.bearings.all.iter().filter(|s| s.is_usable()).map(|s| s.sigma_rad).collect();
        let mut gate = FIRST_GATE_RAD / super::median(&mut sigmas).max(f64::MIN_POSITIVE);
        loop {
            gate = gate.max(self.last_gate());
            self.triangulate(gate);
            self.drop_weak();
            let loss = Loss::Huber((gate / 3.0).max(2.0));
            self.adjust(loss, false, ROUND_ITERATIONS)?;
            if gate <= self.last_gate() || self.is_due() {
                return Ok(());
            }
            gate /= NARROWING;
        }
    }

    /// Takes the poses of keyframes that too few observations hold.
    fn drop_weak(&mut self) {
        loop {
            let mut counts = vec![0; self.problem.poses.len()];
            let used = self.bearings.all.iter().zip(&self.estimate.used).filter(|(_, used)| **used);
            used.for_each(|(bearing, _)| counts[bearing.pose] += 1);
            let needed = self.options.min_observations;
            let mut dropped = false;
            for (pose, &agreeing) in counts.iter().enumerate() {
                let is_weak = agreeing < needed && !self.is_strung[pose];
                if is_weak && self.estimate.poses[pose].take().is_some() {
                    self.reasons[pose] = Unplaced::Inconsistent { agreeing, needed };
                    dropped = true;
                }
            }
            if !dropped {
                return;
            }
            // Points that those alone held go with them.
            let mut views = vec![(0, false); self.problem.landmarks.len()];
            for (bearing, used) in self.bearings.all.iter().zip(&mut self.estimate.used) {
                *used &= self.estimate.poses[bearing.pose].is_some();
                if *used {
                    views[bearing.landmark].0 += 1;
                    views[bearing.landmark].1 |= bearing.seen.depth_m.is_some();
                }
            }
            for (bearing, used) in self.bearings.all.iter().zip(&mut self.estimate.used) {
                let (count, has_depth) = views[bearing.landmark];
                if count < 2 && !has_depth {
                    *used = false;
                    self.estimate.points[bearing.landmark] = None;
                }
            }
        }
    }

    fn adjust(
        &mut self,
        loss: Loss,
        with_intrinsics: bool,
        max_iterations: usize,
    ) -> Result<(), SolveError> {
        if self.is_due() {
            return Ok(());
        }
        let constant = &self.problem.constant_cameras;
        let relative_poses: Vec<RelativePose<Se3, 6>> = self
            .problem
            .relative_poses
            .iter()
            .filter(|factor| self.is_strung[factor.i] || self.is_strung[factor.j])
            .filter(|factor| {
                let placed = |pose: usize| self.estimate.poses[pose].is_some();
                placed(factor.i) && placed(factor.j)
            })
            .copied()
            .collect();
        let adjustment = Adjustment {
            loss,
            constant_cameras: constant.iter().map(|&held| held || !with_intrinsics).collect(),
            free_parameters: &self.problem.free_parameters,
            relative_poses: &relative_poses,
            options: bundle_adjustment::Options {
                optimizer: optimizer::Options {
                    max_iterations: max_iterations.min(self.options.optimizer.max_iterations),
                    deadline: None,
                    threads: None,
                    ..self.options.optimizer
                },
                linear_solver: self.options.linear_solver,
                ..bundle_adjustment::Options::default()
            },
        };
        let report = &mut self.report;
        let mut row = |row: &IterationSummary| {
            report.tell(Stage::Adjustment, row.iteration, max_iterations, Some(row.cost))
        };
        let summary =
            adjust(&self.bearings, &mut self.estimate, adjustment, &self.interrupt, &mut row)?;
        if summary.is_some() {
            self.adjustment = summary;
        }
        if with_intrinsics {
            self.bearings.set_cameras(&self.estimate.cameras);
        }
        Ok(())
    }

    /// Stage 5, its second part: keyframes without a pose against the points.
    pub(super) fn resect_all(&mut self) -> Result<(), SolveError> {
        for pass in 0..RESECTION_PASSES {
            if self.is_due() {
                return Ok(());
            }
            let open: Vec<usize> = (0..self.problem.poses.len())
                .filter(|&pose| self.estimate.poses[pose].is_none())
                .filter(|&pose| !self.bearings.of_pose[pose].is_empty())
                .collect();
            let (bearings, estimate, options) = (&self.bearings, &self.estimate, self.options);
            let interrupt = &self.interrupt;
            let one = |&pose: &usize| match interrupt.is_due() {
                true => Err(0),
                false => resected(bearings, estimate, options, pose, pass),
            };
            let found = parallel::map(open.iter(), one);
            if self.is_due() {
                return Ok(());
            }
            let mut placed = false;
            for (&pose, found) in open.iter().zip(&found) {
                match *found {
                    Ok(found) => {
                        self.estimate.poses[pose] = Some(found);
                        placed = true;
                    }
                    Err(agreeing) if agreeing > 0 => {
                        let needed = self.options.min_observations;
                        self.reasons[pose] = Unplaced::Inconsistent { agreeing, needed };
                    }
                    Err(_) => {}
                }
            }
            let count = self.estimate.poses.iter().flatten().count();
            self.report.tell(Stage::Resection, count, self.problem.poses.len(), None);
            if !placed {
                return Ok(());
            }
            self.triangulate(self.last_gate() * 2.0);
            self.drop_weak();
            self.adjust(Loss::Huber(3.0), false, ROUND_ITERATIONS)?;
            self.triangulate(self.last_gate());
            self.drop_weak();
        }
        Ok(())
    }

    /// Stage 6.
    pub(super) fn string_along_relative_poses(&mut self) -> Result<(), SolveError> {
        if self.is_due() || self.problem.relative_poses.is_empty() {
            return Ok(());
        }
        let is_open = |estimate: &Estimate| estimate.poses.iter().any(Option::is_none);
        if !is_open(&self.estimate) || self.placed() == 0 {
            return Ok(());
        }
        if !self.has_depth() {
            let Some(scale) = frame::scale_by_relative_poses(self.problem, &self.estimate) else {
                return Ok(());
            };
            frame::rescale(&mut self.estimate, scale);
        }
        let mut is_new = true;
        let mut any = false;
        while is_new {
            is_new = false;
            for factor in &self.problem.relative_poses {
                let (i, j) = (self.estimate.poses[factor.i], self.estimate.poses[factor.j]);
                let (pose, placed) = match (i, j) {
                    (Some(i), None) => (factor.j, i.compose(&factor.i_from_j)),
                    (None, Some(j)) => (factor.i, j.compose(&factor.i_from_j.inverse())),
                    _ => continue,
                };
                self.estimate.poses[pose] = Some(placed);
                self.is_strung[pose] = true;
                (is_new, any) = (true, true);
            }
        }
        if any {
            self.triangulate(2.0 * self.last_gate());
            self.adjust(Loss::Huber(3.0), false, ROUND_ITERATIONS)?;
            self.triangulate(self.last_gate());
        }
        Ok(())
    }

    /// Intrinsics join in where they may, and the loss is the problem's.
    pub(super) fn adjust_last(&mut self) -> Result<(), SolveError> {
        let has_free = self.problem.constant_cameras.iter().any(|&constant| !constant);
        if has_free {
            self.adjust(Loss::Huber(3.0), true, ROUND_ITERATIONS)?;
        }
        if self.is_due() {
            return Ok(());
        }
        self.triangulate(self.last_gate());
        self.drop_weak();
        let iterations = self.options.optimizer.max_iterations;
        self.adjust(self.problem.observation_loss, has_free, iterations)
    }
}

/// A pose by the placed points; else how many bearings agree at best, 0 where it sees too few.
fn resected(
    bearings: &Bearings,
    estimate: &Estimate,
    options: &Options,
    pose: usize,
    pass: usize,
) -> Result<Se3, usize> {
    let own: Vec<&Bearing> =
        bearings.of_pose[pose].iter().map(|&index| bearings.get(index)).collect();
    let Some(camera) = own.first().map(|bearing| bearing.camera) else { return Err(0) };
    let seen: Vec<ObservedPoint<'_>> = own
        .into_iter()
        .filter(|bearing| bearing.camera == camera)
        .filter_map(|bearing| {
            let point = estimate.points[bearing.landmark]?;
            Some(ObservedPoint { point: exact(point), bearing })
        })
        .collect();
    let least = options.min_observations.max((seen.len() as f64 * LEAST_SHARE) as usize);
    let mut numbers = Numbers::new(options.seed ^ ((pose as u64) << 8) ^ pass as u64);
    let camera = &estimate.cameras[camera];
    resect(camera, &seen, options.sigma_allowance, least, &mut numbers)
        .map(|found| found.motion.a_from_b)
}
