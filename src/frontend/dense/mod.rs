//! Dense mapping: a surface from depth, color and poses, which forgets what moved.
//!
//! | file | role |
//! |---|---|
//! | `block` | 8³ voxels |
//! | `volume` | the sparse grid of blocks |
//! | `surface` | triangles where the distance is zero |

pub mod block;
pub mod surface;
#[cfg(test)]
mod testing;
pub mod volume;
