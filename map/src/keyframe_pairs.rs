//! Pairs of keyframes whose relative pose is measured from the landmarks that both see.
//!
//! A pair is two consecutive keyframes of a client, or a keyframe and an older one that it sees much of
//! again. Its measurement is a function of observations, cameras and odometry alone: no current estimate
//! and no constraint enters it, so that it is the same whatever solves did to the map, and a loop closure
//! is never judged by what it moved itself. Landmarks lie in the frame of the first keyframe, by its
//! depth or triangulated from keyframes before it at their odometry. Nothing is kept here.

use std::collections::BTreeSet;

use covis_solvers::geometry::{Camera, LieGroup, Se3};
use covis_solvers::initialization::View;
use covis_solvers::relative_motion::{self, Match, PointEstimate, RelativeMotion};

use super::{ClientIndex, EntityId, Keyframe, Map};

/// Keyframes from which a landmark without depth is triangulated, and those within which two keyframes
/// of a client are near each other: a second of video, in which odometry drifts less than a pixel.
const NEAR_KEYFRAMES: usize = 8;

/// What a measurement of a pair depends on. Equal inputs give the same bits.
#[derive(Clone, Debug, PartialEq)]
pub struct PairInput {
    /// The first keyframe, a.
    pub a: EntityId,
    /// The second one, b.
    pub b: EntityId,
    camera_b: Camera,
    matches: Vec<Match>,
    start: Se3,
}

impl PairInput {
    /// Measures the pose of b in the frame of a; `None` where the landmarks do not determine it.
    pub fn measure(&self) -> Option<RelativeMotion> {
        relative_motion::measure(&self.camera_b, &self.matches, &self.start)
    }
}

/// The keyframes of its client that were captured after a keyframe, by capture time and id, and see one
/// of `landmarks`. A landmark without depth is triangulated from keyframes before, so that the
/// measurement of a pair that one of these begins may depend on that keyframe.
#[must_use]
pub fn later_observers(
    map: &Map,
    (capture_time_ns, keyframe): (i64, EntityId),
    landmarks: impl Iterator<Item = EntityId>,
) -> BTreeSet<EntityId> {
    let observers = landmarks.filter_map(|id| map.landmarks().get(&id)).flat_map(|l| &l.observers);
    let is_later = |id: &EntityId| {
        let known = map.keyframes().get(id);
        known.is_some_and(|k| (k.capture_time_ns, *id) > (capture_time_ns, keyframe))
    };
    let own: BTreeSet<EntityId> =
        observers.copied().filter(|observer| observer.client == keyframe.client).collect();
    own.into_iter().filter(is_later).collect()
}

/// What the measurement of b in the frame of a needs; `None` where they share too few landmarks.
#[must_use]
pub fn pair_input(map: &Map, a: EntityId, b: EntityId) -> Option<PairInput> {
    let (first, second) = (map.keyframes().get(&a)?, map.keyframes().get(&b)?);
    let view_b = map.views(second).next()?;
    let camera_b = view_b.camera.camera;
    let matches = view_b.observations.iter().filter_map(|seen| {
        let landmark = point_in(map, (a, first), seen.landmark)?;
        let depth_m = seen.depth.map(|depth| (depth.depth_m, depth.sigma_m));
        Some(Match { landmark, pixel: seen.pixel, sigma_px: seen.sigma_px, depth_m })
    });
    let matches: Vec<Match> = matches.collect();
    let start = odometry(first, second);
    let is_enough = matches.len() >= relative_motion::MIN_MATCHES;
    is_enough.then_some(PairInput { a, b, camera_b, matches, start })
}

/// The relative pose of two keyframes by their client's odometry.
pub(super) fn odometry(a: &Keyframe, b: &Keyframe) -> Se3 {
    a.odom_from_camera.inverse().compose(&b.odom_from_camera)
}

/// The landmark in the frame of `a`, which sees it.
pub(super) fn point_in(
    map: &Map,
    a: (EntityId, &Keyframe),
    landmark: EntityId,
) -> Option<PointEstimate> {
    let (id, keyframe) = a;
    let seen = map.views_at(keyframe, Se3::identity()).find_map(|view| view.of(landmark))?;
    if seen.depth_m.is_some() {
        return PointEstimate::from_views(&[seen]);
    }
    let observers = &map.landmarks().get(&landmark)?.observers;
    let key = |id: EntityId, k: &Keyframe| (k.capture_time_ns, id);
    let mut earlier: Vec<(EntityId, &Keyframe)> = observers
        .iter()
        .filter(|observer| observer.client == id.client)
        .filter_map(|observer| Some((*observer, map.keyframes().get(observer)?)))
        .filter(|&(observer, k)| key(observer, k) <= key(id, keyframe))
        .collect();
    earlier.sort_by_key(|&(observer, k)| std::cmp::Reverse(key(observer, k)));
    earlier.truncate(NEAR_KEYFRAMES);
    let views = earlier.into_iter().flat_map(|(_, k)| map.views_at(k, odometry(keyframe, k)));
    let views: Vec<View> = views.filter_map(|view| view.of(landmark)).collect();
    PointEstimate::from_views(&views)
}

/// The keyframes before and after `keyframe` among those that share landmarks with it, as pairs in
/// capture order: nearly always its neighbors in the trajectory, found without looking through that.
#[must_use]
pub fn near_pairs(map: &Map, keyframe: EntityId) -> Vec<(EntityId, EntityId)> {
    let time = |id: EntityId| map.keyframes().get(&id).map(|k| (k.capture_time_ns, id));
    let Some(now) = time(keyframe) else { return Vec::new() };
    let neighbors = map.covisibility().neighbors(keyframe).map(|(id, _)| id);
    let times = neighbors.filter(|id| id.client == keyframe.client).filter_map(time);
    let (before, after): (Vec<_>, Vec<_>) = times.partition(|&other| other < now);
    let before = before.into_iter().max().map(|(_, id)| (id, keyframe));
    let after = after.into_iter().min().map(|(_, id)| (keyframe, id));
    before.into_iter().chain(after).collect()
}

/// The keyframes of a map in the order of their trajectories, and the pairs whose measurements make up
/// the pose graph. It is made once for a solve.
#[derive(Debug)]
pub struct GraphPairs<'a> {
    /// By id.
    pub(super) keyframes: Vec<(EntityId, &'a Keyframe)>,
    /// A number for each keyframe: consecutive ones of a client in capture order have consecutive
    /// numbers, no others.
    pub(super) numbers: Vec<i64>,
    /// Places of both keyframes in `keyframes`: consecutive keyframes of each client, then those that
    /// see a place again, by the later keyframe.
    pub(super) pairs: Vec<[usize; 2]>,
}

impl<'a> GraphPairs<'a> {
    /// Of all keyframes of a map.
    #[must_use]
    pub fn of(map: &'a Map) -> Self {
        let keyframes: Vec<(EntityId, &Keyframe)> =
            map.keyframes().iter().map(|(&id, keyframe)| (id, keyframe)).collect();
        let mut order: Vec<usize> = (0..keyframes.len()).collect();
        // Sorted already, but for keyframes that came late.
        let key = |&at: &usize| (keyframes[at].0.client, keyframes[at].1.capture_time_ns, at);
        order.sort_by_key(key);
        let trajectories: Vec<&[usize]> =
            order.chunk_by(|&a, &b| keyframes[a].0.client == keyframes[b].0.client).collect();
        let mut numbers = vec![0; keyframes.len()];
        let mut next = 0;
        for trajectory in &trajectories {
            for &at in *trajectory {
                numbers[at] = next;
                next += 1;
            }
            next += 1;
        }
        let mut pairs: Vec<[usize; 2]> =
            trajectories.iter().flat_map(|t| t.windows(2).map(|pair| [pair[0], pair[1]])).collect();
        pairs.extend(again(map, &keyframes, &trajectories));
        Self { keyframes, numbers, pairs }
    }

    /// The ids of the pairs.
    pub fn ids(&self) -> impl ExactSizeIterator<Item = (EntityId, EntityId)> + '_ {
        self.pairs.iter().map(|&[a, b]| (self.keyframes[a].0, self.keyframes[b].0))
    }

    /// The index of a keyframe in the order of ids.
    pub(super) fn index(&self, id: EntityId) -> Option<usize> {
        self.keyframes.binary_search_by_key(&id, |entry| entry.0).ok()
    }
}

/// Keyframes that see again what keyframes saw that are not near in the trajectory, each with the one
/// that it shares most landmarks with. Pairs near each other share landmarks and errors, so that one of
/// them stands for all.
fn again(
    map: &Map,
    keyframes: &[(EntityId, &Keyframe)],
    trajectories: &[&[usize]],
) -> Vec<[usize; 2]> {
    let threshold = u32::try_from(map.policy().min_shared_landmarks.max(1)).unwrap_or(u32::MAX);
    // The index in its trajectory of each keyframe.
    let mut index_in_trajectory = vec![0; keyframes.len()];
    for trajectory in trajectories {
        trajectory.iter().enumerate().for_each(|(index, &at)| index_in_trajectory[at] = index);
    }
    let find = |id: EntityId| keyframes.binary_search_by_key(&id, |entry| entry.0).ok();
    let mut taken: BTreeSet<[(ClientIndex, usize); 2]> = BTreeSet::new();
    let mut pairs = Vec::new();
    for &at in trajectories.iter().copied().flatten() {
        let (keyframe, entity) = keyframes[at];
        if entity.observations.is_empty() {
            continue;
        }
        let is_elsewhere = |other: EntityId| match other.client == keyframe.client {
            true => find(other).is_some_and(|other| {
                index_in_trajectory[other] + NEAR_KEYFRAMES < index_in_trajectory[at]
            }),
            false => other.client < keyframe.client,
        };
        let seen = map.covisibility().neighbors(keyframe);
        let seen = seen.filter(|&(other, shared)| shared >= threshold && is_elsewhere(other));
        let most = seen.max_by_key(|&(id, shared)| (shared, std::cmp::Reverse(id)));
        let Some(other) = most.and_then(|(other, _)| find(other)) else { continue };
        let cell = |at: usize| (keyframes[at].0.client, index_in_trajectory[at] / NEAR_KEYFRAMES);
        if taken.insert([cell(other), cell(at)]) {
            pairs.push([other, at]);
        }
    }
    pairs
}
