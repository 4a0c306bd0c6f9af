//! The reference frontend: semi-direct RGB-D tracking that ignores what moves.
//!
//! It shows how a frontend uses covis: it reaches the server through [`crate::client`] alone, like a
//! stranger. Rooms, lowest floor first:
//!
//! | module | role |
//! |---|---|
//! | [`image`] | images, and a frame with color and depth |
//! | [`input`] | where frames come from: recorded folders |
//! | [`synthetic`] | ray-cast sequences with known truth |
//! | [`features`] | corners, descriptors, matches and the pose they tell |

pub mod features;
pub mod image;
pub mod input;
pub mod synthetic;
