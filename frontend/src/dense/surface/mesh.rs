//! A mesh of triangles, and how pieces are joined to one.
//!
//! The joined mesh has the pieces' vertices in the order of slots, each once.

use rayon::prelude::*;

use super::piece::Piece;

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

/// Joins pieces; `next` gives the slots of the pieces in which a piece's edges may begin (order as in
/// `EdgeName::block`).
pub(super) fn join(pieces: &[Option<Box<Piece>>], next: impl Fn(usize) -> [u32; 8] + Sync) -> Mesh {
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
    let mut parts = Vec::new();
    let mut positions = &mut mesh.positions[..];
    let mut normals = &mut mesh.normals[..];
    let mut colors = &mut mesh.colors[..];
    let mut triangles = &mut mesh.triangles[..];
    for (slot, piece) in pieces.iter().enumerate() {
        if let Some(piece) = piece {
            let count = piece.vertices.len();
            parts.push(Part {
                slot,
                piece,
                positions: take(&mut positions, count),
                normals: take(&mut normals, count),
                colors: take(&mut colors, count),
                triangles: take(&mut triangles, piece.triangles.len()),
            });
        }
    }
    parts.into_par_iter().for_each(|part| part.fill(pieces, &first, &next));
    mesh
}

/// Splits the first items off a list.
fn take<'a, T>(list: &mut &'a mut [T], count: usize) -> &'a mut [T] {
    let (taken, rest) = std::mem::take(list).split_at_mut(count);
    *list = rest;
    taken
}

/// A piece, and its place in the mesh.
struct Part<'a> {
    slot: usize,
    piece: &'a Piece,
    positions: &'a mut [[f32; 3]],
    normals: &'a mut [[f32; 3]],
    colors: &'a mut [[u8; 3]],
    triangles: &'a mut [[u32; 3]],
}

impl Part<'_> {
    fn fill(self, pieces: &[Option<Box<Piece>>], first: &[u32], next: &impl Fn(usize) -> [u32; 8]) {
        for (i, vertex) in self.piece.vertices.iter().enumerate() {
            self.positions[i] = vertex.position;
            self.normals[i] = vertex.normal;
            self.colors[i] = vertex.color;
        }
        let around = next(self.slot).map(|slot| {
            let piece = pieces.get(slot as usize)?.as_deref()?;
            Some((first[slot as usize], piece))
        });
        for (triangle, names) in self.triangles.iter_mut().zip(&self.piece.triangles) {
            *triangle = names.map(|name| {
                // A missing vertex would be a bug of ours; index 0 is at least valid.
                around[name.block()].map_or(0, |(first, piece)| first + piece.vertex(name))
            });
        }
    }
}
