//! What a map holds: clients, cameras, keyframes, landmarks, constraints and priors.
//!
//! Poses are `world_from_camera`, positions `point_in_world` in meters, pixels (u, v) with integers
//! at pixel centers. Entities are plain values: the fold in `fold/` is what changes them.

use std::sync::Arc;

use covis_solvers::geometry::{Camera, LieGroup, Se3};
use covis_solvers::information::Information;
use covis_solvers::loss::Loss;
use nalgebra::{Vector2, Vector3};

use super::{EntityId, Noise, Observations, Observers, PendingSolve, SharedMap, numbers};

/// A SHA-256 digest.
pub type Digest = [u8; 32];

/// A frontend that has opened a stream on the map.
#[derive(Clone, Debug, PartialEq)]
pub struct Client {
    /// The name that it gave.
    pub name: String,
    /// Its newest epoch; streams of older epochs are fenced.
    pub epoch: i64,
    /// The last sequence journaled for it, plus 1; 1 for a new client.
    pub next_sequence: i64,
    /// Solves have covered its items up to this sequence; 0 before the first.
    pub optimized_sequence: i64,
    /// The last of its items that asked for a solve, while none has covered it.
    pub pending_solve: Option<PendingSolve>,
    /// By what the covariances that it states for its loop closures are multiplied, at least 1: found
    /// by the last pose graph that judged them.
    pub closure_variance: f64,
    /// How uncertain what it sends is, as the last windows found.
    pub noise: Noise,
    /// Earlier values of [`Keyframe::map_from_odom`] of its newest keyframe from before large corrections,
    /// the last four: start estimates may still be of them.
    pub earlier_frames: Vec<Se3>,
    /// Length in the map of a unit of length as the client sends it, positive. 1, unless its map was made
    /// without a measured length and was scaled when it became part of this one.
    pub scale: f64,
    /// Whether it left with a map that was merged and taken out again. It is then in no list, has nothing in
    /// the map, and keeps its position, because others refer to theirs; opening a stream brings it back.
    pub has_left: bool,
    /// The digests of the last 65,536 journaled items by sequence, kept past optimization.
    pub items: SharedMap<i64, Digest>,
}

/// The largest epoch and sequence that are accepted: a larger one would leave no room for the next.
pub const MAX_NUMBER: i64 = 1 << 62;

impl Client {
    /// A client without items.
    pub(super) fn new(name: &str, epoch: i64) -> Self {
        Self {
            name: name.to_owned(),
            epoch,
            next_sequence: 1,
            optimized_sequence: 0,
            pending_solve: None,
            closure_variance: 1.0,
            noise: Noise::default(),
            earlier_frames: Vec::new(),
            scale: 1.0,
            has_left: false,
            items: SharedMap::default(),
        }
    }

    /// Its newest epoch as far as it fences others: one above [`MAX_NUMBER`], which an earlier version
    /// took, fences none, because no later one could follow it.
    pub fn newest_epoch(&self) -> i64 {
        if self.epoch > MAX_NUMBER { 0 } else { self.epoch }
    }

    /// Forgets sequences above [`MAX_NUMBER`], which an earlier version took and which no later one
    /// could follow, so that the next stream can continue after the last usable one.
    pub(super) fn drop_unusable_sequences(&mut self) {
        if self.next_sequence.saturating_sub(1) <= MAX_NUMBER {
            return;
        }
        while let Some(last) = self.items.last_key_value().map(|(&sequence, _)| sequence)
            && last > MAX_NUMBER
        {
            self.items.remove(&last);
        }
        let last = self.items.last_key_value().map_or(0, |(&sequence, _)| sequence);
        self.next_sequence = last + 1;
        self.optimized_sequence = self.optimized_sequence.min(last);
        self.pending_solve.take_if(|pending| pending.sequence > last);
    }
}

/// A camera with its intrinsics.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CameraEntity {
    /// The projection, current estimate.
    pub camera: Camera,
    /// Width of the image in pixels; 0 where unknown.
    pub width_px: u32,
    /// Height of the image in pixels; 0 where unknown.
    pub height_px: u32,
}

/// How two descriptors are compared. Hashes and journals have the index in this order.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum DescriptorKind {
    /// A string of bits, by Hamming distance.
    Binary,
    /// Little-endian 32-bit floats, by Euclidean distance.
    Float32,
    /// Unsigned bytes, by Euclidean distance.
    Uint8,
}

/// The appearance of a feature; kept for place recognition, not used yet.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Descriptor {
    /// How it is compared.
    pub kind: DescriptorKind,
    /// What made it, for instance "orb".
    pub name: String,
    /// The descriptor itself.
    pub data: Vec<u8>,
}

/// A measured depth along the optical axis.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Depth {
    /// z of the point in the camera's frame, in meters, positive.
    pub depth_m: f64,
    /// Standard deviation in meters, positive.
    pub sigma_m: f64,
}

impl Depth {
    /// Whether it says where a landmark is, and not only that it is ahead: its deviation is less than itself.
    pub fn places(&self) -> bool {
        self.sigma_m < self.depth_m
    }
}

/// A landmark seen at a pixel of a keyframe.
#[derive(Clone, Debug, PartialEq)]
pub struct Observation<Landmark = EntityId> {
    /// The landmark.
    pub landmark: Landmark,
    /// Measured pixel (u, v).
    pub pixel: Vector2<f64>,
    /// Standard deviation of u and of v in pixels, positive.
    pub sigma_px: f64,
    /// Measured depth, where there is one.
    pub depth: Option<Depth>,
    /// What the feature looks like, where the client said.
    pub descriptor: Option<Arc<Descriptor>>,
}

impl<Landmark> Observation<Landmark> {
    /// Whether its numbers can be a measurement: finite, and positive where they have to be.
    pub(super) fn is_possible(&self) -> bool {
        let is_depth = self.depth.as_ref().is_none_or(numbers::is_depth);
        is_depth && numbers::is_positive(self.sigma_px) && numbers::is_finite(&self.pixel)
    }
}

impl Observation {
    /// What makes an observation of a keyframe unique: the landmark and the bits of its pixel. Two
    /// features may match one landmark (structure-from-motion models hold such pairs).
    pub fn key(&self) -> (EntityId, [u64; 2]) {
        (self.landmark, [self.pixel.x.to_bits(), self.pixel.y.to_bits()])
    }
}

/// A captured frame that the map keeps.
#[derive(Clone, Debug, PartialEq)]
pub struct Keyframe {
    /// Middle of the exposure in nanoseconds of the client's clock; orders a client's keyframes.
    pub capture_time_ns: i64,
    /// The camera that captured it; `None` only without observations.
    pub camera: Option<EntityId>,
    /// Current estimate.
    pub world_from_camera: Se3,
    /// The pose in the client's own odometry frame, which no solve moves; the start estimate where
    /// the client sent none. Its lengths are in the map's unit.
    pub odom_from_camera: Se3,
    /// Features seen, in the order of arrival; each [`Observation::key`] once.
    pub observations: Observations,
    /// What the whole image looks like, where the client said.
    pub global_descriptor: Option<Arc<Descriptor>>,
    /// The revision that added it.
    pub added_revision: i64,
}

impl Keyframe {
    /// Where the client's odometry frame lies in the world by this keyframe's current estimate:
    /// `world_from_camera` · `odom_from_camera`⁻¹, both in the map's unit.
    pub fn map_from_odom(&self) -> Se3 {
        self.world_from_camera.compose(&self.odom_from_camera.inverse())
    }

    /// The first observation of `landmark`, if there is one.
    pub fn observation_of(&self, landmark: EntityId) -> Option<&Observation> {
        self.observations.of(landmark)
    }
}

/// A point of the scene.
#[derive(Clone, Debug, PartialEq)]
pub struct Landmark {
    /// `point_in_world`, current estimate in meters; `None` until it is triangulated.
    pub position: Option<Vector3<f64>>,
    /// The position as the client sent it, in its own unit; a landmark sent again must repeat it.
    pub sent_position: Option<Vector3<f64>>,
    /// The keyframe that it moves with until a solve covers it: its first observer.
    pub reference: Option<EntityId>,
    /// The keyframes that see it, sorted.
    pub observers: Observers,
    /// The revision that added it.
    pub added_revision: i64,
    /// The revision that gave it a position, by a client or by triangulation; 0 before.
    pub positioned_revision: i64,
}

/// What a relative pose came from. Hashes and journals have the index in this order.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ConstraintKind {
    /// Tracking from one keyframe to the next.
    Odometry,
    /// A place seen again; starts pose-graph optimization.
    LoopClosure,
    /// Anything else.
    Other,
    /// Information on two keyframes that a removed one left; the server's own, its ids are negative.
    Marginal,
}

/// A measured relative pose between two keyframes.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Constraint {
    /// What it came from.
    pub kind: ConstraintKind,
    /// The keyframe in whose frame the pose was measured.
    pub keyframe_i: EntityId,
    /// The keyframe whose pose was measured; not `keyframe_i`.
    pub keyframe_j: EntityId,
    /// The measurement Z of r = Log(Z⁻¹ · X_i⁻¹ · X_j).
    pub keyframe_i_from_keyframe_j: Se3,
    /// Information of r, translation first.
    pub information: Information<6>,
    /// Its own ρ; `None` takes the policy's.
    pub loss: Option<Loss>,
}

/// Why a loop closure or a position prior does not count: the pose graph found it false. It stays in
/// the map, since a later solve may find that it fits after all.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SwitchedOff {
    /// χ² = rᵀΩr at the solution that it was judged at.
    pub chi2: f64,
    /// Its weight there, from 0 to 1.
    pub weight: f64,
    /// Whether nothing but the odometry speaks against it: no other closure joins its places.
    pub is_provisional: bool,
}

impl Constraint {
    /// Whether its numbers are possible.
    pub(super) fn is_possible(&self) -> bool {
        let loss = self.loss.is_none_or(|loss| loss.is_valid());
        numbers::is_pose(&self.keyframe_i_from_keyframe_j) && loss
    }
}

impl SwitchedOff {
    /// Whether its numbers are finite.
    pub(super) fn is_possible(&self) -> bool {
        self.chi2.is_finite() && self.weight.is_finite()
    }
}

/// A measurement of one keyframe in the world.
#[derive(Clone, Copy, Debug, PartialEq)]
#[allow(clippy::large_enum_variant, reason = "a map has few priors, and plain values stay Copy")]
pub enum Prior {
    /// Of the whole pose, r = Log(Z⁻¹ · X).
    Pose {
        /// The keyframe.
        keyframe: EntityId,
        /// The measurement Z.
        world_from_camera: Se3,
        /// Information of r, translation first.
        information: Information<6>,
        /// Its ρ.
        loss: Loss,
    },
    /// Of the position of a point p fixed to the keyframe, r = X · p − z.
    Position {
        /// The keyframe.
        keyframe: EntityId,
        /// The measurement z in meters.
        position_in_world: Vector3<f64>,
        /// The lever arm p in the keyframe's frame, in meters; 0 is the camera's center.
        point_in_camera: Vector3<f64>,
        /// Information over x, y, z of the world frame, in 1/m².
        information: Information<3>,
        /// Its ρ.
        loss: Loss,
    },
}

impl Prior {
    /// The keyframe that is measured.
    pub fn keyframe(&self) -> EntityId {
        match *self {
            Self::Pose { keyframe, .. } | Self::Position { keyframe, .. } => keyframe,
        }
    }

    /// Whether its numbers are possible.
    pub(super) fn is_possible(&self) -> bool {
        match self {
            Self::Pose { world_from_camera, loss, .. } => {
                numbers::is_pose(world_from_camera) && loss.is_valid()
            }
            Self::Position { position_in_world, point_in_camera, loss, .. } => {
                numbers::is_finite(position_in_world)
                    && numbers::is_finite(point_in_camera)
                    && loss.is_valid()
            }
        }
    }
}
