//! Names of maps and clients, ids of entities, references between them.
//!
//! A name has 1 to 63 characters of a-z, 0-9, '_' and '-'; an id is at least 0. Whether something with
//! that name exists is not checked here.

use super::{Path, Violations};
use crate::map::{EntityId, EntityRef, Map, Reason};
use crate::service::names::is_name;
use crate::wire::v1;

/// A required name of a map or client.
pub(in crate::service) fn name(at: Path<'_>, name: &str, out: &mut Violations) -> Option<String> {
    if name.is_empty() {
        return out.missing(at);
    }
    if is_name(name) {
        return Some(name.to_owned());
    }
    let text = "1 to 63 characters of a-z, 0-9, '_' and '-' are allowed";
    out.report(at, Reason::OutOfRange, text)
}

/// A required `map_id` of a request.
pub(in crate::service) fn map_id(map_id: &str, out: &mut Violations) -> Option<String> {
    name(Path::root("map_id"), map_id, out)
}

/// An id of an entity.
pub(in crate::service) fn id(at: Path<'_>, id: i64, out: &mut Violations) -> Option<i64> {
    if id >= 0 {
        return Some(id);
    }
    out.report(at, Reason::OutOfRange, format!("{id} is below 0"))
}

/// A reference to an entity of the sender, or of the client that it names.
pub(super) fn reference(
    at: Path<'_>,
    client_id: &str,
    entity: i64,
    out: &mut Violations,
) -> Option<EntityRef> {
    let client = owner(at, client_id, out);
    let id = id(at.field("id"), entity, out);
    Some(EntityRef { client: client?, id: id? })
}

/// The client that a reference names; the inner `None` is the sender.
fn owner(at: Path<'_>, client_id: &str, out: &mut Violations) -> Option<Option<String>> {
    match client_id {
        "" => Some(None),
        other => name(at.field("client_id"), other, out).map(Some),
    }
}

/// A required reference to a keyframe.
pub(in crate::service) fn keyframe_ref(
    at: Path<'_>,
    keyframe: Option<&v1::KeyframeRef>,
    out: &mut Violations,
) -> Option<EntityRef> {
    let keyframe = out.required(at, keyframe)?;
    reference(at, &keyframe.client_id, keyframe.id, out)
}

/// A required reference to a constraint or prior. Those that the server made have ids below 0.
pub(super) fn constraint_ref(
    at: Path<'_>,
    constraint: Option<&v1::ConstraintRef>,
    out: &mut Violations,
) -> Option<EntityRef> {
    let constraint = out.required(at, constraint)?;
    let client = owner(at, &constraint.client_id, out)?;
    Some(EntityRef { client, id: constraint.id })
}

/// A required reference to a landmark.
pub(in crate::service) fn landmark_ref(
    at: Path<'_>,
    landmark: Option<&v1::LandmarkRef>,
    out: &mut Violations,
) -> Option<EntityRef> {
    let landmark = out.required(at, landmark)?;
    reference(at, &landmark.client_id, landmark.id, out)
}

/// The name of the client that owns an entity.
pub(in crate::service) fn client_name(map: &Map, id: EntityId) -> String {
    map.clients().get(id.client.0 as usize).map(|c| c.name.clone()).unwrap_or_default()
}

/// The message of a reference to a keyframe.
pub(in crate::service) fn to_keyframe_ref(map: &Map, id: EntityId) -> v1::KeyframeRef {
    v1::KeyframeRef { client_id: client_name(map, id), id: id.id }
}

/// The message of a reference to a landmark.
pub(in crate::service) fn to_landmark_ref(map: &Map, id: EntityId) -> v1::LandmarkRef {
    v1::LandmarkRef { client_id: client_name(map, id), id: id.id }
}

/// The message of a reference to a constraint.
pub(in crate::service) fn to_constraint_ref(map: &Map, id: EntityId) -> v1::ConstraintRef {
    v1::ConstraintRef { client_id: client_name(map, id), id: id.id }
}
