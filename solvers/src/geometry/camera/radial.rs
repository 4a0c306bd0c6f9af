//! The inverse of an increasing scalar distortion profile, by Newton steps kept in a bracket.
//!
//! Shared by the models whose distortion moves pixels along rays from the center. It must not be
//! given a profile that turns back inside the bracket: callers cut the bracket at the first fold.

/// Iterations after which bisection alone would have resolved any bracket.
const MAX_ITERATIONS: usize = 100;

/// The root of `profile(r) = target` in [`low`, `high`], where the profile increases.
///
/// `profile` returns its value and derivative. `None` when the bracket holds no root.
pub(super) fn invert(
    profile: impl Fn(f64) -> (f64, f64),
    target: f64,
    mut low: f64,
    mut high: f64,
) -> Option<f64> {
    let inside = profile(low).0 <= target && target <= profile(high).0;
    if !inside {
        return None;
    }
    let mut r = target.clamp(low, high);
    for _ in 0..MAX_ITERATIONS {
        let (value, slope) = profile(r);
        if value < target {
            low = r;
        } else {
            high = r;
        }
        let newton = r - (value - target) / slope;
        let next = if newton >= low && newton <= high { newton } else { 0.5 * (low + high) };
        if (next - r).abs() <= 2.0 * f64::EPSILON * next.abs() {
            return Some(next);
        }
        r = next;
    }
    r.is_finite().then_some(r)
}
