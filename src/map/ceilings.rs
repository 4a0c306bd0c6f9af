//! What maps hold, counted, and the most that they may hold.
//!
//! [`Usage`] of a map is kept by the fold and costs nothing to ask for; [`Map::growth`] is what a
//! change would add. The same [`Ceilings`] serve for a map and for all maps of a tenant together.
//! Bytes are an estimate of the memory that the map takes, from the numbers of its entities; what
//! a change adds to the covisibility shows only after it, so that one item may pass the ceiling.

use std::mem::size_of;
use std::ops::{Add, Mul, Sub};

use super::{Change, Constraint, Digest, EntityId, Keyframe, Landmark, Map, Observation, Prior};

/// Limits of what is held; `None` is unlimited.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Ceilings {
    /// Keyframes.
    pub max_keyframes: Option<u64>,
    /// Landmarks.
    pub max_landmarks: Option<u64>,
    /// Observations.
    pub max_observations: Option<u64>,
    /// Estimated memory in bytes.
    pub max_bytes: Option<u64>,
}

/// What is held.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Usage {
    /// Keyframes.
    pub keyframes: u64,
    /// Landmarks.
    pub landmarks: u64,
    /// Observations.
    pub observations: u64,
    /// Estimated memory in bytes.
    pub bytes: u64,
}

/// Which ceiling something would pass.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Passed {
    /// What there is too much of.
    pub resource: Resource,
    /// The ceiling's value.
    pub maximum: u64,
}

/// What ceilings are about.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Resource {
    /// Keyframes.
    Keyframes,
    /// Landmarks.
    Landmarks,
    /// Observations.
    Observations,
    /// Estimated memory.
    Bytes,
}

impl Ceilings {
    /// The first ceiling that `growth` on top of `usage` passes. What does not grow passes none.
    #[must_use]
    pub fn passed(&self, usage: Usage, growth: Usage) -> Option<Passed> {
        let all = [
            (Resource::Keyframes, usage.keyframes, growth.keyframes, self.max_keyframes),
            (Resource::Landmarks, usage.landmarks, growth.landmarks, self.max_landmarks),
            (
                Resource::Observations,
                usage.observations,
                growth.observations,
                self.max_observations,
            ),
            (Resource::Bytes, usage.bytes, growth.bytes, self.max_bytes),
        ];
        all.into_iter().find_map(|(resource, present, added, maximum)| {
            let maximum = maximum?;
            let passes = added > 0 && present.saturating_add(added) > maximum;
            passes.then_some(Passed { resource, maximum })
        })
    }
}

impl Add for Usage {
    type Output = Self;

    fn add(self, other: Self) -> Self {
        Self {
            keyframes: self.keyframes.saturating_add(other.keyframes),
            landmarks: self.landmarks.saturating_add(other.landmarks),
            observations: self.observations.saturating_add(other.observations),
            bytes: self.bytes.saturating_add(other.bytes),
        }
    }
}

impl Mul<u64> for Usage {
    type Output = Self;

    fn mul(self, times: u64) -> Self {
        Self {
            keyframes: self.keyframes.saturating_mul(times),
            landmarks: self.landmarks.saturating_mul(times),
            observations: self.observations.saturating_mul(times),
            bytes: self.bytes.saturating_mul(times),
        }
    }
}

impl Sub for Usage {
    type Output = Self;

    fn sub(self, other: Self) -> Self {
        Self {
            keyframes: self.keyframes.saturating_sub(other.keyframes),
            landmarks: self.landmarks.saturating_sub(other.landmarks),
            observations: self.observations.saturating_sub(other.observations),
            bytes: self.bytes.saturating_sub(other.bytes),
        }
    }
}

/// An entry of an ordered map: key, value, and its share of half-full nodes.
const fn entry(value: usize) -> u64 {
    let bytes = size_of::<EntityId>() + value;
    (bytes + bytes / 2) as u64
}

/// With its digest, its place in the order of age and the counters of its shared list.
const KEYFRAME: u64 = entry(size_of::<Keyframe>()) + entry(size_of::<Digest>()) + entry(8) + 16;
const LANDMARK: u64 = entry(size_of::<Landmark>());
/// Also stands in its landmark's list of observers, which may be twice as long as it needs.
const OBSERVATION: u64 = (size_of::<Observation>() + 2 * size_of::<EntityId>()) as u64;
const CONSTRAINT: u64 = entry(size_of::<Constraint>()) + entry(size_of::<Digest>());
const PRIOR: u64 = entry(size_of::<Prior>()) + entry(size_of::<Digest>());
const SHARED_PAIR: u64 = entry(size_of::<u32>());
/// A descriptor's own memory besides its bytes.
const DESCRIPTOR: u64 = 80;
const ITEM: u64 = (3 * (size_of::<i64>() + size_of::<Digest>()) / 2) as u64;

/// Memory of the descriptors of `observations`.
pub(super) fn descriptor_bytes(observations: &[Observation]) -> u64 {
    let descriptors = observations.iter().filter_map(|o| o.descriptor.as_ref());
    descriptors.map(|d| (d.data.len() + d.name.len()) as u64 + DESCRIPTOR).sum()
}

impl Map {
    /// What the map holds.
    #[must_use]
    pub fn usage(&self) -> Usage {
        let keyframes = self.keyframes.len() as u64;
        let landmarks = self.landmarks.len() as u64;
        let items: usize = self.clients.iter().map(|client| client.items.len()).sum();
        let bytes = keyframes * KEYFRAME
            + landmarks * LANDMARK
            + self.observation_count * OBSERVATION
            + self.descriptor_bytes
            + self.constraints.len() as u64 * CONSTRAINT
            + self.priors.len() as u64 * PRIOR
            + self.covisibility.entry_count() * SHARED_PAIR
            + items as u64 * ITEM;
        Usage { keyframes, landmarks, observations: self.observation_count, bytes }
    }

    /// What a client's change would add to [`Map::usage`].
    #[must_use]
    pub fn growth(&self, change: &Change) -> Usage {
        let (keyframes, new, observations, fixed) = match change {
            Change::KeyframeAdded { observations, landmarks, .. } => {
                (1, landmarks.as_slice(), observations.as_slice(), KEYFRAME)
            }
            Change::LandmarksAdded { landmarks } => (0, landmarks.as_slice(), [].as_slice(), 0),
            Change::ObservationsAdded { observations, .. } => {
                (0, [].as_slice(), observations.as_slice(), 0)
            }
            Change::ConstraintAdded { .. } => (0, [].as_slice(), [].as_slice(), CONSTRAINT),
            Change::PriorAdded { .. } => (0, [].as_slice(), [].as_slice(), PRIOR),
            Change::Created { .. }
            | Change::ClientOpened { .. }
            | Change::CameraSet { .. }
            | Change::LandmarksTriangulated { .. }
            | Change::SolveApplied { .. }
            | Change::ObservationsRemoved { .. }
            | Change::LandmarksFused { .. }
            | Change::LandmarksRemoved { .. }
            | Change::KeyframeRemoved { .. }
            | Change::KeyframeRetired { .. }
            | Change::ConstraintRevoked { .. }
            | Change::PolicySet { .. } => return Usage::default(),
        };
        let is_new = |id: &EntityId| !self.landmarks.contains_key(id);
        let landmarks = new.iter().filter(|landmark| is_new(&landmark.id)).count() as u64;
        let seen = observations.len() as u64;
        let bytes =
            fixed + landmarks * LANDMARK + seen * OBSERVATION + descriptor_bytes(observations);
        Usage { keyframes, landmarks, observations: seen, bytes }
    }
}
