//! Digests of a map's state, of its content, and of what a client sent.
//!
//! This file says what goes into each of them, in which order; `hash` says how a value becomes bytes.
//! What is hashed never changes for maps that exist: what came later is added only where it is used.

use super::hash::Hash;
use super::{
    Change, Client, Digest, EntityId, Keyframe, Landmark, Map, NewLandmark, Noise, OdometryNoise,
    SwitchedOff, ViewNoise,
};

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
    pub fn state_hash(&self) -> [u8; 32] {
        let mut hash = Hash::new();
        hash.i64(self.revision());
        hash.policy(self.policy());
        hash.list(self.clients(), |hash, client| {
            hash.text(&client.name);
            hash.i64(client.epoch);
            hash.i64(client.next_sequence);
            hash.i64(client.optimized_sequence);
            hash.list(&client.items, |hash, (&sequence, digest)| {
                hash.i64(sequence);
                hash.digest(digest);
            });
        });
        self.hash_entities(&mut hash, Hash::keyframe, Hash::landmark);
        hash.list(self.contents(), |hash, (&(kind, id), digest)| {
            hash.tag(kind as u8);
            hash.id(id);
            hash.digest(digest);
        });
        // What came later is hashed only where it is not as it was before.
        let varied = (0_u64..).zip(self.clients()).filter(|(_, c)| c.closure_variance != 1.0);
        for (index, client) in varied {
            hash.tag(2);
            hash.u64(index);
            hash.f64(client.closure_variance);
        }
        let other = |client: &Client| client.noise != Noise::default();
        let learned = (0_u64..).zip(self.clients()).filter(|(_, c)| other(c));
        for (index, client) in learned {
            hash.tag(10);
            hash.u64(index);
            let Noise { odometry, views } = client.noise;
            let OdometryNoise { translation_share, rotation_rad, pairs } = odometry;
            let ViewNoise { pixel_factor, depth_factor, windows, outlier_share: _ } = views;
            let odometry = [translation_share, rotation_rad, pairs];
            let views = [pixel_factor, depth_factor, windows];
            odometry.into_iter().chain(views).for_each(|x| hash.f64(x));
        }
        let misfit = (0_u64..).zip(self.clients());
        for (index, client) in misfit.filter(|(_, c)| c.noise.views.outlier_share != 0.0) {
            hash.tag(11);
            hash.u64(index);
            hash.f64(client.noise.views.outlier_share);
        }
        let moved = (0_u64..).zip(self.clients()).filter(|(_, c)| !c.earlier_frames.is_empty());
        for (index, client) in moved {
            hash.tag(6);
            hash.u64(index);
            hash.list(&client.earlier_frames, |hash, frame| hash.pose(frame));
        }
        let scaled = (0_u64..).zip(self.clients()).filter(|(_, c)| c.scale != 1.0);
        for (index, client) in scaled {
            hash.tag(8);
            hash.u64(index);
            hash.f64(client.scale);
        }
        let gone = (0_u64..).zip(self.clients()).filter(|(_, client)| client.has_left);
        for (index, _) in gone {
            hash.tag(9);
            hash.u64(index);
        }
        if self.is_frozen() {
            hash.tag(1);
        }
        if !self.duplicates().is_empty() {
            hash.tag(3);
            self.duplicates().pairs().for_each(|(a, b, closure)| {
                hash.id(a);
                hash.id(b);
                hash.optional_id(closure);
            });
            hash.list(self.duplicates().compared(), |hash, &closure| hash.id(closure));
        }
        if self.is_adjustment_due() {
            hash.tag(4);
        }
        if !self.place_searches().done.is_empty() {
            hash.tag(5);
            hash.entities(&self.place_searches().done, Hash::place_search);
        }
        hash.finish()
    }

    /// SHA-256 over the content of the map, bit exact and independent of its history: clients by name,
    /// cameras, keyframes, landmarks, constraints, those that are switched off, priors.
    ///
    /// Revisions, epochs and sequences are left out, so that a stream that broke and was resumed
    /// compares equal to one that did not.
    pub fn content_hash(&self) -> [u8; 32] {
        let mut hash = Hash::new();
        hash.list(self.clients(), |hash, client| hash.text(&client.name));
        self.hash_entities(&mut hash, Hash::keyframe_content, Hash::landmark_content);
        for (a, b, _) in self.duplicates().pairs() {
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
        hash.entities(self.cameras(), Hash::camera_entity);
        hash.entities(self.keyframes(), keyframe);
        hash.entities(self.landmarks(), landmark);
        hash.entities(self.constraints(), Hash::constraint);
        hash.entities(self.switched_off(), |hash, SwitchedOff { chi2, weight, is_provisional }| {
            hash.f64(*chi2);
            hash.f64(*weight);
            if *is_provisional {
                hash.tag(1);
            }
        });
        hash.entities(self.priors(), Hash::prior);
        // Earlier versions kept none.
        let images = self.keyframes().iter();
        for (&id, image) in images.filter_map(|(id, k)| Some((id, k.global_descriptor.as_ref()?))) {
            hash.tag(7);
            hash.id(id);
            hash.descriptor(image);
        }
    }

    /// SHA-256 over the ids of all keyframes by client name, then id: the name as text, the id as
    /// eight bytes.
    pub fn keyframe_ids_digest(&self) -> [u8; 32] {
        let name = |id: &EntityId| self.client(id.client).map_or("", |client| &client.name);
        let mut ids: Vec<(&str, i64)> =
            self.keyframes().keys().map(|id| (name(id), id.id)).collect();
        ids.sort_unstable();
        let mut hash = Hash::new();
        for (client, id) in ids {
            hash.text(client);
            hash.i64(id);
        }
        hash.finish()
    }
}
