//! What of a pose error is measured: evo's pose relations, by evo's names.
//!
//! E is the error of a pose or of a motion, R its rotation, t its translation and θ its angle:
//! `trans_part` is ‖t‖, `rot_part` ‖R − I‖ (Frobenius, 2√2 sin(θ/2)), `full` ‖E − I‖ (Frobenius,
//! √(‖R − I‖² + ‖t‖²)), `angle_deg` and `angle_rad` θ. `point_distance` compares lengths instead of
//! vectors, d = | ‖p_j − p_i‖ of the truth − that of the estimate |; of an absolute error it is `trans_part`.
//! `point_distance_error_ratio` is 100 d over the true length, and is left out where that is 0.

use super::{Evaluation, EvaluationError, PoseError, Statistics};

/// A figure of a [`PoseError`].
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum PoseRelation {
    /// Length of the translation error, m.
    #[default]
    TranslationPart,
    /// ‖R − I‖ of the rotation error, Frobenius.
    RotationPart,
    /// ‖E − I‖ of the whole error, Frobenius; it adds meters to numbers without a unit.
    Full,
    /// Angle of the rotation error, degrees.
    AngleDeg,
    /// Angle of the rotation error, radians.
    AngleRad,
    /// Difference of the lengths of both motions, m.
    PointDistance,
    /// The same over the length of the true motion, percent.
    PointDistanceErrorRatio,
}

impl PoseRelation {
    /// All of them.
    pub const ALL: [Self; 7] = [
        Self::TranslationPart,
        Self::RotationPart,
        Self::Full,
        Self::AngleDeg,
        Self::AngleRad,
        Self::PointDistance,
        Self::PointDistanceErrorRatio,
    ];

    /// evo's name (`--pose_relation`).
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::TranslationPart => "trans_part",
            Self::RotationPart => "rot_part",
            Self::Full => "full",
            Self::AngleDeg => "angle_deg",
            Self::AngleRad => "angle_rad",
            Self::PointDistance => "point_distance",
            Self::PointDistanceErrorRatio => "point_distance_error_ratio",
        }
    }

    /// What it is, for people.
    #[must_use]
    pub fn title(self) -> &'static str {
        match self {
            Self::TranslationPart => "translation",
            Self::RotationPart => "rotation part",
            Self::Full => "full transformation",
            Self::AngleDeg | Self::AngleRad => "rotation",
            Self::PointDistance => "distance",
            Self::PointDistanceErrorRatio => "distance ratio",
        }
    }

    /// Its unit, where it has one.
    #[must_use]
    pub fn unit(self) -> Option<&'static str> {
        match self {
            Self::TranslationPart | Self::PointDistance => Some("m"),
            Self::RotationPart | Self::Full => None,
            Self::AngleDeg => Some("deg"),
            Self::AngleRad => Some("rad"),
            Self::PointDistanceErrorRatio => Some("%"),
        }
    }

    /// The figure of an error; `None` for the ratio of an absolute error, or where the truth does not move.
    #[must_use]
    pub fn of(self, error: &PoseError) -> Option<f64> {
        match self {
            Self::TranslationPart => Some(error.translation_m),
            Self::RotationPart => Some(error.rotation_part),
            Self::Full => Some(error.rotation_part.hypot(error.translation_m)),
            Self::AngleDeg => Some(error.angle_deg),
            Self::AngleRad => Some(error.angle_deg.to_radians()),
            Self::PointDistance => Some(error.distance_m),
            Self::PointDistanceErrorRatio => {
                let moved = error.true_distance_m.filter(|&distance_m| distance_m != 0.0);
                moved.map(|distance_m| error.distance_m / distance_m * 100.0)
            }
        }
    }
}

impl Evaluation {
    /// The statistics of one relation. Errors without this figure are left out.
    ///
    /// # Errors
    /// [`EvaluationError::NoRatio`] where none has it.
    pub fn statistics(&self, relation: PoseRelation) -> Result<Statistics, EvaluationError> {
        let figures: Vec<f64> = self.errors.iter().filter_map(|e| relation.of(e)).collect();
        if figures.is_empty() {
            return Err(EvaluationError::NoRatio);
        }
        Ok(Statistics::of(&figures))
    }
}
