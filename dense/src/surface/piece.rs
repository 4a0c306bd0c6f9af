//! The surface in one block: vertices on the edges that begin at its voxels, triangles of its cells.
//!
//! A vertex lies where the linearly interpolated distance between two voxels is zero. Its normal is the
//! gradient of the distance there (central differences at both voxels, one-sided beside unseen voxels),
//! its color is interpolated. A triangle refers to vertices by their edges, which may begin in the next
//! blocks along x, y and z. Independent of other pieces.

use std::sync::LazyLock;

use super::super::block::{Block, BlockKey, EDGE, VOXELS};
use super::bits::{Field, FieldBits, SIDE, borders, first_of_bytes, own, split};
use super::cases::{CASES, TRIANGLES, edge_base};

/// A point of the surface, with the properties of a `Mesh`.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) struct Vertex {
    pub(super) position: [f32; 3],
    pub(super) normal: [f32; 3],
    pub(super) color: [u8; 3],
}

/// An edge of the grid as a triangle refers to it: lower voxel (x, y, z), each 0 to 8 from the block's
/// first, and axis, in four bits each.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(super) struct EdgeName(u16);

impl EdgeName {
    const fn new(x: usize, y: usize, z: usize, axis: usize) -> Self {
        Self((x | y << 4 | z << 8 | axis << 12) as u16)
    }

    /// Which of the blocks it begins in: bit 0 for the next along x, 1 along y, 2 along z.
    pub(super) fn block(self) -> usize {
        usize::from(self.0 >> 3 & 1 | self.0 >> 6 & 2 | self.0 >> 9 & 4)
    }
}

/// The surface in one block.
#[derive(Clone, Debug, Default)]
pub(super) struct Piece {
    /// Edges with a vertex: bit x + 8 y of word z, by axis.
    edges: [[u64; EDGE]; 3],
    /// Number of vertices before those of a word.
    first: [[u16; EDGE]; 3],
    pub(super) vertices: Vec<Vertex>,
    pub(super) triangles: Vec<[EdgeName; 3]>,
}

impl Piece {
    /// The index of the vertex on an edge that begins in this block; the edge must have one.
    pub(super) fn vertex(&self, name: EdgeName) -> u32 {
        let name = usize::from(name.0);
        let (axis, z, bit) = (name >> 12, name >> 8 & 7, (name >> 1 & 0x38) | (name & 7));
        let before = self.edges[axis][z] & ((1 << bit) - 1);
        u32::from(self.first[axis][z]) + before.count_ones()
    }

    /// The piece of a block, `None` where there is no surface, and which of the blocks around it reads,
    /// as in [`borders`]. The memory of an old piece is reused.
    pub(super) fn new(source: &Source<'_>, old: Option<Box<Self>>) -> (Option<Box<Self>>, u32) {
        let cells = crossed_cells(&source.bits);
        if cells.iter().all(|&plane| plane == 0) {
            return (None, 0);
        }
        let mut piece = old.unwrap_or_default();
        piece.vertices.clear();
        piece.triangles.clear();
        piece.mark_edges(&source.bits.inside, &cells);
        piece.place_vertices(source);
        piece.connect(&source.bits.inside, &cells);
        let used = std::array::from_fn(|z| {
            let edges = piece.edges.iter().fold(0, |all, words| all | words[z]);
            edges | own(cells[z + 1])
        });
        (Some(piece), borders(&used))
    }

    /// Marks the edges that a crossed cell uses.
    fn mark_edges(&mut self, inside: &Field, cells: &Cells) {
        let mut count = 0_u16;
        for axis in 0..3 {
            for z in 0..EDGE {
                // Planes of the field: the block's own begin at 1.
                let (below, here, above) = (cells[z], cells[z + 1], inside[z + 2]);
                let (plane, level) = (inside[z + 1], below | here);
                let crossing = match axis {
                    0 => (plane ^ plane >> 1) & (level | level << SIDE),
                    1 => (plane ^ plane >> SIDE) & (level | level << 1),
                    _ => (plane ^ above) & with_lower_cells(here),
                };
                self.edges[axis][z] = own(crossing);
                self.first[axis][z] = count;
                count += self.edges[axis][z].count_ones() as u16;
            }
        }
    }

    fn place_vertices(&mut self, source: &Source<'_>) {
        // Rows of the field with a vertex, and the rows around them, which slopes read.
        let mut wanted = [0; SIDE];
        let mut count = 0;
        for z in 0..EDGE {
            let [a, b, c] = self.edges.map(|words| words[z]);
            count += a.count_ones() + b.count_ones() + c.count_ones();
            let rows = rows_of(a | b | c) << 1;
            let rows = rows | rows << 1 | rows >> 1;
            wanted[z..z + 3].iter_mut().for_each(|plane| *plane |= rows);
        }
        if count > 0 {
            self.vertices.reserve(count as usize);
            let distances = source.distances(&wanted);
            self.place_along::<0>(source, &distances);
            self.place_along::<1>(source, &distances);
            self.place_along::<2>(source, &distances);
        }
    }

    fn place_along<const AXIS: usize>(&mut self, source: &Source<'_>, distances: &Distances) {
        for z in 0..EDGE {
            for bit in ones(self.edges[AXIS][z]) {
                let voxel = [bit % EDGE, bit / EDGE, z];
                self.vertices.push(source.vertex::<AXIS>(distances, voxel));
            }
        }
    }

    fn connect(&mut self, inside: &Field, cells: &Cells) {
        let names = &*NAMES;
        for z in 0..EDGE {
            let here = own(cells[z + 1]);
            for y in ones(rows_of(here).into()) {
                // The rows of inside bits that the cells of this row have as corners.
                let row = |y: usize, z: usize| (inside[z + 1] >> (SIDE * (y + 1) + 1)) as usize;
                let corners = [row(y, z), row(y + 1, z), row(y, z + 1), row(y + 1, z + 1)];
                for x in ones(here >> (EDGE * y) & 0xff) {
                    let [a, b, c, d] = corners.map(|row| row >> x & 3);
                    let (triangles, count) = &names[a | b << 2 | c << 4 | d << 6];
                    let base = EdgeName::new(x, y, z, 0).0;
                    let named = triangles[..*count].iter();
                    self.triangles.extend(named.map(|edges| edges.map(|e| EdgeName(base + e.0))));
                }
            }
        }
    }
}

/// The triangles of each case, by edges named from the cell's lowest voxel, and how many there are.
type Named = ([[EdgeName; 3]; TRIANGLES], usize);

static NAMES: LazyLock<[Named; 256]> = LazyLock::new(|| {
    CASES.each_ref().map(|case| {
        let mut triangles = [[EdgeName::default(); 3]; TRIANGLES];
        for (names, edges) in triangles.iter_mut().zip(case.triangles()) {
            *names = edges.map(|edge| {
                let (base, axis) = edge_base(edge.into());
                EdgeName::new(base & 1, base >> 1 & 1, base >> 2, axis)
            });
        }
        (triangles, case.triangles().len())
    })
});

/// Cells with triangles, by the field's plane of their lower voxels.
type Cells = [u128; SIDE - 1];

/// Which cells of a field were seen completely and have corners on both sides.
fn crossed_cells(bits: &FieldBits) -> Cells {
    // Nine columns of nine rows begin a cell.
    const ROW: u128 = 0x1ff;
    const BASES: u128 = {
        let mut bases = 0;
        let mut y = 0;
        while y < SIDE - 1 {
            bases |= ROW << (SIDE * y);
            y += 1;
        }
        bases
    };
    let all = |plane: u128| {
        let pairs = plane & plane >> 1;
        pairs & pairs >> SIDE
    };
    let any = |plane: u128| {
        let pairs = plane | plane >> 1;
        pairs | pairs >> SIDE
    };
    std::array::from_fn(|z| {
        let [a, b] = [z, z + 1].map(|z| (bits.inside[z], bits.seen[z]));
        let seen = all(a.1) & all(b.1) & BASES;
        seen & (any(a.0) | any(b.0)) & !(all(a.0) & all(b.0))
    })
}

/// Cells of a plane as bits of their four edges upwards.
fn with_lower_cells(cells: u128) -> u128 {
    let pairs = cells | cells << 1;
    pairs | pairs << SIDE
}

/// Which rows of eight bits have a one.
fn rows_of(word: u64) -> u32 {
    let word = word | word >> 4;
    let word = word | word >> 2;
    first_of_bytes((word | word >> 1) & 0x0101_0101_0101_0101) as u32
}

/// The positions of ones, lowest first.
pub(super) fn ones(mut bits: u64) -> impl Iterator<Item = usize> {
    std::iter::from_fn(move || {
        let index = bits.trailing_zeros() as usize;
        bits &= bits.wrapping_sub(1);
        (index < 64).then_some(index)
    })
}

/// The block itself among the 27 around it; steps along x, y and z are 1, 3 and 9.
pub(super) const MIDDLE: usize = 13;

/// The input for a piece.
pub(super) struct Source<'a> {
    /// Which block.
    pub(super) key: BlockKey,
    /// The edge of a voxel, meters.
    pub(super) voxel_m: f32,
    /// The 27 blocks around, itself in the middle.
    pub(super) around: [Option<&'a Block>; 27],
    /// Their bits.
    pub(super) bits: FieldBits,
}

/// Distances of a field, voxel (x, y, z) at x + 10 (y + 10 z); the length makes every index of ten bits
/// valid.
type Distances = [i16; 1024];

/// The distance of a voxel that was not seen enough.
const UNSEEN: i16 = i16::MIN;

/// From a voxel of a field to the next along each axis.
const STRIDES: [usize; 3] = [1, SIDE, SIDE * SIDE];

impl Source<'_> {
    /// Distances of the rows that are wanted, bit y of each plane.
    fn distances(&self, wanted: &[u32; SIDE]) -> Distances {
        let mut field = [UNSEEN; 1024];
        for z in 0..SIDE {
            let (layer, z_in_block) = split(z);
            for y in ones(wanted[z].into()) {
                let (band, y_in_block) = split(y);
                let first = SIDE * (y + SIDE * z);
                let row = &mut field[first..first + SIDE];
                let start = Block::index(0, y_in_block, z_in_block);
                let [left, middle, right] =
                    [0, 1, 2].map(|x| self.around[x + 3 * band + 9 * layer]);
                if let Some(block) = middle {
                    row[1..=EDGE].copy_from_slice(&block.distances[start..start + EDGE]);
                }
                row[0] = left.map_or(UNSEEN, |block| block.distances[start + EDGE - 1]);
                row[SIDE - 1] = right.map_or(UNSEEN, |block| block.distances[start]);
                let seen = (self.bits.seen[z] >> (SIDE * y)) as u64;
                for x in ones(!seen & 0x3ff) {
                    row[x] = UNSEEN;
                }
            }
        }
        field
    }

    /// The vertex between a voxel of the block and the next along an axis.
    fn vertex<const AXIS: usize>(&self, distances: &Distances, voxel: [usize; 3]) -> Vertex {
        let from = (voxel[0] + 1) + SIDE * (voxel[1] + 1) + SIDE * SIDE * (voxel[2] + 1);
        let to = from + STRIDES[AXIS];
        // Half a stored unit, about a micrometer, is added: a distance of 0 lies in front, and a
        // vertex in a corner of its cell would leave triangles without area.
        let [a, b] = [from, to].map(|at| f32::from(distances[at & 1023]) + 0.5);
        let t = a / (a - b);
        let mut normal = [0.0; 3];
        normal[AXIS] = b - a;
        for other in [(AXIS + 1) % 3, (AXIS + 2) % 3] {
            let [near, far] = [from, to].map(|at| slope(distances, at, STRIDES[other]));
            normal[other] = near + t * (far - near);
        }
        let [x, y, z] = normal;
        let per_length = 1.0 / (x * x + y * y + z * z).sqrt();
        let first = [self.key.x, self.key.y, self.key.z].map(|k| k as f32 * EDGE as f32);
        let mut position = [0, 1, 2].map(|i| first[i] + voxel[i] as f32);
        position[AXIS] += t;
        Vertex {
            position: position.map(|p| p * self.voxel_m),
            normal: normal.map(|n| n * per_length),
            color: self.color::<AXIS>(voxel, t),
        }
    }

    /// The color between a voxel of the block and the next along an axis.
    fn color<const AXIS: usize>(&self, voxel: [usize; 3], t: f32) -> [u8; 3] {
        let [x, y, z] = voxel;
        let at = Block::index(x, y, z);
        // The block itself is always there.
        let near = self.around[MIDDLE].map_or([0; 4], |block| block.colors[at % VOXELS]);
        let stride = [1, EDGE, EDGE * EDGE][AXIS];
        let (next, index) = if voxel[AXIS] + 1 < EDGE {
            (MIDDLE, at + stride)
        } else {
            (MIDDLE + [1, 3, 9][AXIS], at + stride - EDGE * stride)
        };
        let far = self.around[next].map_or(near, |block| block.colors[index % VOXELS]);
        let share = (t * 256.0) as u32;
        [0, 1, 2].map(|i| {
            let sum = u32::from(near[i]) * (256 - share) + u32::from(far[i]) * share;
            ((sum + 128) >> 8) as u8
        })
    }
}

/// Growth of the distance per voxel in a direction: between both neighbors, or to the one that was
/// seen.
fn slope(distances: &Distances, index: usize, stride: usize) -> f32 {
    let at = |at: usize| distances[at & 1023];
    let (lower, here, upper) = (at(index - stride), at(index), at(index + stride));
    let or_here = |value: i16| i32::from(if value == UNSEEN { here } else { value });
    let is_whole = lower != UNSEEN && upper != UNSEEN;
    (or_here(upper) - or_here(lower)) as f32 * if is_whole { 0.5 } else { 1.0 }
}
