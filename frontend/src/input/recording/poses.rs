//! Trajectories in recordings: the poses of one topic, for comparisons with others.
//!
//! `nav_msgs/msg/Odometry`, `geometry_msgs/msg/PoseStamped`, `PoseWithCovarianceStamped` and `TransformStamped`
//! say where a body was in the frame of their header. Covariances and twists are not read.

use std::path::Path;

use covis_solvers::geometry::{Se3, So3};
use covis_solvers::io::trajectory::Trajectory;
use nalgebra::Vector3;

use super::bag;
use super::cdr::Cdr;
use super::error::MessageError;
use super::index::Index;
use super::messages::Header;
use super::source::Files;
use super::storage::Storage;
use super::topics::{self, TopicSummary};
use crate::input::error::InputError;

/// The poses of a topic, by time; of the named one, or of the only one that has poses. Messages that cannot be
/// read, and a second one of the same time, are left out; the answer counts them.
///
/// # Errors
/// [`InputError`] where files cannot be read, or no topic or more than one has poses.
pub fn read_trajectory(
    path: &Path,
    topic: Option<&str>,
) -> Result<(Trajectory, TopicSummary, usize), InputError> {
    let (paths, _note) = bag::files(path)?;
    let mut index = Index::default();
    for (number, file) in paths.iter().enumerate() {
        Storage::open(file)?.scan(number, &mut index)?;
    }
    let (topics, _notes) = index.finish();
    let topic = topics::trajectory(path, &topics, topic)?;
    let mut files = Files::new(paths);
    let mut poses = Vec::new();
    for message in &topic.messages {
        if let Ok(read) = pose(&topic.type_name, files.read(message.place)?) {
            poses.push((message.timestamp_s, read.pose));
        }
    }
    poses.sort_by(|a, b| a.0.total_cmp(&b.0));
    poses.dedup_by(|later, first| later.0 == first.0);
    let left_out = topic.messages.len() - poses.len();
    let mut trajectory = Trajectory::default();
    poses.into_iter().for_each(|(timestamp_s, pose)| trajectory.push(timestamp_s, pose));
    Ok((trajectory, topic.summary(), left_out))
}

/// Whether messages of a type have a pose.
pub(super) fn has_pose(type_name: &str) -> bool {
    [
        "nav_msgs/msg/Odometry",
        "geometry_msgs/msg/PoseStamped",
        "geometry_msgs/msg/PoseWithCovarianceStamped",
        "geometry_msgs/msg/TransformStamped",
    ]
    .contains(&type_name)
}

/// Whether messages of a type name the body whose pose they have.
pub(super) fn names_body(type_name: &str) -> bool {
    ["nav_msgs/msg/Odometry", "geometry_msgs/msg/TransformStamped"].contains(&type_name)
}

/// The pose of a message.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct BodyPose<'a> {
    /// The frame of the body, where the message names it.
    pub(super) body: Option<&'a str>,
    /// In the frame of the header, from that of the body.
    pub(super) pose: Se3,
}

/// Reads the pose of a message.
pub(super) fn pose<'a>(type_name: &str, message: &'a [u8]) -> Result<BodyPose<'a>, MessageError> {
    let mut cdr = Cdr::new(message)?;
    Header::read(&mut cdr)?;
    let body = match names_body(type_name) {
        true => Some(cdr.text("child_frame_id")?),
        false => None,
    };
    Ok(BodyPose { body, pose: rigid(&mut cdr)? })
}

/// Reads a position and a quaternion (x, y, z, w).
pub(super) fn rigid(cdr: &mut Cdr<'_>) -> Result<Se3, MessageError> {
    let position: [f64; 3] = cdr.array("position")?;
    let [x, y, z, w] = cdr.array("orientation")?;
    let bad = |field, value| MessageError::Pose { field, value };
    if let Some(&value) = position.iter().find(|value| !value.is_finite()) {
        return Err(bad("the position", value));
    }
    // ROS asks for norm 1, and some drivers leave all of it 0.
    let rotation = So3::from_quaternion_xyzw(x, y, z, w).ok_or(bad("the orientation", w))?;
    Ok(Se3::new(rotation, Vector3::from(position)))
}

#[cfg(test)]
mod tests {
    use super::super::made;
    use super::*;

    #[test]
    fn poses_are_read_from_messages_of_four_types() {
        let values = [1.0, 2.0, 3.0, 0.0, 0.0, 1.0, 0.0];
        for (type_name, child) in [
            ("nav_msgs/msg/Odometry", Some("base")),
            ("geometry_msgs/msg/PoseStamped", None),
            ("geometry_msgs/msg/PoseWithCovarianceStamped", None),
            ("geometry_msgs/msg/TransformStamped", Some("b")),
        ] {
            assert!(has_pose(type_name));
            let message = made::pose(1.5, "odom", child, values);
            let BodyPose { body, pose: found } = pose(type_name, &message).unwrap();
            assert_eq!(body, child);
            assert_eq!(found.translation, Vector3::new(1.0, 2.0, 3.0), "{type_name}");
            assert_eq!(found.rotation.quaternion().k.abs(), 1.0, "{type_name}");
            assert!(pose(type_name, &message[..message.len() - 1]).is_err());
        }
        for bad in [[0.0; 7], [f64::NAN, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0]] {
            let message = made::pose(1.5, "odom", None, bad);
            let error = pose("geometry_msgs/msg/PoseStamped", &message).unwrap_err().to_string();
            assert!(error.contains("the position") || error.contains("the orientation"), "{error}");
        }
    }
}
