//! COLMAP models to bundle adjustment problems and back.
//!
//! Poses stand in the natural order of image names, cameras and landmarks by id. Keypoints without
//! a 3D point are no observations; they stay in the model. A camera that no image uses and a point
//! that no image sees are constant, so that the problem has no variable without a factor. Of a camera
//! only the parameters of its COLMAP model are free.

use std::collections::BTreeMap;
use std::path::Path;

use nalgebra::{Vector2, Vector3};

use super::super::rotation::{from_xyzw, to_xyzw};
use super::super::{IoError, Location, natural_cmp};
use super::camera::PIXEL_CENTER;
use super::{ColmapImage, ColmapKeypoint, ColmapModel, ColmapPoint};
use crate::geometry::{Camera, LieGroup, Se3};
use crate::problem::BundleProblem;

/// A problem with the ids of its variables in the COLMAP model.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct ColmapProblem {
    /// The problem; sigma is 1 px.
    pub problem: BundleProblem,
    /// Image id of each pose, in natural order of the names.
    pub image_ids: Vec<u32>,
    /// Id of each camera, ascending.
    pub camera_ids: Vec<u32>,
    /// Id of each landmark, ascending.
    pub point_ids: Vec<u64>,
    /// Index of each observation's keypoint in its image.
    pub keypoints: Vec<u32>,
}

impl ColmapImage {
    /// An image without keypoints.
    #[must_use]
    pub fn new(name: String, camera: u32, world_from_camera: &Se3) -> Self {
        let mut image = Self {
            quaternion_wxyz: [1.0, 0.0, 0.0, 0.0],
            translation: [0.0; 3],
            camera,
            name,
            keypoints: Vec::new(),
        };
        image.set_world_from_camera(world_from_camera);
        image
    }

    /// Sets the pose.
    pub fn set_world_from_camera(&mut self, world_from_camera: &Se3) {
        let camera_from_world = world_from_camera.inverse();
        let [x, y, z, w] = to_xyzw(&camera_from_world.rotation);
        self.quaternion_wxyz = [w, x, y, z];
        self.translation = camera_from_world.translation.into();
    }

    /// The pose; `None` where the quaternion's norm is off by more than 1e-3.
    #[must_use]
    pub fn world_from_camera(&self) -> Option<Se3> {
        let [w, x, y, z] = self.quaternion_wxyz;
        let rotation = from_xyzw(&[x, y, z, w], || Location::record(Path::new("image"), 0)).ok()?;
        Some(Se3::new(rotation, self.translation.into()).inverse())
    }
}

impl ColmapKeypoint {
    /// The keypoint at `pixel` (u, v), the first pixel's center at (0, 0).
    #[must_use]
    pub fn new(pixel: &Vector2<f64>, point: Option<u64>) -> Self {
        Self { x: pixel.x + PIXEL_CENTER, y: pixel.y + PIXEL_CENTER, point }
    }

    /// The pixel (u, v), the first pixel's center at (0, 0).
    #[must_use]
    pub fn pixel(&self) -> Vector2<f64> {
        Vector2::new(self.x - PIXEL_CENTER, self.y - PIXEL_CENTER)
    }
}

impl ColmapPoint {
    /// A point that no image observes yet.
    #[must_use]
    pub fn new(point_in_world: &Vector3<f64>, color: [u8; 3]) -> Self {
        Self { position: (*point_in_world).into(), color, error: -1.0, track: Vec::new() }
    }
}

impl ColmapModel {
    /// Adds an observation at `pixel` (u, v), the first pixel's center at (0, 0), as a keypoint of
    /// its image and an entry of its point's track.
    ///
    /// # Errors
    /// [`IoError::UnknownId`] where the model does not hold the image or the point.
    pub fn push_observation(
        &mut self,
        image: u32,
        pixel: &Vector2<f64>,
        point: u64,
    ) -> Result<(), IoError> {
        let unknown = |field, id| IoError::UnknownId {
            location: Location::record(Path::new("observation"), point),
            field,
            id,
        };
        let observed = self.points.get_mut(&point).ok_or_else(|| unknown("point", point.into()))?;
        let observer = self.images.get_mut(&image).ok_or_else(|| unknown("image", image.into()))?;
        observed.track.push((image, observer.keypoints.len() as u32));
        observer.keypoints.push(ColmapKeypoint::new(pixel, Some(point)));
        Ok(())
    }

    /// The bundle adjustment problem in covis' conventions, all used variables free; of a camera those
    /// parameters that its model has.
    ///
    /// # Errors
    /// [`IoError::UnsupportedCamera`]; for a model that was not parsed but filled by hand also
    /// [`IoError::UnknownId`] and [`IoError::BadQuaternion`], naming the record by its id.
    pub fn to_problem(&self) -> Result<ColmapProblem, IoError> {
        let location = |id: u32| Location::record(Path::new("image"), id.into());
        let mut out = ColmapProblem::default();
        let mut camera_index = BTreeMap::new();
        for (&id, camera) in &self.cameras {
            let index = out.problem.push_camera(camera.to_camera(id)?, true);
            out.problem.set_free_parameters(index, camera.model.free_parameters());
            camera_index.insert(id, index);
            out.camera_ids.push(id);
        }
        let mut point_index = BTreeMap::new();
        for (&id, point) in &self.points {
            let index = out.problem.push_landmark(point.position.into());
            out.problem.constant_landmarks[index] = true;
            point_index.insert(id, index);
            out.point_ids.push(id);
        }
        let mut images: Vec<(u32, &ColmapImage)> =
            self.images.iter().map(|(&i, m)| (i, m)).collect();
        images.sort_unstable_by(|a, b| natural_cmp(&a.1.name, &b.1.name).then(a.0.cmp(&b.0)));
        for (id, image) in images {
            let norm = image.quaternion_wxyz.iter().map(|c| c * c).sum::<f64>().sqrt();
            let bad_quaternion = || IoError::BadQuaternion { location: location(id), norm };
            let pose = image.world_from_camera().ok_or_else(bad_quaternion)?;
            let pose = out.problem.push_pose(pose);
            out.image_ids.push(id);
            let unknown =
                |field, missing| IoError::UnknownId { location: location(id), field, id: missing };
            let &camera = camera_index
                .get(&image.camera)
                .ok_or_else(|| unknown("camera", image.camera.into()))?;
            for (k, keypoint) in image.keypoints.iter().enumerate() {
                let Some(point) = keypoint.point else { continue };
                let &landmark =
                    point_index.get(&point).ok_or_else(|| unknown("point", point.into()))?;
                let (p, c, l) = (pose as u32, camera as u32, landmark as u32);
                out.problem.reprojections.push(p, c, l, keypoint.pixel(), 1.0);
                out.problem.constant_cameras[camera] = false;
                out.problem.constant_landmarks[landmark] = false;
                out.keypoints.push(k as u32);
            }
        }
        Ok(out)
    }

    /// Takes poses, intrinsics and points of a problem that [`ColmapModel::to_problem`] made.
    /// A camera keeps its model where that represents it exactly, as it does after a solve. The error
    /// of a point becomes the mean of the problem's.
    ///
    /// # Errors
    /// [`IoError::UnknownId`] or [`IoError::SizeMismatch`] where the two do not belong together;
    /// the model is then partly updated.
    pub fn update_from(&mut self, solved: &ColmapProblem) -> Result<(), IoError> {
        let ColmapProblem { problem, image_ids, camera_ids, point_ids, .. } = solved;
        for (what, actual, expected) in [
            ("poses", problem.poses.len(), image_ids.len()),
            ("cameras", problem.cameras.len(), camera_ids.len()),
            ("landmarks", problem.landmarks.len(), point_ids.len()),
        ] {
            if actual != expected {
                return Err(IoError::SizeMismatch { what, actual, expected });
            }
        }
        let unknown = |field, id: u64| {
            let location = Location::record(Path::new("problem"), id);
            IoError::UnknownId { location, field, id: id.into() }
        };
        for (&id, pose) in image_ids.iter().zip(&problem.poses) {
            let image = self.images.get_mut(&id).ok_or_else(|| unknown("image", id.into()))?;
            image.set_world_from_camera(pose);
        }
        for (&id, camera) in camera_ids.iter().zip(&problem.cameras) {
            let slot = self.cameras.get_mut(&id).ok_or_else(|| unknown("camera", id.into()))?;
            *slot = slot.updated(camera);
        }
        let errors = mean_errors_px(problem);
        for ((&id, landmark), error) in point_ids.iter().zip(&problem.landmarks).zip(errors) {
            let point = self.points.get_mut(&id).ok_or_else(|| unknown("point", id))?;
            point.position = (*landmark).into();
            point.error = error;
        }
        Ok(())
    }
}

/// The error of a point as COLMAP counts it: the mean distance of its projections from their keypoints.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct ColmapPointError {
    sum_px: f64,
    views: u32,
}

/// What COLMAP counts for a view without a projection: the square root of the largest number.
const NO_PROJECTION_PX: f64 = 1.340_780_792_994_259_6e154;

impl ColmapPointError {
    /// Adds the view of a point at `pixel`. COLMAP does not project what is not in front of a camera.
    pub fn add(&mut self, camera: &Camera, point_in_camera: &Vector3<f64>, pixel: &Vector2<f64>) {
        let is_in_front = point_in_camera.z >= f64::EPSILON;
        let projected = camera.project(point_in_camera).filter(|_| is_in_front);
        self.sum_px += projected.map_or(NO_PROJECTION_PX, |projected| (projected - pixel).norm());
        self.views += 1;
    }

    /// The mean, px; −1 where no view was added.
    #[must_use]
    pub fn mean_px(&self) -> f64 {
        match self.views {
            0 => -1.0,
            views => self.sum_px / f64::from(views),
        }
    }
}

/// The error of each landmark's point, px; −1 where nothing observes it.
pub(in crate::io) fn mean_errors_px(problem: &BundleProblem) -> Vec<f64> {
    let mut errors = vec![ColmapPointError::default(); problem.landmarks.len()];
    for observation in problem.observations() {
        let landmark = observation.landmark as usize;
        let pose = problem.poses.get(observation.pose as usize);
        let camera = problem.cameras.get(observation.camera as usize);
        let (Some(error), Some(pose), Some(camera)) = (errors.get_mut(landmark), pose, camera)
        else {
            continue;
        };
        let point_in_camera = pose.inverse_transform(&problem.landmarks[landmark]);
        error.add(camera, &point_in_camera, &observation.seen.pixel);
    }
    errors.iter().map(ColmapPointError::mean_px).collect()
}
