//! When a frame becomes a keyframe, and which landmarks it adds: FAST corners in cells without a match,
//! each with a descriptor. Keyframes are sent to the server as they are here. Nothing is sent here.

use std::sync::Arc;

use covis_solvers::geometry::{LieGroup, Se3};
use nalgebra::{Vector2, Vector3};

use super::local_matching::{CurrentView, Match, SIGMA_PX};
use crate::depth;
use crate::features::corners::CornerOptions;
use crate::features::descriptor::{Describer, Descriptor, Size};
use crate::local_map::{CameraPose, LocalMap, MapKeyframe, MapLandmark};
use crate::pyramid::Pyramid;

/// Width of the image border without landmarks, pixels: a patch must fit into the image.
const BORDER_PX: usize = 8;
/// The assumed distance of a scene without depth, meters.
const USUAL_DEPTH_M: f64 = 2.0;

/// Due with fewer matches than this share of the reference keyframe's observations.
const LEAST_SHARE: f64 = 0.6;
/// Due after a rotation by more than this, radians.
const ANGLE_RAD: f64 = 8.0_f64.to_radians();
/// Due after a translation by more than this share of the scene's distance.
const DISTANCE_SHARE: f64 = 0.08;
/// Never due earlier than this after the last one, frames, unless the source gives poses.
pub(crate) const LEAST_FRAMES: usize = 3;
/// Side of a cell, pixels; each cell may add one landmark.
const CELL_PX: usize = 20;

/// A landmark that a keyframe adds.
#[derive(Clone, Debug, PartialEq)]
pub struct NewLandmark {
    /// Its id.
    pub id: usize,
    /// Its position in the map, from the measured depth, meters.
    pub point_in_world: Vector3<f64>,
}

/// A landmark that a keyframe sees.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct NewObservation {
    /// The landmark's id.
    pub landmark: usize,
    /// Where the image shows it, and how sure that is.
    pub seen: Match,
    /// What it looks like, where that can be computed.
    pub descriptor: Option<Descriptor>,
}

/// The keyframe before a new one.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Predecessor {
    /// Its id.
    pub id: usize,
    /// Its pose in the map, as it was when the new one was made.
    pub world_from_camera: Se3,
}

/// A keyframe as it is sent to the server.
#[derive(Clone, Debug, PartialEq)]
pub struct NewKeyframe {
    /// Its id.
    pub id: usize,
    /// The keyframe before it; `None` for the first.
    pub predecessor: Option<Predecessor>,
    /// When it was captured, seconds.
    pub timestamp_s: f64,
    /// Its pose in the map, as tracked.
    pub world_from_camera: Se3,
    /// Its pose in the odometry frame.
    pub odom_from_camera: Se3,
    /// Its new landmarks.
    pub landmarks: Vec<NewLandmark>,
    /// Its observations, those of new landmarks included.
    pub observations: Vec<NewObservation>,
    /// The least id of a landmark that later keyframes may still see.
    pub oldest_landmark: usize,
}

/// Whether a frame should become a keyframe.
#[must_use]
pub fn is_due(reference: &MapKeyframe, world_from_camera: &Se3, inliers: &[Match]) -> bool {
    let motion = reference.world_from_camera.inverse().compose(world_from_camera);
    let mut depths: Vec<f64> = inliers.iter().filter_map(|found| Some(found.depth_m?.0)).collect();
    depths.sort_unstable_by(f64::total_cmp);
    let median_depth_m = depths.get(depths.len() / 2).copied().unwrap_or(USUAL_DEPTH_M);
    let share = inliers.len() as f64 / reference.observations.len().max(1) as f64;
    share < LEAST_SHARE
        || motion.rotation.log().norm() > ANGLE_RAD
        || motion.translation.norm() > DISTANCE_SHARE * median_depth_m
}

/// Adds a keyframe to the map, with a landmark in each cell that has a corner and no match.
pub fn add_keyframe(
    map: &mut LocalMap,
    view: &CurrentView<'_>,
    pyramid: &Arc<Pyramid>,
    pose: &CameraPose,
    timestamp_s: f64,
    matches: &[Match],
) -> NewKeyframe {
    let CameraPose { world_from_camera, odom_from_camera } = *pose;
    let predecessor = map.reference().map(|reference| Predecessor {
        id: reference.id,
        world_from_camera: reference.world_from_camera,
    });
    let describer = Describer::new(view.pyramid);
    let focal_px = view.camera.model().fx;
    let describe = |pixel: &Vector2<f64>, z: f64| {
        describer.describe(pixel.x as f32, pixel.y as f32, Size::at(z, focal_px))
    };
    let mut observations = Vec::with_capacity(matches.len());
    let mut observed = Vec::with_capacity(matches.len());
    let mut landmarks = Vec::new();
    for seen in matches {
        let MapLandmark { id: landmark, point_in_world, .. } = &map.landmarks[seen.landmark];
        let z = world_from_camera.inverse_transform(point_in_world).z;
        let (landmark, descriptor) = (*landmark, describe(&seen.pixel, z));
        observed.push((seen.landmark, seen.pixel));
        observations.push(NewObservation { landmark, seen: *seen, descriptor });
    }
    for (pixel, z) in unmatched_corners(view, matches) {
        let ray = view.shutter.ray(view.camera, &pixel);
        let point_in_world = world_from_camera.transform(&(ray * z));
        let straight = view.shutter.straightened(view.camera, &pixel);
        let descriptor = describe(&pixel, z);
        let index = map.add_landmark(point_in_world);
        let landmark = map.landmarks[index].id;
        landmarks.push(NewLandmark { id: landmark, point_in_world });
        let depth_m = Some((z, depth::sigma_m(z)));
        let seen = Match { landmark: index, pixel, straight, sigma_px: SIGMA_PX, depth_m };
        observed.push((index, pixel));
        observations.push(NewObservation { landmark, seen, descriptor });
    }
    let id = map.add_keyframe(timestamp_s, Arc::clone(pyramid), world_from_camera, observed);
    let oldest_landmark = map.landmarks.first().map_or(0, |landmark| landmark.id);
    NewKeyframe {
        id,
        predecessor,
        timestamp_s,
        world_from_camera,
        odom_from_camera,
        landmarks,
        observations,
        oldest_landmark,
    }
}

/// Corners with their depths, at most one in each cell without a match: only on surfaces, and where
/// nothing moves.
#[must_use]
pub fn unmatched_corners(view: &CurrentView<'_>, matches: &[Match]) -> Vec<(Vector2<f64>, f64)> {
    let gray = view.pyramid.level(0);
    let columns = gray.width().div_ceil(CELL_PX);
    let mut is_taken = vec![false; columns * gray.height().div_ceil(CELL_PX)];
    let cell = |u: usize, v: usize| v / CELL_PX * columns + u / CELL_PX;
    for found in matches {
        is_taken[cell(found.pixel.x as usize, found.pixel.y as usize)] = true;
    }
    let options =
        CornerOptions { cell_px: CELL_PX, border_px: BORDER_PX, ..CornerOptions::default() };
    view.corners(&options, |u, v| !is_taken[cell(u, v)]).collect()
}
