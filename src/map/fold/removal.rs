//! The parts of the fold that remove entities from the map.
//!
//! A landmark whose reference keyframe is removed gets its lowest remaining observer as reference. A
//! landmark that lost all observers stays until it is removed itself.

use super::super::ceilings::descriptor_bytes;
use super::super::digest::Content;
use super::super::{EntityId, Map, Retired};
use super::insert_sorted;

impl Map {
    pub(super) fn remove_observation(&mut self, keyframe_id: EntityId, landmark_id: EntityId) {
        let Some(keyframe) = self.keyframes.get_mut(&keyframe_id) else { return };
        let before = keyframe.observations.len();
        let described = descriptor_bytes(&keyframe.observations);
        keyframe.observations =
            keyframe.observations.iter().filter(|o| o.landmark != landmark_id).cloned().collect();
        let removed = before - keyframe.observations.len();
        self.descriptor_bytes -= described - descriptor_bytes(&keyframe.observations);
        if removed > 0 {
            self.observation_count -= removed as u64;
            self.forget_observer(landmark_id, keyframe_id);
        }
    }

    pub(super) fn remove_landmark(&mut self, id: EntityId) {
        let observers = self.landmarks.get(&id).map(|l| l.observers.clone()).unwrap_or_default();
        for keyframe in observers {
            self.remove_observation(keyframe, id);
        }
        self.drop_landmark(id);
    }

    /// Removes a landmark without observers.
    fn drop_landmark(&mut self, id: EntityId) {
        if let Some(landmark) = self.landmarks.remove(&id) {
            self.unseen.remove(&(landmark.added_revision, id));
        }
    }

    pub(super) fn remove_keyframe(&mut self, id: EntityId) {
        let Some(keyframe) = self.keyframes.remove(&id) else { return };
        self.observation_count -= keyframe.observations.len() as u64;
        self.descriptor_bytes -= descriptor_bytes(&keyframe.observations);
        self.by_age.remove(&keyframe.added_revision);
        for observation in keyframe.observations.iter() {
            self.forget_observer(observation.landmark, id);
        }
        self.contents.remove(&(Content::Keyframe, id));
        for tie in self.ties.of(id).collect::<Vec<_>>() {
            self.revoke(tie);
        }
    }

    pub(super) fn revoke(&mut self, id: EntityId) {
        if let Some(constraint) = self.constraints.remove(&id) {
            self.ties.remove(constraint.keyframe_i, id);
            self.ties.remove(constraint.keyframe_j, id);
        }
        if let Some(prior) = self.priors.remove(&id) {
            self.ties.remove(prior.keyframe(), id);
        }
        self.switched_off.remove(&id);
        self.contents.remove(&(Content::Constraint, id));
    }

    pub(super) fn retire(&mut self, retired: &Retired) {
        self.remove_keyframe(retired.keyframe);
        retired.landmarks.iter().for_each(|&id| self.remove_landmark(id));
        retired.revoked.iter().for_each(|&id| self.revoke(id));
        retired
            .constraints
            .iter()
            .for_each(|&(id, constraint)| self.add_constraint(id, constraint));
        retired.priors.iter().for_each(|&(id, prior)| self.add_prior(id, prior));
    }

    /// Moves the observations of `absorbed` to `kept`; where a keyframe sees both, that of `kept`
    /// stays. If `kept` has no position, it gets the first one that an absorbed landmark has.
    pub(super) fn fuse(&mut self, kept: EntityId, absorbed: &[EntityId]) {
        for &from in absorbed {
            let Some(landmark) = self.landmarks.get(&from) else { continue };
            let (observers, position) = (landmark.observers.clone(), landmark.position);
            for keyframe in observers {
                self.rename_observation(keyframe, from, kept);
            }
            self.drop_landmark(from);
            let revision = self.revision;
            if let (Some(landmark), Some(position)) = (self.landmarks.get_mut(&kept), position)
                && landmark.position.is_none()
            {
                landmark.position = Some(position);
                landmark.positioned_revision = revision;
            }
        }
    }

    fn rename_observation(&mut self, keyframe_id: EntityId, from: EntityId, to: EntityId) {
        let Some(keyframe) = self.keyframes.get_mut(&keyframe_id) else { return };
        if keyframe.observation_of(to).is_some() {
            self.remove_observation(keyframe_id, from);
            return;
        }
        let mut observations = keyframe.observations.to_vec();
        observations.iter_mut().filter(|o| o.landmark == from).for_each(|o| o.landmark = to);
        keyframe.observations = observations.into();
        self.forget_observer(from, keyframe_id);
        let Self { landmarks, keyframes, unseen, covisibility, .. } = self;
        if let Some(landmark) = landmarks.get_mut(&to) {
            let age = |id: EntityId| keyframes.get(&id).map_or(0, |known| known.added_revision);
            let mut sharing = Vec::new();
            covisibility.observe(to, &landmark.observers, keyframe_id, age, &mut sharing);
            covisibility.add(keyframe_id, &mut sharing);
            unseen.remove(&(landmark.added_revision, to));
            insert_sorted(&mut landmark.observers, keyframe_id);
            landmark.reference.get_or_insert(keyframe_id);
        }
    }

    fn forget_observer(&mut self, landmark_id: EntityId, keyframe: EntityId) {
        let Some(landmark) = self.landmarks.get_mut(&landmark_id) else { return };
        let Ok(place) = landmark.observers.binary_search(&keyframe) else { return };
        landmark.observers.remove(place);
        self.covisibility.forget(landmark_id, &landmark.observers, keyframe);
        if landmark.observers.is_empty() {
            self.unseen.insert((landmark.added_revision, landmark_id), ());
        }
        if landmark.reference == Some(keyframe) {
            landmark.reference = landmark.observers.first().copied();
        }
    }
}
