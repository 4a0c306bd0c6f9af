//! The ids that events touch, for watchers.
//!
//! No values are kept here; a watcher reads them from a snapshot later.

use std::collections::BTreeSet;

use crate::map::{Change, ClientIndex, EntityId, Map, Retired};

/// A watcher keeps this many ids, or as many as the map has entities, whichever is more. Beyond
/// that the reader gets the full state.
const LEAST_TOUCHED: usize = 10_000;

/// The ids that events touched. An id that is not in the snapshot was removed.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Touched {
    /// Cameras that are new or changed.
    pub cameras: BTreeSet<EntityId>,
    /// Keyframes that are new, changed or removed.
    pub keyframes: BTreeSet<EntityId>,
    /// Landmarks that are new, changed or removed.
    pub landmarks: BTreeSet<EntityId>,
    /// Constraints and priors that are new, switched off or on, or removed.
    pub constraints: BTreeSet<EntityId>,
    /// Clients that are new or whose keyframes changed.
    pub clients: BTreeSet<ClientIndex>,
    /// Whether ids cannot say what was removed: cameras, and all of a client.
    pub(crate) is_all: bool,
}

impl Touched {
    /// What `change` touches; `map` is the map before it.
    pub(crate) fn by(change: &Change, map: &Map) -> Self {
        let mut touched = Self::default();
        touched.add(change);
        if let Change::ClientOpened { name, .. } = change {
            let next = u32::try_from(map.clients().len()).unwrap_or(u32::MAX);
            touched.clients.insert(map.client_named(name).unwrap_or(ClientIndex(next)));
        } else if let Change::KeyframeRemoved { keyframe: id }
        | Change::KeyframeRetired { retired: Retired { keyframe: id, .. } } = change
        {
            touched.removed(*id, map);
        }
        touched.is_all = matches!(change, Change::MapTakenOut { .. });
        if change.changes_others() {
            let removed = touched.landmarks.iter();
            let others = removed.flat_map(|&id| map.duplicates().group(id)).collect::<Vec<_>>();
            touched.landmarks.extend(others);
        }
        touched
    }

    /// Adds the ids that `change` itself names. Its other effects need the map before it: which
    /// client opened a stream, and what was removed with a keyframe.
    pub(crate) fn add(&mut self, change: &Change) {
        match change {
            Change::Created { .. }
            | Change::ItemRepeated
            | Change::MapUpdated { .. }
            | Change::MapTakenOut { .. }
            | Change::ClientOpened { .. } => {}
            Change::MapMerged { merge } => {
                let at = |id: &EntityId| merge.id_of(*id);
                let content = &merge.content;
                self.clients.extend(merge.clients.iter().map(|client| client.index));
                self.cameras.extend(content.cameras().keys().map(at));
                self.keyframes.extend(content.keyframes().keys().map(at));
                self.landmarks.extend(content.landmarks().keys().map(at));
                self.constraints.extend(content.constraints().keys().map(at));
                self.constraints.extend(content.priors().keys().map(at));
                self.constraints.extend(merge.closures.iter().map(|&(id, _)| id));
            }
            Change::CameraSet { id, .. } => {
                self.cameras.insert(*id);
            }
            Change::KeyframeAdded { id, observations, landmarks, .. } => {
                self.keyframe(*id);
                self.landmarks.extend(landmarks.iter().map(|l| l.id));
                self.landmarks.extend(observations.iter().map(|o| o.landmark));
            }
            Change::LandmarksAdded { landmarks, .. } => {
                self.landmarks.extend(landmarks.iter().map(|l| l.id));
            }
            Change::ObservationsAdded { observations, .. } => {
                self.landmarks.extend(observations.iter().map(|o| o.landmark));
            }
            Change::ConstraintAdded { id, .. }
            | Change::PriorAdded { id, .. }
            | Change::ConstraintRevoked { id } => {
                self.constraints.insert(*id);
            }
            Change::LandmarksTriangulated { positions } => {
                self.landmarks.extend(positions.iter().map(|&(id, _)| id));
            }
            Change::SolveApplied { solve } => {
                solve.poses.iter().for_each(|&(id, _)| self.keyframe(id));
                self.landmarks(solve.landmarks.iter().map(|&(id, _)| id));
                self.cameras.extend(solve.cameras.iter().map(|&(id, _)| id));
                self.constraints.extend(solve.switched_off.iter().map(|&(id, _)| id));
                self.constraints.extend(&solve.switched_on);
            }
            Change::ObservationsRemoved { observations } => {
                self.landmarks.extend(observations.iter().map(|&(_, landmark)| landmark));
            }
            Change::LandmarksFused { kept, absorbed } => {
                self.landmarks.insert(*kept);
                self.landmarks.extend(absorbed);
            }
            Change::DuplicatesFound { comparisons } => {
                let pairs = comparisons.iter().flat_map(|comparison| &comparison.pairs);
                self.landmarks.extend(pairs.flat_map(|&(a, b)| [a, b]));
            }
            Change::PlacesSearched { closures, .. } => {
                self.constraints.extend(closures.iter().map(|&(id, _)| id));
            }
            Change::LandmarksRemoved { landmarks } | Change::DuplicatesSplit { landmarks, .. } => {
                self.landmarks.extend(landmarks);
            }
            Change::KeyframeRemoved { keyframe } => self.keyframe(*keyframe),
            Change::KeyframeRetired { retired } => {
                self.keyframe(retired.keyframe);
                self.landmarks.extend(&retired.landmarks);
                self.constraints.extend(&retired.revoked);
                self.constraints.extend(retired.constraints.iter().map(|&(id, _)| id));
                self.constraints.extend(retired.priors.iter().map(|&(id, _)| id));
            }
        }
    }

    /// Adds what the removal of a keyframe touches: its landmarks, constraints and priors.
    fn removed(&mut self, keyframe: EntityId, map: &Map) {
        if let Some(entity) = map.keyframes().get(&keyframe) {
            self.landmarks.extend(entity.observations.iter().map(|o| o.landmark));
        }
        self.constraints.extend(map.ties().of(keyframe));
    }

    /// How many ids it has.
    pub(crate) fn len(&self) -> usize {
        self.cameras.len()
            + self.keyframes.len()
            + self.landmarks.len()
            + self.constraints.len()
            + self.clients.len()
    }

    fn keyframe(&mut self, id: EntityId) {
        self.keyframes.insert(id);
        self.clients.insert(id.client);
    }

    /// Adds ids of landmarks, which rise and may be all that there are: a set is made of them in one pass.
    fn landmarks(&mut self, ids: impl Iterator<Item = EntityId>) {
        self.landmarks.append(&mut ids.collect());
    }

    /// Adds the ids of `other`, those of landmarks only `with_landmarks`.
    pub(crate) fn join(&mut self, other: &Self, with_landmarks: bool) {
        self.cameras.extend(&other.cameras);
        self.keyframes.extend(&other.keyframes);
        // Both sets in one pass, where that is less work than to insert each id.
        if with_landmarks && other.landmarks.len() > self.landmarks.len() / 8 {
            self.landmarks.append(&mut other.landmarks.clone());
        } else if with_landmarks {
            self.landmarks.extend(&other.landmarks);
        }
        self.constraints.extend(&other.constraints);
        self.clients.extend(&other.clients);
        self.is_all |= other.is_all;
    }
}

/// The size of a change that does not name all that it concerns: large.
const UNKNOWN_SIZE: usize = 1 << 16;

/// About how many entities a change concerns.
pub(crate) fn size_of_change(change: &Change) -> usize {
    match change {
        Change::KeyframeAdded { observations, landmarks, .. } => {
            observations.len() + landmarks.len()
        }
        Change::LandmarksAdded { landmarks, .. } => landmarks.len(),
        Change::ObservationsAdded { observations, .. } => observations.len(),
        Change::LandmarksTriangulated { positions } => positions.len(),
        Change::DuplicatesFound { comparisons } => {
            comparisons.iter().map(|comparison| comparison.pairs.len() + 1).sum()
        }
        Change::DuplicatesSplit { landmarks, .. } => landmarks.len(),
        Change::PlacesSearched { searches, .. } => searches.len(),
        Change::SolveApplied { solve } => {
            solve.poses.len() + solve.landmarks.len() + solve.switched_off.len()
        }
        // With all observations of the keyframes concerned, which the change does not name.
        Change::ObservationsRemoved { .. }
        | Change::KeyframeRemoved { .. }
        | Change::KeyframeRetired { .. }
        | Change::LandmarksFused { .. }
        | Change::LandmarksRemoved { .. }
        | Change::MapMerged { .. }
        | Change::MapTakenOut { .. } => UNKNOWN_SIZE,
        Change::Created { .. }
        | Change::ItemRepeated
        | Change::MapUpdated { .. }
        | Change::ClientOpened { .. }
        | Change::CameraSet { .. }
        | Change::ConstraintAdded { .. }
        | Change::PriorAdded { .. }
        | Change::ConstraintRevoked { .. } => 1,
    }
}

/// Most ids that a watcher of `map` keeps.
pub(crate) fn most_touched(map: &Map) -> usize {
    let constraints = map.constraints().len() + map.priors().len();
    let held = map.keyframes().len() + map.landmarks().len() + constraints;
    LEAST_TOUCHED.max(held + map.cameras().len() + map.clients().len())
}
