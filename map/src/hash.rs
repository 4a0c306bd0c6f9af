//! A running SHA-256 over values, bit by bit.
//!
//! Every number is hashed as eight little-endian bytes (floats by their bits), every list and option
//! after its length, every enum after a tag, so that no two values share an encoding. The encoding is
//! used only in digests; it is no journal format. It must stay as it is: hashes of maps that exist are
//! compared with it.

use covis_solvers::geometry::{Camera, Geodetic, Se3};
use covis_solvers::information::Information;
use covis_solvers::loss::Loss;
use covis_solvers::robust::Kernel;
use nalgebra::Vector3;
use sha2::{Digest as _, Sha256};

use super::{
    CameraEntity, ClosureRobustness, Constraint, Depth, Descriptor, Digest, EntityId, Gauge,
    Keyframe, Landmark, MapPolicy, Observation, PlaceCandidate, PlaceRefusal, PlaceSearch, Prior,
    WhenFull,
};

/// Added to the tag of a constraint or prior with a loss of its own or a lever arm.
const OWN_LOSS: u8 = 0x40;

/// A running SHA-256 with one method per type.
pub(super) struct Hash(Sha256);

impl Hash {
    pub(super) fn new() -> Self {
        Self(Sha256::new())
    }

    pub(super) fn finish(self) -> Digest {
        self.0.finalize().into()
    }

    pub(super) fn tag(&mut self, tag: u8) {
        self.0.update([tag]);
    }

    pub(super) fn i64(&mut self, value: i64) {
        self.0.update(value.to_le_bytes());
    }

    pub(super) fn u64(&mut self, value: u64) {
        self.0.update(value.to_le_bytes());
    }

    fn length(&mut self, length: usize) {
        self.u64(length as u64);
    }

    pub(super) fn f64(&mut self, value: f64) {
        self.u64(value.to_bits());
    }

    /// The entries of a list after its length.
    pub(super) fn list<L: IntoIterator<IntoIter: ExactSizeIterator>>(
        &mut self,
        list: L,
        mut each: impl FnMut(&mut Self, L::Item),
    ) {
        let entries = list.into_iter();
        self.length(entries.len());
        entries.for_each(|entry| each(self, entry));
    }

    /// A list of values, each after its id.
    pub(super) fn entities<'a, V: 'a>(
        &mut self,
        entities: impl IntoIterator<Item = (&'a EntityId, &'a V), IntoIter: ExactSizeIterator>,
        each: impl Fn(&mut Self, &V),
    ) {
        self.list(entities, |hash, (&id, value)| {
            hash.id(id);
            each(hash, value);
        });
    }

    /// A finished digest, as it is.
    pub(super) fn digest(&mut self, digest: &Digest) {
        self.0.update(digest);
    }

    fn bytes(&mut self, bytes: &[u8]) {
        self.length(bytes.len());
        self.0.update(bytes);
    }

    pub(super) fn text(&mut self, text: &str) {
        self.bytes(text.as_bytes());
    }

    pub(super) fn id(&mut self, id: EntityId) {
        self.u64(u64::from(id.client.0));
        self.i64(id.id);
    }

    pub(super) fn optional_id(&mut self, id: Option<EntityId>) {
        self.tag(u8::from(id.is_some()));
        if let Some(id) = id {
            self.id(id);
        }
    }

    fn vector(&mut self, vector: &Vector3<f64>) {
        vector.iter().for_each(|&v| self.f64(v));
    }

    pub(super) fn optional_vector(&mut self, vector: Option<&Vector3<f64>>) {
        self.tag(u8::from(vector.is_some()));
        if let Some(vector) = vector {
            self.vector(vector);
        }
    }

    pub(super) fn pose(&mut self, pose: &Se3) {
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

    pub(super) fn policy(&mut self, policy: &MapPolicy) {
        let MapPolicy {
            local_bundle,
            loop_closure,
            loop_closure_robustness,
            window_keyframes,
            min_shared_landmarks,
            observation_loss,
            constraint_loss,
            max_local_iterations,
            limits,
            when_full,
            max_queued_items,
            gauge,
            geodetic_anchor,
            closure_adjustment,
            odometry,
            metric_odometry,
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
        for limit in [limits.keyframes, limits.landmarks, limits.observations] {
            self.tag(u8::from(limit.is_some()));
            self.u64(limit.unwrap_or(0));
        }
        // Later settings have a name and are left out where they are absent, so that maps without
        // them keep the hash that they always had.
        for (name, limit) in [
            ("max_bytes", limits.bytes),
            ("max_clients", limits.clients),
            ("max_cameras", limits.cameras),
            ("max_constraints", limits.constraints),
            ("max_priors", limits.priors),
        ] {
            if let Some(limit) = limit {
                self.text(name);
                self.u64(limit);
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
        if !odometry {
            self.text("no_odometry");
        }
        if !metric_odometry {
            self.text("no_metric_odometry");
        }
        if !closure_adjustment {
            self.text("no_closure_adjustment");
        }
        if *place_recognition {
            self.text("place_recognition");
        }
    }

    pub(super) fn place_search(&mut self, search: &PlaceSearch) {
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

    pub(super) fn camera_entity(&mut self, entity: &CameraEntity) {
        self.tag(match entity.camera {
            Camera::Pinhole(_) => 0,
            Camera::Fisheye(_) => 1,
            Camera::Snavely(_) => 2,
        });
        entity.camera.parameters().as_slice().iter().for_each(|&v| self.f64(v));
        self.u64(u64::from(entity.width_px));
        self.u64(u64::from(entity.height_px));
    }

    pub(super) fn observations(&mut self, observations: &[Observation]) {
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

    pub(super) fn keyframe(&mut self, keyframe: &Keyframe) {
        self.keyframe_content(keyframe);
        self.i64(keyframe.added_revision);
    }

    pub(super) fn keyframe_content(&mut self, keyframe: &Keyframe) {
        self.i64(keyframe.capture_time_ns);
        self.optional_id(keyframe.camera);
        self.pose(&keyframe.world_from_camera);
        self.pose(&keyframe.odom_from_camera);
        self.observations(&keyframe.observations);
    }

    pub(super) fn descriptor(&mut self, descriptor: &Descriptor) {
        self.tag(descriptor.kind as u8);
        self.text(&descriptor.name);
        self.bytes(&descriptor.data);
    }

    pub(super) fn landmark(&mut self, landmark: &Landmark) {
        self.landmark_content(landmark);
        self.i64(landmark.added_revision);
        self.i64(landmark.positioned_revision);
    }

    pub(super) fn landmark_content(&mut self, landmark: &Landmark) {
        self.optional_vector(landmark.position.as_ref());
        self.optional_vector(landmark.sent_position.as_ref());
        self.optional_id(landmark.reference);
        self.list(&landmark.observers, |hash, &id| hash.id(id));
    }

    pub(super) fn constraint(&mut self, constraint: &Constraint) {
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

    pub(super) fn prior(&mut self, prior: &Prior) {
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
