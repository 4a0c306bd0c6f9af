//! What an event changes, as a message and back.
//!
//! Both matches name every variant: a new kind of change does not compile until it has its message.

use super::clients::{decode_noise, encode_noise};
use super::entities::{
    decode_camera_set, decode_constraint, decode_descriptor, decode_id, decode_ids, decode_kind,
    decode_new_pose, decode_observations, decode_point, decode_policy, decode_pose, decode_prior,
    decode_scale, decode_similarity, decode_switched_off, encode_camera_set, encode_constraint,
    encode_descriptor, encode_id, encode_ids, encode_new_pose, encode_observations, encode_point,
    encode_policy, encode_pose, encode_prior, encode_scale, encode_switched_off, required_id,
};
use super::merging::{decode_merge, encode_merge};
use super::places::{decode_search, encode_search};
use super::v1::event::Change as Wire;
use super::{EncodingError, required, v1};
use covis_map::{
    AppliedSolve, Change, ClientIndex, Comparison, EntityId, NewLandmark, RequestId, Retired,
    SolveKind,
};
use nalgebra::Vector3;

type Decoded<T> = Result<T, EncodingError>;

pub(super) fn encode_change(change: &Change) -> Wire {
    match change {
        Change::Created { policy, create_time_ns, display_name } => Wire::Created(v1::Created {
            policy: Some(encode_policy(policy)),
            create_time_ns: *create_time_ns,
            display_name: display_name.clone(),
        }),
        Change::ClientOpened { name, epoch } => {
            Wire::ClientOpened(v1::ClientOpened { name: name.clone(), epoch: *epoch })
        }
        Change::CameraSet { id, camera } => Wire::CameraSet(encode_camera_set(*id, camera)),
        Change::KeyframeAdded {
            id,
            capture_time_ns,
            camera,
            world_from_camera,
            odom_from_camera,
            observations,
            landmarks,
            global_descriptor,
            motion,
        } => Wire::KeyframeAdded(v1::KeyframeAdded {
            id: Some(encode_id(*id)),
            capture_time_ns: *capture_time_ns,
            camera: camera.map(encode_id),
            world_from_camera: Some(encode_pose(world_from_camera)),
            odom_from_camera: Some(encode_pose(odom_from_camera)),
            observations: encode_observations(observations),
            landmarks: landmarks.iter().map(encode_point).collect(),
            motion: motion.map(|motion| encode_pose(&motion.rigid())),
            scale: motion.and_then(|motion| encode_scale(motion.scale)),
            global_descriptor: global_descriptor.as_deref().map(encode_descriptor),
        }),
        Change::LandmarksAdded { landmarks, scale } => {
            let landmarks = landmarks.iter().map(encode_point).collect();
            let scale = encode_scale(*scale);
            Wire::LandmarksAdded(v1::LandmarksAdded { landmarks, scale })
        }
        Change::ObservationsAdded { keyframe, observations } => {
            Wire::ObservationsAdded(v1::ObservationsAdded {
                keyframe: Some(encode_id(*keyframe)),
                observations: encode_observations(observations),
            })
        }
        Change::ConstraintAdded { id, constraint } => {
            Wire::ConstraintAdded(encode_constraint(*id, constraint))
        }
        Change::PriorAdded { id, prior } => Wire::PriorAdded(encode_prior(*id, prior)),
        Change::LandmarksTriangulated { positions } => {
            let positions = encode_positions(positions);
            Wire::LandmarksTriangulated(v1::LandmarksTriangulated { positions })
        }
        Change::SolveApplied { solve } => Wire::SolveApplied(encode_solve(solve)),
        Change::ObservationsRemoved { observations } => {
            let sighting = |&(keyframe, landmark): &(EntityId, EntityId)| v1::Sighting {
                keyframe: Some(encode_id(keyframe)),
                landmark: Some(encode_id(landmark)),
            };
            let observations = observations.iter().map(sighting).collect();
            Wire::ObservationsRemoved(v1::ObservationsRemoved { observations })
        }
        Change::LandmarksFused { kept, absorbed } => Wire::LandmarksFused(v1::LandmarksFused {
            kept: Some(encode_id(*kept)),
            absorbed: encode_ids(absorbed),
        }),
        Change::DuplicatesFound { comparisons } => {
            let comparison = |comparison: &Comparison| v1::Comparison {
                closure: Some(encode_id(comparison.closure)),
                landmarks: comparison
                    .pairs
                    .iter()
                    .flat_map(|&(a, b)| [a, b].map(encode_id))
                    .collect(),
            };
            let comparisons = comparisons.iter().map(comparison).collect();
            Wire::DuplicatesFound(v1::DuplicatesFound { comparisons })
        }
        Change::DuplicatesSplit { closures, landmarks } => {
            Wire::DuplicatesSplit(v1::DuplicatesSplit {
                closures: encode_ids(closures),
                landmarks: encode_ids(landmarks),
            })
        }
        Change::PlacesSearched { searches, closures } => Wire::PlacesSearched(v1::PlacesSearched {
            searches: searches.iter().map(|(id, search)| encode_search(*id, search)).collect(),
            closures: closures.iter().map(|(id, c)| encode_constraint(*id, c)).collect(),
        }),
        Change::MapMerged { merge } => Wire::MapMerged(encode_merge(merge)),
        Change::MapTakenOut { name, clients_leave } => {
            let (name, clients_leave) = (name.clone(), *clients_leave);
            Wire::MapTakenOut(v1::MapTakenOut { name, clients_leave })
        }
        Change::LandmarksRemoved { landmarks } => {
            let landmarks = encode_ids(landmarks);
            Wire::LandmarksRemoved(v1::LandmarksRemoved { landmarks })
        }
        Change::KeyframeRemoved { keyframe } => Wire::KeyframeRemoved(encode_id(*keyframe)),
        Change::KeyframeRetired { retired } => Wire::KeyframeRetired(encode_retired(retired)),
        Change::ConstraintRevoked { id } => Wire::ConstraintRevoked(encode_id(*id)),
        Change::ItemRepeated => Wire::ItemRepeated(v1::ItemRepeated {}),
        Change::MapUpdated { display_name, policy, frozen } => Wire::MapUpdated(v1::MapUpdated {
            display_name: display_name.clone(),
            policy: policy.as_ref().map(encode_policy),
            frozen: *frozen,
        }),
    }
}

/// [`Change::name`] of a change that need not be one of ours.
pub(super) fn name_of(change: &Wire) -> &'static str {
    match change {
        Wire::Created(_) => "created",
        Wire::ClientOpened(_) => "client_opened",
        Wire::CameraSet(_) => "camera_set",
        Wire::KeyframeAdded(_) => "keyframe_added",
        Wire::LandmarksAdded(_) => "landmarks_added",
        Wire::ObservationsAdded(_) => "observations_added",
        Wire::ConstraintAdded(_) => "constraint_added",
        Wire::PriorAdded(_) => "prior_added",
        Wire::LandmarksTriangulated(_) => "landmarks_triangulated",
        Wire::SolveApplied(_) => "solve_applied",
        Wire::ObservationsRemoved(_) => "observations_removed",
        Wire::LandmarksFused(_) => "landmarks_fused",
        Wire::DuplicatesFound(_) => "duplicates_found",
        Wire::DuplicatesSplit(_) => "duplicates_split",
        Wire::PlacesSearched(_) => "places_searched",
        Wire::LandmarksRemoved(_) => "landmarks_removed",
        Wire::KeyframeRemoved(_) => "keyframe_removed",
        Wire::KeyframeRetired(_) => "keyframe_retired",
        Wire::ConstraintRevoked(_) => "constraint_revoked",
        Wire::MapMerged(_) => "map_merged",
        Wire::MapTakenOut(_) => "map_taken_out",
        Wire::ItemRepeated(_) => "item_repeated",
        Wire::PolicySet(_) => "policy_set",
        Wire::MapUpdated(_) => "map_updated",
    }
}

pub(super) fn decode_change(change: Wire) -> Decoded<Change> {
    Ok(match change {
        Wire::Created(v1::Created { policy, create_time_ns, display_name }) => {
            Change::Created { policy: decode_policy(policy)?, create_time_ns, display_name }
        }
        Wire::ClientOpened(v1::ClientOpened { name, epoch }) => {
            Change::ClientOpened { name, epoch }
        }
        Wire::CameraSet(set) => {
            let (id, camera) = decode_camera_set(set)?;
            Change::CameraSet { id, camera }
        }
        Wire::KeyframeAdded(added) => Change::KeyframeAdded {
            id: required_id(added.id, "a keyframe's id")?,
            capture_time_ns: added.capture_time_ns,
            camera: added.camera.map(decode_id),
            world_from_camera: decode_pose(added.world_from_camera, "world_from_camera")?,
            odom_from_camera: decode_pose(added.odom_from_camera, "odom_from_camera")?,
            observations: decode_observations(added.observations)?,
            landmarks: added.landmarks.into_iter().map(decode_point).collect(),
            global_descriptor: added.global_descriptor.map(decode_descriptor).transpose()?,
            motion: added
                .motion
                .map(|pose| decode_similarity(Some(pose), added.scale, "a motion"))
                .transpose()?,
        },
        Wire::LandmarksAdded(v1::LandmarksAdded { landmarks, scale }) => Change::LandmarksAdded {
            landmarks: landmarks.into_iter().map(decode_point).collect(),
            scale: decode_scale(scale),
        },
        Wire::ObservationsAdded(v1::ObservationsAdded { keyframe, observations }) => {
            Change::ObservationsAdded {
                keyframe: required_id(keyframe, "a keyframe")?,
                observations: decode_observations(observations)?,
            }
        }
        Wire::ConstraintAdded(message) => {
            let (id, constraint) = decode_constraint(message)?;
            Change::ConstraintAdded { id, constraint }
        }
        Wire::PriorAdded(message) => {
            let (id, prior) = decode_prior(message)?;
            Change::PriorAdded { id, prior }
        }
        Wire::LandmarksTriangulated(v1::LandmarksTriangulated { positions }) => {
            Change::LandmarksTriangulated { positions: decode_positions(positions)? }
        }
        Wire::SolveApplied(solve) => Change::SolveApplied { solve: decode_solve(solve)? },
        Wire::ObservationsRemoved(v1::ObservationsRemoved { observations }) => {
            let sighting = |v1::Sighting { keyframe, landmark }| {
                Ok((required_id(keyframe, "a keyframe")?, required_id(landmark, "a landmark")?))
            };
            let observations = observations.into_iter().map(sighting).collect::<Decoded<_>>()?;
            Change::ObservationsRemoved { observations }
        }
        Wire::LandmarksFused(v1::LandmarksFused { kept, absorbed }) => Change::LandmarksFused {
            kept: required_id(kept, "a landmark")?,
            absorbed: decode_ids(absorbed),
        },
        Wire::DuplicatesFound(v1::DuplicatesFound { comparisons }) => {
            let comparisons = comparisons.into_iter().map(decode_comparison);
            Change::DuplicatesFound { comparisons: comparisons.collect::<Decoded<_>>()? }
        }
        Wire::DuplicatesSplit(v1::DuplicatesSplit { closures, landmarks }) => {
            Change::DuplicatesSplit {
                closures: decode_ids(closures),
                landmarks: decode_ids(landmarks),
            }
        }
        Wire::PlacesSearched(v1::PlacesSearched { searches, closures }) => Change::PlacesSearched {
            searches: searches.into_iter().map(decode_search).collect::<Decoded<_>>()?,
            closures: closures.into_iter().map(decode_constraint).collect::<Decoded<_>>()?,
        },
        Wire::LandmarksRemoved(v1::LandmarksRemoved { landmarks }) => {
            Change::LandmarksRemoved { landmarks: decode_ids(landmarks) }
        }
        Wire::KeyframeRemoved(id) => Change::KeyframeRemoved { keyframe: decode_id(id) },
        Wire::KeyframeRetired(retired) => {
            Change::KeyframeRetired { retired: decode_retired(retired)? }
        }
        Wire::ConstraintRevoked(id) => Change::ConstraintRevoked { id: decode_id(id) },
        Wire::ItemRepeated(v1::ItemRepeated {}) => Change::ItemRepeated,
        Wire::MapMerged(merge) => Change::MapMerged { merge: Box::new(decode_merge(merge)?) },
        Wire::MapTakenOut(v1::MapTakenOut { name, clients_leave }) => {
            Change::MapTakenOut { name, clients_leave }
        }
        // Only journals of earlier versions may have it.
        Wire::PolicySet(policy) => Change::MapUpdated {
            display_name: None,
            policy: Some(decode_policy(Some(policy))?),
            frozen: None,
        },
        Wire::MapUpdated(v1::MapUpdated { display_name, policy, frozen }) => Change::MapUpdated {
            display_name,
            policy: policy.map(|policy| decode_policy(Some(policy))).transpose()?,
            frozen,
        },
    })
}

fn decode_comparison(message: v1::Comparison) -> Decoded<Comparison> {
    let v1::Comparison { closure, landmarks } = message;
    let closure = required_id(closure, "a closure")?;
    let (pairs, rest) = landmarks.as_chunks::<2>();
    if !rest.is_empty() {
        return Err(EncodingError::Invalid("a pair of landmarks"));
    }
    let pairs = pairs.iter().map(|&[a, b]| (decode_id(a), decode_id(b))).collect();
    Ok(Comparison { closure, pairs })
}

fn encode_retired(retired: &Retired) -> v1::KeyframeRetired {
    let Retired { keyframe, landmarks, revoked, constraints, priors } = retired;
    v1::KeyframeRetired {
        keyframe: Some(encode_id(*keyframe)),
        landmarks: encode_ids(landmarks),
        revoked: encode_ids(revoked),
        constraints: constraints.iter().map(|(id, c)| encode_constraint(*id, c)).collect(),
        priors: priors.iter().map(|(id, prior)| encode_prior(*id, prior)).collect(),
    }
}

fn decode_retired(message: v1::KeyframeRetired) -> Decoded<Retired> {
    let v1::KeyframeRetired { keyframe, landmarks, revoked, constraints, priors } = message;
    Ok(Retired {
        keyframe: required_id(keyframe, "a keyframe")?,
        landmarks: decode_ids(landmarks),
        revoked: decode_ids(revoked),
        constraints: constraints.into_iter().map(decode_constraint).collect::<Decoded<_>>()?,
        priors: priors.into_iter().map(decode_prior).collect::<Decoded<_>>()?,
    })
}

fn encode_positions(positions: &[(EntityId, Vector3<f64>)]) -> Vec<v1::Point> {
    let point = |&(id, position): &_| encode_point(&NewLandmark { id, position: Some(position) });
    positions.iter().map(point).collect()
}

fn decode_positions(points: Vec<v1::Point>) -> Decoded<Vec<(EntityId, Vector3<f64>)>> {
    let position = |point| {
        let NewLandmark { id, position } = decode_point(point);
        Ok((id, required(position, "a position")?))
    };
    points.into_iter().map(position).collect()
}

fn encode_solve(solve: &AppliedSolve) -> v1::SolveApplied {
    let AppliedSolve {
        kind,
        poses,
        landmarks,
        cameras,
        switched_off,
        switched_on,
        closure_variances,
        noise,
        left_frames,
        covered,
        initial_cost,
        final_cost,
        request,
    } = solve;
    let variance = |&(client, variance): &(ClientIndex, f64)| v1::ClosureVariance {
        client: client.0,
        variance: variance.to_bits(),
    };
    let left_frame = |(client, frame): &(ClientIndex, _)| v1::LeftFrame {
        client: client.0,
        map_from_odom: Some(encode_pose(frame)),
    };
    let camera = |&(id, camera): &(EntityId, _)| {
        let entity = covis_map::CameraEntity { camera, width_px: 0, height_px: 0 };
        encode_camera_set(id, &entity)
    };
    let covered_by =
        |&(client, sequence): &(ClientIndex, i64)| v1::Covered { client: client.0, sequence };
    v1::SolveApplied {
        kind: *kind as u32 + 1,
        poses: poses.iter().map(encode_new_pose).collect(),
        landmarks: encode_positions(landmarks),
        cameras: cameras.iter().map(camera).collect(),
        covered: covered.iter().map(covered_by).collect(),
        initial_cost: initial_cost.to_bits(),
        final_cost: final_cost.to_bits(),
        switched_off: switched_off.iter().map(|(id, off)| encode_switched_off(*id, off)).collect(),
        switched_on: encode_ids(switched_on),
        closure_variances: closure_variances.iter().map(variance).collect(),
        noise: noise.iter().map(|(c, noise)| encode_noise(*c, noise)).collect(),
        left_frames: left_frames.iter().map(left_frame).collect(),
        request: request.map(Vec::from).unwrap_or_default(),
    }
}

/// What asked for a solve.
pub(super) fn decode_request(id: &[u8]) -> Decoded<RequestId> {
    id.try_into().map_err(|_length| EncodingError::Invalid("what asked for a solve"))
}

fn decode_solve(solve: v1::SolveApplied) -> Decoded<AppliedSolve> {
    let kinds = [SolveKind::LocalBundle, SolveKind::PoseGraph, SolveKind::Global];
    let kind = decode_kind(&kinds, solve.kind, "a solve's kind")?;
    let camera = |set| decode_camera_set(set).map(|(id, entity)| (id, entity.camera));
    let left_frame = |v1::LeftFrame { client, map_from_odom }| {
        Ok((ClientIndex(client), decode_pose(map_from_odom, "a frame")?))
    };
    let covered = |v1::Covered { client, sequence }| (ClientIndex(client), sequence);
    Ok(AppliedSolve {
        kind,
        poses: solve.poses.into_iter().map(decode_new_pose).collect::<Decoded<_>>()?,
        landmarks: decode_positions(solve.landmarks)?,
        cameras: solve.cameras.into_iter().map(camera).collect::<Decoded<_>>()?,
        switched_off: solve
            .switched_off
            .into_iter()
            .map(decode_switched_off)
            .collect::<Decoded<_>>()?,
        switched_on: decode_ids(solve.switched_on),
        closure_variances: solve
            .closure_variances
            .into_iter()
            .map(|of| (ClientIndex(of.client), f64::from_bits(of.variance)))
            .collect(),
        noise: solve.noise.iter().map(decode_noise).collect(),
        left_frames: solve.left_frames.into_iter().map(left_frame).collect::<Decoded<_>>()?,
        covered: solve.covered.into_iter().map(covered).collect(),
        initial_cost: f64::from_bits(solve.initial_cost),
        final_cost: f64::from_bits(solve.final_cost),
        request: match &solve.request[..] {
            [] => None,
            id => Some(decode_request(id)?),
        },
    })
}
