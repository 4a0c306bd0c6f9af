//! The noise of depth that structured light measures.
//!
//! Other cameras need another formula. `update` computes the same one for many voxels at a time.

/// Standard deviation of a measured depth, meters: axial noise of the Kinect (Nguyen, Izadi and
/// Lovell, 3DIMPVT 2012), which grows with the square of the distance.
#[inline]
#[must_use]
pub fn sigma_m(depth_m: f64) -> f64 {
    let beyond = (depth_m - 0.4).max(0.0);
    0.0012 + 0.0019 * beyond * beyond
}
