//! Marquardt's scaling D of the damping λD, for every system that the loop drives.

/// Diagonal entries of D are kept in this range: directions without information are damped, and
/// products of two entries are finite.
///
/// It is wide, since where it cuts, the damping depends on the unit of length. A larger lower end
/// would hold landmarks on their way to infinity by an absolute length (at a million kilometers a
/// pixel still says 1e-13 per m²); a smaller upper end would leave a landmark next to a camera's
/// center plane undamped.
pub(crate) const SCALE_RANGE: (f64, f64) = (1e-18, 1e150);

/// The entry of D at a diagonal entry of H.
pub(crate) fn damping_scale(diagonal: f64) -> f64 {
    diagonal.clamp(SCALE_RANGE.0, SCALE_RANGE.1)
}
