//! Dense mapping: a surface from depth images at known poses.
//!
//! The crate fuses depth and color into a truncated signed distance field (TSDF), extracts its surface, and
//! frees voxels where something moved away. [`integrate`] fuses frames into a [`volume`]. [`mapper`] fuses
//! them again when their poses are corrected, and [`thread`] runs it beside tracking. A [`paged`] volume
//! keeps blocks far from the camera on disk. [`surface`] and [`export`] make meshes, [`mod@file`] stores
//! volumes, [`navigation`] makes grids to plan on. Results have the same bits on any number of threads.
//!
//! The crate may use [`covis_solvers`], threads, files and vector instructions. It must not use a server, a
//! client, messages or tokio. It does not track cameras: its callers, such as `covis-frontend`, do.
//!
//! | module | role |
//! |---|---|
//! | `image` | rows of pixels |
//! | `camera` | the lens, and the ray of each pixel |
//! | `depth` | noise of depth |
//! | `block` | 8³ voxels |
//! | `volume` | the sparse grid of blocks, and memory for them |
//! | `packing` | blocks as bytes, and pages of them |
//! | `pages` | pages of bytes in a file on disk |
//! | `page_cache` | regions: groups of blocks that are paged together, and which stay in memory |
//! | `paged` | a volume that may be partly on disk |
//! | `lanes` | sixteen numbers at a time |
//! | `tiles` | nearest and farthest depth of parts of an image |
//! | `pixels` | a frame as voxels read it, and its mask dilated |
//! | `rays` | which blocks a frame's rays pass near the measured depth |
//! | `visibility` | the space that a camera sees, and which blocks a frame sees |
//! | `update` | the rules of one voxel: weighted mean, and what frees and replaces voxels where the scene changes |
//! | `fuse` | fuses a frame into a block by those rules |
//! | `integrate` | integrates frames into a volume |
//! | `frame_log` | frames that may have to be integrated again |
//! | `mapper` | a volume that follows corrections |
//! | `thread` | dense mapping beside tracking |
//! | `pose_track` | interpolated poses |
//! | `surface` | triangles where the distance is zero |
//! | `export` | meshes as PLY and GLB |
//! | `file` | volumes as files |
//! | `navigation` | the ground from above: occupancy and distances |

pub mod block;
pub mod camera;
pub mod depth;
pub mod export;
pub mod file;
pub mod frame_log;
mod fuse;
pub mod image;
pub mod integrate;
mod lanes;
pub mod mapper;
pub mod navigation;
mod packing;
mod page_cache;
pub mod paged;
pub mod pages;
mod pixels;
pub mod pose_track;
mod rays;
pub mod surface;
#[cfg(test)]
mod testing;
#[cfg(test)]
mod tests;
pub mod thread;
mod tiles;
mod update;
mod visibility;
pub mod volume;
