//! Depth of structured-light cameras: its noise (from `covis-dense`), what it is at a point of the image,
//! and the depth image as it would have been when the color was taken. Between the two times only the
//! camera's turn is corrected, not its shift.

pub use covis_dense::depth::sigma_m;
use covis_solvers::geometry::{LieGroup, So3};
use nalgebra::Vector2;

use super::camera::FrameCamera;
use super::image::Image;
use super::simd::{self, Kernel};

/// Largest difference between a depth and those around it on one surface, relative to it.
const SURFACE_STEP: f32 = 0.03;

/// The depth at a pixel where it is that of a surface: measured there and, about the same, around it.
#[must_use]
pub fn on_surface(depth_m: &Image<f32>, u: usize, v: usize) -> Option<f32> {
    if u == 0 || v == 0 || u + 1 >= depth_m.width() || v + 1 >= depth_m.height() {
        return None;
    }
    let z = depth_m.at(u, v);
    let step = SURFACE_STEP * z;
    let around = [(u - 1, v), (u + 1, v), (u, v - 1), (u, v + 1)];
    let is_even = around.iter().all(|&(u, v)| (depth_m.at(u, v) - z).abs() < step);
    (z > 0.0 && is_even).then_some(z)
}

/// As [`on_surface`] at the pixel nearest to a position.
#[must_use]
pub fn near(depth_m: &Image<f32>, pixel: &Vector2<f64>) -> Option<f64> {
    let (u, v) = ((pixel.x + 0.5).floor(), (pixel.y + 0.5).floor());
    (u >= 0.0 && v >= 0.0).then(|| on_surface(depth_m, u as usize, v as usize).map(f64::from))?
}

/// Depth as it was when the color was taken: each pixel reads the depth image where its ray was when
/// that image was taken. Cameras that take the two at different times tear them apart at every edge
/// as soon as they turn. `None` where the camera turned by less than a tenth of a pixel.
#[must_use]
pub fn synchronized(
    camera: &FrameCamera,
    depth_m: &Image<f32>,
    depth_from_color: &So3,
) -> Option<Image<f32>> {
    const CELL: usize = SHIFT_CELL;
    let (width, height) = depth_m.size();
    if depth_from_color.log().norm() * camera.model().fx < 0.1 {
        return None;
    }
    let rotation = depth_from_color.matrix();
    let shift = |u: usize, v: usize| {
        let pixel = Vector2::new(u as f64, v as f64);
        let ray = rotation * camera.ray(&pixel);
        camera.project(&ray).map(|moved| moved - pixel).unwrap_or_default()
    };
    let (columns, rows) = (width.div_ceil(CELL) + 1, height.div_ceil(CELL) + 1);
    let grid: Vec<Vector2<f32>> = (0..rows * columns)
        .map(|i| {
            // Beyond the border as at it.
            let (u, v) = (i % columns * CELL, i / columns * CELL);
            shift(u.min(width - 1), v.min(height - 1)).map(|value| value as f32)
        })
        .collect();
    let mut out = Image::filled(width, height, 0.0);
    simd::run(Reading { depth_m, grid: &grid, columns, out: &mut out });
    Some(out)
}

/// Side of the cells in which [`synchronized`] interpolates shifts, pixels.
const SHIFT_CELL: usize = 16;

/// Reads depth at pixels that are shifted by what a grid says of the corners of cells.
struct Reading<'a> {
    depth_m: &'a Image<f32>,
    grid: &'a [Vector2<f32>],
    columns: usize,
    out: &'a mut Image<f32>,
}

impl Kernel for Reading<'_> {
    type Output = ();

    #[inline(always)]
    fn run(self) {
        let Self { depth_m, grid, columns, out } = self;
        let (width, height) = depth_m.size();
        let (right, bottom) = (width as i32, height as i32);
        for v in 0..height {
            let (row, t) = (v / SHIFT_CELL, (v % SHIFT_CELL) as f32 / SHIFT_CELL as f32);
            for (column, out) in out.row_mut(v).chunks_mut(SHIFT_CELL).enumerate() {
                let at = row * columns + column;
                let left = grid[at] * (1.0 - t) + grid[at + columns] * t;
                let step = (grid[at + 1] * (1.0 - t) + grid[at + columns + 1] * t - left)
                    / SHIFT_CELL as f32;
                // Half a pixel more, since what follows rounds down.
                let (x, y) = ((column * SHIFT_CELL) as f32 + left.x + 0.5, v as f32 + left.y + 0.5);
                let mut indices = [0_i32; SHIFT_CELL];
                for (i, index) in indices.iter_mut().enumerate() {
                    let i = i as f32;
                    let (x, y) = (x + i * (1.0 + step.x), y + i * step.y);
                    let (u, v) = (simd::floor(x), simd::floor(y));
                    let is_inside = (u >= 0) & (v >= 0) & (u < right) & (v < bottom);
                    *index = if is_inside { v * right + u } else { i32::MAX };
                }
                // Most often one after the other.
                let start = indices[0] as usize;
                let mut breaks = 0;
                for (i, &index) in indices.iter().enumerate() {
                    breaks |= index ^ indices[0].wrapping_add(i as i32);
                }
                let run = depth_m.pixels().get(start..start.saturating_add(out.len()));
                if let (0, Some(run)) = (breaks, run) {
                    out.copy_from_slice(run);
                    continue;
                }
                for (out, &index) in out.iter_mut().zip(&indices) {
                    *out = depth_m.pixels().get(index as usize).copied().unwrap_or(0.0);
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use covis_solvers::geometry::PinholeRadialTangential;
    use nalgebra::Vector3;

    use super::*;

    #[test]
    fn depth_is_read_where_the_ray_was_when_it_was_taken() {
        let lens = PinholeRadialTangential::undistorted(260.0, 260.0, 159.5, 119.5);
        let camera = FrameCamera::new(lens, 320, 240).unwrap();
        // Each pixel's depth tells where it lies.
        let mut depth_m = Image::filled(320, 240, 0.0);
        for v in 0..240 {
            for u in 0..320 {
                depth_m.set(u, v, 1.0 + (v * 320 + u) as f32);
            }
        }
        let rotation = So3::exp(&Vector3::new(0.02, -0.03, 0.04));
        let out = synchronized(&camera, &depth_m, &rotation).unwrap();
        for (u, v) in [(60, 50), (160, 120), (250, 180), (100, 201)] {
            let ray = rotation.matrix() * camera.ray(&Vector2::new(f64::from(u), f64::from(v)));
            let pixel = camera.project(&ray).unwrap();
            let read = out.at(u as usize, v as usize) as usize - 1;
            let (x, y) = ((read % 320) as f64, (read / 320) as f64);
            assert!((x - pixel.x).abs() < 0.7 && (y - pixel.y).abs() < 0.7, "{u} {v}: {x} {y}");
        }
        assert_eq!(synchronized(&camera, &depth_m, &So3::identity()), None);
    }

    #[test]
    fn depth_at_an_edge_or_without_neighbors_is_none() {
        let mut depth_m = Image::filled(9, 9, 2.0);
        assert_eq!(near(&depth_m, &Vector2::new(4.3, 3.8)), Some(2.0));
        assert_eq!(near(&depth_m, &Vector2::new(0.0, 4.0)), None);
        assert_eq!(near(&depth_m, &Vector2::new(-7.0, 400.0)), None);
        depth_m.set(5, 4, 2.5);
        assert_eq!(near(&depth_m, &Vector2::new(4.0, 4.0)), None);
        depth_m.set(5, 4, 0.0);
        assert_eq!(near(&depth_m, &Vector2::new(4.0, 4.0)), None);
        assert_eq!(near(&depth_m, &Vector2::new(5.0, 4.0)), None);
    }
}
