//! Interpolates the poses of a trajectory at any time.
//!
//! Plain functions, independent of frames and volumes.

use covis_solvers::geometry::{LieGroup, Se3};
use covis_solvers::io::trajectory::Trajectory;

/// Poses in the order of their times.
#[derive(Clone, Debug, Default)]
pub struct PoseTrack {
    poses: Vec<(f64, Se3)>,
}

impl PoseTrack {
    /// The poses of a trajectory, in any order; of two with the same time the first is kept.
    #[must_use]
    pub fn new(trajectory: &Trajectory) -> Self {
        let times = trajectory.timestamps.iter().copied();
        let mut poses: Vec<_> = times.zip(trajectory.world_from_body.iter().copied()).collect();
        poses.sort_by(|a, b| a.0.total_cmp(&b.0));
        poses.dedup_by(|later, first| later.0 == first.0);
        Self { poses }
    }

    /// The pose at a time, on the geodesic between those before and after; `None` where no pose is
    /// within `reach_s` seconds. Before the first and after the last pose, that pose is returned.
    #[must_use]
    pub fn at(&self, time_s: f64, reach_s: f64) -> Option<Se3> {
        let after = self.poses.partition_point(|&(time, _)| time < time_s);
        let next = self.poses.get(after);
        let before = after.checked_sub(1).and_then(|before| self.poses.get(before));
        let is_near = |pose: &&(f64, Se3)| (pose.0 - time_s).abs() <= reach_s;
        next.into_iter().chain(before).find(is_near)?;
        match (before, next) {
            (Some((t0, a)), Some((t1, b))) => {
                let step = a.inverse().compose(b).log();
                Some(a.compose(&Se3::exp(&(step * ((time_s - t0) / (t1 - t0))))))
            }
            (Some((_, only)), None) | (None, Some((_, only))) => Some(*only),
            (None, None) => None,
        }
    }
}

#[cfg(test)]
mod tests {
    use covis_solvers::geometry::So3;
    use nalgebra::Vector3;

    use super::*;

    fn track() -> PoseTrack {
        let mut trajectory = Trajectory::default();
        let turn = So3::exp(&Vector3::new(0.0, 0.0, 0.2));
        trajectory.push(1.03, Se3::new(turn, Vector3::new(3.0, 0.0, 0.0)));
        trajectory.push(1.0, Se3::identity());
        trajectory.push(2.0, Se3::identity());
        PoseTrack::new(&trajectory)
    }

    #[test]
    fn between_two_poses_the_camera_goes_evenly() {
        let pose = track().at(1.01, 0.02).unwrap();
        assert!((pose.rotation.log() - Vector3::new(0.0, 0.0, 0.2 / 3.0)).norm() < 1e-12);
        // A third of the way on the screw motion between the two poses.
        assert!((pose.translation.norm() - 1.0).abs() < 0.01, "{}", pose.translation);
        assert_eq!(track().at(1.0, 0.02), Some(Se3::identity()));
    }

    #[test]
    fn without_a_pose_in_reach_there_is_none() {
        for (time, is_there) in [
            (0.979, false),
            (0.981, true),
            (1.051, false),
            (1.5, false),
            (2.019, true),
            (2.03, false),
        ] {
            assert_eq!(track().at(time, 0.02).is_some(), is_there, "{time}");
        }
        assert_eq!(PoseTrack::default().at(1.0, 1.0), None);
    }
}
