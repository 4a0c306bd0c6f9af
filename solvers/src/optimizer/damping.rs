//! Marquardt's scaling D of the damping λD, for every system that the loop drives.

/// Diagonal entries of D are kept in this range, so that directions without information are damped.
pub(crate) const SCALE_RANGE: (f64, f64) = (1e-6, 1e32);

/// The entry of D at a diagonal entry of H.
pub(crate) fn damping_scale(diagonal: f64) -> f64 {
    diagonal.clamp(SCALE_RANGE.0, SCALE_RANGE.1)
}
