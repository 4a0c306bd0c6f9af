//! Why an event does not fit the map: a damaged journal or a bug, never a client's bad input.
//!
//! Bad input of a client is a rejection (`rejection.rs`), which is reported before anything is
//! journaled.

use super::{ClientIndex, EntityId};

/// A kind of entity, for messages.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum EntityKind {
    /// A client, named by its position.
    Client,
    /// A camera.
    Camera,
    /// A keyframe.
    Keyframe,
    /// A landmark.
    Landmark,
    /// A constraint or prior.
    Constraint,
    /// An observation, named by its landmark.
    Observation,
}

impl std::fmt::Display for EntityKind {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(match self {
            Self::Client => "client",
            Self::Camera => "camera",
            Self::Keyframe => "keyframe",
            Self::Landmark => "landmark",
            Self::Constraint => "constraint",
            Self::Observation => "observation of landmark",
        })
    }
}

/// An event that does not fit; the map is unchanged.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[allow(missing_docs, reason = "the messages say what the fields are")]
pub enum MapError {
    /// Events are missing, doubled or out of order.
    #[error("the event has revision {actual}, the map needs {expected}")]
    RevisionGap { expected: i64, actual: i64 },
    /// The first event, and no other, creates the map.
    #[error("revision {revision}: a map is created by its first event and by no other")]
    Creation { revision: i64 },
    /// The client has not opened a stream.
    #[error("revision {revision}: client {} does not exist", .client.0)]
    UnknownClient { revision: i64, client: ClientIndex },
    /// An epoch is not newer than the client's last one, or an item's is newer than any opened.
    #[error("revision {revision}: epoch {actual} does not fit the client's epoch {newest}")]
    Epoch { revision: i64, newest: i64, actual: i64 },
    /// The client's sequence is journaled already.
    #[error("revision {revision}: sequence {sequence} of client {} is taken", .client.0)]
    SequenceTaken { revision: i64, client: ClientIndex, sequence: i64 },
    /// The event refers to something that the map does not hold.
    #[error("revision {revision}: {kind} {id} does not exist")]
    Unknown { revision: i64, kind: EntityKind, id: EntityId },
    /// The event gives observations to a keyframe without camera.
    #[error("revision {revision}: keyframe {keyframe} has no camera to observe with")]
    NoCamera { revision: i64, keyframe: EntityId },
    /// The event adds something that the map holds already.
    #[error("revision {revision}: {kind} {id} exists already")]
    Exists { revision: i64, kind: EntityKind, id: EntityId },
    /// The result of a solve would move a keyframe that the map's gauge holds.
    #[error("the gauge holds keyframe {keyframe}, and the result of a solve moves it")]
    GaugeMoved { keyframe: EntityId },
    /// A map from outside holds what no event makes.
    #[error("{kind} {id} {what}")]
    Unsound { kind: EntityKind, id: EntityId, what: &'static str },
    /// A map from outside, or a policy, has what no event makes.
    #[error("{what}")]
    UnsoundMap { what: &'static str },
    /// The event carries a number that is not finite, or not positive where it has to be.
    #[error("revision {revision}: {kind} {id} has an invalid number")]
    ImpossibleNumber { revision: i64, kind: EntityKind, id: EntityId },
}
