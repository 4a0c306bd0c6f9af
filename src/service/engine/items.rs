//! How the engine handles an item: recall, check, commit, acknowledge, start its solve.
//!
//! A bad item is rejected and the stream continues; a ceiling, a failing journal or a bug ends it.

use std::collections::BTreeMap;
use std::sync::Arc;

use crate::map::{
    Cause, Change, ClientIndex, ConstraintKind, Counted, EntityId, Event, Item, MAX_NUMBER, Map,
    PartialItem, Reason, Recall, Rejection, Retired, Usage, has_unplaced, retire, triangulate,
};

use super::actor::Actor;
use super::schedule::Task;
use super::stream::{Body, Queued, QueuedItem};
use super::{Ack, AckStatus, EngineError, Resource, SolveReport, StreamEvent};

/// No keyframe is retired for an item if this many of its size would exceed a ceiling.
const LARGEST_SHARE: u64 = 4;

/// The bound of an item's growth is reserved only if there is room for this many times the bound.
const FAR: u64 = 8;

/// Whether the map has room.
pub(super) enum Room {
    There,
    Made,
    None(EngineError),
}

/// The decision about an item.
enum Admission {
    /// It is already journaled under this sequence.
    Duplicate,
    Reject(Rejection),
    Take(Box<Change>),
    /// The map is full.
    Full(EngineError),
}

impl Actor {
    /// Handles one entry of the queue.
    pub(super) async fn take(&mut self, queued: Queued) {
        let Queued { client, epoch, body, .. } = queued;
        if !self.streams.is_current(client, epoch) {
            // The stream was already sent the reason of its end; the permits are dropped with the
            // item.
            return;
        }
        match body {
            Body::Item(item) => self.ingest(client, epoch, *item).await,
            Body::Rejected { sequence, mut rejection, partial, receipt } => {
                if let Some(PartialItem { item, unreadable }) = partial.map(|partial| *partial)
                    && let Err(more) = self.map.check(client, &item)
                {
                    rejection.join(more, &unreadable);
                }
                let status = AckStatus::Rejected(rejection);
                receipt.send(StreamEvent::Ack(Ack { sequence, revision: 0, status }));
            }
            Body::Finish => self.streams.finish(client, epoch),
        }
    }

    async fn ingest(&mut self, client: ClientIndex, epoch: i64, queued: QueuedItem) {
        let QueuedItem { sequence, digest, item, receipt, durable, optimized } = queued;
        let ack = |revision, status| StreamEvent::Ack(Ack { sequence, revision, status });
        let admission = loop {
            match self.admit(client, sequence, &digest, &item) {
                Admission::Take(change) => match self.make_room(&change).await {
                    Room::There => break Admission::Take(change),
                    // Checks again: the item may refer to the keyframe that was retired.
                    Room::Made => {}
                    Room::None(error) => break Admission::Full(error),
                },
                admission @ (Admission::Duplicate | Admission::Reject(_) | Admission::Full(_)) => {
                    break admission;
                }
            }
        };
        match admission {
            Admission::Duplicate => {
                let revision = self.map.revision();
                receipt.send(ack(revision, AckStatus::Received { duplicate: true }));
                if let Some(durable) = durable {
                    // It was journaled at this revision or before it.
                    self.durable.wait(client, sequence, revision, durable);
                }
                if optimized.is_some() {
                    self.streams.keep(client, optimized);
                    self.acknowledge_unsolved(client, sequence);
                }
            }
            Admission::Reject(rejection) => {
                receipt.send(ack(0, AckStatus::Rejected(rejection)));
            }
            Admission::Full(error) => self.streams.end(client, |_epoch| error),
            Admission::Take(change) => {
                let added = added(&change);
                let repeated = *change == Change::ItemRepeated;
                let cause = Cause { client, epoch, sequence, digest };
                let position = match self.commit(Some(cause), *change).await {
                    Ok(position) => position,
                    Err(error) => {
                        self.entities.update(self.map.usage());
                        return self.streams.end(client, |_epoch| error);
                    }
                };
                let revision = self.map.revision();
                receipt.send(ack(revision, AckStatus::Received { duplicate: repeated }));
                match durable {
                    Some(durable) if position.durable => {
                        durable.send(ack(revision, AckStatus::Durable));
                    }
                    Some(durable) => self.durable.wait(client, sequence, revision, durable),
                    None => {}
                }
                let waits = optimized.is_some();
                self.streams.keep(client, optimized);
                if repeated && waits {
                    self.acknowledge_unsolved(client, sequence);
                }
                self.start(client, sequence, added).await;
            }
        }
    }

    fn admit(
        &self,
        client: ClientIndex,
        sequence: i64,
        digest: &[u8; 32],
        item: &Item,
    ) -> Admission {
        match self.map.recall(client, sequence, digest) {
            Recall::Duplicate => return Admission::Duplicate,
            Recall::Conflict => {
                let text = format!("sequence {sequence} was taken by another item");
                return Admission::Reject(Rejection::of("sequence", Reason::AlreadyExists, text));
            }
            Recall::New => {}
        }
        if sequence > MAX_NUMBER {
            let text = format!("{sequence} is above {MAX_NUMBER}: no other could follow it");
            return Admission::Reject(Rejection::of("sequence", Reason::OutOfRange, text));
        }
        let next = self.map.client(client).map_or(1, |c| c.next_sequence);
        if sequence < next {
            let text = format!(
                "sequence {sequence} was passed over or lies too far back; the next is {next}"
            );
            return Admission::Reject(Rejection::of("sequence", Reason::OutOfRange, text));
        }
        if self.map.holds(client, item) {
            return Admission::Take(Box::new(Change::ItemRepeated));
        }
        match self.map.check(client, item) {
            Ok(change) => Admission::Take(Box::new(change)),
            Err(rejection) => Admission::Reject(rejection),
        }
    }

    /// Checks whether there is room for a change. If there is none and the policy says so, retires
    /// one keyframe.
    pub(super) async fn make_room(&mut self, change: &Change) -> Room {
        let account = Arc::clone(&self.shared.account);
        let ceilings = self.map.policy().ceilings.lower(&account.limits().held);
        // A slow disk fills the memory of the server: the limit covers the journals of all maps
        // together.
        if let Err(error) = account.reserve(Resource::JournalBytes, 1) {
            return Room::None(error);
        }
        let usage = self.map.usage();
        let bound = self.map.growth_bound(change);
        // Far from every limit the bound is enough; near a limit it would refuse items that have
        // room.
        let is_far = ceilings.exceeded(usage, bound * FAR).is_none();
        if is_far && self.entities.have_room(bound * FAR) && self.entities.grow(bound).is_ok() {
            return Room::There;
        }
        let growth = self.map.growth(change);
        let Some(exceeded) = ceilings.exceeded(usage, growth) else {
            return match self.entities.grow(growth) {
                Ok(()) => Room::There,
                Err(error) => Room::None(error),
            };
        };
        // A change that would push out a large part of the map is refused: it can only be a
        // mistake.
        let alone = Usage { keyframes: 0, ..growth };
        let is_huge = ceilings.exceeded(alone * (LARGEST_SHARE - 1), alone).is_some();
        if is_huge {
            return Room::None(account.exceeded(exceeded));
        }
        let counted = exceeded.counted;
        let retired = self.compute(move |map| retire(map).filter(|r| frees(map, r, counted)));
        let Some(retired) = retired.await else {
            return Room::None(account.exceeded(exceeded));
        };
        match self.commit(None, Change::KeyframeRetired { retired }).await {
            Ok(_position) => {
                self.shared.meters.retired.increment();
                Room::Made
            }
            Err(error) => Room::None(error),
        }
    }

    /// Starts again the solves that a restart cut off.
    pub(super) async fn start_unsolved(&mut self) {
        for Unsolved { client, sequence, added } in std::mem::take(&mut self.unsolved) {
            self.start(client, sequence, added).await;
        }
    }

    /// Starts the solve that an accepted item triggers.
    async fn start(&mut self, client: ClientIndex, sequence: i64, added: Added) {
        match added {
            Added::Views(keyframe) => {
                let positions = match has_unplaced(&self.map, keyframe) {
                    true => self.compute(move |map| triangulate(map, keyframe)).await,
                    false => Vec::new(),
                };
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

    /// Acknowledges an item that could have started a solve but did not, once no solve for an
    /// earlier item is outstanding.
    fn acknowledge_unsolved(&mut self, client: ClientIndex, sequence: i64) {
        if let Some(mark) = self.schedule.push_done(client, sequence) {
            let revision = self.map.revision();
            self.streams.optimized(client, mark, revision, 0, SolveReport::Nothing);
        }
    }
}

/// An item that was accepted before a restart and whose solve was not applied.
pub(super) struct Unsolved {
    client: ClientIndex,
    sequence: i64,
    added: Added,
}

/// For each client, the last item that started a solve whose result is not in `map`. `events` are
/// those that led to `map`. In lock-step no other item is unsolved; otherwise the solve of the last
/// item covers most of the others.
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

/// What a change adds that can start a solve.
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
            ConstraintKind::Odometry | ConstraintKind::Other | ConstraintKind::Marginal => {
                Added::Other
            }
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
        | Change::KeyframeRetired { .. }
        | Change::ConstraintRevoked { .. }
        | Change::ItemRepeated
        | Change::PolicySet { .. } => Added::Other,
    }
}

/// Whether retiring a keyframe reduces the count that is too high. Clients and cameras stay in the
/// map, and the keyframe may be replaced by more constraints than it had.
fn frees(map: &Map, retired: &Retired, counted: Counted) -> bool {
    let ties = || map.ties().of(retired.keyframe);
    match counted {
        Counted::Clients | Counted::Cameras => false,
        Counted::Constraints => {
            let gone = ties().filter(|id| map.constraints().contains_key(id)).count();
            gone + retired.revoked.len() > retired.constraints.len()
        }
        Counted::Priors => {
            let gone = ties().filter(|id| map.priors().contains_key(id)).count();
            gone > retired.priors.len()
        }
        Counted::Keyframes | Counted::Landmarks | Counted::Observations | Counted::Bytes => true,
    }
}
