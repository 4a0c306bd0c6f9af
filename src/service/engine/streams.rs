//! The engine's side of ingest streams: which stream may write, and the room for outstanding acks.
//!
//! Before an item is queued, it reserves a permit in the stream's event channel for each of its
//! acks, so that the engine never waits for a slow reader and no ack is lost. A client that does
//! not read its events runs out of permits and has to wait. A client has at most one open stream:
//! the one with the newest epoch.

use std::collections::{BTreeMap, VecDeque};
use std::sync::Arc;
use std::time::Instant;

use tokio::sync::{mpsc, watch};

use super::{Ack, AckStatus, EngineError, EngineMeters, Reservation, SolveReport, StreamEvent};
use crate::map::ClientIndex;
use crate::meter::Held;

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
                EngineError::Ceiling { .. }
                | EngineError::TenantCeiling { .. }
                | EngineError::ServerCeiling { .. },
            ) => {
                meters.ceiling.increment();
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

/// Permits for OPTIMIZED acks that a stream keeps. Solves coalesce, so that at most this many acks
/// are outstanding: of the running solve, of those that wait, and of an earlier stream.
const OPTIMIZED_PERMITS: usize = 4;

/// Events beyond those of queued items: the end, and [`OPTIMIZED_PERMITS`].
const EXTRA_EVENTS: usize = 1 + OPTIMIZED_PERMITS;

/// Most items of a stream whose time to OPTIMIZED is measured at once.
const MEASURED_ITEMS: usize = 1024;

/// Events that one queued item may have: RECEIVED or REJECTED, DURABLE, OPTIMIZED.
const EVENTS_PER_ITEM: usize = 3;

struct Stream {
    /// Dropped before the caller learns of the end.
    _open: Held,
    epoch: i64,
    lock_step: bool,
    finishing: bool,
    end: Option<Permit>,
    optimized: Vec<Permit>,
    /// Sequence and arrival of items whose OPTIMIZED ack is outstanding, at most
    /// [`MEASURED_ITEMS`].
    waiting: VecDeque<(i64, Instant)>,
    ended: watch::Sender<Option<EngineError>>,
    _place: Reservation,
}

/// The ends of the channels that the caller's side of a stream gets.
pub(super) struct StreamEnds {
    pub(super) sender: mpsc::Sender<StreamEvent>,
    pub(super) events: mpsc::Receiver<StreamEvent>,
    pub(super) ended: watch::Receiver<Option<EngineError>>,
}

/// The open streams of a map.
#[derive(Default)]
pub(super) struct Streams(BTreeMap<ClientIndex, Stream>);

impl Streams {
    /// Opens a stream; the caller has ended the client's older one.
    pub(super) fn open(
        &mut self,
        client: ClientIndex,
        epoch: i64,
        lock_step: bool,
        queued_items: usize,
        place: Reservation,
        meters: &Arc<EngineMeters>,
    ) -> StreamEnds {
        let capacity = queued_items.max(1) * EVENTS_PER_ITEM + EXTRA_EVENTS;
        let (sender, events) = mpsc::channel(capacity);
        let (ended_sender, ended) = watch::channel(None);
        let now = Instant::now();
        let permit = || {
            let room = sender.clone().try_reserve_owned().ok();
            room.map(|room| Permit::new(room, meters, 0, now))
        };
        let stream = Stream {
            epoch,
            lock_step,
            finishing: false,
            end: permit(),
            optimized: permit().into_iter().collect(),
            waiting: VecDeque::new(),
            _open: meters.streams.hold(),
            ended: ended_sender,
            _place: place,
        };
        self.0.insert(client, stream);
        StreamEnds { sender, events, ended }
    }

    /// Whether the stream may write.
    pub(super) fn is_current(&self, client: ClientIndex, epoch: i64) -> bool {
        self.0.get(&client).is_some_and(|s| s.epoch == epoch && !s.finishing)
    }

    /// Whether one of the streams is in lock-step.
    pub(super) fn any_lock_step(&self) -> bool {
        self.0.values().any(|s| s.lock_step)
    }

    /// Keeps room for an OPTIMIZED ack.
    pub(super) fn keep(&mut self, client: ClientIndex, permit: Option<Permit>) {
        if let (Some(stream), Some(permit)) = (self.0.get_mut(&client), permit) {
            if stream.waiting.len() < MEASURED_ITEMS {
                stream.waiting.push_back((permit.sequence, permit.arrived));
            }
            if stream.optimized.len() < OPTIMIZED_PERMITS {
                stream.optimized.push(permit);
            }
        }
    }

    /// Sends an OPTIMIZED ack, if the client has a stream.
    pub(super) fn optimized(
        &mut self,
        client: ClientIndex,
        sequence: i64,
        revision: i64,
        solve_id: i64,
        outcome: SolveReport,
    ) {
        let Some(stream) = self.0.get_mut(&client) else { return };
        match stream.optimized.pop() {
            Some(permit) => {
                while let Some((_, arrived)) = stream.waiting.pop_front_if(|w| w.0 <= sequence) {
                    permit.meters.optimized_ns.observe_time(arrived.elapsed());
                }
                let status = AckStatus::Optimized { solve_id, outcome };
                permit.send(StreamEvent::Ack(Ack { sequence, revision, status }));
            }
            None => tracing::warn!(sequence, "no room for an OPTIMIZED ack"),
        }
    }

    /// Marks that the client sends no more; the stream closes once no ack is outstanding.
    pub(super) fn finish(&mut self, client: ClientIndex, epoch: i64) {
        if let Some(stream) = self.0.get_mut(&client).filter(|s| s.epoch == epoch) {
            stream.finishing = true;
        }
    }

    /// Closes the finished streams whose clients do not wait for acks.
    pub(super) fn close_finished(&mut self, is_waiting: impl Fn(ClientIndex) -> bool) {
        self.0.retain(|&client, stream| !stream.finishing || is_waiting(client));
    }

    /// Ends a client's stream, if there is one.
    pub(super) fn end(&mut self, client: ClientIndex, error: impl FnOnce(i64) -> EngineError) {
        if let Some(stream) = self.0.remove(&client) {
            let error = error(stream.epoch);
            if let Some(permit) = stream.end {
                permit.send(StreamEvent::End(error.clone()));
            }
            stream.ended.send_replace(Some(error));
        }
    }

    /// Ends all streams.
    pub(super) fn end_all(&mut self, error: &EngineError) {
        let clients: Vec<ClientIndex> = self.0.keys().copied().collect();
        clients.into_iter().for_each(|client| self.end(client, |_epoch| error.clone()));
    }
}
