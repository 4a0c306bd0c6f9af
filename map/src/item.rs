//! What a client sends, already converted from the wire but not yet checked against the map.
//!
//! The conversion checked every number: finite, in range, definite, quaternions normalized. References
//! may dangle: [`Map::check`](super::Map::check) looks them up.

use std::collections::BTreeMap;
use std::sync::Arc;

use covis_solvers::geometry::{Camera, Geodetic, Se3};
use covis_solvers::information::Information;
use covis_solvers::loss::Loss;
use nalgebra::Vector3;

use super::numbers::{is_finite, is_pose, is_valid_camera};
use super::{ConstraintKind, Descriptor, Edit, NewLandmark, Observation};

/// A reference as a client writes it.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct EntityRef {
    /// The owner's name; `None` for the sender.
    pub client: Option<String>,
    /// The owner's id for it.
    pub id: i64,
}

impl EntityRef {
    /// The sender's own entity `id`.
    #[must_use]
    pub fn own(id: i64) -> Self {
        Self { client: None, id }
    }
}

/// An observation as sent.
pub type ItemObservation = Observation<EntityRef>;

/// A landmark as sent; it belongs to the sender.
pub type ItemLandmark = NewLandmark<i64>;

/// A measured position as sent.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum MeasuredPosition {
    /// In the world frame, in meters.
    InWorld(Vector3<f64>),
    /// On the Earth, for a map whose policy says where its world is.
    OnEarth(Geodetic),
}

impl MeasuredPosition {
    /// Whether each number is finite and within its range.
    pub fn is_valid(&self) -> bool {
        match self {
            Self::InWorld(point) => is_finite(point),
            Self::OnEarth(point) => point.is_valid(),
        }
    }
}

/// One item of a stream; what it adds belongs to the sender. An edit may name entities of any client.
#[derive(Clone, Debug, PartialEq)]
pub enum Item {
    /// Adds a camera.
    Camera {
        /// Its id.
        id: i64,
        /// Its projection.
        camera: Camera,
        /// Width of the image in pixels; 0 where unknown.
        width_px: u32,
        /// Height of the image in pixels; 0 where unknown.
        height_px: u32,
    },
    /// Adds a keyframe with its observations and new landmarks: all of it or nothing.
    Keyframe {
        /// Its id.
        id: i64,
        /// Middle of the exposure in nanoseconds by the client's clock.
        capture_time_ns: i64,
        /// The camera that captured it; needed where there are observations.
        camera: Option<EntityRef>,
        /// Start estimate.
        world_from_camera: Se3,
        /// The pose in the client's own odometry frame; `None` where that is the start estimate.
        odom_from_camera: Option<Se3>,
        /// Features seen, at most one a landmark.
        observations: Vec<ItemObservation>,
        /// Landmarks that are new with it.
        landmarks: Vec<ItemLandmark>,
        /// What the whole image looks like, where the client says.
        global_descriptor: Option<Arc<Descriptor>>,
    },
    /// Adds landmarks.
    Landmarks {
        /// At least one.
        landmarks: Vec<ItemLandmark>,
    },
    /// Adds observations to a keyframe that is in the map.
    Observations {
        /// The keyframe.
        keyframe: EntityRef,
        /// At least one, of landmarks that it does not observe yet.
        observations: Vec<ItemObservation>,
    },
    /// Adds a relative-pose constraint.
    RelativePose {
        /// Its id, in one space with the priors.
        id: i64,
        /// What it came from.
        kind: ConstraintKind,
        /// The keyframe in whose frame the pose was measured.
        keyframe_i: EntityRef,
        /// The keyframe whose pose was measured.
        keyframe_j: EntityRef,
        /// The measurement.
        keyframe_i_from_keyframe_j: Se3,
        /// Information, translation first.
        information: Information<6>,
        /// Its own ρ; `None` takes the policy's.
        loss: Option<Loss>,
    },
    /// Adds a prior on a keyframe's pose.
    PosePrior {
        /// Its id, in one space with the constraints.
        id: i64,
        /// The keyframe.
        keyframe: EntityRef,
        /// The measurement.
        world_from_camera: Se3,
        /// Information, translation first.
        information: Information<6>,
        /// Its ρ.
        loss: Loss,
    },
    /// Adds a prior on the position of a point fixed to a keyframe.
    PositionPrior {
        /// Its id, in one space with the constraints.
        id: i64,
        /// The keyframe.
        keyframe: EntityRef,
        /// The measurement.
        position: MeasuredPosition,
        /// The measured point in the keyframe's frame, in meters.
        point_in_camera: Vector3<f64>,
        /// Information over x, y, z of the world frame, in 1/m².
        information: Information<3>,
        /// Its ρ.
        loss: Loss,
    },
    /// Changes or removes what the map holds.
    Edit(Edit),
}

impl Item {
    /// Gives other names to the clients that references name.
    pub fn rename_clients(&mut self, new_names: &BTreeMap<String, String>) {
        let rename = |reference: &mut EntityRef| {
            if let Some(name) = &mut reference.client
                && let Some(new) = new_names.get(name)
            {
                name.clone_from(new);
            }
        };
        match self {
            Self::Camera { .. } | Self::Landmarks { .. } => {}
            Self::Keyframe { camera, observations, .. } => {
                camera.iter_mut().for_each(rename);
                observations.iter_mut().for_each(|seen| rename(&mut seen.landmark));
            }
            Self::Observations { keyframe, observations } => {
                rename(keyframe);
                observations.iter_mut().for_each(|seen| rename(&mut seen.landmark));
            }
            Self::RelativePose { keyframe_i, keyframe_j, .. } => {
                [keyframe_i, keyframe_j].into_iter().for_each(rename);
            }
            Self::PosePrior { keyframe, .. } | Self::PositionPrior { keyframe, .. } => {
                rename(keyframe);
            }
            Self::Edit(edit) => edit.references(rename),
        }
    }
}

impl Item {
    /// Whether each number is finite, and positive where its description says so. Items from the
    /// wire are; this guards a map against programs that make items themselves.
    pub fn has_valid_numbers(&self) -> bool {
        let are_placed = |landmarks: &[ItemLandmark]| {
            landmarks.iter().all(|landmark| landmark.position.as_ref().is_none_or(is_finite))
        };
        let are_measured =
            |observations: &[ItemObservation]| observations.iter().all(Observation::is_possible);
        match self {
            Self::Camera { camera, .. } => is_valid_camera(camera),
            Self::Edit(edit) => edit.camera().is_none_or(|entity| is_valid_camera(&entity.camera)),
            Self::Keyframe {
                world_from_camera, odom_from_camera, observations, landmarks, ..
            } => {
                is_pose(world_from_camera)
                    && odom_from_camera.as_ref().is_none_or(is_pose)
                    && are_measured(observations)
                    && are_placed(landmarks)
            }
            Self::Landmarks { landmarks } => are_placed(landmarks),
            Self::Observations { observations, .. } => are_measured(observations),
            Self::RelativePose { keyframe_i_from_keyframe_j: pose, loss, .. } => {
                is_pose(pose) && loss.is_none_or(|loss| loss.is_valid())
            }
            Self::PosePrior { world_from_camera: pose, loss, .. } => {
                is_pose(pose) && loss.is_valid()
            }
            Self::PositionPrior { position, point_in_camera, loss, .. } => {
                position.is_valid() && is_finite(point_in_camera) && loss.is_valid()
            }
        }
    }
}

/// An item some of whose fields cannot be read; placeholders stand for them: NaN, or a negative id.
#[derive(Clone, Debug, PartialEq)]
pub struct PartialItem {
    /// What can be read of it.
    pub item: Item,
    /// Paths of the fields that a placeholder replaces, and of those that cannot be checked because of
    /// it.
    pub unreadable: Vec<String>,
}
