//! The pairs of matched poses between which a relative error is measured, as evo's `--delta`,
//! `--delta_unit` and `--all_pairs` choose them.
//!
//! Otherwise pairs are consecutive, each beginning where the last one ended: after delta poses, or with the
//! first pose at which the path, or the angle, added up from pose to pose, reaches delta. With all pairs each
//! pose begins its own: with the pose delta later; with the later pose to which the length of the path is
//! nearest to delta, of equally near ones the first; or with every later pose whose angle to it, on the
//! direct way, is delta. Path and angle may then differ from delta by the tolerance, inclusive.

use std::f64::consts::PI;

use covis_solvers::geometry::{LieGroup, Se3};

use super::{EvaluationError, angle_rad};

/// The unit of a delta.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum DeltaUnit {
    /// Matched poses, a whole number.
    #[default]
    Frames,
    /// Length of the path, m.
    Meters,
    /// Angle, degrees, at most 180.
    Degrees,
    /// Angle, radians, at most π.
    Radians,
}

impl DeltaUnit {
    /// Its name, for people.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Frames => "poses",
            Self::Meters => "m",
            Self::Degrees => "deg",
            Self::Radians => "rad",
        }
    }
}

/// Which pairs of poses a relative error is measured between; by default neighbors.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MotionPairs {
    /// How far apart the poses of a pair are, positive.
    pub delta: f64,
    /// The unit of `delta`.
    pub unit: DeltaUnit,
    /// Each pose begins a pair; otherwise pairs are consecutive.
    pub all_pairs: bool,
    /// By which share of `delta` path or angle may differ from it. Read for all pairs only.
    pub tolerance: f64,
    /// Path and angle are the truth's; otherwise the aligned estimate's.
    pub from_truth: bool,
}

impl Default for MotionPairs {
    fn default() -> Self {
        Self {
            delta: 1.0,
            unit: DeltaUnit::Frames,
            all_pairs: false,
            tolerance: 0.1,
            from_truth: false,
        }
    }
}

impl MotionPairs {
    /// Indices of the first and last poses of the pairs among `poses`, rising by the first ones.
    ///
    /// # Errors
    /// [`EvaluationError`] where delta or tolerance has no meaning, or no pair is found.
    pub(super) fn among(&self, poses: &[Se3]) -> Result<Vec<(usize, usize)>, EvaluationError> {
        self.check()?;
        let pairs = match (self.unit, self.all_pairs) {
            (DeltaUnit::Frames, all) => self.by_index(poses.len(), all),
            (DeltaUnit::Meters, false) => {
                consecutive(poses, self.delta, |a, b| (a.translation - b.translation).norm())
            }
            (DeltaUnit::Meters, true) => self.all_by_path(poses),
            (DeltaUnit::Degrees | DeltaUnit::Radians, false) => {
                consecutive(poses, self.radians(self.delta), angle_between)
            }
            (DeltaUnit::Degrees | DeltaUnit::Radians, true) => self.all_by_angle(poses),
        };
        if pairs.is_empty() {
            let (delta, unit) = (self.delta, self.unit.name());
            return Err(EvaluationError::NoMotions { delta, unit });
        }
        Ok(pairs)
    }

    fn check(&self) -> Result<(), EvaluationError> {
        let must = |must| {
            let (delta, unit) = (self.delta, self.unit.name());
            Err(EvaluationError::InvalidMotion { delta, unit, must })
        };
        if !(self.delta.is_finite() && self.delta > 0.0) {
            return must("finite and positive");
        }
        if !(self.tolerance.is_finite() && self.tolerance >= 0.0) {
            return Err(EvaluationError::InvalidTolerance { value: self.tolerance });
        }
        match self.unit {
            DeltaUnit::Frames if self.delta.fract() != 0.0 => must("a whole number"),
            DeltaUnit::Degrees if self.delta > 180.0 => must("at most 180"),
            DeltaUnit::Radians if self.delta > PI => must("at most pi"),
            DeltaUnit::Frames | DeltaUnit::Meters | DeltaUnit::Degrees | DeltaUnit::Radians => {
                Ok(())
            }
        }
    }

    /// An angle in the unit of delta, in radians.
    fn radians(&self, angle: f64) -> f64 {
        if self.unit == DeltaUnit::Degrees { angle.to_radians() } else { angle }
    }

    fn by_index(&self, count: usize, all: bool) -> Vec<(usize, usize)> {
        // A delta beyond all poses saturates.
        let delta = self.delta as usize;
        let starts = (0..count.saturating_sub(delta)).step_by(if all { 1 } else { delta });
        starts.map(|start| (start, start + delta)).collect()
    }

    fn all_by_path(&self, poses: &[Se3]) -> Vec<(usize, usize)> {
        let mut path_m = 0.0;
        let steps = poses.windows(2).map(|both| (both[0].translation - both[1].translation).norm());
        let later = steps.map(|step| {
            path_m += step;
            path_m
        });
        let paths: Vec<f64> = std::iter::once(0.0).chain(later).collect();
        let tolerance = self.delta * self.tolerance;
        let pair = |start: usize| {
            let off = |index: usize| paths[index] - paths[start] - self.delta;
            let first_from = |bound: f64| {
                let ahead = &paths[start + 1..];
                start + 1 + ahead.partition_point(|path| path - paths[start] - self.delta < bound)
            };
            // Paths never fall: the nearest is the first past delta, or the first of those as long as the
            // last before it.
            let past = first_from(0.0);
            let before = (past > start + 1).then(|| first_from(off(past - 1)));
            let candidates = before.into_iter().chain((past < paths.len()).then_some(past));
            // Of equally near ones the first is taken.
            let end = candidates.min_by(|&a, &b| off(a).abs().total_cmp(&off(b).abs()))?;
            (off(end).abs() <= tolerance).then_some((start, end))
        };
        (0..poses.len().saturating_sub(1)).filter_map(pair).collect()
    }

    /// Compares each pose with each later one.
    fn all_by_angle(&self, poses: &[Se3]) -> Vec<(usize, usize)> {
        let delta = self.radians(self.delta);
        let tolerance = self.radians(self.delta * self.tolerance);
        let range = delta - tolerance..=delta + tolerance;
        let mut pairs = Vec::new();
        for (start, pose) in poses.iter().enumerate() {
            for (end, later) in poses.iter().enumerate().skip(start + 1) {
                if range.contains(&angle_between(pose, later)) {
                    pairs.push((start, end));
                }
            }
        }
        pairs
    }
}

/// The angle of the rotation between two poses, radians.
fn angle_between(a: &Se3, b: &Se3) -> f64 {
    angle_rad(&a.rotation.inverse().compose(&b.rotation))
}

/// Pairs that follow each other, each from the end of the last to where the steps reach `delta`.
fn consecutive(poses: &[Se3], delta: f64, step: impl Fn(&Se3, &Se3) -> f64) -> Vec<(usize, usize)> {
    let (mut pairs, mut start, mut sum) = (Vec::new(), 0, 0.0);
    for (index, both) in poses.windows(2).enumerate() {
        sum += step(&both[0], &both[1]);
        if sum >= delta {
            pairs.push((start, index + 1));
            (start, sum) = (index + 1, 0.0);
        }
    }
    pairs
}
