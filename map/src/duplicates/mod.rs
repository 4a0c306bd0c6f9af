//! Landmarks that are one point of the scene: pairs that were found where a loop closure joins two places.
//!
//! A frontend that comes back gives new ids to what it saw before. The landmarks stay in the map under
//! their ids, so that its next keyframes may observe either; bundle adjustment gives the landmarks of a
//! group one position. Each pair names the closure that it was found by: if that turns out to be false,
//! its pairs are split again. Relative poses of keyframes are measured without these pairs, so that no
//! closure is judged by what it has joined itself. `search` finds pairs; nothing here estimates.

mod search;

use std::collections::BTreeSet;

use super::{ConstraintKind, EntityId, Map, SharedMap};

pub use search::find_duplicates;

/// The pairs of a map.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Duplicates {
    /// Each pair in both orders; `None` where the closure left with a keyframe that made room.
    found_by: SharedMap<(EntityId, EntityId), Option<EntityId>>,
    /// The loop closures whose places were compared.
    compared: BTreeSet<EntityId>,
}

/// What a comparison of the places that a loop closure joins found.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Comparison {
    /// The closure.
    pub closure: EntityId,
    /// Pairs of landmarks that are one point.
    pub pairs: Vec<(EntityId, EntityId)>,
}

/// A pair of landmarks, the lower id first, and the closure by which it was found.
pub type DuplicatePair = (EntityId, EntityId, Option<EntityId>);

impl Duplicates {
    /// Adds pairs and compared closures, from a snapshot.
    pub fn extend(
        &mut self,
        pairs: impl IntoIterator<Item = DuplicatePair>,
        compared: impl IntoIterator<Item = EntityId>,
    ) {
        pairs.into_iter().for_each(|(a, b, closure)| self.link(a, b, closure));
        self.compared.extend(compared);
    }

    /// Whether there is neither a pair nor a compared closure.
    pub fn is_empty(&self) -> bool {
        self.found_by.is_empty() && self.compared.is_empty()
    }

    /// How many pairs there are.
    pub fn len(&self) -> usize {
        self.found_by.len() / 2
    }

    /// The pairs, by id.
    pub fn pairs(&self) -> impl Iterator<Item = DuplicatePair> + '_ {
        let pairs = self.pairs_from((EntityId::MIN, EntityId::MIN));
        pairs.map(|(&(a, b), &closure)| (a, b, closure))
    }

    /// The pairs from `first` on, the lower id first, with the closures.
    pub fn pairs_from(
        &self,
        first: (EntityId, EntityId),
    ) -> impl Iterator<Item = (&(EntityId, EntityId), &Option<EntityId>)> {
        self.found_by.entries_from(first).filter(|((a, b), _)| a < b)
    }

    /// The loop closures whose places were compared.
    pub fn compared(&self) -> &BTreeSet<EntityId> {
        &self.compared
    }

    /// Whether `landmark` is part of a pair.
    pub fn has(&self, landmark: EntityId) -> bool {
        self.partners(landmark).next().is_some()
    }

    fn partners(&self, landmark: EntityId) -> impl Iterator<Item = EntityId> + '_ {
        let all = (landmark, EntityId::MIN)..=(landmark, EntityId::MAX);
        self.found_by.range(all).map(|(&(_, partner), _)| partner)
    }

    /// The landmarks that are one with `landmark` by a chain of pairs, it too, by id; empty where it is
    /// part of no pair.
    pub fn group(&self, landmark: EntityId) -> Vec<EntityId> {
        if !self.has(landmark) {
            return Vec::new();
        }
        let mut group = BTreeSet::from([landmark]);
        let mut next = vec![landmark];
        while let Some(id) = next.pop() {
            next.extend(self.partners(id).filter(|&partner| group.insert(partner)));
        }
        group.into_iter().collect()
    }

    /// The lowest landmark that makes a pair with `landmark`, if it is lower.
    pub fn original_of(&self, landmark: EntityId) -> Option<EntityId> {
        self.partners(landmark).next().filter(|&partner| partner < landmark)
    }

    fn link(&mut self, a: EntityId, b: EntityId, closure: Option<EntityId>) {
        if !self.found_by.contains_key(&(a, b)) {
            self.found_by.insert((a, b), closure);
            self.found_by.insert((b, a), closure);
        }
    }

    /// Adds what a comparison found. A pair that is known keeps the closure that found it first.
    pub(super) fn add(&mut self, comparison: &Comparison) {
        self.compared.insert(comparison.closure);
        let closure = Some(comparison.closure);
        comparison.pairs.iter().for_each(|&(a, b)| self.link(a, b, closure));
    }

    /// Forgets that the places of a closure were compared.
    pub(super) fn forget_comparison(&mut self, closure: EntityId) {
        self.compared.remove(&closure);
    }

    /// Splits the pairs that `closures` found.
    pub(super) fn split(&mut self, closures: &[EntityId]) {
        closures.iter().for_each(|closure| self.forget_comparison(*closure));
        let gone: BTreeSet<EntityId> = closures.iter().copied().collect();
        let is_gone = |closure: &Option<EntityId>| closure.is_some_and(|id| gone.contains(&id));
        let pairs = self.found_by.iter().filter(|(_, closure)| is_gone(closure));
        let pairs: Vec<_> = pairs.map(|(&pair, _)| pair).collect();
        for pair in pairs {
            self.found_by.remove(&pair);
        }
    }

    /// A closure leaves the map because a keyframe makes room: what it found stays.
    pub(super) fn keep(&mut self, closure: EntityId) {
        if self.compared.remove(&closure) {
            let own = self.found_by.values_mut().filter(|found_by| **found_by == Some(closure));
            own.for_each(|found_by| *found_by = None);
        }
    }

    /// A landmark leaves the map.
    pub(super) fn remove(&mut self, landmark: EntityId) {
        for partner in self.partners(landmark).collect::<Vec<_>>() {
            self.found_by.remove(&(landmark, partner));
            self.found_by.remove(&(partner, landmark));
        }
    }

    /// A landmark becomes part of another one, which takes over its pairs.
    pub(super) fn fuse(&mut self, kept: EntityId, absorbed: EntityId) {
        for partner in self.partners(absorbed).collect::<Vec<_>>() {
            let closure = self.found_by.get(&(absorbed, partner)).copied().flatten();
            if partner != kept {
                self.link(kept, partner, closure);
            }
        }
        self.remove(absorbed);
    }
}

impl Map {
    /// The landmarks that are one point of the scene.
    pub fn duplicates(&self) -> &Duplicates {
        &self.parts.duplicates
    }

    /// Whether bundle adjustment of the whole map is due: a pose graph took closures into account, and
    /// none has followed.
    pub fn is_adjustment_due(&self) -> bool {
        self.parts.adjustment_due
    }

    /// The loop closures that count and whose places were not compared, by id. Where a keyframe sees
    /// nothing there is nothing to compare.
    pub fn uncompared_closures(&self) -> impl Iterator<Item = EntityId> + '_ {
        let closures = self.active_constraints().filter(move |(_, constraint)| {
            constraint.is_closure()
                && self.sees(constraint.keyframe_i)
                && self.sees(constraint.keyframe_j)
        });
        closures.map(|(id, _)| id).filter(|id| !self.parts.duplicates.compared.contains(id))
    }

    /// The compared closures that no longer count, with the landmarks of their pairs, each by id.
    pub fn false_duplicates(&self) -> (Vec<EntityId>, Vec<EntityId>) {
        let counts = |id: EntityId| self.active_constraint(id).is_some_and(|c| c.is_closure());
        let compared = self.parts.duplicates.compared.iter().copied();
        let closures: BTreeSet<EntityId> = compared.filter(|&id| !counts(id)).collect();
        let of_false =
            |pair: &DuplicatePair| pair.2.is_some_and(|closure| closures.contains(&closure));
        let landmarks: BTreeSet<EntityId> = match closures.is_empty() {
            true => BTreeSet::new(),
            false => self
                .parts
                .duplicates
                .pairs()
                .filter(of_false)
                .flat_map(|(a, b, _)| [a, b])
                .collect(),
        };
        (closures.into_iter().collect(), landmarks.into_iter().collect())
    }

    /// Splits the pairs of closures that do not count. A closure whose keyframes see one of `landmarks`
    /// may have found the same pair: its places are compared again.
    pub(super) fn split_duplicates(&mut self, closures: &[EntityId], landmarks: &[EntityId]) {
        self.parts.duplicates.split(closures);
        let seen = landmarks.iter().filter_map(|id| self.parts.landmarks.get(id));
        let keyframes: BTreeSet<EntityId> =
            seen.flat_map(|landmark| landmark.observers.iter().copied()).collect();
        for keyframe in keyframes {
            self.ties.of(keyframe).for_each(|id| self.parts.duplicates.forget_comparison(id));
        }
    }

    /// Whether a comparison still holds: its closure counts and was not compared. Removes the pairs
    /// whose landmarks have left the map.
    pub fn keeps(&self, comparison: &mut Comparison) -> bool {
        let is_held = |id: &EntityId| self.parts.landmarks.contains_key(id);
        comparison.pairs.retain(|(a, b)| is_held(a) && is_held(b));
        let counts = self.active_constraint(comparison.closure).is_some_and(|c| c.is_closure());
        counts && !self.parts.duplicates.compared.contains(&comparison.closure)
    }

    /// Whether a pose graph that ends now took closures into account.
    pub(super) fn has_active_closure(&self) -> bool {
        self.active_constraints().any(|(_, constraint)| constraint.is_closure())
    }
}

impl super::Constraint {
    /// Whether it is a loop closure.
    pub fn is_closure(&self) -> bool {
        self.kind == ConstraintKind::LoopClosure
    }

    /// Its keyframes, the lower id first.
    pub(super) fn pair(&self) -> (EntityId, EntityId) {
        (self.keyframe_i.min(self.keyframe_j), self.keyframe_i.max(self.keyframe_j))
    }
}
