//! A sorted map whose copies share what neither has changed.
//!
//! Entries stand in leaves of up to 32, each behind an `Arc`: a copy of the map copies the list
//! of leaves, and a change copies the leaf that it touches where another map still has it. So a
//! reader may hold a map of a million landmarks while the engine changes its own. Names and order are
//! those of `BTreeMap`; knows nothing of what it holds.

#[cfg(test)]
mod tests;

use std::collections::{BTreeMap, btree_map};
use std::fmt;
use std::ops::RangeInclusive;
use std::slice;
use std::sync::Arc;

/// Entries of a leaf at most. Twice as many make the list of leaves half as long and the copy of a
/// leaf twice.
const LEAF: usize = 32;
/// A leaf with fewer looks for a neighbor to join.
const FEW: usize = LEAF / 4;

type Leaf<K, V> = Arc<Vec<(K, V)>>;

/// The map. Every leaf has entries; it stands under a key that is not above its first and is above
/// the last of the leaf before it.
#[derive(Clone)]
pub struct SharedMap<K, V> {
    leaves: BTreeMap<K, Leaf<K, V>>,
    len: usize,
}

impl<K, V> Default for SharedMap<K, V> {
    fn default() -> Self {
        Self { leaves: BTreeMap::new(), len: 0 }
    }
}

impl<K, V> SharedMap<K, V> {
    /// How many entries it has.
    #[must_use]
    pub fn len(&self) -> usize {
        self.len
    }

    /// Whether it has none.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.len == 0
    }

    /// The entries by rising key.
    #[must_use]
    pub fn iter(&self) -> Iter<'_, K, V> {
        Iter { leaves: self.leaves.values(), leaf: [].iter(), len: self.len }
    }

    /// The keys, rising.
    pub fn keys(&self) -> impl ExactSizeIterator<Item = &K> {
        self.iter().map(|(key, _)| key)
    }

    /// The values by rising key.
    pub fn values(&self) -> impl ExactSizeIterator<Item = &V> {
        self.iter().map(|(_, value)| value)
    }
}

impl<K: Ord + Copy, V> SharedMap<K, V> {
    /// The value of a key.
    #[must_use]
    pub fn get(&self, key: &K) -> Option<&V> {
        let (_, leaf) = self.leaves.range(..=key).next_back()?;
        let at = leaf.binary_search_by_key(key, |entry| entry.0).ok()?;
        Some(&leaf[at].1)
    }

    /// Whether a key has a value.
    #[must_use]
    pub fn contains_key(&self, key: &K) -> bool {
        self.get(key).is_some()
    }

    /// The entry of the highest key.
    #[must_use]
    pub fn last_key_value(&self) -> Option<(&K, &V)> {
        let (_, leaf) = self.leaves.last_key_value()?;
        leaf.last().map(|(key, value)| (key, value))
    }

    /// The entries of these keys, rising.
    pub fn range(&self, keys: RangeInclusive<K>) -> impl Iterator<Item = (&K, &V)> {
        let (first, last) = keys.into_inner();
        let start = self.leaves.range(..=first).next_back().map_or(first, |(&key, _)| key);
        // A range that ends before it starts is empty here and a panic there.
        let leaves = (first <= last).then(|| self.leaves.range(start..=last));
        let entries = leaves.into_iter().flatten().flat_map(|(_, leaf)| leaf.iter());
        entries
            .map(|(key, value)| (key, value))
            .skip_while(move |&(key, _)| *key < first)
            .take_while(move |&(key, _)| *key <= last)
    }
}

impl<K: Ord + Copy, V: Clone> SharedMap<K, V> {
    /// The value of a key, to be changed.
    pub fn get_mut(&mut self, key: &K) -> Option<&mut V> {
        let (_, leaf) = self.leaves.range_mut(..=key).next_back()?;
        let at = leaf.binary_search_by_key(key, |entry| entry.0).ok()?;
        Some(&mut Arc::make_mut(leaf)[at].1)
    }

    /// The values by rising key, to be changed.
    pub fn values_mut(&mut self) -> impl Iterator<Item = &mut V> {
        let leaves = self.leaves.values_mut();
        leaves.flat_map(|leaf| Arc::make_mut(leaf).iter_mut().map(|(_, value)| value))
    }

    /// Gives a key a value; answers the one that it had.
    pub fn insert(&mut self, key: K, value: V) -> Option<V> {
        let Some((_, leaf)) = self.leaves.range_mut(..=key).next_back() else {
            return self.insert_first(key, value);
        };
        let at = match leaf.binary_search_by_key(&key, |entry| entry.0) {
            Ok(at) => return Some(std::mem::replace(&mut Arc::make_mut(leaf)[at].1, value)),
            Err(at) => at,
        };
        self.len += 1;
        if leaf.len() < LEAF {
            Arc::make_mut(leaf).insert(at, (key, value));
        } else if at == LEAF {
            // Rising keys leave full leaves behind.
            self.leaves.insert(key, Arc::new(vec![(key, value)]));
        } else {
            let lower = Arc::make_mut(leaf);
            let mut upper = lower.split_off(LEAF / 2);
            if at <= LEAF / 2 {
                lower.insert(at, (key, value));
            } else {
                upper.insert(at - LEAF / 2, (key, value));
            }
            self.leaves.insert(upper[0].0, Arc::new(upper));
        }
        None
    }

    /// Of a key below all leaves.
    fn insert_first(&mut self, key: K, value: V) -> Option<V> {
        self.len += 1;
        let leaf = match self.leaves.pop_first() {
            Some((_, mut leaf)) if leaf.len() < LEAF => {
                Arc::make_mut(&mut leaf).insert(0, (key, value));
                leaf
            }
            full => {
                self.leaves.extend(full);
                Arc::new(vec![(key, value)])
            }
        };
        self.leaves.insert(key, leaf);
        None
    }

    /// Removes a key; answers its value.
    pub fn remove(&mut self, key: &K) -> Option<V> {
        let (&place, leaf) = self.leaves.range_mut(..=key).next_back()?;
        let at = leaf.binary_search_by_key(key, |entry| entry.0).ok()?;
        let entries = Arc::make_mut(leaf);
        let (_, value) = entries.remove(at);
        if entries.capacity() / 4 > entries.len() {
            entries.shrink_to(entries.len() * 2);
        }
        self.len -= 1;
        match entries.len() {
            0 => drop(self.leaves.remove(&place)),
            few if few < FEW => {
                let before = self.leaves.range(..place).next_back().map(|(&before, _)| before);
                if !before.is_some_and(|before| self.join(before)) {
                    self.join(place);
                }
            }
            _ => {}
        }
        Some(value)
    }

    /// Removes the lowest key.
    pub fn pop_first(&mut self) -> Option<(K, V)> {
        let &key = self.keys().next()?;
        self.remove(&key).map(|value| (key, value))
    }

    /// Joins the leaf at `place` with the next, where they make one with room left.
    fn join(&mut self, place: K) -> bool {
        let mut from_here = self.leaves.range(place..);
        let (Some((_, leaf)), Some((&next, other))) = (from_here.next(), from_here.next()) else {
            return false;
        };
        if leaf.len() + other.len() > LEAF - FEW {
            return false;
        }
        let Some(other) = self.leaves.remove(&next) else { return false };
        if let Some(leaf) = self.leaves.get_mut(&place) {
            Arc::make_mut(leaf).extend(Arc::unwrap_or_clone(other));
        }
        true
    }
}

impl<K: PartialEq, V: PartialEq> PartialEq for SharedMap<K, V> {
    fn eq(&self, other: &Self) -> bool {
        self.len == other.len && self.iter().eq(other.iter())
    }
}

impl<K: Eq, V: Eq> Eq for SharedMap<K, V> {}

impl<K: fmt::Debug, V: fmt::Debug> fmt::Debug for SharedMap<K, V> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_map().entries(self.iter()).finish()
    }
}

impl<K: Ord + Copy, V: Clone> FromIterator<(K, V)> for SharedMap<K, V> {
    fn from_iter<I: IntoIterator<Item = (K, V)>>(entries: I) -> Self {
        let mut map = Self::default();
        map.extend(entries);
        map
    }
}

impl<K: Ord + Copy, V: Clone> Extend<(K, V)> for SharedMap<K, V> {
    fn extend<I: IntoIterator<Item = (K, V)>>(&mut self, entries: I) {
        entries.into_iter().for_each(|(key, value)| drop(self.insert(key, value)));
    }
}

impl<'a, K, V> IntoIterator for &'a SharedMap<K, V> {
    type Item = (&'a K, &'a V);
    type IntoIter = Iter<'a, K, V>;

    fn into_iter(self) -> Self::IntoIter {
        self.iter()
    }
}

/// The entries of a [`SharedMap`] by rising key.
#[derive(Debug)]
pub struct Iter<'a, K, V> {
    leaves: btree_map::Values<'a, K, Leaf<K, V>>,
    leaf: slice::Iter<'a, (K, V)>,
    len: usize,
}

impl<'a, K, V> Iterator for Iter<'a, K, V> {
    type Item = (&'a K, &'a V);

    fn next(&mut self) -> Option<Self::Item> {
        if self.leaf.len() == 0 {
            self.leaf = self.leaves.next()?.iter();
        }
        let (key, value) = self.leaf.next()?;
        self.len -= 1;
        Some((key, value))
    }

    fn size_hint(&self) -> (usize, Option<usize>) {
        (self.len, Some(self.len))
    }
}

impl<K, V> ExactSizeIterator for Iter<'_, K, V> {}
