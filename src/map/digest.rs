//! SHA-256 over values, bit by bit: the hash of a map's state and of what a client sent.
//!
//! Every number is hashed as eight little-endian bytes (floats by their bits), every list and option
//! after its length, every enum after a tag, so that no two values share an encoding. The encoding is
//! used only in digests; it is no journal format.

use covis_solvers::geometry::{Camera, Geodetic, Se3};
use covis_solvers::information::Information;
use covis_solvers::loss::Loss;
use covis_solvers::robust::Kernel;
use nalgebra::Vector3;
use sha2::{Digest as _, Sha256};

use super::{
    CameraEntity, Change, ClosureRobustness, Constraint, Depth, Descriptor, Digest, EntityId,
    Gauge, Keyframe, Landmark, Map, MapPolicy, NewLandmark, Observation, PlaceCandidate,
    PlaceRefusal, PlaceSearch, Prior, SwitchedOff, WhenFull,
};

/// Added to the tag of a constraint or prior with a loss of its own or a lever arm.
const OWN_LOSS: u8 = 0x40;

/// The kinds of entity whose content as sent is remembered. Their order is in snapshots and hashes.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Content {
    /// Cameras.
    Camera,
    /// Keyframes.
    Keyframe,
    /// Constraints and priors.
    Constraint,
}

/// The digest of what an event adds, for the kinds whose content is remembered.
pub(super) fn content(change: &Change) -> Digest {
    let mut hash = Hash::new();
    if let Change::CameraSet { id, camera } = change {
        hash.tag(0);
        hash.id(*id);
        hash.camera_entity(camera);
    } else if let Change::KeyframeAdded {
        id,
        capture_time_ns,
        camera,
        world_from_camera,
        odom_from_camera,
        observations,
        landmarks,
        global_descriptor,
        // Of the map, not of what was sent.
        motion: _,
    } = change
    {
        hash.tag(1);
        hash.id(*id);
        hash.i64(*capture_time_ns);
        hash.optional_id(*camera);
        hash.pose(world_from_camera);
        hash.pose(odom_from_camera);
        hash.observations(observations);
        hash.list(landmarks, |hash, &NewLandmark { id, position }| {
            hash.id(id);
            hash.optional_vector(position.as_ref());
        });
        if let Some(descriptor) = global_descriptor {
            hash.descriptor(descriptor);
        }
    } else if let Change::ConstraintAdded { id, constraint } = change {
        hash.tag(2);
        hash.id(*id);
        hash.constraint(constraint);
    } else if let Change::PriorAdded { id, prior } = change {
        hash.tag(3);
        hash.id(*id);
        hash.prior(prior);
    } else {
        hash.tag(255);
    }
    hash.finish()
}

impl Map {
    /// SHA-256 over the whole state, bit exact.
    ///
    /// Times and the display name are left out, so that two runs on the same input compare equal; the
    /// covisibility counts are left out because the observations determine them. What is to be solved
    /// for a client is left out because earlier versions did not keep it.
    #[must_use]
    pub fn state_hash(&self) -> [u8; 32] {
        let mut hash = Hash::new();
        hash.i64(self.revision);
        hash.policy(&self.policy);
        hash.list(&self.clients, |hash, client| {
            hash.text(&client.name);
            hash.i64(client.epoch);
            hash.i64(client.next_sequence);
            hash.i64(client.optimized_sequence);
            hash.list(&client.items, |hash, (&sequence, digest)| {
                hash.i64(sequence);
                hash.0.update(digest);
            });
        });
        self.hash_entities(&mut hash, Hash::keyframe, Hash::landmark);
        hash.list(&self.contents, |hash, (&(kind, id), digest)| {
            hash.tag(kind as u8);
            hash.id(id);
            hash.0.update(digest);
        });
        // What came later is hashed only where it is not as it was before.
        let varied = (0_u64..).zip(&self.clients).filter(|(_, c)| c.closure_variance != 1.0);
        for (index, client) in varied {
            hash.tag(2);
            hash.u64(index);
            hash.f64(client.closure_variance);
        }
        let moved = (0_u64..).zip(&self.clients).filter(|(_, c)| !c.earlier_frames.is_empty());
        for (index, client) in moved {
            hash.tag(6);
            hash.u64(index);
            hash.list(&client.earlier_frames, |hash, frame| hash.pose(frame));
        }
        let scaled = (0_u64..).zip(&self.clients).filter(|(_, c)| c.scale != 1.0);
        for (index, client) in scaled {
            hash.tag(8);
            hash.u64(index);
            hash.f64(client.scale);
        }
        if self.frozen {
            hash.tag(1);
        }
        if !self.duplicates.is_empty() {
            hash.tag(3);
            self.duplicates.pairs().for_each(|(a, b, closure)| {
                hash.id(a);
                hash.id(b);
                hash.optional_id(closure);
            });
            hash.list(self.duplicates.compared(), |hash, &closure| hash.id(closure));
        }
        if self.adjustment_due {
            hash.tag(4);
        }
        if !self.place_searches.done().is_empty() {
            hash.tag(5);
            hash.entities(self.place_searches.done(), Hash::place_search);
        }
        hash.finish()
    }

    /// SHA-256 over the content of the map, bit exact and independent of its history: clients by name,
    /// cameras, keyframes, landmarks, constraints, those that are switched off, priors.
    ///
    /// Revisions, epochs and sequences are left out, so that a stream that broke and was resumed
    /// compares equal to one that did not.
    #[must_use]
    pub fn content_hash(&self) -> [u8; 32] {
        let mut hash = Hash::new();
        hash.list(&self.clients, |hash, client| hash.text(&client.name));
        self.hash_entities(&mut hash, Hash::keyframe_content, Hash::landmark_content);
        for (a, b, _) in self.duplicates.pairs() {
            hash.tag(3);
            hash.id(a);
            hash.id(b);
        }
        hash.finish()
    }

    /// Everything with an id, in the order of the ids.
    fn hash_entities(
        &self,
        hash: &mut Hash,
        keyframe: fn(&mut Hash, &Keyframe),
        landmark: fn(&mut Hash, &Landmark),
    ) {
        hash.entities(&self.cameras, Hash::camera_entity);
        hash.entities(&self.keyframes, keyframe);
        hash.entities(&self.landmarks, landmark);
        hash.entities(&self.constraints, Hash::constraint);
        hash.entities(&self.switched_off, |hash, SwitchedOff { chi2, weight, is_provisional }| {
            hash.f64(*chi2);
            hash.f64(*weight);
            if *is_provisional {
                hash.tag(1);
            }
        });
        hash.entities(&self.priors, Hash::prior);
        // Earlier versions kept none.
        let images = self.keyframes.iter();
        for (&id, image) in images.filter_map(|(id, k)| Some((id, k.global_descriptor.as_ref()?))) {
            hash.tag(7);
            hash.id(id);
            hash.descriptor(image);
        }
    }

    /// SHA-256 over the ids of all keyframes by client name, then id: the name as text, the id as
    /// eight bytes.
    #[must_use]
    pub fn keyframe_ids_digest(&self) -> [u8; 32] {
        let name = |id: &EntityId| self.client(id.client).map_or("", |client| &client.name);
        let mut ids: Vec<(&str, i64)> = self.keyframes.keys().map(|id| (name(id), id.id)).collect();
        ids.sort_unstable();
        let mut hash = Hash::new();
        for (client, id) in ids {
            hash.text(client);
            hash.i64(id);
        }
        hash.finish()
    }
}

/// A running SHA-256 with one method per type.
struct Hash(Sha256);

impl Hash {
    fn new() -> Self {
        Self(Sha256::new())
    }

    fn finish(self) -> Digest {
        self.0.finalize().into()
    }

    fn tag(&mut self, tag: u8) {
        self.0.update([tag]);
    }

    fn i64(&mut self, value: i64) {
        self.0.update(value.to_le_bytes());
    }

    fn u64(&mut self, value: u64) {
        self.0.update(value.to_le_bytes());
    }

    fn length(&mut self, length: usize) {
        self.u64(length as u64);
    }

    fn f64(&mut self, value: f64) {
        self.u64(value.to_bits());
    }

    /// The entries of a list after its length.
    fn list<L: IntoIterator<IntoIter: ExactSizeIterator>>(
        &mut self,
        list: L,
        mut each: impl FnMut(&mut Self, L::Item),
    ) {
        let entries = list.into_iter();
        self.length(entries.len());
        entries.for_each(|entry| each(self, entry));
    }

    /// A list of values, each after its id.
    fn entities<'a, V: 'a>(
        &mut self,
        entities: impl IntoIterator<Item = (&'a EntityId, &'a V), IntoIter: ExactSizeIterator>,
        each: impl Fn(&mut Self, &V),
    ) {
        self.list(entities, |hash, (&id, value)| {
            hash.id(id);
            each(hash, value);
        });
    }

    fn bytes(&mut self, bytes: &[u8]) {
        self.length(bytes.len());
        self.0.update(bytes);
    }

    fn text(&mut self, text: &str) {
        self.bytes(text.as_bytes());
    }

    fn id(&mut self, id: EntityId) {
        self.u64(u64::from(id.client.0));
        self.i64(id.id);
    }

    fn optional_id(&mut self, id: Option<EntityId>) {
        self.tag(u8::from(id.is_some()));
        if let Some(id) = id {
            self.id(id);
        }
    }

    fn vector(&mut self, vector: &Vector3<f64>) {
        vector.iter().for_each(|&v| self.f64(v));
    }

    fn optional_vector(&mut self, vector: Option<&Vector3<f64>>) {
        self.tag(u8::from(vector.is_some()));
        if let Some(vector) = vector {
            self.vector(vector);
        }
    }

    fn pose(&mut self, pose: &Se3) {
        pose.rotation.quaternion().coords.iter().for_each(|&v| self.f64(v));
        self.vector(&pose.translation);
    }

    fn information<const N: usize>(&mut self, information: &Information<N>) {
        information.matrix().iter().for_each(|&v| self.f64(v));
    }

    fn loss(&mut self, loss: &Loss) {
        let (tag, width) = match *loss {
            Loss::Trivial => (0, 0.0),
            Loss::Huber(width) => (1, width),
            Loss::Cauchy(width) => (2, width),
            Loss::Tukey(width) => (3, width),
            Loss::GemanMcClure(width) => (4, width),
        };
        self.tag(tag);
        self.f64(width);
    }

    fn policy(&mut self, policy: &MapPolicy) {
        let MapPolicy {
            local_bundle,
            loop_closure,
            loop_closure_robustness,
            window_keyframes,
            min_shared_landmarks,
            observation_loss,
            constraint_loss,
            max_local_iterations,
            ceilings,
            when_full,
            max_queued_items,
            gauge,
            geodetic_anchor,
            closure_adjustment,
            place_recognition,
        } = policy;
        self.tag(u8::from(*local_bundle));
        self.tag(u8::from(*loop_closure));
        let ClosureRobustness { kernel, threshold } = loop_closure_robustness;
        self.tag(match kernel {
            None => 0,
            Some(Kernel::TruncatedLeastSquares) => 1,
            Some(Kernel::GemanMcClure) => 2,
        });
        self.tag(u8::from(threshold.is_some()));
        self.f64(threshold.unwrap_or(0.0));
        self.length(*window_keyframes);
        self.length(*min_shared_landmarks);
        self.loss(observation_loss);
        self.loss(constraint_loss);
        self.length(*max_local_iterations);
        for ceiling in [ceilings.max_keyframes, ceilings.max_landmarks, ceilings.max_observations] {
            self.tag(u8::from(ceiling.is_some()));
            self.u64(ceiling.unwrap_or(0));
        }
        // Later settings have a name and are left out where they are absent, so that maps without
        // them keep the hash that they always had.
        for (name, ceiling) in [
            ("max_bytes", ceilings.max_bytes),
            ("max_clients", ceilings.max_clients),
            ("max_cameras", ceilings.max_cameras),
            ("max_constraints", ceilings.max_constraints),
            ("max_priors", ceilings.max_priors),
        ] {
            if let Some(ceiling) = ceiling {
                self.text(name);
                self.u64(ceiling);
            }
        }
        match when_full {
            WhenFull::Reject => {}
            WhenFull::Marginalize => self.text("marginalize"),
            WhenFull::Sparsify => self.text("sparsify"),
        }
        if let Some(items) = max_queued_items {
            self.text("max_queued_items");
            self.u64(u64::from(*items));
        }
        match gauge {
            Gauge::FirstKeyframeFixed => {}
            Gauge::Free => self.text("gauge_free"),
            Gauge::Priors => self.text("gauge_priors"),
            Gauge::FixedPoses => self.text("gauge_fixed_poses"),
        }
        if let Some(Geodetic { latitude_deg, longitude_deg, height_m }) = geodetic_anchor {
            self.text("geodetic_anchor");
            [latitude_deg, longitude_deg, height_m].into_iter().for_each(|&x| self.f64(x));
        }
        if !closure_adjustment {
            self.text("no_closure_adjustment");
        }
        if *place_recognition {
            self.text("place_recognition");
        }
    }

    fn place_search(&mut self, search: &PlaceSearch) {
        let PlaceSearch { candidates, closure, refusal } = search;
        self.list(candidates, |hash, candidate| {
            let PlaceCandidate { keyframe, score, matches, refusal } = candidate;
            hash.id(*keyframe);
            hash.f64(*score);
            hash.u64(u64::from(*matches));
            hash.place_refusal(refusal.as_ref());
        });
        self.optional_id(*closure);
        self.place_refusal(refusal.as_ref());
    }

    fn place_refusal(&mut self, refusal: Option<&PlaceRefusal>) {
        self.tag(u8::from(refusal.is_some()));
        if let Some(PlaceRefusal { reason, text }) = refusal {
            self.text(reason);
            self.text(text);
        }
    }

    fn camera_entity(&mut self, entity: &CameraEntity) {
        self.tag(match entity.camera {
            Camera::Pinhole(_) => 0,
            Camera::Fisheye(_) => 1,
            Camera::Snavely(_) => 2,
        });
        entity.camera.parameters().as_slice().iter().for_each(|&v| self.f64(v));
        self.u64(u64::from(entity.width_px));
        self.u64(u64::from(entity.height_px));
    }

    fn observations(&mut self, observations: &[Observation]) {
        self.list(observations, Self::observation);
    }

    fn observation(&mut self, observation: &Observation) {
        let Observation { landmark, pixel, sigma_px, depth, descriptor } = observation;
        self.id(*landmark);
        self.f64(pixel.x);
        self.f64(pixel.y);
        self.f64(*sigma_px);
        self.tag(u8::from(depth.is_some()));
        if let Some(Depth { depth_m, sigma_m }) = depth {
            self.f64(*depth_m);
            self.f64(*sigma_m);
        }
        self.tag(u8::from(descriptor.is_some()));
        if let Some(descriptor) = descriptor {
            self.descriptor(descriptor);
        }
    }

    fn keyframe(&mut self, keyframe: &Keyframe) {
        self.keyframe_content(keyframe);
        self.i64(keyframe.added_revision);
    }

    fn keyframe_content(&mut self, keyframe: &Keyframe) {
        self.i64(keyframe.capture_time_ns);
        self.optional_id(keyframe.camera);
        self.pose(&keyframe.world_from_camera);
        self.pose(&keyframe.odom_from_camera);
        self.observations(&keyframe.observations);
    }

    fn descriptor(&mut self, descriptor: &Descriptor) {
        self.tag(descriptor.kind as u8);
        self.text(&descriptor.name);
        self.bytes(&descriptor.data);
    }

    fn landmark(&mut self, landmark: &Landmark) {
        self.landmark_content(landmark);
        self.i64(landmark.added_revision);
        self.i64(landmark.positioned_revision);
    }

    fn landmark_content(&mut self, landmark: &Landmark) {
        self.optional_vector(landmark.position.as_ref());
        self.optional_vector(landmark.sent_position.as_ref());
        self.optional_id(landmark.reference);
        self.list(&landmark.observers, |hash, &id| hash.id(id));
    }

    fn constraint(&mut self, constraint: &Constraint) {
        // What came later has tags of its own, so that the hashes of older maps stay.
        self.tag(constraint.kind as u8 | if constraint.loss.is_some() { OWN_LOSS } else { 0 });
        self.id(constraint.keyframe_i);
        self.id(constraint.keyframe_j);
        self.pose(&constraint.keyframe_i_from_keyframe_j);
        self.information(&constraint.information);
        if let Some(loss) = &constraint.loss {
            self.loss(loss);
        }
    }

    fn prior(&mut self, prior: &Prior) {
        match prior {
            Prior::Pose { keyframe, world_from_camera, information, loss } => {
                let is_plain = *loss == Loss::Trivial;
                self.tag(if is_plain { 0 } else { OWN_LOSS });
                self.id(*keyframe);
                self.pose(world_from_camera);
                self.information(information);
                if !is_plain {
                    self.loss(loss);
                }
            }
            Prior::Position { keyframe, position_in_world, point_in_camera, information, loss } => {
                // −0 is no lever arm either.
                let is_plain = *loss == Loss::Trivial && *point_in_camera == Vector3::zeros();
                self.tag(if is_plain { 1 } else { 1 | OWN_LOSS });
                self.id(*keyframe);
                self.vector(position_in_world);
                self.information(information);
                if !is_plain {
                    self.vector(point_in_camera);
                    self.loss(loss);
                }
            }
        }
    }
}
