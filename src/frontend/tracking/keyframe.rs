//! When a frame becomes a keyframe, and which landmarks it brings.

use covis_solvers::geometry::{LieGroup, Se3};
use nalgebra::{Vector2, Vector3};

use super::local_matching::{Match, View};
use crate::frontend::depth;
use crate::frontend::image::Image;
use crate::frontend::local_map::{LocalMap, MapKeyframe, MapLandmark};
use crate::frontend::pyramid::Pyramid;

/// When to take a keyframe.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct KeyframeOptions {
    /// Below this share of the reference keyframe's observations.
    pub least_share: f64,
    /// Turned by more than this, radians.
    pub angle_rad: f64,
    /// Moved by more than this share of the scene's distance.
    pub distance_share: f64,
    /// Never sooner than this after the last one, frames.
    pub least_frames: usize,
    /// Side of the cells of which each may bring a landmark, pixels.
    pub cell_px: usize,
}

impl Default for KeyframeOptions {
    fn default() -> Self {
        let angle_rad = 8.0_f64.to_radians();
        Self { least_share: 0.6, angle_rad, distance_share: 0.08, least_frames: 3, cell_px: 20 }
    }
}

/// A landmark that a keyframe brings.
#[derive(Clone, Debug, PartialEq)]
pub struct NewLandmark {
    /// Its id.
    pub id: usize,
    /// Where its depth puts it, in the map, meters.
    pub point_in_world: Vector3<f64>,
}

/// What a keyframe tells the server.
#[derive(Clone, Debug, PartialEq)]
pub struct NewKeyframe {
    /// Its id.
    pub id: usize,
    /// When it was captured, seconds.
    pub timestamp_s: f64,
    /// Its pose in the map, as tracked.
    pub world_from_camera: Se3,
    /// Its pose in the odometry frame.
    pub odom_from_camera: Se3,
    /// Landmarks that are new with it.
    pub landmarks: Vec<NewLandmark>,
    /// What it sees, the new ones included.
    pub observations: Vec<Match>,
}

/// Whether a frame should become a keyframe.
#[must_use]
pub fn is_due(
    options: &KeyframeOptions,
    reference: &MapKeyframe,
    world_from_camera: &Se3,
    inliers: usize,
    median_depth_m: f64,
) -> bool {
    let motion = reference.world_from_camera.inverse().compose(world_from_camera);
    let share = inliers as f64 / reference.observations.len().max(1) as f64;
    share < options.least_share
        || motion.rotation.log().norm() > options.angle_rad
        || motion.translation.norm() > options.distance_share * median_depth_m
}

/// Adds a keyframe to the map, with a landmark in each cell that has a corner and no match.
pub fn add_keyframe(
    map: &mut LocalMap,
    view: &View<'_>,
    pyramid: std::sync::Arc<Pyramid>,
    corners: &[Vector2<f64>],
    (world_from_camera, odom_from_camera): (&Se3, &Se3),
    timestamp_s: f64,
    matches: &[Match],
) -> NewKeyframe {
    let id = map.keyframes.len();
    let mut observations = matches.to_vec();
    let mut landmarks = Vec::new();
    for found in matches {
        map.landmarks[found.landmark].observations.push((id, found.pixel));
    }
    for pixel in corners {
        let Some(z) = depth::near(view.depth_m, pixel) else { continue };
        let ray = view.shutter.ray(view.camera, pixel);
        let point_in_world = world_from_camera.transform(&(ray * z));
        let straight = view.shutter.straightened(view.camera, pixel);
        let landmark = map.landmarks.len();
        map.landmarks.push(MapLandmark {
            point_in_world,
            observations: vec![(id, *pixel)],
            matched: 0,
            sought: 0,
            is_removed: false,
        });
        landmarks.push(NewLandmark { id: landmark, point_in_world });
        let depth_m = Some((z, depth::sigma_m(z)));
        observations.push(Match { landmark, pixel: *pixel, straight, sigma_px: 0.7, depth_m });
    }
    map.keyframes.push(MapKeyframe {
        timestamp_s,
        pyramid,
        world_from_camera: *world_from_camera,
        observations: observations.iter().map(|o| (o.landmark, o.pixel)).collect(),
    });
    NewKeyframe {
        id,
        timestamp_s,
        world_from_camera: *world_from_camera,
        odom_from_camera: *odom_from_camera,
        landmarks,
        observations,
    }
}

/// Corners, at most one in each cell that has no match, strongest first within a cell (Shi and
/// Tomasi), only where depth is that of a surface and nothing moves.
#[must_use]
pub fn free_corners(
    view: &View<'_>,
    gray: &Image<u8>,
    matches: &[Match],
    cell_px: usize,
) -> Vec<Vector2<f64>> {
    let (width, height) = gray.size();
    let columns = width.div_ceil(cell_px);
    let mut is_taken = vec![false; columns * height.div_ceil(cell_px)];
    for found in matches {
        is_taken[found.pixel.y as usize / cell_px * columns + found.pixel.x as usize / cell_px] = true;
    }
    let mut corners = Vec::new();
    for (cell, is_taken) in is_taken.iter().enumerate() {
        if *is_taken {
            continue;
        }
        let (left, top) = (cell % columns * cell_px, cell / columns * cell_px);
        let mut best = (300.0_f32, None);
        for v in (top.max(8)..(top + cell_px).min(height - 8)).step_by(2) {
            for u in (left.max(8)..(left + cell_px).min(width - 8)).step_by(2) {
                let (mut xx, mut xy, mut yy) = (0.0, 0.0, 0.0);
                for dv in 0..5 {
                    for du in 0..5 {
                        let (x, y) = (u + du - 2, v + dv - 2);
                        let gx = f32::from(gray.at(x + 1, y)) - f32::from(gray.at(x - 1, y));
                        let gy = f32::from(gray.at(x, y + 1)) - f32::from(gray.at(x, y - 1));
                        xx += gx * gx;
                        xy += gx * gy;
                        yy += gy * gy;
                    }
                }
                let weaker = 0.5 * (xx + yy - ((xx - yy).powi(2) + 4.0 * xy * xy).sqrt());
                if weaker > best.0 {
                    let pixel = Vector2::new(u as f64, v as f64);
                    if !view.is_moving(&pixel) && depth::near(view.depth_m, &pixel).is_some() {
                        best = (weaker, Some(pixel));
                    }
                }
            }
        }
        corners.extend(best.1);
    }
    corners
}
