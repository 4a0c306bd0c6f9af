//! Why a problem cannot be solved as posed.
//!
//! Not converging is an outcome, not an error. Variants carry what names the culprit: the kind, the
//! index or the id; nothing here is prose of another module.

use super::Piece;
use crate::price::TooExpensive;

/// A problem that no solver could solve as posed, with the variable or factor that makes it so.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum SolveError {
    /// There is no factor, or no variable that may move.
    #[error("nothing to solve: {0}")]
    Empty(&'static str),
    /// A factor refers to a variable that the problem does not hold.
    #[error("{factor} {index}: {variable} {value} does not exist (there are {count})")]
    IndexOutOfRange {
        /// The kind of factor.
        factor: &'static str,
        /// The factor's position in its batch, from 0.
        index: usize,
        /// The kind of variable.
        variable: &'static str,
        /// The index that the factor names.
        value: usize,
        /// How many variables of that kind there are.
        count: usize,
    },
    /// Arrays that describe the same things differ in length.
    #[error("{what} has {actual} entries, {expected} are needed")]
    LengthMismatch {
        /// The array.
        what: &'static str,
        /// Its length.
        actual: usize,
        /// The length it must have.
        expected: usize,
    },
    /// A variable or measurement is NaN or infinite.
    #[error("{what} {index} is not finite")]
    NotFinite {
        /// The kind of variable or factor.
        what: &'static str,
        /// Its index, or its id where it has one.
        index: i64,
    },
    /// A factor cannot be evaluated at the start, for instance a point in the camera's center plane.
    #[error("{factor} {index} has no finite residual at the start")]
    ResidualNotFinite {
        /// The kind of factor.
        factor: &'static str,
        /// Its position in its batch, from 0.
        index: usize,
    },
    /// An information matrix or sigma is not positive definite.
    #[error("{factor} {index}: the information matrix is not positive definite")]
    NotPositiveDefinite {
        /// The kind of factor.
        factor: &'static str,
        /// Its position in its batch, from 0.
        index: usize,
    },
    /// The loss of one factor has a width that is not finite and positive.
    #[error("{factor} {index}: the width of its loss must be finite and positive")]
    BadLoss {
        /// The kind of factor.
        factor: &'static str,
        /// Its position in its batch, from 0.
        index: usize,
    },
    /// A range is between a variable and itself.
    #[error("range {index} is between a variable and itself")]
    SelfRange {
        /// Its position in its batch, from 0.
        index: usize,
    },
    /// The factors leave a variable open: a system that must have one solution has none or many.
    #[error("the {what} {id} is not determined by the factors")]
    Singular {
        /// What is open, with the kind of variable: "rotation of pose".
        what: &'static str,
        /// The variable's id.
        id: i64,
    },
    /// A pose graph is in several pieces that no factor ties together.
    #[error("the graph is in {} pieces: {}", .pieces.len(), Piece::describe(.pieces))]
    Disconnected {
        /// The pieces, the one with the lowest id first.
        pieces: Vec<Piece>,
    },
    /// Two variables share an id.
    #[error("{what} id {id} occurs twice")]
    DuplicateId {
        /// The kind of variable.
        what: &'static str,
        /// The id.
        id: i64,
    },
    /// An option is out of its range.
    #[error("option {field}: {reason}")]
    InvalidOption {
        /// The option's name.
        field: &'static str,
        /// What is wrong with it.
        reason: &'static str,
    },
    /// The linear system does not fit into memory or 32-bit indices.
    #[error("the linear system of dimension {dimension} is too large")]
    TooLarge {
        /// Scalars in the system.
        dimension: usize,
    },
    /// The estimate of memory or work passes the ceiling of the options; nothing was begun.
    #[error(transparent)]
    TooExpensive(#[from] TooExpensive),
    /// The time was up, or the caller left, before there was anything to answer but the start.
    #[error("the time limit passed before the solve began")]
    Interrupted,
    /// The worker threads could not be started.
    #[error("{count} worker threads could not be started")]
    Threads {
        /// How many were asked for.
        count: usize,
    },
}

impl SolveError {
    /// The same of a whole that takes `bytes` more: those that a part was not told of.
    #[must_use]
    pub fn beside(self, bytes: u64) -> Self {
        if let Self::TooExpensive(error) = self {
            return Self::TooExpensive(error.beside(bytes));
        }
        self
    }

    /// The same of two parts alike, each of which had half the ceiling.
    #[must_use]
    pub fn twice(self) -> Self {
        if let Self::TooExpensive(error) = self {
            return Self::TooExpensive(error.twice());
        }
        self
    }
}
