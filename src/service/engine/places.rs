//! The index of a map's places, kept so that a search need not index the map again.
//!
//! It is a function of what the map holds and lost with the process: it is made when a place is first
//! searched, and brought up to the map of each later search by what differs, a piece at a time. So no caller
//! has to report what changed, and changes of the map never wait for it. It is shared by the searches and the
//! calls of one map, blocks its thread and uses nothing of the engine.

use std::collections::BTreeMap;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{PoisonError, RwLock, RwLockReadGuard, RwLockWriteGuard};

use covis_solvers::interrupt::Interrupt;

use crate::loop_closing::{QueryView, comparable, indexed, not_indexed};
use crate::map::{EntityId, Map, Observations, PlaceRefusal, PlaceSearch};
use crate::place::{Candidate, Feature, PlaceError, PlaceIndex};

/// Memory that an index may take beyond what the map counts for it: its smallest tables, of each make.
const LEAST: u64 = 1 << 20;

/// Descriptors that are indexed or removed at once, and a keyframe more: some 3 µs each.
const PIECE: usize = 1 << 15;

/// A type of descriptors that no keyframe has, where keyframes have others.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct UnknownType {
    /// Index of the first feature that has it; `None`: the descriptor of the whole image has it.
    pub feature: Option<usize>,
    /// Its name.
    pub name: String,
    /// Its length, bytes.
    pub bytes: usize,
    /// The types that keyframes have: name and length.
    pub known: Vec<(String, usize)>,
}

impl UnknownType {
    fn new(feature: Option<usize>, sent: &Feature<'_>, known: &[(&str, usize)]) -> Self {
        let known = known.iter().map(|&(name, bytes)| (name.to_owned(), bytes)).collect();
        Self { feature, name: sent.name.to_owned(), bytes: sent.data.len(), known }
    }
}

/// The index of a map's places.
#[derive(Debug, Default)]
pub(crate) struct Places {
    known: RwLock<Indexed>,
    /// Memory of the index.
    bytes: AtomicU64,
}

#[derive(Debug, Default)]
pub(crate) struct Indexed {
    index: PlaceIndex,
    /// What each keyframe was indexed with.
    indexed: BTreeMap<EntityId, Entry>,
    /// The revision whose keyframes are all indexed.
    revision: Option<i64>,
}

#[derive(Debug)]
struct Entry {
    observations: Observations,
    /// Why the index does not hold it.
    refusal: Option<Box<PlaceRefusal>>,
}

impl Indexed {
    /// Whether it is as new as the map.
    fn is_current(&self, map: &Map) -> bool {
        self.revision >= Some(map.revision())
    }

    /// Indexes a piece of what is not as in the map, which is newer. What is done when the interrupt is due
    /// is kept.
    fn update(&mut self, map: &Map, interrupt: &Interrupt) {
        let keyframes = map.keyframes();
        let mut left = PIECE;
        let gone = self.indexed.iter().filter(|(id, _)| !keyframes.contains_key(id));
        let gone: Vec<_> = gone.map(|(&id, entry)| (id, entry.observations.len())).collect();
        for (id, count) in gone {
            if left == 0 || interrupt.is_due() {
                return;
            }
            self.index.remove(id);
            self.indexed.remove(&id);
            left = left.saturating_sub(count);
        }
        let is_due = |id: &EntityId, seen: &Observations| {
            self.indexed.get(id).is_none_or(|entry| !entry.observations.is_same(seen))
        };
        let due = keyframes.iter().filter(|(id, keyframe)| is_due(id, &keyframe.observations));
        // In the order of their age: the index is a function of its calls, and the same after a restart.
        let mut due: Vec<_> = due.map(|(&id, known)| ((known.added_revision, id), known)).collect();
        due.sort_unstable_by_key(|&(age, _)| age);
        for ((_, id), keyframe) in due {
            if left == 0 || interrupt.is_due() {
                return;
            }
            self.index.remove(id);
            let (_, features) = indexed(keyframe);
            left = left.saturating_sub(features.len());
            let added = if features.is_empty() {
                Ok(())
            } else {
                self.index.add(id, keyframe.capture_time_ns, &features)
            };
            if let (Ok(()), Some(image)) =
                (&added, comparable(keyframe.global_descriptor.as_deref()))
                && let Err(error) = self.index.add_image(id, keyframe.capture_time_ns, &image)
            {
                tracing::debug!(keyframe = %id, %error, "an image is not compared");
            }
            let refusal = added.err().map(|error| Box::new(not_indexed(&error)));
            let observations = keyframe.observations.clone();
            self.indexed.insert(id, Entry { observations, refusal });
        }
        self.revision = Some(map.revision());
    }

    /// Whether the index has what the keyframe sees in this map.
    fn has(&self, map: &Map, id: EntityId) -> bool {
        let entry = self.indexed.get(&id).filter(|entry| entry.refusal.is_none());
        let seen = map.keyframes().get(&id).map(|keyframe| &keyframe.observations);
        entry.zip(seen).is_some_and(|(entry, seen)| entry.observations.is_same(seen))
    }
}

impl Places {
    fn write(&self) -> RwLockWriteGuard<'_, Indexed> {
        // An index that a panic left is made anew: the lock is poisoned then.
        self.known.write().unwrap_or_else(|poisoned| {
            self.known.clear_poison();
            let mut known = PoisonError::into_inner(poisoned);
            *known = Indexed::default();
            known
        })
    }

    fn read(&self) -> RwLockReadGuard<'_, Indexed> {
        if self.known.is_poisoned() {
            drop(self.write());
        }
        self.known.read().unwrap_or_else(PoisonError::into_inner)
    }

    /// The index, where it takes more memory than `map` counts for it: keyframes left the map and nothing
    /// was searched since, or nothing is to be searched any more. Does not wait for who uses it.
    pub(crate) fn take_excess(&self, map: &Map) -> Option<Indexed> {
        let most = if map.policy().place_recognition { map.descriptor_bytes() + LEAST } else { 0 };
        if self.bytes.load(Ordering::Relaxed) <= most {
            return None;
        }
        let mut known = self.known.try_write().ok()?;
        self.bytes.store(0, Ordering::Relaxed);
        Some(std::mem::take(&mut *known))
    }

    /// Indexes a piece of what the index lacks of a map: a tenth of a second at most, so that whoever has
    /// much to index can give its thread to others in between. Whether nothing is left to do: the index is
    /// as new as the map, or the interrupt is due.
    pub(crate) fn advance(&self, map: &Map, interrupt: &Interrupt) -> bool {
        if interrupt.is_due() || self.read().is_current(map) {
            return true;
        }
        let mut known = self.write();
        // Another search may have done so meanwhile.
        if !known.is_current(map) {
            known.update(map, interrupt);
            self.bytes.store(known.index.bytes() as u64, Ordering::Relaxed);
        }
        known.is_current(map) || interrupt.is_due()
    }

    /// The candidates for the place of a view, best first, none of those that `is_excluded` names. None
    /// where the interrupt was due.
    ///
    /// # Errors
    /// [`PlaceError`] where the view has more descriptors than a keyframe may have.
    pub(crate) fn candidates(
        &self,
        map: &Map,
        view: &QueryView<'_>,
        interrupt: &Interrupt,
        is_excluded: &dyn Fn(EntityId) -> bool,
    ) -> Result<Vec<Candidate>, PlaceError> {
        let (_, features) = view.searchable();
        if features.is_empty() {
            return Ok(Vec::new());
        }
        while !self.advance(map, interrupt) {}
        if interrupt.is_due() {
            return Ok(Vec::new());
        }
        let known = self.read();
        // What is not in this map as it was indexed, from an earlier or a later one, is no candidate.
        // As a trait object, so that the search is compiled once for all who ask.
        let is_out: &dyn Fn(EntityId) -> bool = &|id| is_excluded(id) || !known.has(map, id);
        let image = comparable(view.image);
        known.index.query(&features, image.as_ref(), PlaceSearch::MOST_CANDIDATES, is_out)
    }

    /// What is wrong with the descriptors of a view, if none of its features, or its image, has a type
    /// that the index holds. An index without descriptors refuses none.
    pub(crate) fn unknown_type(&self, view: &QueryView<'_>) -> Option<UnknownType> {
        let known = self.read();
        let (indices, features) = view.searchable();
        let types: Vec<_> = known.index.descriptor_types().collect();
        let is_known = |f: &Feature<'_>| types.contains(&(f.name, f.data.len()));
        if let Some((&feature, first)) = indices.first().zip(features.first())
            && !types.is_empty()
            && !features.iter().any(is_known)
        {
            return Some(UnknownType::new(Some(feature), first, &types));
        }
        let image = comparable(view.image)?;
        let types: Vec<_> = known.index.image_descriptor_types().collect();
        let is_known = types.is_empty() || types.contains(&(image.name, image.data.len()));
        (!is_known).then(|| UnknownType::new(None, &image, &types))
    }

    /// Why the index does not hold a keyframe, if it was refused.
    pub(crate) fn refusal(&self, keyframe: EntityId) -> Option<PlaceRefusal> {
        self.read().indexed.get(&keyframe)?.refusal.as_deref().cloned()
    }
}

#[cfg(test)]
mod tests;
