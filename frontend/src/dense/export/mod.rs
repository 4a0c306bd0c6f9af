//! Meshes as files that other programs read: PLY and GLB.
//!
//! Files are in the frame of the mesh, meters, except where a format wants its own. Bytes are a
//! function of the mesh alone.

mod glb;
mod ply;

pub use glb::glb;
pub use ply::{ply, point_cloud_ply};
