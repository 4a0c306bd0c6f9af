//! Out of the volume: the surface where distances change their sign, block by block.
//!
//! | file | role |
//! |---|---|
//! | `cases` | which triangles a cell has |
//! | `bits` | signs and sight of a block's voxels as bits, with their neighbors' |
//! | `piece` | the vertices and triangles of one block |
//! | `cache` | pieces that follow a volume as it changes |
//! | `mesh` | pieces joined to one mesh |
//!
//! A cell is the cube between eight neighboring voxels; it belongs to the block of its lowest voxel
//! and has triangles where all eight were seen near the surface. A vertex lies on an edge of cells and belongs to the
//! block of the edge's lower voxel, which makes it once; pieces name vertices by their edges, so that
//! the joined mesh is indexed and closed over the borders of blocks. Reads the volume, changes
//! nothing in it; results do not depend on the number of threads.

mod bits;
mod cache;
mod cases;
mod mesh;
mod piece;
#[cfg(test)]
mod tests;

pub use cache::SurfaceCache;
pub use mesh::Mesh;
pub use piece::Vertex;

use super::paged::PagedVolume;
use super::pages::PageError;
use super::volume::Volume;

/// What counts as surface.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SurfaceOptions {
    /// Weight that each of a cell's eight voxels must have at least, in weights of one observation.
    pub least_weight: f32,
}

impl Default for SurfaceOptions {
    /// Three frames, also of what is as far as depth is used: there one weighs a 256th of what it does
    /// at a meter.
    fn default() -> Self {
        Self { least_weight: 3.0 / 256.0 }
    }
}

/// The surface of a whole volume in memory.
#[must_use]
pub fn extract(volume: &Volume, options: SurfaceOptions) -> Mesh {
    let mut cache = SurfaceCache::new(options);
    cache.update(volume);
    cache.mesh()
}

/// The surface of a whole volume part of which may be on disk, region by region. The mesh, its pieces
/// and 300 bytes a block are in memory as a whole; of the blocks no more than the volume's ceiling allows,
/// but for what a single region needs: itself and those next to it.
///
/// # Errors
/// Where blocks do not come back from disk or others have no room there.
pub fn extract_paged(volume: &mut PagedVolume, options: SurfaceOptions) -> Result<Mesh, PageError> {
    let mut cache = SurfaceCache::new(options);
    cache.update_paged(volume, usize::MAX)?;
    Ok(cache.mesh())
}
