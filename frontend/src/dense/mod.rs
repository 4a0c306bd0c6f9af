//! Dense mapping: fuses depth and color at known poses into a truncated signed distance field (TSDF), takes
//! the surface out of it, and frees voxels where something moved away.
//!
//! | file | role |
//! |---|---|
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
pub mod export;
pub mod file;
pub mod frame_log;
mod fuse;
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
