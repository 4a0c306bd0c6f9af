//! Static transforms of a recording: how the frames of a robot lie to each other, by the messages
//! `tf2_msgs/msg/TFMessage` of its topics `tf_static`.
//!
//! Frames form a tree: each has one parent, and the last message counts. Transforms that change with time
//! (`/tf`) are not read.

use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;

use covis_solvers::geometry::{LieGroup, Se3};

use super::cdr::Cdr;
use super::error::{MessageError, RecordingError};
use super::index::Topic;
use super::messages::{Header, Kind};
use super::poses;
use super::source::Files;

/// The tree of the frames that do not move to each other.
#[derive(Clone, Debug, Default)]
pub(super) struct Transforms {
    /// Of each frame its parent and parent_from_frame.
    parents: BTreeMap<String, (String, Se3)>,
}

impl Transforms {
    /// Reads all static transforms.
    pub(super) fn read(
        path: &Path,
        files: &mut Files,
        topics: &[Topic],
    ) -> Result<Self, RecordingError> {
        let mut transforms = Self::default();
        for topic in topics.iter().filter(|topic| topic.kind == Kind::StaticTransforms) {
            for message in &topic.messages {
                let added = transforms.add(files.read(message.place)?);
                added.map_err(|source| RecordingError::Message {
                    path: path.to_owned(),
                    topic: topic.name.clone(),
                    source,
                })?;
            }
        }
        Ok(transforms)
    }

    /// Adds the transforms of a message.
    pub(super) fn add(&mut self, message: &[u8]) -> Result<(), MessageError> {
        let mut cdr = Cdr::new(message)?;
        for _ in 0..cdr.u32("transforms")? {
            let parent = Header::read(&mut cdr)?.frame_id.to_owned();
            let child = cdr.text("child_frame_id")?.to_owned();
            self.parents.insert(child, (parent, poses::rigid(&mut cdr)?));
        }
        Ok(())
    }

    /// The frame at the top of a frame's chain, and top_from_frame.
    fn top<'a>(&'a self, frame: &'a str) -> (&'a str, Se3) {
        let (mut top, mut top_from_frame) = (frame, Se3::identity());
        // A chain that returns to itself has no top; it is followed once.
        for _ in 0..self.parents.len() {
            let Some((parent, parent_from_top)) = self.parents.get(top) else { break };
            (top, top_from_frame) = (parent, parent_from_top.compose(&top_from_frame));
        }
        (top, top_from_frame)
    }

    /// a_from_b, where static transforms join these frames. A frame needs none to itself.
    pub(super) fn between(&self, a: &str, b: &str) -> Option<Se3> {
        if a == b {
            return Some(Se3::identity());
        }
        let ((top_of_a, top_from_a), (top_of_b, top_from_b)) = (self.top(a), self.top(b));
        (top_of_a == top_of_b).then(|| top_from_a.inverse().compose(&top_from_b))
    }

    /// The names of all frames.
    pub(super) fn frames(&self) -> Vec<String> {
        let names = self.parents.iter().flat_map(|(child, (parent, _))| [child, parent]);
        names.collect::<BTreeSet<_>>().into_iter().cloned().collect()
    }
}

#[cfg(test)]
mod tests {
    use covis_solvers::geometry::So3;
    use nalgebra::Vector3;

    use super::super::made;
    use super::*;

    fn transforms(parts: &[(&str, &str, [f64; 7])]) -> Transforms {
        let mut transforms = Transforms::default();
        transforms.add(&made::transforms(parts)).unwrap();
        transforms
    }

    #[test]
    fn frames_are_joined_through_their_common_parent() {
        let half = std::f64::consts::FRAC_1_SQRT_2;
        let found = transforms(&[
            ("base", "mast", [0.0, 0.0, 1.0, 0.0, 0.0, half, half]),
            ("mast", "camera", [0.5, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0]),
            ("base", "wheel", [0.0, 0.25, 0.0, 0.0, 0.0, 0.0, 1.0]),
        ]);
        let wheel_from_camera = found.between("wheel", "camera").unwrap();
        let turn = So3::exp(&Vector3::new(0.0, 0.0, std::f64::consts::FRAC_PI_2));
        let expected = Se3::new(turn, Vector3::new(0.0, 0.25, 1.0));
        assert!(wheel_from_camera.inverse().compose(&expected).log().norm() < 1e-15);
        let back = found.between("camera", "wheel").unwrap();
        assert!(back.compose(&wheel_from_camera).log().norm() < 1e-15);
        assert!(found.between("lidar", "camera").is_none());
        assert_eq!(found.between("lidar", "lidar"), Some(Se3::identity()));
        assert_eq!(found.frames(), ["base", "camera", "mast", "wheel"]);
    }

    #[test]
    fn a_chain_that_returns_to_itself_ends() {
        let none = [0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0];
        let found = transforms(&[("a", "b", none), ("b", "a", none)]);
        assert!(found.between("a", "elsewhere").is_none());
    }

    #[test]
    fn transforms_that_are_none_are_refused() {
        let mut transforms = Transforms::default();
        let message = made::transforms(&[("a", "b", [0.0; 7])]);
        assert!(matches!(transforms.add(&message), Err(MessageError::Pose { .. })));
        let many = [&[0, 1, 0, 0][..], &u32::MAX.to_le_bytes()].concat();
        assert!(matches!(transforms.add(&many), Err(MessageError::Short { .. })));
    }
}
