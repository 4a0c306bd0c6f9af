//! Dense mapping: a surface from depth, color and poses, which forgets what moved.
//!
//! | file | role |
//! |---|---|
//! | `block` | 8³ voxels |
//! | `slabs` | memory for blocks |
//! | `volume` | the sparse grid of blocks |
//! | `lanes` | sixteen numbers at a time |
//! | `tiles` | nearest and farthest depth of parts of an image |
//! | `pixels` | a frame as voxels read it |
//! | `reach` | which blocks a frame's rays pass |
//! | `sight` | which blocks a frame sees |
//! | `fuse` | what a frame does to a block |
//! | `dynamic` | what a block does with what changed |
//! | `integrate` | frames into a volume |
//! | `frame_log` | frames that may have to be integrated again |
//! | `mapper` | a volume that follows corrections |
//! | `thread` | dense mapping beside tracking |
//! | `pose_track` | poses between poses |
//! | `surface` | triangles where the distance is zero |
//! | `export` | meshes as PLY and GLB |
//! | `file` | volumes as files |
//! | `navigation` | the ground from above: occupancy and distances |

pub mod block;
mod dynamic;
pub mod export;
pub mod file;
pub mod frame_log;
mod fuse;
pub mod integrate;
mod lanes;
pub mod mapper;
pub mod navigation;
mod pixels;
pub mod pose_track;
mod reach;
mod sight;
mod slabs;
pub mod surface;
#[cfg(test)]
mod testing;
pub mod thread;
mod tiles;
pub mod volume;

#[cfg(test)]
mod tests;
