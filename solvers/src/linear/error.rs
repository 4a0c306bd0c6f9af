//! What can go wrong between a block matrix and its factor.
//!
//! Every variant carries the place in the caller's own (unpermuted) numbering, so that a layer
//! above can name the variable behind it. Nothing here panics or holds text made elsewhere.

use thiserror::Error;

use crate::price::TooExpensive;

/// Why a plan or a factorization was refused.
#[derive(Debug, Clone, PartialEq, Error)]
pub enum LinearError {
    /// H + D has a pivot that is zero or negative: the system is indefinite or singular.
    #[error("matrix is not positive definite: pivot of scalar {scalar} (block {block})")]
    NotPositiveDefinite {
        /// Block of the failing pivot.
        block: usize,
        /// Scalar row of the failing pivot.
        scalar: usize,
    },
    /// H or D holds a NaN or an infinity, or the factor overflowed.
    #[error("matrix holds a value that is not finite, in block row {block}")]
    NonFinite {
        /// Block row of the first value found.
        block: usize,
    },
    /// A vector has the wrong length.
    #[error("vector has length {found}, the system has dimension {expected}")]
    DimensionMismatch {
        /// Scalars in the system.
        expected: usize,
        /// Length of the vector given.
        found: usize,
    },
    /// The matrix is not on the pattern that the plan was made for.
    #[error("matrix of {found} blocks is not on the pattern of {expected} blocks planned for")]
    PatternMismatch {
        /// Stored blocks in the plan's pattern.
        expected: usize,
        /// Stored blocks in the matrix's pattern.
        found: usize,
    },
    /// The system or its factor has more entries than 32-bit indices count.
    #[error("system of dimension {dimension} has a factor too large to index")]
    TooLarge {
        /// Scalars in the system.
        dimension: usize,
    },
    /// Planning showed that the factorization would pass the ceiling; nothing large was allocated.
    #[error(transparent)]
    TooExpensive(#[from] TooExpensive),
    /// The deadline passed, or the caller left, within the work.
    #[error("the work was interrupted")]
    Interrupted,
    /// Memory for the factor could not be had.
    #[error("no memory for the factor of a system of dimension {dimension}")]
    OutOfMemory {
        /// Scalars in the system.
        dimension: usize,
    },
}
