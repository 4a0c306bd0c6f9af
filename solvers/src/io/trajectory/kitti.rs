//! KITTI's odometry poses: a line a pose, the twelve numbers of [R | t] row by row, meters.
//!
//! Poses are world_from_camera of the left camera, z forward and y down as in covis. The file holds no
//! times, they are in a file beside it: what is read here has the numbers of its rows, from 0.

use std::path::Path;

use super::super::text::{Line, Text, TextWriter};
use super::super::{IoError, pose_matrix};
use super::{Trajectory, columns};
use crate::geometry::Se3;

pub(super) fn parse(bytes: &[u8], path: &Path) -> Result<Trajectory, IoError> {
    let mut text = Text::new(bytes, path);
    let mut trajectory = Trajectory::default();
    while let Some(line) = text.record() {
        let world_from_camera = pose(line);
        let world_from_camera =
            world_from_camera.map_err(|error| columns::not_kitti(line).unwrap_or(error))?;
        trajectory.push(trajectory.len() as f64, world_from_camera);
    }
    Ok(trajectory)
}

fn pose(mut line: Line<'_>) -> Result<Se3, IoError> {
    let row = [line.numbers("row 0")?, line.numbers("row 1")?, line.numbers("row 2")?];
    let world_from_camera = pose_matrix::rigid(row, || line.location())?;
    line.end()?;
    Ok(world_from_camera)
}

pub(super) fn to_bytes(trajectory: &Trajectory) -> Vec<u8> {
    let mut text = TextWriter::default();
    for pose in &trajectory.world_from_body {
        for (k, number) in pose_matrix::rows(pose).iter().flatten().enumerate() {
            let separator = if k == 0 { "" } else { " " };
            text.put(format_args!("{separator}{number:?}"));
        }
        text.end_line();
    }
    text.into_bytes()
}

/// Reads the times of a KITTI sequence: one number of seconds a line.
///
/// # Errors
/// [`IoError::Read`], and the first line that is not one finite number.
pub fn read_times(path: &Path) -> Result<Vec<f64>, IoError> {
    let bytes = super::super::files::read(path)?;
    let mut text = Text::new(&bytes, path);
    let mut times = Vec::new();
    while let Some(mut line) = text.record() {
        times.push(line.number("time")?);
        line.end()?;
    }
    Ok(times)
}
