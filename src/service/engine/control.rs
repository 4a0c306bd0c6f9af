//! Control messages: what a handle asks of the engine, besides items.
//!
//! They have their own channel and overtake queued items, so that a reader never waits behind a busy
//! stream. These are messages only; the actor answers them.

use std::fmt;

use tokio::sync::oneshot;

use super::handle::{MapHandle, MapInfo};
use super::joining::{Joining, Left};
use super::solve::Job;
use super::watch::Past;
use super::{EngineError, IngestStream, Watch};
use crate::map::{EntityId, MapPolicy};

/// A requested change of a map's name, policy or state; what is `None` stays as it is.
#[derive(Default)]
pub struct MapUpdate {
    /// The new free text for people.
    pub display_name: Option<String>,
    /// Computes the new policy from the present one.
    pub policy: Option<PolicyUpdate>,
    /// Whether the map is to be frozen.
    pub frozen: Option<bool>,
    /// The change is made only at this revision.
    pub expected_revision: Option<i64>,
}

/// Computes a policy from the present one.
pub type PolicyUpdate = Box<dyn FnOnce(&MapPolicy) -> MapPolicy + Send>;

impl fmt::Debug for MapUpdate {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { display_name, policy: _, frozen, expected_revision } = self;
        f.debug_struct("MapUpdate")
            .field("display_name", display_name)
            .field("frozen", frozen)
            .field("expected_revision", expected_revision)
            .finish_non_exhaustive()
    }
}

/// Answers a control message.
pub(super) type Reply<T> = oneshot::Sender<T>;

/// Answers a call. A caller that went away needs no answer.
pub(super) fn tell<T>(reply: Reply<T>, answer: T) {
    let _gone = reply.send(answer);
}

/// A request to the engine that is not an item.
pub(super) enum Control {
    Info {
        reply: Reply<MapInfo>,
    },
    Open {
        client: String,
        epoch: i64,
        lock_step: bool,
        handle: MapHandle,
        reply: Reply<Result<IngestStream, EngineError>>,
    },
    Watch {
        from_revision: Option<i64>,
        handle: MapHandle,
        reply: Reply<Result<(Watch, Past), EngineError>>,
    },
    Optimize(Box<Job>),
    Update {
        update: MapUpdate,
        reply: Reply<Result<MapInfo, EngineError>>,
    },
    /// Removes those of the keyframes that are redundant still; the answer counts them.
    RetireRedundant {
        keyframes: Vec<EntityId>,
        share: f64,
        reply: Reply<Result<usize, EngineError>>,
    },
    /// Keeps a snapshot and drops the journal before it.
    DropJournal {
        reply: Reply<Result<(), EngineError>>,
    },
    /// Takes nothing more, because another map is to take its content.
    Hold {
        reply: Reply<Result<MapInfo, EngineError>>,
    },
    /// Takes the content of another map.
    Join {
        joining: Box<Joining>,
        reply: Reply<Result<MapInfo, EngineError>>,
    },
    /// Makes a map of what came with a merge, and lets go of it.
    TakeOut {
        name: String,
        reply: Reply<Result<Left, EngineError>>,
    },
    Delete {
        reply: Reply<Result<(), EngineError>>,
    },
    /// The answer is that the engine drops the reply when it has ended.
    Shutdown {
        reply: Reply<()>,
    },
}
