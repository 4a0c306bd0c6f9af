//! How many landmarks each pair of keyframes shares.
//!
//! With the observation matrix A (landmarks × keyframes, entries 0 or 1) the counts are the
//! off-diagonal entries of AᵀA. The fold keeps them one observation at a time;
//! [`Covisibility::product`] forms the product itself, for building from scratch and as the oracle
//! in tests. Nothing here decides how many shared landmarks make neighbors.

use std::collections::{BTreeMap, BTreeSet};
use std::sync::Arc;

use sprs::{CsMat, TriMat};

use super::{EntityId, Keyframe, SharedMap};

/// Shared-landmark counts, symmetric, positive entries only.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Covisibility {
    /// Rows are shared with the snapshots that readers hold and copied on write.
    rows: BTreeMap<EntityId, Arc<BTreeMap<EntityId, u32>>>,
    /// Entries of all rows.
    entry_count: u64,
}

impl Covisibility {
    /// How many landmarks `a` and `b` share; 0 for a keyframe with itself.
    #[must_use]
    pub fn shared(&self, a: EntityId, b: EntityId) -> u32 {
        self.rows.get(&a).and_then(|row| row.get(&b)).copied().unwrap_or(0)
    }

    /// The keyframes that share landmarks with `keyframe`, with the counts, by id.
    pub fn neighbors(&self, keyframe: EntityId) -> impl Iterator<Item = (EntityId, u32)> + '_ {
        self.rows.get(&keyframe).into_iter().flat_map(|row| row.iter().map(|(&id, &n)| (id, n)))
    }

    /// How many counts are kept: two a pair.
    #[must_use]
    pub fn entry_count(&self) -> u64 {
        self.entry_count
    }

    /// Every pair (a, b, count) with a < b, in order.
    pub fn pairs(&self) -> impl Iterator<Item = (EntityId, EntityId, u32)> + '_ {
        self.rows.iter().flat_map(|(&a, row)| {
            row.iter().filter(move |&(&b, _)| a < b).map(move |(&b, &n)| (a, b, n))
        })
    }

    /// The counts from scratch, as the sparse product AᵀA.
    #[must_use]
    pub fn product(keyframes: &SharedMap<EntityId, Keyframe>) -> Self {
        let ids: Vec<EntityId> = keyframes.keys().copied().collect();
        let mut landmarks: BTreeMap<EntityId, usize> = BTreeMap::new();
        for keyframe in keyframes.values() {
            for observation in keyframe.observations.iter() {
                let next = landmarks.len();
                landmarks.entry(observation.landmark).or_insert(next);
            }
        }
        let mut triplets = TriMat::new((landmarks.len(), ids.len()));
        for (column, keyframe) in keyframes.values().enumerate() {
            // Once each: triplets of one place add up, and two features may match one landmark.
            let seen = keyframe.observations.iter().filter_map(|o| landmarks.get(&o.landmark));
            for row in seen.copied().collect::<BTreeSet<usize>>() {
                triplets.add_triplet(row, column, 1_u32);
            }
        }
        let a: CsMat<u32> = triplets.to_csc();
        let transposed = a.transpose_view();
        let counts: CsMat<u32> = &transposed * &a;
        let mut covisibility = Self::default();
        for (&count, (i, j)) in &counts {
            if i != j && count > 0 {
                let row = covisibility.rows.entry(ids[i]).or_default();
                Arc::make_mut(row).insert(ids[j], count);
                covisibility.entry_count += 1;
            }
        }
        covisibility
    }

    /// Counts landmarks more that `keyframe` shares: `observers` names another keyframe once for each,
    /// in any order, and is left sorted.
    ///
    /// A row is looked up once a neighbor, not once a landmark: a keyframe shares hundreds of them
    /// with each.
    pub(super) fn add(&mut self, keyframe: EntityId, observers: &mut [EntityId]) {
        observers.sort_unstable();
        for run in observers.chunk_by(|a, b| a == b) {
            let (other, landmarks) = (run[0], run.len() as u32);
            if other == keyframe {
                continue;
            }
            for (a, b) in [(keyframe, other), (other, keyframe)] {
                let row = self.rows.entry(a).or_default();
                let count = Arc::make_mut(row).entry(b).or_insert(0);
                self.entry_count += u64::from(*count == 0);
                *count += landmarks;
            }
        }
    }

    /// Counts one landmark less seen by `keyframe` and by each of `observers`.
    pub(super) fn remove(&mut self, keyframe: EntityId, observers: &[EntityId]) {
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
