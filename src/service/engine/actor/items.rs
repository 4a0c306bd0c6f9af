//! What one item goes through: admission, room, the event, its acks, and the solve that it starts.
//!
//! Nothing here waits for a solve or for the disk. A rejected item changes nothing; an item for
//! which there is no room ends its stream.

use crate::map::{
    Affected, Cause, Change, ClientIndex, EntityId, Map, PartialItem, PendingSolve, Reason,
    Rejection, SolveRequest, has_unplaced, retire, triangulate,
};
use crate::service::engine::actor::{Actor, SMALL, STEP};
use crate::service::engine::events::{Body, Queued, QueuedItem};
use crate::service::engine::ingest::{Admission, Ingest, frees, size_of_item};
use crate::service::engine::solving::schedule::Task;
use crate::service::engine::{Ack, AckStatus, EngineError, Fault, SolveReport, StreamEvent};

impl Actor {
    /// Handles one entry of the queue.
    pub(crate) async fn take(&mut self, queued: Queued) {
        let Queued { client, epoch, body, .. } = queued;
        if !self.ingest.is_current(client, epoch) {
            // The stream was already sent the reason of its end; the permits are dropped with the
            // item.
            return;
        }
        match body {
            Body::Item(mut item) => {
                self.ingest.rename(client, &mut item.item);
                self.take_item(client, epoch, *item).await;
            }
            Body::Rejected { sequence, mut rejection, partial, receipt } => {
                if let Some(mut partial) = partial {
                    self.ingest.rename(client, &mut partial.item);
                    let check = move |map: &Map| {
                        let PartialItem { item, unreadable } = *partial;
                        if let Err(more) = map.check(client, &item) {
                            rejection.join(more, &unreadable);
                        }
                        rejection
                    };
                    rejection = self.compute(check).await;
                }
                let status = AckStatus::Rejected(rejection);
                receipt.send(StreamEvent::Ack(Ack { sequence, revision: 0, status }));
            }
            Body::Finish => self.ingest.finish(client, epoch),
        }
    }

    /// Admits an item, commits it, acknowledges it and starts its solve.
    async fn take_item(&mut self, client: ClientIndex, epoch: i64, queued: QueuedItem) {
        let QueuedItem { sequence, digest, mut item, receipt, durable, optimized } = queued;
        let ack = |revision, status| StreamEvent::Ack(Ack { sequence, revision, status });
        let size = size_of_item(&item);
        self.handled += STEP + size;
        let change = loop {
            let admission = if size > SMALL {
                let admit =
                    move |map: &Map| (Ingest::admit(map, client, sequence, &digest, &item), item);
                let admission;
                (admission, item) = self.compute(admit).await;
                admission
            } else {
                Ingest::admit(&self.map, client, sequence, &digest, &item)
            };
            match admission {
                Admission::Take(change) => match self.make_room(&change).await {
                    Ok(true) => break *change,
                    // Checks again: the item may refer to the keyframe that was retired.
                    Ok(false) => {}
                    Err(full) => return self.ingest.end(client, full),
                },
                Admission::Reject(rejection) => {
                    return receipt.send(ack(0, AckStatus::Rejected(rejection)));
                }
                Admission::Duplicate => {
                    let revision = self.map.revision();
                    receipt.send(ack(revision, AckStatus::Received { duplicate: true }));
                    if let Some(durable) = durable {
                        // It was journaled at this revision or before it.
                        self.journal.acknowledge_when_durable(client, sequence, revision, durable);
                    }
                    if optimized.is_some() {
                        self.ingest.keep(client, optimized);
                        self.nothing_to_solve(client, sequence);
                    }
                    return;
                }
            }
        };
        if size > SMALL {
            self.pool.discard(item);
        }
        let duplicate = change == Change::ItemRepeated;
        let cause = Cause { client, epoch, sequence, digest };
        let position = match self.commit(Some(cause), change).await {
            Ok(position) => position,
            Err(EngineError::Refused { reason, .. }) => {
                self.ingest.count(&self.map);
                let rejection = Rejection::of("item", Reason::OutOfRange, reason);
                return receipt.send(ack(0, AckStatus::Rejected(rejection)));
            }
            Err(error) => {
                self.ingest.count(&self.map);
                return self.ingest.end(client, error);
            }
        };
        let revision = self.map.revision();
        receipt.send(ack(revision, AckStatus::Received { duplicate }));
        match durable {
            Some(durable) if position.durable => durable.send(ack(revision, AckStatus::Durable)),
            Some(durable) => {
                self.journal.acknowledge_when_durable(client, sequence, revision, durable)
            }
            None => {}
        }
        let waits = optimized.is_some();
        self.ingest.keep(client, optimized);
        if duplicate && waits {
            self.nothing_to_solve(client, sequence);
        }
        let pending = self.map.client(client).and_then(|client| client.pending_solve.clone());
        if let Some(pending) = pending.filter(|pending| pending.sequence == sequence) {
            self.trigger(client, pending).await;
        }
    }

    /// Reserves room for a change. If the map is full and the policy says so, retires one keyframe;
    /// the answer is then `false`, and the change must be checked again.
    ///
    /// # Errors
    /// Why there is no room.
    pub(crate) async fn make_room(&mut self, change: &Change) -> Result<bool, EngineError> {
        let Some(exceeded) = self.ingest.reserve(&self.map, change)? else { return Ok(true) };
        let counted = exceeded.counted;
        let panics = self.shared.config.injects(Fault::PanicInRetirement);
        let retired = self.attempt(move |map| {
            if panics {
                std::panic::panic_any("staged by a test");
            }
            retire(map).filter(|retired| frees(map, retired, counted))
        });
        let Some(retired) = retired.await? else {
            return Err(self.shared.account.exceeded(exceeded));
        };
        self.commit(None, Change::KeyframeRetired { retired }).await?;
        self.shared.meters.retired.increment();
        Ok(false)
    }

    /// Starts the solve that an accepted item triggers.
    pub(crate) async fn trigger(&mut self, client: ClientIndex, pending: PendingSolve) {
        let PendingSolve { sequence, request } = pending;
        let policy = self.map.policy();
        let (local_bundle, loop_closure) = (policy.local_bundle, policy.loop_closure);
        let is_closure = request == SolveRequest::LoopClosure;
        let (graph, window, seen) = match request {
            // Without views nothing measures a keyframe but odometry, which has put it there.
            SolveRequest::Views(id) => {
                let sees = self.map.sees(id);
                (None, (local_bundle && sees).then(|| Task::around(id)), Some(id))
            }
            SolveRequest::LoopClosure => (loop_closure.then_some(Task::Loop), None, None),
            SolveRequest::Prior => (loop_closure.then_some(Task::Prior), None, None),
            SolveRequest::Edited(Affected { graph, keyframes }) => {
                let newest = keyframes.last().copied();
                let windows = local_bundle && !keyframes.is_empty();
                let window = windows.then(|| Task::Window(keyframes.into()));
                ((graph && loop_closure).then_some(Task::Loop), window, newest)
            }
        };
        if let Some(id) = seen
            && let Err(error) = self.triangulate_landmarks(id).await
        {
            return self.ingest.end(client, error);
        }
        if graph.is_none() && window.is_none() {
            return self.nothing_to_solve(client, sequence);
        }
        if graph.is_some() && !is_closure {
            self.solving.ask_for_motion();
        }
        for task in graph.into_iter().chain(window) {
            self.solving.schedule.push(client, sequence, task);
        }
    }

    /// Starts a pose graph for closures that no client waits for.
    pub(crate) async fn trigger_own_closures(&mut self) {
        let (sequence, request) = (self.map.revision(), SolveRequest::LoopClosure);
        self.trigger(ClientIndex::SERVER, PendingSolve { sequence, request }).await;
    }

    /// Triangulates landmarks of a keyframe that have no position, if that is possible now.
    ///
    /// # Errors
    /// As [`Actor::commit`].
    async fn triangulate_landmarks(&mut self, id: EntityId) -> Result<(), EngineError> {
        let seen = self.map.keyframes().get(&id).map_or(0, |k| k.observations.len());
        let positions = match seen > SMALL || has_unplaced(&self.map, id) {
            // Without them the landmarks stay without positions.
            true => self.attempt(move |map| triangulate(map, id)).await.unwrap_or_default(),
            false => Vec::new(),
        };
        if positions.is_empty() {
            return Ok(());
        }
        match self.commit(None, Change::LandmarksTriangulated { positions }).await {
            // The landmarks stay without positions.
            Ok(_) | Err(EngineError::Refused { .. }) => Ok(()),
            Err(error) => Err(error),
        }
    }

    /// Acknowledges an item that could have started a solve but did not, once no solve for an
    /// earlier item is outstanding.
    fn nothing_to_solve(&mut self, client: ClientIndex, sequence: i64) {
        let mark = self.solving.schedule.push_done(client, sequence);
        let marks = mark.map(|mark| (client, mark, self.solving.schedule.is_waiting(client)));
        self.ingest.acknowledge_optimized(marks, self.map.revision(), 0, &SolveReport::Nothing);
    }
}
