//! C. Which pixels of a frame show something that moves: as detected, and as the user says. Older
//! keyframes with about the same view show what was free space then. No pose is changed here.

use covis_solvers::geometry::{LieGroup, Se3};

use super::{CurrentFrame, Pipeline};
use crate::image::Image;
use crate::local_map::{CameraPose, LocalMap};
use crate::motion::history::Neighbor;
use crate::motion::warp::Exposure;

/// A mask that leaves a smaller share of the pixels than this is ignored.
const LEAST_STILL_SHARE: f64 = 0.25;
/// Free space is looked up in keyframes that are at least this old, seconds.
const NEIGHBOR_AGE_S: f64 = 0.7;
/// How many such keyframes are looked up at most.
const NEIGHBORS: usize = 4;
/// The least time between two of them, seconds.
const NEIGHBOR_INTERVAL_S: f64 = 0.5;
/// Largest rotation to such a keyframe, rad.
const NEIGHBOR_REACH: f64 = 0.5;
/// As how many rad of rotation a meter of distance counts.
const NEIGHBOR_RAD_PER_M: f64 = 0.3;

impl Pipeline {
    /// The mask of what moves at an approximate pose. `exposure` is the change since the last frame.
    pub(super) fn detect_movement(
        &mut self,
        frame: &CurrentFrame<'_>,
        pose: &CameraPose,
        exposure: Exposure,
    ) -> Option<Image<u8>> {
        let given = frame.given_mask;
        let Some(detector) = &mut self.detector else { return given.cloned() };
        let neighbors = neighbors(&self.map, &pose.world_from_camera, frame.rgbd.timestamp_s);
        let mut moving = detector.detect(
            &self.camera,
            frame.pyramid.level(0),
            frame.depth_m(),
            &pose.odom_from_camera,
            exposure,
            &neighbors,
        );
        if let Some(given) = given {
            for (pixel, &given) in moving.pixels_mut().iter_mut().zip(given.pixels()) {
                *pixel = (*pixel).max(if given > 127 { 255 } else { 0 });
            }
        }
        Some(moving)
    }
}

/// The mask, unless it leaves too few pixels for tracking.
pub(super) fn usable_mask(moving: Option<&Image<u8>>) -> Option<&Image<u8>> {
    moving.filter(|mask| {
        let pixels = mask.pixels();
        let still = pixels.iter().filter(|&&pixel| pixel <= 127).count();
        still as f64 >= LEAST_STILL_SHARE * pixels.len() as f64
    })
}

/// Older keyframes that show most of what a camera at a pose sees, the closest first.
fn neighbors(map: &LocalMap, world_from_camera: &Se3, timestamp_s: f64) -> Vec<Neighbor> {
    let mut all = Vec::new();
    for keyframe in &map.keyframes {
        let keyframe_from_camera = keyframe.world_from_camera.inverse().compose(world_from_camera);
        let distance = keyframe_from_camera.translation.norm();
        let away = keyframe_from_camera.rotation.log().norm() + NEIGHBOR_RAD_PER_M * distance;
        if timestamp_s - keyframe.timestamp_s > NEIGHBOR_AGE_S && away < NEIGHBOR_REACH {
            let neighbor = Neighbor { keyframe: keyframe.id, keyframe_from_camera };
            all.push((away, keyframe.timestamp_s, neighbor));
        }
    }
    all.sort_by(|a, b| a.0.total_cmp(&b.0));
    let mut chosen: Vec<(f64, Neighbor)> = Vec::new();
    for (_, time, neighbor) in all {
        let is_apart = |(other, _): &(f64, Neighbor)| (other - time).abs() > NEIGHBOR_INTERVAL_S;
        if chosen.len() < NEIGHBORS && chosen.iter().all(is_apart) {
            chosen.push((time, neighbor));
        }
    }
    chosen.into_iter().map(|(_, neighbor)| neighbor).collect()
}
