//! Checks an edit against the map: what it names must be there, and each thing once.
//!
//! A new camera must project what the old one projects, and its image must hold the pixels that were
//! measured in it; the first observation that contradicts is named. Nothing is changed here.

use super::{Check, far_outside, is_projected, repeated};
use crate::{CameraEntity, Change, Constraint, Edit, EntityId, EntityRef, Map, Reason, Sighting};

impl Check<'_> {
    /// Whether the map is already as the edit asks. What was removed is not remembered: a removal is
    /// never done already.
    pub(super) fn is_done(&self, edit: &Edit) -> bool {
        let Edit::SetCamera { id, camera } = edit else { return false };
        self.resolve(id).and_then(|id| self.map.cameras().get(&id)) == Some(camera)
    }

    /// The change that an edit makes; `None` where what it is about cannot be found.
    pub(super) fn edit(&mut self, edit: &Edit) -> Option<Change> {
        match edit {
            Edit::RevokeConstraint { constraint } => {
                let field = "revoke_constraint.constraint";
                // Of what the server made, a client may revoke closures: the rest stands for keyframes
                // that were retired.
                let has = |map: &Map, id: &EntityId| {
                    let constraint = map.constraints().get(id);
                    let is_closure = constraint.is_some_and(Constraint::is_closure);
                    map.has_constraint(*id) && (id.id >= 0 || is_closure)
                };
                let id = self.known(field, "constraint", constraint, has)?;
                Some(Change::ConstraintRevoked { id })
            }
            Edit::RemoveObservations { observations } => Some(Change::ObservationsRemoved {
                observations: self.sightings("remove_observations.observations", observations),
            }),
            Edit::FuseLandmarks { kept, absorbed } => {
                let kept = self.landmark("fuse_landmarks.kept", kept);
                let path = "fuse_landmarks.absorbed";
                let absorbed = self.known_landmarks(path, absorbed);
                for (index, _) in absorbed.iter().filter(|&&(_, id)| Some(id) == kept) {
                    let text = "the landmark is the one that is kept";
                    self.add(format_args!("{path}[{index}]"), Reason::Inconsistent, text);
                }
                let absorbed = absorbed.into_iter().map(|(_, id)| id).collect();
                Some(Change::LandmarksFused { kept: kept?, absorbed })
            }
            Edit::RemoveLandmarks { landmarks } => {
                let known = self.known_landmarks("remove_landmarks.landmarks", landmarks);
                let landmarks = known.into_iter().map(|(_, id)| id).collect();
                Some(Change::LandmarksRemoved { landmarks })
            }
            Edit::RemoveKeyframe { keyframe } => {
                let keyframe = self.keyframe("remove_keyframe.keyframe", keyframe)?;
                Some(Change::KeyframeRemoved { keyframe })
            }
            Edit::SetCamera { id, camera } => {
                let has = |map: &Map, id: &EntityId| map.cameras().contains_key(id);
                let id = self.known("set_camera.id", "camera", id, has)?;
                self.views(id, camera);
                Some(Change::CameraSet { id, camera: *camera })
            }
        }
    }

    fn landmark(
        &mut self,
        field: impl std::fmt::Display,
        reference: &EntityRef,
    ) -> Option<EntityId> {
        self.known(field, "landmark", reference, |map, id| map.landmarks().contains_key(id))
    }

    /// The landmarks of a list that the map holds, each with its index in the list.
    fn known_landmarks(&mut self, path: &str, sent: &[EntityRef]) -> Vec<(usize, EntityId)> {
        self.not_empty(path, sent.len());
        let mut known = Vec::with_capacity(sent.len());
        for (index, landmark) in sent.iter().enumerate() {
            if let Some(id) = self.landmark(format_args!("{path}[{index}]"), landmark) {
                known.push((index, id));
            }
        }
        for (index, id) in repeated(known.iter().map(|&(index, id)| (id, Some(index))).collect()) {
            let text = format!("landmark {} occurs twice", id.id);
            self.add(format_args!("{path}[{index}]"), Reason::Duplicate, text);
        }
        known
    }

    /// The observations of a list that the map holds.
    fn sightings(&mut self, path: &str, sent: &[Sighting]) -> Vec<(EntityId, EntityId)> {
        self.not_empty(path, sent.len());
        let mut known = Vec::with_capacity(sent.len());
        for (index, sighting) in sent.iter().enumerate() {
            let at = format_args!("{path}[{index}]");
            let id = self.keyframe(format_args!("{at}.keyframe"), &sighting.keyframe);
            let landmark = self.landmark(format_args!("{at}.landmark"), &sighting.landmark);
            let (Some(id), Some(landmark)) = (id, landmark) else { continue };
            let keyframe = self.map.keyframes().get(&id);
            if keyframe.is_none_or(|keyframe| keyframe.observation_of(landmark).is_none()) {
                let text = format!("keyframe {} does not observe landmark {}", id.id, landmark.id);
                self.add(at, Reason::UnknownReference, text);
            }
            known.push(((id, landmark), Some(index)));
        }
        let sightings = known.iter().map(|&(sighting, _)| sighting).collect();
        for (index, (_, landmark)) in repeated(known) {
            let text = format!("the observation of landmark {} occurs twice", landmark.id);
            self.add(format_args!("{path}[{index}]"), Reason::Duplicate, text);
        }
        sightings
    }

    /// Whether what was observed with camera `id` could have been observed with `new`. The first
    /// observation for which that is not so is reported.
    fn views(&mut self, id: EntityId, new: &CameraEntity) {
        let map = self.map;
        let Some(old) = map.cameras().get(&id) else { return };
        for (keyframe_id, view) in map.views_of_camera(id) {
            for seen in view.observations.iter() {
                let named = || {
                    let name = map.client(keyframe_id.client).map_or("", |c| c.name.as_str());
                    let landmark = seen.landmark.id;
                    format!("keyframe {} of client {name:?}, landmark {landmark}", keyframe_id.id)
                };
                let pose = &view.world_from_camera;
                if let Some(position) = map.landmarks().get(&seen.landmark).and_then(|l| l.position)
                    && !is_projected(new, pose, &position)
                    && is_projected(old, pose, &position)
                {
                    let text = format!("no finite projection with this model: {}", named());
                    return self.add("set_camera.model", Reason::ProjectionNotFinite, text);
                }
                for (field, value, size) in [
                    ("set_camera.width_px", seen.pixel.x, new.width_px),
                    ("set_camera.height_px", seen.pixel.y, new.height_px),
                ] {
                    if let Some(size) = far_outside(value, size) {
                        let text = format!(
                            "{value} is far outside an image of {size} pixels: {}",
                            named()
                        );
                        return self.add(field, Reason::Inconsistent, text);
                    }
                }
            }
        }
    }
}
