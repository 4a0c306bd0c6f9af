//! The engine through its handles: acks, epochs, solves beside the stream, lock-step, bugs.

mod bugs;
mod journal;
mod limits;
mod maps;
mod merging;
mod solves;
mod staged_store;
mod stream;
mod watch;

use std::hash::{DefaultHasher, Hash, Hasher};
use std::sync::Arc;

use covis::map::{Change, Digest, Item, Map, MapPolicy, SolveKind};
use covis::service::engine::{
    Ack, AckStatus, EngineConfig, EngineError, Fault, IngestStream, ItemSender, MapHandle, Maps,
    SolverPool, StreamEvent,
};
use covis::store::{MemoryStore, Store};
use covis_solvers::geometry::{LieGroup, Se3};
use nalgebra::Vector6;
use tokio::sync::mpsc::Receiver;

use crate::map_support::{camera_item, pose_at, street_keyframe};

/// A server's maps over a store that the test can read.
pub(crate) struct Fixture {
    pub(crate) store: Arc<MemoryStore>,
    pub(crate) maps: Maps,
}

impl Fixture {
    pub(crate) async fn new(config: EngineConfig, threads: usize) -> Self {
        let store = Arc::new(MemoryStore::new());
        let maps = open(&store, config, threads).await;
        Self { store, maps }
    }

    pub(crate) async fn plain() -> Self {
        Self::new(EngineConfig::default(), 1).await
    }

    pub(crate) async fn lock_step() -> Self {
        Self::new(EngineConfig { lock_step: true, ..EngineConfig::default() }, 1).await
    }

    pub(crate) async fn faulty(fault: Fault) -> Self {
        Self::new(EngineConfig { fault: Some(fault), ..EngineConfig::default() }, 1).await
    }

    pub(crate) async fn map(&self, policy: MapPolicy) -> MapHandle {
        self.maps.create("house", "A house", policy).await.unwrap();
        self.maps.get("house").unwrap()
    }

    /// The kinds of the applied solves, from the journal.
    pub(crate) async fn solves(&self) -> Vec<SolveKind> {
        let events = self.store.read("house", 0).await.unwrap();
        let kind = |change: &Change| {
            if let Change::SolveApplied { solve } = change { Some(solve.kind) } else { None }
        };
        events.iter().filter_map(|e| kind(&e.change)).collect()
    }

    /// The map as its journal replays.
    pub(crate) async fn replayed(&self) -> Map {
        let events = self.store.read("house", 0).await.unwrap();
        Map::replay(events.iter().map(AsRef::as_ref)).unwrap()
    }
}

pub(crate) async fn open(store: &Arc<MemoryStore>, config: EngineConfig, threads: usize) -> Maps {
    let store: Arc<dyn Store> = Arc::<MemoryStore>::clone(store);
    Maps::open(store, SolverPool::new(threads).unwrap(), config).await.unwrap()
}

/// A stream with its halves and the next sequence.
pub(crate) struct Client {
    pub(crate) sender: ItemSender,
    pub(crate) events: Receiver<StreamEvent>,
    pub(crate) sequence: i64,
    /// The acks that were read.
    pub(crate) seen: Vec<Ack>,
}

impl Client {
    pub(crate) fn of(stream: IngestStream) -> Self {
        let sequence = stream.opened.next_sequence;
        let (sender, events) = stream.split();
        Self { sender, events, sequence, seen: Vec::new() }
    }

    pub(crate) async fn open(map: &MapHandle) -> Self {
        Self::open_as(map, "robot").await
    }

    pub(crate) async fn open_as(map: &MapHandle, name: &str) -> Self {
        Self::of(map.open_stream(name.to_owned(), 0, false).await.unwrap())
    }

    /// Sends the next item and returns its sequence.
    pub(crate) async fn send(&mut self, item: Item) -> i64 {
        let sequence = self.sequence;
        self.sequence += 1;
        self.sender.send(sequence, digest(&item), item).await.unwrap();
        sequence
    }

    /// Sends the camera and the keyframes `ids` of the street.
    pub(crate) async fn send_street(&mut self, ids: std::ops::Range<i64>) {
        self.send(camera_item(0)).await;
        for id in ids {
            self.send(noisy_keyframe(id)).await;
        }
    }

    pub(crate) async fn event(&mut self) -> StreamEvent {
        self.events.recv().await.expect("the stream is open")
    }

    pub(crate) async fn ack(&mut self) -> Ack {
        match self.event().await {
            StreamEvent::Ack(ack) => {
                self.seen.push(ack.clone());
                ack
            }
            StreamEvent::End(error) => panic!("the stream ended: {error}"),
        }
    }

    /// Reads acks until `sequence` was received or rejected, and returns that ack.
    pub(crate) async fn received(&mut self, sequence: i64) -> Ack {
        loop {
            let ack = self.ack().await;
            let answers = matches!(ack.status, AckStatus::Received { .. } | AckStatus::Rejected(_));
            if answers && ack.sequence == sequence {
                return ack;
            }
        }
    }

    /// Reads on until the stream ends with an error.
    pub(crate) async fn end(&mut self) -> EngineError {
        loop {
            if let StreamEvent::End(error) = self.event().await {
                return error;
            }
        }
    }

    /// Half-closes and returns all acks that are left.
    pub(crate) async fn finish(self) -> Vec<Ack> {
        let Self { sender, mut events, .. } = self;
        sender.finish().await;
        let mut acks = Vec::new();
        while let Some(event) = events.recv().await {
            match event {
                StreamEvent::Ack(ack) => acks.push(ack),
                StreamEvent::End(error) => panic!("the stream ended: {error}"),
            }
        }
        acks
    }
}

pub(crate) fn digest(item: &Item) -> Digest {
    let mut hasher = DefaultHasher::new();
    format!("{item:?}").hash(&mut hasher);
    let mut digest = [0; 32];
    digest[..8].copy_from_slice(&hasher.finish().to_le_bytes());
    digest
}

/// Keyframe `id` of the street, its start estimate off by some centimeters and milliradians.
pub(crate) fn noisy_keyframe(id: i64) -> Item {
    street_keyframe(id, noisy_pose(id), &Map::new())
}

pub(crate) fn noisy_pose(id: i64) -> Se3 {
    let wobble = |k: i64| 0.02 * ((id * 37 + k * 11) % 7 - 3) as f64 / 3.0;
    let tangent = Vector6::from_fn(|row, _| wobble(row as i64) * if row < 3 { 1.0 } else { 0.2 });
    // The first keyframe is where it says: it holds the frame.
    if id == 0 { pose_at(0.0) } else { pose_at(id as f64).plus(&tangent) }
}

/// (sequence, solve id) of the OPTIMIZED acks.
pub(crate) fn optimized(acks: &[Ack]) -> Vec<(i64, i64)> {
    acks.iter()
        .filter_map(|ack| match &ack.status {
            AckStatus::Optimized { solve_id, .. } => Some((ack.sequence, *solve_id)),
            AckStatus::Received { .. } | AckStatus::Durable | AckStatus::Rejected(_) => None,
        })
        .collect()
}
