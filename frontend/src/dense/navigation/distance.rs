//! Distances to the nearest surface on a level slice: a slice of the Euclidean distance field.
//!
//! Felzenszwalb and Huttenlocher, Distance Transforms of Sampled Functions (2012): the squared distance
//! to a set is the lower envelope of parabolas, dimension by dimension, exact and in linear time. The
//! first dimension is up; for one slice it is the nearest surface of each column, and the two others
//! follow as in the paper. Distances are between the centers of voxels. Unseen space is no obstacle:
//! the occupancy grid shows where it is.

use rayon::prelude::*;

use super::super::paged::PagedVolume;
use super::columns::{Columns, Ground, Place};
use super::{NavigationError, NavigationOptions};

/// Distances on a slice.
#[derive(Clone, Debug, PartialEq)]
pub struct DistanceSlice {
    /// Where the cells are.
    pub ground: Ground,
    /// Height of the slice, meters along up.
    pub height_m: f64,
    /// Meters to the nearest surface between the heights of the options, negative behind a surface;
    /// infinite where there is none at all. Row by row from the least y.
    pub distances_m: Vec<f32>,
}

/// Distances on the slice at a height.
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
        columns.fold(volume, f64::INFINITY, |nearest, height, place| match place {
            Place::Surface => nearest.min((height as f64 - slice).powi(2)),
            Place::Unseen | Place::Free | Place::Behind => nearest,
        })?;
    let (width, height) = (ground.width, ground.height);
    squares.par_chunks_mut(width).for_each(transform);
    let mut turned = transposed(&squares, width);
    turned.par_chunks_mut(height).for_each(transform);
    let squares = transposed(&turned, height);
    let behind = columns.map(volume, [slice; 2], false, |standing, i, j| {
        standing.at(i, j, slice) == Place::Behind
    })?;
    let distances_m = squares.into_par_iter().zip(behind).map(|(square, is_behind)| {
        let distance = square.sqrt() * ground.resolution_m;
        (if is_behind { -distance } else { distance }) as f32
    });
    Ok(DistanceSlice { ground, height_m, distances_m: distances_m.collect() })
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
