//! Edits of an ingest stream: items that change or remove what the map holds.
//!
//! An edit names entities by reference; an empty `client_id` is the sender. Whether the map holds them
//! is checked by `Map::check`.

use super::camera::camera;
use super::ids::{constraint_ref, landmark_ref, reference};
use super::item::{MAX_ENTRIES, UNREADABLE_CAMERA, UNREADABLE_ID, known_keyframe};
use super::{Path, Violations, all};
use crate::map::{Edit, EntityRef, Item, Sighting};
use crate::wire::v1;

pub(super) fn revoke_constraint(message: &v1::RevokeConstraint, out: &mut Violations) -> Item {
    let at = Path::root("revoke_constraint");
    let at = at.field("constraint");
    let constraint = constraint_ref(at, message.constraint.as_ref(), out);
    let constraint = out.or(at, constraint, EntityRef::own(UNREADABLE_ID));
    Item::Edit(Edit::RevokeConstraint { constraint })
}

pub(super) fn remove_observations(
    message: v1::RemoveObservations,
    out: &mut Violations,
) -> Option<Item> {
    let at = Path::root("remove_observations");
    let at = at.field("observations");
    out.not_empty(at, &message.observations);
    out.at_most(at, &message.observations, MAX_ENTRIES)?;
    let observations = all(at, message.observations, out, |at, message, out| {
        let keyframe = known_keyframe(at.field("keyframe"), message.keyframe.as_ref(), out);
        let landmark = known_landmark(at.field("landmark"), message.landmark.as_ref(), out);
        // A keyframe of one camera has no other; rigs are refused before.
        let _first = out.within(at.field("camera_index"), message.camera_index, 0, 0);
        Some(Sighting { keyframe, landmark })
    })?;
    Some(Item::Edit(Edit::RemoveObservations { observations }))
}

pub(super) fn fuse_landmarks(message: v1::FuseLandmarks, out: &mut Violations) -> Option<Item> {
    let at = Path::root("fuse_landmarks");
    let kept = known_landmark(at.field("kept"), message.kept.as_ref(), out);
    let absorbed = landmarks(at.field("absorbed"), &message.absorbed, out)?;
    Some(Item::Edit(Edit::FuseLandmarks { kept, absorbed }))
}

pub(super) fn remove_landmarks(message: v1::RemoveLandmarks, out: &mut Violations) -> Option<Item> {
    let at = Path::root("remove_landmarks");
    let landmarks = landmarks(at.field("landmarks"), &message.landmarks, out)?;
    Some(Item::Edit(Edit::RemoveLandmarks { landmarks }))
}

pub(super) fn remove_keyframe(message: &v1::RemoveKeyframe, out: &mut Violations) -> Item {
    let at = Path::root("remove_keyframe");
    let keyframe = known_keyframe(at.field("keyframe"), message.keyframe.as_ref(), out);
    Item::Edit(Edit::RemoveKeyframe { keyframe })
}

pub(super) fn set_camera(message: &v1::Camera, out: &mut Violations) -> Item {
    let at = Path::root("set_camera");
    let id = reference(at, &message.client_id, message.id, out);
    let id = out.or(at.field("id"), id, EntityRef::own(UNREADABLE_ID));
    let entity = camera(at, message, out);
    // Without the model nothing can be said of what it projects.
    let camera = out.or(at.field("model"), entity, UNREADABLE_CAMERA);
    Item::Edit(Edit::SetCamera { id, camera })
}

fn landmarks(
    at: Path<'_>,
    messages: &[v1::LandmarkRef],
    out: &mut Violations,
) -> Option<Vec<EntityRef>> {
    out.not_empty(at, messages);
    out.at_most(at, messages, MAX_ENTRIES)?;
    all(at, messages, out, |at, message, out| Some(known_landmark(at, Some(message), out)))
}

/// The landmark that an edit names.
fn known_landmark(
    at: Path<'_>,
    landmark: Option<&v1::LandmarkRef>,
    out: &mut Violations,
) -> EntityRef {
    let landmark = landmark_ref(at, landmark, out);
    out.or(at, landmark, EntityRef::own(UNREADABLE_ID))
}
