//! Names of clients and entities inside a map.
//!
//! A client chooses the ids of its cameras, keyframes, landmarks and constraints; within a map an
//! entity is named by (client, id). Ids order as (client, id), which is the order of every table.
//! Nothing here knows how the wire spells a reference.

use std::fmt;
use std::ops::RangeInclusive;

use super::SharedMap;

/// Position of a client in [`Map::clients`](super::Map::clients); never changes once given.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct ClientIndex(pub u32);

impl ClientIndex {
    /// Stands for the server where what it added itself is counted beside the items of clients. No client
    /// has this index.
    pub const SERVER: Self = Self(u32::MAX);

    /// One more than the highest id of its entities in a table; 0 where it has none.
    pub(crate) fn next_id<V>(self, table: &SharedMap<EntityId, V>) -> i64 {
        let end = EntityId::new(Self(self.0.saturating_add(1)), i64::MIN);
        let last = table.entry_before(&end).map(|(id, _)| id).filter(|id| id.client == self);
        last.map_or(0, |last| last.id.saturating_add(1))
    }

    /// The ids of its entities.
    pub(crate) fn ids(self) -> RangeInclusive<EntityId> {
        EntityId::new(self, i64::MIN)..=EntityId::new(self, i64::MAX)
    }
}

/// A camera, keyframe, landmark or constraint (priors included) of one client.
///
/// Each of the four kinds has its own id space.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct EntityId {
    /// The client that owns it.
    pub client: ClientIndex,
    /// The client's id for it, at least 0.
    pub id: i64,
}

impl EntityId {
    /// Before all others.
    pub(super) const MIN: Self = Self { client: ClientIndex(0), id: i64::MIN };
    /// Behind all others.
    pub(super) const MAX: Self = Self { client: ClientIndex(u32::MAX), id: i64::MAX };

    /// Number of ids of the server's own constraints for each revision; they are below zero.
    pub const OWN_PER_REVISION: usize = 4096;

    /// The id of the server's own constraint `number`, below [`EntityId::OWN_PER_REVISION`], of those that
    /// it adds to a client's keyframes with the event that makes `revision`.
    pub fn own(client: ClientIndex, revision: i64, number: usize) -> Self {
        let first = revision.saturating_mul(-(Self::OWN_PER_REVISION as i64));
        Self { client, id: first.saturating_add_unsigned(number as u64) }
    }

    /// Whether it names a constraint of the server's own.
    pub fn is_own(&self) -> bool {
        self.id < 0
    }

    /// The entity `id` of `client`.
    #[must_use]
    pub fn new(client: ClientIndex, id: i64) -> Self {
        Self { client, id }
    }
}

impl fmt::Display for EntityId {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{} of client {}", self.id, self.client.0)
    }
}
