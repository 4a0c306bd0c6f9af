//! Chooses the part of the map for a local bundle adjustment.
//!
//! Free are one keyframe, or several that an edit concerns, and those that share most landmarks with them, by
//! count, then the more recent, then the lower id; and those that see nothing beside one of these. The
//! window's landmarks are those that the free keyframes see; the other keyframes that see most of them
//! (`rim`) are held fixed and so tie the window to the rest of the map. A keyframe that the map's gauge holds
//! (`gauge`) is fixed too, wherever it is in the window. If nothing would be fixed, the keyframe that arrived
//! first is; the scale of a monocular window is then still free, and the damping of the solver holds it.
//!
//! Where no odometry ties keyframes, a window is twice as large and reaches past the keyframes that share
//! landmarks with the newest one. Views alone measure the bend of a way over the length of a window poorly. A
//! window that is held by keyframes just behind it continues their bend and overshoots: along a street that
//! every camera sees 10 m of, windows of the twenty keyframes in it went off by five times as much each 50 m,
//! however precise the views.
//!
//! If two rays meet at less than about 1°, noise determines the depth of a point: a window would move
//! it far away or behind a camera, and neither later keyframes nor a solve of the whole map would
//! correct it. Such a landmark is left out of local bundle adjustment until it has more parallax; it
//! keeps the position that was sent and follows its reference keyframe. A measured depth alone is
//! enough. Whole-map solves include all landmarks.

use std::cmp::Reverse;
use std::collections::{BTreeMap, BTreeSet};

use covis_solvers::geometry::Se3;
use nalgebra::Vector3;

use super::rim::rim;
use super::{ClientIndex, EntityId, Keyframe, Landmark, Map, Prior};

/// How many times as many keyframes a window has where no odometry ties them.
const FARTHER: usize = 2;

/// Cosine of the least angle, 1°, between the ray of the first observer and another one.
const MIN_PARALLAX_COS: f64 = 0.999_847_695_156_391_3;

/// A part of the map to be optimized; every list is sorted.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Window {
    /// Keyframes that may move.
    pub free: Vec<EntityId>,
    /// Keyframes that are held.
    pub fixed: Vec<EntityId>,
    /// Landmarks that may move: with a position, and seen from far enough apart or with a depth.
    pub landmarks: Vec<EntityId>,
    /// Keyframes that wait for another window and go with the keyframe before them.
    pub carried: BTreeSet<EntityId>,
}

/// The window around keyframes, all of which may move; empty when the map holds none of them.
///
/// The keyframes `waiting` have had no solve of their own. Those at the end of a trajectory are where odometry
/// puts them: they are in no window but their own, so that a burst is solved by the windows that the same
/// keyframes one by one would have.
#[must_use]
pub fn choose_window(map: &Map, keyframes: &[EntityId], waiting: &BTreeSet<EntityId>) -> Window {
    let held = keyframes.iter().copied().filter(|id| map.keyframes().contains_key(id));
    let mut free: BTreeSet<EntityId> = held.collect();
    if free.is_empty() {
        return Window::default();
    }
    let carried: BTreeSet<EntityId> = tails(map, waiting).difference(&free).copied().collect();
    let room = map.policy().window_keyframes;
    add_neighbors(map, &carried, room, &mut free);
    match map.policy().odometry {
        true => add_blind(map, &carried, &mut free),
        false => while add_neighbors(map, &carried, FARTHER * room, &mut free) {},
    }

    let mut seen: BTreeSet<EntityId> = free
        .iter()
        .filter_map(|id| map.keyframes().get(id))
        .flat_map(|k| k.observations.iter().map(|o| o.landmark))
        .collect();
    let groups: Vec<EntityId> = seen.iter().flat_map(|&id| map.duplicates().group(id)).collect();
    seen.extend(groups);
    let landmarks: Vec<EntityId> =
        seen.into_iter().filter(|&id| is_usable(map, id) && may_move(map, id)).collect();
    let mut fixed = rim(map, &free, &landmarks);
    if map.policy().odometry {
        fixed.extend(map.beside(&free));
    }
    fixed.retain(|id| !carried.contains(id));
    let is_pose_prior = |id| matches!(map.priors().get(&id), Some(Prior::Pose { .. }));
    let has_pose_prior = free.iter().any(|&id| map.ties().of(id).any(is_pose_prior));
    for id in map.held_among(map.policy().gauge, &free) {
        free.remove(&id);
        fixed.insert(id);
    }
    let arrival = |id: EntityId| map.keyframes().get(&id).map_or(0, |k| k.added_revision);
    if fixed.is_empty()
        && !has_pose_prior
        && let Some(&oldest) = free.iter().min_by_key(|&&id| (arrival(id), id))
    {
        free.remove(&oldest);
        fixed.insert(oldest);
    }
    let (free, fixed) = (free.into_iter().collect(), fixed.into_iter().collect());
    Window { free, fixed, landmarks, carried }
}

/// Adds the keyframes that share most with `free` until there are `room`. Returns whether it added any.
fn add_neighbors(
    map: &Map,
    carried: &BTreeSet<EntityId>,
    room: usize,
    free: &mut BTreeSet<EntityId>,
) -> bool {
    let missing = room.saturating_sub(free.len());
    if missing == 0 {
        return false;
    }
    let mut shared: BTreeMap<EntityId, u32> = BTreeMap::new();
    let sharing = free.iter().flat_map(|&id| map.covisibility().neighbors(id));
    let again = free.iter().flat_map(|&id| observers_of_duplicates(map, id)).map(|id| (id, 1));
    for (id, count) in sharing.chain(again) {
        if !free.contains(&id) && !carried.contains(&id) {
            *shared.entry(id).or_default() += count;
        }
    }
    let time = |id: EntityId| map.keyframes().get(&id).map_or(i64::MIN, |k| k.capture_time_ns);
    let mut neighbors: Vec<(EntityId, u32)> = shared.into_iter().collect();
    neighbors.sort_unstable_by_key(|&(id, shared)| (Reverse(shared), Reverse(time(id)), id));
    neighbors.truncate(missing);
    free.extend(neighbors.iter().map(|&(id, _)| id));
    !neighbors.is_empty()
}

/// Adds the keyframes beside `free` in their trajectories that see nothing of the map, as many as the window
/// takes: only odometry ties them, and held they would tear the trajectory.
fn add_blind(map: &Map, carried: &BTreeSet<EntityId>, free: &mut BTreeSet<EntityId>) {
    let is_blind = |id: &EntityId| {
        let keyframe = map.keyframes().get(id);
        keyframe.is_some_and(|k| !k.observations.iter().any(|o| is_usable(map, o.landmark)))
    };
    let room = map.policy().window_keyframes;
    loop {
        let mut blind = map.beside(free);
        blind.retain(|id| is_blind(id) && !carried.contains(id));
        if blind.is_empty() || free.len() + blind.len() > room {
            return;
        }
        free.extend(blind);
    }
}

/// The keyframes of `waiting` behind which, in their trajectories, there are only others of them and keyframes
/// without views; and those of the latter that are behind one of them.
fn tails(map: &Map, waiting: &BTreeSet<EntityId>) -> BTreeSet<EntityId> {
    let clients: BTreeSet<ClientIndex> = waiting.iter().map(|id| id.client).collect();
    let mut tails = BTreeSet::new();
    for client in clients {
        let mut next = map.last_keyframe(client);
        let mut without_views = Vec::new();
        while let Some(id) = next {
            if waiting.contains(&id) {
                tails.extend(without_views.drain(..));
                tails.insert(id);
            } else if !map.sees(id) {
                without_views.push(id);
            } else {
                break;
            }
            next = map.keyframe_before(id).map(|(before, _)| before);
        }
    }
    tails
}

/// The keyframes that see duplicates of what `keyframe` sees, once for each.
fn observers_of_duplicates(map: &Map, keyframe: EntityId) -> Vec<EntityId> {
    let seen = map.keyframes().get(&keyframe).map(|k| &*k.observations).unwrap_or_default();
    let duplicates = seen.iter().flat_map(|seen| {
        let group = map.duplicates().group(seen.landmark);
        group.into_iter().filter(|&id| id != seen.landmark)
    });
    let duplicates = duplicates.filter_map(|id| map.landmarks().get(&id));
    duplicates.flat_map(|landmark| landmark.observers.iter().copied()).collect()
}

/// Whether a landmark has a position and enough observations to estimate it, those of its duplicates
/// too.
pub(super) fn is_usable(map: &Map, id: EntityId) -> bool {
    let Some(landmark) = map.landmarks().get(&id) else { return false };
    let is_seen = landmark.observers.len() >= 2
        || has_depth(map, id, landmark)
        || (!landmark.observers.is_empty() && map.duplicates().has(id));
    landmark.position.is_some() && is_seen
}

/// Whether a local solve may move a landmark.
fn may_move(map: &Map, id: EntityId) -> bool {
    let Some(landmark) = map.landmarks().get(&id) else { return false };
    let pose = |_, keyframe: &Keyframe| keyframe.world_from_camera;
    landmark.position.is_some_and(|position| is_well_placed(map, id, landmark, &position, pose))
}

/// Whether a landmark of the map at `position` lies in front of all its observers and is seen from far
/// enough apart, or has a measured depth. `pose` gives where each observer is.
pub(super) fn is_well_placed(
    map: &Map,
    id: EntityId,
    landmark: &Landmark,
    position: &Vector3<f64>,
    pose: impl Fn(EntityId, &Keyframe) -> Se3,
) -> bool {
    let mut first: Option<Vector3<f64>> = None;
    let (mut is_in_front, mut has_parallax) = (true, false);
    let observers = landmark.observers.iter();
    let observers = observers.filter_map(|id| Some((*id, map.keyframes().get(id)?)));
    for view in observers.flat_map(|(id, keyframe)| map.views_at(keyframe, pose(id, keyframe))) {
        let Some(seen) = view.observations.of(id) else { continue };
        if seen.depth.is_some_and(|depth| depth.places()) {
            return true;
        }
        is_in_front &= view.world_from_camera.inverse_transform(position).z > 0.0;
        if !is_in_front {
            // A later view may have a depth.
            continue;
        }
        let ray = (position - view.world_from_camera.translation).normalize();
        match &first {
            None => first = Some(ray),
            Some(first) => has_parallax |= first.dot(&ray) < MIN_PARALLAX_COS,
        }
    }
    is_in_front && has_parallax
}

/// Whether an observer measured how far the landmark is.
fn has_depth(map: &Map, id: EntityId, landmark: &Landmark) -> bool {
    landmark.observers.iter().any(|keyframe| {
        let keyframe = map.keyframes().get(keyframe);
        let seen = keyframe.and_then(|k| k.observation_of(id));
        seen.and_then(|seen| seen.depth).is_some_and(|depth| depth.places())
    })
}
