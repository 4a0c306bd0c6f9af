//! The reference frontend: semi-direct RGB-D tracking that ignores what moves.
//!
//! It shows how a frontend uses covis: it reaches the server through [`crate::client`] alone, like a
//! stranger. Rooms, lowest floor first:
//!
//! | module | role |
//! |---|---|
//! | [`image`] | images, and a frame with color and depth |
//! | [`features`] | corners, descriptors, matches and the pose they tell |

pub mod features;
pub mod image;
