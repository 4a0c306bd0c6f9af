//! The task that owns a map: its loop, and its answers to control messages.
//!
//! Each step handles one of these, in this order of priority: a control message, the end of the
//! running solve, progress of the journal, an item. After a control message, the others have
//! priority for one step, so that constant requests of readers cannot block writers. Steps run
//! under `catch_unwind`: a panic poisons only this map. In lock-step the task accepts no item while
//! a solve runs or waits.

use std::hash::{BuildHasher, RandomState};
use std::panic::AssertUnwindSafe;
use std::sync::Arc;

use futures_util::FutureExt;
use tokio::sync::mpsc;
use tracing::Instrument;

use super::account::HeldEntities;
use super::durable::{DurableAcks, Snapshots};
use super::handle::{Control, Reply, Shared};
use super::history::Past;
use super::items::{Room, Unsolved};
use super::optimize::Job;
use super::pool::panic_message;
use super::schedule::Schedule;
use super::solves::Running;
use super::stream::{ItemSender, Queued};
use super::streams::Streams;
use super::watch::Watchers;
use super::{
    EngineConfig, EngineError, IngestStream, MapHandle, MapInfo, MapState, Opened, Reservation,
    Resource, SolverPool, Watch,
};
use crate::map::{Change, Client, MAX_NUMBER, Map};
use crate::store::{Durability, Epoch, Store};

/// A map and its only writer.
pub(super) struct Actor {
    pub(super) shared: Arc<Shared>,
    pub(super) config: EngineConfig,
    pub(super) store: Arc<dyn Store>,
    pub(super) pool: Arc<SolverPool>,
    /// Counts the map in the account of its tenant until it is dropped.
    pub(super) _place: Reservation,
    /// The map's entities, as its accounts count them.
    pub(super) entities: HeldEntities,
    /// Bytes of its journal that wait for the disk.
    pub(super) journal: Reservation,
    /// The store's epoch, which fences other writers.
    pub(super) store_epoch: Epoch,
    pub(super) map: Arc<Map>,
    pub(super) state: MapState,
    /// Why the map accepts no changes, if the reason is not a bug.
    pub(super) refusal: Option<EngineError>,
    pub(super) durable: DurableAcks,
    pub(super) snapshots: Snapshots,
    /// The revision before the event that is being applied. While it is set, a panic may leave an
    /// event half applied.
    pub(super) applying: Option<i64>,
    pub(super) items: mpsc::Receiver<Queued>,
    pub(super) control: mpsc::Receiver<Control>,
    pub(super) streams: Streams,
    pub(super) watchers: Watchers,
    pub(super) schedule: Schedule,
    pub(super) running: Option<Running>,
    /// The optimization that waits or runs.
    pub(super) job: Option<Job>,
    pub(super) last_solve_id: i64,
    /// Items whose solves were cut off by a restart.
    pub(super) unsolved: Vec<Unsolved>,
    /// Whether the queue is closed and empty.
    pub(super) drained: bool,
    /// Whether the last step answered a control message.
    pub(super) answered: bool,
    /// Replies that are dropped when the engine ends. Not empty once it was asked to stop.
    pub(super) closing: Vec<Reply<()>>,
}

/// Whether the task continues.
pub(super) enum Flow {
    Continue,
    Stop,
}

impl Actor {
    /// Runs until the map is deleted or the server shuts down.
    pub(super) async fn run(mut self) {
        loop {
            match AssertUnwindSafe(self.step()).catch_unwind().await {
                Ok(Flow::Continue) => {}
                Ok(Flow::Stop) => break,
                Err(panic) => {
                    self.shared.meters.engine_panics.increment();
                    self.poison(&panic_message(panic.as_ref())).await;
                }
            }
            self.shared.condition.put(self.state, self.refusal.is_some());
            if !self.closing.is_empty() && self.drained && self.is_settled() {
                break;
            }
        }
        let error = self.shared.ended.get_or_init(|| EngineError::ShuttingDown).clone();
        self.cancel_solves(&error);
        self.streams.end_all(&error);
    }

    /// Whether no solve runs or waits.
    fn is_idle(&self) -> bool {
        self.running.is_none() && self.schedule.is_empty() && self.job.is_none()
    }

    /// Whether no solve and no DURABLE ack is outstanding.
    fn is_settled(&self) -> bool {
        self.is_idle() && self.durable.is_empty()
    }

    /// Whether items wait for solves.
    pub(super) fn is_lock_step(&self) -> bool {
        self.config.lock_step || self.streams.any_lock_step()
    }

    async fn step(&mut self) -> Flow {
        if !self.unsolved.is_empty() {
            self.start_unsolved().await;
            self.start_solves().await;
        }
        let takes_items = !self.drained && (self.is_idle() || !self.is_lock_step());
        let answered = std::mem::take(&mut self.answered);
        let flow = tokio::select! {
            biased;
            control = self.control.recv(), if !answered => match control {
                Some(control) => self.answer(control).await,
                None => Flow::Stop,
            },
            outcome = Running::ended(&mut self.running) => {
                self.solved(outcome).await;
                Flow::Continue
            }
            () = self.durable.progress() => {
                self.flushed();
                Flow::Continue
            }
            item = self.items.recv(), if takes_items => {
                match item {
                    Some(item) => {
                        let parent = &item.span;
                        let span = tracing::debug_span!(parent: parent, "item", map = %self.shared.name);
                        self.take(item).instrument(span).await;
                    }
                    None => self.drained = true,
                }
                Flow::Continue
            }
            // Nothing else is ready: the next step may answer a control message again.
            () = std::future::ready(()), if answered => Flow::Continue,
        };
        self.start_solves().await;
        self.streams.close_finished(|client| self.schedule.is_waiting(client));
        flow
    }

    /// Computes something from the map on another thread. The engine awaits the result; its thread
    /// is not blocked.
    pub(super) async fn compute<R: Send + 'static>(
        &self,
        work: impl FnOnce(&Map) -> R + Send + 'static,
    ) -> R {
        let map = Arc::clone(&self.map);
        let work = move || {
            let result = work(&map);
            // Dropped before the answer: the next change would copy a map that is shared.
            drop(map);
            result
        };
        self.pool.compute(work).await
    }

    async fn answer(&mut self, control: Control) -> Flow {
        self.answered = true;
        // A caller that went away needs no answer, so that failed sends are ignored.
        match control {
            Control::Info { reply } => {
                let _gone = reply.send(self.info());
            }
            Control::Open { client, epoch, lock_step, handle, reply } => {
                let _gone = reply.send(self.open_stream(client, epoch, lock_step, handle).await);
            }
            Control::Watch { from_revision, handle, reply } => {
                let _gone = reply.send(self.watch(from_revision, handle));
            }
            Control::Optimize(job) => self.optimize(*job),
            Control::Delete { reply } => {
                let name = &self.shared.name;
                let deleted = self.store.delete_map(name).await;
                let stop = deleted.is_ok();
                if stop {
                    let map = name.clone();
                    self.shared.ended.get_or_init(|| EngineError::MapNotFound { map });
                }
                let _gone = reply.send(deleted.map_err(EngineError::Store));
                if stop {
                    return Flow::Stop;
                }
            }
            Control::Shutdown { reply } => {
                self.items.close();
                self.closing.push(reply);
            }
        }
        Flow::Continue
    }

    fn info(&self) -> MapInfo {
        MapInfo {
            name: self.shared.name.clone(),
            uid: self.shared.uid.clone(),
            snapshot: Arc::clone(&self.map),
            state: self.state,
        }
    }

    /// Refuses changes to a poisoned or ending map.
    pub(super) fn check_open(&self) -> Result<(), EngineError> {
        if !self.closing.is_empty() {
            return Err(EngineError::ShuttingDown);
        }
        match self.state {
            MapState::Open => Ok(()),
            MapState::Poisoned => Err(self
                .refusal
                .clone()
                .unwrap_or_else(|| EngineError::Poisoned { map: self.shared.name.clone() })),
        }
    }

    async fn open_stream(
        &mut self,
        name: String,
        epoch: i64,
        lock_step: bool,
        handle: MapHandle,
    ) -> Result<IngestStream, EngineError> {
        self.check_open()?;
        if epoch > MAX_NUMBER {
            return Err(EngineError::TooLarge { field: "open.epoch", maximum: MAX_NUMBER });
        }
        let place = self.shared.account.reserve(Resource::Streams, 1)?;
        let known = self.map.client_named(&name);
        let newest = known.and_then(|c| self.map.client(c)).map_or(0, Client::newest_epoch);
        let map = self.shared.name.clone();
        let fenced = |epoch: i64, newest: i64| EngineError::EpochFenced {
            map: map.clone(),
            client: name.clone(),
            epoch,
            newest,
        };
        let next = newest.saturating_add(1);
        let epoch = if epoch == 0 { next } else { epoch };
        if epoch <= newest {
            return Err(fenced(epoch, newest));
        }
        let older = |older: i64| fenced(older, epoch);
        let opening = Change::ClientOpened { name: name.clone(), epoch };
        loop {
            match self.make_room(&opening).await {
                Room::There => break,
                Room::Made => {}
                Room::None(error) => return Err(error),
            }
        }
        if let Some(client) = known {
            self.streams.end(client, older);
        }
        if let Err(error) = self.commit(None, opening).await {
            self.entities.update(self.map.usage());
            return Err(error);
        }
        let Some(client) = self.map.client_named(&name) else {
            return Err(report_bug("an opened client is not in the map"));
        };
        tracing::debug!(client = name, epoch, "stream opened");
        let lock_step = lock_step || self.config.lock_step;
        let most = self.map.policy().max_queued_items.map_or(usize::MAX, |most| most as usize);
        let (room, meters) = (self.config.queue_capacity.min(most), &self.shared.meters);
        let ends = self.streams.open(client, epoch, lock_step, room, place, meters);
        let next_sequence = self.map.client(client).map_or(1, |c| c.next_sequence);
        let opened = Opened {
            client,
            next_sequence,
            optimized_sequence: self.schedule.first_open(client).unwrap_or(next_sequence) - 1,
            epoch,
            revision: self.map.revision(),
            lock_step,
        };
        let sender = ItemSender {
            queue: handle.items.clone(),
            handle,
            client,
            epoch,
            durable: self.store.durability() != Durability::Memory,
            events: ends.sender,
            ended: ends.ended,
            finished: false,
        };
        Ok(IngestStream { opened, sender, events: ends.events })
    }

    /// Takes constant time: the watcher reads the journal in its own task.
    fn watch(
        &self,
        from_revision: Option<i64>,
        handle: MapHandle,
    ) -> Result<(Watch, Past), EngineError> {
        let account = &self.shared.account;
        let watcher = account.reserve(Resource::Watchers, 1)?;
        let place = [watcher, account.reserve(Resource::Streams, 1)?];
        let newest = self.map.revision();
        if let Some(revision) = from_revision.filter(|&revision| revision > newest) {
            let map = self.shared.name.clone();
            return Err(EngineError::RevisionAhead { map, revision, newest });
        }
        let mut watch = self.watchers.open(handle, &self.map, self.state, place);
        if from_revision.is_none() {
            watch.reset = Some(Arc::clone(&self.map));
        }
        Ok((watch, Past::of(&self.map)))
    }
}

/// Logs a bug and returns the error that names the entry.
pub(super) fn report_bug(details: &str) -> EngineError {
    // The hasher's keys are random, so that ids tell entries apart, also across restarts.
    let id = format!("{:016x}", RandomState::new().hash_one(details));
    tracing::error!(%id, details, "bug");
    EngineError::Bug { id }
}
