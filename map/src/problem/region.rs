//! The part of a map that is adjusted after closures: what they moved, held by what is around it.

use std::collections::BTreeSet;

use super::{MapProblem, local_problem};
use crate::rim::rim;
use crate::window::is_usable;
use crate::{EntityId, Map, Window};

/// Bundle adjustment of `free` keyframes and all that they see; the keyframes that share most with them are
/// held. `None` where most of the map is free: the whole costs little more, and has no rim.
#[must_use]
pub fn region_problem(map: &Map, free: &BTreeSet<EntityId>) -> Option<MapProblem> {
    let known = free.iter().copied().filter(|id| map.keyframes().contains_key(id));
    let mut free: BTreeSet<EntityId> = known.collect();
    if 2 * free.len() > map.keyframes().len() {
        return None;
    }
    let views = free.iter().filter_map(|id| map.keyframes().get(id));
    let seen: BTreeSet<EntityId> =
        views.flat_map(|k| k.observations.iter().map(|seen| seen.landmark)).collect();
    let groups: Vec<EntityId> = seen.iter().flat_map(|&id| map.duplicates().group(id)).collect();
    let landmarks: BTreeSet<EntityId> = seen.into_iter().chain(groups).collect();
    let landmarks: Vec<EntityId> = landmarks.into_iter().filter(|&id| is_usable(map, id)).collect();
    let mut fixed = rim(map, &free, &landmarks);
    if map.policy().odometry {
        fixed.extend(map.beside(&free));
    }
    // A closure ties what shares no landmark.
    let tied: Vec<EntityId> = free.iter().flat_map(|&id| map.tied(id)).collect();
    fixed.extend(tied.into_iter().filter(|id| !free.contains(id)));
    for id in map.held_among(map.policy().gauge, &free) {
        free.remove(&id);
        fixed.insert(id);
    }
    if fixed.is_empty() {
        return None;
    }
    let (free, fixed) = (free.into_iter().collect(), fixed.into_iter().collect());
    let window = Window { free, fixed, landmarks, carried: BTreeSet::new() };
    Some(local_problem(map, &window))
}
