//! A map taken apart and put together again, for snapshots.
//!
//! [`MapParts`] holds what cannot be derived; the rest (observers of landmarks, covisibility, the
//! number of observations) is computed again from it. [`Map::from_parts`] checks that the parts fit
//! each other, so that a damaged snapshot never becomes a damaged map. The store defines how parts are
//! encoded.

use std::collections::BTreeMap;

use super::{
    CameraEntity, Client, Constraint, Content, Covisibility, Digest, Duplicates, EntityId,
    EntityKind, Keyframe, Landmark, LastRequest, Map, MapError, MapPolicy, MergedMap,
    PlaceSearches, Prior, SharedMap, SwitchedOff, Ties,
};

/// What a map consists of. [`Landmark::observers`] is not read: it follows from the keyframes.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct MapParts {
    /// See [`Map::revision`].
    pub revision: i64,
    /// See [`Map::create_time_ns`].
    pub create_time_ns: i64,
    /// See [`Map::update_time_ns`].
    pub update_time_ns: i64,
    /// See [`Map::display_name`].
    pub display_name: String,
    /// See [`Map::policy`].
    pub policy: MapPolicy,
    /// See [`Map::is_frozen`].
    pub frozen: bool,
    /// See [`Map::solve_count`].
    pub solve_count: i64,
    /// See [`Map::clients`].
    pub clients: Vec<Client>,
    /// See [`Map::cameras`].
    pub cameras: BTreeMap<EntityId, CameraEntity>,
    /// See [`Map::keyframes`].
    pub keyframes: SharedMap<EntityId, Keyframe>,
    /// See [`Map::landmarks`].
    pub landmarks: SharedMap<EntityId, Landmark>,
    /// See [`Map::constraints`].
    pub constraints: SharedMap<EntityId, Constraint>,
    /// See [`Map::switched_off`].
    pub switched_off: BTreeMap<EntityId, SwitchedOff>,
    /// See [`Map::priors`].
    pub priors: SharedMap<EntityId, Prior>,
    /// See [`Map::duplicates`].
    pub duplicates: Duplicates,
    /// See [`Map::place_searches`].
    pub place_searches: PlaceSearches,
    /// See [`Map::is_adjustment_due`].
    pub adjustment_due: bool,
    /// See [`Map::last_request`].
    pub last_request: Option<LastRequest>,
    /// See [`Map::merged`].
    pub merged: Vec<MergedMap>,
    /// See [`Map::contents`].
    pub contents: SharedMap<(Content, EntityId), Digest>,
}

impl Map {
    /// How many solves were applied.
    pub fn solve_count(&self) -> i64 {
        self.parts.solve_count
    }

    /// The last solve that named its request. It is no part of the hashes: it says nothing of the map.
    pub fn last_request(&self) -> Option<&LastRequest> {
        self.parts.last_request.as_ref()
    }

    /// The digests of cameras, keyframes and constraints as they were sent.
    pub fn contents(&self) -> &SharedMap<(Content, EntityId), Digest> {
        &self.parts.contents
    }

    /// The parts of the map; lists are shared, not copied, where possible.
    pub fn to_parts(&self) -> MapParts {
        self.parts.clone()
    }

    /// The map as it begins on a server that imports it: created at this time by the server's clock,
    /// with another display name, policy and state where they are given. That maps were merged into it is
    /// not known there: their names may be those of other maps. The rest stays as it is.
    #[must_use]
    pub fn imported(
        mut self,
        create_time_ns: i64,
        display_name: Option<String>,
        policy: Option<MapPolicy>,
        frozen: Option<bool>,
    ) -> Self {
        (self.parts.create_time_ns, self.parts.update_time_ns) = (create_time_ns, create_time_ns);
        self.parts.display_name = display_name.unwrap_or(self.parts.display_name);
        self.parts.policy = policy.unwrap_or(self.parts.policy);
        self.parts.frozen = frozen.unwrap_or(self.parts.frozen);
        self.parts.merged.clear();
        self
    }

    /// Puts a map together.
    ///
    /// # Errors
    /// [`MapError::Unknown`] where a part refers to something that no part has.
    pub fn from_parts(mut parts: MapParts) -> Result<Self, MapError> {
        let revision = parts.revision;
        let unknown = |kind, id| MapError::Unknown { revision, kind, id };
        let MapParts { cameras, keyframes, landmarks, constraints, priors, .. } = &mut parts;
        let ids: Vec<EntityId> = landmarks.keys().copied().collect();
        let mut observers: Vec<Vec<EntityId>> = vec![Vec::new(); ids.len()];
        let age = |id: EntityId| keyframes.get(&id).map_or(0, |known| known.added_revision);
        let mut covisibility = Covisibility::default();
        let mut observation_count = 0;
        let mut descriptor_bytes = 0;
        // By rising id, so that each list of observers is sorted.
        for (&id, keyframe) in &*keyframes {
            if let Some(camera) = keyframe.camera.filter(|camera| !cameras.contains_key(camera)) {
                return Err(unknown(EntityKind::Camera, camera));
            }
            observation_count += keyframe.observations.len() as u64;
            descriptor_bytes += super::usage::descriptor_bytes(&keyframe.observations)
                + super::usage::image_bytes(keyframe.global_descriptor.as_deref());
            let mut sharing = Vec::new();
            for observation in keyframe.observations.iter() {
                let seen = observation.landmark;
                let index = ids.binary_search(&seen);
                let index = index.map_err(|_index| unknown(EntityKind::Landmark, seen))?;
                let observers = &mut observers[index];
                if observers.last() != Some(&id) {
                    covisibility.observe(seen, observers, id, age, &mut sharing);
                    observers.push(id);
                }
            }
            covisibility.add(id, &mut sharing);
        }
        for (landmark, observers) in landmarks.values_mut().zip(observers) {
            landmark.observers = observers.into();
        }
        let references = landmarks.values().filter_map(|landmark| landmark.reference);
        let ends = constraints.values().flat_map(|c| [c.keyframe_i, c.keyframe_j]);
        let measured = priors.values().map(Prior::keyframe);
        for id in references.chain(ends).chain(measured) {
            if !keyframes.contains_key(&id) {
                return Err(unknown(EntityKind::Keyframe, id));
            }
        }
        let mut by_age: Vec<_> =
            keyframes.iter().map(|(&id, k)| ((k.added_revision, id), ())).collect();
        by_age.sort_unstable();
        let by_age = by_age.into_iter().collect();
        let of_clients = |key: fn(&Keyframe) -> i64| {
            let entry = |(&id, k): (&EntityId, &Keyframe)| ((id.client, key(k), id), ());
            let mut entries: Vec<_> = keyframes.iter().map(entry).collect();
            entries.sort_unstable();
            entries.into_iter().collect()
        };
        let by_time = of_clients(|keyframe| keyframe.capture_time_ns);
        let by_arrival = of_clients(|keyframe| keyframe.added_revision);
        let unseen = landmarks.iter().filter(|(_, landmark)| landmark.observers.is_empty());
        let mut unseen: Vec<_> = unseen.map(|(&id, l)| ((l.added_revision, id), ())).collect();
        unseen.sort_unstable();
        let unseen = unseen.into_iter().collect();
        let ties = Ties::new(constraints, priors);
        let map = Self {
            parts,
            ties,
            covisibility,
            observation_count,
            descriptor_bytes,
            by_age,
            by_time,
            by_arrival,
            unseen,
        };
        if let Some(&id) = map.switched_off().keys().find(|id| !map.has_constraint(**id)) {
            return Err(unknown(EntityKind::Constraint, id));
        }
        let is_unknown = |id: &EntityId| !map.landmarks().contains_key(id);
        if let Some(id) = map.duplicates().pairs().flat_map(|(a, b, _)| [a, b]).find(is_unknown) {
            return Err(unknown(EntityKind::Landmark, id));
        }
        Ok(map)
    }
}
