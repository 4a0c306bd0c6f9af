//! Whether an event fits the map, checked in full before anything changes.
//!
//! These checks guard the journal, not the clients: an event that was made by
//! [`Map::check`](crate::Map::check) or by a solve passes them. They prevent a damaged journal
//! from becoming a damaged map.

use std::collections::BTreeSet;

use covis_solvers::geometry::Se3;
use nalgebra::Vector3;

use super::super::numbers::{
    is_finite, is_policy, is_pose, is_positive, is_similarity, is_valid_camera,
};
use super::super::scaling::SCALES;
use super::super::{
    AppliedSolve, Cause, Change, Client, ClientIndex, Comparison, Constraint, EntityId, EntityKind,
    Event, Map, MapError, MapPolicy, Merge, MergedClient, NewLandmark, Observation, Prior, Retired,
};

impl Map {
    /// Whether [`Map::fold`] may add an event: it is the next one, what it names exists, and its numbers are
    /// possible.
    ///
    /// # Errors
    /// [`MapError`], with what does not fit.
    pub fn fits(&self, event: &Event) -> Result<(), MapError> {
        let check = Fit { map: self, revision: event.revision };
        if self.revision().checked_add(1) != Some(event.revision) {
            let expected = self.revision().saturating_add(1);
            return Err(MapError::RevisionGap { expected, actual: event.revision });
        }
        if matches!(event.change, Change::Created { .. }) != (self.revision() == 0) {
            return Err(MapError::Creation { revision: event.revision });
        }
        if let Some(cause) = &event.cause {
            check.cause(cause)?;
        }
        check.change(&event.change)
    }
}

/// The map against which an event is checked.
struct Fit<'a> {
    map: &'a Map,
    revision: i64,
}

type Outcome = Result<(), MapError>;

fn policy_fits(policy: &MapPolicy) -> Outcome {
    let what = "the policy has an invalid loss, threshold or anchor";
    if is_policy(policy) { Ok(()) } else { Err(MapError::UnsoundMap { what }) }
}

impl Fit<'_> {
    fn cause(&self, cause: &Cause) -> Outcome {
        let (revision, client) = (self.revision, cause.client);
        let Some(known) = self.map.client(client) else {
            return Err(MapError::UnknownClient { revision, client });
        };
        if cause.epoch > known.epoch {
            let (newest, actual) = (known.epoch, cause.epoch);
            return Err(MapError::Epoch { revision, newest, actual });
        }
        if known.items.contains_key(&cause.sequence) {
            return Err(MapError::SequenceTaken { revision, client, sequence: cause.sequence });
        }
        Ok(())
    }

    fn change(&self, change: &Change) -> Outcome {
        match change {
            Change::ItemRepeated => Ok(()),
            Change::Created { policy, .. } => policy_fits(policy),
            Change::MapUpdated { policy, .. } => policy.as_ref().map_or(Ok(()), policy_fits),
            Change::ClientOpened { name, epoch } => self.opening(name, *epoch),
            Change::CameraSet { id, camera } => {
                self.finite(is_valid_camera(&camera.camera), EntityKind::Camera, *id)
            }
            Change::KeyframeAdded {
                id,
                camera,
                world_from_camera,
                odom_from_camera,
                observations,
                landmarks,
                motion,
                ..
            } => {
                self.absent(!self.map.keyframes().contains_key(id), EntityKind::Keyframe, *id)?;
                match camera {
                    Some(camera) => self.camera(*camera)?,
                    None => self.sees_nothing(*id, observations)?,
                }
                self.pose(*id, world_from_camera)?;
                self.pose(*id, odom_from_camera)?;
                if let Some(motion) = motion {
                    self.pose(*id, &motion.transform_pose(world_from_camera))?;
                    self.scale(motion.scale, id.client)?;
                }
                let new = self.new_landmarks(landmarks)?;
                self.observations(observations, &new, &[])
            }
            Change::LandmarksAdded { landmarks, scale } => {
                self.scale(*scale, landmarks.first().map_or(ClientIndex(0), |l| l.id.client))?;
                self.new_landmarks(landmarks).map(drop)
            }
            Change::ObservationsAdded { keyframe, observations } => {
                self.keyframe(*keyframe)?;
                let known = self.map.keyframes().get(keyframe);
                if known.is_some_and(|k| k.camera.is_none()) {
                    self.sees_nothing(*keyframe, observations)?;
                }
                let present = known.map(|k| &*k.observations).unwrap_or_default();
                self.observations(observations, &[], present)
            }
            Change::ConstraintAdded { id, constraint } => {
                self.new_constraints(&[(*id, *constraint)])
            }
            Change::PriorAdded { id, prior } => {
                self.new_constraint(*id)?;
                self.keyframe(prior.keyframe())?;
                self.measured(*id, prior)
            }
            Change::LandmarksTriangulated { positions } => self.positions(positions),
            Change::SolveApplied { solve } => self.solve(solve),
            Change::ObservationsRemoved { observations } => {
                observations.iter().try_for_each(|&(keyframe, landmark)| {
                    let seen = self.map.keyframes().get(&keyframe);
                    let seen = seen.is_some_and(|k| k.observation_of(landmark).is_some());
                    self.present(seen, EntityKind::Observation, landmark)
                })
            }
            Change::LandmarksFused { kept, absorbed } => {
                self.landmark(*kept)?;
                self.absent(!absorbed.contains(kept), EntityKind::Landmark, *kept)?;
                absorbed.iter().try_for_each(|&id| self.landmark(id))
            }
            Change::DuplicatesFound { comparisons } => {
                comparisons.iter().try_for_each(|comparison| self.comparison(comparison))
            }
            Change::LandmarksRemoved { landmarks } | Change::DuplicatesSplit { landmarks, .. } => {
                landmarks.iter().try_for_each(|&id| self.landmark(id))
            }
            Change::PlacesSearched { searches, closures } => {
                for (keyframe, search) in searches {
                    self.keyframe(*keyframe)?;
                    let scores = search.candidates.iter().all(|c| c.score.is_finite());
                    self.finite(scores, EntityKind::Keyframe, *keyframe)?;
                }
                self.new_constraints(closures)
            }
            Change::MapMerged { merge } => self.merge(merge),
            Change::MapTakenOut { name, .. } => {
                let is_known = self.map.merged().iter().any(|merged| merged.name == *name);
                self.present(is_known, EntityKind::Client, EntityId::MIN)
            }
            Change::KeyframeRemoved { keyframe } => self.keyframe(*keyframe),
            Change::KeyframeRetired { retired } => self.retired(retired),
            Change::ConstraintRevoked { id } => {
                self.present(self.map.has_constraint(*id), EntityKind::Constraint, *id)
            }
        }
    }

    fn scale(&self, scale: f64, client: ClientIndex) -> Outcome {
        self.finite(SCALES.contains(&scale), EntityKind::Client, EntityId { client, id: 0 })
    }

    fn retired(&self, retired: &Retired) -> Outcome {
        self.keyframe(retired.keyframe)?;
        retired.landmarks.iter().try_for_each(|&id| self.landmark(id))?;
        for &id in &retired.revoked {
            self.present(self.map.has_constraint(id), EntityKind::Constraint, id)?;
        }
        self.new_constraints(&retired.constraints)?;
        let stays = |id| self.absent(id != retired.keyframe, EntityKind::Keyframe, id);
        let mut new = BTreeSet::new();
        for (id, constraint) in &retired.constraints {
            new.insert(*id);
            stays(constraint.keyframe_i)?;
            stays(constraint.keyframe_j)?;
        }
        for (id, prior) in &retired.priors {
            self.new_constraint(*id)?;
            self.absent(new.insert(*id), EntityKind::Constraint, *id)?;
            stays(prior.keyframe())?;
            self.keyframe(prior.keyframe())?;
            self.measured(*id, prior)?;
        }
        Ok(())
    }

    /// New constraints between keyframes of the map.
    fn new_constraints(&self, constraints: &[(EntityId, Constraint)]) -> Outcome {
        let mut new = BTreeSet::new();
        for (id, constraint) in constraints {
            self.new_constraint(*id)?;
            self.absent(new.insert(*id), EntityKind::Constraint, *id)?;
            self.keyframe(constraint.keyframe_i)?;
            self.keyframe(constraint.keyframe_j)?;
            self.finite(constraint.is_possible(), EntityKind::Constraint, *id)?;
        }
        Ok(())
    }

    fn merge(&self, merge: &Merge) -> Outcome {
        let content = &*merge.content;
        let is_placed = is_similarity(&merge.target_from_source);
        self.finite(is_placed, EntityKind::Client, EntityId::MIN)?;
        if let Some((id, pose)) = &merge.first {
            self.pose(*id, pose)?;
        }
        let client = |index| EntityId { client: index, id: 0 };
        let mut next = self.map.clients().len();
        let mut taken = BTreeSet::new();
        for (MergedClient { index, .. }, new) in merge.clients.iter().zip(content.clients()) {
            let kind = EntityKind::Client;
            self.absent(taken.insert(*index), kind, client(*index))?;
            match self.map.client_named(&new.name) {
                Some(known) => {
                    let is_free = known == *index && self.map.is_without_content(known);
                    self.absent(is_free, kind, client(*index))?;
                }
                None => {
                    self.present(index.0 as usize == next, kind, client(*index))?;
                    next += 1;
                }
            }
        }
        let is_whole = merge.clients.len() == content.clients().len();
        self.present(is_whole, EntityKind::Client, client(ClientIndex(0)))?;
        for (&id, keyframe) in content.keyframes() {
            self.pose(id, &keyframe.world_from_camera)?;
        }
        let positions = content.landmarks().iter().filter_map(|(id, l)| Some((id, l.position?)));
        for (&id, position) in positions {
            self.finite(is_finite(&position), EntityKind::Landmark, id)?;
        }
        let added: BTreeSet<EntityId> =
            content.keyframes().keys().map(|&id| merge.id_of(id)).collect();
        let constraints = content.constraints().keys().chain(content.priors().keys());
        let mut new: BTreeSet<EntityId> = constraints.map(|&id| merge.id_of(id)).collect();
        for (id, closure) in &merge.closures {
            self.new_constraint(*id)?;
            self.absent(new.insert(*id), EntityKind::Constraint, *id)?;
            self.keyframe(closure.keyframe_i)?;
            let end = closure.keyframe_j;
            self.present(added.contains(&end), EntityKind::Keyframe, end)?;
            self.finite(closure.is_possible(), EntityKind::Constraint, *id)?;
        }
        Ok(())
    }

    fn comparison(&self, comparison: &Comparison) -> Outcome {
        let closure = comparison.closure;
        let counts = self.map.active_constraint(closure).is_some_and(Constraint::is_closure);
        self.present(counts, EntityKind::Constraint, closure)?;
        comparison.pairs.iter().try_for_each(|&(a, b)| {
            self.landmark(a)?;
            self.absent(a != b, EntityKind::Landmark, b)?;
            self.landmark(b)
        })
    }

    fn measured(&self, id: EntityId, prior: &Prior) -> Outcome {
        self.finite(prior.is_possible(), EntityKind::Constraint, id)
    }

    fn opening(&self, name: &str, epoch: i64) -> Outcome {
        let newest = self.map.client_named(name).and_then(|c| self.map.client(c));
        match newest.map(Client::newest_epoch) {
            Some(newest) if epoch <= newest => {
                Err(MapError::Epoch { revision: self.revision, newest, actual: epoch })
            }
            _ => Ok(()),
        }
    }

    /// Their ids, sorted.
    fn new_landmarks(&self, landmarks: &[NewLandmark]) -> Result<Vec<EntityId>, MapError> {
        for new in landmarks {
            let repeats = match self.map.landmarks().get(&new.id) {
                Some(known) => known.sent_position == new.position,
                None => true,
            };
            self.absent(repeats, EntityKind::Landmark, new.id)?;
            let is_finite = new.position.as_ref().is_none_or(is_finite);
            self.finite(is_finite, EntityKind::Landmark, new.id)?;
        }
        let mut ids: Vec<EntityId> = landmarks.iter().map(|l| l.id).collect();
        ids.sort_unstable();
        let twice = ids.windows(2).find(|pair| pair[0] == pair[1]);
        twice.map_or(Ok(()), |pair| self.absent(false, EntityKind::Landmark, pair[0]))?;
        Ok(ids)
    }

    fn observations(
        &self,
        observations: &[Observation],
        new: &[EntityId],
        present: &[Observation],
    ) -> Outcome {
        for observation in observations {
            let id = observation.landmark;
            let known = new.binary_search(&id).is_ok() || self.map.landmarks().contains_key(&id);
            self.present(known, EntityKind::Landmark, id)?;
            self.finite(observation.is_possible(), EntityKind::Observation, id)?;
        }
        let mut keys: Vec<_> = present.iter().chain(observations).map(Observation::key).collect();
        keys.sort_unstable();
        let twice = keys.windows(2).find(|pair| pair[0] == pair[1]);
        twice.map_or(Ok(()), |pair| self.absent(false, EntityKind::Observation, pair[0].0))
    }

    /// A keyframe without a camera must not have observations.
    fn sees_nothing(&self, keyframe: EntityId, observations: &[Observation]) -> Outcome {
        let revision = self.revision;
        let holds = observations.is_empty();
        if holds { Ok(()) } else { Err(MapError::NoCamera { revision, keyframe }) }
    }

    fn positions(&self, positions: &[(EntityId, Vector3<f64>)]) -> Outcome {
        // A solve may move all landmarks, by rising id.
        let mut landmarks = self.map.landmarks().rising();
        for (id, position) in positions {
            self.present(landmarks.get(id).is_some(), EntityKind::Landmark, *id)?;
            self.finite(is_finite(position), EntityKind::Landmark, *id)?;
        }
        Ok(())
    }

    fn solve(&self, solve: &AppliedSolve) -> Outcome {
        for (id, pose) in &solve.poses {
            self.keyframe(*id)?;
            self.pose(*id, pose)?;
        }
        self.positions(&solve.landmarks)?;
        for (id, camera) in &solve.cameras {
            self.camera(*id)?;
            self.finite(is_valid_camera(camera), EntityKind::Camera, *id)?;
        }
        for (id, off) in &solve.switched_off {
            self.constraint(*id)?;
            self.finite(off.is_possible(), EntityKind::Constraint, *id)?;
        }
        for id in &solve.switched_on {
            self.constraint(*id)?;
        }
        for &(client, variance) in &solve.closure_variances {
            self.finite(is_positive(variance), EntityKind::Client, EntityId::new(client, 0))?;
        }
        for (client, noise) in &solve.noise {
            self.finite(noise.is_possible(), EntityKind::Client, EntityId::new(*client, 0))?;
        }
        for (client, frame) in &solve.left_frames {
            self.finite(is_pose(frame), EntityKind::Client, EntityId::new(*client, 0))?;
        }
        let noises = solve.noise.iter().map(|&(client, _)| client);
        let varied = solve.closure_variances.iter().map(|&(client, _)| client).chain(noises);
        for client in solve.covered.iter().map(|&(client, _)| client).chain(varied) {
            if client != ClientIndex::SERVER && self.map.client(client).is_none() {
                return Err(MapError::UnknownClient { revision: self.revision, client });
            }
        }
        Ok(())
    }

    fn pose(&self, id: EntityId, pose: &Se3) -> Outcome {
        self.finite(is_pose(pose), EntityKind::Keyframe, id)
    }

    fn camera(&self, id: EntityId) -> Outcome {
        self.present(self.map.cameras().contains_key(&id), EntityKind::Camera, id)
    }

    fn keyframe(&self, id: EntityId) -> Outcome {
        self.present(self.map.keyframes().contains_key(&id), EntityKind::Keyframe, id)
    }

    fn landmark(&self, id: EntityId) -> Outcome {
        self.present(self.map.landmarks().contains_key(&id), EntityKind::Landmark, id)
    }

    fn constraint(&self, id: EntityId) -> Outcome {
        self.present(self.map.has_constraint(id), EntityKind::Constraint, id)
    }

    fn new_constraint(&self, id: EntityId) -> Outcome {
        self.absent(!self.map.has_constraint(id), EntityKind::Constraint, id)
    }

    fn present(&self, holds: bool, kind: EntityKind, id: EntityId) -> Outcome {
        let revision = self.revision;
        if holds { Ok(()) } else { Err(MapError::Unknown { revision, kind, id }) }
    }

    fn absent(&self, holds: bool, kind: EntityKind, id: EntityId) -> Outcome {
        let revision = self.revision;
        if holds { Ok(()) } else { Err(MapError::Exists { revision, kind, id }) }
    }

    fn finite(&self, holds: bool, kind: EntityKind, id: EntityId) -> Outcome {
        let revision = self.revision;
        if holds { Ok(()) } else { Err(MapError::ImpossibleNumber { revision, kind, id }) }
    }
}
