//! What the searches for known places found: of each keyframe the candidates and their verdicts.
//!
//! A keyframe whose descriptors are new waits here until its place was searched, so that whoever takes
//! the map over (a restart, an import) continues with it. Each candidate that was refused keeps its
//! reason, so that a user can ask why a loop was not closed. Nothing is searched here.

use super::usage::entry;
use super::{DescriptorKind, EntityId, Map, Observation, SharedMap};

/// A keyframe that looked like the place of another one.
#[derive(Clone, Debug, PartialEq)]
pub struct PlaceCandidate {
    /// The keyframe that was there before.
    pub keyframe: EntityId,
    /// How much of its appearance is that of the other one, from 0 to 1.
    pub score: f64,
    /// Descriptors that match.
    pub matches: u32,
    /// Why it is not the same place; `None` where it is.
    pub refusal: Option<PlaceRefusal>,
}

/// Why two keyframes were not joined.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct PlaceRefusal {
    /// The name of the reason, in snake case.
    pub reason: String,
    /// With its numbers, for people.
    pub text: String,
}

impl PlaceRefusal {
    /// Longest reason or text, bytes: numbers and names that clients send may be long.
    pub const LONGEST: usize = 160;

    /// A reason with its text, which is cut off where it is longer than [`PlaceRefusal::LONGEST`].
    #[must_use]
    pub fn new(reason: &str, text: &str) -> Self {
        let cut = |text: &str| text[..text.floor_char_boundary(Self::LONGEST)].to_owned();
        Self { reason: cut(reason), text: cut(text) }
    }

    /// Whether it is as [`PlaceRefusal::new`] makes it.
    pub(super) fn is_short(&self) -> bool {
        self.reason.len() <= Self::LONGEST && self.text.len() <= Self::LONGEST
    }
}

/// What the search for the place of a keyframe found.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct PlaceSearch {
    /// Candidates that were verified, at most [`PlaceSearch::MOST_CANDIDATES`], in the order of the
    /// verification; only the last one may have no refusal.
    pub candidates: Vec<PlaceCandidate>,
    /// The loop closure that it added; it may have been removed since.
    pub closure: Option<EntityId>,
    /// Why the place was not searched, or no closure was added.
    pub refusal: Option<PlaceRefusal>,
}

impl PlaceSearch {
    /// Most candidates that are verified. The best one is nearly always right where any is; each that is
    /// refused takes some 30 ms.
    pub const MOST_CANDIDATES: usize = 3;
}

/// The searches of a map.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct PlaceSearches {
    /// Keyframes whose place is to be searched, with the revision that brought their descriptors.
    pub pending: SharedMap<EntityId, i64>,
    /// What was found, by keyframe.
    pub done: SharedMap<EntityId, PlaceSearch>,
    /// The last revision that added closures which no pose graph has covered; 0 where there is none.
    pub unsolved: i64,
}

impl PlaceSearches {
    /// A keyframe gets observations at `revision`.
    pub(super) fn observed(&mut self, keyframe: EntityId, added: &[Observation], revision: i64) {
        if added.iter().any(is_searchable) {
            self.pending.insert(keyframe, revision);
        }
    }

    /// A search ended, at `revision`.
    pub(super) fn searched(&mut self, keyframe: EntityId, search: &PlaceSearch, revision: i64) {
        self.pending.remove(&keyframe);
        if search.closure.is_some() {
            self.unsolved = revision;
        }
        self.done.insert(keyframe, search.clone());
    }

    /// A pose graph covers the closures of all searches up to `revision`.
    pub(super) fn solved(&mut self, revision: i64) {
        if self.unsolved <= revision {
            self.unsolved = 0;
        }
    }

    /// A keyframe leaves the map.
    pub(super) fn remove(&mut self, keyframe: EntityId) {
        self.pending.remove(&keyframe);
        self.done.remove(&keyframe);
    }

    /// Nothing is to be searched any more.
    pub(super) fn stop(&mut self) {
        self.pending = SharedMap::default();
    }

    /// Estimated memory of what was found.
    pub(super) fn bytes(&self) -> u64 {
        self.done.len() as u64 * SEARCH
    }
}

/// Bytes of a reason, which has a word or two, and its text, at most.
const REFUSAL: usize = 32 + PlaceRefusal::LONGEST;
/// Memory of what a search found.
pub(super) const SEARCH: u64 = entry(
    size_of::<PlaceSearch>()
        + PlaceSearch::MOST_CANDIDATES * (size_of::<PlaceCandidate>() + REFUSAL)
        + REFUSAL,
);

/// Whether a place can be recognized by the descriptor of an observation.
fn is_searchable(observation: &Observation) -> bool {
    observation.descriptor.as_ref().is_some_and(|d| d.kind == DescriptorKind::Binary)
}

impl Map {
    /// What the searches for known places found.
    pub fn place_searches(&self) -> &PlaceSearches {
        &self.parts.place_searches
    }

    /// Estimated memory of the descriptors and of an index of them, part of [`Map::usage`].
    pub fn descriptor_bytes(&self) -> u64 {
        self.descriptor_bytes
    }
}
