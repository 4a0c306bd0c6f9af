//! The parts of a map under other ids: each client at another position, the server's own constraints
//! under other numbers. Ids are all that changes; nothing here knows why.

use std::collections::BTreeMap;

use super::super::{
    Affected, ClientIndex, Constraint, Content, Duplicates, EntityId, Keyframe, Landmark,
    MAX_NUMBER, MapParts, MergedClient, MergedMap, Observation, Observers, PendingSolve,
    PlaceCandidate, PlaceSearch, PlaceSearches, Prior, SharedMap, SolveRequest,
};

/// New ids for old ones.
pub(crate) struct Renaming<'a> {
    /// The new position of each client.
    clients: &'a [ClientIndex],
    /// The new ids of the server's own constraints and priors, whose numbers count revisions of a map
    /// that is another one now.
    own: BTreeMap<EntityId, i64>,
}

impl<'a> Renaming<'a> {
    /// `clients` has the new position of each client of `parts`. The server's own constraints get the
    /// lowest numbers, which no revision reaches.
    pub(crate) fn new(parts: &MapParts, clients: &'a [ClientIndex]) -> Self {
        let mut counts: BTreeMap<ClientIndex, i64> = BTreeMap::new();
        let mut own: Vec<EntityId> =
            parts.constraints.keys().chain(parts.priors.keys()).copied().collect();
        own.retain(EntityId::is_own);
        own.sort_unstable();
        let number = |id: EntityId| {
            let count = counts.entry(id.client).or_default();
            *count += 1;
            (id, -MAX_NUMBER + *count)
        };
        Self { clients, own: own.into_iter().map(number).collect() }
    }

    /// `clients` has the new position of each client; the numbers stay.
    pub(crate) fn of_clients(clients: &'a [ClientIndex]) -> Self {
        Self { clients, own: BTreeMap::new() }
    }

    fn client(&self, client: ClientIndex) -> ClientIndex {
        self.clients.get(client.0 as usize).copied().unwrap_or(client)
    }

    /// The new id of a camera, keyframe or landmark.
    pub(crate) fn entity(&self, id: EntityId) -> EntityId {
        EntityId { client: self.client(id.client), ..id }
    }

    /// The new id of a constraint or prior.
    fn constraint(&self, id: EntityId) -> EntityId {
        let number = self.own.get(&id).copied().unwrap_or(id.id);
        EntityId { client: self.client(id.client), id: number }
    }

    fn observation(&self, observation: &Observation) -> Observation {
        Observation { landmark: self.entity(observation.landmark), ..observation.clone() }
    }

    fn keyframe(&self, keyframe: &Keyframe) -> Keyframe {
        Keyframe {
            camera: keyframe.camera.map(|camera| self.entity(camera)),
            observations: keyframe.observations.iter().map(|o| self.observation(o)).collect(),
            ..keyframe.clone()
        }
    }

    fn landmark(&self, landmark: &Landmark) -> Landmark {
        let observers = Observers::default();
        let reference = landmark.reference.map(|keyframe| self.entity(keyframe));
        Landmark { reference, observers, ..landmark.clone() }
    }

    fn measurement(&self, constraint: &Constraint) -> Constraint {
        Constraint {
            keyframe_i: self.entity(constraint.keyframe_i),
            keyframe_j: self.entity(constraint.keyframe_j),
            ..*constraint
        }
    }

    fn prior(&self, prior: &Prior) -> Prior {
        let mut prior = *prior;
        let (Prior::Pose { keyframe, .. } | Prior::Position { keyframe, .. }) = &mut prior;
        *keyframe = self.entity(*keyframe);
        prior
    }

    fn search(&self, search: &PlaceSearch) -> PlaceSearch {
        let candidate = |candidate: &PlaceCandidate| PlaceCandidate {
            keyframe: self.entity(candidate.keyframe),
            ..candidate.clone()
        };
        PlaceSearch {
            candidates: search.candidates.iter().map(candidate).collect(),
            closure: search.closure.map(|closure| self.constraint(closure)),
            refusal: search.refusal.clone(),
        }
    }

    fn pending_solve(&self, pending: PendingSolve) -> PendingSolve {
        let request = match pending.request {
            SolveRequest::Views(keyframe) => SolveRequest::Views(self.entity(keyframe)),
            same @ (SolveRequest::LoopClosure | SolveRequest::Prior) => same,
            SolveRequest::Edited(Affected { graph, keyframes }) => {
                let keyframes = keyframes.into_iter().map(|id| self.entity(id)).collect();
                SolveRequest::Edited(Affected { graph, keyframes })
            }
        };
        PendingSolve { request, ..pending }
    }

    /// The parts under their new ids. The clients stay in their list; the scalars stay as they are.
    pub(crate) fn apply(&self, parts: MapParts) -> MapParts {
        let PlaceSearches { pending, done, unsolved } = &parts.place_searches;
        let done = done.iter().map(|(&id, search)| (self.entity(id), self.search(search)));
        let place_searches = PlaceSearches {
            pending: pending.iter().map(|(&id, &at)| (self.entity(id), at)).collect(),
            done: done.collect(),
            unsolved: *unsolved,
        };
        let mut duplicates = Duplicates::default();
        let pair = |(a, b, closure): (EntityId, EntityId, Option<EntityId>)| {
            (self.entity(a), self.entity(b), closure.map(|closure| self.constraint(closure)))
        };
        duplicates.extend(
            parts.duplicates.pairs().map(pair),
            parts.duplicates.compared().iter().map(|&closure| self.constraint(closure)),
        );
        let mut clients = parts.clients;
        for client in &mut clients {
            client.pending_solve =
                client.pending_solve.take().map(|pending| self.pending_solve(pending));
        }
        let mut merged = parts.merged;
        for MergedMap { clients, first, .. } in &mut merged {
            for MergedClient { index, name: _ } in clients {
                *index = self.client(*index);
            }
            *first = first.map(|(id, pose)| (self.entity(id), pose));
        }
        let content = |(kind, id)| match kind {
            Content::Camera | Content::Keyframe => (kind, self.entity(id)),
            Content::Constraint => (kind, self.constraint(id)),
        };
        MapParts {
            clients,
            cameras: parts.cameras.iter().map(|(&id, &c)| (self.entity(id), c)).collect(),
            keyframes: sorted(
                parts.keyframes.iter().map(|(&id, k)| (self.entity(id), self.keyframe(k))),
            ),
            landmarks: sorted(
                parts.landmarks.iter().map(|(&id, l)| (self.entity(id), self.landmark(l))),
            ),
            constraints: sorted(
                parts.constraints.iter().map(|(&id, c)| (self.constraint(id), self.measurement(c))),
            ),
            switched_off: parts
                .switched_off
                .iter()
                .map(|(&id, &off)| (self.constraint(id), off))
                .collect(),
            priors: sorted(
                parts.priors.iter().map(|(&id, p)| (self.constraint(id), self.prior(p))),
            ),
            contents: sorted(parts.contents.iter().map(|(&key, &digest)| (content(key), digest))),
            duplicates,
            place_searches,
            merged,
            ..parts
        }
    }
}

/// A list by its new ids, which may order otherwise than the old ones.
fn sorted<K: Ord + Copy, V: Clone>(entries: impl Iterator<Item = (K, V)>) -> SharedMap<K, V> {
    let mut entries: Vec<(K, V)> = entries.collect();
    entries.sort_unstable_by_key(|&(key, _)| key);
    entries.into_iter().collect()
}
