//! Items of an ingest stream, and the digest that identifies an item that is sent again.
//!
//! The digest is SHA-256 over the prost encoding of the item as received, without its sequence.
//! What needs the map (references, duplicates, projections) is checked by `Map::check`.

use std::sync::Arc;

use covis_solvers::geometry::{Camera, LieGroup, PinholeRadialTangential, Se3};
use covis_solvers::information::Information;
use nalgebra::{Vector2, Vector3};
use sha2::{Digest as _, Sha256};

use super::camera::camera;
use super::geometry::{information3, information6, rigid_transform, vector2, vector3};
use super::ids::{id, keyframe_ref, landmark_ref, owner};
use super::solve::loss;
use super::time::nanoseconds;
use super::{Path, Violations, all};
use crate::map::{
    CameraEntity, ConstraintKind, Depth, Descriptor, DescriptorKind, Digest, EntityRef, Item,
    ItemLandmark, ItemObservation, PartialItem, Reason, Rejection,
};
use crate::wire::v1;
use v1::ingest_request::Item as WireItem;

/// Longest descriptor of a feature, bytes.
const MAX_FEATURE_DESCRIPTOR: usize = 4096;
/// Longest descriptor of a whole image, bytes.
const MAX_IMAGE_DESCRIPTOR: usize = 65_536;
/// Most observations, and most landmarks, of one item: each needs some hundred bytes in the map,
/// however few on the wire.
const MAX_ENTRIES: usize = 65_536;
/// Placeholder for an id that cannot be read; no client can use it.
const UNREADABLE_ID: i64 = -1;
/// Longest name of a descriptor, bytes.
const MAX_DESCRIPTOR_NAME: usize = 64;

/// The digest of an item as received.
pub(in crate::service) fn digest(item: &WireItem) -> Digest {
    let mut bytes = Vec::with_capacity(item.encoded_len());
    item.encode(&mut bytes);
    Sha256::digest(&bytes).into()
}

/// An item that cannot be accepted.
#[derive(Debug)]
pub(in crate::service) struct Refused {
    /// Everything that is wrong with its fields.
    pub rejection: Rejection,
    /// The part that can be read; `None` if the map cannot check it.
    pub partial: Option<Box<PartialItem>>,
}

/// Converts an item from the stream of client `sender`.
///
/// # Errors
/// [`Refused`] with everything that is wrong with its fields.
pub(in crate::service) fn item(item: &WireItem, sender: &str) -> Result<Item, Refused> {
    let mut out = Violations::default();
    let read = read(item, sender, &mut out);
    if out.rejection.is_empty() {
        return out.finish(read).map_err(|rejection| Refused { rejection, partial: None });
    }
    let unreadable = std::mem::take(&mut out.unreadable);
    let partial = read.map(|item| Box::new(PartialItem { item, unreadable }));
    Err(Refused { rejection: out.rejection, partial })
}

/// The item, with placeholders for what cannot be read.
fn read(item: &WireItem, sender: &str, out: &mut Violations) -> Option<Item> {
    match item {
        WireItem::Camera(camera) => camera_item(Path::root("camera"), camera, sender, out),
        WireItem::Keyframe(keyframe) => keyframe_item(keyframe, sender, out),
        WireItem::Landmarks(batch) => {
            let at = Path::root("landmarks");
            let at = at.field("landmarks");
            out.not_empty(at, &batch.landmarks);
            Some(Item::Landmarks { landmarks: landmarks(at, &batch.landmarks, sender, out)? })
        }
        WireItem::Observations(batch) => observation_batch(batch, out),
        WireItem::RelativePose(constraint) => relative_pose(constraint, sender, out),
        WireItem::PositionPrior(prior) => position_prior(prior, sender, out),
        WireItem::PosePrior(prior) => pose_prior(prior, sender, out),
        WireItem::Rig(_) => out.unimplemented(Path::root("rig")),
        WireItem::RevokeConstraint(_) => out.unimplemented(Path::root("revoke_constraint")),
        WireItem::RemoveObservations(_) => out.unimplemented(Path::root("remove_observations")),
        WireItem::FuseLandmarks(_) => out.unimplemented(Path::root("fuse_landmarks")),
        WireItem::RemoveLandmarks(_) => out.unimplemented(Path::root("remove_landmarks")),
        WireItem::RemoveKeyframe(_) => out.unimplemented(Path::root("remove_keyframe")),
        WireItem::SetCamera(_) => out.unimplemented(Path::root("set_camera")),
        // A second open ends the stream before this point.
        WireItem::Open(_) => out.report(Path::root("open"), Reason::Duplicate, "open already"),
    }
}

fn camera_item(
    at: Path<'_>,
    message: &v1::Camera,
    sender: &str,
    out: &mut Violations,
) -> Option<Item> {
    let _own = owner(at.field("client_id"), &message.client_id, sender, out);
    let place = at.field("id");
    let id = id(place, message.id, out);
    let id = out.or(place, id, UNREADABLE_ID);
    // The placeholder of a camera that cannot be read causes no violation.
    let entity = camera(at, message, out).unwrap_or(CameraEntity {
        camera: Camera::Pinhole(PinholeRadialTangential::undistorted(1.0, 1.0, 0.0, 0.0)),
        width_px: 0,
        height_px: 0,
    });
    let CameraEntity { camera, width_px, height_px } = entity;
    Some(Item::Camera { id, camera, width_px, height_px })
}

fn keyframe_item(message: &v1::Keyframe, sender: &str, out: &mut Violations) -> Option<Item> {
    let at = Path::root("keyframe");
    let _own = owner(at.field("client_id"), &message.client_id, sender, out);
    let place = at.field("id");
    let id = id(place, message.id, out);
    let id = out.or(place, id, UNREADABLE_ID);
    let time = nanoseconds(at.field("capture_time"), message.capture_time.as_ref(), out);
    let camera = sensor(at, message, out);
    let camera = out.or(at.field("camera_id"), camera, None);
    if message.world_from_rig.is_some() {
        let _: Option<()> = out.unimplemented(at.field("world_from_rig"));
    }
    let start = at.field("world_from_camera");
    let pose = rigid_transform(start, message.world_from_camera.as_ref(), out);
    // The placeholder is not finite, so that nothing is projected from it.
    let nowhere = Se3 { translation: Vector3::repeat(f64::NAN), ..Se3::identity() };
    let world_from_camera = out.or(start, pose, nowhere);
    let odom = message.odom_from_camera.as_ref();
    let odom = odom.and_then(|odom| rigid_transform(at.field("odom_from_camera"), Some(odom), out));
    let observations = observations(at.field("observations"), &message.observations, out);
    let landmarks = landmarks(at.field("landmarks"), &message.landmarks, sender, out);
    let _kept = descriptor(
        at.field("global_descriptor"),
        message.global_descriptor.as_ref(),
        MAX_IMAGE_DESCRIPTOR,
        out,
    );
    Some(Item::Keyframe {
        id,
        capture_time_ns: time.unwrap_or(0),
        camera: camera.map(EntityRef::own),
        world_from_camera,
        odom_from_camera: odom,
        observations: observations?,
        landmarks: landmarks?,
    })
}

/// The camera of a keyframe, `Some(None)` if it names none; the map checks whether it needs one.
fn sensor(at: Path<'_>, message: &v1::Keyframe, out: &mut Violations) -> Option<Option<i64>> {
    match message.sensor {
        None => Some(None),
        Some(v1::keyframe::Sensor::CameraId(camera)) => {
            id(at.field("camera_id"), camera, out).map(Some)
        }
        Some(v1::keyframe::Sensor::RigId(_)) => out.unimplemented(at.field("rig_id")),
    }
}

fn observation_batch(batch: &v1::ObservationBatch, out: &mut Violations) -> Option<Item> {
    let at = Path::root("observations");
    let place = at.field("keyframe");
    let keyframe = keyframe_ref(place, batch.keyframe.as_ref(), out);
    let keyframe = out.or(place, keyframe, EntityRef::own(UNREADABLE_ID));
    let list = at.field("observations");
    out.not_empty(list, &batch.observations);
    let observations = observations(list, &batch.observations, out)?;
    Some(Item::Observations { keyframe, observations })
}

fn observations(
    at: Path<'_>,
    messages: &[v1::Observation],
    out: &mut Violations,
) -> Option<Vec<ItemObservation>> {
    out.at_most(at, messages, MAX_ENTRIES)?;
    all(at, messages, out, observation)
}

fn observation(
    at: Path<'_>,
    message: &v1::Observation,
    out: &mut Violations,
) -> Option<ItemObservation> {
    let place = at.field("landmark");
    let landmark = landmark_ref(place, message.landmark.as_ref(), out);
    let landmark = out.or(place, landmark, EntityRef::own(UNREADABLE_ID));
    // A keyframe of one camera has no other; rigs are refused before.
    let _first = out.within(at.field("camera_index"), message.camera_index, 0, 0);
    let place = at.field("pixel");
    let pixel = vector2(place, message.pixel.as_ref(), out);
    let pixel = out.or(place, pixel, Vector2::repeat(f64::NAN));
    let sigma = out.positive(at.field("sigma_px"), message.sigma_px.unwrap_or(1.0));
    let depth = depth(at, message.depth_m, message.sigma_depth_m, out);
    let kept = descriptor(
        at.field("descriptor"),
        message.descriptor.as_ref(),
        MAX_FEATURE_DESCRIPTOR,
        out,
    );
    Some(ItemObservation {
        landmark,
        pixel,
        sigma_px: sigma.unwrap_or(1.0),
        depth: depth.flatten(),
        descriptor: kept.flatten().map(Arc::new),
    })
}

/// `depth_m` with `sigma_depth_m`: both or neither.
pub(super) fn depth(
    at: Path<'_>,
    depth_m: Option<f64>,
    sigma_m: Option<f64>,
    out: &mut Violations,
) -> Option<Option<Depth>> {
    match (depth_m, sigma_m) {
        (None, None) => Some(None),
        (Some(depth), Some(sigma)) => {
            let depth = out.positive(at.field("depth_m"), depth);
            let sigma = out.positive(at.field("sigma_depth_m"), sigma);
            Some(Some(Depth { depth_m: depth?, sigma_m: sigma? }))
        }
        (Some(_), None) => {
            out.report(at.field("sigma_depth_m"), Reason::Inconsistent, "required with depth_m")
        }
        (None, Some(_)) => {
            out.report(at.field("sigma_depth_m"), Reason::Inconsistent, "refused without depth_m")
        }
    }
}

fn descriptor(
    at: Path<'_>,
    message: Option<&v1::Descriptor>,
    longest: usize,
    out: &mut Violations,
) -> Option<Option<Descriptor>> {
    let Some(message) = message else { return Some(None) };
    let kind = match out.known(at.field("kind"), message.kind) {
        Some(v1::DescriptorKind::Unspecified) => out.missing(at.field("kind")),
        Some(v1::DescriptorKind::Binary) => Some(DescriptorKind::Binary),
        Some(v1::DescriptorKind::Float32) => Some(DescriptorKind::Float32),
        Some(v1::DescriptorKind::Uint8) => Some(DescriptorKind::Uint8),
        None => None,
    };
    for (name, length, limit) in
        [("name", message.name.len(), MAX_DESCRIPTOR_NAME), ("data", message.data.len(), longest)]
    {
        if length > limit {
            let text = format!("{length} bytes, at most {limit} are taken");
            let _: Option<()> = out.report(at.field(name), Reason::TooLarge, text);
        }
    }
    Some(Some(Descriptor { kind: kind?, name: message.name.clone(), data: message.data.clone() }))
}

fn landmarks(
    at: Path<'_>,
    messages: &[v1::Landmark],
    sender: &str,
    out: &mut Violations,
) -> Option<Vec<ItemLandmark>> {
    out.at_most(at, messages, MAX_ENTRIES)?;
    all(at, messages, out, |at, message, out| {
        let _own = owner(at.field("client_id"), &message.client_id, sender, out);
        let place = at.field("id");
        let id = id(place, message.id, out);
        let id = out.or(place, id, UNREADABLE_ID);
        let position = message.point_in_world.as_ref();
        let read = position.and_then(|point| vector3(at.field("point_in_world"), Some(point), out));
        if position.is_some() && read.is_none() {
            // It is unknown whether the map has the landmark with another position.
            out.unreadable.push(place.to_string());
        }
        let _kept = descriptor(
            at.field("descriptor"),
            message.descriptor.as_ref(),
            MAX_FEATURE_DESCRIPTOR,
            out,
        );
        Some(ItemLandmark { id, position: read })
    })
}

fn relative_pose(
    message: &v1::RelativePoseConstraint,
    sender: &str,
    out: &mut Violations,
) -> Option<Item> {
    let at = Path::root("relative_pose");
    let _own = owner(at.field("client_id"), &message.client_id, sender, out);
    let place = at.field("id");
    let id = id(place, message.id, out);
    let id = out.or(place, id, UNREADABLE_ID);
    let place = at.field("keyframe_i");
    let keyframe_i = keyframe_ref(place, message.keyframe_i.as_ref(), out);
    let keyframe_i = out.or(place, keyframe_i, EntityRef::own(UNREADABLE_ID));
    let place = at.field("keyframe_j");
    let keyframe_j = keyframe_ref(place, message.keyframe_j.as_ref(), out);
    let keyframe_j = out.or(place, keyframe_j, EntityRef::own(UNREADABLE_ID));
    let measured = rigid_transform(
        at.field("keyframe_i_from_keyframe_j"),
        message.keyframe_i_from_keyframe_j.as_ref(),
        out,
    );
    let information = information6(at.field("information"), message.information.as_ref(), out);
    let kind = match out.known(at.field("kind"), message.kind) {
        Some(v1::ConstraintKind::Unspecified) => out.missing(at.field("kind")),
        Some(v1::ConstraintKind::Odometry) => Some(ConstraintKind::Odometry),
        Some(v1::ConstraintKind::LoopClosure) => Some(ConstraintKind::LoopClosure),
        Some(v1::ConstraintKind::Other) => Some(ConstraintKind::Other),
        Some(v1::ConstraintKind::Marginal) => out.report(
            at.field("kind"),
            Reason::OutOfRange,
            "marginal constraints are the server's own",
        ),
        None => None,
    };
    let _none = no_own_loss(at, message.loss.as_ref(), false, out);
    Some(Item::RelativePose {
        id,
        kind: kind.unwrap_or(ConstraintKind::Other),
        keyframe_i,
        keyframe_j,
        keyframe_i_from_keyframe_j: measured.unwrap_or_else(Se3::identity),
        information: information.unwrap_or_else(Information::identity),
    })
}

fn position_prior(message: &v1::PositionPrior, sender: &str, out: &mut Violations) -> Option<Item> {
    let at = Path::root("position_prior");
    let _own = owner(at.field("client_id"), &message.client_id, sender, out);
    let place = at.field("id");
    let id = id(place, message.id, out);
    let id = out.or(place, id, UNREADABLE_ID);
    let place = at.field("keyframe");
    let keyframe = keyframe_ref(place, message.keyframe.as_ref(), out);
    let keyframe = out.or(place, keyframe, EntityRef::own(UNREADABLE_ID));
    let point = vector3(at.field("point_in_world"), message.point_in_world.as_ref(), out);
    if let Some(arm) = &message.point_in_camera {
        let place = at.field("point_in_camera");
        if vector3(place, Some(arm), out).is_some_and(|arm| arm.norm() > 0.0) {
            let _: Option<()> = out.unimplemented(place);
        }
    }
    let information = information3(at.field("information"), message.information.as_ref(), out);
    let _none = no_own_loss(at, message.loss.as_ref(), true, out);
    Some(Item::PositionPrior {
        id,
        keyframe,
        position_in_world: point.unwrap_or_default(),
        information: information.unwrap_or_else(Information::identity),
    })
}

fn pose_prior(message: &v1::PosePrior, sender: &str, out: &mut Violations) -> Option<Item> {
    let at = Path::root("pose_prior");
    let _own = owner(at.field("client_id"), &message.client_id, sender, out);
    let place = at.field("id");
    let id = id(place, message.id, out);
    let id = out.or(place, id, UNREADABLE_ID);
    let place = at.field("keyframe");
    let keyframe = keyframe_ref(place, message.keyframe.as_ref(), out);
    let keyframe = out.or(place, keyframe, EntityRef::own(UNREADABLE_ID));
    let pose =
        rigid_transform(at.field("world_from_camera"), message.world_from_camera.as_ref(), out);
    let information = information6(at.field("information"), message.information.as_ref(), out);
    let _none = no_own_loss(at, message.loss.as_ref(), true, out);
    Some(Item::PosePrior {
        id,
        keyframe,
        world_from_camera: pose.unwrap_or_else(Se3::identity),
        information: information.unwrap_or_else(Information::identity),
    })
}

/// A loss of a single constraint: not served yet, unless it is the trivial loss and the constraint
/// has that already.
fn no_own_loss(
    at: Path<'_>,
    message: Option<&v1::Loss>,
    trivial_by_default: bool,
    out: &mut Violations,
) -> Option<()> {
    let at = at.field("loss");
    match loss(at, message, out)? {
        None => Some(()),
        Some(covis_solvers::loss::Loss::Trivial) if trivial_by_default => Some(()),
        Some(_) => out.unimplemented(at),
    }
}
