//! What events and maps have in common: ids, poses, cameras, observations, constraints, policies.
//!
//! Encoding takes every struct apart by name, so that a field that is added to one of them does not
//! compile until it is encoded here.

use std::sync::Arc;

use covis_solvers::geometry::{
    Camera, Geodetic, KannalaBrandt, PinholeRadialTangential, Se3, Sim3, Snavely, So3,
};
use covis_solvers::information::Information;
use covis_solvers::loss::Loss;
use covis_solvers::robust::Kernel;
use nalgebra::{Quaternion, SMatrix, UnitQuaternion, Vector2, Vector3};

use super::{EncodingError, required, v1};
use covis_map::{
    CameraEntity, ClientIndex, ClosureRobustness, Constraint, ConstraintKind, Depth, Descriptor,
    DescriptorKind, EntityId, Gauge, MapLimits, MapPolicy, NewLandmark, Observation, Prior,
    SwitchedOff, WhenFull,
};

type Decoded<T> = Result<T, EncodingError>;

const DESCRIPTOR_KINDS: [DescriptorKind; 3] =
    [DescriptorKind::Binary, DescriptorKind::Float32, DescriptorKind::Uint8];
const CONSTRAINT_KINDS: [ConstraintKind; 4] = [
    ConstraintKind::Odometry,
    ConstraintKind::LoopClosure,
    ConstraintKind::Other,
    ConstraintKind::Marginal,
];

/// The kind with a number; a kind is encoded as its index in its enum, from 1.
pub(super) fn decode_kind<T: Copy>(kinds: &[T], number: u32, name: &'static str) -> Decoded<T> {
    let kind = number.checked_sub(1).and_then(|index| kinds.get(index as usize));
    kind.copied().ok_or(EncodingError::Invalid(name))
}

pub(super) fn encode_id(id: EntityId) -> v1::Id {
    v1::Id { client: id.client.0, id: id.id }
}

pub(super) fn decode_id(id: v1::Id) -> EntityId {
    EntityId::new(ClientIndex(id.client), id.id)
}

/// An id that must be there.
pub(super) fn required_id(id: Option<v1::Id>, name: &'static str) -> Decoded<EntityId> {
    required(id, name).map(decode_id)
}

pub(super) fn encode_vector(vector: &Vector3<f64>) -> v1::Vector3 {
    v1::Vector3 { x: vector.x.to_bits(), y: vector.y.to_bits(), z: vector.z.to_bits() }
}

pub(super) fn decode_vector(vector: v1::Vector3) -> Vector3<f64> {
    Vector3::new(vector.x, vector.y, vector.z).map(f64::from_bits)
}

pub(super) fn encode_pose(pose: &Se3) -> v1::Pose {
    let (q, t) = (pose.rotation.quaternion().coords, pose.translation);
    v1::Pose {
        qx: q.x.to_bits(),
        qy: q.y.to_bits(),
        qz: q.z.to_bits(),
        qw: q.w.to_bits(),
        tx: t.x.to_bits(),
        ty: t.y.to_bits(),
        tz: t.z.to_bits(),
    }
}

/// A pose of a keyframe.
pub(super) fn encode_new_pose((id, pose): &(EntityId, Se3)) -> v1::NewPose {
    v1::NewPose { id: Some(encode_id(*id)), world_from_camera: Some(encode_pose(pose)) }
}

pub(super) fn decode_new_pose(pose: v1::NewPose) -> Decoded<(EntityId, Se3)> {
    let id = required_id(pose.id, "a keyframe")?;
    Ok((id, decode_pose(pose.world_from_camera, "a new pose")?))
}

pub(super) fn decode_pose(pose: Option<v1::Pose>, name: &'static str) -> Decoded<Se3> {
    let v1::Pose { qx, qy, qz, qw, tx, ty, tz } = required(pose, name)?;
    let [x, y, z, w] = [qx, qy, qz, qw].map(f64::from_bits);
    // As it was: normalizing again could change its last bits.
    let quaternion = UnitQuaternion::new_unchecked(Quaternion::new(w, x, y, z));
    let translation = Vector3::new(tx, ty, tz).map(f64::from_bits);
    Ok(Se3::new(So3::from_unit_quaternion(quaternion), translation))
}

/// A scale, absent where it is 1 as in every earlier version.
pub(super) fn encode_scale(scale: f64) -> Option<u64> {
    (scale != 1.0).then(|| scale.to_bits())
}

pub(super) fn decode_scale(scale: Option<u64>) -> f64 {
    scale.map_or(1.0, f64::from_bits)
}

pub(super) fn decode_similarity(
    pose: Option<v1::Pose>,
    scale: Option<u64>,
    name: &'static str,
) -> Decoded<Sim3> {
    Ok(Sim3 { scale: decode_scale(scale), ..decode_pose(pose, name)?.into() })
}

fn encode_information<const N: usize>(information: &Information<N>) -> Vec<f64> {
    information.matrix().as_slice().to_vec()
}

fn decode_information<const N: usize>(entries: &[f64]) -> Decoded<Information<N>> {
    let invalid = EncodingError::Invalid("an information matrix");
    if entries.len() != N * N {
        return Err(invalid);
    }
    let matrix = SMatrix::<f64, N, N>::from_column_slice(entries);
    // What was written went through the same constructor, which then changes no bit.
    let information = Information::semidefinite(&matrix);
    information.ok().filter(|information| *information.matrix() == matrix).ok_or(invalid)
}

fn encode_loss(loss: &Loss) -> v1::Loss {
    let (kind, width) = match *loss {
        Loss::Trivial => (1, 0.0),
        Loss::Huber(width) => (2, width),
        Loss::Cauchy(width) => (3, width),
        Loss::Tukey(width) => (4, width),
        Loss::GemanMcClure(width) => (5, width),
    };
    v1::Loss { kind, width: f64::to_bits(width) }
}

fn decode_loss(loss: Option<v1::Loss>) -> Decoded<Loss> {
    let v1::Loss { kind, width } = required(loss, "a loss")?;
    let width = f64::from_bits(width);
    match kind {
        1 => Ok(Loss::Trivial),
        2 => Ok(Loss::Huber(width)),
        3 => Ok(Loss::Cauchy(width)),
        4 => Ok(Loss::Tukey(width)),
        5 => Ok(Loss::GemanMcClure(width)),
        _ => Err(EncodingError::Invalid("a loss")),
    }
}

pub(super) fn encode_policy(policy: &MapPolicy) -> v1::Policy {
    let MapPolicy {
        local_bundle,
        loop_closure,
        closure_adjustment,
        odometry,
        metric_odometry,
        loop_closure_robustness: ClosureRobustness { kernel, threshold },
        window_keyframes,
        min_shared_landmarks,
        observation_loss,
        constraint_loss,
        max_local_iterations,
        limits,
        when_full,
        max_queued_items,
        gauge,
        geodetic_anchor,
        place_recognition,
    } = policy;
    v1::Policy {
        local_bundle: *local_bundle,
        loop_closure: *loop_closure,
        closure_adjustment: Some(*closure_adjustment),
        odometry: Some(*odometry),
        metric_odometry: Some(*metric_odometry),
        place_recognition: *place_recognition,
        window_keyframes: *window_keyframes as u64,
        min_shared_landmarks: *min_shared_landmarks as u64,
        observation_loss: Some(encode_loss(observation_loss)),
        constraint_loss: Some(encode_loss(constraint_loss)),
        max_local_iterations: *max_local_iterations as u64,
        max_keyframes: limits.keyframes,
        max_landmarks: limits.landmarks,
        max_observations: limits.observations,
        closure_kernel: match kernel {
            None => 0,
            Some(Kernel::TruncatedLeastSquares) => 1,
            Some(Kernel::GemanMcClure) => 2,
        },
        closure_threshold: threshold.map(f64::to_bits),
        max_bytes: limits.bytes,
        when_full: *when_full as u32,
        max_queued_items: *max_queued_items,
        max_clients: limits.clients,
        max_cameras: limits.cameras,
        max_constraints: limits.constraints,
        max_priors: limits.priors,
        gauge: *gauge as u32,
        geodetic_anchor: geodetic_anchor.as_ref().map(encode_geodetic),
    }
}

fn encode_geodetic(point: &Geodetic) -> v1::Geodetic {
    let Geodetic { latitude_deg, longitude_deg, height_m } = point;
    v1::Geodetic {
        latitude_deg: latitude_deg.to_bits(),
        longitude_deg: longitude_deg.to_bits(),
        height_m: height_m.to_bits(),
    }
}

fn decode_geodetic(point: v1::Geodetic) -> Geodetic {
    let v1::Geodetic { latitude_deg, longitude_deg, height_m } = point;
    Geodetic {
        latitude_deg: f64::from_bits(latitude_deg),
        longitude_deg: f64::from_bits(longitude_deg),
        height_m: f64::from_bits(height_m),
    }
}

pub(super) fn decode_policy(policy: Option<v1::Policy>) -> Decoded<MapPolicy> {
    let policy = required(policy, "a policy")?;
    let count = |value: u64| {
        usize::try_from(value).map_err(|_large| EncodingError::Invalid("a number of a policy"))
    };
    let kernel = match policy.closure_kernel {
        0 => None,
        1 => Some(Kernel::TruncatedLeastSquares),
        2 => Some(Kernel::GemanMcClure),
        _ => return Err(EncodingError::Invalid("the kernel of loop closures")),
    };
    let threshold = policy.closure_threshold.map(f64::from_bits);
    Ok(MapPolicy {
        local_bundle: policy.local_bundle,
        loop_closure: policy.loop_closure,
        closure_adjustment: policy.closure_adjustment.unwrap_or(true),
        odometry: policy.odometry.unwrap_or(true),
        metric_odometry: policy.metric_odometry.unwrap_or(true),
        place_recognition: policy.place_recognition,
        loop_closure_robustness: ClosureRobustness { kernel, threshold },
        window_keyframes: count(policy.window_keyframes)?,
        min_shared_landmarks: count(policy.min_shared_landmarks)?,
        observation_loss: decode_loss(policy.observation_loss)?,
        constraint_loss: decode_loss(policy.constraint_loss)?,
        max_local_iterations: count(policy.max_local_iterations)?,
        limits: MapLimits {
            clients: policy.max_clients,
            cameras: policy.max_cameras,
            constraints: policy.max_constraints,
            priors: policy.max_priors,
            keyframes: policy.max_keyframes,
            landmarks: policy.max_landmarks,
            observations: policy.max_observations,
            bytes: policy.max_bytes,
        },
        when_full: match policy.when_full {
            0 => WhenFull::Reject,
            1 => WhenFull::Marginalize,
            2 => WhenFull::Sparsify,
            _ => return Err(EncodingError::Invalid("what is done when the map is full")),
        },
        max_queued_items: policy.max_queued_items,
        gauge: match policy.gauge {
            0 => Gauge::FirstKeyframeFixed,
            1 => Gauge::Free,
            2 => Gauge::Priors,
            3 => Gauge::FixedPoses,
            _ => return Err(EncodingError::Invalid("a gauge")),
        },
        geodetic_anchor: policy.geodetic_anchor.map(decode_geodetic),
    })
}

fn decode_projection(model: u32, parameters: &[f64]) -> Decoded<Camera> {
    match (model, parameters) {
        (1, &[fx, fy, cx, cy, k1, k2, p1, p2, k3]) => {
            let pinhole = PinholeRadialTangential { fx, fy, cx, cy, k1, k2, p1, p2, k3 };
            Ok(Camera::Pinhole(pinhole))
        }
        (2, &[fx, fy, cx, cy, k1, k2, k3, k4]) => {
            Ok(Camera::Fisheye(KannalaBrandt { fx, fy, cx, cy, k1, k2, k3, k4 }))
        }
        (3, &[focal, k1, k2]) => Ok(Camera::Snavely(Snavely { focal, k1, k2 })),
        _ => Err(EncodingError::Invalid("a camera model")),
    }
}

pub(super) fn encode_camera_set(id: EntityId, camera: &CameraEntity) -> v1::CameraSet {
    let CameraEntity { camera, width_px, height_px } = *camera;
    let model = match camera {
        Camera::Pinhole(_) => 1,
        Camera::Fisheye(_) => 2,
        Camera::Snavely(_) => 3,
    };
    let parameters = camera.parameters().as_slice().to_vec();
    let camera = v1::Camera { model, parameters, width_px, height_px };
    v1::CameraSet { id: Some(encode_id(id)), camera: Some(camera) }
}

pub(super) fn decode_camera_set(set: v1::CameraSet) -> Decoded<(EntityId, CameraEntity)> {
    let id = required_id(set.id, "a camera's id")?;
    let v1::Camera { model, parameters, width_px, height_px } = required(set.camera, "a camera")?;
    let camera = decode_projection(model, &parameters)?;
    Ok((id, CameraEntity { camera, width_px, height_px }))
}

pub(super) fn encode_observations(observations: &[Observation]) -> Vec<v1::Observation> {
    observations.iter().map(encode_observation).collect()
}

pub(super) fn decode_observations(rows: Vec<v1::Observation>) -> Decoded<Vec<Observation>> {
    rows.into_iter().map(decode_observation).collect()
}

fn encode_observation(observation: &Observation) -> v1::Observation {
    let Observation { landmark, pixel, sigma_px, depth, descriptor } = observation;
    let depth = depth.map(|Depth { depth_m, sigma_m }| v1::Depth {
        depth_m: depth_m.to_bits(),
        sigma_m: sigma_m.to_bits(),
    });
    let descriptor = descriptor.as_deref().map(encode_descriptor);
    v1::Observation {
        client: landmark.client.0,
        landmark: landmark.id,
        u: pixel.x.to_bits(),
        v: pixel.y.to_bits(),
        sigma_px: sigma_px.to_bits(),
        depth,
        descriptor,
    }
}

fn decode_observation(row: v1::Observation) -> Decoded<Observation> {
    let v1::Observation { client, landmark, u, v, sigma_px, depth, descriptor } = row;
    let depth = depth.map(|depth| Depth {
        depth_m: f64::from_bits(depth.depth_m),
        sigma_m: f64::from_bits(depth.sigma_m),
    });
    Ok(Observation {
        landmark: EntityId::new(ClientIndex(client), landmark),
        pixel: Vector2::new(f64::from_bits(u), f64::from_bits(v)),
        sigma_px: f64::from_bits(sigma_px),
        depth,
        descriptor: descriptor.map(decode_descriptor).transpose()?,
    })
}

pub(super) fn encode_descriptor(descriptor: &Descriptor) -> v1::Descriptor {
    let Descriptor { kind, name, data } = descriptor;
    v1::Descriptor { kind: *kind as u32 + 1, name: name.clone(), data: data.clone() }
}

pub(super) fn decode_descriptor(descriptor: v1::Descriptor) -> Decoded<Arc<Descriptor>> {
    let v1::Descriptor { kind, name, data } = descriptor;
    let kind = decode_kind(&DESCRIPTOR_KINDS, kind, "a descriptor's kind")?;
    Ok(Arc::new(Descriptor { kind, name, data }))
}

pub(super) fn encode_point(&NewLandmark { id, position }: &NewLandmark) -> v1::Point {
    let EntityId { client, id } = id;
    v1::Point { client: client.0, id, position: position.as_ref().map(encode_vector) }
}

pub(super) fn decode_point(v1::Point { client, id, position }: v1::Point) -> NewLandmark {
    let id = EntityId::new(ClientIndex(client), id);
    NewLandmark { id, position: position.map(decode_vector) }
}

pub(super) fn encode_ids(ids: &[EntityId]) -> Vec<v1::Id> {
    ids.iter().copied().map(encode_id).collect()
}

pub(super) fn decode_ids(ids: Vec<v1::Id>) -> Vec<EntityId> {
    ids.into_iter().map(decode_id).collect()
}

pub(super) fn encode_constraint(id: EntityId, constraint: &Constraint) -> v1::Constraint {
    let Constraint { kind, keyframe_i, keyframe_j, keyframe_i_from_keyframe_j, information, loss } =
        constraint;
    v1::Constraint {
        id: Some(encode_id(id)),
        kind: *kind as u32 + 1,
        keyframe_i: Some(encode_id(*keyframe_i)),
        keyframe_j: Some(encode_id(*keyframe_j)),
        keyframe_i_from_keyframe_j: Some(encode_pose(keyframe_i_from_keyframe_j)),
        information: encode_information(information),
        loss: loss.as_ref().map(encode_loss),
    }
}

pub(super) fn decode_constraint(message: v1::Constraint) -> Decoded<(EntityId, Constraint)> {
    let kind = decode_kind(&CONSTRAINT_KINDS, message.kind, "a constraint's kind")?;
    let measured = message.keyframe_i_from_keyframe_j;
    let constraint = Constraint {
        kind,
        keyframe_i: required_id(message.keyframe_i, "keyframe_i")?,
        keyframe_j: required_id(message.keyframe_j, "keyframe_j")?,
        keyframe_i_from_keyframe_j: decode_pose(measured, "a constraint's pose")?,
        information: decode_information(&message.information)?,
        loss: message.loss.map(|loss| decode_loss(Some(loss))).transpose()?,
    };
    Ok((required_id(message.id, "a constraint's id")?, constraint))
}

pub(super) fn encode_switched_off(id: EntityId, off: &SwitchedOff) -> v1::SwitchedOff {
    let SwitchedOff { chi2, weight, is_provisional } = *off;
    let (chi2, weight) = (chi2.to_bits(), weight.to_bits());
    v1::SwitchedOff { id: Some(encode_id(id)), chi2, weight, is_provisional }
}

pub(super) fn decode_switched_off(message: v1::SwitchedOff) -> Decoded<(EntityId, SwitchedOff)> {
    let v1::SwitchedOff { id, chi2, weight, is_provisional } = message;
    let (chi2, weight) = (f64::from_bits(chi2), f64::from_bits(weight));
    let off = SwitchedOff { chi2, weight, is_provisional };
    Ok((required_id(id, "a constraint")?, off))
}

pub(super) fn encode_prior(id: EntityId, prior: &Prior) -> v1::Prior {
    // The defaults are absent, so that a journal is as it was before there were others.
    let own = |loss: &Loss| (*loss != Loss::Trivial).then(|| encode_loss(loss));
    let (pose, position, arm, information, loss) = match prior {
        Prior::Pose { keyframe: _, world_from_camera, information, loss } => {
            let information = encode_information(information);
            (Some(encode_pose(world_from_camera)), None, None, information, own(loss))
        }
        Prior::Position { keyframe: _, position_in_world, point_in_camera, information, loss } => {
            let has_arm = point_in_camera.iter().any(|x| x.to_bits() != 0);
            let arm = has_arm.then(|| encode_vector(point_in_camera));
            let information = encode_information(information);
            (None, Some(encode_vector(position_in_world)), arm, information, own(loss))
        }
    };
    v1::Prior {
        id: Some(encode_id(id)),
        keyframe: Some(encode_id(prior.keyframe())),
        world_from_camera: pose,
        position_in_world: position,
        information,
        loss,
        point_in_camera: arm,
    }
}

pub(super) fn decode_prior(message: v1::Prior) -> Decoded<(EntityId, Prior)> {
    let id = required_id(message.id, "a prior's id")?;
    let keyframe = required_id(message.keyframe, "a prior's keyframe")?;
    let loss = message.loss.map(|loss| decode_loss(Some(loss))).transpose()?.unwrap_or_default();
    let prior = match (message.world_from_camera, message.position_in_world) {
        (pose @ Some(_), None) => Prior::Pose {
            keyframe,
            world_from_camera: decode_pose(pose, "a prior's pose")?,
            information: decode_information(&message.information)?,
            loss,
        },
        (None, Some(position)) => Prior::Position {
            keyframe,
            position_in_world: decode_vector(position),
            point_in_camera: message.point_in_camera.map(decode_vector).unwrap_or_default(),
            information: decode_information(&message.information)?,
            loss,
        },
        _ => return Err(EncodingError::Invalid("a prior's measurement")),
    };
    Ok((id, prior))
}
