//! Counts of what maps hold, and limits on them.
//!
//! The fold keeps the [`Usage`] of a map, so that reading it costs nothing; [`Map::growth`] is the most
//! that a change would add. The same [`MapLimits`] apply to a map, to all maps of a tenant and to all
//! maps of a server. Every kind of entity counts. Bytes are an estimate of the memory that the map
//! takes, from the numbers of its entities. Nothing is refused here: what happens at a limit is
//! decided by the engine.

use std::mem::size_of;
use std::ops::{Add, Mul, Sub};

use serde::Deserialize;

use super::covisibility::NEAREST;
use super::place_searches::SEARCH;
use super::{
    CameraEntity, Change, Client, Constraint, Descriptor, DescriptorKind, Digest, EntityId,
    Keyframe, Landmark, Map, MergedClient, MergedMap, NewLandmark, Observation, Prior, SwitchedOff,
};

/// One value for each kind of what maps hold.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Counts<T> {
    /// Clients that have ever opened a stream.
    #[serde(rename = "max_clients")]
    pub clients: T,
    /// Cameras.
    #[serde(rename = "max_cameras")]
    pub cameras: T,
    /// Keyframes.
    #[serde(rename = "max_keyframes")]
    pub keyframes: T,
    /// Landmarks.
    #[serde(rename = "max_landmarks")]
    pub landmarks: T,
    /// Observations.
    #[serde(rename = "max_observations")]
    pub observations: T,
    /// Relative-pose constraints, those that are switched off too.
    #[serde(rename = "max_constraints")]
    pub constraints: T,
    /// Pose priors and position priors.
    #[serde(rename = "max_priors")]
    pub priors: T,
    /// Estimated memory in bytes.
    #[serde(rename = "max_bytes")]
    pub bytes: T,
}

/// What is held.
pub type Usage = Counts<u64>;

/// Limits of what is held; `None` is unlimited. `[map_limits]` of `covis.toml` has a key for each.
pub type MapLimits = Counts<Option<u64>>;

/// Which limit a change would exceed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Exceeded {
    /// What there is too much of.
    pub counted: Counted,
    /// The limit's value.
    pub maximum: u64,
}

/// What of a map is counted.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
#[allow(missing_docs, reason = "the fields of `Counts` have them")]
pub enum Counted {
    Clients,
    Cameras,
    Keyframes,
    Landmarks,
    Observations,
    Constraints,
    Priors,
    Bytes,
}

impl Counted {
    /// Each of them.
    pub const ALL: [Self; 8] = [
        Self::Clients,
        Self::Cameras,
        Self::Keyframes,
        Self::Landmarks,
        Self::Observations,
        Self::Constraints,
        Self::Priors,
        Self::Bytes,
    ];
}

impl<T: Copy> Counts<T> {
    /// The values that a function gives.
    pub fn each(mut value: impl FnMut(Counted) -> T) -> Self {
        Self {
            clients: value(Counted::Clients),
            cameras: value(Counted::Cameras),
            keyframes: value(Counted::Keyframes),
            landmarks: value(Counted::Landmarks),
            observations: value(Counted::Observations),
            constraints: value(Counted::Constraints),
            priors: value(Counted::Priors),
            bytes: value(Counted::Bytes),
        }
    }

    /// The value of one kind.
    pub fn of(&self, counted: Counted) -> T {
        match counted {
            Counted::Clients => self.clients,
            Counted::Cameras => self.cameras,
            Counted::Keyframes => self.keyframes,
            Counted::Landmarks => self.landmarks,
            Counted::Observations => self.observations,
            Counted::Constraints => self.constraints,
            Counted::Priors => self.priors,
            Counted::Bytes => self.bytes,
        }
    }
}

impl MapLimits {
    /// These limits where they are set, otherwise those of `default`.
    #[must_use]
    pub fn over(&self, default: &Self) -> Self {
        Self::each(|counted| self.of(counted).or(default.of(counted)))
    }

    /// The lower one of both limits for each kind.
    #[must_use]
    pub fn lower(&self, other: &Self) -> Self {
        Self::each(|counted| match (self.of(counted), other.of(counted)) {
            (Some(a), Some(b)) => Some(a.min(b)),
            (one, None) | (None, one) => one,
        })
    }

    /// The first limit that `growth` on top of `usage` exceeds. A count that does not grow exceeds
    /// none.
    pub fn exceeded(&self, usage: Usage, growth: Usage) -> Option<Exceeded> {
        Counted::ALL.into_iter().find_map(|counted| {
            let maximum = self.of(counted)?;
            let (present, added) = (usage.of(counted), growth.of(counted));
            let passes = added > 0 && present.saturating_add(added) > maximum;
            passes.then_some(Exceeded { counted, maximum })
        })
    }
}

impl Add for Usage {
    type Output = Self;

    fn add(self, other: Self) -> Self {
        Self::each(|counted| self.of(counted).saturating_add(other.of(counted)))
    }
}

impl Mul<u64> for Usage {
    type Output = Self;

    fn mul(self, times: u64) -> Self {
        Self::each(|counted| self.of(counted).saturating_mul(times))
    }
}

impl Sub for Usage {
    type Output = Self;

    fn sub(self, other: Self) -> Self {
        Self::each(|counted| self.of(counted).saturating_sub(other.of(counted)))
    }
}

/// An entry of an ordered map: key, value, and its share of half-full nodes.
pub(super) const fn entry(value: usize) -> u64 {
    let bytes = size_of::<EntityId>() + value;
    (bytes + bytes / 2) as u64
}

/// A client with its name; its items count by themselves.
const CLIENT: u64 = size_of::<Client>() as u64 + 64;
const CAMERA: u64 = entry(size_of::<CameraEntity>()) + entry(size_of::<Digest>());
/// With its digest, its place in the orders of age, of time and of arrival, in the index of places and among
/// those whose place is to be searched, and the counters of its shared list.
const KEYFRAME: u64 = entry(size_of::<Keyframe>())
    + entry(size_of::<Digest>())
    + 4 * entry(8)
    + INDEXED_KEYFRAME
    + 16;
const LANDMARK: u64 = entry(size_of::<Landmark>());
/// A landmark without observers is in a separate list.
const UNSEEN: u64 = entry(size_of::<i64>());
/// It is also in its landmark's list of observers, whose counters and padding take no more than it needs
/// itself, and in the index of its keyframe.
const OBSERVATION: u64 = (size_of::<Observation>() + 2 * size_of::<EntityId>() + 4) as u64;
/// In the index of its keyframe.
const TIE: u64 = entry(size_of::<EntityId>());
const CONSTRAINT: u64 = entry(size_of::<Constraint>()) + entry(size_of::<Digest>()) + 2 * TIE;
const SWITCHED_OFF: u64 = entry(size_of::<SwitchedOff>());
/// In both orders, each key with one landmark more than others.
const DUPLICATE: u64 = 2 * entry(size_of::<EntityId>() + size_of::<Option<EntityId>>());
const PRIOR: u64 = entry(size_of::<Prior>()) + entry(size_of::<Digest>()) + TIE;
const SHARED_PAIR: u64 = entry(size_of::<u32>());
/// An observer of a landmark with many, in a list that may be twice as long as it needs.
const LONG_OBSERVER: u64 = 2 * size_of::<(i64, EntityId)>() as u64;
/// A descriptor's own memory besides its bytes.
const DESCRIPTOR: u64 = 80;
/// Observers of a landmark that has the most without such a list.
const NOT_LONG: usize = NEAREST + 1;
/// A map that became part of this one, with its names.
const MERGED: u64 = size_of::<MergedMap>() as u64 + 320;
/// A client that came with it, with its name there.
const MERGED_CLIENT: u64 = size_of::<MergedClient>() as u64 + 64;
/// The digest of a client's item with its sequence.
const ITEM: u64 = (3 * (size_of::<i64>() + size_of::<Digest>()) / 2) as u64;

/// What the index of places takes for a binary descriptor besides a copy of its bits, at most: its number,
/// and of each of two tables an entry in a bucket that is full beside others that are empty.
const INDEXED: u64 = 48;
/// Bytes that the index of places takes for a keyframe, at most.
pub const INDEXED_KEYFRAME: u64 = 240;

/// Memory of the descriptors of `observations`. The index of places counts whether or not the policy
/// wants one: it can be switched on at any time.
pub(super) fn descriptor_bytes(observations: &[Observation]) -> u64 {
    let descriptors = observations.iter().filter_map(|o| o.descriptor.as_ref());
    let bytes = |d: &Descriptor| match d.kind {
        // The index has whole words.
        DescriptorKind::Binary => {
            let copies = d.data.len() + d.data.len().next_multiple_of(8);
            (copies + d.name.len()) as u64 + DESCRIPTOR + INDEXED
        }
        DescriptorKind::Float32 | DescriptorKind::Uint8 => {
            (d.data.len() + d.name.len()) as u64 + DESCRIPTOR
        }
    };
    descriptors.map(|descriptor| bytes(descriptor)).sum()
}

/// Memory of the descriptor of a whole image, with the index's copy of it.
pub(super) fn image_bytes(descriptor: Option<&Descriptor>) -> u64 {
    descriptor.map_or(0, |descriptor| {
        (2 * descriptor.data.len() + 2 * descriptor.name.len()) as u64 + 2 * DESCRIPTOR
    })
}

const NOTHING: Usage = Usage {
    clients: 0,
    cameras: 0,
    keyframes: 0,
    landmarks: 0,
    observations: 0,
    constraints: 0,
    priors: 0,
    bytes: 0,
};
/// What every item adds: its digest.
const NEW_ITEM: Usage = Usage { bytes: ITEM, ..NOTHING };
/// A keyframe without its observations.
const NEW_KEYFRAME: Usage = Usage { keyframes: 1, bytes: KEYFRAME + ITEM, ..NOTHING };

impl Map {
    /// What the map holds.
    pub fn usage(&self) -> Usage {
        let clients = self.clients().len() as u64;
        let cameras = self.cameras().len() as u64;
        let keyframes = self.keyframes().len() as u64;
        let landmarks = self.landmarks().len() as u64;
        let observations = self.observation_count;
        let constraints = self.constraints().len() as u64;
        let priors = self.priors().len() as u64;
        let items: usize = self.clients().iter().map(|client| client.items.len()).sum();
        let bytes = clients * CLIENT
            + items as u64 * ITEM
            + cameras * CAMERA
            + keyframes * KEYFRAME
            + landmarks * LANDMARK
            + self.unseen.len() as u64 * UNSEEN
            + observations * OBSERVATION
            + self.descriptor_bytes
            + constraints * CONSTRAINT
            + self.switched_off().len() as u64 * SWITCHED_OFF
            + priors * PRIOR
            + self.duplicates().len() as u64 * DUPLICATE
            + self.place_searches().bytes()
            + self.merged().iter().map(|merged| merged_bytes(&merged.clients)).sum::<u64>()
            + self.covisibility.entry_count() * SHARED_PAIR
            + self.covisibility.long_count() * LONG_OBSERVER;
        Usage { clients, cameras, keyframes, landmarks, observations, constraints, priors, bytes }
    }

    /// An upper bound of [`Map::growth`], from the lengths of the change's lists alone: most changes
    /// are far from every limit, and looking up each landmark to know so is expensive.
    pub fn growth_bound(&self, change: &Change) -> Usage {
        let by_observations = |added: &[Observation]| {
            let neighbors = (added.len() * 2 * NEAREST).min(self.keyframes().len()) as u64;
            growth_by(added, neighbors, added.len() as u64 * (NOT_LONG as u64 + 1))
        };
        self.growth_of(change, |new| growth_by_landmarks(new.len()), by_observations)
    }

    /// The most that a client's change would add to [`Map::usage`].
    ///
    /// A removal adds nothing, so that a full map takes it: it frees more than its digest takes. Only
    /// if a landmark loses some of more than 33 observers may bytes grow, because keyframes come to
    /// share it that others stood between.
    pub fn growth(&self, change: &Change) -> Usage {
        let by_landmarks = |new: &[NewLandmark]| {
            let is_new = |new: &&NewLandmark| !self.landmarks().contains_key(&new.id);
            growth_by_landmarks(new.iter().filter(is_new).count())
        };
        self.growth_of(change, by_landmarks, |added| self.growth_by(added))
    }

    /// What a change adds, with what its landmarks and its observations add.
    fn growth_of(
        &self,
        change: &Change,
        by_landmarks: impl Fn(&[NewLandmark]) -> Usage,
        by_observations: impl Fn(&[Observation]) -> Usage,
    ) -> Usage {
        match change {
            Change::KeyframeAdded { observations, landmarks, global_descriptor, .. } => {
                let bytes = image_bytes(global_descriptor.as_deref());
                let image = Usage { bytes, ..NOTHING };
                NEW_KEYFRAME + image + by_landmarks(landmarks) + by_observations(observations)
            }
            Change::LandmarksAdded { landmarks, .. } => NEW_ITEM + by_landmarks(landmarks),
            Change::ObservationsAdded { observations, .. } => {
                NEW_ITEM + by_observations(observations)
            }
            Change::ConstraintAdded { .. } => {
                Usage { constraints: 1, bytes: CONSTRAINT + ITEM, ..NOTHING }
            }
            Change::PriorAdded { .. } => Usage { priors: 1, bytes: PRIOR + ITEM, ..NOTHING },
            Change::CameraSet { id, .. } if !self.cameras().contains_key(id) => {
                Usage { cameras: 1, bytes: CAMERA + ITEM, ..NOTHING }
            }
            Change::ClientOpened { name, .. } if self.client_named(name).is_none() => {
                Usage { clients: 1, bytes: CLIENT, ..NOTHING }
            }
            Change::ItemRepeated | Change::CameraSet { .. } => NEW_ITEM,
            Change::PlacesSearched { searches, closures } => {
                let constraints = closures.len() as u64;
                let bytes = searches.len() as u64 * SEARCH + constraints * CONSTRAINT;
                Usage { constraints, bytes, ..NOTHING }
            }
            Change::LandmarksFused { kept, absorbed } => {
                NEW_ITEM + self.growth_by_fusing(*kept, absorbed)
            }
            Change::MapMerged { merge } => {
                merge.content.usage() + Usage { bytes: merged_bytes(&merge.clients), ..NOTHING }
            }
            Change::MapTakenOut { .. }
            | Change::Created { .. }
            | Change::ClientOpened { .. }
            | Change::LandmarksTriangulated { .. }
            | Change::SolveApplied { .. }
            | Change::DuplicatesFound { .. }
            | Change::DuplicatesSplit { .. }
            | Change::ObservationsRemoved { .. }
            | Change::LandmarksRemoved { .. }
            | Change::KeyframeRemoved { .. }
            | Change::KeyframeRetired { .. }
            | Change::ConstraintRevoked { .. }
            | Change::MapUpdated { .. } => NOTHING,
        }
    }

    /// Each observer of a landmark that is absorbed may become a neighbor of those of the others.
    fn growth_by_fusing(&self, kept: EntityId, absorbed: &[EntityId]) -> Usage {
        let observers = |id| self.landmarks().get(id).map_or(0, |l| l.observers.len());
        let moved: usize = absorbed.iter().map(observers).sum();
        let all = moved + observers(&kept);
        let pairs = (moved as u64).saturating_mul(all.min(2 * NEAREST) as u64);
        let long = if all > NOT_LONG { all as u64 } else { 0 };
        let bytes = 2 * pairs * SHARED_PAIR + long * LONG_OBSERVER;
        Usage { bytes, ..NOTHING }
    }

    fn growth_by(&self, observations: &[Observation]) -> Usage {
        // Each observer of a landmark that counts may be a new neighbor, in both rows; there are no
        // more neighbors than keyframes.
        let (mut neighbors, mut long) = (0, 0);
        for observation in observations {
            let known = self.landmarks().get(&observation.landmark);
            let observers = known.map_or(0, |landmark| landmark.observers.len());
            neighbors += observers.min(2 * NEAREST);
            long += match observers {
                0..=NEAREST => 0,
                NOT_LONG => NOT_LONG as u64 + 1,
                _ => 1,
            };
        }
        growth_by(observations, neighbors.min(self.keyframes().len()) as u64, long)
    }
}

/// Memory of what is kept of a merge with these clients.
fn merged_bytes(clients: &[MergedClient]) -> u64 {
    MERGED + clients.len() as u64 * MERGED_CLIENT
}

/// Of so many new landmarks.
fn growth_by_landmarks(count: usize) -> Usage {
    let landmarks = count as u64;
    Usage { landmarks, bytes: landmarks * (LANDMARK + UNSEEN), ..NOTHING }
}

/// Of observations with so many new neighbors of their keyframe and entries in lists of observers.
fn growth_by(added: &[Observation], neighbors: u64, long: u64) -> Usage {
    let observations = added.len() as u64;
    let bytes = observations * OBSERVATION
        + descriptor_bytes(added)
        + 2 * neighbors * SHARED_PAIR
        + long * LONG_OBSERVER;
    Usage { observations, bytes, ..NOTHING }
}
