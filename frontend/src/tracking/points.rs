//! The points for the alignment of the next frame: one per cell, where the gradient is steepest.
//!
//! Points lie only on surfaces, and where nothing moves. They serve one alignment and are no landmarks.

use nalgebra::{Vector2, Vector3};

use super::local_matching::CurrentView;
use crate::depth;
use crate::image::Image;
use crate::simd::{self, Kernel};

/// Side of a cell, pixels.
const CELL: usize = 16;
/// Least squared central difference, gray levels squared; smaller ones are noise.
const LEAST: i32 = 18 * 18;
/// Width of the image border without points, pixels.
const BORDER: usize = 4;
/// Largest depth from which a point is computed, meters.
const FARTHEST_M: f32 = 8.0;

/// A point of the reference image with its position in space.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct AlignmentPoint {
    /// Its pixel in the reference image.
    pub pixel: Vector2<f64>,
    /// Its position in the reference camera's frame, meters.
    pub point_in_reference: Vector3<f64>,
}

/// Selects points of a frame.
#[must_use]
pub fn select_points(view: &CurrentView<'_>) -> Vec<AlignmentPoint> {
    let mut points = Vec::new();
    for (u, v) in simd::run(Steepest { gray: view.pyramid.level(0), depth_m: view.depth_m }) {
        let pixel = Vector2::new(u as f64, v as f64);
        let z = view.depth_m.at(u, v);
        if z < FARTHEST_M && !view.is_moving(&pixel) {
            let point_in_reference = view.shutter.ray(view.camera, &pixel) * f64::from(z);
            points.push(AlignmentPoint { pixel, point_in_reference });
        }
    }
    points
}

/// The pixel of each cell where the gradient is steepest, of those that lie on a surface.
struct Steepest<'a> {
    gray: &'a Image<u8>,
    depth_m: &'a Image<f32>,
}

impl Kernel for Steepest<'_> {
    type Output = Vec<(usize, usize)>;

    #[inline(always)]
    fn run(self) -> Self::Output {
        let (width, height) = self.gray.size();
        let (right, bottom) = (width.saturating_sub(BORDER), height.saturating_sub(BORDER));
        let mut steepest = Vec::new();
        let mut squares = vec![0; width];
        let mut best = vec![(LEAST, 0, 0); width.div_ceil(CELL)];
        for top in (0..height).step_by(CELL) {
            best.fill((LEAST, 0, 0));
            for v in top.max(BORDER)..(top + CELL).min(bottom) {
                let [above, row, below] = [v - 1, v, v + 1].map(|v| self.gray.row(v));
                if right <= BORDER {
                    continue;
                }
                let along = row[BORDER - 1..].iter().zip(&row[BORDER + 1..]);
                let down = above[BORDER..right].iter().zip(&below[BORDER..right]);
                for ((square, (&a, &b)), (&c, &d)) in
                    squares[BORDER..].iter_mut().zip(along).zip(down)
                {
                    let (gx, gy) = (i32::from(b) - i32::from(a), i32::from(d) - i32::from(c));
                    *square = gx * gx + gy * gy;
                }
                for (cell, (best, squares)) in best.iter_mut().zip(squares.chunks(CELL)).enumerate()
                {
                    // Most rows of a cell have nothing steeper.
                    if squares.iter().fold(0, |most, &square| most.max(square)) <= best.0 {
                        continue;
                    }
                    for (i, &square) in squares.iter().enumerate() {
                        let u = cell * CELL + i;
                        if square > best.0 && depth::on_surface(self.depth_m, u, v).is_some() {
                            *best = (square, u, v);
                        }
                    }
                }
            }
            let found = best.iter().filter(|best| best.0 > LEAST);
            steepest.extend(found.map(|&(_, u, v)| (u, v)));
        }
        steepest
    }
}
