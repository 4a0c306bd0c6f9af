//! Events: what changed in a map, as values, never as recipes.
//!
//! A map is the fold of its events. Because a solve's event carries the resulting poses and
//! landmarks, replaying a journal runs no solver and gives the same bits on any machine.

use std::sync::Arc;

use covis_solvers::geometry::{Camera, Se3, Sim3};
use nalgebra::Vector3;

use super::{
    CameraEntity, ClientIndex, Comparison, Constraint, Descriptor, Digest, EntityId, MapPolicy,
    Merge, Noise, Observation, PlaceSearch, Prior, SwitchedOff,
};

/// One step of a map.
#[derive(Clone, Debug, PartialEq)]
pub struct Event {
    /// The map's revision after the event: 1 for the first, one more with each.
    pub revision: i64,
    /// Unix time in nanoseconds by the server's clock; 0 where it was not recorded.
    pub time_ns: i64,
    /// The client item that caused it; `None` for the server's own events.
    pub cause: Option<Cause>,
    /// What changed.
    pub change: Change,
}

/// The client item behind an event.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Cause {
    /// The client.
    pub client: ClientIndex,
    /// The epoch of its stream.
    pub epoch: i64,
    /// The item's sequence in the stream, at least 1.
    pub sequence: i64,
    /// Digest of the item as received, by which a re-sent item is recognized.
    pub digest: Digest,
}

/// A landmark as it enters the map.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct NewLandmark<Id = EntityId> {
    /// Its id.
    pub id: Id,
    /// `point_in_world` as it was sent, in the client's unit; `None` where the server is to triangulate it.
    pub position: Option<Vector3<f64>>,
}

impl NewLandmark {
    /// Its position where that was sent in another frame or unit, which `motion` moves.
    pub(super) fn moved_by(&self, motion: Option<&Sim3>) -> Self {
        let moved = |position| motion.map_or(position, |motion| motion.transform(&position));
        Self { position: self.position.map(moved), ..*self }
    }
}

/// Which solve an event carries. Journals have the index in this order.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum SolveKind {
    /// Bundle adjustment of a covisibility window.
    LocalBundle,
    /// Pose-graph optimization; landmarks follow their reference keyframes.
    PoseGraph,
    /// Bundle adjustment of the whole map.
    Global,
}

/// The result of a solve, including the motion of entities that arrived meanwhile.
#[derive(Clone, Debug, PartialEq)]
pub struct AppliedSolve {
    /// Which solve.
    pub kind: SolveKind,
    /// New `world_from_camera` of keyframes.
    pub poses: Vec<(EntityId, Se3)>,
    /// New `point_in_world` of landmarks, in meters.
    pub landmarks: Vec<(EntityId, Vector3<f64>)>,
    /// New intrinsics.
    pub cameras: Vec<(EntityId, Camera)>,
    /// Loop closures that it found false, those too that were switched off before.
    pub switched_off: Vec<(EntityId, SwitchedOff)>,
    /// Loop closures that count again.
    pub switched_on: Vec<EntityId>,
    /// New values of [`Client::closure_variance`](super::Client::closure_variance).
    pub closure_variances: Vec<(ClientIndex, f64)>,
    /// New values of [`Client::noise`](super::Client::noise).
    pub noise: Vec<(ClientIndex, Noise)>,
    /// The clients that it moves far, and their frames before: see
    /// [`Client::earlier_frames`](super::Client::earlier_frames).
    pub left_frames: Vec<(ClientIndex, Se3)>,
    /// Per client the last sequence whose items are covered.
    pub covered: Vec<(ClientIndex, i64)>,
    /// ½ Σ ρ at the start.
    pub initial_cost: f64,
    /// ½ Σ ρ at the end.
    pub final_cost: f64,
    /// What asked for it, where that is to find out later whether its solve was applied.
    pub request: Option<RequestId>,
}

impl AppliedSolve {
    /// The result of a solve of this kind that changes nothing, at no cost.
    #[must_use]
    pub fn unchanged(kind: SolveKind) -> Self {
        Self {
            kind,
            poses: Vec::new(),
            landmarks: Vec::new(),
            cameras: Vec::new(),
            switched_off: Vec::new(),
            switched_on: Vec::new(),
            closure_variances: Vec::new(),
            noise: Vec::new(),
            left_frames: Vec::new(),
            covered: Vec::new(),
            initial_cost: 0.0,
            final_cost: 0.0,
            request: None,
        }
    }
}

/// Names what asked for a solve; random.
pub type RequestId = [u8; 16];

/// The last solve that named its request.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LastRequest {
    /// What asked for it.
    pub id: RequestId,
    /// The revision that holds its result.
    pub revision: i64,
    /// ½ Σ ρ at the start.
    pub initial_cost: f64,
    /// ½ Σ ρ at the end.
    pub final_cost: f64,
}

impl LastRequest {
    /// Of a solve with these costs. Numbers do not hold the cost of some starts: it is infinite then and
    /// never NaN, so that a map equals itself.
    #[must_use]
    pub fn new(id: RequestId, revision: i64, (initial_cost, final_cost): (f64, f64)) -> Self {
        let held = |cost: f64| if cost.is_nan() { f64::INFINITY } else { cost };
        Self { id, revision, initial_cost: held(initial_cost), final_cost: held(final_cost) }
    }
}

/// A keyframe that was removed to make room.
#[derive(Clone, Debug, PartialEq)]
pub struct Retired {
    /// It is removed with its observations, constraints and priors.
    pub keyframe: EntityId,
    /// Landmarks that are removed too, because they have no observers left.
    pub landmarks: Vec<EntityId>,
    /// Constraints and priors that new ones replace.
    pub revoked: Vec<EntityId>,
    /// Its information on its neighbors, [`ConstraintKind::Marginal`](super::ConstraintKind::Marginal).
    pub constraints: Vec<(EntityId, Constraint)>,
    /// Its information on the neighbors' poses in the world.
    pub priors: Vec<(EntityId, Prior)>,
}

impl Change {
    /// Its kind, for messages, logs and metrics.
    #[must_use]
    pub fn name(&self) -> &'static str {
        match self {
            Self::Created { .. } => "created",
            Self::ClientOpened { .. } => "client_opened",
            Self::CameraSet { .. } => "camera_set",
            Self::KeyframeAdded { .. } => "keyframe_added",
            Self::LandmarksAdded { .. } => "landmarks_added",
            Self::ObservationsAdded { .. } => "observations_added",
            Self::ConstraintAdded { .. } => "constraint_added",
            Self::PriorAdded { .. } => "prior_added",
            Self::LandmarksTriangulated { .. } => "landmarks_triangulated",
            Self::SolveApplied { .. } => "solve_applied",
            Self::ObservationsRemoved { .. } => "observations_removed",
            Self::LandmarksFused { .. } => "landmarks_fused",
            Self::DuplicatesFound { .. } => "duplicates_found",
            Self::DuplicatesSplit { .. } => "duplicates_split",
            Self::PlacesSearched { .. } => "places_searched",
            Self::LandmarksRemoved { .. } => "landmarks_removed",
            Self::KeyframeRemoved { .. } => "keyframe_removed",
            Self::KeyframeRetired { .. } => "keyframe_retired",
            Self::ConstraintRevoked { .. } => "constraint_revoked",
            Self::MapMerged { .. } => "map_merged",
            Self::MapTakenOut { .. } => "map_taken_out",
            Self::ItemRepeated => "item_repeated",
            Self::MapUpdated { .. } => "map_updated",
        }
    }

    /// Whether entities change that the event does not name: what a removed keyframe sees, and
    /// duplicates of removed landmarks.
    pub fn changes_others(&self) -> bool {
        matches!(
            self,
            Self::KeyframeRemoved { .. }
                | Self::KeyframeRetired { .. }
                | Self::LandmarksRemoved { .. }
                | Self::LandmarksFused { .. }
                | Self::MapTakenOut { .. }
        )
    }
}

/// What an event changes.
#[derive(Clone, Debug, PartialEq)]
pub enum Change {
    /// The map exists; first event and only there.
    Created {
        /// How it is kept.
        policy: MapPolicy,
        /// Unix time in nanoseconds by the server's clock.
        create_time_ns: i64,
        /// Free text for people.
        display_name: String,
    },
    /// A client opened a stream, for the first time or with a newer epoch.
    ClientOpened {
        /// The client's name.
        name: String,
        /// Newer than its last one.
        epoch: i64,
    },
    /// A camera is new or replaced.
    CameraSet {
        /// Its id.
        id: EntityId,
        /// Its values.
        camera: CameraEntity,
    },
    /// A keyframe is new. Landmarks that the map knows with the same sent position may be repeated.
    KeyframeAdded {
        /// Its id.
        id: EntityId,
        /// See [`Keyframe::capture_time_ns`](super::Keyframe::capture_time_ns).
        capture_time_ns: i64,
        /// The camera that captured it; `None` only without observations.
        camera: Option<EntityId>,
        /// Start estimate as it was sent.
        world_from_camera: Se3,
        /// See [`Keyframe::odom_from_camera`](super::Keyframe::odom_from_camera).
        odom_from_camera: Se3,
        /// Features seen.
        observations: Vec<Observation>,
        /// Landmarks sent with it.
        landmarks: Vec<NewLandmark>,
        /// See [`Keyframe::global_descriptor`](super::Keyframe::global_descriptor).
        global_descriptor: Option<Arc<Descriptor>>,
        /// What moves the start estimate, and the positions of new landmarks, into the client's present
        /// frame and the map's unit; the odometry is scaled with it. `None` where they are of both.
        motion: Option<Sim3>,
    },
    /// Landmarks are new, or repeated as in [`Change::KeyframeAdded`].
    LandmarksAdded {
        /// The landmarks.
        landmarks: Vec<NewLandmark>,
        /// [`Client::scale`](super::Client::scale) of the sender, which scales their positions.
        scale: f64,
    },
    /// A keyframe got more observations.
    ObservationsAdded {
        /// The keyframe.
        keyframe: EntityId,
        /// Of landmarks that it did not observe before.
        observations: Vec<Observation>,
    },
    /// A relative pose was measured.
    ConstraintAdded {
        /// Its id, in one space with priors.
        id: EntityId,
        /// Its values.
        constraint: Constraint,
    },
    /// A keyframe was measured in the world.
    PriorAdded {
        /// Its id, in one space with constraints.
        id: EntityId,
        /// Its values.
        prior: Prior,
    },
    /// Landmarks got their first position.
    LandmarksTriangulated {
        /// `point_in_world` in meters.
        positions: Vec<(EntityId, Vector3<f64>)>,
    },
    /// A solve's result took effect.
    SolveApplied {
        /// The resulting values.
        solve: AppliedSolve,
    },
    /// Observations were removed, each named as (keyframe, landmark).
    ObservationsRemoved {
        /// Which.
        observations: Vec<(EntityId, EntityId)>,
    },
    /// Several landmarks turned out to be one.
    LandmarksFused {
        /// The landmark that receives the observations.
        kept: EntityId,
        /// The landmarks that are removed.
        absorbed: Vec<EntityId>,
    },
    /// The places that loop closures join were compared.
    DuplicatesFound {
        /// What was found of each closure.
        comparisons: Vec<Comparison>,
    },
    /// Closures no longer count: the landmarks of the pairs that they found are apart again.
    DuplicatesSplit {
        /// The closures.
        closures: Vec<EntityId>,
        /// The landmarks of their pairs.
        landmarks: Vec<EntityId>,
    },
    /// The places of keyframes were searched.
    PlacesSearched {
        /// What was found of each keyframe, by id; each keyframe once.
        searches: Vec<(EntityId, PlaceSearch)>,
        /// The loop closures that the searches name, with ids of the server's own.
        closures: Vec<(EntityId, Constraint)>,
    },
    /// Landmarks were removed, with their observations.
    LandmarksRemoved {
        /// Which.
        landmarks: Vec<EntityId>,
    },
    /// A keyframe was removed, with its observations, constraints and priors.
    KeyframeRemoved {
        /// Which.
        keyframe: EntityId,
    },
    /// A full map made room: a keyframe was removed, and its information on others is kept.
    KeyframeRetired {
        /// What was removed, and what replaces it.
        retired: Retired,
    },
    /// A constraint or prior was removed.
    ConstraintRevoked {
        /// Which.
        id: EntityId,
    },
    /// Another map became part of this one.
    MapMerged {
        /// Its content.
        merge: Box<Merge>,
    },
    /// A map that had become part of this one left it: the clients that came with it, with all that is
    /// theirs.
    MapTakenOut {
        /// See [`MergedMap::name`](super::MergedMap::name).
        name: String,
        /// See [`Client::has_left`](super::Client::has_left); `false` in journals of earlier versions, which
        /// kept the clients.
        clients_leave: bool,
    },
    /// An item repeated what the map already holds, under another sequence: only the sequence is new,
    /// so that the client's acknowledged sequences have no gap.
    ItemRepeated,
    /// Name, policy or state changed on request; what is `None` stays as it is.
    MapUpdated {
        /// The new free text for people.
        display_name: Option<String>,
        /// The new policy.
        policy: Option<MapPolicy>,
        /// Whether the map is frozen.
        frozen: Option<bool>,
    },
}
