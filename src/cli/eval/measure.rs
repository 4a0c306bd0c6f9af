//! What `covis eval ape|rpe` is asked to measure, and its words for it. It computes nothing.
//!
//! The defaults keep the words that they had before there were choices.

use std::num::NonZeroUsize;

use anyhow::ensure;

use crate::evaluation::{Alignment, Correction, DeltaUnit, MotionPairs, PoseRelation};

/// The motions of a relative error.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Motions {
    /// Between matched poses, as evo has it.
    Between(MotionPairs),
    /// Over a time, as the TUM scripts have it.
    Over {
        /// That time, seconds.
        delta_s: f64,
    },
}

/// What is measured of each estimate.
#[derive(Clone, Copy, Debug)]
pub(super) struct Measure {
    /// The motions that are compared; `None` for single poses.
    pub(super) motions: Option<Motions>,
    pub(super) alignment: Alignment,
    /// The relation that comes first.
    pub(super) relation: PoseRelation,
}

impl Measure {
    pub(super) fn new(
        motions: Option<Motions>,
        correction: Correction,
        relation: PoseRelation,
    ) -> Self {
        let alignment = Alignment { correction, first_poses: None };
        Self { motions, alignment, relation }
    }

    /// Fits the alignment to the first poses.
    ///
    /// # Errors
    /// Where nothing is fitted.
    pub(super) fn by_first_poses(mut self, count: Option<NonZeroUsize>) -> anyhow::Result<Self> {
        ensure!(
            count.is_none() || self.alignment.correction.is_fitted(),
            "--n-to-align is for --align se3, sim3 or scale; no alignment is fitted here"
        );
        self.alignment.first_poses = count;
        Ok(self)
    }

    pub(super) fn metric(&self) -> &'static str {
        if self.motions.is_none() { "ape" } else { "rpe" }
    }

    /// What is measured, beginning with a small letter.
    pub(super) fn title(&self) -> String {
        let aligned = match self.alignment.correction {
            Correction::None if self.motions.is_some() => "",
            Correction::None => ", not aligned",
            Correction::Se3 => ", SE(3) aligned",
            Correction::Sim3 => ", Sim(3) aligned",
            Correction::Scale => ", scale corrected",
            Correction::Origin => ", origin aligned",
        };
        let by = self.alignment.first_poses;
        let by = by.map(|count| format!(" by the first {count} poses")).unwrap_or_default();
        let what = match &self.motions {
            None => "absolute pose error".to_owned(),
            Some(Motions::Over { delta_s }) => format!("relative pose error over {delta_s} s"),
            Some(Motions::Between(pairs)) => format!("relative pose error{}", over(pairs)),
        };
        format!("{what}{aligned}{by}")
    }

    /// The relations that are shown: the first one, then translation and angle.
    pub(super) fn relations(&self) -> Vec<PoseRelation> {
        let others = [PoseRelation::TranslationPart, PoseRelation::AngleDeg];
        let others = others.into_iter().filter(|&relation| relation != self.relation);
        std::iter::once(self.relation).chain(others).collect()
    }
}

fn over(pairs: &MotionPairs) -> String {
    let MotionPairs { delta, unit, all_pairs, tolerance: _, from_truth } = pairs;
    let distance = match unit {
        DeltaUnit::Frames if *delta == 1.0 => ", one matched pose to the next".to_owned(),
        DeltaUnit::Frames => format!(" over {delta} matched poses"),
        DeltaUnit::Meters => format!(" over {delta} m of path"),
        DeltaUnit::Degrees | DeltaUnit::Radians => {
            format!(" over {delta} {} of rotation", unit.name())
        }
    };
    let all = if *all_pairs { ", all pairs" } else { "" };
    let of_truth = if *from_truth { ", pairs of the truth" } else { "" };
    format!("{distance}{all}{of_truth}")
}

/// A relation with its unit, as the head of a column: "translation (m)".
pub(super) fn head(relation: PoseRelation) -> String {
    match relation.unit() {
        Some(unit) => format!("{} ({unit})", relation.title()),
        None => relation.title().to_owned(),
    }
}
