//! Checks a motion by depth: compares surfaces of the last frame with the depth of the current one.
//!
//! Gray levels need texture, and one textured object that moves can have more of it than a blurred
//! room. Surfaces are everywhere: points on an even grid, with equal weights, show whether the room
//! moved as assumed. They do not estimate the motion: a few planes leave it undetermined, and what
//! stands out from them may be a moving object. Depth may be taken at another time than color; the
//! rotation in between is part of the assumption.

use covis_solvers::geometry::{LieGroup, Se3, So3};
use nalgebra::{Vector2, Vector3};

use super::local_matching::CurrentView;
use crate::camera::FrameCamera;
use crate::depth;
use crate::image::Image;

/// Distance of the points on the grid, pixels.
const GRID: usize = 16;
/// Distance of the neighbors from which a normal is computed, pixels.
const REACH: usize = 5;
/// Depths that differ by less than this plus two or three standard deviations belong to one surface,
/// meters.
const SAME_M: f64 = 0.01;
/// With fewer points measured in both frames there is no result.
const LEAST_MEASURED: usize = 60;

/// The surfaces that a frame shows.
#[derive(Clone, Debug)]
pub struct Surfaces {
    /// The centers of pieces of surfaces, in the camera's frame.
    pieces: Vec<Vector3<f64>>,
}

/// The current frame's depth.
#[derive(Clone, Copy, Debug)]
pub struct CurrentDepth<'a> {
    /// Its lens.
    pub camera: &'a FrameCamera,
    /// Its depth, meters, as it was taken.
    pub depth_m: &'a Image<f32>,
    /// Delay of the depth after the color, as a share of the time since the last frame.
    pub delay_share: f64,
}

impl Surfaces {
    /// The surfaces of a frame that do not move.
    #[must_use]
    pub fn new(view: &CurrentView<'_>) -> Self {
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

    /// The share of the pieces measured again that lie where a motion predicts them; `None` where too
    /// few are measured again.
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

/// The piece of surface at a pixel, if it is flat and does not move.
fn piece(view: &CurrentView<'_>, u: usize, v: usize) -> Option<Vector3<f64>> {
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
    /// Rotation from the camera at the time of the color to that of the depth, if it keeps turning as
    /// in a motion.
    fn delayed(&self, current_from_last: &Se3) -> So3 {
        So3::exp(&(current_from_last.rotation.log() * self.delay_share))
    }

    /// The measured depth at the pixel of a point, which is in the depth camera's frame.
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
