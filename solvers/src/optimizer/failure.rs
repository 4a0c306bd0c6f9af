//! What a plan that fails says of the problem. Values at fault are not told here: who knows the
//! variable behind a row names it.

use crate::linear::LinearError;
use crate::problem::SolveError;

/// The error of a problem for whose system of `dimension` scalars planning or memory failed.
pub(crate) fn from_linear(error: LinearError, dimension: usize) -> SolveError {
    match error {
        LinearError::Interrupted => SolveError::Interrupted,
        LinearError::TooExpensive(error) => SolveError::TooExpensive(error),
        LinearError::NotPositiveDefinite { .. }
        | LinearError::NonFinite { .. }
        | LinearError::DimensionMismatch { .. }
        | LinearError::PatternMismatch { .. }
        | LinearError::TooLarge { .. }
        | LinearError::OutOfMemory { .. } => SolveError::TooLarge { dimension },
    }
}
