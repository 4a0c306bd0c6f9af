//! Tracking: the pose of the current frame.
//!
//! | file | the paper's section |
//! |---|---|
//! | [`rotation`] | a first guess, for cameras that turn fast |
//! | [`alignment`], `patches` | A. initial estimate of the pose, equations 1 to 4 |
//! | [`surfaces`] | whether depth agrees with it |
//! | [`local_matching`], `patch_match` | B. feature points, equations 5 to 7 |
//! | [`refinement`] | D. pose optimization, equation 8 |
//! | [`keyframe`] | when a frame becomes a keyframe, and its new landmarks |
//! | [`points`] | the points for the alignment of the next frame |
//!
//! C, the detection of movement, is `crate::motion`.

pub mod alignment;
pub mod keyframe;
pub mod local_matching;
mod patch_match;
mod patches;
pub mod points;
pub mod refinement;
pub mod rotation;
pub mod surfaces;
#[cfg(test)]
mod tests;
