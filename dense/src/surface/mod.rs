//! Extracts the surface of a volume, where distances change their sign, block by block.
//!
//! | file | role |
//! |---|---|
//! | `cases` | which triangles a cell has |
//! | `bits` | sign and visibility of a block's voxels as bits, with their neighbors' |
//! | `piece` | the vertices and triangles of one block |
//! | `cache` | pieces that follow a volume as it changes |
//!
//! A cell is the cube between eight neighboring voxels; it belongs to the block of its lowest voxel and
//! has triangles where all eight were seen near the surface. A vertex lies on an edge of cells and
//! belongs to the block of the edge's lower voxel, which creates it once. Pieces refer to vertices by
//! their edges, so that the joined mesh is indexed and closed across the borders of blocks. The volume
//! is only read; results do not depend on the number of threads.

mod bits;
mod cache;
mod cases;
mod piece;
#[cfg(test)]
mod tests;

use rayon::prelude::*;

use super::paged::PagedVolume;
use super::pages::PageError;
pub use cache::SurfaceCache;
use piece::Piece;

/// The surface of a volume that may be partly on disk, region by region. The whole mesh, its pieces and
/// 300 bytes per block are in memory. Blocks in memory stay below the volume's ceiling, unless a single
/// region and those next to it need more.
///
/// # Errors
/// Blocks cannot be read from disk, or others have no room there.
pub fn extract(volume: &mut PagedVolume) -> Result<Mesh, PageError> {
    let mut cache = SurfaceCache::default();
    cache.update(volume, usize::MAX)?;
    Ok(cache.mesh())
}

/// Triangles that share vertices, each property in its own list. They are counterclockwise as seen from
/// the observed side.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Mesh {
    /// Positions in the volume's frame, meters.
    pub positions: Vec<[f32; 3]>,
    /// Normals of length one, to the side from which the surface was seen; as many as positions.
    pub normals: Vec<[f32; 3]>,
    /// Red, green, blue; as many as positions.
    pub colors: Vec<[u8; 3]>,
    /// Triangles as indices of vertices.
    pub triangles: Vec<[u32; 3]>,
}

/// Joins pieces to a mesh with their vertices in the order of slots, each once; `next` gives the slots of
/// the pieces in which a piece's edges may begin (order as in `EdgeName::block`).
fn join(pieces: &[Option<Box<Piece>>], next: impl Fn(usize) -> [u32; 8] + Sync) -> Mesh {
    let mut first = Vec::with_capacity(pieces.len());
    let (mut vertices, mut triangles) = (0, 0);
    for piece in pieces {
        first.push(vertices as u32);
        if let Some(piece) = piece {
            vertices += piece.vertices.len();
            triangles += piece.triangles.len();
        }
    }
    let mut mesh = Mesh {
        positions: vec![[0.0; 3]; vertices],
        normals: vec![[0.0; 3]; vertices],
        colors: vec![[0; 3]; vertices],
        triangles: vec![[0; 3]; triangles],
    };
    let (mut positions, mut normals) = (&mut mesh.positions[..], &mut mesh.normals[..]);
    let (mut colors, mut triangles) = (&mut mesh.colors[..], &mut mesh.triangles[..]);
    let mut parts = Vec::new();
    for (slot, piece) in pieces.iter().enumerate() {
        let Some(piece) = piece else { continue };
        let count = piece.vertices.len();
        parts.push((
            (slot, piece),
            positions.split_off_mut(..count).unwrap_or_default(),
            normals.split_off_mut(..count).unwrap_or_default(),
            colors.split_off_mut(..count).unwrap_or_default(),
            triangles.split_off_mut(..piece.triangles.len()).unwrap_or_default(),
        ));
    }
    parts.into_par_iter().for_each(|((slot, piece), positions, normals, colors, triangles)| {
        for (i, vertex) in piece.vertices.iter().enumerate() {
            positions[i] = vertex.position;
            normals[i] = vertex.normal;
            colors[i] = vertex.color;
        }
        let around = next(slot).map(|slot| {
            let piece = pieces.get(slot as usize)?.as_deref()?;
            Some((first[slot as usize], piece))
        });
        for (triangle, names) in triangles.iter_mut().zip(&piece.triangles) {
            *triangle = names.map(|name| {
                // A missing vertex would be a bug of ours; index 0 is at least valid.
                around[name.block()].map_or(0, |(first, piece)| first + piece.vertex(name))
            });
        }
    });
    mesh
}
