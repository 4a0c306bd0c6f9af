//! A sorted map whose copies share what neither has changed.
//!
//! A tree of three levels: branches of up to 64 leaves of up to 32 entries, each behind an `Arc`. A
//! copy of the map copies the list of branches, one pointer for some thousand entries; a change copies
//! the leaf that it touches and the branch of the leaf, if another map still has them. So a reader may
//! hold a map of a million landmarks while the engine changes its own. Names and order are those of
//! `BTreeMap`; independent of the type of its entries.

#[cfg(test)]
mod tests;

use std::fmt;
use std::ops::RangeInclusive;
use std::slice;
use std::sync::Arc;

/// Most entries of a leaf. Twice as many halve the length of a branch and double the copy of a leaf.
const LEAF: usize = 32;
/// Most leaves of a branch.
const BRANCH: usize = 64;

/// Parts of one level in order. The key of a part is not above its first key and is above the last key
/// of the previous part; no part is empty. A branch has the key of its first leaf.
type Parts<K, T> = Vec<(K, Arc<Vec<T>>)>;
type Leaf<K, V> = Arc<Vec<(K, V)>>;
type Leaves<K, V> = Vec<(K, Leaf<K, V>)>;

/// The map.
#[derive(Clone)]
pub struct SharedMap<K, V> {
    branches: Vec<(K, Arc<Leaves<K, V>>)>,
    len: usize,
}

impl<K, V> Default for SharedMap<K, V> {
    fn default() -> Self {
        Self { branches: Vec::new(), len: 0 }
    }
}

impl<K, V> SharedMap<K, V> {
    /// How many entries it has.
    pub fn len(&self) -> usize {
        self.len
    }

    /// Whether it has none.
    pub fn is_empty(&self) -> bool {
        self.len == 0
    }

    /// The entries by rising key.
    pub fn iter(&self) -> Iter<'_, K, V> {
        let entries =
            Entries { branches: self.branches.iter(), leaves: [].iter(), leaf: [].iter() };
        Iter { entries, len: self.len }
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

/// Where a key is or would be inserted: its branch, its leaf and its index in the leaf.
type Position = (usize, usize, Result<usize, usize>);

/// The part that holds a key if any does; `None` below the first.
fn part_of<K: Ord, T>(parts: &[(K, T)], key: &K) -> Option<usize> {
    parts.partition_point(|part| part.0 <= *key).checked_sub(1)
}

/// The index of a key in a leaf; it is most often at `at`.
fn place_near<K: Ord + Copy, V>(leaf: &[(K, V)], at: usize, key: &K) -> Result<usize, usize> {
    match leaf.get(at) {
        Some((next, _)) if next == key => Ok(at),
        _ => leaf.binary_search_by_key(key, |entry| entry.0),
    }
}

impl<K: Ord + Copy, V> SharedMap<K, V> {
    /// `None` below all entries.
    fn position(&self, key: &K) -> Option<Position> {
        let branch = part_of(&self.branches, key)?;
        let leaves = &self.branches[branch].1;
        let leaf = part_of(leaves, key)?;
        Some((branch, leaf, leaves[leaf].1.binary_search_by_key(key, |entry| entry.0)))
    }

    /// The value of a key.
    pub fn get(&self, key: &K) -> Option<&V> {
        let leaves = &self.branches[part_of(&self.branches, key)?].1;
        let leaf = &leaves[part_of(leaves, key)?].1;
        let at = leaf.binary_search_by_key(key, |entry| entry.0).ok()?;
        Some(&leaf[at].1)
    }

    /// Whether a key has a value.
    pub fn contains_key(&self, key: &K) -> bool {
        self.get(key).is_some()
    }

    /// Finds the values of keys that rise, mostly without a search from the top.
    pub fn rising(&self) -> Rising<'_, K, V> {
        Rising { map: self, leaf: &[], end: None, at: 0 }
    }

    /// The first key behind the leaf at a position; `None` behind the last leaf.
    fn end_of(&self, branch: usize, leaf: usize) -> Option<K> {
        let next = self.branches[branch].1.get(leaf + 1).map(|&(key, _)| key);
        next.or_else(|| self.branches.get(branch + 1).map(|&(key, _)| key))
    }

    /// The entry of the highest key.
    pub fn last_key_value(&self) -> Option<(&K, &V)> {
        let (_, leaves) = self.branches.last()?;
        let (_, leaf) = leaves.last()?;
        leaf.last().map(|(key, value)| (key, value))
    }

    /// The entry of the highest key below this one.
    pub fn entry_before(&self, key: &K) -> Option<(&K, &V)> {
        let branch = self.branches.partition_point(|part| part.0 < *key).checked_sub(1)?;
        let leaves = &self.branches[branch].1;
        let leaf = leaves.partition_point(|part| part.0 < *key).checked_sub(1)?;
        let entries = &leaves[leaf].1;
        let entry = match entries.partition_point(|entry| entry.0 < *key).checked_sub(1) {
            Some(at) => entries.get(at),
            // The leaf has lost the entries that it began with.
            None => match leaf.checked_sub(1) {
                Some(leaf) => leaves[leaf].1.last(),
                None => self.branches[branch.checked_sub(1)?].1.last()?.1.last(),
            },
        };
        entry.map(|(key, value)| (key, value))
    }

    /// The entries of these keys, rising.
    pub fn range(&self, keys: RangeInclusive<K>) -> impl Iterator<Item = (&K, &V)> {
        let (first, last) = keys.into_inner();
        self.entries_from(first).take_while(move |&(key, _)| *key <= last)
    }

    /// The entries from a key on, rising.
    pub fn entries_from(&self, first: K) -> impl Iterator<Item = (&K, &V)> {
        match self.position(&first) {
            None => self.iter().entries,
            Some((branch, leaf, at)) => {
                let leaves = &self.branches[branch].1;
                let at = at.unwrap_or_else(|at| at);
                Entries {
                    branches: self.branches[branch + 1..].iter(),
                    leaves: leaves[leaf + 1..].iter(),
                    leaf: leaves[leaf].1[at..].iter(),
                }
            }
        }
    }
}

impl<K: Ord + Copy, V: Clone> SharedMap<K, V> {
    /// The leaves of a branch, to be changed.
    fn leaves_mut(&mut self, branch: usize) -> &mut Leaves<K, V> {
        Arc::make_mut(&mut self.branches[branch].1)
    }

    /// The value of a key, to be changed.
    pub fn get_mut(&mut self, key: &K) -> Option<&mut V> {
        let (branch, leaf, at) = self.position(key)?;
        let at = at.ok()?;
        Some(&mut Arc::make_mut(&mut self.leaves_mut(branch)[leaf].1)[at].1)
    }

    /// Changes the values of keys that rise, mostly without a search from the top; keys without a value
    /// are skipped. Other orders take longer and do the same.
    pub fn update_rising<T>(
        &mut self,
        changes: impl IntoIterator<Item = (K, T)>,
        mut change: impl FnMut(&mut V, T),
    ) {
        let mut changes = changes.into_iter().peekable();
        while let Some((first, value)) = changes.next() {
            let Some((branch, leaf, Ok(at))) = self.position(&first) else { continue };
            let end = self.end_of(branch, leaf);
            let entries = Arc::make_mut(&mut self.leaves_mut(branch)[leaf].1);
            change(&mut entries[at].1, value);
            let mut at = at + 1;
            let is_here = |key: &K| *key > first && end.is_none_or(|end| *key < end);
            while let Some((key, value)) = changes.next_if(|(key, _)| is_here(key)) {
                match place_near(entries, at, &key) {
                    Ok(found) => {
                        change(&mut entries[found].1, value);
                        at = found + 1;
                    }
                    Err(next) => at = next,
                }
            }
        }
    }

    /// The value of a key, to be changed; `value` where it has none yet.
    pub fn get_or_insert(&mut self, key: K, value: impl FnOnce() -> V) -> &mut V {
        let (branch, leaf, at) = match self.position(&key) {
            Some((branch, leaf, Ok(at))) => (branch, leaf, at),
            vacant => self.insert_at(vacant, key, value()),
        };
        &mut Arc::make_mut(&mut self.leaves_mut(branch)[leaf].1)[at].1
    }

    /// The values by rising key, to be changed.
    pub fn values_mut(&mut self) -> impl Iterator<Item = &mut V> {
        let branches = self.branches.iter_mut();
        let leaves = branches.flat_map(|(_, leaves)| Arc::make_mut(leaves));
        leaves.flat_map(|(_, leaf)| Arc::make_mut(leaf).iter_mut().map(|(_, value)| value))
    }

    /// Sets the value of a key; returns the one that it had.
    pub fn insert(&mut self, key: K, value: V) -> Option<V> {
        match self.position(&key) {
            Some((branch, leaf, Ok(at))) => {
                let entry = &mut Arc::make_mut(&mut self.leaves_mut(branch)[leaf].1)[at];
                Some(std::mem::replace(&mut entry.1, value))
            }
            vacant => {
                self.insert_at(vacant, key, value);
                None
            }
        }
    }

    /// Inserts a key without a value at its position; returns its new one.
    fn insert_at(&mut self, position: Option<Position>, key: K, value: V) -> (usize, usize, usize) {
        self.len += 1;
        if self.branches.is_empty() {
            self.branches.push((key, Arc::new(vec![(key, Arc::new(Vec::new()))])));
        }
        let (branch, leaf, at) = match position {
            Some((branch, leaf, at)) => (branch, leaf, at.unwrap_or_else(|at| at)),
            None => {
                self.branches[0].0 = key;
                self.leaves_mut(0)[0].0 = key;
                (0, 0, 0)
            }
        };
        let leaves = self.leaves_mut(branch);
        let full = &mut leaves[leaf].1;
        if full.len() < LEAF {
            Arc::make_mut(full).insert(at, (key, value));
            return (branch, leaf, at);
        }
        // Rising keys leave full leaves behind.
        let (kept, next) = (if at == LEAF { LEAF } else { LEAF / 2 }, leaf + 1);
        let lower = Arc::make_mut(full);
        let mut upper = lower.split_off(kept);
        let goes_up = at > kept || kept == LEAF;
        if goes_up {
            upper.insert(at - kept, (key, value));
        } else {
            lower.insert(at, (key, value));
        }
        leaves.insert(next, (upper[0].0, Arc::new(upper)));
        let (leaf, at) = if goes_up { (next, at - kept) } else { (leaf, at) };
        let (branch, leaf) = self.split_branch(branch, leaf);
        (branch, leaf, at)
    }

    /// Splits a branch that has become too long; returns the new position of its leaf.
    fn split_branch(&mut self, branch: usize, leaf: usize) -> (usize, usize) {
        let leaves = self.leaves_mut(branch);
        if leaves.len() <= BRANCH {
            return (branch, leaf);
        }
        let kept = if leaf == BRANCH { BRANCH } else { BRANCH / 2 };
        let upper = leaves.split_off(kept);
        self.branches.insert(branch + 1, (upper[0].0, Arc::new(upper)));
        if leaf < kept { (branch, leaf) } else { (branch + 1, leaf - kept) }
    }

    /// Removes a key; answers its value.
    pub fn remove(&mut self, key: &K) -> Option<V> {
        let (branch, leaf, at) = self.position(key)?;
        let at = at.ok()?;
        self.len -= 1;
        let leaves = self.leaves_mut(branch);
        let (_, value) = Arc::make_mut(&mut leaves[leaf].1).remove(at);
        let before = leaves.len();
        join_few(leaves, leaf, LEAF);
        let (left, first) = (leaves.len(), leaves.first().map(|(first, _)| *first));
        if left < before {
            // With its first leaf gone, the keys below the next belong to the branch before.
            if let Some(first) = first {
                self.branches[branch].0 = first;
            }
            join_few(&mut self.branches, branch, BRANCH);
        }
        Some(value)
    }

    /// Removes the lowest key.
    pub fn pop_first(&mut self) -> Option<(K, V)> {
        let &key = self.keys().next()?;
        self.remove(&key).map(|value| (key, value))
    }
}

/// After the part at `at` lost something: drops it where it is empty, and joins it with a neighbor where
/// both make one of up to `most` with room left.
fn join_few<K, T: Clone>(parts: &mut Parts<K, T>, at: usize, most: usize) {
    let few = most / 4;
    match parts[at].1.len() {
        0 => drop(parts.remove(at)),
        left if left < few => {
            let fits = |first: usize, parts: &Parts<K, T>| {
                parts
                    .get(first + 1)
                    .is_some_and(|next| parts[first].1.len() + next.1.len() <= most - few)
            };
            let before = at.checked_sub(1).filter(|&before| fits(before, parts));
            if let Some(first) = before.or_else(|| fits(at, parts).then_some(at)) {
                let (_, next) = parts.remove(first + 1);
                Arc::make_mut(&mut parts[first].1).extend(Arc::unwrap_or_clone(next));
            }
        }
        left => {
            let part = Arc::make_mut(&mut parts[at].1);
            if part.capacity() / 4 > left {
                part.shrink_to(left * 2);
            }
        }
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

/// Finds values of a [`SharedMap`] by rising keys. Other orders take longer and find the same.
#[derive(Debug)]
pub struct Rising<'a, K, V> {
    map: &'a SharedMap<K, V>,
    /// The leaf of the last key that was found.
    leaf: &'a [(K, V)],
    /// The first key behind that leaf; `None` behind the last leaf.
    end: Option<K>,
    /// The index in the leaf where the next key is expected.
    at: usize,
}

impl<'a, K: Ord + Copy, V> Rising<'a, K, V> {
    /// The value of a key.
    pub fn get(&mut self, key: &K) -> Option<&'a V> {
        let is_here = self.leaf.first().is_some_and(|(first, _)| first <= key)
            && self.end.is_none_or(|end| *key < end);
        let at = if is_here {
            place_near(self.leaf, self.at, key)
        } else {
            let (branch, leaf, at) = self.map.position(key)?;
            self.leaf = &self.map.branches[branch].1[leaf].1;
            self.end = self.map.end_of(branch, leaf);
            at
        };
        self.at = at.map_or_else(|at| at, |at| at + 1);
        Some(&self.leaf[at.ok()?].1)
    }
}

/// The entries of a [`SharedMap`] by rising key.
#[derive(Debug)]
pub struct Iter<'a, K, V> {
    entries: Entries<'a, K, V>,
    len: usize,
}

impl<'a, K, V> Iterator for Iter<'a, K, V> {
    type Item = (&'a K, &'a V);

    fn next(&mut self) -> Option<Self::Item> {
        let entry = self.entries.next()?;
        self.len -= 1;
        Some(entry)
    }

    fn size_hint(&self) -> (usize, Option<usize>) {
        (self.len, Some(self.len))
    }
}

impl<K, V> ExactSizeIterator for Iter<'_, K, V> {}

/// The entries from some key on.
#[derive(Debug)]
struct Entries<'a, K, V> {
    branches: slice::Iter<'a, (K, Arc<Leaves<K, V>>)>,
    leaves: slice::Iter<'a, (K, Leaf<K, V>)>,
    leaf: slice::Iter<'a, (K, V)>,
}

impl<'a, K, V> Iterator for Entries<'a, K, V> {
    type Item = (&'a K, &'a V);

    fn next(&mut self) -> Option<Self::Item> {
        loop {
            if let Some((key, value)) = self.leaf.next() {
                return Some((key, value));
            }
            match self.leaves.next() {
                Some((_, leaf)) => self.leaf = leaf.iter(),
                None => self.leaves = self.branches.next()?.1.iter(),
            }
        }
    }
}
