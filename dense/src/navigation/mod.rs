//! Grids for a robot's planner: the volume seen from above.
//!
//! An occupancy grid (free, occupied or unknown; the files that ROS reads), and meters to the nearest
//! surface on a slice. `columns` has the grid on the ground, and the content of the column over a cell.
//!
//! The ground has the axes x, the horizontal part of the volume's x axis, and y, which makes (x, y, up)
//! right-handed; heights are measured along up. All of them start at the volume's origin. Where up is
//! opposite to the volume's y axis, as for a camera held level, the ground's y is the volume's z. The
//! volume is only read. Blocks on disk are read one square of the ground at a time, while the whole
//! grid is in memory.

mod columns;
#[cfg(test)]
mod tests;

use nalgebra::Vector3;
use rayon::prelude::*;

use super::paged::PagedVolume;
use super::pages::PageError;
pub use columns::Ground;
use columns::{Columns, VoxelState};

/// Which part of the volume is an obstacle.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct NavigationOptions {
    /// Up in the volume's frame, of any length but zero.
    pub up: Vector3<f64>,
    /// Heights between which a surface is an obstacle, meters along up from the volume's origin.
    pub heights_m: [f64; 2],
}

impl Default for NavigationOptions {
    /// Up is opposite to y, as if the first camera was held level; 1.4 m below it to 0.4 m above.
    fn default() -> Self {
        Self { up: -Vector3::y(), heights_m: [-1.4, 0.4] }
    }
}

/// Why there is no grid.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum NavigationError {
    /// Up is no direction.
    #[error("up is ({}, {}, {}), which is not a direction", up.x, up.y, up.z)]
    Up {
        /// What was given.
        up: Vector3<f64>,
    },
    /// The heights are no range.
    #[error("heights from {} to {} m are not a range", heights_m[0], heights_m[1])]
    Heights {
        /// What was given.
        heights_m: [f64; 2],
    },
    /// There is nothing in the volume.
    #[error("the volume is empty")]
    Empty,
    /// The volume is too wide for a grid.
    #[error("a grid of {cells} cells is too large")]
    TooLarge {
        /// Cells that it would have.
        cells: f64,
    },
    /// Blocks cannot be read from disk, or others have no room there.
    #[error(transparent)]
    Pages(#[from] PageError),
}

/// Whether a robot can drive on a cell.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Cell {
    /// Nothing was seen there.
    #[default]
    Unknown,
    /// Seen through, and no surface.
    Free,
    /// A surface.
    Occupied,
}

/// Occupancy of the cells of a grid.
#[derive(Clone, Debug, PartialEq)]
pub struct OccupancyGrid {
    /// Where the cells are.
    pub ground: Ground,
    /// What they are, row by row from the least y.
    pub cells: Vec<Cell>,
}

/// The occupancy of the ground under a volume. A cell is occupied if a surface is above it between the
/// two heights, free if there is none and the camera saw through a voxel there, unknown otherwise.
///
/// # Errors
/// The options are invalid, the volume is empty, its grid is too large, or a part of it cannot be read
/// from disk.
pub fn occupancy_grid(
    volume: &mut PagedVolume,
    options: &NavigationOptions,
) -> Result<OccupancyGrid, NavigationError> {
    let columns = Columns::new(volume, options)?;
    let cells = columns.fold(volume, Cell::Unknown, |cell, _, found| match (cell, found) {
        (Cell::Occupied, _) | (_, VoxelState::Surface) => Cell::Occupied,
        (_, VoxelState::Free) => Cell::Free,
        (cell, VoxelState::Unseen | VoxelState::Behind) => cell,
    })?;
    Ok(OccupancyGrid { ground: columns.ground, cells })
}

impl OccupancyGrid {
    /// The image, binary PGM: 254 free, 0 occupied, 205 unknown, as ROS' `map_saver` writes them. Its
    /// first row has the greatest y.
    #[must_use]
    pub fn to_pgm(&self) -> Vec<u8> {
        let Ground { width, height, .. } = self.ground;
        let resolution = self.ground.resolution();
        let header = format!("P5\n# covis, {resolution} m a pixel\n{width} {height}\n255\n");
        let mut bytes = header.into_bytes();
        for row in self.cells.chunks(width.max(1)).rev() {
            bytes.extend(row.iter().map(|cell| match cell {
                Cell::Unknown => 205,
                Cell::Free => 254,
                Cell::Occupied => 0,
            }));
        }
        bytes
    }

    /// The text that belongs to the image; `image` is the image's path as the text's reader finds it.
    #[must_use]
    pub fn to_yaml(&self, image: &str) -> String {
        // Rounded to micrometers: further digits come from single precision.
        let [x, y] = self.ground.corner_m.map(|at| (at * 1e6).round() / 1e6);
        // A JSON string is a YAML string, whatever is in it. 205 is 0.19608, just not free.
        let image = serde_json::Value::from(image);
        format!(
            "image: {image}\nresolution: {}\norigin: [{x:?}, {y:?}, 0.0]\nnegate: 0\n\
             occupied_thresh: 0.65\nfree_thresh: 0.196\n",
            self.ground.resolution()
        )
    }
}

/// Distances on a slice.
#[derive(Clone, Debug, PartialEq)]
pub struct DistanceSlice {
    /// Where the cells are.
    pub ground: Ground,
    /// Meters to the nearest surface between the heights of the options, negative behind a surface;
    /// infinite where there is none at all. Row by row from the least y.
    pub distances_m: Vec<f32>,
}

/// Distances to the nearest surface on the level slice at a height: a slice of the Euclidean distance
/// field.
///
/// Felzenszwalb and Huttenlocher, Distance Transforms of Sampled Functions (2012): the squared distance
/// to a set is the lower envelope of parabolas, dimension by dimension, exact and in linear time. The
/// first dimension is up; for one slice it is the nearest surface of each column, and the two others
/// follow as in the paper. Distances are between the centers of voxels. Unseen space is no obstacle:
/// the occupancy grid shows where it is.
///
/// # Errors
/// The options are invalid, the volume is empty, its grid is too large, or a part of it cannot be read
/// from disk.
pub fn distance_slice(
    volume: &mut PagedVolume,
    options: &NavigationOptions,
    height_m: f64,
) -> Result<DistanceSlice, NavigationError> {
    if !height_m.is_finite() {
        return Err(NavigationError::Heights { heights_m: [height_m; 2] });
    }
    let columns = Columns::new(volume, options)?;
    let ground = columns.ground;
    let slice = height_m / ground.resolution_m;
    let mut squares =
        columns.fold(volume, f64::INFINITY, |nearest, height, found| match found {
            VoxelState::Surface => nearest.min((height as f64 - slice).powi(2)),
            VoxelState::Unseen | VoxelState::Free | VoxelState::Behind => nearest,
        })?;
    let (width, height) = (ground.width, ground.height);
    squares.par_chunks_mut(width).for_each(transform);
    let mut turned = transposed(&squares, width);
    turned.par_chunks_mut(height).for_each(transform);
    let squares = transposed(&turned, height);
    let behind = columns.map(volume, [slice; 2], false, |standing, i, j| {
        standing.at(i, j, slice) == VoxelState::Behind
    })?;
    let distances_m = squares.into_par_iter().zip(behind).map(|(square, is_behind)| {
        let distance = square.sqrt() * ground.resolution_m;
        (if is_behind { -distance } else { distance }) as f32
    });
    Ok(DistanceSlice { ground, distances_m: distances_m.collect() })
}

impl DistanceSlice {
    /// The distances as a PFM image, little endian; its first row has the least y, as PFM has it.
    #[must_use]
    pub fn to_pfm(&self) -> Vec<u8> {
        let mut bytes =
            format!("Pf\n{} {}\n-1.0\n", self.ground.width, self.ground.height).into_bytes();
        for distance in &self.distances_m {
            bytes.extend_from_slice(&distance.to_le_bytes());
        }
        bytes
    }
}

/// Replaces each value f(q) by the least of (p - q)² + f(q) over all q.
fn transform(values: &mut [f64]) {
    // The parabolas of the lower envelope, and where each begins.
    let mut roots: Vec<(usize, f64)> = Vec::new();
    let mut starts: Vec<f64> = Vec::new();
    for (q, &value) in values.iter().enumerate().filter(|(_, value)| value.is_finite()) {
        let mut start = f64::NEG_INFINITY;
        while let Some(&(p, height)) = roots.last() {
            let (a, b) = (p as f64, q as f64);
            start = ((value + b * b) - (height + a * a)) / (2.0 * (b - a));
            if starts.last().is_some_and(|&last| start > last) {
                break;
            }
            roots.pop();
            starts.pop();
            start = f64::NEG_INFINITY;
        }
        roots.push((q, value));
        starts.push(start);
    }
    let mut k = 0;
    for (p, value) in values.iter_mut().enumerate() {
        while starts.get(k + 1).is_some_and(|&start| start < p as f64) {
            k += 1;
        }
        if let Some(&(q, height)) = roots.get(k) {
            *value = (p as f64 - q as f64).powi(2) + height;
        }
    }
}

/// Transposes rows of a width to columns.
fn transposed(values: &[f64], width: usize) -> Vec<f64> {
    let height = values.len() / width.max(1);
    (0..values.len()).map(|i| values[i / height + width * (i % height)]).collect()
}
