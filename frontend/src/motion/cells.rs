//! A frame in cells of 4 × 4 pixels, the input of the motion models. Uses the lens for the rays of
//! cells, but no motion.

use nalgebra::Vector2;

use super::gaussian::CellView;
use crate::camera::FrameCamera;
use crate::image::Image;
use crate::simd::{self, Kernel};

/// N, columns and rows of a cell.
pub const CELL: usize = 4;

/// (x/z, y/z) of the ray through the middle of each cell.
pub type CellRays = Image<[f32; 2]>;

/// The rays of a camera's cells.
#[must_use]
pub fn cell_rays(camera: &FrameCamera) -> CellRays {
    let (width, height) = camera.size();
    let (columns, rows) = (width / CELL, height / CELL);
    let mut rays = Image::filled(columns, rows, [0.0; 2]);
    let middle = |cell: usize| (cell * CELL) as f64 + (CELL as f64 - 1.0) * 0.5;
    for row in 0..rows {
        for column in 0..columns {
            let ray = camera.ray(&Vector2::new(middle(column), middle(row)));
            rays.set(column, row, [ray.x as f32, ray.y as f32]);
        }
    }
    rays
}

/// The depth of each cell; where none was measured, a value between that of the previous cell and the
/// median.
#[must_use]
pub fn filled_depths(cells: &Image<CellView>) -> Image<f32> {
    let mut known: Vec<f32> =
        cells.pixels().iter().step_by(7).map(|cell| cell.depth_m).filter(|&z| z > 0.0).collect();
    known.sort_unstable_by(f32::total_cmp);
    let middle = known.get(known.len() / 2).copied().unwrap_or(2.0);
    let mut depths = cells.map(|cell| cell.depth_m);
    let mut last = middle;
    for depth in depths.pixels_mut() {
        last = if *depth > 0.0 { *depth } else { 0.9 * last + 0.1 * middle };
        *depth = last;
    }
    depths
}

/// What each cell shows; pixels past the last whole cell are left out.
#[must_use]
pub fn view_cells(gray: &Image<u8>, depth_m: &Image<f32>) -> Image<CellView> {
    let (columns, rows) = (gray.width() / CELL, gray.height() / CELL);
    let mut cells = Image::filled(columns, rows, CellView::default());
    simd::run(Viewing { gray, depth_m, cells: &mut cells });
    cells
}

struct Viewing<'a> {
    gray: &'a Image<u8>,
    depth_m: &'a Image<f32>,
    cells: &'a mut Image<CellView>,
}

impl Kernel for Viewing<'_> {
    type Output = ();

    #[inline(always)]
    fn run(self) {
        let width = self.cells.width() * CELL;
        let mut down = vec![(0_u16, 0_u8, 0_u8); width];
        for row in 0..self.cells.height() {
            let [first, second, third, fourth] = [0, 1, 2, 3].map(|v| row * CELL + v);
            let gray = [first, second, third, fourth].map(|v| &self.gray.row(v)[..width]);
            for (u, down) in down.iter_mut().enumerate() {
                let [a, b, c, d] = gray.map(|row| row[u]);
                let sum = [a, b, c, d].into_iter().map(u16::from).sum();
                *down = (sum, a.min(b).min(c.min(d)), a.max(b).max(c.max(d)));
            }
            let z = [first, second, third, fourth].map(|v| &self.depth_m.row(v)[..width]);
            let cells = self.cells.row_mut(row).iter_mut().zip(down.chunks_exact(CELL));
            for (column, (cell, down)) in cells.enumerate() {
                let (mut sum, mut least, mut largest) = (0, u8::MAX, 0);
                for part in down {
                    sum += part.0;
                    least = least.min(part.1);
                    largest = largest.max(part.2);
                }
                let left = column * CELL;
                *cell = CellView {
                    mean: f32::from(sum) / (CELL * CELL) as f32,
                    least: f32::from(least),
                    largest: f32::from(largest),
                    depth_m: lower_median(
                        z[0][left + 1],
                        z[1][left + 3],
                        z[2][left],
                        z[3][left + 2],
                    ),
                };
            }
        }
    }
}

/// The lower median of those of four depths that were measured; 0 where fewer than two were.
#[inline(always)]
fn lower_median(a: f32, b: f32, c: f32, d: f32) -> f32 {
    let (low, high) = ((a.min(b), c.min(d)), (a.max(b), c.max(d)));
    let least = low.0.min(low.1);
    let middle = (low.0.max(low.1), high.0.min(high.1));
    // A depth that was not measured is 0 and sorts first.
    if least > 0.0 { middle.0.min(middle.1) } else { middle.0.max(middle.1) }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_cell_has_mean_least_largest_and_lower_median_of_four_depths() {
        let mut gray = Image::filled(10, 9, 100_u8);
        gray.set(4, 0, 20);
        gray.set(7, 3, 196);
        let mut depth_m = Image::filled(10, 9, 0.0_f32);
        for ((u, v), z) in [((5, 0), 3.0), ((7, 1), 1.0), ((4, 2), 2.0), ((6, 3), 4.0)] {
            depth_m.set(u, v, z);
        }
        depth_m.set(1, 0, 5.0);
        let cells = view_cells(&gray, &depth_m);
        assert_eq!(cells.size(), (2, 2));
        let mixed = CellView { mean: 101.0, least: 20.0, largest: 196.0, depth_m: 2.0 };
        assert_eq!(cells.at(1, 0), mixed);
        // One depth of four is not enough.
        let plain = CellView { mean: 100.0, least: 100.0, largest: 100.0, depth_m: 0.0 };
        assert_eq!(cells.at(0, 0), plain);
    }

    #[test]
    fn cells_without_depth_have_about_that_of_those_before() {
        let mut cells = Image::filled(7, 1, CellView { depth_m: 2.0, ..CellView::default() });
        cells.set(3, 0, CellView { depth_m: 3.0, ..CellView::default() });
        cells.set(4, 0, CellView::default());
        let depths = filled_depths(&cells);
        assert_eq!(depths.at(2, 0), 2.0);
        assert!((depths.at(4, 0) - 2.9).abs() < 1e-6, "{}", depths.at(4, 0));
    }
}
