//! The grid on the ground, and what stands in the column over a cell.
//!
//! Cells are as large as voxels, their centers lie at multiples of the voxel size. A column is sampled
//! at heights that are multiples of it too, by the nearest voxel: with up along an axis of the volume
//! each sample is a voxel. A voxel is surface where its distance is at most half a voxel's diagonal,
//! so that a surface of any slope has no holes; and where it lies behind and the next one is free,
//! since distances of many views need not grow evenly.

use nalgebra::Vector3;
use rayon::prelude::*;

use super::super::block::{Block, BlockKey, DISTANCE_ONE, EDGE, WEIGHT_ONE};
use super::super::volume::Volume;
use super::{NavigationError, NavigationOptions};

/// Cells that a grid has at most.
const MOST_CELLS: f64 = 67_108_864.0;

/// To the six neighbors of a voxel.
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

/// What is at a place.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Place {
    Unseen,
    Free,
    Surface,
    /// Behind a surface.
    Behind,
}

/// The columns over a grid.
pub(super) struct Columns<'a> {
    pub(super) ground: Ground,
    volume: &'a Volume,
    /// Heights of samples in resolutions: first and last.
    heights: [i64; 2],
    least_weight: f32,
    /// Stored distance up to which a voxel is surface.
    thickness: f32,
}

impl<'a> Columns<'a> {
    /// Over all of a volume.
    pub(super) fn new(
        volume: &'a Volume,
        options: &NavigationOptions,
    ) -> Result<Self, NavigationError> {
        let axes = axes(options.up)?;
        let [lowest, highest] = options.heights_m;
        // Not the negation: numbers that are none are no range either.
        if !(lowest <= highest && lowest.is_finite() && highest.is_finite()) {
            return Err(NavigationError::Heights { heights_m: options.heights_m });
        }
        let resolution_m = f64::from(volume.options().voxel_m);
        let (low, high) = bounds(volume, &axes).ok_or(NavigationError::Empty)?;
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
        Ok(Self {
            ground,
            volume,
            heights: [first as i64, last as i64],
            least_weight: (options.least_weight * f32::from(WEIGHT_ONE)).max(1.0),
            thickness,
        })
    }

    /// One value a cell, from what stands over it at each height (in resolutions), lowest first.
    pub(super) fn fold<T: Copy + Send + Sync>(
        &self,
        empty: T,
        with: impl Fn(T, i64, Place) -> T + Sync,
    ) -> Vec<T> {
        let mut cells = vec![empty; self.ground.width * self.ground.height];
        let rows = cells.par_chunks_mut(self.ground.width.max(1)).enumerate();
        rows.for_each(|(j, row)| {
            for (i, cell) in row.iter_mut().enumerate() {
                for height in self.heights[0]..=self.heights[1] {
                    *cell = with(*cell, height, self.at(i, j, height as f64));
                }
            }
        });
        cells
    }

    /// What is over the center of a cell at a height in resolutions.
    pub(super) fn at(&self, i: usize, j: usize, height: f64) -> Place {
        let Ground { axes, resolution_m, corner_m, .. } = &self.ground;
        let x = corner_m[0] / resolution_m + 0.5 + i as f64;
        let y = corner_m[1] / resolution_m + 0.5 + j as f64;
        let voxel = (axes[0] * x + axes[1] * y + axes[2] * height).map(|v| v.round() as i64);
        let place = self.voxel(voxel);
        let is_free = |step: Vector3<i64>| self.voxel(voxel + step) == Place::Free;
        if place == Place::Behind && STEPS.iter().any(|&[x, y, z]| is_free(Vector3::new(x, y, z))) {
            return Place::Surface;
        }
        place
    }

    /// What a voxel is by itself.
    fn voxel(&self, voxel: Vector3<i64>) -> Place {
        let [bx, by, bz] = [voxel.x, voxel.y, voxel.z].map(|v| v.div_euclid(EDGE as i64) as i32);
        let Some(block) = self.volume.block(BlockKey { x: bx, y: by, z: bz }) else {
            return Place::Unseen;
        };
        let [x, y, z] = [voxel.x, voxel.y, voxel.z].map(|v| v.rem_euclid(EDGE as i64) as usize);
        let at = Block::index(x, y, z);
        let distance = f32::from(block.distances[at]);
        if f32::from(block.weights[at]) < self.least_weight {
            Place::Unseen
        } else if distance.abs() <= self.thickness {
            Place::Surface
        } else if distance > 0.0 {
            Place::Free
        } else {
            Place::Behind
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

/// Least and greatest coordinates of all blocks along the axes, in voxels, rounded outwards.
fn bounds(volume: &Volume, axes: &[Vector3<f64>; 3]) -> Option<([f64; 3], [f64; 3])> {
    let mut low = [f64::INFINITY; 3];
    let mut high = [f64::NEG_INFINITY; 3];
    let half = 0.5 * (EDGE as f64 - 1.0);
    for key in volume.keys() {
        let center = Vector3::new(key.x, key.y, key.z).map(|k| f64::from(k) * EDGE as f64 + half);
        for (i, axis) in axes.iter().enumerate() {
            let (middle, reach) = (axis.dot(&center), half * axis.abs().sum());
            low[i] = low[i].min((middle - reach).round());
            high[i] = high[i].max((middle + reach).round());
        }
    }
    (low[0] <= high[0]).then_some((low, high))
}
