//! Why two trajectories, or two masks, cannot be compared.
//!
//! The messages name no file: the caller knows which ones it read.

/// Two trajectories, or two masks, that cannot be compared.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[allow(missing_docs, reason = "the messages say what the fields are")]
pub enum EvaluationError {
    /// No pose of one has a partner in the other.
    #[error(
        "no timestamps of ground truth and estimate are within {max_difference_s} s of each other"
    )]
    NoMatches {
        /// The largest difference that was allowed, in seconds.
        max_difference_s: f64,
    },
    /// The largest time difference is negative or not finite.
    #[error("the largest time difference is {value} s; it must be finite and not negative")]
    InvalidTimeDifference { value: f64 },
    /// An RPE needs at least two matched poses.
    #[error("{pairs} matched poses; a relative error needs two")]
    TooFewPairs { pairs: usize },
    /// The time over which a drift is asked for is not positive or not finite.
    #[error("the time between two poses is {value} s; it must be finite and positive")]
    InvalidDelta { value: f64 },
    /// Too few poses of the estimate are this far apart and have a truth.
    #[error("{pairs} pairs of poses are {delta_s} s apart and have ground truth; two are needed")]
    TooFewApart {
        pairs: usize,
        /// The time between the poses of a pair, in seconds.
        delta_s: f64,
    },
    /// The delta between the poses of a pair is no such number.
    #[error("a delta of {delta} {unit} must be {must}")]
    InvalidMotion {
        delta: f64,
        unit: &'static str,
        /// What it must be.
        must: &'static str,
    },
    /// The tolerance of a delta is negative or not finite.
    #[error("the tolerance of the delta is {value}; it must be finite and not negative")]
    InvalidTolerance { value: f64 },
    /// No two poses are a delta apart.
    #[error(
        "no two matched poses are a delta of {delta} {unit} apart; a smaller delta, or a larger \
         tolerance with all pairs, may find some"
    )]
    NoMotions { delta: f64, unit: &'static str },
    /// There is nothing to divide a distance error by.
    #[error(
        "point_distance_error_ratio is a share of true motions, and the truth moves between the \
         poses of no pair"
    )]
    NoRatio,
    /// Two masks of one frame differ in size.
    #[error("the ground-truth mask has {truth} pixels, the estimated one {estimate}")]
    UnequalMasks {
        /// Pixels of the truth.
        truth: usize,
        /// Pixels of the estimate.
        estimate: usize,
    },
    /// The matched positions do not determine a rotation: they lie on a line or in a point.
    #[error(
        "{pairs} matched positions do not determine a rotation (their covariance has rank {rank})"
    )]
    Degenerate {
        pairs: usize,
        /// Singular values of their covariance that are not zero.
        rank: usize,
    },
}
