//! The points by which the next frame is aligned: one a cell, where the gradient is steepest.
//!
//! Only where depth is that of a surface, and nothing moves.

use nalgebra::Vector2;

use super::alignment::AlignmentPoint;
use super::local_matching::View;
use crate::frontend::depth;

/// Side of a cell, pixels.
const CELL: usize = 16;
/// Least squared central difference, gray levels squared: below it is noise.
const LEAST: i32 = 18 * 18;
/// Farthest depth that says where a point is, meters.
const FARTHEST_M: f32 = 8.0;

/// Selects points of a frame.
#[must_use]
pub fn select_points(view: &View<'_>) -> Vec<AlignmentPoint> {
    let gray = view.pyramid.level(0);
    let (width, height) = gray.size();
    let mut points = Vec::new();
    let mut best = vec![(LEAST, 0, 0); width.div_ceil(CELL)];
    for top in (0..height).step_by(CELL) {
        best.fill((LEAST, 0, 0));
        for v in top.max(4)..(top + CELL).min(height.saturating_sub(4)) {
            let (above, row, below) = (gray.row(v - 1), gray.row(v), gray.row(v + 1));
            let mut squares = [0_i32; CELL];
            for (cell, best) in best.iter_mut().enumerate() {
                let start = (cell * CELL).max(4);
                let end = ((cell + 1) * CELL).min(width - 4);
                if start >= end {
                    continue;
                }
                let columns = end - start;
                for i in 0..columns {
                    let u = start + i;
                    let gx = i32::from(row[u + 1]) - i32::from(row[u - 1]);
                    let gy = i32::from(below[u]) - i32::from(above[u]);
                    squares[i] = gx * gx + gy * gy;
                }
                for (i, &square) in squares[..columns].iter().enumerate() {
                    if square > best.0 && depth::on_surface(view.depth_m, start + i, v).is_some() {
                        *best = (square, start + i, v);
                    }
                }
            }
        }
        for &(square, u, v) in &best {
            let pixel = Vector2::new(u as f64, v as f64);
            let z = view.depth_m.at(u, v);
            if square > LEAST && z < FARTHEST_M && !view.is_moving(&pixel) {
                let point_in_reference = view.shutter.ray(view.camera, &pixel) * f64::from(z);
                points.push(AlignmentPoint { pixel, point_in_reference });
            }
        }
    }
    points
}
