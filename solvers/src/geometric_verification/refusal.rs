//! Why a candidate is refused, and what is wrong with an input.
//!
//! The reasons are a closed set with names, so that they can be kept and listed. Nothing is decided here.

use thiserror::Error;

/// Why a candidate is not taken for the place of the query.
#[derive(Clone, Copy, Debug, PartialEq, Error)]
pub enum Refusal {
    /// Matches that can be used: those with a weight.
    #[error("{matches} matches, fewer than {needed}")]
    TooFewMatches {
        /// How many there are.
        matches: usize,
        /// How many are needed.
        needed: usize,
    },
    /// No pose has so many inliers that chance is excluded.
    #[error("{inliers} inliers, fewer than {needed}: chance may explain them")]
    TooFewInliers {
        /// Inliers of the best pose; of those that show one patch of the scene, one.
        inliers: usize,
        /// How many are needed among so many matches.
        needed: usize,
    },
    /// A turn about the line is not determined.
    #[error("the inliers are within {share:.3} of their length from one line")]
    OneLine {
        /// Deviation across the line over that along it.
        share: f64,
    },
    /// The inliers may lie on an object that moves, or on a picture that exists twice.
    #[error("the inliers cover {share:.3} of the image")]
    SmallRegion {
        /// Share of the area that features have in the image where it is smaller.
        share: f64,
    },
    /// A plane that is seen from afar, without depth: two poses explain it.
    #[error("the inliers are on a plane that another pose explains as well, chi2 {chi2:.1} more")]
    MirroredPlane {
        /// By how much χ² of the other pose is larger.
        chi2: f64,
    },
    /// The inliers leave a direction open.
    #[error("the pose is known only to {rotation_rad:.3} rad and {distance:.3} of the distance")]
    Undetermined {
        /// Largest standard deviation of the rotation, rad.
        rotation_rad: f64,
        /// Largest standard deviation of the translation, over the median depth of the inliers.
        distance: f64,
    },
    /// Landmarks match in one part of what the pose shows, and hardly beside it: a thing that exists twice.
    #[error(
        "on {share:.2} of what the pose shows matches are as frequent as around its {independent} inliers"
    )]
    Unexplained {
        /// Share of the landmarks that the pose has in the image.
        share: f64,
        /// Inliers; of those that show one patch of the scene, one.
        independent: usize,
    },
    /// Other matches agree on another pose: the scene repeats itself.
    #[error("another pose has {rival} inliers, and the best one has {inliers}")]
    Ambiguous {
        /// Inliers of the best pose.
        inliers: usize,
        /// Inliers of the other pose, none of them among the former.
        rival: usize,
    },
    /// The odometry contradicts the pose.
    #[error("improbable by odometry: chi2 {chi2:.1} above {limit:.1}")]
    Improbable {
        /// Of the difference, with six degrees of freedom.
        chi2: f64,
        /// Its limit.
        limit: f64,
    },
    /// No pose fits the inliers as a least-squares solution.
    #[error("the refinement of the pose failed")]
    RefinementFailed,
}

impl Refusal {
    /// Name of the reason, in snake case: what lists and counters are sorted by.
    #[must_use]
    pub fn name(&self) -> &'static str {
        match self {
            Self::TooFewMatches { .. } => "too_few_matches",
            Self::TooFewInliers { .. } => "too_few_inliers",
            Self::OneLine { .. } => "one_line",
            Self::SmallRegion { .. } => "small_region",
            Self::MirroredPlane { .. } => "mirrored_plane",
            Self::Undetermined { .. } => "undetermined",
            Self::Unexplained { .. } => "unexplained",
            Self::Ambiguous { .. } => "ambiguous",
            Self::Improbable { .. } => "improbable",
            Self::RefinementFailed => "refinement_failed",
        }
    }
}

/// What is wrong with an input.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Error)]
pub enum InputError {
    /// A number is not finite, or out of its range.
    #[error("{what} {index} is not finite or out of range")]
    Number {
        /// What it belongs to.
        what: &'static str,
        /// Which one.
        index: usize,
    },
    /// A match names what is not there.
    #[error("match {index} names {what} {named} of {count}")]
    NoSuch {
        /// Which match.
        index: usize,
        /// What it names.
        what: &'static str,
        /// The index that it names.
        named: usize,
        /// How many there are.
        count: usize,
    },
    /// A point or a feature is in two matches.
    #[error("match {index} has a {what} of an earlier match")]
    Twice {
        /// Which match.
        index: usize,
        /// What is named twice.
        what: &'static str,
    },
}
