//! Dense mapping: a surface from depth, color and poses, which forgets what moved.
//!
//! | file | role |
//! |---|---|
//! | `block` | 8³ voxels |
//! | `slabs`, `slab_pool` | memory for blocks |
//! | `volume` | the sparse grid of blocks |
//! | `packing` | blocks as bytes |
//! | `pages` | bytes that are put away on disk |
//! | `region` | what goes to disk and comes back together |
//! | `page_cache` | which regions stay in memory |
//! | `paged` | a volume part of which may be on disk |
//! | `lanes` | sixteen numbers at a time |
//! | `options` | how frames become a surface |
//! | `dilation` | masks that are taken larger |
//! | `tiles` | nearest and farthest depth of parts of an image |
//! | `pixels` | a frame as voxels read it |
//! | `frustum` | the space that a camera sees |
//! | `ray_blocks`, `rays` | which blocks a frame's rays pass near their depth |
//! | `visibility` | which blocks a frame sees |
//! | `fuse` | what a frame does to a block |
//! | `dynamic` | what a voxel does with what disagrees |
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
mod dilation;
mod dynamic;
pub mod export;
pub mod file;
pub mod frame_log;
mod frustum;
mod fuse;
pub mod integrate;
mod lanes;
pub mod mapper;
pub mod navigation;
mod options;
mod packing;
mod page_cache;
pub mod paged;
pub mod pages;
mod pixels;
pub mod pose_track;
mod ray_blocks;
mod rays;
mod region;
mod slab_pool;
mod slabs;
pub mod surface;
#[cfg(test)]
mod testing;
#[cfg(test)]
mod tests;
pub mod thread;
mod tiles;
mod visibility;
pub mod volume;
