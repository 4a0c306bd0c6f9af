//! Points that can be found again: corners, their descriptors, matches, and the motion they tell.
//!
//! Used once a keyframe, and where the camera is lost; frames between are tracked without it.
//!
//! | module | role |
//! |---|---|
//! | [`corners`] | where to look: FAST corners, the best of each cell |
//! | [`descriptor`] | what it looks like: 256 bits that turn with the image |
//! | [`matching`] | which is which: mutual nearest descriptors |
//! | [`rigid_alignment`] | where the camera is: RANSAC over matched points with depth |
//!
//! All are pure functions of their arguments; what they draw at random comes from a seed.

pub mod corners;
pub mod descriptor;
pub mod matching;
pub mod rigid_alignment;
mod splitmix;
#[cfg(test)]
mod tests;
