//! Dense mapping: a surface from depth, color and poses, which forgets what moved.
//!
//! | file | role |
//! |---|---|
//! | `block` | 8³ voxels |
//! | `volume` | the sparse grid of blocks |

pub mod block;
pub mod volume;
