//! The record of a job, what was uploaded for it, and a solve on its way, as bytes. What the parts of a
//! record mean is known by their owner.

use covis_solvers::bundle_adjustment::Checkpoint;
use covis_solvers::optimizer::{IterationSummary, LoopState};
use nalgebra::Vector3;
use prost::Message;

use super::entities::{decode_camera_set, decode_pose, encode_camera_set, encode_pose};
use super::{EncodingError, decode, encode, v1};
use crate::job_files::{JobRecord, JobUpload};
use covis_map::{CameraEntity, ClientIndex, EntityId};

/// The bytes of a record.
pub(crate) fn encode_job(record: &JobRecord) -> Vec<u8> {
    let JobRecord { tenant, job_id, number, job, done } = record.clone();
    encode(&v1::JobRecord { tenant, job_id, number, job, done })
}

/// The record of `bytes`.
///
/// # Errors
/// [`EncodingError`] where they are no record, or one of a later version.
pub(crate) fn decode_job(bytes: &[u8]) -> Result<JobRecord, EncodingError> {
    let v1::JobRecord { tenant, job_id, number, job, done } = decode(bytes)?;
    Ok(JobRecord { tenant, job_id, number, job, done })
}

/// Tenant and name of the job in a record of any later version: its fields 1 and 2 stay that forever.
pub(crate) fn decode_later_job(bytes: &[u8]) -> Result<(String, String), EncodingError> {
    let record = v1::JobRecord::decode(bytes);
    let record = record.map_err(|error| EncodingError::Message(error.to_string()))?;
    Ok((record.tenant, record.job_id))
}

/// The bytes of an upload's description.
pub(crate) fn encode_upload(upload: &JobUpload) -> Vec<u8> {
    let JobUpload { tenant, create_time_s, files } = upload.clone();
    let files = files.into_iter().map(|(path, size_bytes)| v1::JobUploadFile { path, size_bytes });
    encode(&v1::JobUpload { tenant, create_time_s, files: files.collect() })
}

/// The description of an upload in `bytes`.
///
/// # Errors
/// As [`decode_job`].
pub(crate) fn decode_upload(bytes: &[u8]) -> Result<JobUpload, EncodingError> {
    let v1::JobUpload { tenant, create_time_s, files } = decode(bytes)?;
    let files = files.into_iter().map(|file| (file.path, file.size_bytes)).collect();
    Ok(JobUpload { tenant, create_time_s, files })
}

/// The bytes of a checkpoint.
pub(crate) fn encode_checkpoint(checkpoint: &Checkpoint) -> Vec<u8> {
    let Checkpoint { state, left_iterative, poses, landmarks, cameras } = checkpoint;
    let id = EntityId::new(ClientIndex(0), 0);
    let camera =
        |&camera: &_| encode_camera_set(id, &CameraEntity { camera, width_px: 0, height_px: 0 });
    encode(&v1::BundleCheckpoint {
        initial_cost: state.initial_cost.to_bits(),
        cost: state.cost.to_bits(),
        damping: state.damping.to_bits(),
        damping_growth: state.damping_growth.to_bits(),
        stiffness: state.stiffness.map(f64::to_bits),
        is_approaching: state.is_approaching,
        linear_residual: state.linear_residual.to_bits(),
        rows: state.rows.iter().map(encode_row).collect(),
        poses: poses.iter().map(encode_pose).collect(),
        landmarks: landmarks.iter().flat_map(|p| [p.x, p.y, p.z].map(f64::to_bits)).collect(),
        cameras: cameras.iter().map(camera).collect(),
        left_iterative: *left_iterative,
    })
}

/// The checkpoint in `bytes`.
///
/// # Errors
/// As [`decode_job`].
pub(crate) fn decode_checkpoint(bytes: &[u8]) -> Result<Checkpoint, EncodingError> {
    let message: v1::BundleCheckpoint = decode(bytes)?;
    let state = LoopState {
        initial_cost: f64::from_bits(message.initial_cost),
        cost: f64::from_bits(message.cost),
        damping: f64::from_bits(message.damping),
        damping_growth: f64::from_bits(message.damping_growth),
        stiffness: message.stiffness.map(f64::from_bits),
        is_approaching: message.is_approaching,
        linear_residual: f64::from_bits(message.linear_residual),
        rows: message.rows.iter().map(decode_row).collect(),
    };
    let poses = message.poses.into_iter().map(|pose| decode_pose(Some(pose), "a pose"));
    let (points, []) = message.landmarks.as_chunks::<3>() else {
        return Err(EncodingError::Invalid("landmarks of a checkpoint"));
    };
    let cameras = message.cameras.into_iter().map(|set| Ok(decode_camera_set(set)?.1.camera));
    Ok(Checkpoint {
        state,
        left_iterative: message.left_iterative,
        poses: poses.collect::<Result<_, EncodingError>>()?,
        landmarks: points.iter().map(|p| Vector3::from(p.map(f64::from_bits))).collect(),
        cameras: cameras.collect::<Result<_, EncodingError>>()?,
    })
}

fn encode_row(row: &IterationSummary) -> v1::CheckpointRow {
    v1::CheckpointRow {
        iteration: row.iteration as u64,
        cost: row.cost.to_bits(),
        seconds: row.seconds.to_bits(),
        accepted: row.accepted,
        damping: row.damping.to_bits(),
        gradient_max_norm: row.gradient_max_norm.to_bits(),
        step_norm: row.step_norm.to_bits(),
        step_quality: row.step_quality.to_bits(),
    }
}

fn decode_row(row: &v1::CheckpointRow) -> IterationSummary {
    IterationSummary {
        iteration: usize::try_from(row.iteration).unwrap_or(usize::MAX),
        cost: f64::from_bits(row.cost),
        seconds: f64::from_bits(row.seconds),
        accepted: row.accepted,
        damping: f64::from_bits(row.damping),
        gradient_max_norm: f64::from_bits(row.gradient_max_norm),
        step_norm: f64::from_bits(row.step_norm),
        step_quality: f64::from_bits(row.step_quality),
    }
}

#[cfg(test)]
mod tests {
    use covis_solvers::geometry::{LieGroup, Se3, Snavely};

    use super::*;

    #[test]
    fn a_checkpoint_comes_back_bit_for_bit() {
        let state = LoopState {
            initial_cost: 7.0,
            cost: 0.1,
            damping: 1e-9,
            damping_growth: 2.0,
            stiffness: None,
            is_approaching: true,
            linear_residual: 1e-12,
            rows: Vec::new(),
        };
        for left_iterative in [false, true] {
            let checkpoint = Checkpoint {
                state: state.clone(),
                left_iterative,
                poses: vec![Se3::identity()],
                landmarks: vec![Vector3::new(0.1, -0.2, 0.3)],
                cameras: vec![Snavely { focal: 500.0, k1: 0.1, k2: 0.0 }.into()],
            };
            assert_eq!(decode_checkpoint(&encode_checkpoint(&checkpoint)).unwrap(), checkpoint);
        }
    }
}
