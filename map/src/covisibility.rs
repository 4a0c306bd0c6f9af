//! How many landmarks each pair of keyframes shares.
//!
//! A landmark counts for two of its observers unless more than 31 others were added between them: each
//! observer is a neighbor of the 32 that were added just before it and of the 32 just after it. So the
//! newest keyframe shares a landmark with the newest that see it, an old one with those of similar age,
//! and one landmark costs at most 64 counts per observer, however many see it. Which pairs count is a
//! function of the keyframes alone, whatever the order in which they are counted: the counts are kept
//! one observation at a time. Nothing here decides how many shared landmarks make neighbors.

use std::collections::BTreeMap;
use std::sync::Arc;

use super::{EntityId, SharedMap};

/// Observers of a landmark that count for another one to each side, by the revision that added them.
/// Every track of the shared BAL files is shorter; a window of 20 keyframes fits into it.
pub(super) const NEAREST: usize = 32;

/// An observer of a landmark, behind the revision that added the keyframe.
type Observer = (i64, EntityId);

/// Shared-landmark counts, symmetric, positive entries only.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Covisibility {
    /// Rows are shared with the snapshots that readers hold and copied on write.
    rows: SharedMap<EntityId, Arc<BTreeMap<EntityId, u32>>>,
    /// Entries of all rows.
    entry_count: u64,
    /// The observers of each landmark that has more than [`NEAREST`] + 1, by age.
    long: SharedMap<EntityId, Arc<Vec<Observer>>>,
    /// Observers in all lists of `long`.
    long_count: u64,
}

impl Covisibility {
    /// The keyframes that share landmarks with `keyframe`, with the counts, by id.
    pub fn neighbors(&self, keyframe: EntityId) -> impl Iterator<Item = (EntityId, u32)> + '_ {
        self.rows.get(&keyframe).into_iter().flat_map(|row| row.iter().map(|(&id, &n)| (id, n)))
    }

    /// How many counts are kept: two per pair.
    pub fn entry_count(&self) -> u64 {
        self.entry_count
    }

    /// How many observers are kept in the order of their age.
    pub(super) fn long_count(&self) -> u64 {
        self.long_count
    }

    /// `keyframe` sees `landmark`, which `observers` see already: appends to `sharing` those that now
    /// share it with `keyframe`, for [`Covisibility::add`]. `age` gives the revision that added one.
    pub(super) fn observe(
        &mut self,
        landmark: EntityId,
        observers: &[EntityId],
        keyframe: EntityId,
        age: impl Fn(EntityId) -> i64,
        sharing: &mut Vec<EntityId>,
    ) {
        if observers.len() <= NEAREST {
            sharing.extend_from_slice(observers);
            return;
        }
        let long_count = &mut self.long_count;
        let order = self.long.get_or_insert(landmark, || {
            let mut order: Vec<Observer> = observers.iter().map(|&id| (age(id), id)).collect();
            order.sort_unstable();
            *long_count += order.len() as u64;
            Arc::new(order)
        });
        let order = Arc::make_mut(order);
        let new = (age(keyframe), keyframe);
        let index = order.partition_point(|observer| *observer < new);
        let first = index.saturating_sub(NEAREST);
        let near = order[first..].iter().take(index - first + NEAREST);
        sharing.extend(near.map(|&(_, id)| id));
        // The new one is between them now.
        let apart = |at: usize| Some((order[at].1, order.get(at + NEAREST)?.1));
        let apart: Vec<(EntityId, EntityId)> = (first..index).filter_map(apart).collect();
        order.insert(index, new);
        self.long_count += 1;
        for (a, b) in apart {
            self.decrement(a, b);
            self.decrement(b, a);
        }
    }

    /// `keyframe` no longer sees `landmark`, which `observers` still see.
    pub(super) fn forget(
        &mut self,
        landmark: EntityId,
        observers: &[EntityId],
        keyframe: EntityId,
    ) {
        let Some(order) = self.long.get_mut(&landmark) else {
            return self.remove(keyframe, observers);
        };
        let order = Arc::make_mut(order);
        let Some(index) = order.iter().position(|&(_, id)| id == keyframe) else { return };
        let first = index.saturating_sub(NEAREST);
        let near = order[first..].iter().take(index - first + 1 + NEAREST);
        let near: Vec<EntityId> = near.map(|&(_, id)| id).collect();
        // Nothing is between them any more.
        let closer = |at: usize| Some((order[at].1, order.get(at + NEAREST + 1)?.1));
        let closer: Vec<(EntityId, EntityId)> = (first..index).filter_map(closer).collect();
        order.remove(index);
        self.long_count -= 1;
        if order.len() <= NEAREST + 1 {
            self.long_count -= order.len() as u64;
            self.long.remove(&landmark);
        }
        self.remove(keyframe, &near);
        for (a, b) in closer {
            self.count(a, b, 1);
            self.count(b, a, 1);
        }
    }

    /// Counts landmarks more that `keyframe` shares: `observers` names another keyframe once for each,
    /// in any order, and is left sorted.
    ///
    /// A row is looked up once per neighbor, not once per landmark: a keyframe shares hundreds of
    /// landmarks with each.
    pub(super) fn add(&mut self, keyframe: EntityId, observers: &mut [EntityId]) {
        observers.sort_unstable();
        for run in observers.chunk_by(|a, b| a == b) {
            let (other, landmarks) = (run[0], run.len() as u32);
            if other != keyframe {
                self.count(keyframe, other, landmarks);
                self.count(other, keyframe, landmarks);
            }
        }
    }

    fn count(&mut self, a: EntityId, b: EntityId, landmarks: u32) {
        let row = self.rows.get_or_insert(a, Default::default);
        let count = Arc::make_mut(row).entry(b).or_insert(0);
        self.entry_count += u64::from(*count == 0);
        *count += landmarks;
    }

    /// Counts one landmark less seen by `keyframe` and by each of `observers`.
    fn remove(&mut self, keyframe: EntityId, observers: &[EntityId]) {
        for &other in observers.iter().filter(|&&o| o != keyframe) {
            self.decrement(keyframe, other);
            self.decrement(other, keyframe);
        }
    }

    fn decrement(&mut self, a: EntityId, b: EntityId) {
        let Some(row) = self.rows.get_mut(&a) else { return };
        let row_mut = Arc::make_mut(row);
        if let Some(count) = row_mut.get_mut(&b) {
            *count -= 1;
            if *count == 0 {
                row_mut.remove(&b);
                self.entry_count -= 1;
            }
        }
        if row.is_empty() {
            self.rows.remove(&a);
        }
    }
}
