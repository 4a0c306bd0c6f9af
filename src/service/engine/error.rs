//! Errors of the engine. A bad item is not an error: its ack rejects it.
//!
//! One value may end many streams and calls, so that the type is `Clone`. The edge assigns status
//! codes.

use std::hash::{BuildHasher, RandomState};

use covis_solvers::problem::SolveError;

use crate::loop_closing::NotAligned;
use crate::map::{MapError, MergeError};
use crate::store::StoreError;

/// A state that a map had.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct PastState {
    /// Its revision.
    pub revision: i64,
    /// When the map came to it, Unix time in nanoseconds by the server's clock.
    pub time_ns: i64,
}

/// A refused call or the end of a stream.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[allow(missing_docs, reason = "the messages say what the fields are")]
pub enum EngineError {
    /// There is no such map, or it was deleted meanwhile.
    #[error("map {map:?} does not exist")]
    MapNotFound { map: String },
    /// A map with this name exists already.
    #[error("map {map:?} exists already")]
    MapExists { map: String },
    /// A change of the map hit a bug: the map can be read and exported, but not changed.
    #[error("map {map:?} is poisoned by an earlier bug: it can be read and takes no changes")]
    Poisoned { map: String },
    /// What was to change the map is not possible, so it is not in the journal: the map is as it was and
    /// takes changes.
    #[error("map {map:?} refuses a change ({change}): {reason}")]
    Refused {
        map: String,
        /// [`Change::name`](crate::map::Change::name).
        change: &'static str,
        reason: String,
    },
    /// The map was frozen by request: it can be read, but not changed.
    #[error("map {map:?} is frozen: it can be read and takes no changes")]
    Frozen { map: String },
    /// The map is becoming part of another one, or was taken out of one: its name soon leads to it.
    #[error("map {map:?} is moving into or out of another map: try again")]
    Moving { map: String },
    /// The map became part of another one.
    #[error("map {map:?} was merged into map {into:?}")]
    MergedAway { map: String, into: String },
    /// A merge that is to be undone was not made, or was undone already.
    #[error("map {source_map:?} is not merged into map {map:?}")]
    NotMerged { map: String, source_map: String },
    /// It is not known where a map lies in the one that is to take it.
    #[error("map {map:?} cannot be aligned with the target: {error}")]
    NotAligned { map: String, error: NotAligned },
    /// The content of a map does not fit the one that is to take it.
    #[error("map {map:?} cannot be merged: {error}")]
    CannotMerge { map: String, error: MergeError },
    /// A constraint is not between keyframes of two maps.
    #[error(
        "keyframes {} of client {:?} and {} of client {:?} do not belong to one map each",
        .keyframe_i.1, .keyframe_i.0, .keyframe_j.1, .keyframe_j.0
    )]
    NoSuchKeyframe {
        /// One of them, by client and id.
        keyframe_i: (String, i64),
        keyframe_j: (String, i64),
    },
    /// The map's policy has no place recognition.
    #[error("map {map:?} recognizes no places: its policy has place_recognition off")]
    NoPlaceRecognition { map: String },
    /// The map holds positions that were converted with the anchor that is to change.
    #[error("map {map:?} holds priors: its geodetic anchor can no longer change")]
    AnchorInUse { map: String },
    /// A change was requested for another revision than the map's.
    #[error("map {map:?} is at revision {actual}, the change is for revision {expected}")]
    RevisionMismatch { map: String, expected: i64, actual: i64 },
    /// The client has a stream with a newer epoch.
    #[error("client {client:?} of map {map:?}: epoch {epoch} is fenced, the newest is {newest}")]
    EpochFenced { map: String, client: String, epoch: i64, newest: i64 },
    /// A number in a request is larger than the largest that is accepted.
    #[error("{field}: at most {maximum} is allowed")]
    TooLarge { field: &'static str, maximum: i64 },
    /// Another optimization runs on the map.
    #[error("another optimization runs on map {map:?}")]
    OptimizationRunning { map: String },
    /// An item would exceed a limit of the map. It was not accepted, but it is not invalid.
    #[error("map {map:?} is full: {limit} is {maximum}")]
    MapLimit {
        map: String,
        /// The limit, as the wire names it.
        limit: &'static str,
        maximum: i64,
    },
    /// A request would exceed a limit of its tenant. It was not done, but it is not invalid.
    #[error("the tenant is full: {limit} is {maximum}")]
    TenantLimit { limit: &'static str, maximum: i64 },
    /// A request would exceed a limit of the server. It was not done, but it is not invalid.
    #[error("the server is full: {limit} is {maximum}")]
    ServerLimit {
        /// The limit, as the wire names it.
        limit: &'static str,
        maximum: i64,
    },
    /// A watcher asks for changes since a revision that the map has not reached.
    #[error("map {map:?} is at revision {newest}, {revision} lies ahead of it")]
    RevisionAhead { map: String, revision: i64, newest: i64 },
    /// A state of a map is asked for that its journal does not keep, or has not reached.
    #[error(
        "map {map:?} can be restored at revisions {} to {}", oldest.revision, newest.revision
    )]
    NotKept {
        map: String,
        /// The field of the request.
        field: &'static str,
        oldest: PastState,
        newest: PastState,
    },
    /// The map's problem cannot be solved as posed.
    #[error("the problem cannot be solved as posed: {0}")]
    Solve(#[from] SolveError),
    /// The map has no factor, or nothing in it may move.
    #[error("map {map:?} holds nothing to solve")]
    NothingToSolve { map: String },
    /// The caller went away; nothing was changed.
    #[error("the caller of map {map:?} disconnected")]
    Cancelled { map: String },
    /// The server accepts no more work.
    #[error("the server is shutting down")]
    ShuttingDown,
    /// The journal refused an operation or failed.
    #[error("the journal: {0}")]
    Store(#[from] StoreError),
    /// A journal cannot be replayed.
    #[error("map {map:?} does not replay: {error}")]
    Journal { map: String, error: MapError },
    /// The solver pool's threads could not be started.
    #[error("{count} solver threads could not be started")]
    Threads { count: usize },
    /// A bug; the log holds the details under this id.
    #[error("a bug was hit, see {id} in the log")]
    Bug { id: String },
}

/// Logs a bug and returns the error that names the entry.
pub(super) fn report_bug(details: &str) -> EngineError {
    // The hasher's keys are random, so that ids tell entries apart, also across restarts.
    let id = format!("{:016x}", RandomState::new().hash_one(details));
    tracing::error!(%id, details, "bug");
    EngineError::Bug { id }
}
