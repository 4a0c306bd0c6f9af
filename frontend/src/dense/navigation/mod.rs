//! Grids for a robot's planner: the volume seen from above.
//!
//! | file | role |
//! |---|---|
//! | `columns` | the grid on the ground, and the content of the column over a cell |
//! | `occupancy` | free, occupied or unknown; the files that ROS reads |
//! | `distance` | meters to the nearest surface on a slice |
//!
//! The ground has the axes x, the horizontal part of the volume's x axis, and y, which makes (x, y, up)
//! right-handed; heights are measured along up. All of them start at the volume's origin. Where up is
//! opposite to the volume's y axis, as for a camera held level, the ground's y is the volume's z. The
//! volume is only read. Blocks on disk are read one square of the ground at a time, while the whole
//! grid is in memory.

mod columns;
mod distance;
mod occupancy;
#[cfg(test)]
mod tests;

pub use columns::Ground;
pub use distance::{DistanceSlice, distance_slice};
pub use occupancy::{Cell, OccupancyGrid, occupancy_grid};

use nalgebra::Vector3;

use super::pages::PageError;
use super::surface::SurfaceOptions;

/// Which part of the volume is an obstacle.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct NavigationOptions {
    /// Up in the volume's frame, of any length but zero.
    pub up: Vector3<f64>,
    /// Heights between which a surface is an obstacle, meters along up from the volume's origin.
    pub heights_m: [f64; 2],
    /// Least weight of a voxel that counts, in weights of one observation.
    pub least_weight: f32,
}

impl Default for NavigationOptions {
    /// Up is opposite to y, as if the first camera was held level; 1.4 m below it to 0.4 m above.
    fn default() -> Self {
        let SurfaceOptions { least_weight } = SurfaceOptions::default();
        Self { up: -Vector3::y(), heights_m: [-1.4, 0.4], least_weight }
    }
}

/// Why there is no grid.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum NavigationError {
    /// Up is no direction.
    #[error("up is ({}, {}, {}), which is no direction", up.x, up.y, up.z)]
    Up {
        /// What was given.
        up: Vector3<f64>,
    },
    /// The heights are no range.
    #[error("heights from {} to {} m are no range", heights_m[0], heights_m[1])]
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
