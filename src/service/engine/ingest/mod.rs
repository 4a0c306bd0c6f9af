//! Ingest: the open streams, the queue of their items, and whether an item is accepted.
//!
//! A client has at most one open stream: the one with the newest epoch. A bad item is rejected and
//! the stream continues; a limit, a failing journal or a bug ends it. A client that does not read
//! its events runs out of permits and has to wait. This part decides; the actor commits.

use std::collections::{BTreeMap, VecDeque};
use std::sync::Arc;
use std::time::Instant;

use tokio::sync::{mpsc, watch};

use crate::map::{
    Change, Client, ClientIndex, Counted, Digest, Exceeded, Item, MAX_NUMBER, Map, Reason, Recall,
    Rejection, Retired, Usage,
};
use crate::service::engine::account::HeldEntities;
use crate::service::engine::context::MapContext;
use crate::service::engine::events::{Permit, Queued};
use crate::service::engine::{
    Ack, AckStatus, EngineError, Opened, Reservation, Resource, SolveReport, StreamEvent,
};

/// No keyframe is retired for an item if this many of its size would exceed a limit.
const LARGEST_SHARE: u64 = 4;

/// The bound of an item's growth is reserved only if there is room for this many times the bound.
const FAR: u64 = 8;

/// Permits for OPTIMIZED acks that a stream keeps. A burst that ends has as many more acks; the last permit
/// is kept for the last of them.
const OPTIMIZED_PERMITS: usize = 16;

/// Events beyond those of queued items: the end, and [`OPTIMIZED_PERMITS`].
const EXTRA_EVENTS: usize = 1 + OPTIMIZED_PERMITS;

/// Most items of a stream whose time to OPTIMIZED is measured at once.
const MEASURED_ITEMS: usize = 1024;

/// Events that one queued item may have: RECEIVED or REJECTED, DURABLE, OPTIMIZED.
const EVENTS_PER_ITEM: usize = 3;

/// The decision about an item.
pub(crate) enum Admission {
    /// It is already journaled under this sequence.
    Duplicate,
    Reject(Rejection),
    Take(Box<Change>),
}

struct Stream {
    /// Counted as open until the caller learns of the end.
    _open: crate::meter::GaugeGuard,
    epoch: i64,
    lock_step: bool,
    finishing: bool,
    /// The names in this map of the clients that have another one in the map by whose name it was opened.
    renamed: BTreeMap<String, String>,
    end: Option<Permit>,
    optimized: Vec<Permit>,
    /// Sequence and arrival of items whose OPTIMIZED ack is outstanding, at most
    /// [`MEASURED_ITEMS`].
    waiting: VecDeque<(i64, Instant)>,
    ended: watch::Sender<Option<EngineError>>,
    _reservation: Reservation,
}

/// A stream as its caller gets it.
pub(crate) struct OpenedStream {
    pub(crate) opened: Opened,
    /// Gives the items of the stream room for their acks.
    pub(crate) sender: mpsc::Sender<StreamEvent>,
    pub(crate) events: mpsc::Receiver<StreamEvent>,
    /// Why the stream has ended.
    pub(crate) ended: watch::Receiver<Option<EngineError>>,
}

/// The streams of a map and what they may add to it.
pub(crate) struct Ingest {
    shared: Arc<MapContext>,
    queue: mpsc::Receiver<Queued>,
    /// Whether the queue is closed and empty.
    drained: bool,
    streams: BTreeMap<ClientIndex, Stream>,
    /// The map's entities, as its accounts count them.
    entities: HeldEntities,
}

impl Ingest {
    pub(crate) fn new(shared: &Arc<MapContext>, queue: mpsc::Receiver<Queued>, map: &Map) -> Self {
        Self {
            shared: Arc::clone(shared),
            queue,
            drained: false,
            streams: BTreeMap::new(),
            entities: HeldEntities::existing(&shared.account, map.usage()),
        }
    }

    /// The next entry of the queue; never resolves after the last one.
    pub(crate) async fn next(&mut self) -> Option<Queued> {
        if self.drained {
            return std::future::pending().await;
        }
        let next = self.queue.recv().await;
        self.drained = next.is_none();
        next
    }

    /// Accepts no further items; those in the queue are still handled.
    pub(crate) fn close(&mut self) {
        self.queue.close();
    }

    /// Whether the queue is closed and empty.
    pub(crate) fn is_drained(&self) -> bool {
        self.drained
    }

    /// The change by which a client opens a stream, its epoch, and its reservation among all streams.
    /// Epoch 0 means the next epoch.
    ///
    /// # Errors
    /// [`EngineError::TooLarge`], [`EngineError::EpochFenced`], and as [`Account::reserve`](crate::service::engine::Account::reserve).
    pub(crate) fn opening(
        &self,
        map: &Map,
        name: &str,
        epoch: i64,
    ) -> Result<(Change, i64, Reservation), EngineError> {
        if epoch > MAX_NUMBER {
            return Err(EngineError::TooLarge { field: "open.epoch", maximum: MAX_NUMBER });
        }
        let reservation = self.shared.account.reserve(Resource::Streams, 1)?;
        let known = map.client_named(name).and_then(|client| map.client(client));
        let newest = known.map_or(0, Client::newest_epoch);
        let epoch = if epoch == 0 { newest.saturating_add(1) } else { epoch };
        if epoch <= newest {
            return Err(self.fenced(name, epoch, newest));
        }
        Ok((Change::ClientOpened { name: name.to_owned(), epoch }, epoch, reservation))
    }

    fn fenced(&self, client: &str, epoch: i64, newest: i64) -> EngineError {
        let map = self.shared.name.clone();
        EngineError::EpochFenced { map, client: client.to_owned(), epoch, newest }
    }

    /// Ends the client's stream, because one with the newer epoch `newest` is opened.
    pub(crate) fn fence(&mut self, client: ClientIndex, name: &str, newest: i64) {
        if let Some(stream) = self.streams.get(&client) {
            let error = self.fenced(name, stream.epoch, newest);
            self.end(client, error);
        }
    }

    /// Opens a stream; the client's older one has ended. `renamed` has the names in this map of clients that
    /// have another one in the map by whose name it was opened.
    pub(crate) fn open(
        &mut self,
        opened: Opened,
        map: &Map,
        renamed: BTreeMap<String, String>,
        reservation: Reservation,
    ) -> OpenedStream {
        let Opened { client, epoch, lock_step, .. } = opened;
        let most = map.policy().max_queued_items.map_or(usize::MAX, |most| most as usize);
        let queued_items = self.shared.config.queue_capacity.min(most);
        let capacity = queued_items.max(1) * EVENTS_PER_ITEM + EXTRA_EVENTS;
        let (sender, events) = mpsc::channel(capacity);
        let (ended_sender, ended) = watch::channel(None);
        let meters = &self.shared.meters;
        let now = Instant::now();
        let permit = || {
            let room = sender.clone().try_reserve_owned().ok();
            room.map(|room| Permit::new(room, meters, 0, now))
        };
        let stream = Stream {
            renamed,
            epoch,
            lock_step,
            finishing: false,
            end: permit(),
            optimized: permit().into_iter().collect(),
            waiting: VecDeque::new(),
            _open: meters.streams.hold(),
            ended: ended_sender,
            _reservation: reservation,
        };
        self.streams.insert(client, stream);
        OpenedStream { opened, sender, events, ended }
    }

    /// Whether the stream may write.
    pub(crate) fn is_current(&self, client: ClientIndex, epoch: i64) -> bool {
        self.streams.get(&client).is_some_and(|s| s.epoch == epoch && !s.finishing)
    }

    /// Makes an item name clients as this map does.
    pub(crate) fn rename(&self, client: ClientIndex, item: &mut Item) {
        if let Some(stream) = self.streams.get(&client).filter(|s| !s.renamed.is_empty()) {
            item.rename_clients(&stream.renamed);
        }
    }

    /// Whether the client has a stream.
    pub(crate) fn has_stream(&self, client: ClientIndex) -> bool {
        self.streams.contains_key(&client)
    }

    /// Whether items wait for solves.
    pub(crate) fn is_lock_step(&self) -> bool {
        self.shared.config.lock_step || self.streams.values().any(|s| s.lock_step)
    }

    /// Decides about an item, apart from whether there is room for it.
    pub(crate) fn admit(
        map: &Map,
        client: ClientIndex,
        sequence: i64,
        digest: &Digest,
        item: &Item,
    ) -> Admission {
        let refused =
            |reason, text: String| Admission::Reject(Rejection::of("sequence", reason, text));
        match map.recall(client, sequence, digest) {
            Recall::Duplicate => return Admission::Duplicate,
            Recall::Conflict => {
                let text = format!("sequence {sequence} was used by another item");
                return refused(Reason::AlreadyExists, text);
            }
            Recall::New => {}
        }
        if sequence > MAX_NUMBER {
            let text = format!("{sequence} is above {MAX_NUMBER}: no other could follow it");
            return refused(Reason::OutOfRange, text);
        }
        let next = map.client(client).map_or(1, |c| c.next_sequence);
        if sequence < next {
            let text =
                format!("sequence {sequence} was skipped or lies too far back; the next is {next}");
            return refused(Reason::OutOfRange, text);
        }
        if !item.has_valid_numbers() {
            let text = "a number is not finite, or not positive where it must be";
            return Admission::Reject(Rejection::of("item", Reason::OutOfRange, text));
        }
        if map.holds(client, item) {
            return Admission::Take(Box::new(Change::ItemRepeated));
        }
        match map.check(client, item) {
            Ok(change) => Admission::Take(Box::new(change)),
            Err(rejection) => Admission::Reject(rejection),
        }
    }

    /// Reserves what a change would add, in all accounts. It is counted by [`Ingest::count`] once
    /// the change was applied or has failed. Returns the limit of the map that leaves no room until a
    /// keyframe goes, if there is one.
    ///
    /// # Errors
    /// Why there is no room, whatever goes.
    pub(crate) fn reserve(
        &mut self,
        map: &Map,
        change: &Change,
    ) -> Result<Option<Exceeded>, EngineError> {
        let account = &self.shared.account;
        let limits = map.policy().limits.lower(&account.limits().held);
        // A slow disk fills the memory of the server: the limit covers the journals of all maps
        // together.
        drop(account.reserve(Resource::JournalBytes, 1)?);
        let usage = map.usage();
        let bound = map.growth_bound(change);
        // Far from every limit the bound is enough; near a limit it would refuse items that have
        // room.
        let is_far = limits.exceeded(usage, bound * FAR).is_none();
        if is_far && self.entities.have_room(bound * FAR) && self.entities.grow(bound).is_ok() {
            return Ok(None);
        }
        let growth = map.growth(change);
        let Some(exceeded) = limits.exceeded(usage, growth) else {
            self.entities.grow(growth)?;
            return Ok(None);
        };
        // A change that would push out a large part of the map is refused: it can only be a
        // mistake.
        let alone = Usage { keyframes: 0, ..growth };
        let is_huge = limits.exceeded(alone * (LARGEST_SHARE - 1), alone).is_some();
        if is_huge { Err(account.exceeded(exceeded)) } else { Ok(Some(exceeded)) }
    }

    /// Counts the entities of the map as it is now.
    pub(crate) fn count(&mut self, map: &Map) {
        self.entities.update(map.usage());
    }

    /// Keeps room for an OPTIMIZED ack.
    pub(crate) fn keep(&mut self, client: ClientIndex, permit: Option<Permit>) {
        if let (Some(stream), Some(permit)) = (self.streams.get_mut(&client), permit) {
            if stream.waiting.len() < MEASURED_ITEMS {
                stream.waiting.push_back((permit.sequence, permit.arrived));
            }
            if stream.optimized.len() < OPTIMIZED_PERMITS {
                stream.optimized.push(permit);
            }
        }
    }

    /// Sends OPTIMIZED acks to those clients that have a stream, up to their sequences; for each it is said
    /// whether another one follows, which replaces it where there is room for one only.
    pub(crate) fn acknowledge_optimized(
        &mut self,
        marks: impl IntoIterator<Item = (ClientIndex, i64, bool)>,
        revision: i64,
        solve_id: i64,
        report: &SolveReport,
    ) {
        for (client, sequence, is_followed) in marks {
            let Some(stream) = self.streams.get_mut(&client) else { continue };
            if is_followed && stream.optimized.len() == 1 {
                continue;
            }
            let Some(permit) = stream.optimized.pop() else {
                tracing::warn!(sequence, "no room for an OPTIMIZED ack");
                continue;
            };
            while let Some((_, arrived)) = stream.waiting.pop_front_if(|w| w.0 <= sequence) {
                self.shared.meters.optimized_ns.observe_time(arrived.elapsed());
            }
            let status = AckStatus::Optimized { solve_id, outcome: report.clone() };
            permit.send(StreamEvent::Ack(Ack { sequence, revision, status }));
        }
    }

    /// Marks that the client sends no more; the stream closes once no ack is outstanding.
    pub(crate) fn finish(&mut self, client: ClientIndex, epoch: i64) {
        if let Some(stream) = self.streams.get_mut(&client).filter(|s| s.epoch == epoch) {
            stream.finishing = true;
        }
    }

    /// Closes the finished streams whose clients do not wait for acks.
    pub(crate) fn close_finished(&mut self, is_waiting: impl Fn(ClientIndex) -> bool) {
        self.streams.retain(|&client, stream| !stream.finishing || is_waiting(client));
    }

    /// Ends a client's stream, if there is one.
    pub(crate) fn end(&mut self, client: ClientIndex, error: EngineError) {
        if let Some(stream) = self.streams.remove(&client) {
            if let Some(permit) = stream.end {
                permit.send(StreamEvent::End(error.clone()));
            }
            stream.ended.send_replace(Some(error));
        }
    }

    /// Ends all streams.
    pub(crate) fn end_all(&mut self, error: &EngineError) {
        let clients: Vec<ClientIndex> = self.streams.keys().copied().collect();
        clients.into_iter().for_each(|client| self.end(client, error.clone()));
    }
}

/// How many entities an item has.
pub(crate) fn size_of_item(item: &Item) -> usize {
    match item {
        Item::Keyframe { observations, landmarks, .. } => observations.len() + landmarks.len(),
        Item::Landmarks { landmarks } => landmarks.len(),
        Item::Observations { observations, .. } => observations.len(),
        Item::Camera { .. }
        | Item::RelativePose { .. }
        | Item::PosePrior { .. }
        | Item::PositionPrior { .. } => 1,
        Item::Edit(edit) => edit.size(),
    }
}

/// Whether retiring a keyframe reduces the count that is too high. Clients and cameras stay in the
/// map, and the keyframe may be replaced by more constraints than it had.
pub(crate) fn frees(map: &Map, retired: &Retired, counted: Counted) -> bool {
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
