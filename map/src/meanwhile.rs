//! What became of a problem's variables while a solver moved them.
//!
//! Windows are solved beside a pose graph or an adjustment, which takes longer. A keyframe that one of them
//! moved meanwhile keeps its place among those that it was solved with and goes along with the motion that
//! the longer solve found for it, T_new = found · start⁻¹ · T_now; its landmarks go with it. What nothing
//! moved gets what was found, to the bit. A window that others overtook leaves what they moved to them.

use std::collections::{BTreeMap, HashMap};

use covis_solvers::geometry::{LieGroup, Se3};
use nalgebra::Vector3;

use super::{EntityId, Map, SolveKind, Solved};

/// Landmarks with where they are.
type Positions = Vec<(EntityId, Vector3<f64>)>;

/// The new poses and landmarks of a solve in the map as it is now, each by rising id. What has left the map, or
/// came after the solve began, is left out.
pub(super) fn caught_up(
    map: &Map,
    solved: Solved<'_>,
    kind: SolveKind,
    start_revision: i64,
) -> (BTreeMap<EntityId, Se3>, Positions) {
    let keyframes = map.keyframes();
    let yields = kind == SolveKind::LocalBundle;
    let mut motions: HashMap<EntityId, Se3> = HashMap::new();
    let mut poses = BTreeMap::new();
    for (id, start, found) in solved.poses() {
        let known = keyframes.get(&id).filter(|known| known.added_revision <= start_revision);
        let Some(now) = known.map(|known| known.world_from_camera) else { continue };
        if now == start {
            poses.insert(id, found);
        } else if !yields {
            poses.insert(id, found.compose(&start.inverse()).compose(&now));
        }
        if !yields {
            motions.insert(id, found.compose(&start.inverse()));
        }
    }
    let new_position = |(id, start, found): (EntityId, Vector3<f64>, Vector3<f64>)| {
        let known = map.landmarks().get(&id)?;
        let Some(now) = known.position.filter(|&now| now != start) else { return Some(found) };
        let motion = motions.get(&known.reference?);
        (!yields).then(|| motion.map_or(now, |motion| motion.transform(&now)))
    };
    // Duplicates are one point, which moves as the first of them that the map still has.
    let mut landmarks = Vec::new();
    for (ids, start, found) in solved.landmarks() {
        let known = |id: &&EntityId| {
            let known = map.landmarks().get(id);
            known.is_some_and(|known| known.added_revision <= start_revision)
        };
        let mut ids = ids.iter().filter(known).copied();
        if let Some(first) = ids.next()
            && let Some(position) = new_position((first, start, found))
        {
            landmarks.push((first, position));
            landmarks.extend(ids.map(|id| (id, position)));
        }
    }
    landmarks.sort_unstable_by_key(|&(id, _)| id);
    (poses, landmarks)
}
