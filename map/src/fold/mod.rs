//! The fold: what each event does to the map.
//!
//! [`Map::apply`] first checks the whole event against the map (`fits.rs`) and only then changes
//! anything, so that a refused event changes nothing. Covisibility is updated one observation at a
//! time. The fold never estimates: every value is taken from the event.
//!
//! A landmark whose reference keyframe is removed gets its lowest remaining observer as reference. One
//! that lost all observers stays until it is removed itself.

mod edits;
mod fits;
mod merging;

use covis_solvers::geometry::Sim3;

use super::digest::{self, Content};
use super::frames;
use super::pending_solve::solve_request;
use super::scaling;
use super::usage::{descriptor_bytes, image_bytes};
use super::{
    AppliedSolve, Cause, Change, Client, ClientIndex, Constraint, EntityId, Event, Keyframe,
    Landmark, LastRequest, Map, MapError, MapParts, MapPolicy, NewLandmark, Observation,
    Observations, Observers, PendingSolve, Prior, Retired, SolveKind, SolveRequest,
};

/// Items of a client whose digests are kept. Clients do not resend older items: a client keeps only
/// what is not durable, and that is far less.
const REMEMBERED_ITEMS: usize = 1 << 16;

impl Map {
    /// Applies one event.
    ///
    /// # Errors
    /// [`MapError`] when the event does not fit: a gap in the revisions, an unknown or doubled id,
    /// a number that is not possible. The map is then unchanged.
    pub fn apply(&mut self, event: &Event) -> Result<(), MapError> {
        self.fits(event)?;
        self.fold(event);
        Ok(())
    }

    /// Applies one event that [`Map::fits`] found to fit this map.
    pub fn fold(&mut self, event: &Event) {
        self.parts.revision = event.revision;
        // An event without a recorded time is no older than the previous one.
        self.parts.update_time_ns = self.parts.update_time_ns.max(event.time_ns);
        let request = event.cause.as_ref().and_then(|_| solve_request(self, &event.change));
        self.change(&event.change);
        if let Some(cause) = &event.cause {
            self.remember(cause, request);
        }
    }

    fn change(&mut self, change: &Change) {
        match change {
            Change::Created { policy, create_time_ns, display_name } => {
                self.parts.policy = *policy;
                self.parts.create_time_ns = *create_time_ns;
                self.parts.update_time_ns = self.parts.update_time_ns.max(*create_time_ns);
                self.parts.display_name.clone_from(display_name);
            }
            Change::ClientOpened { name, epoch } => self.open(name, *epoch),
            Change::CameraSet { id, camera } => {
                // The content is what the client added the camera with, whatever replaced it later.
                if self.parts.cameras.insert(*id, *camera).is_none() {
                    self.parts.contents.insert((Content::Camera, *id), digest::content(change));
                }
            }
            Change::KeyframeAdded {
                id,
                capture_time_ns,
                camera,
                world_from_camera,
                odom_from_camera,
                observations,
                landmarks,
                global_descriptor,
                motion,
            } => {
                self.parts.contents.insert((Content::Keyframe, *id), digest::content(change));
                self.add_landmarks(landmarks, motion.as_ref());
                let keyframe = Keyframe {
                    capture_time_ns: *capture_time_ns,
                    camera: *camera,
                    world_from_camera: motion.map_or(*world_from_camera, |motion| {
                        motion.transform_pose(world_from_camera)
                    }),
                    odom_from_camera: motion.map_or(*odom_from_camera, |motion| {
                        scaling::pose(motion.scale, odom_from_camera)
                    }),
                    observations: Observations::default(),
                    global_descriptor: global_descriptor.clone(),
                    added_revision: self.parts.revision,
                };
                self.descriptor_bytes += image_bytes(keyframe.global_descriptor.as_deref());
                self.parts.keyframes.insert(*id, keyframe);
                self.by_age.insert((self.parts.revision, *id), ());
                self.by_time.insert((id.client, *capture_time_ns, *id), ());
                self.by_arrival.insert((id.client, self.parts.revision, *id), ());
                self.add_observations(*id, observations);
            }
            Change::LandmarksAdded { landmarks, scale } => {
                let motion = (*scale != 1.0).then(|| scaling::similarity(*scale));
                self.add_landmarks(landmarks, motion.as_ref());
            }
            Change::ObservationsAdded { keyframe, observations } => {
                self.add_observations(*keyframe, observations);
            }
            Change::ConstraintAdded { id, constraint } => {
                self.add_constraint(*id, *constraint);
                self.parts.contents.insert((Content::Constraint, *id), digest::content(change));
            }
            Change::PriorAdded { id, prior } => {
                self.add_prior(*id, *prior);
                self.parts.contents.insert((Content::Constraint, *id), digest::content(change));
            }
            Change::LandmarksTriangulated { positions } => {
                for (id, position) in positions {
                    if let Some(landmark) = self.parts.landmarks.get_mut(id) {
                        landmark.position = Some(*position);
                        landmark.positioned_revision = self.parts.revision;
                    }
                }
            }
            Change::SolveApplied { solve } => self.take_solve(solve),
            Change::ObservationsRemoved { observations } => {
                self.remove_observations(observations.iter().copied());
            }
            Change::LandmarksFused { kept, absorbed } => self.fuse(*kept, absorbed),
            Change::DuplicatesFound { comparisons } => {
                comparisons.iter().for_each(|comparison| self.parts.duplicates.add(comparison));
            }
            Change::DuplicatesSplit { closures, landmarks } => {
                self.split_duplicates(closures, landmarks);
            }
            Change::PlacesSearched { searches, closures } => {
                for (keyframe, search) in searches {
                    self.parts.place_searches.searched(*keyframe, search, self.parts.revision);
                }
                closures.iter().for_each(|&(id, constraint)| self.add_constraint(id, constraint));
            }
            Change::LandmarksRemoved { landmarks } => self.remove_landmarks(landmarks),
            Change::KeyframeRemoved { keyframe } => self.remove_keyframe(*keyframe),
            Change::KeyframeRetired { retired } => self.retire(retired),
            Change::ConstraintRevoked { id } => self.revoke(*id),
            Change::MapMerged { merge } => self.merge(merge),
            Change::MapTakenOut { name, clients_leave } => self.take_out(name, *clients_leave),
            // The cause contains everything.
            Change::ItemRepeated => {}
            Change::MapUpdated { display_name, policy, frozen } => {
                if let Some(display_name) = display_name {
                    self.parts.display_name.clone_from(display_name);
                }
                self.set_policy(policy.unwrap_or(self.parts.policy));
                self.parts.frozen = frozen.unwrap_or(self.parts.frozen);
            }
        }
    }

    fn set_policy(&mut self, policy: MapPolicy) {
        self.parts.policy = policy;
        if !policy.place_recognition {
            self.parts.place_searches.stop();
        }
    }

    fn open(&mut self, name: &str, epoch: i64) {
        match self.client_named(name) {
            Some(ClientIndex(index)) => {
                let client = &mut self.parts.clients[index as usize];
                client.epoch = epoch;
                client.has_left = false;
                client.drop_unusable_sequences();
            }
            None => self.parts.clients.push(Client::new(name, epoch)),
        }
    }

    fn remember(&mut self, cause: &Cause, request: Option<SolveRequest>) {
        if let Some(client) = self.parts.clients.get_mut(cause.client.0 as usize) {
            client.items.insert(cause.sequence, cause.digest);
            if client.items.len() > REMEMBERED_ITEMS {
                client.items.pop_first();
            }
            client.next_sequence = client.next_sequence.max(cause.sequence.saturating_add(1));
            if let Some(request) = request {
                client.pending_solve = Some(PendingSolve { sequence: cause.sequence, request });
            }
        }
    }

    fn add_landmarks(&mut self, landmarks: &[NewLandmark], motion: Option<&Sim3>) {
        let revision = self.parts.revision;
        for new in landmarks {
            if self.parts.landmarks.contains_key(&new.id) {
                continue;
            }
            self.unseen.insert((revision, new.id), ());
            let landmark = Landmark {
                position: new.moved_by(motion).position,
                sent_position: new.position,
                reference: None,
                observers: Observers::default(),
                added_revision: revision,
                positioned_revision: if new.position.is_some() { revision } else { 0 },
            };
            self.parts.landmarks.insert(new.id, landmark);
        }
    }

    fn add_observations(&mut self, keyframe_id: EntityId, added: &[Observation]) {
        let Some(keyframe) = self.parts.keyframes.get_mut(&keyframe_id) else { return };
        keyframe.observations = keyframe.observations.iter().chain(added).cloned().collect();
        self.descriptor_bytes += descriptor_bytes(added);
        self.observation_count += added.len() as u64;
        if self.parts.policy.place_recognition {
            self.parts.place_searches.observed(keyframe_id, added, self.parts.revision);
        }
        self.observe(keyframe_id, added.iter().map(|observation| observation.landmark));
    }

    /// A keyframe sees landmarks, some of them perhaps already.
    fn observe(&mut self, keyframe_id: EntityId, seen: impl Iterator<Item = EntityId>) {
        let Self { parts, unseen, covisibility, .. } = self;
        let MapParts { landmarks, keyframes, .. } = parts;
        let age = |id: EntityId| keyframes.get(&id).map_or(0, |known| known.added_revision);
        let mut sharing = Vec::new();
        for id in seen {
            let Some(landmark) = landmarks.get_mut(&id) else { continue };
            // A second feature on the same landmark adds no covisibility.
            if let Err(index) = landmark.observers.binary_search(&keyframe_id) {
                if landmark.observers.is_empty() {
                    unseen.remove(&(landmark.added_revision, id));
                }
                covisibility.observe(id, &landmark.observers, keyframe_id, age, &mut sharing);
                landmark.observers.insert(index, keyframe_id);
            }
            landmark.reference.get_or_insert(keyframe_id);
        }
        covisibility.add(keyframe_id, &mut sharing);
    }

    fn add_constraint(&mut self, id: EntityId, constraint: Constraint) {
        self.ties.add(constraint.keyframe_i, id);
        self.ties.add(constraint.keyframe_j, id);
        self.parts.constraints.insert(id, constraint);
    }

    fn add_prior(&mut self, id: EntityId, prior: Prior) {
        self.ties.add(prior.keyframe(), id);
        self.parts.priors.insert(id, prior);
    }

    fn take_solve(&mut self, solve: &AppliedSolve) {
        self.parts.solve_count += 1;
        for (id, pose) in &solve.poses {
            if let Some(keyframe) = self.parts.keyframes.get_mut(id) {
                keyframe.world_from_camera = *pose;
            }
        }
        let revision = self.parts.revision;
        self.parts.landmarks.update_rising(
            solve.landmarks.iter().copied(),
            |landmark, position| {
                if landmark.position.replace(position).is_none() {
                    landmark.positioned_revision = revision;
                }
            },
        );
        for (id, camera) in &solve.cameras {
            if let Some(entity) = self.parts.cameras.get_mut(id) {
                entity.camera = *camera;
            }
        }
        self.parts.switched_off.extend(solve.switched_off.iter().copied());
        for id in &solve.switched_on {
            self.parts.switched_off.remove(id);
        }
        if let Some(id) = solve.request {
            let costs = (solve.initial_cost, solve.final_cost);
            self.parts.last_request = Some(LastRequest::new(id, revision, costs));
        }
        match solve.kind {
            SolveKind::LocalBundle => {}
            SolveKind::PoseGraph => {
                // The windows of an edit may still be open.
                for client in &mut self.parts.clients {
                    if let Some(PendingSolve { request: SolveRequest::Edited(affected), .. }) =
                        &mut client.pending_solve
                    {
                        affected.graph = false;
                    }
                }
                self.parts.adjustment_due =
                    !self.parts.landmarks.is_empty() && self.has_active_closure();
            }
            SolveKind::Global => self.parts.adjustment_due = false,
        }
        for &(client, variance) in &solve.closure_variances {
            if let Some(client) = self.parts.clients.get_mut(client.0 as usize) {
                client.closure_variance = variance;
            }
        }
        for &(client, noise) in &solve.noise {
            if let Some(client) = self.parts.clients.get_mut(client.0 as usize) {
                client.noise = noise;
            }
        }
        for &(client, frame) in &solve.left_frames {
            if let Some(client) = self.parts.clients.get_mut(client.0 as usize) {
                frames::remember(&mut client.earlier_frames, frame);
            }
        }
        for &(client, sequence) in &solve.covered {
            if client == ClientIndex::SERVER {
                self.parts.place_searches.solved(sequence);
            }
            if let Some(client) = self.parts.clients.get_mut(client.0 as usize) {
                client.optimized_sequence = client.optimized_sequence.max(sequence);
                client.pending_solve.take_if(|pending| pending.sequence <= sequence);
            }
        }
    }

    fn remove_keyframe(&mut self, id: EntityId) {
        let Some(keyframe) = self.parts.keyframes.remove(&id) else { return };
        self.observation_count -= keyframe.observations.len() as u64;
        self.descriptor_bytes -= descriptor_bytes(&keyframe.observations);
        self.descriptor_bytes -= image_bytes(keyframe.global_descriptor.as_deref());
        self.by_age.remove(&(keyframe.added_revision, id));
        self.by_time.remove(&(id.client, keyframe.capture_time_ns, id));
        self.by_arrival.remove(&(id.client, keyframe.added_revision, id));
        self.parts.place_searches.remove(id);
        for observation in keyframe.observations.iter() {
            self.forget_observer(observation.landmark, id);
        }
        self.parts.contents.remove(&(Content::Keyframe, id));
        for tie in self.ties.of(id).collect::<Vec<_>>() {
            self.revoke(tie);
        }
    }

    fn revoke(&mut self, id: EntityId) {
        if let Some(constraint) = self.parts.constraints.remove(&id) {
            self.ties.remove(constraint.keyframe_i, id);
            self.ties.remove(constraint.keyframe_j, id);
        }
        if let Some(prior) = self.parts.priors.remove(&id) {
            self.ties.remove(prior.keyframe(), id);
        }
        self.parts.switched_off.remove(&id);
        self.parts.contents.remove(&(Content::Constraint, id));
    }

    fn retire(&mut self, retired: &Retired) {
        let ties = self.ties.of(retired.keyframe).collect::<Vec<_>>();
        ties.into_iter().for_each(|tie| self.parts.duplicates.keep(tie));
        self.remove_keyframe(retired.keyframe);
        self.remove_landmarks(&retired.landmarks);
        retired.revoked.iter().for_each(|&id| self.revoke(id));
        retired
            .constraints
            .iter()
            .for_each(|&(id, constraint)| self.add_constraint(id, constraint));
        retired.priors.iter().for_each(|&(id, prior)| self.add_prior(id, prior));
    }
}
