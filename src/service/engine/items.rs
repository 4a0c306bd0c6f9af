//! What the engine does with an item: recall, check, commit, acknowledge, start what it starts.
//!
//! Bad items are answered and the stream lives; a ceiling, a failing journal or a bug ends it.

use std::collections::BTreeMap;
use std::sync::Arc;

use crate::map::{
    Cause, Change, ClientIndex, ConstraintKind, EntityId, Event, Item, Map, Reason, Recall,
    Rejection, triangulate,
};

use super::actor::Actor;
use super::schedule::Task;
use super::stream::{Body, Queued, QueuedItem};
use super::{Ack, AckStatus, EngineError, SolveReport, StreamEvent};

/// What becomes of an item.
enum Verdict {
    /// The map has it already.
    Duplicate,
    Reject(Rejection),
    Take(Box<Change>),
    /// The map is full.
    Full(EngineError),
}

impl Actor {
    /// Takes one thing from the queue.
    pub(super) async fn take(&mut self, queued: Queued) {
        let Queued { client, epoch, body, .. } = queued;
        if !self.streams.is_current(client, epoch) {
            // The stream was told why it ended; its permits go with the item.
            return;
        }
        match body {
            Body::Item(item) => self.ingest(client, epoch, *item).await,
            Body::Rejected { sequence, rejection, receipt } => {
                let status = AckStatus::Rejected(rejection);
                receipt.send(StreamEvent::Ack(Ack { sequence, revision: 0, status }));
            }
            Body::Finish => self.streams.finish(client, epoch),
        }
    }

    async fn ingest(&mut self, client: ClientIndex, epoch: i64, queued: QueuedItem) {
        let QueuedItem { sequence, digest, item, receipt, durable, optimized } = queued;
        let ack = |revision, status| StreamEvent::Ack(Ack { sequence, revision, status });
        match self.judge(client, sequence, &digest, &item) {
            Verdict::Duplicate => {
                let revision = self.map.revision();
                receipt.send(ack(revision, AckStatus::Received { duplicate: true }));
                if let Some(durable) = durable {
                    // It stands at this revision or before it.
                    self.durable.wait(client, sequence, revision, durable);
                }
                if optimized.is_some() {
                    self.streams.keep(client, optimized);
                    self.acknowledge_unsolved(client, sequence);
                }
            }
            Verdict::Reject(rejection) => {
                receipt.send(ack(0, AckStatus::Rejected(rejection)));
            }
            Verdict::Full(error) => self.streams.end(client, |_epoch| error),
            Verdict::Take(change) => {
                let added = added(&change);
                let cause = Cause { client, epoch, sequence, digest };
                let position = match self.commit(Some(cause), *change).await {
                    Ok(position) => position,
                    Err(error) => return self.streams.end(client, |_epoch| error),
                };
                let revision = self.map.revision();
                receipt.send(ack(revision, AckStatus::Received { duplicate: false }));
                match durable {
                    Some(durable) if position.durable => {
                        durable.send(ack(revision, AckStatus::Durable));
                    }
                    Some(durable) => self.durable.wait(client, sequence, revision, durable),
                    None => {}
                }
                self.streams.keep(client, optimized);
                self.start(client, sequence, added).await;
            }
        }
    }

    fn judge(&self, client: ClientIndex, sequence: i64, digest: &[u8; 32], item: &Item) -> Verdict {
        match self.map.recall(client, sequence, digest) {
            Recall::Duplicate => return Verdict::Duplicate,
            Recall::Conflict => {
                let text = format!("sequence {sequence} was taken by another item");
                return Verdict::Reject(Rejection::of("sequence", Reason::AlreadyExists, text));
            }
            Recall::New => {}
        }
        let next = self.map.client(client).map_or(1, |c| c.next_sequence);
        if sequence < next {
            let text = format!("sequence {sequence} was passed over; the next is {next}");
            return Verdict::Reject(Rejection::of("sequence", Reason::OutOfRange, text));
        }
        if self.map.holds(client, item) {
            return Verdict::Duplicate;
        }
        match self.map.check(client, item) {
            Ok(change) => Verdict::Take(Box::new(change)),
            Err(mut rejection) => {
                if rejection.violations.iter().all(|v| v.reason == Reason::Ceiling) {
                    return Verdict::Full(ceiling(&self.shared.name, &self.map, &rejection));
                }
                rejection.violations.retain(|v| v.reason != Reason::Ceiling);
                Verdict::Reject(rejection)
            }
        }
    }

    /// Starts again what a restart cut off.
    pub(super) async fn start_unsolved(&mut self) {
        for Unsolved { client, sequence, added } in std::mem::take(&mut self.unsolved) {
            self.start(client, sequence, added).await;
        }
    }

    /// Starts what a taken item starts.
    async fn start(&mut self, client: ClientIndex, sequence: i64, added: Added) {
        match added {
            Added::Views(keyframe) => {
                let positions = triangulate(&self.map, keyframe);
                if !positions.is_empty() {
                    let change = Change::LandmarksTriangulated { positions };
                    if let Err(error) = self.commit(None, change).await {
                        return self.streams.end(client, |_epoch| error);
                    }
                }
                if self.map.policy().local_bundle {
                    self.schedule.push(client, sequence, Task::Window(keyframe));
                } else {
                    self.acknowledge_unsolved(client, sequence);
                }
            }
            Added::Loop if self.map.policy().loop_closure => {
                self.schedule.push(client, sequence, Task::Loop);
                self.supersede_window();
            }
            Added::Loop => self.acknowledge_unsolved(client, sequence),
            Added::Other => {}
        }
    }

    /// Acknowledges an item that could have started a solve and did not, once no solve for an
    /// earlier item is to come.
    fn acknowledge_unsolved(&mut self, client: ClientIndex, sequence: i64) {
        if let Some(mark) = self.schedule.push_done(client, sequence) {
            let revision = self.map.revision();
            self.streams.optimized(client, mark, revision, 0, SolveReport::Nothing);
        }
    }
}

/// An item that was taken before a restart and whose solve was not applied.
pub(super) struct Unsolved {
    client: ClientIndex,
    sequence: i64,
    added: Added,
}

/// Each client's last item among `events`, those that led to `map`, that started a solve of which
/// the map has no result. In lock-step there can be no other; else its solve covers most of what
/// waited with it.
pub(super) fn unsolved(map: &Map, events: &[Arc<Event>]) -> Vec<Unsolved> {
    let mut last = BTreeMap::new();
    for event in events {
        let Some(Cause { client, sequence, .. }) = event.cause else { continue };
        match added(&event.change) {
            Added::Other => {}
            added @ (Added::Views(_) | Added::Loop) => {
                last.insert(client, Unsolved { client, sequence, added });
            }
        }
    }
    let covered = |client| map.client(client).map_or(0, |c| c.optimized_sequence);
    last.into_values().filter(|u| u.sequence > covered(u.client)).collect()
}

/// What a change adds, as far as solves go.
enum Added {
    /// Observations of this keyframe.
    Views(EntityId),
    Loop,
    Other,
}

fn added(change: &Change) -> Added {
    match change {
        Change::KeyframeAdded { id, .. } => Added::Views(*id),
        Change::ObservationsAdded { keyframe, .. } => Added::Views(*keyframe),
        Change::ConstraintAdded { constraint, .. } => match constraint.kind {
            ConstraintKind::LoopClosure => Added::Loop,
            ConstraintKind::Odometry | ConstraintKind::Other => Added::Other,
        },
        Change::Created { .. }
        | Change::ClientOpened { .. }
        | Change::CameraSet { .. }
        | Change::LandmarksAdded { .. }
        | Change::PriorAdded { .. }
        | Change::LandmarksTriangulated { .. }
        | Change::SolveApplied { .. }
        | Change::ObservationsRemoved { .. }
        | Change::LandmarksFused { .. }
        | Change::LandmarksRemoved { .. }
        | Change::KeyframeRemoved { .. }
        | Change::ConstraintRevoked { .. }
        | Change::PolicySet { .. } => Added::Other,
    }
}

/// Which ceiling a rejection is about, by the field that would pass it.
fn ceiling(map_name: &str, map: &Map, rejection: &Rejection) -> EngineError {
    let ceilings = map.policy().ceilings;
    let field = rejection.violations.first().map_or("", |v| v.field.as_str());
    let (limit, maximum) = match field.rsplit('.').next() {
        Some("landmarks") => ("max_landmark_count", ceilings.max_landmarks),
        Some("observations") => ("max_observation_count", ceilings.max_observations),
        _ => ("max_keyframe_count", ceilings.max_keyframes),
    };
    let maximum = i64::try_from(maximum.unwrap_or(u64::MAX)).unwrap_or(i64::MAX);
    EngineError::Ceiling { map: map_name.to_owned(), limit, maximum }
}
