//! The part of the map that tracking works with: the keyframes that share landmarks with what the
//! camera saw last, with their images, and the landmarks that these keyframes see.
//!
//! It is bounded: with each new keyframe beyond the most, the one that was of use the longest ago
//! leaves, with its image and the landmarks that only it sees. The whole map is the server's. Ids are
//! the client's, from 0 and rising; keyframes and landmarks refer to each other by their indices here,
//! which change when a keyframe leaves. Poses and positions are in the map's frame as the server last
//! sent them; before that, as they were sent. Knows no server.

use std::sync::Arc;

use covis_solvers::geometry::{LieGroup, Se3};
use nalgebra::{Vector2, Vector3};

use super::pyramid::Pyramid;

/// The most keyframes that are kept as a rule. Matching takes ten of them and movement four: a hundred
/// hold these and what a moving camera adds in half a minute. At 640 × 480 pixels their images take
/// 60 MB.
pub const MOST_KEYFRAMES: usize = 100;

/// A keyframe.
#[derive(Clone, Debug)]
pub struct MapKeyframe {
    /// Its id.
    pub id: usize,
    /// When it was captured, seconds.
    pub timestamp_s: f64,
    /// Its image.
    pub pyramid: Arc<Pyramid>,
    /// Its pose in the map.
    pub world_from_camera: Se3,
    /// The indices of the landmarks that it sees, and where it sees them.
    pub observations: Vec<(usize, Vector2<f64>)>,
    /// The number of the last frame that showed one of its landmarks.
    pub last_used: u64,
}

/// A landmark.
#[derive(Clone, Debug)]
pub struct MapLandmark {
    /// Its id.
    pub id: usize,
    /// Its position in the map, meters.
    pub point_in_world: Vector3<f64>,
    /// The indices of the keyframes that see it, and where they see it.
    pub observations: Vec<(usize, Vector2<f64>)>,
    /// Frames whose pose it fitted, since it last seemed to move.
    pub times_tracked: usize,
}

/// Where a camera is.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CameraPose {
    /// In the map.
    pub world_from_camera: Se3,
    /// In the odometry frame.
    pub odom_from_camera: Se3,
}

impl CameraPose {
    /// The origin of both frames.
    pub(crate) fn origin() -> Self {
        Self { world_from_camera: Se3::identity(), odom_from_camera: Se3::identity() }
    }

    /// The pose after the camera moved to a place in the map: odometry has the same motion.
    pub(crate) fn moved_to(&self, world_from_camera: &Se3) -> Self {
        let motion = self.world_from_camera.inverse().compose(world_from_camera);
        let odom_from_camera = self.odom_from_camera.compose(&motion);
        Self { world_from_camera: *world_from_camera, odom_from_camera }
    }
}

/// What the server corrected.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Corrections {
    /// Keyframes and their poses, by rising id.
    pub keyframes: Vec<(usize, Se3)>,
    /// Landmarks and their positions, by rising id.
    pub landmarks: Vec<(usize, Vector3<f64>)>,
    /// How what the server does not know yet moves along, where something does.
    pub newer: Option<Newer>,
}

/// How keyframes and landmarks move that came after all that the server knows.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Newer {
    /// The id of the first of these keyframes.
    pub keyframe: usize,
    /// The id of the first of these landmarks.
    pub landmark: usize,
    /// The motion of the map there: corrected_from_before.
    pub motion: Se3,
}

impl Corrections {
    /// Whether there is nothing to correct.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.keyframes.is_empty() && self.landmarks.is_empty() && self.newer.is_none()
    }

    /// What remains of these corrections and later ones, applied one after the other.
    #[must_use]
    pub fn then(self, later: Self) -> Self {
        let newer = match (self.newer, later.newer) {
            (Some(first), Some(second)) => {
                Some(Newer { motion: second.motion.compose(&first.motion), ..second })
            }
            (first, second) => second.or(first),
        };
        Self {
            keyframes: joined(self.keyframes, later.keyframes),
            landmarks: joined(self.landmarks, later.landmarks),
            newer,
        }
    }
}

/// Two lists by rising id as one; where both have an id, the later value.
fn joined<T>(earlier: Vec<(usize, T)>, later: Vec<(usize, T)>) -> Vec<(usize, T)> {
    if earlier.is_empty() {
        return later;
    }
    let mut all = Vec::with_capacity(earlier.len() + later.len());
    let mut earlier = earlier.into_iter().peekable();
    for (id, value) in later {
        while let Some(before) = earlier.next_if(|(other, _)| *other <= id) {
            if before.0 < id {
                all.push(before);
            }
        }
        all.push((id, value));
    }
    all.extend(earlier);
    all
}

/// Keyframes and landmarks, both by rising id.
#[derive(Clone, Debug, Default)]
pub struct LocalMap {
    /// Not more than [`LocalMap::trim`] left.
    pub keyframes: Vec<MapKeyframe>,
    /// All that one of the keyframes sees.
    pub landmarks: Vec<MapLandmark>,
    /// The id of the next keyframe.
    next_keyframe: usize,
    /// The id of the next landmark.
    next_landmark: usize,
    /// How many frames were tracked.
    frame: u64,
}

impl LocalMap {
    /// How many landmarks there have been: the id of the next.
    #[must_use]
    pub fn next_landmark(&self) -> usize {
        self.next_landmark
    }

    /// The keyframe with an id, where it has not left.
    #[must_use]
    pub fn keyframe(&self, id: usize) -> Option<&MapKeyframe> {
        let index = self.keyframes.binary_search_by_key(&id, |keyframe| keyframe.id).ok()?;
        self.keyframes.get(index)
    }

    /// The keyframe that frames refer to: the newest, which never leaves.
    #[must_use]
    pub fn reference(&self) -> Option<&MapKeyframe> {
        self.keyframes.last()
    }

    /// Adds a landmark, which no keyframe sees yet, and returns its index.
    pub fn add_landmark(&mut self, point_in_world: Vector3<f64>) -> usize {
        let (id, observations) = (self.next_landmark, Vec::new());
        self.next_landmark += 1;
        let times_tracked = 0;
        self.landmarks.push(MapLandmark { id, point_in_world, observations, times_tracked });
        self.landmarks.len() - 1
    }

    /// Adds a keyframe that sees these landmarks, by their indices, and returns its id.
    pub fn add_keyframe(
        &mut self,
        timestamp_s: f64,
        pyramid: Arc<Pyramid>,
        world_from_camera: Se3,
        observations: Vec<(usize, Vector2<f64>)>,
    ) -> usize {
        let (id, index) = (self.next_keyframe, self.keyframes.len());
        self.next_keyframe += 1;
        for &(landmark, pixel) in &observations {
            self.landmarks[landmark].observations.push((index, pixel));
        }
        let last_used = self.frame;
        self.keyframes.push(MapKeyframe {
            id,
            timestamp_s,
            pyramid,
            world_from_camera,
            observations,
            last_used,
        });
        id
    }

    /// A frame was tracked by these landmarks: they fitted once more, and the keyframes that see them
    /// are of use.
    pub fn tracked(&mut self, landmarks: impl Iterator<Item = usize>) {
        self.frame += 1;
        for index in landmarks {
            let landmark = &mut self.landmarks[index];
            landmark.times_tracked += 1;
            for &(keyframe, _) in &landmark.observations {
                self.keyframes[keyframe].last_used = self.frame;
            }
        }
    }

    /// Lets go of the keyframes beyond `most`, at least 1, that were of use the longest ago, and of the
    /// landmarks that only they see. Indices change. Returns the ids of these keyframes.
    pub fn trim(&mut self, most: usize) -> Vec<usize> {
        let mut left = Vec::new();
        while self.keyframes.len() > most.max(1) {
            // The newest is the reference of the frames to come.
            let older = &self.keyframes[..self.keyframes.len() - 1];
            let oldest = older.iter().enumerate().min_by_key(|(_, k)| (k.last_used, k.id));
            let Some((index, keyframe)) = oldest else { break };
            left.push(keyframe.id);
            self.remove_keyframe(index);
        }
        left
    }

    fn remove_keyframe(&mut self, index: usize) {
        self.keyframes.remove(index);
        let mut new_index = Vec::with_capacity(self.landmarks.len());
        let mut kept = 0;
        self.landmarks.retain_mut(|landmark| {
            landmark.observations.retain_mut(|(keyframe, _)| {
                let stays = *keyframe != index;
                *keyframe -= usize::from(*keyframe > index);
                stays
            });
            let stays = !landmark.observations.is_empty();
            new_index.push(kept);
            kept += usize::from(stays);
            stays
        });
        for (landmark, _) in self.keyframes.iter_mut().flat_map(|k| &mut k.observations) {
            *landmark = new_index[*landmark];
        }
    }

    /// Takes what the server corrected. What has left, or was never here, is passed over.
    pub fn correct(&mut self, corrections: &Corrections) {
        // A keyframe that is named has its own pose below.
        if let Some(Newer { keyframe, landmark, motion }) = &corrections.newer {
            let keyframes = self.keyframes.iter_mut().rev().take_while(|k| k.id >= *keyframe);
            for newer in keyframes {
                newer.world_from_camera = motion.compose(&newer.world_from_camera);
            }
            for newer in self.landmarks.iter_mut().rev().take_while(|l| l.id >= *landmark) {
                newer.point_in_world = motion.transform(&newer.point_in_world);
            }
        }
        for (keyframe, pose) in pairs(&mut self.keyframes, |k| k.id, &corrections.keyframes) {
            keyframe.world_from_camera = pose;
        }
        for (landmark, point) in pairs(&mut self.landmarks, |l| l.id, &corrections.landmarks) {
            landmark.point_in_world = point;
        }
    }
}

/// What is here with its correction: both lists by rising id, each gone through once.
fn pairs<'a, T, V: Copy>(
    here: &'a mut [T],
    id: impl Fn(&T) -> usize + 'a,
    corrections: &'a [(usize, V)],
) -> impl Iterator<Item = (&'a mut T, V)> {
    let mut corrections = corrections.iter().peekable();
    here.iter_mut().filter_map(move |item| {
        while corrections.next_if(|(other, _)| *other < id(item)).is_some() {}
        let (_, value) = corrections.next_if(|(other, _)| *other == id(item))?;
        Some((item, *value))
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::image::Image;
    use nalgebra::Vector6;

    fn pyramid() -> Arc<Pyramid> {
        Arc::new(Pyramid::new(Image::filled(32, 32, 0), 2))
    }

    /// A map whose keyframe n sees the landmarks n and n + 1.
    fn map(keyframes: usize) -> LocalMap {
        let mut map = LocalMap::default();
        map.add_landmark(Vector3::zeros());
        for n in 0..keyframes {
            let index = map.add_landmark(Vector3::new(n as f64, 0.0, 1.0));
            let seen = [index - 1, index].map(|index| (index, Vector2::zeros())).to_vec();
            map.add_keyframe(n as f64, pyramid(), Se3::identity(), seen);
            map.tracked([index - 1, index].into_iter());
        }
        map
    }

    /// Whether all references stand for what they did: keyframe n sees landmarks n and n + 1.
    fn assert_sound(map: &LocalMap) {
        for (index, keyframe) in map.keyframes.iter().enumerate() {
            let seen: Vec<usize> = keyframe
                .observations
                .iter()
                .map(|(landmark, _)| map.landmarks[*landmark].id)
                .collect();
            assert_eq!(seen, [keyframe.id, keyframe.id + 1]);
            for &(landmark, _) in &keyframe.observations {
                let views = &map.landmarks[landmark].observations;
                assert!(views.iter().any(|(other, _)| *other == index));
            }
        }
        let views: usize = map.landmarks.iter().map(|l| l.observations.len()).sum();
        assert_eq!(views, 2 * map.keyframes.len());
    }

    #[test]
    fn keyframes_leave_that_were_of_use_the_longest_ago_with_their_landmarks_and_images() {
        let mut map = map(MOST_KEYFRAMES);
        assert!(map.trim(MOST_KEYFRAMES).is_empty());
        let images: Vec<_> = map.keyframes.iter().map(|k| Arc::downgrade(&k.pyramid)).collect();
        // The first two are seen again.
        map.tracked([0, 1].into_iter());
        for n in 0..5 {
            let index = map.add_landmark(Vector3::zeros());
            let seen = [index - 1, index].map(|index| (index, Vector2::zeros())).to_vec();
            let id = map.add_keyframe(0.0, pyramid(), Se3::identity(), seen);
            assert_eq!((id, map.next_keyframe), (MOST_KEYFRAMES + n, MOST_KEYFRAMES + n + 1));
            map.tracked([map.landmarks.len() - 1].into_iter());
            assert_eq!(
                map.trim(MOST_KEYFRAMES),
                [n + 2],
                "the newest stays, and what was seen again"
            );
            assert_sound(&map);
        }
        assert_eq!(map.keyframes.len(), MOST_KEYFRAMES);
        let alive: Vec<usize> =
            (0..images.len()).filter(|&i| images[i].upgrade().is_some()).collect();
        assert_eq!(alive, (0..images.len()).filter(|i| !(2..7).contains(i)).collect::<Vec<_>>());
        // Landmark 2 is seen by keyframe 1 as well, landmark 7 by keyframe 7; those between are gone.
        let gone = [3, 4, 5, 6];
        assert!(map.landmarks.iter().all(|landmark| !gone.contains(&landmark.id)));
        assert_eq!(map.landmarks.len(), MOST_KEYFRAMES + 1 + 5 - gone.len());
        assert_eq!((map.keyframe(3).is_some(), map.keyframe(7).map(|k| k.id)), (false, Some(7)));
    }

    #[test]
    fn corrections_reach_what_is_here_and_what_the_server_does_not_know_moves_along() {
        let mut map = map(4);
        let moved = |x: f64| Se3::exp(&Vector6::new(x, 0.0, 0.0, 0.0, 0.0, 0.0));
        let corrections = Corrections {
            keyframes: vec![(1, moved(0.5)), (7, moved(9.0))],
            landmarks: vec![(0, Vector3::new(5.0, 5.0, 5.0)), (40, Vector3::zeros())],
            newer: Some(Newer { keyframe: 2, landmark: 3, motion: moved(0.25) }),
        };
        map.correct(&corrections);
        let x: Vec<f64> = map.keyframes.iter().map(|k| k.world_from_camera.translation.x).collect();
        assert_eq!(x, [0.0, 0.5, 0.25, 0.25]);
        let x: Vec<f64> = map.landmarks.iter().map(|l| l.point_in_world.x).collect();
        assert_eq!(x, [5.0, 0.0, 1.0, 2.25, 3.25]);
    }

    #[test]
    fn corrections_that_were_joined_do_what_they_did_one_after_the_other() {
        let moved = |x: f64| Se3::exp(&Vector6::new(x, 0.1 * x, 0.0, 0.0, 0.2 * x, 0.0));
        let point = |x: f64| Vector3::new(x, 1.0, 2.0);
        let first = Corrections {
            keyframes: vec![(0, moved(0.1)), (1, moved(0.2))],
            landmarks: vec![(0, point(1.0)), (2, point(2.0))],
            newer: Some(Newer { keyframe: 2, landmark: 3, motion: moved(0.3) }),
        };
        // Keyframes 2 and 3 have become known meanwhile.
        let second = Corrections {
            keyframes: vec![(1, moved(0.4)), (2, moved(0.5)), (3, moved(0.6))],
            landmarks: vec![(1, point(3.0)), (2, point(4.0)), (3, point(5.0)), (4, point(6.0))],
            newer: Some(Newer { keyframe: 4, landmark: 5, motion: moved(0.7) }),
        };
        let (mut one_by_one, mut at_once) = (map(6), map(6));
        one_by_one.correct(&first);
        one_by_one.correct(&second);
        at_once.correct(&first.then(second));
        for (a, b) in one_by_one.keyframes.iter().zip(&at_once.keyframes) {
            let apart = a.world_from_camera.inverse().compose(&b.world_from_camera);
            assert!(apart.log().norm() < 1e-12, "{}", a.id);
        }
        for (a, b) in one_by_one.landmarks.iter().zip(&at_once.landmarks) {
            assert!((a.point_in_world - b.point_in_world).norm() < 1e-12, "{}", a.id);
        }
    }
}
