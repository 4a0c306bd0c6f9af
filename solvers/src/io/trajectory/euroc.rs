//! EuRoC's (ASL's) ground truth: a table `timestamp [ns], p_x, p_y, p_z, q_w, q_x, q_y, q_z, …`.
//!
//! Poses are world_from_body; in EuRoC's own files the body is the IMU, not a camera. Columns after the
//! eighth (velocity, biases) are not read. Times become seconds, which hold nanoseconds of this century
//! to 120 ns; times of EuRoC's files, which are multiples of 256 ns, come back as they were.

use std::path::Path;

use nalgebra::Vector3;

use super::super::text::{Text, TextWriter};
use super::super::{IoError, rotation};
use super::Trajectory;
use crate::geometry::Se3;

const HEAD: &str = "#timestamp [ns],p_x [m],p_y [m],p_z [m],q_w [],q_x [],q_y [],q_z []\n";
const NANOSECONDS: f64 = 1e9;

pub(super) fn parse(bytes: &[u8], path: &Path) -> Result<Trajectory, IoError> {
    let mut text = Text::new(bytes, path);
    let mut trajectory = Trajectory::default();
    while let Some(line) = text.record() {
        let mut line = line.cells();
        let timestamp = line.number("timestamp")? / NANOSECONDS;
        let [x, y, z] = line.numbers("position")?;
        let [qw, qx, qy, qz] = line.numbers("quaternion")?;
        let rotation = rotation::from_xyzw(&[qx, qy, qz, qw], || line.location())?;
        trajectory.push(timestamp, Se3::new(rotation, Vector3::new(x, y, z)));
    }
    Ok(trajectory)
}

/// The whole number of nanoseconds that reads back as this time, where there is one, else the nearest.
fn nearest_ns(seconds: f64) -> f64 {
    let near = (seconds * NANOSECONDS).round();
    // The product may be off by its last bit.
    let above = near.next_up().max(near + 1.0);
    let below = near.next_down().min(near - 1.0);
    let all = [near, above, below].into_iter();
    all.map(f64::round).find(|ns| ns / NANOSECONDS == seconds).unwrap_or(near)
}

/// # Errors
/// [`IoError::UnwritableText`] where a time has no 64-bit number of nanoseconds.
pub(super) fn to_bytes(trajectory: &Trajectory) -> Result<Vec<u8>, IoError> {
    let mut text = TextWriter::default();
    text.put(HEAD);
    let poses = trajectory.timestamps.iter().zip(&trajectory.world_from_body);
    for (k, (timestamp, pose)) in poses.enumerate() {
        let nanoseconds = nearest_ns(*timestamp);
        // Above this bound a cast would saturate.
        if !nanoseconds.is_finite() || nanoseconds.abs() >= 9.2e18 {
            let reason = "its time is no 64-bit number of nanoseconds, which EuRoC's files have";
            return Err(IoError::UnwritableText { field: "pose", id: k as u64, reason });
        }
        let [qx, qy, qz, qw] = rotation::to_xyzw(&pose.rotation);
        text.put(nanoseconds as i64);
        for number in pose.translation.iter().chain(&[qw, qx, qy, qz]) {
            text.put(format_args!(",{number:?}"));
        }
        text.end_line();
    }
    Ok(text.into_bytes())
}
