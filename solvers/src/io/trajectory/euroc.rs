//! EuRoC's (ASL's) ground truth: a table `timestamp [ns], p_x, p_y, p_z, q_w, q_x, q_y, q_z, …`.
//!
//! Poses are world_from_body; in EuRoC's own files the body is the IMU, not a camera. Columns after the
//! eighth (velocity, biases) are not read. Times become seconds, whose spacing is 238 ns from 2004 to
//! 2038. Times of EuRoC's files, which are multiples of 256 ns, come back as they were; others come back
//! within 240 ns.

use std::path::Path;

use nalgebra::Vector3;

use super::super::text::{Text, TextWriter};
use super::super::{IoError, rotation};
use super::{Trajectory, TrajectoryFormat, columns, nanoseconds_of_seconds};
use crate::geometry::Se3;

const HEAD: &str = "#timestamp [ns],p_x [m],p_y [m],p_z [m],q_w [],q_x [],q_y [],q_z []\n";
const NANOSECONDS: f64 = 1e9;
/// Times of EuRoC's own files are multiples of this.
const STEP_NS: i64 = 256;

pub(super) fn parse(bytes: &[u8], path: &Path) -> Result<Trajectory, IoError> {
    columns::check_order(bytes, path, TrajectoryFormat::Euroc)?;
    let mut text = Text::new(bytes, path);
    let mut trajectory = Trajectory::default();
    while let Some(line) = text.record() {
        let mut line = line.separated(true);
        let nanoseconds = line.number("timestamp")?;
        columns::check_nanoseconds(nanoseconds, &line)?;
        let timestamp = nanoseconds / NANOSECONDS;
        let [x, y, z] = line.numbers("position")?;
        let [qw, qx, qy, qz] = line.numbers("quaternion")?;
        let rotation = rotation::from_xyzw(&[qx, qy, qz, qw], || line.location())?;
        trajectory.push(timestamp, Se3::new(rotation, Vector3::new(x, y, z)));
    }
    Ok(trajectory)
}

/// The multiple of 256 ns that reads back as this time, where there is one, else the nearest whole
/// nanoseconds; `None` where these have no 64 bits.
fn nearest_ns(seconds: f64) -> Option<i64> {
    let nearest = nanoseconds_of_seconds(seconds)?;
    let multiple = nearest.saturating_add(STEP_NS / 2).div_euclid(STEP_NS) * STEP_NS;
    let is_same = multiple as f64 / NANOSECONDS == seconds;
    Some(if is_same { multiple } else { nearest })
}

/// # Errors
/// [`IoError::UnwritableText`] where a time has no 64-bit number of nanoseconds.
pub(super) fn to_bytes(trajectory: &Trajectory) -> Result<Vec<u8>, IoError> {
    let mut text = TextWriter::default();
    text.put(HEAD);
    let poses = trajectory.timestamps.iter().zip(&trajectory.world_from_body);
    for (k, (timestamp, pose)) in poses.enumerate() {
        let Some(nanoseconds) = nearest_ns(*timestamp) else {
            let reason = "its time does not fit the 64-bit nanoseconds of EuRoC's files";
            return Err(IoError::UnwritableText { field: "pose", id: k as u64, reason });
        };
        let [qx, qy, qz, qw] = rotation::to_xyzw(&pose.rotation);
        text.put(nanoseconds);
        for number in pose.translation.iter().chain(&[qw, qx, qy, qz]) {
            text.put(format_args!(",{number:?}"));
        }
        text.end_line();
    }
    Ok(text.into_bytes())
}
