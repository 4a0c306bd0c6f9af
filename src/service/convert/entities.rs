//! Keyframes, landmarks, constraints and client frames of a map, as readers get them.
//!
//! References always name their client; ids of clients are looked up in the map that is read. Only
//! outward: what clients send is converted in `item` and `edit`.

use covis_solvers::geometry::{LieGroup, Se3};
use covis_solvers::loss::Loss;
use nalgebra::Vector3;

use super::camera::to_camera as camera_message;
use super::count;
use super::geometry::{
    to_information6, to_rigid_transform, to_upper_triangle, to_vector2, to_vector3,
};
use super::ids::{client_name, to_constraint_ref, to_keyframe_ref, to_landmark_ref};
use super::solve::to_loss;
use super::time::timestamp;
use crate::map::{
    CameraEntity, ClientIndex, Constraint, ConstraintKind, Descriptor, DescriptorKind, EntityId,
    Keyframe, Landmark, Map, Observation, PlaceCandidate, PlaceRefusal, PlaceSearch, Prior,
    SwitchedOff,
};
use crate::wire::v1;
use v1::constraint::Constraint as WireConstraint;

/// A camera.
pub(in crate::service) fn to_camera(map: &Map, id: EntityId, camera: &CameraEntity) -> v1::Camera {
    camera_message(client_name(map, id), id.id, camera)
}

/// The pose of a keyframe.
pub(in crate::service) fn to_keyframe_pose(
    map: &Map,
    id: EntityId,
    keyframe: &Keyframe,
) -> v1::KeyframePose {
    v1::KeyframePose {
        keyframe: Some(to_keyframe_ref(map, id)),
        capture_time: Some(timestamp(keyframe.capture_time_ns)),
        world_from_camera: Some(to_rigid_transform(&keyframe.world_from_camera)),
        world_from_rig: None,
    }
}

/// A keyframe, without its observations.
pub(in crate::service) fn to_keyframe(
    map: &Map,
    id: EntityId,
    keyframe: &Keyframe,
) -> v1::Keyframe {
    v1::Keyframe {
        client_id: client_name(map, id),
        id: id.id,
        capture_time: Some(timestamp(keyframe.capture_time_ns)),
        sensor: keyframe.camera.map(|camera| v1::keyframe::Sensor::CameraId(camera.id)),
        world_from_camera: Some(to_rigid_transform(&keyframe.world_from_camera)),
        odom_from_camera: Some(to_rigid_transform(&keyframe.odom_from_camera)),
        ..v1::Keyframe::default()
    }
}

/// An observation of a keyframe, with its descriptor.
pub(in crate::service) fn to_observation(map: &Map, observation: &Observation) -> v1::Observation {
    let Observation { landmark, pixel, sigma_px, depth, descriptor } = observation;
    v1::Observation {
        landmark: Some(to_landmark_ref(map, *landmark)),
        camera_index: 0,
        pixel: Some(to_vector2(pixel)),
        sigma_px: Some(*sigma_px),
        depth_m: depth.map(|depth| depth.depth_m),
        sigma_depth_m: depth.map(|depth| depth.sigma_m),
        descriptor: descriptor.as_deref().map(to_descriptor),
    }
}

/// A descriptor of a feature or of a whole image.
pub(in crate::service) fn to_descriptor(descriptor: &Descriptor) -> v1::Descriptor {
    let kind = match descriptor.kind {
        DescriptorKind::Binary => v1::DescriptorKind::Binary,
        DescriptorKind::Float32 => v1::DescriptorKind::Float32,
        DescriptorKind::Uint8 => v1::DescriptorKind::Uint8,
    };
    let (name, data) = (descriptor.name.clone(), descriptor.data.clone());
    v1::Descriptor { kind: kind.into(), name, data }
}

/// A landmark, without its descriptor.
pub(in crate::service) fn to_landmark(
    map: &Map,
    id: EntityId,
    landmark: &Landmark,
) -> v1::Landmark {
    let state = match landmark.position {
        None => v1::LandmarkState::Unpositioned,
        Some(_) => v1::LandmarkState::Positioned,
    };
    v1::Landmark {
        client_id: client_name(map, id),
        id: id.id,
        point_in_world: landmark.position.as_ref().map(to_vector3),
        descriptor: None,
        reference_keyframe: landmark.reference.map(|k| to_keyframe_ref(map, k)),
        observation_count: count(landmark.observers.len()),
        state: state.into(),
        duplicate_of: map.duplicates().original_of(id).map(|id| to_landmark_ref(map, id)),
    }
}

/// The relative-pose constraint or prior with this id.
pub(in crate::service) fn to_any_constraint(map: &Map, id: EntityId) -> Option<v1::Constraint> {
    match (map.constraints().get(&id), map.priors().get(&id)) {
        (Some(constraint), _) => Some(to_constraint(map, id, constraint)),
        (None, Some(prior)) => Some(to_prior(map, id, prior)),
        (None, None) => None,
    }
}

/// A relative-pose constraint.
pub(in crate::service) fn to_constraint(
    map: &Map,
    id: EntityId,
    constraint: &Constraint,
) -> v1::Constraint {
    let kind = match constraint.kind {
        ConstraintKind::Odometry => v1::ConstraintKind::Odometry,
        ConstraintKind::LoopClosure => v1::ConstraintKind::LoopClosure,
        ConstraintKind::Other => v1::ConstraintKind::Other,
        ConstraintKind::Marginal => v1::ConstraintKind::Marginal,
    };
    let measured = to_rigid_transform(&constraint.keyframe_i_from_keyframe_j);
    wire(WireConstraint::RelativePose(v1::RelativePoseConstraint {
        client_id: client_name(map, id),
        id: id.id,
        keyframe_i: Some(to_keyframe_ref(map, constraint.keyframe_i)),
        keyframe_j: Some(to_keyframe_ref(map, constraint.keyframe_j)),
        keyframe_i_from_keyframe_j: Some(measured),
        information: Some(to_information6(&constraint.information)),
        kind: kind.into(),
        loss: constraint.loss.as_ref().map(to_loss),
        switched_off: map.switched_off().get(&id).map(to_switched_off),
    }))
}

/// Why a constraint is switched off.
pub(in crate::service) fn to_switched_off(off: &SwitchedOff) -> v1::SwitchedOff {
    let SwitchedOff { chi2, weight, is_provisional: provisional } = *off;
    v1::SwitchedOff { chi2, weight, provisional }
}

/// What the search for the place of a keyframe found.
pub(in crate::service) fn to_place_search(
    map: &Map,
    keyframe: EntityId,
    search: &PlaceSearch,
) -> v1::PlaceSearch {
    let PlaceSearch { candidates, closure, refusal } = search;
    // A keyframe is searched again when it gets observations.
    let is_earlier = |id: &EntityId| {
        let found = map.constraints().get(id).filter(|_| id.is_own() && Some(*id) != *closure);
        found.is_some_and(|c| c.kind == ConstraintKind::LoopClosure && c.keyframe_j == keyframe)
    };
    let earlier = map.ties().of(keyframe).filter(is_earlier);
    v1::PlaceSearch {
        keyframe: Some(to_keyframe_ref(map, keyframe)),
        candidates: candidates.iter().map(|c| to_place_candidate(map, c)).collect(),
        closure: closure.map(|id| to_constraint_ref(map, id)),
        refusal: refusal.as_ref().map(to_place_refusal),
        earlier_closures: earlier.map(|id| to_constraint_ref(map, id)).collect(),
    }
}

/// A candidate for a place.
pub(in crate::service) fn to_place_candidate(
    map: &Map,
    candidate: &PlaceCandidate,
) -> v1::PlaceCandidate {
    let PlaceCandidate { keyframe, score, matches, refusal } = candidate;
    v1::PlaceCandidate {
        keyframe: Some(to_keyframe_ref(map, *keyframe)),
        score: *score,
        match_count: i32::try_from(*matches).unwrap_or(i32::MAX),
        refusal: refusal.as_ref().map(to_place_refusal),
    }
}

fn to_place_refusal(refusal: &PlaceRefusal) -> v1::PlaceRefusal {
    let PlaceRefusal { reason, text } = refusal.clone();
    v1::PlaceRefusal { reason, text }
}

/// A prior on a keyframe.
pub(in crate::service) fn to_prior(map: &Map, id: EntityId, prior: &Prior) -> v1::Constraint {
    let client_id = client_name(map, id);
    let keyframe = Some(to_keyframe_ref(map, prior.keyframe()));
    let own = |loss: &Loss| (*loss != Loss::Trivial).then(|| to_loss(loss));
    match prior {
        Prior::Pose { world_from_camera, information, loss, .. } => {
            wire(WireConstraint::PosePrior(v1::PosePrior {
                client_id,
                id: id.id,
                keyframe,
                world_from_camera: Some(to_rigid_transform(world_from_camera)),
                information: Some(to_information6(information)),
                loss: own(loss),
            }))
        }
        Prior::Position { position_in_world, point_in_camera, information, loss, .. } => {
            wire(WireConstraint::PositionPrior(v1::PositionPrior {
                client_id,
                id: id.id,
                keyframe,
                point_in_world: Some(to_vector3(position_in_world)),
                point_in_camera: (*point_in_camera != Vector3::zeros())
                    .then(|| to_vector3(point_in_camera)),
                information: Some(v1::InformationMatrix3 {
                    upper_triangle: to_upper_triangle(information),
                }),
                loss: own(loss),
                switched_off: map.switched_off().get(&id).map(to_switched_off),
                geodetic_point: None,
            }))
        }
    }
}

fn wire(constraint: WireConstraint) -> v1::Constraint {
    v1::Constraint { constraint: Some(constraint) }
}

/// Where a client's odometry frame lies in the map, from its newest keyframe, in the client's unit. `None`
/// without a keyframe, and where poses near the largest numbers overflow.
pub(in crate::service) fn to_client_frame(
    map: &Map,
    client: ClientIndex,
) -> Option<v1::ClientFrame> {
    let (id, newest) = map.newest_keyframe(client)?;
    let (frame, scale) = (newest.map_from_odom(), map.scale_of(client));
    let in_own_unit = Se3::new(frame.rotation, frame.translation / scale);
    in_own_unit.is_finite().then_some(())?;
    Some(v1::ClientFrame {
        client_id: client_name(map, id),
        map_from_odom: Some(to_rigid_transform(&in_own_unit)),
        keyframe: Some(to_keyframe_ref(map, id)),
        scale,
    })
}

/// The clients of a map that have not left it, sorted by name, the order of every answer.
pub(in crate::service) fn clients_by_name(map: &Map) -> Vec<(&str, ClientIndex)> {
    let present = (0u32..).zip(map.clients()).filter(|(_, client)| !client.has_left);
    let mut clients: Vec<(&str, ClientIndex)> =
        present.map(|(index, client)| (client.name.as_str(), ClientIndex(index))).collect();
    clients.sort_unstable();
    clients
}
