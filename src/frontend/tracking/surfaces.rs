//! What depth says of a motion: surfaces of the last frame against the depth of the current one.
//!
//! Gray levels are where texture is, and one textured thing that walks can have more of it than a
//! blurred room. Surfaces are everywhere: points on an even grid, each as good as the next, tell
//! whether the room moved as assumed, and by their planes how it did. Depth may be taken at another
//! time than color; what the camera turned in between is part of the assumption.

use covis_solvers::geometry::{LieGroup, Se3, So3};
use nalgebra::{Matrix6, Vector2, Vector3, Vector6};

use super::local_matching::View;
use crate::frontend::camera::FrameCamera;
use crate::frontend::depth;
use crate::frontend::image::Image;

/// Distance of the points on the grid, pixels.
const GRID: usize = 16;
/// How far the neighbors are by which a normal is told, pixels.
const REACH: usize = 5;
/// Depths that differ by less than this, and three standard deviations, are of one surface, meters.
const SAME_M: f64 = 0.01;
/// Fewer points that are measured in both frames say nothing.
const LEAST_MEASURED: usize = 60;
/// Most steps.
const MAX_STEPS: usize = 12;
/// Scale of the distances from planes, meters.
const SCALE_M: f64 = 0.008;
/// From one step to the next, until it is [`SCALE_M`], that scale shrinks to this share.
const SCALE_SHRINKS: f64 = 0.5;
/// How far planes are followed, meters.
const FARTHEST_M: f64 = 0.12;
/// Pieces on one plane, about.
const PIECES_A_PLANE: f64 = 30.0;
/// Standard deviations of what planes leave open, meters and radians.
const LOOSE: (f64, f64) = (0.02, 0.02);
/// A step shorter than this is the last, meters and radians.
const SHORT: f64 = 2e-4;

/// A piece of a surface, in the camera's frame.
#[derive(Clone, Copy, Debug)]
struct Piece {
    point: Vector3<f64>,
    normal: Vector3<f64>,
}

/// The surfaces that a frame shows.
#[derive(Clone, Debug)]
pub struct Surfaces {
    pieces: Vec<Piece>,
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
            let point = motion.transform(&piece.point);
            let Some((_, z)) = current.measured(&point) else { continue };
            measured += 1;
            same += usize::from((z - point.z).abs() < SAME_M + 3.0 * depth::sigma_m(z));
        }
        (measured >= LEAST_MEASURED).then(|| same as f64 / measured as f64)
    }

    /// The motion near `start` that brings planes onto each other; what they leave open stays about
    /// as it is. Point to plane, with weights of Geman and McClure of a scale that shrinks to that
    /// of the depth (Yang et al., "Graduated non-convexity for robust spatial perception", 2020): at
    /// a start that is off, the narrow one would take every plane for an outlier.
    #[must_use]
    pub fn align(&self, current: &CurrentDepth<'_>, start: &Se3) -> Option<Se3> {
        let mut motion = *start;
        let loose = Vector6::from_fn(|i, _| if i < 3 { LOOSE.0 } else { LOOSE.1 });
        // Pieces of one plane are wrong together.
        let prior = loose.map(|sigma| PIECES_A_PLANE * (SCALE_M / sigma).powi(2));
        let mut scale_m = FARTHEST_M;
        for _ in 0..MAX_STEPS {
            let delayed = current.delayed(&motion);
            let back = delayed.inverse().matrix();
            let rotation = motion.rotation.matrix();
            let mut hessian = Matrix6::from_diagonal(&prior);
            let mut gradient = prior.component_mul(&start.inverse().compose(&motion).log());
            let mut used = 0;
            for Piece { point, normal } in &self.pieces {
                let here = motion.transform(point);
                let Some((ray, z)) = current.measured(&(delayed.matrix() * here)) else { continue };
                let residual = (rotation * normal).dot(&(back * (ray * z) - here));
                if residual.abs() > FARTHEST_M {
                    continue;
                }
                used += 1;
                let weight = (1.0 + (residual / scale_m).powi(2)).powi(-2);
                let turned = point.cross(normal);
                let slope =
                    -Vector6::new(normal.x, normal.y, normal.z, turned.x, turned.y, turned.z);
                hessian += slope * slope.transpose() * weight;
                gradient += slope * (weight * residual);
            }
            if used < LEAST_MEASURED {
                return None;
            }
            let step = -hessian.cholesky()?.solve(&gradient);
            motion = motion.compose(&Se3::exp(&step));
            if scale_m <= SCALE_M && step.norm() < SHORT {
                break;
            }
            scale_m = (scale_m * SCALE_SHRINKS).max(SCALE_M);
        }
        Some(motion)
    }
}

/// The piece of surface at a pixel, if it is even and does not move.
fn piece(view: &View<'_>, u: usize, v: usize) -> Option<Piece> {
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
    (is_even && is_still).then_some(Piece { point, normal })
}

impl CurrentDepth<'_> {
    /// From the camera of the color to that of the depth, if it goes on turning as in a motion.
    fn delayed(&self, current_from_last: &Se3) -> So3 {
        So3::exp(&(current_from_last.rotation.log() * self.delay_share))
    }

    /// The ray at depth 1 and the depth where a point of the depth's camera is seen.
    fn measured(&self, point: &Vector3<f64>) -> Option<(Vector3<f64>, f64)> {
        let pixel = self.camera.project(point)?;
        if !self.camera.contains(&pixel, 1.0) {
            return None;
        }
        let (u, v) = ((pixel.x + 0.5) as usize, (pixel.y + 0.5) as usize);
        let z = f64::from(self.depth_m.at(u, v));
        (z > 0.0).then(|| (point / point.z, z))
    }
}
