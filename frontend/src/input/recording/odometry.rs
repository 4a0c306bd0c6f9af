//! Odometry of a recording: where the camera was, by the poses of another body of the same robot.
//!
//! A message has odom_from_body; static transforms have body_from_camera. Between two messages the body moves
//! with a constant twist, T(s) = T₀ · Exp(s · Log(T₀⁻¹ · T₁)), which is the same motion in either frame.
//! Covariances of messages are not read: drivers leave them 0 or constant, and the server finds the noise of
//! odometry itself.

use std::path::Path;

use covis_solvers::geometry::{LieGroup, Se3};

use super::error::RecordingError;
use super::index::Topic;
use super::note::Note;
use super::poses;
use super::source::Files;
use super::transforms::Transforms;

/// Periods between two messages over which odometry is interpolated: a few messages may be missing.
const MOST_PERIODS: f64 = 5.0;

/// The camera's poses by odometry.
#[derive(Clone, Debug)]
pub(super) struct Odometry {
    /// Increasing.
    times_s: Vec<f64>,
    /// One a time.
    odom_from_camera: Vec<Se3>,
    /// The median time between two messages.
    period_s: f64,
}

impl Odometry {
    /// Reads a topic for the camera whose images have this frame. Messages that are no poses, that are of
    /// another body than the first, or that repeat a time are left out and noted.
    pub(super) fn read(
        path: &Path,
        files: &mut Files,
        topics: &[Topic],
        topic: &Topic,
        camera_frame: &str,
        notes: &mut Vec<Note>,
    ) -> Result<Self, RecordingError> {
        let transforms = Transforms::read(path, files, topics)?;
        let mut first_body: Option<String> = None;
        let mut poses = Vec::new();
        for message in &topic.messages {
            let Ok(read) = poses::pose(&topic.type_name, files.read(message.place)?) else {
                continue;
            };
            let body = read.body.unwrap_or_default();
            if first_body.get_or_insert_with(|| body.to_owned()) == body {
                poses.push((message.timestamp_s, read.pose));
            }
        }
        poses.sort_by(|a, b| a.0.total_cmp(&b.0));
        poses.dedup_by(|later, first| later.0 == first.0);
        let left_out = topic.messages.len() - poses.len();
        if left_out > 0 {
            notes.push(Note::NoPoses { topic: topic.name.clone(), messages: left_out });
        }
        let body = first_body.unwrap_or_default();
        let Some(body_from_camera) = transforms.between(&body, camera_frame) else {
            return Err(RecordingError::NoTransform {
                path: path.to_owned(),
                body,
                camera: camera_frame.to_owned(),
                frames: transforms.frames(),
            });
        };
        Self::new(poses.into_iter().map(|(time_s, pose)| (time_s, pose.compose(&body_from_camera))))
            .ok_or_else(|| RecordingError::NoOdometry {
                path: path.to_owned(),
                topic: topic.name.clone(),
            })
    }

    /// Of poses by increasing time; `None` of fewer than two.
    fn new(poses: impl Iterator<Item = (f64, Se3)>) -> Option<Self> {
        let (times_s, odom_from_camera): (Vec<f64>, Vec<Se3>) = poses.unzip();
        let mut periods: Vec<f64> = times_s.windows(2).map(|pair| pair[1] - pair[0]).collect();
        periods.sort_unstable_by(f64::total_cmp);
        let period_s = *periods.get(periods.len() / 2)?;
        Some(Self { times_s, odom_from_camera, period_s })
    }

    /// odom_from_camera at a time; `None` where the messages around it are too far apart, or where it is more
    /// than a period before the first or after the last.
    pub(super) fn at(&self, timestamp_s: f64) -> Option<Se3> {
        let after = self.times_s.partition_point(|time_s| *time_s < timestamp_s);
        let after = after.clamp(1, self.times_s.len() - 1);
        let (from_s, to_s) = (self.times_s[after - 1], self.times_s[after]);
        let outside_s = (from_s - timestamp_s).max(timestamp_s - to_s);
        let is_near = outside_s <= self.period_s && to_s - from_s <= MOST_PERIODS * self.period_s;
        is_near.then(|| {
            let (from, to) = (&self.odom_from_camera[after - 1], &self.odom_from_camera[after]);
            let share = (timestamp_s - from_s) / (to_s - from_s);
            from.compose(&Se3::exp(&(from.inverse().compose(to).log() * share)))
        })
    }
}

#[cfg(test)]
mod tests {
    use nalgebra::Vector6;

    use super::*;

    /// A body with a constant twist.
    fn moved(time_s: f64) -> Se3 {
        Se3::exp(&(Vector6::new(0.3, -0.2, 0.1, 0.1, 0.4, -0.3) * time_s))
    }

    fn odometry(times_s: &[f64]) -> Odometry {
        Odometry::new(times_s.iter().map(|&time_s| (time_s, moved(time_s)))).unwrap()
    }

    #[test]
    fn a_pose_between_messages_is_that_of_a_constant_twist() {
        let odometry = odometry(&[10.0, 10.1, 10.2, 10.3]);
        for time_s in [9.9, 9.97, 10.0, 10.04, 10.1, 10.25, 10.3, 10.39] {
            let found = odometry.at(time_s).unwrap();
            assert!(found.inverse().compose(&moved(time_s)).log().norm() < 1e-12, "{time_s}");
        }
    }

    #[test]
    fn no_pose_is_made_up_far_from_messages() {
        let odometry = odometry(&[10.0, 10.1, 10.2, 10.3, 10.6, 12.0, 12.1]);
        assert!(odometry.at(10.45).is_some(), "two messages are missing");
        for time_s in [9.8, 11.0, 11.95, 12.3, f64::NAN] {
            assert!(odometry.at(time_s).is_none(), "{time_s}");
        }
        assert!(Odometry::new(std::iter::once((1.0, moved(1.0)))).is_none());
    }
}
