//! Items of an ingest stream, and the digest that identifies an item that is sent again.
//!
//! The digest is SHA-256 over the item as prost encodes it again, without its sequence. It is not
//! taken of the bytes that came: encodings of one message may differ, and journals and clients that
//! resume after an upgrade need the same digest for the same item.
//! What needs the map (references, duplicates, projections) is checked by `Map::check`.

use std::sync::Arc;

use covis_solvers::geometry::{Camera, LieGroup, PinholeRadialTangential, Se3};
use covis_solvers::information::Information;
use nalgebra::{Vector2, Vector3};
use sha2::{Digest as _, Sha256};

use super::camera::camera;
use super::geometry::{geodetic, information, rigid_transform, vector2, vector3};
use super::ids::{keyframe_ref, landmark_ref};
use super::solve::own_loss;
use super::time::nanoseconds;
use super::{Path, Violations, all, edit, ids};
use crate::map::{
    CameraEntity, ConstraintKind, Depth, Descriptor, DescriptorKind, Digest, EntityRef, Item,
    ItemLandmark, ItemObservation, MeasuredPosition, PartialItem, Reason, Rejection,
};
use crate::place::is_image_descriptor;
use crate::wire::v1;
use v1::ingest_request::Item as WireItem;
use v1::keyframe::Sensor;

/// Longest descriptor of a feature, bytes.
const MAX_FEATURE_DESCRIPTOR: usize = 4096;
/// Longest descriptor of a whole image, bytes.
const MAX_IMAGE_DESCRIPTOR: usize = 65_536;
/// Most observations, and most landmarks, of one item: each needs some hundred bytes in the map,
/// however few on the wire.
pub(super) const MAX_ENTRIES: usize = 65_536;
/// Placeholder for an id that cannot be read; no client can use it.
pub(super) const UNREADABLE_ID: i64 = -1;
/// Placeholder for a camera that cannot be read; it causes no violation.
pub(super) const UNREADABLE_CAMERA: CameraEntity = CameraEntity {
    camera: Camera::Pinhole(PinholeRadialTangential {
        fx: 1.0,
        fy: 1.0,
        cx: 0.0,
        cy: 0.0,
        k1: 0.0,
        k2: 0.0,
        p1: 0.0,
        p2: 0.0,
        k3: 0.0,
    }),
    width_px: 0,
    height_px: 0,
};
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
pub(in crate::service) fn item(item: WireItem, sender: &str) -> Result<Item, Refused> {
    let mut out = Violations::default();
    let read = read(item, sender, &mut out);
    if out.rejection.is_empty() {
        return out.finish(read).map_err(|rejection| Refused { rejection, partial: None });
    }
    let Violations { rejection, unreadable } = out;
    let partial = read.map(|item| Box::new(PartialItem { item, unreadable }));
    Err(Refused { rejection, partial })
}

/// The item, with placeholders for what cannot be read.
fn read(item: WireItem, sender: &str, out: &mut Violations) -> Option<Item> {
    match item {
        WireItem::Camera(message) => Some(camera_item(&message, sender, out)),
        WireItem::Keyframe(message) => keyframe(message, sender, out),
        WireItem::Landmarks(batch) => {
            let at = Path::root("landmarks");
            let at = at.field("landmarks");
            out.not_empty(at, &batch.landmarks);
            Some(Item::Landmarks { landmarks: landmarks(at, &batch.landmarks, sender, out)? })
        }
        WireItem::Observations(batch) => {
            let at = Path::root("observations");
            let keyframe = known_keyframe(at.field("keyframe"), batch.keyframe.as_ref(), out);
            let list = at.field("observations");
            out.not_empty(list, &batch.observations);
            let observations = observations(list, batch.observations, out)?;
            Some(Item::Observations { keyframe, observations })
        }
        WireItem::RelativePose(message) => Some(relative_pose(&message, sender, out)),
        WireItem::PositionPrior(message) => Some(position_prior(&message, sender, out)),
        WireItem::PosePrior(message) => Some(pose_prior(&message, sender, out)),
        WireItem::Rig(_) => out.unimplemented(Path::root("rig")),
        WireItem::RevokeConstraint(message) => Some(edit::revoke_constraint(&message, out)),
        WireItem::RemoveObservations(message) => edit::remove_observations(message, out),
        WireItem::FuseLandmarks(message) => edit::fuse_landmarks(message, out),
        WireItem::RemoveLandmarks(message) => edit::remove_landmarks(message, out),
        WireItem::RemoveKeyframe(message) => Some(edit::remove_keyframe(&message, out)),
        WireItem::SetCamera(message) => Some(edit::set_camera(&message, out)),
        // A second open ends the stream before this point.
        WireItem::Open(_) => out.report(Path::root("open"), Reason::Duplicate, "open already"),
    }
}

/// The id of an entity that the stream of `sender` adds. Its `client_id` is empty or the sender's:
/// nobody adds to another client's entities.
fn own_id(at: Path<'_>, client_id: &str, id: i64, sender: &str, out: &mut Violations) -> i64 {
    if !client_id.is_empty() && client_id != sender {
        let text = format!(
            "{client_id} is another client; a stream can only add entities of its own client"
        );
        let _: Option<()> = out.report(at.field("client_id"), Reason::Inconsistent, text);
    }
    let field = at.field("id");
    let id = ids::id(field, id, out);
    out.or(field, id, UNREADABLE_ID)
}

/// The keyframe that an item refers to.
pub(super) fn known_keyframe(
    at: Path<'_>,
    keyframe: Option<&v1::KeyframeRef>,
    out: &mut Violations,
) -> EntityRef {
    let keyframe = keyframe_ref(at, keyframe, out);
    out.or(at, keyframe, EntityRef::own(UNREADABLE_ID))
}

fn camera_item(message: &v1::Camera, sender: &str, out: &mut Violations) -> Item {
    let at = Path::root("camera");
    let id = own_id(at, &message.client_id, message.id, sender, out);
    let entity = camera(at, message, out).unwrap_or(UNREADABLE_CAMERA);
    let CameraEntity { camera, width_px, height_px } = entity;
    Item::Camera { id, camera, width_px, height_px }
}

fn keyframe(message: v1::Keyframe, sender: &str, out: &mut Violations) -> Option<Item> {
    let at = Path::root("keyframe");
    let id = own_id(at, &message.client_id, message.id, sender, out);
    let time = nanoseconds(at.field("capture_time"), message.capture_time.as_ref(), out);
    let camera = sensor(at, message.sensor, out);
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
    let observations = observations(at.field("observations"), message.observations, out);
    let landmarks = landmarks(at.field("landmarks"), &message.landmarks, sender, out);
    let image = message.global_descriptor;
    let field = at.field("global_descriptor");
    let image = image.and_then(|image| image_descriptor(field, image, out));
    Some(Item::Keyframe {
        id,
        capture_time_ns: time.unwrap_or(0),
        camera: camera.map(EntityRef::own),
        world_from_camera,
        odom_from_camera: odom,
        observations: observations?,
        landmarks: landmarks?,
        global_descriptor: image.map(Arc::new),
    })
}

/// The camera of a keyframe, `Some(None)` if it names none; the map checks whether it needs one.
fn sensor(at: Path<'_>, sensor: Option<Sensor>, out: &mut Violations) -> Option<Option<i64>> {
    match sensor {
        None => Some(None),
        Some(Sensor::CameraId(camera)) => ids::id(at.field("camera_id"), camera, out).map(Some),
        Some(Sensor::RigId(_)) => out.unimplemented(at.field("rig_id")),
    }
}

fn observations(
    at: Path<'_>,
    messages: Vec<v1::Observation>,
    out: &mut Violations,
) -> Option<Vec<ItemObservation>> {
    out.at_most(at, &messages, MAX_ENTRIES)?;
    all(at, messages, out, |at, message, out| {
        let field = at.field("landmark");
        let landmark = landmark_ref(field, message.landmark.as_ref(), out);
        let landmark = out.or(field, landmark, EntityRef::own(UNREADABLE_ID));
        // A keyframe of one camera has no other; rigs are refused before.
        let _first = out.within(at.field("camera_index"), message.camera_index, 0, 0);
        let field = at.field("pixel");
        let pixel = vector2(field, message.pixel.as_ref(), out);
        let pixel = out.or(field, pixel, Vector2::repeat(f64::NAN));
        let sigma = out.positive(at.field("sigma_px"), message.sigma_px.unwrap_or(1.0));
        let depth = depth(at, message.depth_m, message.sigma_depth_m, out);
        let field = at.field("descriptor");
        let sent = message.descriptor;
        let descriptor = sent.and_then(|d| feature_descriptor(field, d, out));
        let descriptor = descriptor.map(Arc::new);
        let sigma_px = sigma.unwrap_or(1.0);
        Some(ItemObservation { landmark, pixel, sigma_px, depth: depth.flatten(), descriptor })
    })
}

/// `depth_m` with `sigma_depth_m`: both or neither.
pub(in crate::service) fn depth(
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

/// A descriptor of a feature.
pub(in crate::service) fn feature_descriptor(
    at: Path<'_>,
    message: v1::Descriptor,
    out: &mut Violations,
) -> Option<Descriptor> {
    descriptor(at, message, MAX_FEATURE_DESCRIPTOR, out)
}

/// A descriptor of a whole image. Such are compared by the cosine, which needs numbers with a direction.
pub(in crate::service) fn image_descriptor(
    at: Path<'_>,
    message: v1::Descriptor,
    out: &mut Violations,
) -> Option<Descriptor> {
    let image = descriptor(at, message, MAX_IMAGE_DESCRIPTOR, out)?;
    if image.kind != DescriptorKind::Float32 {
        let text = "whole images are compared by FLOAT32 descriptors only";
        return out.report(at.field("kind"), Reason::OutOfRange, text);
    }
    if !is_image_descriptor(&image.data) {
        let text = "the norm of its numbers is 0 or too large";
        return out.report(at.field("data"), Reason::OutOfRange, text);
    }
    Some(image)
}

/// A descriptor of at most `longest` bytes.
fn descriptor(
    at: Path<'_>,
    message: v1::Descriptor,
    longest: usize,
    out: &mut Violations,
) -> Option<Descriptor> {
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
            let text = format!("{length} bytes, at most {limit} are allowed");
            let _: Option<()> = out.report(at.field(name), Reason::TooLarge, text);
        }
    }
    let v1::Descriptor { name, data, .. } = message;
    let field = at.field("data");
    out.not_empty(field, &data);
    if kind == Some(DescriptorKind::Float32) {
        let (numbers, rest) = data.as_chunks();
        if !rest.is_empty() {
            let text = format!("{} bytes are not a list of 32-bit floats", data.len());
            let _: Option<()> = out.report(field, Reason::WrongLength, text);
        } else if !numbers.iter().all(|&number| f32::from_le_bytes(number).is_finite()) {
            let text = "a number is not finite";
            let _: Option<()> = out.report(field, Reason::NotFinite, text);
        }
    }
    Some(Descriptor { kind: kind?, name, data })
}

fn landmarks(
    at: Path<'_>,
    messages: &[v1::Landmark],
    sender: &str,
    out: &mut Violations,
) -> Option<Vec<ItemLandmark>> {
    out.at_most(at, messages, MAX_ENTRIES)?;
    all(at, messages, out, |at, message, out| {
        let id = own_id(at, &message.client_id, message.id, sender, out);
        let position = message.point_in_world.as_ref();
        let read = position.and_then(|point| vector3(at.field("point_in_world"), Some(point), out));
        if position.is_some() && read.is_none() {
            // It is unknown whether the map has the landmark with another position.
            out.unreadable.push(at.field("id").to_string());
        }
        if message.descriptor.is_some() {
            let _: Option<()> = out.unimplemented(at.field("descriptor"));
        }
        Some(ItemLandmark { id, position: read })
    })
}

/// The information of a constraint; the identity stands for one that cannot be read.
fn information_or_identity<const N: usize>(
    at: Path<'_>,
    upper_triangle: Option<&Vec<f64>>,
    out: &mut Violations,
) -> Information<N> {
    let information = information(at.field("information"), upper_triangle, out);
    information.unwrap_or_else(Information::identity)
}

fn relative_pose(message: &v1::RelativePoseConstraint, sender: &str, out: &mut Violations) -> Item {
    let at = Path::root("relative_pose");
    let id = own_id(at, &message.client_id, message.id, sender, out);
    let keyframe_i = known_keyframe(at.field("keyframe_i"), message.keyframe_i.as_ref(), out);
    let keyframe_j = known_keyframe(at.field("keyframe_j"), message.keyframe_j.as_ref(), out);
    let measured = message.keyframe_i_from_keyframe_j.as_ref();
    let measured = rigid_transform(at.field("keyframe_i_from_keyframe_j"), measured, out);
    let upper_triangle = message.information.as_ref().map(|m| &m.upper_triangle);
    let information = information_or_identity(at, upper_triangle, out);
    let kind = match out.known(at.field("kind"), message.kind) {
        Some(v1::ConstraintKind::Unspecified) => out.missing(at.field("kind")),
        Some(v1::ConstraintKind::Odometry) => Some(ConstraintKind::Odometry),
        Some(v1::ConstraintKind::LoopClosure) => Some(ConstraintKind::LoopClosure),
        Some(v1::ConstraintKind::Other) => Some(ConstraintKind::Other),
        Some(v1::ConstraintKind::Marginal) => {
            let text = "only the server adds marginal constraints";
            out.report(at.field("kind"), Reason::OutOfRange, text)
        }
        None => None,
    };
    let loss = own_loss(at, message.loss.as_ref(), out).flatten();
    Item::RelativePose {
        id,
        kind: kind.unwrap_or(ConstraintKind::Other),
        keyframe_i,
        keyframe_j,
        keyframe_i_from_keyframe_j: measured.unwrap_or_else(Se3::identity),
        information,
        loss,
    }
}

fn position_prior(message: &v1::PositionPrior, sender: &str, out: &mut Violations) -> Item {
    let at = Path::root("position_prior");
    let id = own_id(at, &message.client_id, message.id, sender, out);
    let keyframe = known_keyframe(at.field("keyframe"), message.keyframe.as_ref(), out);
    let position = position(at, message, out);
    let arm = message.point_in_camera.as_ref();
    let arm = arm.and_then(|arm| vector3(at.field("point_in_camera"), Some(arm), out));
    let upper_triangle = message.information.as_ref().map(|m| &m.upper_triangle);
    let information = information_or_identity(at, upper_triangle, out);
    let loss = own_loss(at, message.loss.as_ref(), out).flatten().unwrap_or_default();
    Item::PositionPrior {
        id,
        keyframe,
        position: position.unwrap_or(MeasuredPosition::InWorld(Vector3::zeros())),
        point_in_camera: arm.unwrap_or_default(),
        information,
        loss,
    }
}

/// Where a position prior has its point: in the world or on the Earth, not both.
fn position(
    at: Path<'_>,
    message: &v1::PositionPrior,
    out: &mut Violations,
) -> Option<MeasuredPosition> {
    let (world, earth) = (at.field("point_in_world"), at.field("geodetic_point"));
    match (&message.point_in_world, &message.geodetic_point) {
        (Some(_), Some(_)) => {
            let text = "point_in_world is given too";
            out.report(earth, Reason::Inconsistent, text)
        }
        (point, None) => vector3(world, point.as_ref(), out).map(MeasuredPosition::InWorld),
        (None, Some(point)) => geodetic(earth, point, out).map(MeasuredPosition::OnEarth),
    }
}

fn pose_prior(message: &v1::PosePrior, sender: &str, out: &mut Violations) -> Item {
    let at = Path::root("pose_prior");
    let id = own_id(at, &message.client_id, message.id, sender, out);
    let keyframe = known_keyframe(at.field("keyframe"), message.keyframe.as_ref(), out);
    let pose =
        rigid_transform(at.field("world_from_camera"), message.world_from_camera.as_ref(), out);
    let world_from_camera = pose.unwrap_or_else(Se3::identity);
    let upper_triangle = message.information.as_ref().map(|m| &m.upper_triangle);
    let information = information_or_identity(at, upper_triangle, out);
    let loss = own_loss(at, message.loss.as_ref(), out).flatten().unwrap_or_default();
    Item::PosePrior { id, keyframe, world_from_camera, information, loss }
}
