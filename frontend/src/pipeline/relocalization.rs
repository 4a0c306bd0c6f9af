//! Relocalization after tracking was lost: matches the frame's corners with the landmarks of keyframes.
//!
//! Descriptors are matched with one keyframe after the other, newest first. The first rigid motion with
//! enough inliers is the start of a refinement.

use covis_solvers::geometry::{Camera, LieGroup, Se3};
use nalgebra::Vector2;

use super::pose::{FEW_INLIERS, match_map};
use super::{CurrentFrame, FoundPose, Motion, Pipeline};
use crate::depth;
use crate::features::corners::{CornerOptions, detect};
use crate::features::descriptor::{Describer, Descriptor};
use crate::features::matching::{MatchOptions, match_mutual};
use crate::features::rigid_alignment::{AlignmentOptions, Correspondence, align};
use crate::image::Image;
use crate::local_map::LocalMap;
use crate::tracking::local_matching::View;

/// Keyframes that a frame is compared with at most.
const MOST_KEYFRAMES: usize = 60;
/// Least number of corners that must agree on a motion.
const LEAST_INLIERS: usize = 15;
/// Largest reprojection error of an inlier, pixels: depth and color are not synchronized here.
const REACH_PX: f64 = 5.0;

impl Pipeline {
    /// The pose of a frame whose motion is not known. Odometry continues by the motion in the map,
    /// without a gap.
    pub(super) fn relocalize(
        &mut self,
        frame: &CurrentFrame<'_>,
        moving: Option<&Image<u8>>,
    ) -> Option<FoundPose> {
        let view = frame.view(&self.camera, moving);
        let start = locate(&self.map, &view)?;
        let refined = match_map(&self.map, &view, &start)?.refined;
        if refined.inliers.len() < FEW_INLIERS {
            return None;
        }
        let pose = self.last.as_ref()?.pose.moved_to(&refined.world_from_camera);
        self.coasted = 0;
        Some(FoundPose { pose, motion: Motion::unknown(), inliers: refined.inliers })
    }
}

/// The pose of a frame in the map.
fn locate(map: &LocalMap, view: &View<'_>) -> Option<Se3> {
    let gray = view.pyramid.level(0);
    let describer = Describer::new(gray);
    let is_allowed = |u: usize, v: usize| {
        depth::on_surface(view.depth_m, u, v).is_some()
            && !view.is_moving(&Vector2::new(u as f64, v as f64))
    };
    let mut descriptors: Vec<Descriptor> = Vec::new();
    let mut points = Vec::new();
    for corner in detect(gray, &CornerOptions::default(), is_allowed) {
        let Some(descriptor) = describer.describe(corner.u as f32, corner.v as f32) else {
            continue;
        };
        let depth_m = view.depth_m.at(corner.u, corner.v);
        let pixel = Vector2::new(corner.u as f64, corner.v as f64);
        descriptors.push(descriptor);
        points.push(view.camera.ray(&pixel) * f64::from(depth_m));
    }
    if points.len() < LEAST_INLIERS {
        return None;
    }
    let lens = Camera::from(*view.camera.model());
    let options = AlignmentOptions {
        max_reprojection_px: REACH_PX,
        min_inliers: LEAST_INLIERS,
        ..AlignmentOptions::default()
    };
    // The newest keyframe, and older ones at even steps.
    let stride = map.keyframes.len().div_ceil(MOST_KEYFRAMES).max(1);
    map.keyframes.iter().rev().step_by(stride).find_map(|keyframe| {
        let known = keyframe.observations.iter().filter_map(|(landmark, _)| {
            let landmark = &map.landmarks[*landmark];
            Some((landmark.descriptor?, landmark.point_in_world))
        });
        let (known, places): (Vec<_>, Vec<_>) = known.unzip();
        let matches = match_mutual(&descriptors, &known, &MatchOptions::default());
        let correspondences: Vec<_> = matches
            .iter()
            .map(|found| Correspondence {
                point_in_world: places[found.candidate],
                point_in_camera: points[found.query],
            })
            .collect();
        let found = align(&lens, &correspondences, depth::sigma_m, &options)?;
        Some(found.camera_from_world.inverse())
    })
}
