//! The index of a map's places, kept so that a search need not index the map again.
//!
//! It is a function of what the map holds and lost with the process: it is made when a place is first
//! searched. The engine tells which keyframes a change concerns ([`Places::note`]); they are indexed
//! again before the next search. It is shared by the searches and the calls of one map, blocks its
//! thread and uses nothing of the engine.

use std::collections::BTreeMap;
use std::sync::{Mutex, MutexGuard, PoisonError};

use crate::loop_closing::{View, indexed, not_indexed};
use crate::map::{Change, EntityId, Map, Observations, PlaceRefusal, PlaceSearch};
use crate::place::{Candidate, PlaceError, PlaceIndex};

/// The index of a map's places.
#[derive(Debug, Default)]
pub(super) struct Places(Mutex<Option<Known>>);

#[derive(Debug, Default)]
struct Known {
    index: PlaceIndex,
    /// What each keyframe was indexed with, or refused with a reason.
    indexed: BTreeMap<EntityId, Entry>,
    /// Keyframes whose observations changed since they were indexed, with the revision.
    changed: BTreeMap<EntityId, i64>,
}

#[derive(Debug)]
struct Entry {
    observations: Observations,
    refusal: Option<PlaceRefusal>,
}

impl Known {
    /// All keyframes of a map, in the order of their age.
    fn of(map: &Map) -> Self {
        let mut known = Self::default();
        let all = map.keyframes().iter().map(|(&id, keyframe)| (id, keyframe.added_revision));
        known.changed = all.collect();
        known.update(map);
        known
    }

    /// Indexes anew what has changed up to the map's revision.
    fn update(&mut self, map: &Map) {
        let age = |id: &EntityId| map.keyframes().get(id).map_or(0, |known| known.added_revision);
        let revision = map.revision();
        let due = self.changed.extract_if(.., |_, changed| *changed <= revision);
        let mut due: Vec<EntityId> = due.map(|(id, _)| id).collect();
        // The index is a function of its calls: the same after a restart.
        due.sort_by_key(|id| (age(id), *id));
        for id in due {
            self.index.remove(id);
            self.indexed.remove(&id);
            let Some(keyframe) = map.keyframes().get(&id) else { continue };
            let (_, features) = indexed(keyframe);
            if features.is_empty() {
                continue;
            }
            let added = self.index.add(id, keyframe.capture_time_ns, &features);
            let refusal = added.err().map(|error| not_indexed(&error));
            let observations = keyframe.observations.clone();
            self.indexed.insert(id, Entry { observations, refusal });
        }
    }

    /// Whether the index has what the keyframe sees in this map.
    fn has(&self, map: &Map, id: EntityId) -> bool {
        let entry = self.indexed.get(&id).filter(|entry| entry.refusal.is_none());
        let seen = map.keyframes().get(&id).map(|keyframe| &keyframe.observations);
        entry.zip(seen).is_some_and(|(entry, seen)| entry.observations.is_same(seen))
    }
}

impl Places {
    fn known(&self) -> MutexGuard<'_, Option<Known>> {
        // An index that a panic left is made anew: the lock is poisoned then.
        self.0.lock().unwrap_or_else(|poisoned| {
            self.0.clear_poison();
            let mut known = PoisonError::into_inner(poisoned);
            *known = None;
            known
        })
    }

    /// Takes in which keyframes the next change of the map concerns, which makes `revision`; `map` is the
    /// map before it.
    pub(super) fn note(&self, map: &Map, change: &Change, revision: i64) {
        let mut known = self.known();
        let Some(held) = &mut *known else { return };
        let observers = |id: &EntityId| {
            let landmark = map.landmarks().get(id);
            landmark.into_iter().flat_map(|landmark| landmark.observers.iter().copied())
        };
        let concerned: Vec<EntityId> = match change {
            Change::KeyframeAdded { id, .. }
            | Change::ObservationsAdded { keyframe: id, .. }
            | Change::KeyframeRemoved { keyframe: id } => vec![*id],
            Change::KeyframeRetired { retired } => {
                let seen = retired.landmarks.iter().flat_map(observers);
                seen.chain([retired.keyframe]).collect()
            }
            Change::ObservationsRemoved { observations } => {
                observations.iter().map(|&(keyframe, _)| keyframe).collect()
            }
            Change::LandmarksFused { absorbed, .. } => {
                absorbed.iter().flat_map(observers).collect()
            }
            Change::LandmarksRemoved { landmarks } => {
                landmarks.iter().flat_map(observers).collect()
            }
            Change::MapUpdated { policy: Some(policy), .. } | Change::PolicySet { policy } => {
                if !policy.place_recognition {
                    *known = None;
                }
                return;
            }
            Change::Created { .. }
            | Change::ItemRepeated
            | Change::MapUpdated { .. }
            | Change::ClientOpened { .. }
            | Change::CameraSet { .. }
            | Change::LandmarksAdded { .. }
            | Change::ConstraintAdded { .. }
            | Change::PriorAdded { .. }
            | Change::ConstraintRevoked { .. }
            | Change::DuplicatesFound { .. }
            | Change::DuplicatesSplit { .. }
            | Change::PlacesSearched { .. }
            | Change::LandmarksTriangulated { .. }
            | Change::SolveApplied { .. } => return,
        };
        held.changed.extend(concerned.into_iter().map(|id| (id, revision)));
    }

    /// The candidates for the place of a view, best first, none of those that `is_excluded` names.
    ///
    /// # Errors
    /// [`PlaceError`] where the view has more descriptors than a keyframe may have.
    pub(super) fn candidates(
        &self,
        map: &Map,
        view: &View<'_>,
        is_excluded: impl Fn(EntityId) -> bool,
    ) -> Result<Vec<Candidate>, PlaceError> {
        let (_, features) = view.searchable();
        if features.is_empty() {
            return Ok(Vec::new());
        }
        let mut known = self.known();
        let known = known.get_or_insert_with(|| Known::of(map));
        known.update(map);
        // What changed after this map, or was indexed from a later one, is no candidate.
        let is_out = |id| is_excluded(id) || !known.has(map, id);
        known.index.query(&features, PlaceSearch::MOST_CANDIDATES, is_out)
    }

    /// Why the index does not hold a keyframe, if it was refused.
    pub(super) fn refusal(&self, keyframe: EntityId) -> Option<PlaceRefusal> {
        let known = self.known();
        known.as_ref().and_then(|known| known.indexed.get(&keyframe)?.refusal.clone())
    }
}
