//! What a watcher's reader has, and whether a value that was touched is sent to it again.
//!
//! The reader has the map of the last step, which is a snapshot and shares what has not changed with
//! the newest one and with other watchers. Where the reader takes a resolution, some entities moved
//! since by less than that; for those alone the values that it has are kept here. The map bounds
//! their number, and so does a constant: past it values are sent. Compares messages, so that whatever
//! a reader can see counts; sends nothing.

use std::collections::{BTreeMap, BTreeSet};
use std::sync::Arc;

use super::super::convert::entities::{
    to_any_constraint, to_camera, to_client_frame, to_keyframe_pose, to_landmark,
};
use crate::map::{ClientIndex, EntityId, Map};
use crate::wire::v1;

/// Most values that wait, about 20 MB of a watcher: any further one is sent, however small the change.
const MOST_WITHHELD: usize = 1 << 18;

/// The number of a landmark's observations changes with almost every keyframe: where a resolution is
/// asked for, it alone is a reason to send once it is so many times larger or smaller.
const COUNT_RATIO: i64 = 4;

/// How far a value may be from the one that the reader has.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(in crate::service) struct Resolution {
    /// Of landmarks, and of positions of keyframes, m. 0: every change is sent.
    pub position_m: f64,
    /// Of rotations of keyframes, rad. 0: every change is sent.
    pub rotation_rad: f64,
}

impl Resolution {
    fn is_exact(self) -> bool {
        self.position_m == 0.0 && self.rotation_rad == 0.0
    }
}

/// What a reader has.
#[derive(Debug)]
pub(super) struct Sent {
    resolution: Resolution,
    /// The map of the last step. `None` before the first.
    last: Option<Arc<Map>>,
    /// The poses that the reader has where they are not those of `last`.
    poses: BTreeMap<EntityId, v1::RigidTransform>,
    /// The position and the number of observations that the reader has where they are not those of
    /// `last`.
    landmarks: BTreeMap<EntityId, (v1::Vector3, i64)>,
    /// The keyframes and the landmarks that were sent on this stream, where it went on from a
    /// revision and the reader may be off by the resolution already. `None`: all are known.
    known: Option<[BTreeSet<EntityId>; 2]>,
}

impl Sent {
    /// Of a reader of which nothing is known.
    pub(super) fn new(resolution: Resolution) -> Self {
        let (poses, landmarks) = Default::default();
        let known = (!resolution.is_exact()).then(Default::default);
        Self { resolution, last: None, poses, landmarks, known }
    }

    /// The reader drops what it has and gets all of a map.
    pub(super) fn reset(&mut self) {
        *self = Self { known: None, ..Self::new(self.resolution) };
    }

    /// The step to `map` was sent.
    pub(super) fn took(&mut self, map: &Arc<Map>) {
        self.last = Some(Arc::clone(map));
    }

    /// Whether the reader may have an entity that the map no longer has; `had` finds it in the map of
    /// the last step.
    pub(super) fn may_have(&mut self, id: EntityId, had: impl FnOnce(&Map) -> bool) -> bool {
        self.poses.remove(&id);
        self.landmarks.remove(&id);
        self.last.as_deref().is_none_or(had)
    }

    /// Whether the reader needs this pose of a keyframe.
    pub(super) fn needs_keyframe(&mut self, id: EntityId, now: &v1::KeyframePose) -> bool {
        let withheld = self.poses.remove(&id);
        let is_known = self.known.as_mut().is_none_or(|[poses, _]| !poses.insert(id));
        let last = self.last.as_deref().filter(|_| is_known);
        let had = |last: &Map| Some(to_keyframe_pose(last, id, last.keyframes().get(&id)?));
        let Some(mut had) = last.and_then(had) else { return true };
        if let Some(pose) = withheld {
            had.world_from_camera = Some(pose);
        }
        if had == *now {
            return false;
        }
        if self.resolution.is_exact() {
            return true;
        }
        let (Some(a), Some(b)) = (had.world_from_camera, now.world_from_camera) else {
            return true;
        };
        let moved = v1::KeyframePose { world_from_camera: Some(b), ..had };
        if moved != *now || !self.resolution.covers(&a, &b) || self.is_full() {
            return true;
        }
        self.poses.insert(id, a);
        false
    }

    /// Whether the reader needs this landmark. Where the reader takes a resolution, the number of
    /// observations counts only when it is another one by [`COUNT_RATIO`].
    pub(super) fn needs_landmark(&mut self, id: EntityId, now: &v1::Landmark) -> bool {
        let withheld = self.landmarks.remove(&id);
        let is_known = self.known.as_mut().is_none_or(|[_, landmarks]| !landmarks.insert(id));
        let last = self.last.as_deref().filter(|_| is_known);
        let had = |last: &Map| Some(to_landmark(last, id, last.landmarks().get(&id)?));
        let Some(mut had) = last.and_then(had) else { return true };
        if let Some((point, count)) = withheld {
            (had.point_in_world, had.observation_count) = (Some(point), count);
        }
        if had == *now {
            return false;
        }
        let (Some(a), Some(b)) = (had.point_in_world, now.point_in_world) else { return true };
        let (before, after) = (had.observation_count, now.observation_count);
        let moved = v1::Landmark { point_in_world: Some(b), observation_count: after, ..had };
        let about_as_many = after < COUNT_RATIO * before && before < COUNT_RATIO * after;
        let most = self.resolution.position_m;
        let is_near = most > 0.0 && distance(&a, &b) <= most;
        if moved != *now || !about_as_many || !is_near || self.is_full() {
            return true;
        }
        self.landmarks.insert(id, (a, before));
        false
    }

    fn is_full(&self) -> bool {
        self.poses.len() + self.landmarks.len() >= MOST_WITHHELD
    }

    /// Whether the reader needs this camera.
    pub(super) fn needs_camera(&self, id: EntityId, now: &v1::Camera) -> bool {
        self.needs(now, |last| Some(to_camera(last, id, last.cameras().get(&id)?)))
    }

    /// Whether the reader needs this constraint or prior.
    pub(super) fn needs_constraint(&self, id: EntityId, now: &v1::Constraint) -> bool {
        self.needs(now, |last| to_any_constraint(last, id))
    }

    /// Whether the reader needs this frame of a client.
    pub(super) fn needs_client_frame(&self, client: ClientIndex, now: &v1::ClientFrame) -> bool {
        self.needs(now, |last| to_client_frame(last, client))
    }

    fn needs<M: PartialEq>(&self, now: &M, had: impl FnOnce(&Map) -> Option<M>) -> bool {
        self.last.as_deref().and_then(had).is_none_or(|had| had != *now)
    }
}

impl Resolution {
    /// Whether two poses differ by no more than this.
    fn covers(self, a: &v1::RigidTransform, b: &v1::RigidTransform) -> bool {
        let (Some(p), Some(q), Some(r), Some(s)) =
            (a.translation, b.translation, a.rotation, b.rotation)
        else {
            return false;
        };
        let position = p == q || distance(&p, &q) <= self.position_m;
        position && (r == s || angle(&r, &s) <= self.rotation_rad)
    }
}

fn distance(a: &v1::Vector3, b: &v1::Vector3) -> f64 {
    (a.x - b.x).hypot(a.y - b.y).hypot(a.z - b.z)
}

/// The angle between two rotations, from the chord of their quaternions, which is exact for small
/// angles too.
fn angle(a: &v1::Quaternion, b: &v1::Quaternion) -> f64 {
    let chord = |sign: f64| {
        let [x, y] = [a.x - sign * b.x, a.y - sign * b.y];
        let [z, w] = [a.z - sign * b.z, a.w - sign * b.w];
        x.hypot(y).hypot(z).hypot(w)
    };
    4.0 * (0.5 * chord(1.0).min(chord(-1.0))).min(1.0).asin()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn pose(x: f64, angle_rad: f64) -> v1::RigidTransform {
        let (z, w) = (0.5 * angle_rad).sin_cos();
        v1::RigidTransform {
            translation: Some(v1::Vector3 { x, y: 2.0, z: 3.0 }),
            rotation: Some(v1::Quaternion { x: 0.0, y: 0.0, z, w }),
        }
    }

    #[test]
    fn small_angles_are_distinguished_and_opposite_quaternions_are_one_rotation() {
        let a = pose(0.0, 0.3).rotation.unwrap();
        for turned in [1e-12, 1e-6, 0.1, 3.0] {
            let b = pose(0.0, 0.3 + turned).rotation.unwrap();
            assert!((angle(&a, &b) - turned).abs() < 1e-6 * turned + 1e-15, "{turned}");
            let opposite = v1::Quaternion { x: -b.x, y: -b.y, z: -b.z, w: -b.w };
            assert_eq!(angle(&a, &opposite), angle(&a, &b));
        }
    }

    #[test]
    fn a_pose_waits_where_both_parts_moved_less_than_their_resolution() {
        let within = |position_m, rotation_rad, x, angle_rad| {
            let resolution = Resolution { position_m, rotation_rad };
            resolution.covers(&pose(0.0, 0.1), &pose(x, 0.1 + angle_rad))
        };
        assert!(within(1e-3, 1e-3, 0.9e-3, 0.9e-3));
        assert!(!within(1e-3, 1e-3, 1.1e-3, 0.0) && !within(1e-3, 1e-3, 0.0, 1.1e-3));
        // One that is 0 lets nothing wait that it is about.
        assert!(within(1e-3, 0.0, 0.9e-3, 0.0) && !within(1e-3, 0.0, 0.9e-3, 1e-9));
        assert!(within(0.0, 1e-3, 0.0, 0.9e-3) && !within(0.0, 1e-3, 1e-9, 0.9e-3));
        assert!(!within(0.0, 0.0, 1e-300, 0.0));
    }
}
