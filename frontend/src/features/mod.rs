//! Points that can be found again: corners and their descriptors.
//!
//! Used once a keyframe, and where the camera is lost; frames between are tracked without it. The server
//! matches them.
//!
//! | module | role |
//! |---|---|
//! | [`corners`] | where to look: FAST corners, the best of each cell |
//! | [`descriptor`] | what it looks like: 256 bits that turn with the image |
//!
//! Both are pure functions of their arguments.

pub mod corners;
pub mod descriptor;
mod splitmix;
#[cfg(test)]
mod tests;
