//! The map: clients, cameras, keyframes, landmarks, observations, constraints, covisibility.
//!
//! A [`Map`] is the fold of its [`Event`]s, which carry values: the same journal gives the same bits.
//! [`Map::check`] turns a client's [`Item`] into a [`Change`] or refuses it with the fields' names;
//! [`problem`] is the only place that turns a map into a solver problem, and [`applied`](applied())
//! turns the result of a solve into a change. No map is solved here and nothing here is asynchronous: no
//! tokio, tonic or prost, no clock and no files.
//!
//! In the order in which they are best read:
//!
//! | items | role |
//! |---|---|
//! | [`EntityId`], [`Client`], [`Keyframe`], [`Landmark`], [`Constraint`], [`Prior`] | what a map holds |
//! | [`Item`], [`Edit`], [`Rejection`] | what a client may ask for, and why it is refused |
//! | [`Event`], [`Change`] | everything that can happen to a map |
//! | [`View`] | an image of a keyframe: its camera, and where that was |
//! | [`Map`], [`MapPolicy`], [`MapLimits`] | the fold of events, how it behaves, how large it may be |
//! | [`shared_map`], [`Covisibility`], [`Ties`] | its sorted lists, and what is counted by keyframe |
//! | [`choose_window`], [`problem`], [`applied`] | what a solve may move, its problem, its result as a change |
//! | [`triangulate`], [`retire`], [`find_duplicates`] | landmarks without a position, maps that are full, points that are one |
//! | [`Merge`], [`MergedMap`] | maps that become one and part again |
//! | [`Hint`] | mistakes that the data of a client look like |
//! | [`place`] | the keyframes that may show a place |
//! | [`loop_closing`] | which of them do |
//!
//! | file | role |
//! |---|---|
//! | `ids`, `entities`, `observations` | names and content |
//! | `item`, `edit`, `check`, `rejection` | what may happen, and why not |
//! | `event`, `fold`, `error` | what happens |
//! | `covisibility`, `ties`, `observers`, `views` | what is kept by keyframe and landmark |
//! | `policy`, `usage`, `retirement` | how a map behaves, what it holds, what goes when it is full |
//! | `gauge`, `window`, `affected`, `rim` | keyframes that nothing moves, what a solve may move, what an edit asks for, what holds a part in place |
//! | `problem`, `applied`, `meanwhile`, `pending_solve` | from map to problem and back; items whose solves are outstanding |
//! | `keyframe_pairs`, `triangulation`, `duplicates` | pairs that a pose graph measures, first positions, landmarks that are one point |
//! | `noise`, `odometry`, `view_noise`, `view_distance`, `noticeable` | how uncertain clients are, by the map's residuals; motions that a measurement can notice |
//! | `place_searches`, `surroundings` | searches for places; landmarks around a keyframe |
//! | `merging`, `scaling`, `frames` | maps that become one; units; frames that a correction has left |
//! | `hints` | mistakes that data look like |
//! | `digest`, `hash` | what is hashed, and how |
//! | `numbers`, `sound`, `parts` | possible numbers; a map from outside; a map taken apart |

use std::collections::BTreeMap;

mod affected;
mod applied;
mod check;
mod covisibility;
mod digest;
mod duplicates;
mod edit;
mod entities;
mod error;
mod event;
mod fold;
mod frames;
mod gauge;
mod hash;
mod hints;
mod ids;
mod item;
mod keyframe_pairs;
pub mod loop_closing;
mod meanwhile;
mod merging;
mod noise;
mod noticeable;
mod numbers;
mod observations;
mod observers;
mod odometry;
mod parts;
mod pending_solve;
pub mod place;
mod place_searches;
mod policy;
pub mod problem;
mod rejection;
mod retirement;
mod rim;
mod scaling;
pub mod shared_map;
mod sound;
mod surroundings;
mod ties;
mod triangulation;
mod usage;
mod view_distance;
mod view_noise;
mod views;
mod window;

pub use affected::{Affected, affected};
pub use applied::{Reach, Solved, applied};
pub use covisibility::Covisibility;
pub use digest::Content;
pub use duplicates::{Comparison, DuplicatePair, Duplicates, find_duplicates};
pub use edit::{Edit, Sighting};
pub use entities::{
    CameraEntity, Client, Constraint, ConstraintKind, Depth, Descriptor, DescriptorKind, Digest,
    Keyframe, Landmark, MAX_NUMBER, Observation, Prior, SwitchedOff,
};
pub use error::{EntityKind, MapError};
pub use event::{
    AppliedSolve, Cause, Change, Event, LastRequest, NewLandmark, RequestId, Retired, SolveKind,
};
pub use hints::{Hint, HintKind};
pub use ids::{ClientIndex, EntityId};
pub use item::{EntityRef, Item, ItemLandmark, ItemObservation, MeasuredPosition, PartialItem};
pub use keyframe_pairs::{GraphPairs, PairInput, later_observers, near_pairs, pair_input};
pub use merging::{Link, Merge, MergeError, MergedClient, MergedMap};
pub use noise::Noise;
pub use numbers::is_valid_camera;
pub use observations::Observations;
pub use observers::Observers;
pub use odometry::OdometryNoise;
pub use parts::MapParts;
pub use pending_solve::{PendingSolve, SolveRequest};
pub use place_searches::{PlaceCandidate, PlaceRefusal, PlaceSearch, PlaceSearches};
pub use policy::{ClosureRobustness, Gauge, MapPolicy, WhenFull};
pub use problem::{
    ClosureEdge, Compared, GlobalOptions, GraphProblem, Held, JudgedPosition, MapProblem, Start,
    global_problem, local_problem, measured_graph, observation_problem, region_problem,
};
pub use rejection::{FieldViolation, Reason, Rejection};
pub use retirement::{redundant_keyframes, retire, retire_redundant};
pub use shared_map::SharedMap;
pub use surroundings::{Surroundings, likeness};
pub use ties::Ties;
pub use triangulation::{has_unplaced, triangulate};
pub use usage::{Counted, Counts, Exceeded, INDEXED_KEYFRAME, MapLimits, Usage};
pub use view_noise::ViewNoise;
pub use views::View;
pub use window::{Window, choose_window};

/// Whether the map already has the content of an item of a stream.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Recall {
    /// The sequence is not journaled.
    New,
    /// The same item is journaled under this sequence: acknowledge it again.
    Duplicate,
    /// Another item is journaled under this sequence.
    Conflict,
}

/// A map at one revision.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Map {
    parts: MapParts,
    /// The constraints and priors of each keyframe.
    ties: Ties,
    covisibility: Covisibility,
    observation_count: u64,
    /// Memory of the observations' descriptors.
    descriptor_bytes: u64,
    /// The keyframes by the revision that added them.
    by_age: SharedMap<(i64, EntityId), ()>,
    /// The keyframes of each client by capture time.
    by_time: SharedMap<(ClientIndex, i64, EntityId), ()>,
    /// The keyframes of each client by the revision that added them.
    by_arrival: SharedMap<(ClientIndex, i64, EntityId), ()>,
    /// The landmarks that no keyframe sees, by the revision that added them.
    unseen: SharedMap<(i64, EntityId), ()>,
}

impl Map {
    /// A map before its first event, at revision 0.
    #[must_use]
    pub fn new() -> Self {
        Self::default()
    }

    /// How many events were applied.
    pub fn revision(&self) -> i64 {
        self.parts.revision
    }

    /// Unix time of the creation in nanoseconds, by the server's clock.
    pub fn create_time_ns(&self) -> i64 {
        self.parts.create_time_ns
    }

    /// Unix time of the last event in nanoseconds, by the server's clock.
    pub fn update_time_ns(&self) -> i64 {
        self.parts.update_time_ns
    }

    /// Free text for people.
    pub fn display_name(&self) -> &str {
        &self.parts.display_name
    }

    /// The rules by which the map is kept.
    pub fn policy(&self) -> &MapPolicy {
        &self.parts.policy
    }

    /// Whether a policy keeps the geodetic anchor by which positions of this map were converted. A map
    /// without priors, or without an anchor, can take any policy.
    pub fn keeps_anchor(&self, policy: &MapPolicy) -> bool {
        let anchor = self.parts.policy.geodetic_anchor;
        anchor.is_none() || anchor == policy.geodetic_anchor || self.parts.priors.is_empty()
    }

    /// Whether the map takes no items and no solves, by request.
    pub fn is_frozen(&self) -> bool {
        self.parts.frozen
    }

    /// The clients in the order of their first stream; a [`ClientIndex`] is a position here.
    pub fn clients(&self) -> &[Client] {
        &self.parts.clients
    }

    /// The client at `index`.
    pub fn client(&self, index: ClientIndex) -> Option<&Client> {
        self.parts.clients.get(index.0 as usize)
    }

    /// The items whose solves are outstanding: of each client the last one. Of the server's own closures
    /// the last revision that added some stands for the sequence.
    pub fn pending_solves(&self) -> Vec<(ClientIndex, PendingSolve)> {
        let outstanding = |(index, client): (u32, &Client)| {
            let unsolved = client.pending_solve.clone()?;
            let is_open = unsolved.sequence > client.optimized_sequence;
            is_open.then_some((ClientIndex(index), unsolved))
        };
        let unsolved = self.parts.place_searches.unsolved;
        let found = PendingSolve { sequence: unsolved, request: SolveRequest::LoopClosure };
        let found = (unsolved > 0).then_some((ClientIndex::SERVER, found));
        (0..).zip(&self.parts.clients).filter_map(outstanding).chain(found).collect()
    }

    /// The client called `name`.
    pub fn client_named(&self, name: &str) -> Option<ClientIndex> {
        let index = self.parts.clients.iter().position(|c| c.name == name)?;
        u32::try_from(index).ok().map(ClientIndex)
    }

    /// One more than the highest id of a client's keyframes; 0 if it has none.
    pub fn next_keyframe_id(&self, client: ClientIndex) -> i64 {
        client.next_id(self.keyframes())
    }

    /// One more than the highest id of a client's landmarks; 0 if it has none.
    pub fn next_landmark_id(&self, client: ClientIndex) -> i64 {
        client.next_id(self.landmarks())
    }

    /// The cameras.
    pub fn cameras(&self) -> &BTreeMap<EntityId, CameraEntity> {
        &self.parts.cameras
    }

    /// The keyframes.
    pub fn keyframes(&self) -> &SharedMap<EntityId, Keyframe> {
        &self.parts.keyframes
    }

    /// The landmarks, those without a position too.
    pub fn landmarks(&self) -> &SharedMap<EntityId, Landmark> {
        &self.parts.landmarks
    }

    /// The relative-pose constraints, those that are switched off too.
    pub fn constraints(&self) -> &SharedMap<EntityId, Constraint> {
        &self.parts.constraints
    }

    /// The loop closures and position priors that do not count.
    pub fn switched_off(&self) -> &BTreeMap<EntityId, SwitchedOff> {
        &self.parts.switched_off
    }

    /// Whether a constraint or a prior has this id.
    fn has_constraint(&self, id: EntityId) -> bool {
        self.parts.constraints.contains_key(&id) || self.parts.priors.contains_key(&id)
    }

    /// A relative-pose constraint, if it counts.
    pub fn active_constraint(&self, id: EntityId) -> Option<&Constraint> {
        self.parts.constraints.get(&id).filter(|_| !self.parts.switched_off.contains_key(&id))
    }

    /// The relative-pose constraints that count.
    pub fn active_constraints(&self) -> impl Iterator<Item = (EntityId, &Constraint)> {
        let active = self
            .parts
            .constraints
            .iter()
            .filter(|(id, _)| !self.parts.switched_off.contains_key(id));
        active.map(|(&id, constraint)| (id, constraint))
    }

    /// A prior, if it counts.
    pub fn active_prior(&self, id: EntityId) -> Option<&Prior> {
        self.parts.priors.get(&id).filter(|_| !self.parts.switched_off.contains_key(&id))
    }

    /// The priors, those that are switched off too.
    pub fn priors(&self) -> &SharedMap<EntityId, Prior> {
        &self.parts.priors
    }

    /// The constraints and priors of each keyframe.
    pub fn ties(&self) -> &Ties {
        &self.ties
    }

    /// How many landmarks keyframes share.
    pub fn covisibility(&self) -> &Covisibility {
        &self.covisibility
    }

    /// How many observations the keyframes have.
    pub fn observation_count(&self) -> u64 {
        self.observation_count
    }

    /// The keyframes of `client`, by capture time, then id.
    pub fn trajectory(&self, client: ClientIndex) -> Vec<(EntityId, &Keyframe)> {
        let own = self.by_time.entries_from((client, i64::MIN, EntityId::MIN));
        let own = own.map(|(&key, ())| key).take_while(|key| key.0 == client);
        own.filter_map(|(_, _, id)| Some((id, self.parts.keyframes.get(&id)?))).collect()
    }

    /// The last keyframe of a client by capture time, then id.
    pub fn last_keyframe(&self, client: ClientIndex) -> Option<EntityId> {
        let end = (ClientIndex(client.0.checked_add(1)?), i64::MIN, EntityId::MIN);
        let (&(last, _, id), ()) = self.by_time.entry_before(&end)?;
        (last == client).then_some(id)
    }

    /// The keyframe of the same client before this one, by capture time, then id.
    pub fn keyframe_before(&self, id: EntityId) -> Option<(EntityId, &Keyframe)> {
        let key = (id.client, self.parts.keyframes.get(&id)?.capture_time_ns, id);
        let (&(client, _, before), ()) = self.by_time.entry_before(&key)?;
        let known = (client == id.client).then(|| self.parts.keyframes.get(&before))?;
        known.map(|keyframe| (before, keyframe))
    }

    /// The keyframe of the same client after this one.
    pub fn keyframe_after(&self, id: EntityId) -> Option<(EntityId, &Keyframe)> {
        let key = (id.client, self.parts.keyframes.get(&id)?.capture_time_ns, id);
        let (&(client, _, after), ()) = self.by_time.entries_from(key).nth(1)?;
        let known = (client == id.client).then(|| self.parts.keyframes.get(&after))?;
        known.map(|keyframe| (after, keyframe))
    }

    /// Whether item `sequence` of `client` is journaled, and with this digest.
    ///
    /// A sequence below `next_sequence` that was skipped or refused is [`Recall::New`].
    pub fn recall(&self, client: ClientIndex, sequence: i64, digest: &Digest) -> Recall {
        match self.client(client).and_then(|c| c.items.get(&sequence)) {
            None => Recall::New,
            Some(known) if known == digest => Recall::Duplicate,
            Some(_) => Recall::Conflict,
        }
    }

    /// Applies events in order to an empty map.
    ///
    /// # Errors
    /// [`MapError`] of the first event that does not fit.
    pub fn replay<'a>(events: impl Iterator<Item = &'a Event>) -> Result<Self, MapError> {
        let mut map = Self::new();
        for event in events {
            map.apply(event)?;
        }
        Ok(map)
    }
}
