//! The grid on the ground, and the content of the column over a cell.
//!
//! Cells are as large as voxels, their centers lie at multiples of the voxel size. A column is sampled
//! at heights that are multiples of it too, by the nearest voxel: with up along an axis of the volume
//! each sample is a voxel. A voxel is surface if its distance is at most half a voxel's diagonal, so
//! that a surface of any slope has no holes. It is also surface if it lies behind and a neighbor is
//! free, because distances from many views need not grow evenly. It says what a column holds; what a
//! robot may do there is decided in `mod`.

use nalgebra::Vector3;
use rayon::prelude::*;

use super::super::block::{Block, BlockKey, DISTANCE_ONE, EDGE, LEAST_WEIGHT};
use super::super::paged::PagedVolume;
use super::super::pages::PageError;
use super::super::volume::Volume;
use super::{NavigationError, NavigationOptions};

/// Most cells of a grid.
const MOST_CELLS: f64 = 67_108_864.0;

/// Cells along an edge of the squares of the ground that are processed one at a time.
const SQUARE: usize = 64;
/// Blocks whose keys are read at a time.
const BLOCKS_AT_A_TIME: usize = 1024;

/// Steps to the six neighbors of a voxel.
const STEPS: [[i64; 3]; 6] = [[-1, 0, 0], [1, 0, 0], [0, -1, 0], [0, 1, 0], [0, 0, -1], [0, 0, 1]];

/// A grid of square cells on the ground, row by row from the least y.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Ground {
    /// Unit vectors of the ground's x and y and of up, in the volume's frame.
    pub axes: [Vector3<f64>; 3],
    /// Edge of a cell, meters.
    pub resolution_m: f64,
    /// Corner of the first cell: least x and y, meters.
    pub corner_m: [f64; 2],
    /// Cells along x.
    pub width: usize,
    /// Cells along y.
    pub height: usize,
}

impl Ground {
    /// The resolution in meters as the voxel size was given, without extra digits from the conversion
    /// of single precision.
    #[must_use]
    pub fn resolution(&self) -> f32 {
        self.resolution_m as f32
    }
}

/// What is at a point.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum VoxelState {
    Unseen,
    Free,
    Surface,
    /// Behind a surface.
    Behind,
}

/// The columns over a grid.
pub(super) struct Columns {
    pub(super) ground: Ground,
    /// Heights of samples in resolutions: first and last.
    heights: [i64; 2],
    /// Stored distance up to which a voxel is surface.
    thickness: f32,
}

/// The content of columns whose blocks are all in memory.
pub(super) struct ResidentColumns<'a> {
    columns: &'a Columns,
    volume: &'a Volume,
}

impl Columns {
    /// The columns over all of a volume.
    pub(super) fn new(
        volume: &mut PagedVolume,
        options: &NavigationOptions,
    ) -> Result<Self, NavigationError> {
        let axes = axes(options.up)?;
        let [lowest, highest] = options.heights_m;
        // Not the negated comparison, because NaN must be refused too.
        if !(lowest <= highest && lowest.is_finite() && highest.is_finite()) {
            return Err(NavigationError::Heights { heights_m: options.heights_m });
        }
        let resolution_m = f64::from(volume.options().voxel_m);
        let (low, high) = bounds(volume, &axes)?.ok_or(NavigationError::Empty)?;
        let [width, height] = [0, 1].map(|i| high[i] - low[i] + 1.0);
        if width * height > MOST_CELLS {
            return Err(NavigationError::TooLarge { cells: width * height });
        }
        let ground = Ground {
            axes,
            resolution_m,
            corner_m: [0, 1].map(|i| (low[i] - 0.5) * resolution_m),
            width: width as usize,
            height: height as usize,
        };
        // A height at the limit counts in spite of rounding.
        let first = (lowest / resolution_m - 1e-6).ceil().max(low[2]);
        let last = (highest / resolution_m + 1e-6).floor().min(high[2]);
        let truncation_m = volume.options().truncation_m;
        let thickness = 0.75_f32.sqrt() * volume.options().voxel_m / truncation_m * DISTANCE_ONE;
        Ok(Self { ground, heights: [first as i64, last as i64], thickness })
    }

    /// One value per cell, folded over the places above it at each height (in resolutions), lowest
    /// first.
    pub(super) fn fold<T: Copy + Send + Sync>(
        &self,
        volume: &mut PagedVolume,
        empty: T,
        with: impl Fn(T, i64, VoxelState) -> T + Sync,
    ) -> Result<Vec<T>, PageError> {
        let [first, last] = self.heights;
        self.map(volume, [first as f64, last as f64], empty, |columns, i, j| {
            (first..=last)
                .fold(empty, |value, height| with(value, height, columns.at(i, j, height as f64)))
        })
    }

    /// One value per cell, from its column between two heights, in resolutions. If part of the volume
    /// is on disk, it is read by squares of the ground.
    pub(super) fn map<T: Copy + Send + Sync>(
        &self,
        volume: &mut PagedVolume,
        heights: [f64; 2],
        empty: T,
        value: impl Fn(&ResidentColumns<'_>, usize, usize) -> T + Sync,
    ) -> Result<Vec<T>, PageError> {
        let Ground { width, height, .. } = self.ground;
        let edge = if volume.paging().is_some() { SQUARE } else { width.max(height).max(1) };
        let mut cells = vec![empty; width * height];
        for top in (0..height).step_by(edge) {
            let rows = cells.chunks_mut(width).skip(top).take(edge);
            let mut rows: Vec<_> = rows.collect();
            for left in (0..width).step_by(edge) {
                let right = width.min(left + edge);
                let square = [[left, top], [right - 1, top + rows.len() - 1]];
                let (low, high) = self.voxels(square, heights);
                let volume = volume.bring_between(low, high)?;
                let columns = ResidentColumns { columns: self, volume };
                rows.par_iter_mut().enumerate().for_each(|(j, row)| {
                    for (i, cell) in (left..).zip(&mut row[left..right]) {
                        *cell = value(&columns, i, top + j);
                    }
                });
            }
        }
        Ok(cells)
    }

    /// A sample, in voxels.
    fn in_voxels(&self, i: usize, j: usize, height: f64) -> Vector3<f64> {
        let Ground { axes, resolution_m, corner_m, .. } = &self.ground;
        let x = corner_m[0] / resolution_m + 0.5 + i as f64;
        let y = corner_m[1] / resolution_m + 0.5 + j as f64;
        axes[0] * x + axes[1] * y + axes[2] * height
    }

    /// The lowest and the highest voxels that are read over a square of cells.
    fn voxels(&self, square: [[usize; 2]; 2], heights: [f64; 2]) -> (Vector3<f64>, Vector3<f64>) {
        let corners = (0..8)
            .map(|k| self.in_voxels(square[k & 1][0], square[k >> 1 & 1][1], heights[k >> 2]));
        let none = Vector3::repeat(f64::INFINITY);
        let bounds = corners.fold((none, -none), |(low, high), p| (low.inf(&p), high.sup(&p)));
        // The nearest voxel, its neighbors, and rounding.
        let (low, high) = bounds;
        (low.add_scalar(-2.0), high.add_scalar(2.0))
    }
}

impl ResidentColumns<'_> {
    /// What is over the center of a cell at a height in resolutions.
    pub(super) fn at(&self, i: usize, j: usize, height: f64) -> VoxelState {
        let voxel = self.columns.in_voxels(i, j, height).map(|v| v.round() as i64);
        let state = self.voxel(voxel);
        let is_free = |step: Vector3<i64>| self.voxel(voxel + step) == VoxelState::Free;
        if state == VoxelState::Behind
            && STEPS.iter().any(|&[x, y, z]| is_free(Vector3::new(x, y, z)))
        {
            return VoxelState::Surface;
        }
        state
    }

    /// What a voxel is, regardless of its neighbors.
    fn voxel(&self, voxel: Vector3<i64>) -> VoxelState {
        let [bx, by, bz] = [voxel.x, voxel.y, voxel.z].map(|v| v.div_euclid(EDGE as i64) as i32);
        let Some(block) = self.volume.block(BlockKey { x: bx, y: by, z: bz }) else {
            return VoxelState::Unseen;
        };
        let [x, y, z] = [voxel.x, voxel.y, voxel.z].map(|v| v.rem_euclid(EDGE as i64) as usize);
        let at = Block::index(x, y, z);
        let distance = f32::from(block.distances[at]);
        if block.weights[at] < LEAST_WEIGHT {
            VoxelState::Unseen
        } else if distance.abs() <= self.columns.thickness {
            VoxelState::Surface
        } else if distance > 0.0 {
            VoxelState::Free
        } else {
            VoxelState::Behind
        }
    }
}

/// The ground's x and y and up.
fn axes(up: Vector3<f64>) -> Result<[Vector3<f64>; 3], NavigationError> {
    let unit = up.try_normalize(0.0).filter(|unit| unit.iter().all(|x| x.is_finite()));
    let unit = unit.ok_or(NavigationError::Up { up })?;
    // The volume's x axis, or z where x points up or down.
    let ahead = if unit.x.abs() < 0.9 { Vector3::x() } else { Vector3::z() };
    let x = (ahead - unit * unit.dot(&ahead)).normalize();
    Ok([x, unit.cross(&x), unit])
}

/// Least and greatest coordinates.
type Bounds = ([f64; 3], [f64; 3]);

/// Least and greatest coordinates of all blocks along the axes, in voxels, rounded outwards.
fn bounds(volume: &mut PagedVolume, axes: &[Vector3<f64>; 3]) -> Result<Option<Bounds>, PageError> {
    let mut low = [f64::INFINITY; 3];
    let mut high = [f64::NEG_INFINITY; 3];
    let half = 0.5 * (EDGE as f64 - 1.0);
    volume.visit(BLOCKS_AT_A_TIME, |blocks| -> Result<(), PageError> {
        for (key, _) in blocks {
            let center =
                Vector3::new(key.x, key.y, key.z).map(|k| f64::from(k) * EDGE as f64 + half);
            for (i, axis) in axes.iter().enumerate() {
                let (middle, reach) = (axis.dot(&center), half * axis.abs().sum());
                low[i] = low[i].min((middle - reach).round());
                high[i] = high[i].max((middle + reach).round());
            }
        }
        Ok(())
    })?;
    Ok((low[0] <= high[0]).then_some((low, high)))
}
