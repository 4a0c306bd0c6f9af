//! The caller's side of an ingest stream: items in, events out.
//!
//! Sending waits while the engine's queue is full or the events are not read: that is the
//! back-pressure. Before an item is queued, it reserves a [`Permit`] in the stream's event channel
//! for each of its acks, so that the engine never waits for a slow reader and no ack is lost. Items
//! keep the caller's order; the edge checks that sequences increase. `RECEIVED` and `REJECTED`
//! answer one item each, in the order of the items; `DURABLE` and `OPTIMIZED` are cumulative.

use std::sync::Arc;
use std::time::Instant;

use covis_solvers::problem::SolveError;
use tokio::sync::{mpsc, watch};
use tracing::Span;

use super::{EngineError, EngineMeters, MapHandle, SolveCertificate};
use crate::map::{ClientIndex, ConstraintKind, Digest, Item, PartialItem, Rejection};

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

/// An open ingest stream.
#[derive(Debug)]
pub struct IngestStream {
    /// The state from which it starts.
    pub opened: Opened,
    pub(super) sender: ItemSender,
    pub(super) events: mpsc::Receiver<StreamEvent>,
}

impl IngestStream {
    /// The two halves. The receiver ends after [`StreamEvent::End`], or after
    /// [`ItemSender::finish`] once every ack was sent.
    #[must_use]
    pub fn split(self) -> (ItemSender, mpsc::Receiver<StreamEvent>) {
        (self.sender, self.events)
    }
}

/// An entry of the engine's queue.
pub(super) struct Queued {
    pub(super) client: ClientIndex,
    pub(super) epoch: i64,
    /// Span of the call that sent it.
    pub(super) span: Span,
    pub(super) body: Body,
}

pub(super) enum Body {
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

pub(super) struct QueuedItem {
    pub(super) sequence: i64,
    pub(super) digest: Digest,
    pub(super) item: Item,
    pub(super) receipt: Permit,
    /// Present if the store is durable.
    pub(super) durable: Option<Permit>,
    /// Present if the item may start a solve.
    pub(super) optimized: Option<Permit>,
}

/// Whether items of this kind may be followed by an OPTIMIZED ack.
pub(super) fn may_start_solve(item: &Item) -> bool {
    match item {
        Item::Keyframe { .. } | Item::Observations { .. } | Item::Edit(_) => true,
        Item::RelativePose { kind, .. } => *kind == ConstraintKind::LoopClosure,
        Item::PosePrior { .. } | Item::PositionPrior { .. } => true,
        Item::Camera { .. } | Item::Landmarks { .. } => false,
    }
}

/// Room for one event of a stream, reserved for an item.
pub(super) struct Permit {
    room: mpsc::OwnedPermit<StreamEvent>,
    meters: Arc<EngineMeters>,
    /// The item's sequence; 0 if the permit belongs to no item.
    pub(super) sequence: i64,
    /// When the item arrived.
    pub(super) arrived: Instant,
}

impl Permit {
    pub(super) fn new(
        room: mpsc::OwnedPermit<StreamEvent>,
        meters: &Arc<EngineMeters>,
        sequence: i64,
        arrived: Instant,
    ) -> Self {
        Self { room, meters: Arc::clone(meters), sequence, arrived }
    }

    /// Sends the event for which the room was reserved.
    pub(super) fn send(self, event: StreamEvent) {
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
    pub(super) fn is_durable(&self) {
        self.meters.durable_ns.observe_time(self.arrived.elapsed());
    }
}

/// Sends the items of one stream. Dropping it finishes the stream.
#[derive(Debug)]
pub struct ItemSender {
    pub(super) handle: MapHandle,
    pub(super) client: ClientIndex,
    pub(super) epoch: i64,
    pub(super) events: mpsc::Sender<StreamEvent>,
    pub(super) ended: watch::Receiver<Option<EngineError>>,
    pub(super) finished: bool,
}

impl ItemSender {
    /// Queues an item; its acks are events of the stream. `digest` is computed from the item as
    /// received.
    ///
    /// # Errors
    /// Why the stream has ended; [`EngineError::Cancelled`] when the receiver of its events was
    /// dropped.
    pub async fn send(&self, sequence: i64, digest: Digest, item: Item) -> Result<(), EngineError> {
        let arrived = Instant::now();
        let permit = || self.permit(sequence, arrived);
        let receipt = permit().await?;
        let durable = if self.handle.shared.is_durable() { Some(permit().await?) } else { None };
        let optimized = if may_start_solve(&item) { Some(permit().await?) } else { None };
        let item = QueuedItem { sequence, digest, item, receipt, durable, optimized };
        self.queue(Body::Item(Box::new(item))).await
    }

    /// Queues the rejection of an item that could not be converted, so that its ack keeps its
    /// place. The readable part of the item is checked against the map, so that all violations are
    /// reported at once.
    ///
    /// # Errors
    /// As [`ItemSender::send`].
    pub async fn reject(
        &self,
        sequence: i64,
        rejection: Rejection,
        partial: Option<Box<PartialItem>>,
    ) -> Result<(), EngineError> {
        let receipt = self.permit(sequence, Instant::now()).await?;
        self.queue(Body::Rejected { sequence, rejection, partial, receipt }).await
    }

    /// Half-closes the stream: the outstanding acks are sent, including those of solves, then the
    /// events end.
    pub async fn finish(mut self) {
        self.finished = true;
        // A stream that has already ended has reported the reason.
        let _ended = self.queue(Body::Finish).await;
    }

    async fn queue(&self, body: Body) -> Result<(), EngineError> {
        let span = Span::current();
        let queued = Queued { client: self.client, epoch: self.epoch, span, body };
        tokio::select! {
            biased;
            error = self.end() => Err(error),
            sent = self.handle.items.send(queued) => sent.map_err(|_closed| self.handle.end_error()),
        }
    }

    async fn permit(&self, sequence: i64, arrived: Instant) -> Result<Permit, EngineError> {
        tokio::select! {
            biased;
            error = self.end() => Err(error),
            permit = self.events.clone().reserve_owned() => {
                let gone = |_closed| EngineError::Cancelled { map: self.handle.name().to_owned() };
                let meters = &self.handle.shared.meters;
                permit.map_err(gone).map(|room| Permit::new(room, meters, sequence, arrived))
            }
        }
    }

    /// Resolves when the stream has ended.
    async fn end(&self) -> EngineError {
        let mut ended = self.ended.clone();
        let error = ended.wait_for(Option::is_some).await.ok().and_then(|error| error.clone());
        error.unwrap_or_else(|| self.handle.end_error())
    }
}

impl Drop for ItemSender {
    fn drop(&mut self) {
        if self.finished {
            return;
        }
        let (client, epoch, span) = (self.client, self.epoch, Span::none());
        let finish = Queued { client, epoch, span, body: Body::Finish };
        if let Err(mpsc::error::TrySendError::Full(finish)) = self.handle.items.try_send(finish)
            && let Ok(runtime) = tokio::runtime::Handle::try_current()
        {
            let queue = self.handle.items.clone();
            runtime.spawn(async move {
                // A closed queue has no streams left to finish.
                let _closed = queue.send(finish).await;
            });
        }
    }
}
