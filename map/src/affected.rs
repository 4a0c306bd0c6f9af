//! What an edit asks to be solved again.
//!
//! Removed measurements, fused landmarks and new intrinsics leave the estimates around them where the
//! old measurements placed them: the keyframes concerned get a local bundle adjustment. A loop closure
//! or prior that counted and goes asks for a pose graph, which judges the others again. Computed from
//! the map before the change; nothing is solved or changed here.

use std::collections::BTreeSet;

use super::{Change, ConstraintKind, EntityId, Map};

/// What is to be solved after an edit.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Affected {
    /// Whether the pose graph is.
    pub graph: bool,
    /// The keyframes that are, oldest first.
    pub keyframes: Vec<EntityId>,
}

impl Affected {
    /// Most keyframes that an edit asks to be solved again, the newest ones. An edit that concerns more
    /// needs an optimization of the whole map, and hundreds of windows would delay those of new
    /// keyframes.
    pub const MOST_KEYFRAMES: usize = 64;
}

/// What `change` asks to be solved again, if a client edits the map with it; `map` is the map before it.
#[must_use]
pub fn affected(map: &Map, change: &Change) -> Option<Affected> {
    let observers = |id: &EntityId| {
        let landmark = map.landmarks().get(id);
        landmark.into_iter().flat_map(|landmark| landmark.observers.iter().copied())
    };
    let (graph, keyframes): (bool, BTreeSet<EntityId>) = match change {
        Change::ConstraintRevoked { id } => (shapes_graph(map, *id), BTreeSet::new()),
        Change::ObservationsRemoved { observations } => {
            (false, observations.iter().map(|&(keyframe, _)| keyframe).collect())
        }
        Change::LandmarksFused { kept, absorbed } => {
            (false, absorbed.iter().chain([kept]).flat_map(observers).collect())
        }
        Change::LandmarksRemoved { landmarks } => {
            (false, landmarks.iter().flat_map(observers).collect())
        }
        Change::KeyframeRemoved { keyframe } => {
            let sharing = map.covisibility().neighbors(*keyframe).map(|(id, _)| id);
            let graph = map.ties().of(*keyframe).any(|id| shapes_graph(map, id));
            (graph, map.tied(*keyframe).chain(sharing).collect())
        }
        Change::CameraSet { id, .. } if map.cameras().contains_key(id) => {
            (false, map.views_of_camera(*id).map(|(keyframe, _)| keyframe).collect())
        }
        Change::Created { .. }
        | Change::ClientOpened { .. }
        | Change::CameraSet { .. }
        | Change::KeyframeAdded { .. }
        | Change::LandmarksAdded { .. }
        | Change::ObservationsAdded { .. }
        | Change::ConstraintAdded { .. }
        | Change::PriorAdded { .. }
        | Change::LandmarksTriangulated { .. }
        | Change::DuplicatesFound { .. }
        | Change::DuplicatesSplit { .. }
        | Change::PlacesSearched { .. }
        | Change::SolveApplied { .. }
        | Change::KeyframeRetired { .. }
        | Change::MapMerged { .. }
        | Change::MapTakenOut { .. }
        | Change::ItemRepeated
        | Change::MapUpdated { .. } => return None,
    };
    let age = |id: &EntityId| map.keyframes().get(id).map_or(0, |known| known.added_revision);
    let mut keyframes: Vec<EntityId> = keyframes.into_iter().collect();
    keyframes.sort_unstable_by_key(|id| (age(id), *id));
    let first = keyframes.len().saturating_sub(Affected::MOST_KEYFRAMES);
    Some(Affected { graph, keyframes: keyframes.split_off(first) })
}

/// Whether a constraint is a loop closure or a prior, and counts.
fn shapes_graph(map: &Map, id: EntityId) -> bool {
    let closure = map.active_constraint(id).filter(|c| c.kind == ConstraintKind::LoopClosure);
    closure.is_some() || map.active_prior(id).is_some()
}
