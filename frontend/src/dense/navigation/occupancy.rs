//! Occupancy of the ground, and the image and text that ROS' `map_server` reads.
//!
//! A cell is occupied if a surface is above it between the two heights, free if there is none and the
//! camera saw through a voxel there, unknown otherwise. The image's first row has the greatest y.

use super::super::paged::PagedVolume;
use super::columns::{Columns, Ground, Place};
use super::{NavigationError, NavigationOptions};

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

/// The occupancy of the ground under a volume.
///
/// # Errors
/// The options are invalid, the volume is empty, its grid is too large, or a part of it cannot be read
/// from disk.
pub fn occupancy_grid(
    volume: &mut PagedVolume,
    options: &NavigationOptions,
) -> Result<OccupancyGrid, NavigationError> {
    let columns = Columns::new(volume, options)?;
    let cells = columns.fold(volume, Cell::Unknown, |cell, _, place| match (cell, place) {
        (Cell::Occupied, _) | (_, Place::Surface) => Cell::Occupied,
        (_, Place::Free) => Cell::Free,
        (cell, Place::Unseen | Place::Behind) => cell,
    })?;
    Ok(OccupancyGrid { ground: columns.ground, cells })
}

impl OccupancyGrid {
    /// The image, binary PGM: 254 free, 0 occupied, 205 unknown, as `map_saver` writes them.
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
