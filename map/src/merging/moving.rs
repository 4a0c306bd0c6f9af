//! The parts of a map in another frame and unit of length.
//!
//! What clients sent stays as they sent it; all that solves estimate and factors measure moves. Which frame
//! and unit are wanted is not known here.

use covis_solvers::geometry::{LieGroup, Se3, Sim3};
use covis_solvers::information::Information;
use nalgebra::{Matrix3, SMatrix};

use super::super::scaling::{self, SCALES};
use super::super::{MapParts, Prior, frames, numbers};
use super::MergeError;

/// Moves the world frame: `motion` is the old one in the new one, and the length of the old unit in the
/// new one. Where landmarks were sent stays as it was sent; priors stay too where `keeps_priors`.
pub(super) fn move_by(
    motion: &Sim3,
    parts: &mut MapParts,
    keeps_priors: bool,
) -> Result<(), MergeError> {
    let (scale, rigid) = (motion.scale, motion.rigid());
    if scale != 1.0 {
        rescale(scale, parts, keeps_priors).ok_or(MergeError::OutOfRange)?;
    }
    for keyframe in parts.keyframes.values_mut() {
        keyframe.world_from_camera = rigid.compose(&keyframe.world_from_camera);
    }
    for landmark in parts.landmarks.values_mut() {
        landmark.position = landmark.position.map(|position| rigid.transform(&position));
    }
    if keeps_priors {
        return Ok(());
    }
    for prior in parts.priors.values_mut() {
        match prior {
            Prior::Pose { world_from_camera, .. } => {
                *world_from_camera = rigid.compose(world_from_camera);
            }
            Prior::Position { position_in_world, information, .. } => {
                *position_in_world = rigid.transform(position_in_world);
                *information = rotated(information, &rigid.rotation.matrix())?;
            }
        }
    }
    Ok(())
}

/// Changes the unit of length; `None` where numbers overflow. Priors that stay are on the Earth, in meters.
fn rescale(scale: f64, parts: &mut MapParts, keeps_priors: bool) -> Option<()> {
    for keyframe in parts.keyframes.values_mut() {
        keyframe.world_from_camera = scaling::pose(scale, &keyframe.world_from_camera);
        keyframe.odom_from_camera = scaling::pose(scale, &keyframe.odom_from_camera);
        if keyframe.observations.iter().any(|seen| seen.depth.is_some()) {
            keyframe.observations = scaling::observations(scale, &keyframe.observations)?;
        }
    }
    for landmark in parts.landmarks.values_mut() {
        landmark.position = landmark.position.map(|position| position * scale);
    }
    for constraint in parts.constraints.values_mut() {
        let measured = &mut constraint.keyframe_i_from_keyframe_j;
        *measured = scaling::pose(scale, measured);
        constraint.information = scaling::information(scale, &constraint.information)?;
    }
    for prior in parts.priors.values_mut() {
        match prior {
            Prior::Position { point_in_camera, .. } if keeps_priors => *point_in_camera *= scale,
            Prior::Pose { .. } if keeps_priors => {}
            Prior::Position { .. } | Prior::Pose { .. } => *prior = scaling::prior(scale, prior)?,
        }
    }
    for client in &mut parts.clients {
        frames::scale(&mut client.earlier_frames, scale);
    }
    Some(())
}

/// Whether every pose, position and scale is a number.
pub(super) fn is_finite(parts: &MapParts) -> bool {
    let mut poses = parts.keyframes.values().map(|keyframe| &keyframe.world_from_camera);
    let mut odometry = parts.keyframes.values().map(|keyframe| &keyframe.odom_from_camera);
    let mut measured = parts.constraints.values().map(|c| &c.keyframe_i_from_keyframe_j);
    let mut positions = parts.landmarks.values().filter_map(|landmark| landmark.position.as_ref());
    let mut merged = parts.merged.iter().map(|merged| &merged.target_from_source);
    poses.all(Se3::is_finite)
        && odometry.all(Se3::is_finite)
        && measured.all(Se3::is_finite)
        && merged.all(numbers::is_similarity)
        && parts.clients.iter().all(|client| SCALES.contains(&client.scale))
        && positions.all(numbers::is_finite)
        && parts.priors.values().all(Prior::is_possible)
}

/// Information over the axes of a frame that lies `turned` in another one, over the axes of the latter.
fn rotated(
    information: &Information<3>,
    turned: &Matrix3<f64>,
) -> Result<Information<3>, MergeError> {
    let product = turned * information.matrix() * turned.transpose();
    symmetric(&product)
}

/// Information of an error that a motion sees from its other end, r' = −Ad(Z) r with Z = `i_from_j`.
///
/// # Errors
/// [`MergeError::OutOfRange`] where numbers overflow.
pub(super) fn inverted(
    information: &Information<6>,
    i_from_j: &Se3,
) -> Result<Information<6>, MergeError> {
    let adjoint = i_from_j.inverse().adjoint();
    symmetric(&(adjoint.transpose() * information.matrix() * adjoint))
}

/// The information matrix of a product MᵀΩM: rounding alone makes it asymmetric, or indefinite where a lever
/// of kilometers stands beside a millimeter.
fn symmetric<const N: usize>(product: &SMatrix<f64, N, N>) -> Result<Information<N>, MergeError> {
    let symmetric = product * 0.5 + product.transpose() * 0.5;
    Information::nearest(&symmetric).map_err(|_overflows| MergeError::OutOfRange)
}
