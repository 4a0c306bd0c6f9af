//! Whether a map that comes from outside is one that events can make.
//!
//! [`Map::from_parts`] checks that references lead somewhere, which is enough for a snapshot of our
//! own. A file that somebody uploads may hold anything: here each number is checked as an item's
//! numbers are, and what the fold keeps true of every map. Nothing is changed or repaired.

use super::numbers::{is_finite, is_policy, is_pose, is_positive, is_similarity, is_valid_camera};
use super::scaling::SCALES;
use super::{
    Affected, Client, ConstraintKind, Content, EntityId, EntityKind, Keyframe, Landmark,
    MAX_NUMBER, Map, MapError, Observation, PendingSolve, PlaceRefusal, PlaceSearch, SolveRequest,
};

type Outcome = Result<(), MapError>;

fn check(holds: bool, kind: EntityKind, id: EntityId, what: &'static str) -> Outcome {
    if holds { Ok(()) } else { Err(MapError::Unsound { kind, id, what }) }
}

fn check_map(holds: bool, what: &'static str) -> Outcome {
    if holds { Ok(()) } else { Err(MapError::UnsoundMap { what }) }
}

impl Map {
    /// Checks a map that was put together from parts of unknown origin.
    ///
    /// # Errors
    /// [`MapError::Unsound`] with the first entity that no event makes, [`MapError::UnsoundMap`].
    pub fn check_sound(&self) -> Result<(), MapError> {
        let counts =
            [self.solve_count(), self.update_time_ns().saturating_sub(self.create_time_ns())];
        let counts = counts.into_iter().all(|count| count >= 0) && self.solve_count() <= MAX_NUMBER;
        check_map(counts, "the map's times or its number of solves are invalid")?;
        check_map((1..=MAX_NUMBER).contains(&self.revision()), "the map's revision is invalid")?;
        let text = "a loss, a threshold or the geodetic anchor of the map's policy is invalid";
        check_map(is_policy(self.policy()), text)?;
        self.clients_are_sound()?;
        for (&id, entity) in self.cameras() {
            self.own(id, EntityKind::Camera)?;
            let is_valid = is_valid_camera(&entity.camera);
            check(is_valid, EntityKind::Camera, id, "has invalid parameters")?;
        }
        self.keyframes().iter().try_for_each(|(&id, keyframe)| self.keyframe(id, keyframe))?;
        self.landmarks().iter().try_for_each(|(&id, landmark)| self.landmark(id, landmark))?;
        self.constraints_are_sound()?;
        for (&id, off) in self.switched_off() {
            check(
                off.is_possible(),
                EntityKind::Constraint,
                id,
                "is switched off by a chi2 or weight that is not a number",
            )?;
        }
        for &id in self.duplicates().compared() {
            // It may have been revoked a moment ago.
            check(
                self.client(id.client).is_some(),
                EntityKind::Constraint,
                id,
                "belongs to no client",
            )?;
        }
        self.searches_are_sound()?;
        let clients = self.merged().iter().flat_map(|merged| &merged.clients);
        let known = clients.into_iter().all(|client| self.client(client.index).is_some());
        check_map(known, "a merged map has an invalid client")?;
        let placed = self.merged().iter().map(|merged| &merged.target_from_source);
        let placed = placed.into_iter().all(is_similarity);
        check_map(placed, "a merged map has an invalid pose or scale")?;
        let mut first = self.merged().iter().filter_map(|merged| merged.first);
        let first = first.all(|(id, pose)| self.client(id.client).is_some() && is_pose(&pose));
        check_map(first, "the first keyframe of a merged map is invalid")?;
        for &(content, id) in self.contents().keys() {
            let (kind, is_known) = match content {
                Content::Camera => (EntityKind::Camera, self.cameras().contains_key(&id)),
                Content::Keyframe => (EntityKind::Keyframe, self.keyframes().contains_key(&id)),
                Content::Constraint => (EntityKind::Constraint, self.has_constraint(id)),
            };
            check(is_known, kind, id, "has a digest and is not in the map")?;
        }
        Ok(())
    }

    fn clients_are_sound(&self) -> Outcome {
        let mut names: Vec<&str> = self.clients().iter().map(|c| c.name.as_str()).collect();
        names.sort_unstable();
        let twice = names.windows(2).any(|pair| pair[0] == pair[1]);
        check_map(!twice, "two clients have the same name")?;
        for client in self.clients() {
            let Client {
                name: _,
                epoch,
                next_sequence,
                optimized_sequence,
                pending_solve,
                closure_variance,
                noise,
                earlier_frames,
                scale,
                has_left,
                items,
            } = client;
            let numbers = (1..=MAX_NUMBER).contains(epoch)
                && (1..=MAX_NUMBER + 1).contains(next_sequence)
                && (0..*next_sequence).contains(optimized_sequence);
            let first = items.iter().next().is_none_or(|(&sequence, _)| sequence >= 1);
            let last = items.last_key_value().is_none_or(|(sequence, _)| sequence < next_sequence);
            let text = "a client's epoch or sequences are invalid";
            check_map(numbers && first && last, text)?;
            let text = "a client's pending solve is invalid";
            let waits = |pending: &PendingSolve| {
                (1..*next_sequence).contains(&pending.sequence)
                    && self.can_be_solved(&pending.request)
            };
            check_map(pending_solve.as_ref().is_none_or(waits), text)?;
            let frames = earlier_frames.len() <= super::frames::MOST_FRAMES;
            let text = "a client's earlier frames are invalid";
            check_map(frames && earlier_frames.iter().all(is_pose), text)?;
            let text = "a client's variance factor is invalid";
            check_map(is_positive(*closure_variance), text)?;
            let text = "the noise of a client is invalid";
            check_map(noise.is_possible(), text)?;
            check_map(SCALES.contains(scale), "a client's scale is invalid")?;
            let is_gone = !has_left || (*next_sequence == 1 && pending_solve.is_none());
            check_map(is_gone, "a client that left has items")?;
        }
        Ok(())
    }

    fn searches_are_sound(&self) -> Outcome {
        let (searches, kind) = (self.place_searches(), EntityKind::Keyframe);
        let numbers = (0..=self.revision()).contains(&searches.unsolved);
        check_map(numbers, "the pending closures are invalid")?;
        for (&id, &revision) in &searches.pending {
            let is_possible = self.keyframes().contains_key(&id) && self.is_revision(revision);
            check(is_possible, kind, id, "waits for an invalid search")?;
        }
        for (&id, search) in &searches.done {
            // Candidates and closures may have gone since.
            let is_known = |id: EntityId| self.client(id.client).is_some();
            let candidates = &search.candidates;
            let refusals = candidates.iter().map(|candidate| &candidate.refusal);
            let mut refusals = refusals.chain([&search.refusal]).flatten();
            let is_possible = self.keyframes().contains_key(&id)
                && refusals.all(PlaceRefusal::is_short)
                && candidates.len() <= PlaceSearch::MOST_CANDIDATES
                && candidates.iter().all(|c| is_known(c.keyframe) && c.score.is_finite())
                && search.closure.is_none_or(is_known);
            check(is_possible, kind, id, "has an invalid search")?;
        }
        Ok(())
    }

    /// Keyframes may have gone since.
    fn can_be_solved(&self, request: &SolveRequest) -> bool {
        let keyframes = match request {
            SolveRequest::Views(keyframe) => std::slice::from_ref(keyframe),
            SolveRequest::Edited(affected) => &affected.keyframes,
            SolveRequest::LoopClosure | SolveRequest::Prior => &[],
        };
        keyframes.len() <= Affected::MOST_KEYFRAMES
            && keyframes.iter().all(|id| self.client(id.client).is_some())
    }

    /// An entity of a client, which chose its id.
    fn own(&self, id: EntityId, kind: EntityKind) -> Outcome {
        check(self.client(id.client).is_some(), kind, id, "belongs to no client")?;
        check(id.id >= 0, kind, id, "has a negative id")
    }

    fn is_revision(&self, revision: i64) -> bool {
        (1..=self.revision()).contains(&revision)
    }

    fn keyframe(&self, id: EntityId, keyframe: &Keyframe) -> Outcome {
        let test = |holds, what| check(holds, EntityKind::Keyframe, id, what);
        self.own(id, EntityKind::Keyframe)?;
        let poses = is_pose(&keyframe.world_from_camera) && is_pose(&keyframe.odom_from_camera);
        test(poses, "has an invalid pose")?;
        test(
            self.is_revision(keyframe.added_revision),
            "has a revision that the map does not have",
        )?;
        let sees = keyframe.camera.is_some() || keyframe.observations.is_empty();
        test(sees, "has observations and no camera")?;
        let possible = keyframe.observations.iter().all(Observation::is_possible);
        test(possible, "has an observation with an invalid number")?;
        let mut keys: Vec<_> = keyframe.observations.iter().map(Observation::key).collect();
        keys.sort_unstable();
        let twice = keys.windows(2).any(|pair| pair[0] == pair[1]);
        test(!twice, "has an observation twice")
    }

    fn landmark(&self, id: EntityId, landmark: &Landmark) -> Outcome {
        let test = |holds, what| check(holds, EntityKind::Landmark, id, what);
        self.own(id, EntityKind::Landmark)?;
        let positions = [landmark.position, landmark.sent_position];
        test(positions.iter().flatten().all(is_finite), "has a position that is not finite")?;
        let positioned = (0..=self.revision()).contains(&landmark.positioned_revision);
        let revisions = self.is_revision(landmark.added_revision) && positioned;
        test(revisions, "has a revision that the map does not have")?;
        let observers = &landmark.observers;
        let reference = landmark.reference.is_none_or(|k| observers.binary_search(&k).is_ok());
        test(reference, "moves with a keyframe that does not see it")
    }

    fn constraints_are_sound(&self) -> Outcome {
        let kind = EntityKind::Constraint;
        // Ids of the server are negative; each revision has some thousand.
        let is_id = |id: EntityId, is_ours: bool| id.id >= 0 || (is_ours && id.id >= -MAX_NUMBER);
        for (&id, constraint) in self.constraints() {
            check(self.client(id.client).is_some(), kind, id, "belongs to no client")?;
            let ours = [ConstraintKind::Marginal, ConstraintKind::LoopClosure];
            let is_ours = ours.contains(&constraint.kind);
            check(is_id(id, is_ours), kind, id, "has an invalid id")?;
            let ends = constraint.keyframe_i != constraint.keyframe_j;
            check(ends && constraint.is_possible(), kind, id, "has an invalid measurement")?;
        }
        for (&id, prior) in self.priors() {
            check(self.client(id.client).is_some(), kind, id, "belongs to no client")?;
            check(is_id(id, true), kind, id, "has an invalid id")?;
            check(!self.constraints().contains_key(&id), kind, id, "is in the map twice")?;
            check(prior.is_possible(), kind, id, "has an invalid measurement")?;
        }
        Ok(())
    }
}
