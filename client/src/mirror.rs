//! A copy of a map on the client's side, which deltas keep up to date.
//!
//! Entities come whole, so applying a delta is overwriting; a reset drops all there was. The parts
//! of a delta are applied together or not at all (docs/wire.md, "Watching a map"). Knows no network:
//! `watch` brings the deltas.

use std::collections::BTreeMap;

use super::ClientError;
use crate::wire::v1;
use v1::constraint::Constraint as Kind;

/// An entity's owner and id.
pub type Key = (String, i64);

/// The map as of one revision.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct MapMirror {
    /// The map's uid; empty before the first delta.
    pub uid: String,
    /// The revision that the mirror holds.
    pub revision: i64,
    /// A `MapState`.
    pub state: i32,
    /// What the server still did to the map by itself when it sent the last delta; absent from an earlier
    /// server.
    pub pending_work: Option<v1::PendingWork>,
    /// Cameras by owner and id.
    pub cameras: BTreeMap<Key, v1::Camera>,
    /// Rigs by owner and id.
    pub rigs: BTreeMap<Key, v1::Rig>,
    /// Keyframe poses by owner and id.
    pub keyframes: BTreeMap<Key, v1::KeyframePose>,
    /// Landmarks by owner and id.
    pub landmarks: BTreeMap<Key, v1::Landmark>,
    /// Constraints by owner and id.
    pub constraints: BTreeMap<Key, v1::Constraint>,
    /// Odometry frames by client.
    pub client_frames: BTreeMap<String, v1::ClientFrame>,
}

/// What a delta changed, by owner and id, in the order of its parts.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct MapChanges {
    /// Whether the delta began anew: what it does not name is gone.
    pub reset: bool,
    /// Keyframes that are new, moved or gone; the mirror does not have those that are gone.
    pub keyframes: Vec<Key>,
    /// The same of landmarks.
    pub landmarks: Vec<Key>,
    /// The same of constraints and priors.
    pub constraints: Vec<Key>,
}

impl MapMirror {
    /// Where a client's odometry frame lies in the map, in the client's unit of length; absent where the
    /// client has no keyframe. With it the client makes its start estimates, in whatever unit the map is:
    /// `world_from_camera` = `map_from_odom` · `odom_from_camera`.
    pub fn map_from_odom(&self, client_id: &str) -> Option<&v1::RigidTransform> {
        self.client_frames.get(client_id)?.map_from_odom.as_ref()
    }

    /// The length in the map of a client's unit of length: 1, unless its map was made without measured
    /// lengths and became part of another one. What a client sends is in its own unit; lengths that the
    /// mirror holds are in the map's, and the client divides them by this.
    pub fn scale(&self, client_id: &str) -> f64 {
        // An earlier server sends none.
        let sent = self.client_frames.get(client_id).map(|frame| frame.scale);
        sent.filter(|&scale| scale > 0.0).unwrap_or(1.0)
    }

    /// Applies a whole delta, given as all its parts in order, and tells what it changed.
    ///
    /// # Errors
    /// [`ClientError::Protocol`] when the parts do not belong together or the delta starts from
    /// another revision than the mirror's; the mirror is then unchanged.
    pub fn apply(&mut self, parts: Vec<v1::MapDelta>) -> Result<MapChanges, ClientError> {
        let protocol = |what| Err(ClientError::Protocol { rpc: "WatchMap", what });
        let Some(first) = parts.first() else { return protocol("a delta without parts") };
        let (revision, reset, base) = (first.revision, first.reset, first.base_revision);
        let last = parts.len() - 1;
        let fits = |(index, part): (usize, &v1::MapDelta)| {
            part.revision == revision
                && usize::try_from(part.part_index) == Ok(index)
                && part.last_part == (index == last)
        };
        if !parts.iter().enumerate().all(fits) {
            return protocol("the parts of a delta do not belong together");
        }
        if !reset && (base != self.revision || revision < base) {
            return protocol("a delta does not start from the revision before it");
        }
        if reset {
            *self = Self::default();
        }
        let mut changes = MapChanges { reset, ..MapChanges::default() };
        for part in parts {
            self.apply_part(part, &mut changes);
        }
        self.revision = revision;
        Ok(changes)
    }

    fn apply_part(&mut self, part: v1::MapDelta, changes: &mut MapChanges) {
        self.state = part.state;
        self.uid = part.map_uid;
        self.pending_work = part.pending_work;
        let key = |client_id: &str, id: i64| (client_id.to_owned(), id);
        for camera in part.cameras {
            self.cameras.insert(key(&camera.client_id, camera.id), camera);
        }
        for rig in part.rigs {
            self.rigs.insert(key(&rig.client_id, rig.id), rig);
        }
        for pose in part.keyframes {
            let Some(keyframe) = &pose.keyframe else { continue };
            let named = key(&keyframe.client_id, keyframe.id);
            changes.keyframes.push(named.clone());
            self.keyframes.insert(named, pose);
        }
        for landmark in part.landmarks {
            let named = key(&landmark.client_id, landmark.id);
            changes.landmarks.push(named.clone());
            self.landmarks.insert(named, landmark);
        }
        for constraint in part.constraints {
            let named = match &constraint.constraint {
                Some(Kind::RelativePose(c)) => key(&c.client_id, c.id),
                Some(Kind::PositionPrior(c)) => key(&c.client_id, c.id),
                Some(Kind::PosePrior(c)) => key(&c.client_id, c.id),
                // A kind that this client does not know.
                None => continue,
            };
            changes.constraints.push(named.clone());
            self.constraints.insert(named, constraint);
        }
        for frame in part.client_frames {
            if frame.keyframe.is_some() {
                self.client_frames.insert(frame.client_id.clone(), frame);
            } else {
                self.client_frames.remove(&frame.client_id);
            }
        }
        for gone in part.removed_keyframes {
            let named = (gone.client_id, gone.id);
            self.keyframes.remove(&named);
            changes.keyframes.push(named);
        }
        for gone in part.removed_landmarks {
            let named = (gone.client_id, gone.id);
            self.landmarks.remove(&named);
            changes.landmarks.push(named);
        }
        for gone in part.removed_constraints {
            let named = (gone.client_id, gone.id);
            self.constraints.remove(&named);
            changes.constraints.push(named);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn landmark(id: i64, observation_count: i64) -> v1::Landmark {
        v1::Landmark { client_id: "a".into(), id, observation_count, ..v1::Landmark::default() }
    }

    fn part(base: i64, revision: i64, index: i32, last: bool) -> v1::MapDelta {
        v1::MapDelta {
            base_revision: base,
            revision,
            part_index: index,
            last_part: last,
            map_uid: "u".into(),
            ..v1::MapDelta::default()
        }
    }

    #[test]
    fn deltas_overwrite_remove_and_reset() {
        let mut mirror = MapMirror::default();
        let mut start = part(0, 3, 0, false);
        start.reset = true;
        start.landmarks = vec![landmark(1, 1)];
        let mut rest = part(0, 3, 1, true);
        rest.reset = true;
        rest.landmarks = vec![landmark(2, 1)];
        mirror.apply(vec![start, rest]).unwrap();
        assert_eq!((mirror.revision, mirror.landmarks.len(), mirror.uid.as_str()), (3, 2, "u"));

        let mut delta = part(3, 5, 0, true);
        delta.landmarks = vec![landmark(1, 4)];
        delta.removed_landmarks = vec![v1::LandmarkRef { client_id: "a".into(), id: 2 }];
        let changes = mirror.apply(vec![delta]).unwrap();
        let named = [1, 2].map(|id| ("a".to_owned(), id)).to_vec();
        assert_eq!(changes, MapChanges { landmarks: named, ..MapChanges::default() });
        let counts: Vec<i64> = mirror.landmarks.values().map(|l| l.observation_count).collect();
        assert_eq!((mirror.revision, counts), (5, vec![4]));

        let mut reset = part(0, 9, 0, true);
        reset.reset = true;
        assert!(mirror.apply(vec![reset]).unwrap().reset);
        assert_eq!((mirror.revision, mirror.landmarks.len()), (9, 0));
    }

    #[test]
    fn a_client_of_a_server_that_knows_no_scales_has_the_unit_of_the_map() {
        let mut mirror = MapMirror::default();
        let mut start = part(0, 3, 0, true);
        start.reset = true;
        let frame = |client: &str, scale| v1::ClientFrame {
            client_id: client.into(),
            scale,
            // Without one it is removed.
            keyframe: Some(v1::KeyframeRef::default()),
            ..v1::ClientFrame::default()
        };
        start.client_frames = vec![frame("old", 0.0), frame("scaled", 2.5)];
        mirror.apply(vec![start]).unwrap();
        let scales = ["old", "scaled", "none"].map(|client| mirror.scale(client));
        assert_eq!(scales, [1.0, 2.5, 1.0]);
    }

    #[test]
    fn a_gap_or_a_missing_part_is_refused_and_changes_nothing() {
        let mut mirror = MapMirror::default();
        let mut reset = part(0, 3, 0, true);
        reset.reset = true;
        mirror.apply(vec![reset]).unwrap();
        let before = mirror.clone();
        assert!(mirror.apply(vec![part(4, 5, 0, true)]).is_err());
        assert!(mirror.apply(vec![part(3, 5, 0, false)]).is_err());
        assert!(mirror.apply(vec![part(3, 5, 0, false), part(3, 6, 1, true)]).is_err());
        assert!(mirror.apply(Vec::new()).is_err());
        assert_eq!(mirror, before);
    }
}
