//! What a number, a vector or a depth must be wherever a map checks one: finite, and positive where its
//! description says so.
//!
//! Plain functions of numbers; they know no map, no event and no error.

use nalgebra::SVector;

use super::Depth;

/// Whether a number is finite and greater than 0.
pub(super) fn is_positive(value: f64) -> bool {
    value.is_finite() && value > 0.0
}

/// Whether all coordinates are finite.
pub(super) fn is_finite<const N: usize>(vector: &SVector<f64, N>) -> bool {
    vector.iter().all(|value| value.is_finite())
}

/// Whether a depth and its deviation are finite and greater than 0.
pub(super) fn is_depth(depth: &Depth) -> bool {
    is_positive(depth.depth_m) && is_positive(depth.sigma_m)
}
