//! Dense mapping: a surface from depth, color and poses, which forgets what moved.
//!
//! | file | role |
//! |---|---|
//! | `block` | 8³ voxels |
//! | `volume` | the sparse grid of blocks |
//! | `surface` | triangles where the distance is zero |
//! | `export` | meshes as PLY and GLB |
//! | `file` | volumes as files |

pub mod block;
pub mod export;
pub mod file;
pub mod surface;
#[cfg(test)]
mod testing;
pub mod volume;
