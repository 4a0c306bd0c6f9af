//! Extracts the surface of a volume, where distances change their sign, block by block.
//!
//! | file | role |
//! |---|---|
//! | `cases` | which triangles a cell has |
//! | `bits` | sign and visibility of a block's voxels as bits, with their neighbors' |
//! | `piece` | the vertices and triangles of one block |
//! | `cache` | pieces that follow a volume as it changes |
//! | `mesh` | pieces joined to one mesh |
//!
//! A cell is the cube between eight neighboring voxels; it belongs to the block of its lowest voxel and
//! has triangles where all eight were seen near the surface. A vertex lies on an edge of cells and
//! belongs to the block of the edge's lower voxel, which creates it once. Pieces refer to vertices by
//! their edges, so that the joined mesh is indexed and closed across the borders of blocks. The volume
//! is only read; results do not depend on the number of threads.

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

/// Which voxels count as surface.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SurfaceOptions {
    /// Least weight of each of a cell's eight voxels, in weights of one observation.
    pub least_weight: f32,
}

impl Default for SurfaceOptions {
    /// Three frames, also at the largest depth in use: there one has 1/256 of its weight at a meter.
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

/// The surface of a volume that may be partly on disk, region by region. The whole mesh, its pieces and
/// 300 bytes per block are in memory. Blocks in memory stay below the volume's ceiling, unless a single
/// region and those next to it need more.
///
/// # Errors
/// Blocks cannot be read from disk, or others have no room there.
pub fn extract_paged(volume: &mut PagedVolume, options: SurfaceOptions) -> Result<Mesh, PageError> {
    let mut cache = SurfaceCache::new(options);
    cache.update_paged(volume, usize::MAX)?;
    Ok(cache.mesh())
}
