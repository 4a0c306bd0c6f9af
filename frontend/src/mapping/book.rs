//! What the server and tracking know of the client's keyframes: turns changes of the map into
//! corrections for tracking.
//!
//! Tracking continues while the server solves. So a keyframe may be made on poses that were corrected
//! meanwhile, and a correction may come before the server knows the newest keyframes. Both move with
//! the keyframe before them. A keyframe that could not be sent is left out: its landmarks are sent with
//! the next keyframe that sees them, and both follow the keyframe before it. Knows no network.

use std::collections::BTreeMap;

use covis_client::{Key, MapChanges, MapMirror};
use covis_solvers::geometry::{LieGroup, Se3};
use nalgebra::Vector3;

use super::messages;
use crate::local_map::{Corrections, Newer};
use crate::tracking::keyframe::{NewKeyframe, NewLandmark};

/// Poses as near as this are one, m and rad: quaternions are normalized on their way.
const SAME: f64 = 1e-9;

/// A keyframe.
#[derive(Clone, Copy, Debug)]
struct Entry {
    timestamp_s: f64,
    /// As the server last sent it, otherwise as it was tracked, moved with its reference.
    world_from_camera: Se3,
    /// As it was sent.
    sent: Option<Se3>,
    /// The id after that of the last landmark so far.
    end_landmark: usize,
}

/// A landmark that was not sent to the server yet.
#[derive(Clone, Copy, Debug)]
struct Unsent {
    /// The keyframe that it moves with.
    anchor: Option<usize>,
    point_in_world: Vector3<f64>,
}

/// The client's keyframes.
#[derive(Debug)]
pub(super) struct Book {
    client_id: String,
    keyframes: BTreeMap<usize, Entry>,
    /// The newest keyframe that was sent.
    sent: Option<usize>,
    /// The newest keyframe that the server sent.
    known: Option<usize>,
    /// Keyframes that were left out, by the one that they move with.
    left_out: BTreeMap<usize, Vec<usize>>,
    unsent: BTreeMap<usize, Unsent>,
    /// Tracking has let go of the landmarks before this one.
    oldest_landmark: usize,
}

impl Entry {
    /// Whether the server tells the pose that it was sent although the map has moved since: no solve
    /// has included the keyframe yet.
    fn is_unsolved(&self, told: &Se3) -> bool {
        let is_same = |a: &Se3, b: &Se3| a.inverse().compose(b).log().norm() < SAME;
        self.sent
            .is_some_and(|sent| is_same(&sent, told) && !is_same(&sent, &self.world_from_camera))
    }
}

impl Book {
    /// An empty book of a client.
    pub(super) fn new(client_id: &str) -> Self {
        Self {
            client_id: client_id.to_owned(),
            keyframes: BTreeMap::new(),
            sent: None,
            known: None,
            left_out: BTreeMap::new(),
            unsent: BTreeMap::new(),
            oldest_landmark: 0,
        }
    }

    /// All keyframes by rising id: id, time and pose.
    pub(super) fn poses(&self) -> impl Iterator<Item = (usize, f64, Se3)> {
        let entries = self.keyframes.iter();
        entries.map(|(id, entry)| (*id, entry.timestamp_s, entry.world_from_camera))
    }

    /// The pose of a keyframe.
    pub(super) fn pose(&self, id: usize) -> Option<Se3> {
        Some(self.keyframes.get(&id)?.world_from_camera)
    }

    /// When a keyframe was captured, seconds.
    pub(super) fn timestamp_s(&self, id: usize) -> Option<f64> {
        Some(self.keyframes.get(&id)?.timestamp_s)
    }

    /// Enters a new keyframe and makes it ready to be sent: on the present poses, with the landmarks of
    /// keyframes that were left out.
    pub(super) fn enter(&mut self, keyframe: &mut NewKeyframe) {
        if let Some(before) = keyframe.predecessor
            && let Some(now) = self.pose(before.id)
            && now != before.world_from_camera
        {
            let motion = now.compose(&before.world_from_camera.inverse());
            keyframe.world_from_camera = motion.compose(&keyframe.world_from_camera);
            for landmark in &mut keyframe.landmarks {
                landmark.point_in_world = motion.transform(&landmark.point_in_world);
            }
        }
        self.oldest_landmark = keyframe.oldest_landmark;
        self.unsent = self.unsent.split_off(&keyframe.oldest_landmark);
        let last = self.keyframes.last_key_value().map_or(0, |(_, entry)| entry.end_landmark);
        let end_landmark = keyframe.landmarks.last().map_or(last, |landmark| landmark.id + 1);
        self.keyframes.insert(
            keyframe.id,
            Entry {
                timestamp_s: keyframe.timestamp_s,
                world_from_camera: keyframe.world_from_camera,
                sent: None,
                end_landmark,
            },
        );
        for observation in &keyframe.observations {
            if let Some(unsent) = self.unsent.remove(&observation.landmark) {
                let (id, point_in_world) = (observation.landmark, unsent.point_in_world);
                keyframe.landmarks.push(NewLandmark { id, point_in_world });
            }
        }
    }

    /// A keyframe that was entered is on its way.
    pub(super) fn sent(&mut self, id: usize) {
        self.sent = Some(id);
        if let Some(entry) = self.keyframes.get_mut(&id) {
            entry.sent = Some(entry.world_from_camera);
        }
    }

    /// A keyframe that was entered could not be sent.
    pub(super) fn leave_out(&mut self, keyframe: &NewKeyframe) {
        let anchor = self.sent;
        if let Some(anchor) = anchor {
            self.left_out.entry(anchor).or_default().push(keyframe.id);
        }
        for landmark in &keyframe.landmarks {
            let point_in_world = landmark.point_in_world;
            self.unsent.insert(landmark.id, Unsent { anchor, point_in_world });
        }
    }

    /// What a delta corrects. A keyframe that came to the server after a solve moved the map stands where
    /// it was sent until the next solve: it and its landmarks wait for that.
    pub(super) fn correct(&mut self, changes: &MapChanges, mirror: &MapMirror) -> Corrections {
        let mut corrected = BTreeMap::new();
        let mut motions = BTreeMap::new();
        let first = self.end_of_known();
        for (id, key) in self.own(&changes.keyframes) {
            let told = mirror.keyframes.get(key).and_then(|told| told.world_from_camera.as_ref());
            let Some(pose) = told.and_then(messages::se3) else { continue };
            let Some(entry) = self.keyframes.get_mut(&id) else { continue };
            if entry.is_unsolved(&pose) {
                continue;
            }
            self.known = self.known.max(Some(id));
            if entry.world_from_camera != pose {
                motions.insert(id, pose.compose(&entry.world_from_camera.inverse()));
                entry.world_from_camera = pose;
                corrected.insert(id, pose);
            }
        }
        let end = self.end_of_known();
        let mut landmarks = BTreeMap::new();
        let mut take = |id: usize, key: &Key| {
            let told = mirror.landmarks.get(key).and_then(|told| told.point_in_world);
            if let Some(p) = told.filter(|_| id >= self.oldest_landmark && id < end) {
                landmarks.insert(id, Vector3::new(p.x, p.y, p.z));
            }
        };
        for (id, key) in self.own(&changes.landmarks) {
            take(id, key);
        }
        // Those of keyframes that were solved just now may have come before.
        let key = |id: usize| (self.client_id.clone(), i64::try_from(id).unwrap_or(i64::MAX));
        for (key, _) in mirror.landmarks.range(key(first)..key(end.max(first))) {
            take(usize::try_from(key.1).unwrap_or(usize::MAX), key);
        }
        self.move_left_out(&motions, &mut corrected, &mut landmarks);
        let newer = self.move_newer(&motions);
        Corrections {
            keyframes: corrected.into_iter().collect(),
            landmarks: landmarks.into_iter().collect(),
            newer,
        }
    }

    /// The id after that of the last landmark of the keyframes that the server knows.
    fn end_of_known(&self) -> usize {
        let known = self.known.and_then(|known| self.keyframes.get(&known));
        known.map_or(0, |entry| entry.end_landmark)
    }

    /// What the client owns of these, by its id.
    fn own<'a>(&self, keys: &'a [Key]) -> Vec<(usize, &'a Key)> {
        let own = keys.iter().filter(|key| key.0 == self.client_id);
        own.filter_map(|key| Some((usize::try_from(key.1).ok()?, key))).collect()
    }

    /// Moves what was left out with the keyframe before it.
    fn move_left_out(
        &mut self,
        motions: &BTreeMap<usize, Se3>,
        keyframes: &mut BTreeMap<usize, Se3>,
        landmarks: &mut BTreeMap<usize, Vector3<f64>>,
    ) {
        if self.left_out.is_empty() {
            return;
        }
        for (anchor, motion) in motions {
            for id in self.left_out.get(anchor).into_iter().flatten() {
                if let Some(entry) = self.keyframes.get_mut(id) {
                    entry.world_from_camera = motion.compose(&entry.world_from_camera);
                    keyframes.insert(*id, entry.world_from_camera);
                }
            }
        }
        for (&id, unsent) in &mut self.unsent {
            let anchor = unsent.anchor.min(self.known);
            if let Some(motion) = anchor.and_then(|anchor| motions.get(&anchor)) {
                unsent.point_in_world = motion.transform(&unsent.point_in_world);
                landmarks.insert(id, unsent.point_in_world);
            }
        }
    }

    /// Moves what the server does not know yet with the newest keyframe that it knows.
    fn move_newer(&mut self, motions: &BTreeMap<usize, Se3>) -> Option<Newer> {
        let known = self.known?;
        let motion = *motions.get(&known)?;
        // Those that were left out after it have moved with it already.
        let followers = self.left_out.get(&known).into_iter().flatten();
        let first = followers.fold(known, |last, follower| last.max(*follower)) + 1;
        let landmark = self.keyframes.range(..first).next_back()?.1.end_landmark;
        for (_, entry) in self.keyframes.range_mut(first..) {
            entry.world_from_camera = motion.compose(&entry.world_from_camera);
        }
        Some(Newer { keyframe: first, landmark, motion })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::tracking::keyframe::{NewObservation, Predecessor};
    use crate::tracking::local_matching::Match;
    use covis_client::wire::v1;
    use covis_solvers::geometry::So3;
    use nalgebra::Vector2;

    fn at(x: f64) -> Se3 {
        Se3::new(So3::identity(), Vector3::new(x, 0.0, 0.0))
    }

    /// Keyframe n: it stands at x = n, brings landmark n at x = n + 10, and sees landmark n − 1 too.
    fn keyframe(id: usize) -> NewKeyframe {
        let x = id as f64;
        let before = id.checked_sub(1);
        let seen = |landmark: usize| NewObservation {
            landmark,
            seen: Match {
                landmark: 0,
                pixel: Vector2::zeros(),
                straight: Vector2::zeros(),
                sigma_px: 1.0,
                depth_m: None,
            },
            descriptor: None,
        };
        NewKeyframe {
            id,
            predecessor: before.map(|id| Predecessor { id, world_from_camera: at(id as f64) }),
            timestamp_s: x,
            world_from_camera: at(x),
            odom_from_camera: at(x),
            landmarks: vec![NewLandmark { id, point_in_world: at(x + 10.0).translation }],
            observations: before.into_iter().chain([id]).map(seen).collect(),
            oldest_landmark: 0,
        }
    }

    /// A delta with keyframes and landmarks of `own`, at these positions along x.
    fn delta(keyframes: &[(i64, f64)], landmarks: &[(i64, f64)]) -> (MapChanges, MapMirror) {
        let (mut changes, mut mirror) = (MapChanges::default(), MapMirror::default());
        for &(id, x) in keyframes {
            let world_from_camera = Some(messages::rigid(&at(x)));
            let pose = v1::KeyframePose { world_from_camera, ..Default::default() };
            changes.keyframes.push(("own".to_owned(), id));
            mirror.keyframes.insert(("own".to_owned(), id), pose);
        }
        for &(id, x) in landmarks {
            let point_in_world = Some(messages::vector3(&at(x).translation));
            changes.landmarks.push(("own".to_owned(), id));
            let landmark = v1::Landmark { point_in_world, ..Default::default() };
            mirror.landmarks.insert(("own".to_owned(), id), landmark);
        }
        // Another client's are no concern of this one.
        changes.keyframes.push(("other".to_owned(), 0));
        mirror.keyframes.insert(("other".to_owned(), 0), v1::KeyframePose::default());
        (changes, mirror)
    }

    fn x_of(poses: &[(usize, Se3)]) -> Vec<(usize, f64)> {
        poses.iter().map(|(id, pose)| (*id, pose.translation.x)).collect()
    }

    #[test]
    fn what_the_server_does_not_know_moves_with_the_newest_keyframe_that_it_knows() {
        let mut book = Book::new("own");
        for id in 0..3 {
            book.enter(&mut keyframe(id));
            book.sent(id);
        }
        let (changes, mirror) = delta(&[(0, 0.0), (1, 1.5)], &[(1, 11.25)]);
        let corrections = book.correct(&changes, &mirror);
        assert_eq!(x_of(&corrections.keyframes), [(1, 1.5)], "keyframe 0 stays");
        assert_eq!(corrections.landmarks, [(1, at(11.25).translation)]);
        assert_eq!(corrections.newer, Some(Newer { keyframe: 2, landmark: 2, motion: at(0.5) }));
        // A keyframe that was made before tracking took that is sent on the corrected poses.
        let mut late = keyframe(3);
        book.enter(&mut late);
        assert_eq!(late.world_from_camera.translation.x, 3.5);
        assert_eq!(late.landmarks[0].point_in_world.x, 13.5);
        let poses: Vec<f64> = book.poses().map(|(_, _, pose)| pose.translation.x).collect();
        assert_eq!(poses, [0.0, 1.5, 2.5, 3.5]);
    }

    #[test]
    fn a_keyframe_that_agrees_with_the_book_is_sent_as_it_was_tracked() {
        let mut book = Book::new("own");
        for id in 0..2 {
            let mut sent = keyframe(id);
            book.enter(&mut sent);
            assert_eq!(sent, keyframe(id));
        }
        let (changes, mirror) = delta(&[(0, 0.0), (1, 1.0)], &[]);
        assert!(book.correct(&changes, &mirror).is_empty());
    }

    #[test]
    fn landmarks_of_a_keyframe_that_was_left_out_come_with_the_next_that_sees_them() {
        let mut book = Book::new("own");
        book.enter(&mut keyframe(0));
        book.sent(0);
        for id in [1, 2] {
            let mut left_out = keyframe(id);
            book.enter(&mut left_out);
            book.leave_out(&left_out);
        }
        // They move with keyframe 0, and tracking is told so.
        let (changes, mirror) = delta(&[(0, 0.25)], &[]);
        let corrections = book.correct(&changes, &mirror);
        assert_eq!(x_of(&corrections.keyframes), [(0, 0.25), (1, 1.25), (2, 2.25)]);
        let points: Vec<_> = corrections.landmarks.iter().map(|(id, p)| (*id, p.x)).collect();
        assert_eq!(points, [(1, 11.25), (2, 12.25)]);
        assert_eq!(corrections.newer, Some(Newer { keyframe: 3, landmark: 3, motion: at(0.25) }));
        // Keyframe 3 sees landmark 2 of keyframe 2 and is the first that the server gets of it.
        let mut next = keyframe(3);
        book.enter(&mut next);
        let sent: Vec<_> = next.landmarks.iter().map(|l| (l.id, l.point_in_world.x)).collect();
        assert_eq!(sent, [(3, 13.25), (2, 12.25)]);
        book.sent(3);
        let mut after = keyframe(4);
        book.enter(&mut after);
        assert_eq!(after.landmarks.len(), 1, "landmark 3 was sent");
    }

    #[test]
    fn landmarks_that_tracking_let_go_are_neither_corrected_nor_kept() {
        let mut book = Book::new("own");
        book.enter(&mut keyframe(0));
        book.sent(0);
        let mut left_out = keyframe(1);
        book.enter(&mut left_out);
        book.leave_out(&left_out);
        let mut later = NewKeyframe { oldest_landmark: 2, ..keyframe(2) };
        book.enter(&mut later);
        assert!(book.unsent.is_empty());
        book.sent(2);
        let (changes, mirror) = delta(&[(2, 2.0)], &[(0, 10.5), (2, 12.5)]);
        let corrections = book.correct(&changes, &mirror);
        assert_eq!(corrections.landmarks, [(2, at(12.5).translation)]);
    }

    #[test]
    fn a_keyframe_that_reached_the_server_after_the_map_moved_waits_for_its_solve() {
        let mut book = Book::new("own");
        for id in 0..2 {
            book.enter(&mut keyframe(id));
            book.sent(id);
        }
        let (changes, mirror) = delta(&[(0, 0.5)], &[(0, 10.5)]);
        assert!(book.correct(&changes, &mirror).newer.is_some());
        assert_eq!(book.pose(1).map(|pose| pose.translation.x), Some(1.5));
        // The server has it where it was sent, and its landmark too.
        let (changes, mut mirror) = delta(&[(1, 1.0)], &[(1, 11.0)]);
        assert!(book.correct(&changes, &mirror).is_empty());
        assert_eq!(book.pose(1).map(|pose| pose.translation.x), Some(1.5));
        // Its solve: the landmark that came before is told with it.
        let (changes, solved) = delta(&[(1, 1.25)], &[]);
        mirror.keyframes = solved.keyframes;
        let corrections = book.correct(&changes, &mirror);
        assert_eq!(x_of(&corrections.keyframes), [(1, 1.25)]);
        assert_eq!(corrections.landmarks, [(1, at(11.0).translation)]);
        assert_eq!(corrections.newer, Some(Newer { keyframe: 2, landmark: 2, motion: at(-0.25) }));
    }
}
