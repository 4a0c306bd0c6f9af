//! The entries of the engine's queue, and the events that answer them.
//!
//! Before an item is queued, it reserves a [`Permit`] in the stream's event channel for each of its acks, so that
//! the engine never waits for a slow reader and no ack is lost. `RECEIVED` and `REJECTED` answer one item each, in
//! the order of the items; `DURABLE` and `OPTIMIZED` are cumulative.

use std::sync::Arc;
use std::time::Instant;

use covis_solvers::problem::SolveError;
use tokio::sync::mpsc;
use tracing::Span;

use crate::map::{ClientIndex, ConstraintKind, Digest, Item, PartialItem, Rejection};
use crate::service::engine::{EngineError, EngineMeters, SolveCertificate};

/// One event of an ingest stream.
#[derive(Clone, Debug)]
pub enum StreamEvent {
    /// An acknowledgment.
    Ack(Ack),
    /// The stream has ended; no event follows. A stream that its client finished ends without this
    /// event.
    End(EngineError),
}

/// An acknowledgment.
#[derive(Clone, Debug)]
pub struct Ack {
    /// The item's sequence; for cumulative statuses, the last sequence that is covered.
    pub sequence: i64,
    /// Revision of the map that contains the item's effect; 0 when rejected.
    pub revision: i64,
    /// The stage that the item has reached.
    pub status: AckStatus,
}

/// The stage that an item has reached.
#[derive(Clone, Debug)]
pub enum AckStatus {
    /// Checked, journaled, applied.
    Received {
        /// The map already had the same item; nothing changed.
        duplicate: bool,
    },
    /// Every accepted item up to the sequence is on stable storage.
    Durable,
    /// Solves have covered every accepted item up to the sequence.
    Optimized {
        /// The solve, counted from 1 in each map; 0 when there was nothing to solve.
        solve_id: i64,
        /// What it did.
        outcome: SolveReport,
    },
    /// Refused permanently; nothing changed.
    Rejected(Rejection),
}

/// What the solve behind an ack did.
#[derive(Clone, Debug)]
pub enum SolveReport {
    /// There was nothing to solve.
    Nothing,
    /// It ran; the certificate says how it ended.
    Solved(Arc<SolveCertificate>),
    /// The problem could not be solved as posed; the map keeps its estimates.
    Failed {
        /// Names the variable or factor.
        error: SolveError,
    },
    /// It hit a bug; the map keeps its estimates.
    Lost {
        /// With the id under which it was reported.
        bug: EngineError,
    },
    /// It ran, and its result is not possible; the map keeps its estimates.
    Refused {
        /// Names the entity.
        reason: String,
    },
}

/// The state from which an opened stream starts.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Opened {
    /// The client in the map.
    pub client: ClientIndex,
    /// The last sequence journaled for the client, plus 1.
    pub next_sequence: i64,
    /// Solves have covered every accepted item of the client up to this sequence; 0 if there is
    /// none.
    pub optimized_sequence: i64,
    /// The stream's epoch.
    pub epoch: i64,
    /// The map's revision.
    pub revision: i64,
    /// Whether the stream is in lock-step.
    pub lock_step: bool,
}

/// An entry of the engine's queue.
pub(crate) struct Queued {
    pub(crate) client: ClientIndex,
    pub(crate) epoch: i64,
    /// Span of the call that sent it.
    pub(crate) span: Span,
    pub(crate) body: Body,
}

pub(crate) enum Body {
    Item(Box<QueuedItem>),
    /// The edge could not convert it.
    Rejected {
        sequence: i64,
        rejection: Rejection,
        /// The readable part of the item, to be checked against the map.
        partial: Option<Box<PartialItem>>,
        receipt: Permit,
    },
    Finish,
}

pub(crate) struct QueuedItem {
    pub(crate) sequence: i64,
    pub(crate) digest: Digest,
    pub(crate) item: Item,
    pub(crate) receipt: Permit,
    /// Present if the store is durable.
    pub(crate) durable: Option<Permit>,
    /// Present if the item may start a solve.
    pub(crate) optimized: Option<Permit>,
}

/// Whether items of this kind may be followed by an OPTIMIZED ack.
pub(crate) fn may_start_solve(item: &Item) -> bool {
    match item {
        Item::Keyframe { .. } | Item::Observations { .. } | Item::Edit(_) => true,
        Item::RelativePose { kind, .. } => *kind == ConstraintKind::LoopClosure,
        Item::PosePrior { .. } | Item::PositionPrior { .. } => true,
        Item::Camera { .. } | Item::Landmarks { .. } => false,
    }
}

/// Room for one event of a stream, reserved for an item.
pub(crate) struct Permit {
    room: mpsc::OwnedPermit<StreamEvent>,
    meters: Arc<EngineMeters>,
    /// The item's sequence; 0 if the permit belongs to no item.
    pub(crate) sequence: i64,
    /// When the item arrived.
    pub(crate) arrived: Instant,
}

impl Permit {
    pub(crate) fn new(
        room: mpsc::OwnedPermit<StreamEvent>,
        meters: &Arc<EngineMeters>,
        sequence: i64,
        arrived: Instant,
    ) -> Self {
        Self { room, meters: Arc::clone(meters), sequence, arrived }
    }

    /// Sends the event for which the room was reserved.
    pub(crate) fn send(self, event: StreamEvent) {
        let meters = &self.meters;
        match &event {
            StreamEvent::Ack(ack) => match &ack.status {
                AckStatus::Received { duplicate: false } => meters.received.increment(),
                AckStatus::Received { duplicate: true } => meters.duplicate.increment(),
                AckStatus::Rejected(rejection) => {
                    let first = rejection.violations.first();
                    first.into_iter().for_each(|violation| meters.reject(violation.reason));
                }
                AckStatus::Durable | AckStatus::Optimized { .. } => {}
            },
            StreamEvent::End(
                EngineError::MapLimit { .. }
                | EngineError::TenantLimit { .. }
                | EngineError::ServerLimit { .. },
            ) => {
                meters.at_limit.increment();
            }
            StreamEvent::End(_) => {}
        }
        self.room.send(event);
    }

    /// Measures how long the item took to become durable.
    pub(crate) fn is_durable(&self) {
        self.meters.durable_ns.observe_time(self.arrived.elapsed());
    }
}
