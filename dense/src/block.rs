//! Eight by eight by eight voxels: distances, weights, colors.
//!
//! A voxel lies at its corner of the grid: voxel (x, y, z) of block (i, j, k) is at
//! (8i + x, 8j + y, 8k + z) · voxel size in the world. This file defines what the numbers mean, not how
//! they change.

/// Voxels along an edge of a block.
pub const EDGE: usize = 8;
/// Voxels of a block.
pub const VOXELS: usize = EDGE * EDGE * EDGE;
/// A distance of one truncation, as it is stored.
pub const DISTANCE_ONE: f32 = 32_767.0;
/// A weight of one, as it is stored.
pub const WEIGHT_ONE: u16 = 256;
/// Least stored weight of a voxel that counts: three frames, also at the largest depth in use, where one
/// has 1/256 of its weight at a meter.
pub(super) const LEAST_WEIGHT: u16 = 3;

/// A block of the grid, by its coordinates in blocks.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct BlockKey {
    /// Along x.
    pub x: i32,
    /// Along y.
    pub y: i32,
    /// Along z.
    pub z: i32,
}

/// Voxels of a block, each property in its own array: index x + 8 y + 64 z.
#[derive(Clone, Debug, PartialEq, Eq)]
#[repr(C, align(64))]
pub struct Block {
    /// Signed distance to the surface, positive on the camera's side, in truncations /
    /// [`DISTANCE_ONE`].
    pub distances: [i16; VOXELS],
    /// Weight of the measurements, in 1 / [`WEIGHT_ONE`]; 0 where there are none.
    pub weights: [u16; VOXELS],
    /// Red, green, blue, and what was seen of changes.
    pub colors: [[u8; 4]; VOXELS],
}

impl Block {
    /// A block without measurements.
    pub const EMPTY: Self =
        Self { distances: [0; VOXELS], weights: [0; VOXELS], colors: [[0; 4]; VOXELS] };

    /// The index of voxel (x, y, z), each below 8, in the arrays.
    #[must_use]
    pub const fn index(x: usize, y: usize, z: usize) -> usize {
        x + EDGE * (y + EDGE * z)
    }
}
