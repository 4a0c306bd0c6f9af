//! The fold of edits: observations that go, landmarks that go, landmarks that become one.
//!
//! The observations of a keyframe are one list behind an `Arc`: an edit writes each list once, however
//! many of its entries change. Covisibility, observers, references, counts and the list of landmarks
//! without observers follow one observation at a time. The result does not depend on the order of the
//! landmarks or observations in an event, except that of fused landmarks.

use std::collections::{BTreeMap, BTreeSet};

use super::super::usage::descriptor_bytes;
use super::super::{EntityId, Map, Observation};

/// What a keyframe sees of the landmarks that another one absorbs.
struct Absorbed {
    /// The first of them in the order of the event.
    first: EntityId,
    all: BTreeSet<EntityId>,
}

impl Map {
    /// Removes observations, each named as (keyframe, landmark).
    pub(super) fn remove_observations(
        &mut self,
        observations: impl Iterator<Item = (EntityId, EntityId)>,
    ) {
        let mut gone: BTreeMap<EntityId, BTreeSet<EntityId>> = BTreeMap::new();
        for (keyframe, landmark) in observations {
            gone.entry(keyframe).or_default().insert(landmark);
        }
        for (keyframe, landmarks) in gone {
            self.rewrite(keyframe, |seen| {
                (!landmarks.contains(&seen.landmark)).then(|| seen.clone())
            });
            landmarks.into_iter().for_each(|landmark| self.forget_observer(landmark, keyframe));
        }
    }

    /// Removes landmarks with their observations.
    pub(super) fn remove_landmarks(&mut self, ids: &[EntityId]) {
        let seen = ids.iter().filter_map(|&id| Some((id, self.parts.landmarks.get(&id)?)));
        let observations: Vec<(EntityId, EntityId)> = seen
            .flat_map(|(id, landmark)| {
                landmark.observers.iter().map(move |&keyframe| (keyframe, id))
            })
            .collect();
        self.remove_observations(observations.into_iter());
        ids.iter().for_each(|&id| self.drop_landmark(id));
    }

    /// Removes a landmark without observers.
    fn drop_landmark(&mut self, id: EntityId) {
        if let Some(landmark) = self.parts.landmarks.remove(&id) {
            self.parts.duplicates.remove(id);
            self.unseen.remove(&(landmark.added_revision, id));
        }
    }

    /// Moves the observations of `absorbed` to `kept`. Where a keyframe sees several of them, those of
    /// `kept` stay, otherwise those of the first in the order of `absorbed`. If `kept` has no position,
    /// it gets the first one that an absorbed landmark has; the same for its reference.
    pub(super) fn fuse(&mut self, kept: EntityId, absorbed: &[EntityId]) {
        let mut seeing: BTreeMap<EntityId, Absorbed> = BTreeMap::new();
        let (mut position, mut reference) = (None, None);
        for &id in absorbed {
            let Some(landmark) = self.parts.landmarks.get(&id) else { continue };
            position = position.or(landmark.position);
            reference = reference.or(landmark.reference);
            for &keyframe in &landmark.observers {
                let new = || Absorbed { first: id, all: BTreeSet::new() };
                seeing.entry(keyframe).or_insert_with(new).all.insert(id);
            }
        }
        let revision = self.parts.revision;
        if let Some(landmark) = self.parts.landmarks.get_mut(&kept) {
            if landmark.position.is_none() && position.is_some() {
                landmark.position = position;
                landmark.positioned_revision = revision;
            }
            // A reference is an observer: the absorbed landmark's becomes one below.
            landmark.reference = landmark.reference.or(reference);
        }
        for (keyframe, Absorbed { first, all }) in seeing {
            let known = self.parts.keyframes.get(&keyframe);
            let moves = known.is_some_and(|known| known.observation_of(kept).is_none());
            self.rewrite(keyframe, |seen| match seen.landmark {
                landmark if moves && landmark == first => {
                    Some(Observation { landmark: kept, ..seen.clone() })
                }
                landmark => (!all.contains(&landmark)).then(|| seen.clone()),
            });
            all.into_iter().for_each(|landmark| self.forget_observer(landmark, keyframe));
            if moves {
                self.observe(keyframe, std::iter::once(kept));
            }
        }
        for &id in absorbed {
            self.parts.duplicates.fuse(kept, id);
            self.drop_landmark(id);
        }
    }

    /// Replaces each observation of a keyframe by what `new` gives for it, or removes it. The observers
    /// of the landmarks are left to the caller.
    fn rewrite(&mut self, id: EntityId, new: impl Fn(&Observation) -> Option<Observation>) {
        let Some(keyframe) = self.parts.keyframes.get_mut(&id) else { return };
        let before = keyframe.observations.clone();
        keyframe.observations = before.iter().filter_map(new).collect();
        self.observation_count -= (before.len() - keyframe.observations.len()) as u64;
        self.descriptor_bytes -=
            descriptor_bytes(&before) - descriptor_bytes(&keyframe.observations);
    }

    /// A keyframe no longer sees a landmark.
    pub(super) fn forget_observer(&mut self, landmark_id: EntityId, keyframe: EntityId) {
        let Some(landmark) = self.parts.landmarks.get_mut(&landmark_id) else { return };
        let Ok(index) = landmark.observers.binary_search(&keyframe) else { return };
        landmark.observers.remove(index);
        self.covisibility.forget(landmark_id, &landmark.observers, keyframe);
        if landmark.observers.is_empty() {
            self.unseen.insert((landmark.added_revision, landmark_id), ());
        }
        if landmark.reference == Some(keyframe) {
            landmark.reference = landmark.observers.first().copied();
        }
    }
}
