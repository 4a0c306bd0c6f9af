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

use super::{CameraEntity, ClientIndex, EntityId, Keyframe, Map, Observation, Observations};

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
    #[must_use]
    pub fn measure(&self) -> Option<RelativeMotion> {
        relative_motion::measure(&self.camera_b, &self.matches, &self.start)
    }
}

/// By what it is recognized that a measurement still holds.
#[derive(Clone, Debug)]
pub struct PairState {
    observations: [Observations; 2],
    cameras: [Option<CameraEntity>; 2],
    odometry: [Se3; 2],
}

impl PairState {
    /// Of a pair in the map; `None` where a keyframe is not there.
    #[must_use]
    pub fn of(map: &Map, a: EntityId, b: EntityId) -> Option<Self> {
        let (a, b) = (map.keyframes().get(&a)?, map.keyframes().get(&b)?);
        let camera = |k: &Keyframe| k.camera.and_then(|id| map.cameras().get(&id)).copied();
        Some(Self {
            observations: [a.observations.clone(), b.observations.clone()],
            cameras: [camera(a), camera(b)],
            odometry: [a.odom_from_camera, b.odom_from_camera],
        })
    }

    /// Whether both are of the same observations, cameras and odometry.
    #[must_use]
    pub fn is_same(&self, other: &Self) -> bool {
        let [a, b] = &self.observations;
        a.is_same(&other.observations[0])
            && b.is_same(&other.observations[1])
            && self.cameras == other.cameras
            && self.odometry == other.odometry
    }
}

/// What the measurement of b in the frame of a needs; `None` where they share too few landmarks.
#[must_use]
pub fn pair_input(map: &Map, a: EntityId, b: EntityId) -> Option<PairInput> {
    let (first, second) = (map.keyframes().get(&a)?, map.keyframes().get(&b)?);
    let camera_b = map.cameras().get(&second.camera?)?.camera;
    let matches = second.observations.iter().filter_map(|seen| {
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
    let seen = keyframe.observation_of(landmark)?;
    if seen.depth.is_some() {
        return PointEstimate::from_views(&[view(map, Se3::identity(), keyframe, seen)?]);
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
    let views: Option<Vec<View>> = earlier
        .into_iter()
        .map(|(_, k)| view(map, odometry(keyframe, k), k, k.observation_of(landmark)?))
        .collect();
    PointEstimate::from_views(&views?)
}

fn view(map: &Map, a_from_camera: Se3, keyframe: &Keyframe, seen: &Observation) -> Option<View> {
    Some(View {
        world_from_camera: a_from_camera,
        camera: map.cameras().get(&keyframe.camera?)?.camera,
        pixel: seen.pixel,
        sigma_px: seen.sigma_px,
        depth_m: seen.depth.map(|depth| (depth.depth_m, depth.sigma_m)),
    })
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

/// The pairs whose measurements make up the pose graph: consecutive keyframes of each client, then
/// those that see a place again, sorted.
#[must_use]
pub fn graph_pairs(map: &Map) -> Vec<(EntityId, EntityId)> {
    let mut pairs = Vec::new();
    for index in (0..).take(map.clients().len()) {
        let trajectory = map.trajectory(ClientIndex(index));
        pairs.extend(trajectory.windows(2).map(|pair| (pair[0].0, pair[1].0)));
    }
    pairs.extend(again(map));
    pairs
}

/// Keyframes that see again what keyframes saw that are not near in the trajectory, each with the one
/// that it shares most landmarks with. Pairs near each other share landmarks and errors, so that one of
/// them stands for all.
fn again(map: &Map) -> Vec<(EntityId, EntityId)> {
    let threshold = u32::try_from(map.policy().min_shared_landmarks.max(1)).unwrap_or(u32::MAX);
    let trajectories: Vec<Vec<EntityId>> = (0..)
        .take(map.clients().len())
        .map(|index| map.trajectory(ClientIndex(index)).into_iter().map(|(id, _)| id).collect())
        .collect();
    let place: std::collections::BTreeMap<EntityId, usize> = trajectories
        .iter()
        .flat_map(|trajectory| trajectory.iter().enumerate().map(|(place, &id)| (id, place)))
        .collect();
    let mut taken: BTreeSet<(EntityId, EntityId)> = BTreeSet::new();
    let mut pairs = Vec::new();
    for (client, trajectory) in trajectories.iter().enumerate() {
        for (at, &keyframe) in trajectory.iter().enumerate() {
            let is_elsewhere = |other: &EntityId| match other.client.0 as usize == client {
                true => place.get(other).is_some_and(|&p| p + NEAR_KEYFRAMES < at),
                false => (other.client.0 as usize) < client,
            };
            let seen = map.covisibility().neighbors(keyframe);
            let seen = seen.filter(|(other, shared)| *shared >= threshold && is_elsewhere(other));
            let Some((other, _)) = seen.max_by_key(|&(id, shared)| (shared, std::cmp::Reverse(id)))
            else {
                continue;
            };
            let cell = |id: EntityId| {
                let place = place.get(&id).copied().unwrap_or_default() / NEAR_KEYFRAMES;
                EntityId::new(id.client, i64::try_from(place).unwrap_or(i64::MAX))
            };
            if taken.insert((cell(other), cell(keyframe))) {
                pairs.push((other, keyframe));
            }
        }
    }
    pairs
}
