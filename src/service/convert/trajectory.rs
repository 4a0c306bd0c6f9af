//! Trajectories that clients send: poses with their times. Checks each pose; compares nothing.

use covis_solvers::geometry::Se3;

use super::geometry::rigid_transform;
use super::time::nanoseconds;
use super::{Path, Violations, all};
use crate::wire::v1;

/// Poses with the times at which they were, nanoseconds.
pub(in crate::service) fn poses(
    at: Path<'_>,
    poses: &[v1::KeyframePose],
    out: &mut Violations,
) -> Option<Vec<(i64, Se3)>> {
    all(at, poses, out, |at, pose, out| {
        let time = nanoseconds(at.field("capture_time"), pose.capture_time.as_ref(), out);
        let pose = pose.world_from_camera.as_ref();
        let pose = rigid_transform(at.field("world_from_camera"), pose, out);
        Some((time?, pose?))
    })
}
