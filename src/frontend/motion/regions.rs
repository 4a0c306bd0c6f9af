//! From the evidence of single cells to the things that move.
//!
//! A thing is a patch of cells whose depth changes little from one to the next. It moves where
//! enough of it stands before a background that is known; then all of it that has not been seen to
//! stand still moves.

use super::history::Testimony;
use crate::frontend::image::Image;

/// What is known of a cell.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct CellEvidence {
    /// What earlier frames say.
    pub said: Testimony,
    /// Depth, meters; 0 where none was measured.
    pub depth_m: f32,
    /// Whether its gray level is foreground to its model.
    pub is_changed: bool,
    /// Whether something as far away moved about here in the frame before.
    pub is_carried: bool,
}

impl CellEvidence {
    /// Whether it stands where space was free.
    fn has_moved(&self) -> bool {
        self.said.free > 0
    }

    /// Whether it was seen to stand still for that many frames.
    fn is_still(&self, frames: u8) -> bool {
        self.said.free == 0 && self.said.oldest_same >= frames
    }
}

/// Parameters of the regions.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RegionOptions {
    /// Cells beside a moving one that must be moving as well, of eight.
    pub support: usize,
    /// Least cells of a thing.
    pub least_cells: usize,
    /// What is as it was so many frames ago stands still.
    pub still_frames: u8,
    /// Least share of a thing's cells that must be seen to move.
    pub least_share: f32,
    /// Least share of the textured cells around a cell whose gray level changed.
    pub gray_share: f32,
    /// Largest step of depth from one cell to the next, relative.
    pub depth_step: f32,
}

impl Default for RegionOptions {
    fn default() -> Self {
        Self {
            support: 3,
            least_cells: 12,
            still_frames: 10,
            least_share: 0.3,
            gray_share: 0.45,
            depth_step: 0.03,
        }
    }
}

/// The cells that move.
#[must_use]
pub fn moving_cells(evidence: &Image<CellEvidence>, options: &RegionOptions) -> Image<bool> {
    let (columns, rows) = evidence.size();
    let is_evident = |c: usize, r: usize| evidence.at(c, r).has_moved();
    let mut seeds = Image::filled(columns, rows, false);
    for row in 1..rows.saturating_sub(1) {
        for column in 1..columns.saturating_sub(1) {
            if !is_evident(column, row) {
                continue;
            }
            let beside =
                (row - 1..=row + 1).flat_map(|r| (column - 1..=column + 1).map(move |c| (c, r)));
            let support = beside.filter(|&(c, r)| is_evident(c, r)).count() - 1;
            seeds.set(column, row, support >= options.support);
        }
    }
    let mut moving = Image::filled(columns, rows, false);
    let mut is_seen = moving.clone();
    let mut thing = Vec::new();
    for row in 0..rows {
        for column in 0..columns {
            if is_seen.at(column, row) || !seeds.at(column, row) {
                continue;
            }
            fill(evidence, &mut is_seen, (column, row), options, &mut thing);
            let evident = thing.iter().filter(|&&(c, r)| seeds.at(c, r)).count();
            if evident < options.least_cells {
                continue;
            }
            let is_grown = evident as f32 >= options.least_share * thing.len() as f32;
            for &(c, r) in thing
                .iter()
                .filter(|&&(c, r)| is_grown || seeds.at(c, r) || evidence.at(c, r).is_carried)
            {
                moving.set(c, r, true);
            }
        }
    }
    moving
}

/// The cells of the thing around `start`, which were not seen yet.
fn fill(
    evidence: &Image<CellEvidence>,
    is_seen: &mut Image<bool>,
    start: (usize, usize),
    options: &RegionOptions,
    thing: &mut Vec<(usize, usize)>,
) {
    let (columns, rows) = evidence.size();
    thing.clear();
    thing.push(start);
    is_seen.set(start.0, start.1, true);
    let mut next = 0;
    while let Some(&(column, row)) = thing.get(next) {
        next += 1;
        let here = evidence.at(column, row);
        let beside = [
            (column.wrapping_sub(1), row),
            (column + 1, row),
            (column, row.wrapping_sub(1)),
            (column, row + 1),
        ];
        for (c, r) in beside {
            if c >= columns || r >= rows || is_seen.at(c, r) {
                continue;
            }
            let there = evidence.at(c, r);
            let is_one = there.depth_m > 0.0
                && here.depth_m > 0.0
                && (there.depth_m - here.depth_m).abs() < options.depth_step * here.depth_m;
            if is_one && (there.is_carried || !there.is_still(options.still_frames)) {
                is_seen.set(c, r, true);
                thing.push((c, r));
            }
        }
    }
}
