//! What holds a part of the map in its place: the keyframes around it.

use std::cmp::Reverse;
use std::collections::{BTreeMap, BTreeSet};

use super::{EntityId, Map};

/// Most keyframes that hold a part, for each free one. A place that a robot visits again and again has ever
/// more, which say the same.
const HELD_FOR_EACH: usize = 4;

/// Least keyframes that may hold a part.
const LEAST_HELD: usize = 40;

/// The keyframes around `free` that see most of `landmarks`, those of equal count by id.
pub(super) fn rim(
    map: &Map,
    free: &BTreeSet<EntityId>,
    landmarks: &[EntityId],
) -> BTreeSet<EntityId> {
    let mut shared: BTreeMap<EntityId, u32> = BTreeMap::new();
    for landmark in landmarks.iter().filter_map(|id| map.landmarks().get(id)) {
        for &observer in landmark.observers.iter().filter(|id| !free.contains(id)) {
            *shared.entry(observer).or_default() += 1;
        }
    }
    let most = (HELD_FOR_EACH * free.len()).max(LEAST_HELD);
    let mut around: Vec<(EntityId, u32)> = shared.into_iter().collect();
    around.sort_unstable_by_key(|&(id, shared)| (Reverse(shared), id));
    around.truncate(most);
    around.into_iter().map(|(id, _)| id).collect()
}
