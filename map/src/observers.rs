//! The keyframes that see a landmark.
//!
//! The list is immutable and shared by copies of the landmark: a solve that moves all landmarks of a map
//! that a reader holds copies each of them, and no list. Independent of maps.

use std::ops::Deref;
use std::slice;
use std::sync::Arc;

use super::EntityId;

/// The keyframes that see a landmark, sorted. Clones share their memory.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Observers(Arc<[EntityId]>);

impl Observers {
    /// Inserts a keyframe at its index in the order.
    pub(super) fn insert(&mut self, index: usize, keyframe: EntityId) {
        let (before, after) = self.0.split_at(index);
        self.0 = before.iter().copied().chain([keyframe]).chain(after.iter().copied()).collect();
    }

    /// Removes the keyframe at an index.
    pub(super) fn remove(&mut self, index: usize) {
        let (before, after) = self.0.split_at(index);
        self.0 = before.iter().chain(&after[1..]).copied().collect();
    }
}

impl Deref for Observers {
    type Target = [EntityId];

    fn deref(&self) -> &[EntityId] {
        &self.0
    }
}

impl<'a> IntoIterator for &'a Observers {
    type Item = &'a EntityId;
    type IntoIter = slice::Iter<'a, EntityId>;

    fn into_iter(self) -> Self::IntoIter {
        self.iter()
    }
}

impl From<Vec<EntityId>> for Observers {
    /// Of keyframes that are sorted.
    fn from(sorted: Vec<EntityId>) -> Self {
        Self(sorted.into())
    }
}
