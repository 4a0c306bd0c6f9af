//! What depth says of a motion: surfaces of the last frame against the depth of the current one.
//!
//! Gray levels are where texture is, and one textured thing that walks can have more of it than a
//! blurred room. Surfaces are everywhere: points on an even grid, each as good as the next, tell
//! whether the room moved as assumed. How it did they do not: a few planes leave that to whatever
//! stands out from them, which may walk. Depth may be taken at another time than color; what the
//! camera turned in between is part of the assumption.

use covis_solvers::geometry::{LieGroup, Se3, So3};
use nalgebra::{Vector2, Vector3};

use super::local_matching::View;
use crate::camera::FrameCamera;
use crate::depth;
use crate::image::Image;

/// Distance of the points on the grid, pixels.
const GRID: usize = 16;
/// Distance of the neighbors from which a normal is computed, pixels.
const REACH: usize = 5;
/// Depths that differ by less than this, and three standard deviations, are of one surface, meters.
const SAME_M: f64 = 0.01;
/// With fewer points that are measured in both frames there is no estimate.
const LEAST_MEASURED: usize = 60;

/// The surfaces that a frame shows.
#[derive(Clone, Debug)]
pub struct Surfaces {
    /// Pieces of them, by their middle, in the camera's frame.
    pieces: Vec<Vector3<f64>>,
}

/// The current frame's depth.
#[derive(Clone, Copy, Debug)]
pub struct CurrentDepth<'a> {
    /// Its lens.
    pub camera: &'a FrameCamera,
    /// Its depth, meters, as it was taken.
    pub depth_m: &'a Image<f32>,
    /// How much later than the color, as a share of the time since the last frame.
    pub delay_share: f64,
}

impl Surfaces {
    /// Of a frame, where nothing moves.
    #[must_use]
    pub fn new(view: &View<'_>) -> Self {
        let (width, height) = view.depth_m.size();
        let mut pieces = Vec::new();
        for v in (GRID / 2..height).step_by(GRID) {
            for u in (GRID / 2..width).step_by(GRID) {
                if u + REACH < width && v + REACH < height && u >= REACH && v >= REACH {
                    pieces.extend(piece(view, u, v));
                }
            }
        }
        Self { pieces }
    }

    /// The share of the pieces, of those measured again, that are where a motion says; `None` where
    /// too few are.
    #[must_use]
    pub fn agreement(&self, current: &CurrentDepth<'_>, current_from_last: &Se3) -> Option<f64> {
        let delayed = current.delayed(current_from_last);
        let motion = Se3::new(delayed, Vector3::zeros()).compose(current_from_last);
        let (mut measured, mut same) = (0, 0);
        for piece in &self.pieces {
            let point = motion.transform(piece);
            let Some(z) = current.measured(&point) else { continue };
            measured += 1;
            same += usize::from((z - point.z).abs() < SAME_M + 3.0 * depth::sigma_m(z));
        }
        (measured >= LEAST_MEASURED).then(|| same as f64 / measured as f64)
    }
}

/// The piece of surface at a pixel, if it is even and does not move.
fn piece(view: &View<'_>, u: usize, v: usize) -> Option<Vector3<f64>> {
    let at = |u: usize, v: usize| {
        let z = f64::from(depth::on_surface(view.depth_m, u, v)?);
        Some(view.shutter.ray(view.camera, &Vector2::new(u as f64, v as f64)) * z)
    };
    let point = at(u, v)?;
    let (left, right) = (at(u - REACH, v)?, at(u + REACH, v)?);
    let (above, below) = (at(u, v - REACH)?, at(u, v + REACH)?);
    let normal = (right - left).cross(&(below - above)).try_normalize(1e-9)?;
    let is_even = [left, right, above, below]
        .iter()
        .all(|beside| (beside - point).dot(&normal).abs() < SAME_M + 2.0 * depth::sigma_m(point.z));
    let is_still = !view.is_moving(&Vector2::new(u as f64, v as f64));
    (is_even && is_still).then_some(point)
}

impl CurrentDepth<'_> {
    /// From the camera of the color to that of the depth, if it goes on turning as in a motion.
    fn delayed(&self, current_from_last: &Se3) -> So3 {
        So3::exp(&(current_from_last.rotation.log() * self.delay_share))
    }

    /// The depth where a point of the depth's camera is seen.
    fn measured(&self, point: &Vector3<f64>) -> Option<f64> {
        let pixel = self.camera.project(point)?;
        if !self.camera.contains(&pixel, 1.0) {
            return None;
        }
        let (u, v) = ((pixel.x + 0.5) as usize, (pixel.y + 0.5) as usize);
        let z = f64::from(self.depth_m.at(u, v));
        (z > 0.0).then_some(z)
    }
}
