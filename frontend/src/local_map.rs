//! The frontend's copy of the map: keyframes with their images, landmarks with where they were seen.
//!
//! Ids are the client's, from 0 without gaps. Poses and positions are in the map's frame as the
//! server last told them; before that, as they were sent. Knows no server.

use std::sync::Arc;

use covis_solvers::geometry::{LieGroup, Se3};
use nalgebra::{Vector2, Vector3};

use super::features::descriptor::Descriptor;
use super::pyramid::Pyramid;

/// A keyframe.
#[derive(Clone, Debug)]
pub struct MapKeyframe {
    /// When it was captured, seconds.
    pub timestamp_s: f64,
    /// Its image.
    pub pyramid: Arc<Pyramid>,
    /// Its pose in the map.
    pub world_from_camera: Se3,
    /// The landmarks that it sees, and where.
    pub observations: Vec<(usize, Vector2<f64>)>,
}

/// A landmark.
#[derive(Clone, Debug)]
pub struct MapLandmark {
    /// Its position in the map, meters.
    pub point_in_world: Vector3<f64>,
    /// The keyframes that see it, and where.
    pub observations: Vec<(usize, Vector2<f64>)>,
    /// Frames whose pose it fitted, since it last seemed to move.
    pub times_tracked: usize,
    /// What it looked like at first.
    pub descriptor: Option<Descriptor>,
}

/// Where a camera is.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CameraPose {
    /// In the map.
    pub world_from_camera: Se3,
    /// In the odometry frame.
    pub odom_from_camera: Se3,
}

impl CameraPose {
    /// The origin of both frames.
    pub(crate) fn origin() -> Self {
        Self { world_from_camera: Se3::identity(), odom_from_camera: Se3::identity() }
    }

    /// The pose after the camera moved to a place in the map: odometry has the same motion.
    pub(crate) fn moved_to(&self, world_from_camera: &Se3) -> Self {
        let motion = self.world_from_camera.inverse().compose(world_from_camera);
        let odom_from_camera = self.odom_from_camera.compose(&motion);
        Self { world_from_camera: *world_from_camera, odom_from_camera }
    }
}

/// What the server corrected.
#[derive(Clone, Debug, Default)]
pub struct Corrections {
    /// Keyframes and their poses.
    pub keyframes: Vec<(usize, Se3)>,
    /// Landmarks and their positions.
    pub landmarks: Vec<(usize, Vector3<f64>)>,
}

/// Keyframes and landmarks by id.
#[derive(Clone, Debug, Default)]
pub struct LocalMap {
    /// All keyframes.
    pub keyframes: Vec<MapKeyframe>,
    /// All landmarks.
    pub landmarks: Vec<MapLandmark>,
}

impl LocalMap {
    /// Takes what the server corrected; ids that are not known are left.
    pub fn correct(&mut self, corrections: &Corrections) {
        for &(id, pose) in &corrections.keyframes {
            if let Some(keyframe) = self.keyframes.get_mut(id) {
                keyframe.world_from_camera = pose;
            }
        }
        for &(id, point) in &corrections.landmarks {
            if let Some(landmark) = self.landmarks.get_mut(id) {
                landmark.point_in_world = point;
            }
        }
    }
}
