//! B. Which landmarks the current frame shows, and where: tracking of the local map.
//!
//! The local map consists of the keyframes with the most landmarks that project into the frame. In each
//! cell of the image the landmark that was seen most often is searched for, with the patch of the
//! keyframe that saw it from the closest direction. If it is not found, the next one is tried. It
//! changes neither the map nor the pose.

use covis_solvers::geometry::{LieGroup, Se3};
use nalgebra::{Matrix2, Vector2, Vector3};

use super::patch_match::WarpedPatch;
use crate::camera::FrameCamera;
use crate::depth;
use crate::features::corners::{Corner, CornerOptions, detect};
use crate::image::Image;
use crate::local_map::{LocalMap, MapLandmark};
use crate::pyramid::{Pyramid, scale};
use crate::shutter::Shutter;

/// Standard deviation of a match on the finest level, pixels.
pub(super) const SIGMA_PX: f64 = 0.7;
/// Number of landmarks from which a keyframe's overlap is estimated.
const SAMPLES: usize = 40;
/// A measured depth that differs by more than this many standard deviations plus [`FARTHEST_M`] does
/// not belong to the landmark.
const FARTHEST_SIGMAS: f64 = 5.0;
/// See [`FARTHEST_SIGMAS`], meters.
const FARTHEST_M: f64 = 0.04;
/// Side of a block, pixels: landmarks closer together than this often belong to one object.
const BLOCK_PX: f64 = 80.0;
/// Levels on which a patch is searched for: blur removes the detail of the finer ones.
const LEVELS: usize = 2;
/// Candidates that are tried in a cell.
const TRIES: usize = 3;

/// Keyframes of the local map.
const KEYFRAMES: usize = 10;
/// Side of a cell, pixels.
const CELL_PX: usize = 10;
/// Most matches.
const MOST: usize = 400;

/// A landmark found in the current frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Match {
    /// Its index in the local map.
    pub landmark: usize,
    /// Where the image shows it.
    pub pixel: Vector2<f64>,
    /// Where it would be seen if all rows were exposed at once.
    pub straight: Vector2<f64>,
    /// Standard deviation of u and of v, pixels.
    pub sigma_px: f64,
    /// Measured depth and its standard deviation, meters.
    pub depth_m: Option<(f64, f64)>,
}

impl Match {
    /// Column and row of the block of the image that shows it. Landmarks of a block often belong to one
    /// object and move together, so that many of them say little more than one.
    #[must_use]
    pub fn block(&self) -> (usize, usize) {
        ((self.pixel.x / BLOCK_PX) as usize, (self.pixel.y / BLOCK_PX) as usize)
    }
}

/// The current frame as the matcher sees it.
#[derive(Clone, Copy, Debug)]
pub struct CurrentView<'a> {
    /// Its lens.
    pub camera: &'a FrameCamera,
    /// Its image.
    pub pyramid: &'a Pyramid,
    /// Its depth, meters.
    pub depth_m: &'a Image<f32>,
    /// How it was read out.
    pub shutter: Shutter,
    /// 255 where a pixel shows something that moves.
    pub moving: Option<&'a Image<u8>>,
}

impl CurrentView<'_> {
    /// Whether a position shows something that moves.
    #[must_use]
    pub fn is_moving(&self, pixel: &Vector2<f64>) -> bool {
        let at = |mask: &Image<u8>| {
            let (u, v) = ((pixel.x + 0.5) as usize, (pixel.y + 0.5) as usize);
            u < mask.width() && v < mask.height() && mask.at(u, v) > 127
        };
        self.moving.is_some_and(at)
    }

    /// Corners with their depths, of pixels for which `is_free` holds: only on surfaces, and where nothing
    /// moves.
    pub fn corners(
        &self,
        options: &CornerOptions,
        is_free: impl Fn(usize, usize) -> bool,
    ) -> impl Iterator<Item = (Vector2<f64>, f64)> {
        let is_allowed = |u: usize, v: usize| {
            is_free(u, v)
                && depth::on_surface(self.depth_m, u, v).is_some()
                && !self.is_moving(&Vector2::new(u as f64, v as f64))
        };
        let corners = detect(self.pyramid.level(0), options, is_allowed).into_iter();
        corners.map(|Corner { u, v, .. }| {
            (Vector2::new(u as f64, v as f64), f64::from(self.depth_m.at(u, v)))
        })
    }
}

/// A landmark that should be seen.
struct Candidate {
    landmark: usize,
    expected: Vector2<f64>,
    times_seen: usize,
    depth_m: f64,
}

/// Searches for the landmarks of the local map. `finest` is the finest level on which patches are
/// searched for; coarser ones reach farther.
pub fn match_landmarks(
    view: &CurrentView<'_>,
    map: &LocalMap,
    world_from_camera: &Se3,
    finest: usize,
) -> Vec<Match> {
    let camera_from_world = world_from_camera.inverse();
    let local = overlapping(view.camera, map, &camera_from_world);
    let cells = candidates(view, map, &local, &camera_from_world);
    let mut matches = Vec::with_capacity(MOST);
    for cell in spread(cells.len()) {
        if matches.len() >= MOST {
            break;
        }
        for candidate in cells[cell].iter().take(TRIES) {
            if let Some(found) = find(view, map, candidate, world_from_camera, finest) {
                matches.push(found);
                break;
            }
        }
    }
    // Sorted by index, so that sums over matches do not depend on the order of cells.
    matches.sort_by_key(|found| found.landmark);
    matches
}

/// The keyframes with the largest overlap with the frame, largest first.
fn overlapping(camera: &FrameCamera, map: &LocalMap, camera_from_world: &Se3) -> Vec<usize> {
    let mut shares = Vec::new();
    for (id, keyframe) in map.keyframes.iter().enumerate() {
        let stride = (keyframe.observations.len() / SAMPLES).max(1);
        let sampled = keyframe.observations.iter().step_by(stride);
        let seen = sampled.filter(|(landmark, _)| {
            let point = camera_from_world.transform(&map.landmarks[*landmark].point_in_world);
            camera.project(&point).is_some_and(|pixel| camera.contains(&pixel, 0.0))
        });
        // The samples represent all observations.
        let seen = seen.count() * stride;
        if seen > 0 {
            shares.push((seen, id));
        }
    }
    // Of two with equal overlap the newer one is first.
    shares.sort_unstable_by(|a, b| b.cmp(a));
    shares.into_iter().take(KEYFRAMES).map(|(_, id)| id).collect()
}

/// The candidates of each cell, the landmark seen most often first.
fn candidates(
    view: &CurrentView<'_>,
    map: &LocalMap,
    local: &[usize],
    camera_from_world: &Se3,
) -> Vec<Vec<Candidate>> {
    let (width, height) = view.camera.size();
    let columns = width.div_ceil(CELL_PX);
    let rows = height.div_ceil(CELL_PX);
    let mut cells: Vec<Vec<Candidate>> = Vec::new();
    cells.resize_with(columns * rows, Vec::new);
    let mut is_taken = vec![false; map.landmarks.len()];
    for &keyframe in local {
        for &(id, _) in &map.keyframes[keyframe].observations {
            let landmark = &map.landmarks[id];
            if std::mem::replace(&mut is_taken[id], true) {
                continue;
            }
            let point = camera_from_world.transform(&landmark.point_in_world);
            let Some(expected) = view.shutter.project(view.camera, &point) else { continue };
            if !view.camera.contains(&expected, 6.0) || view.is_moving(&expected) {
                continue;
            }
            let (column, row) = (expected.x as usize, expected.y as usize);
            let cell = row / CELL_PX * columns + column / CELL_PX;
            let times_seen = landmark.observations.len();
            cells[cell].push(Candidate { landmark: id, expected, times_seen, depth_m: point.z });
        }
    }
    for cell in &mut cells {
        cell.sort_unstable_by_key(|c| (std::cmp::Reverse(c.times_seen), c.landmark));
    }
    cells
}

/// All indices below a count, with neighbors far apart, so that a part of them covers the image.
fn spread(count: usize) -> impl Iterator<Item = usize> {
    // Prime and near the golden ratio of a few thousand cells.
    const STRIDE: usize = 1_907;
    let is_whole = count > 0 && !count.is_multiple_of(STRIDE);
    let stride = if is_whole { STRIDE } else { 1 };
    (0..count).map(move |i| i * stride % count)
}

fn find(
    view: &CurrentView<'_>,
    map: &LocalMap,
    candidate: &Candidate,
    world_from_camera: &Se3,
    finest: usize,
) -> Option<Match> {
    let landmark = &map.landmarks[candidate.landmark];
    let (keyframe, pixel) = closest_view(map, landmark, world_from_camera)?;
    let source = &map.keyframes[keyframe];
    let camera_from_keyframe = world_from_camera.inverse().compose(&source.world_from_camera);
    let point_in_keyframe = source.world_from_camera.inverse_transform(&landmark.point_in_world);
    let warp = affine(view.camera, &camera_from_keyframe, &pixel, point_in_keyframe.z)?;
    let (found, level) = (finest..finest + LEVELS).find_map(|coarser| {
        let patch = WarpedPatch::new(&source.pyramid, &pixel, &warp, coarser)?;
        let (found, _) = patch.find(view.pyramid, &candidate.expected)?;
        Some((found, patch.level))
    })?;
    if !view.camera.contains(&found, 1.0) || view.is_moving(&found) {
        return None;
    }
    let depth_m = depth::near(view.depth_m, &found).map(|z| (z, depth::sigma_m(z)));
    if let Some((z, sigma)) = depth_m {
        let away = (z - candidate.depth_m).abs();
        if away > FARTHEST_M + FARTHEST_SIGMAS * sigma {
            return None;
        }
    }
    let sigma_px = SIGMA_PX * scale(level);
    let straight = view.shutter.straightened(view.camera, &found);
    Some(Match { landmark: candidate.landmark, pixel: found, straight, sigma_px, depth_m })
}

/// The keyframe that saw a landmark from the direction closest to the frame's, and its pixel there.
fn closest_view(
    map: &LocalMap,
    landmark: &MapLandmark,
    world_from_camera: &Se3,
) -> Option<(usize, Vector2<f64>)> {
    let ray = world_from_camera.translation - landmark.point_in_world;
    let mut best = None;
    for &(keyframe, pixel) in landmark.observations.iter().rev() {
        let other = map.keyframes[keyframe].world_from_camera.translation - landmark.point_in_world;
        let cosine = ray.dot(&other) / (ray.norm() * other.norm()).max(f64::MIN_POSITIVE);
        // Views more than 60° apart do not look alike. An older view must be clearly closer, because
        // the newest one has the current light.
        if cosine > 0.5 && best.is_none_or(|(least, _)| cosine > least + 1e-3) {
            best = Some((cosine, (keyframe, pixel)));
        }
    }
    best.map(|(_, view)| view)
}

/// How pixels around `pixel` of a keyframe move when the frame sees them, on a plane that faces the
/// keyframe at the landmark's depth.
fn affine(
    camera: &FrameCamera,
    camera_from_keyframe: &Se3,
    pixel: &Vector2<f64>,
    depth_m: f64,
) -> Option<Matrix2<f64>> {
    const REACH_PX: f64 = 5.0;
    let warped = |du: f64, dv: f64| {
        let ray: Vector3<f64> = camera.ray(&(pixel + Vector2::new(du, dv)));
        camera.project(&camera_from_keyframe.transform(&(ray * depth_m)))
    };
    let center = warped(0.0, 0.0)?;
    let right = (warped(REACH_PX, 0.0)? - center) / REACH_PX;
    let down = (warped(0.0, REACH_PX)? - center) / REACH_PX;
    Some(Matrix2::from_columns(&[right, down]))
}
