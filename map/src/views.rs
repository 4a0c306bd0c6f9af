//! The images of keyframes: which camera captured each, from where, and what it shows.
//!
//! A keyframe has one camera, or none if it has no observations. Code that projects into an image, casts rays
//! from it or compares cameras reads its [`View`]s; code that needs the pose of the keyframe itself
//! (trajectories, pose graphs) reads its pose. Nothing is estimated here.

use covis_solvers::geometry::Se3;
use covis_solvers::initialization;

use super::{CameraEntity, EntityId, Keyframe, Map, Observations};

/// An image of a keyframe.
#[derive(Clone, Copy, Debug)]
pub struct View<'a> {
    /// The id of the camera that captured it.
    pub camera_id: EntityId,
    /// That camera.
    pub camera: &'a CameraEntity,
    /// Where the camera was at the capture.
    pub world_from_camera: Se3,
    /// Features seen in the image.
    pub observations: &'a Observations,
}

impl View<'_> {
    /// What the image shows of a landmark: its first observation, `None` where there is none.
    pub(super) fn of(&self, landmark: EntityId) -> Option<initialization::View> {
        let seen = self.observations.of(landmark)?;
        Some(initialization::View {
            world_from_camera: self.world_from_camera,
            camera: self.camera.camera,
            pixel: seen.pixel,
            sigma_px: seen.sigma_px,
            depth_m: seen.depth.map(|depth| (depth.depth_m, depth.sigma_m)),
        })
    }
}

impl Map {
    /// The images of a keyframe of the map.
    pub fn views<'a>(&'a self, keyframe: &'a Keyframe) -> impl Iterator<Item = View<'a>> {
        self.views_at(keyframe, keyframe.world_from_camera)
    }

    /// The images of a keyframe as they are where the keyframe has another pose, maybe in another frame.
    pub fn views_at<'a>(
        &'a self,
        keyframe: &'a Keyframe,
        world_from_keyframe: Se3,
    ) -> impl Iterator<Item = View<'a>> {
        let camera = keyframe.camera.and_then(|id| self.cameras().get_key_value(&id));
        let view = camera.map(|(&camera_id, camera)| View {
            camera_id,
            camera,
            world_from_camera: world_from_keyframe,
            observations: &keyframe.observations,
        });
        view.into_iter()
    }

    /// Whether a keyframe of the map observes anything.
    pub fn sees(&self, keyframe: EntityId) -> bool {
        self.keyframes().get(&keyframe).is_some_and(|k| !k.observations.is_empty())
    }

    /// The images that a camera captured, each with the id of its keyframe, by that id.
    pub fn views_of_camera(&self, camera: EntityId) -> impl Iterator<Item = (EntityId, View<'_>)> {
        let of_keyframe = |(&id, keyframe)| self.views(keyframe).map(move |view| (id, view));
        let views = self.keyframes().iter().flat_map(of_keyframe);
        views.filter(move |(_, view)| view.camera_id == camera)
    }
}
