//! Maps of several servers: the embedded store as a cache on each, and NATS JetStream between them.
//!
//! A map's journal is a stream (`map_stream`). An event is durable once the owner's own journal has synced
//! it **and** the stream has acknowledged it, which every NATS server does after its own sync (`synced`).
//! Decision 0037 gives the reasons.
//!
//! - One server owns a map. It says so in the catalog (`catalog`) and takes the map over in the map's stream,
//!   which refuses the previous writer (`map_stream`): two servers never both write.
//! - Clocks decide who is alive and nothing else (`members`). A server whose lease lapsed goes on with the
//!   maps that nobody took (`owned`).
//! - What a server's own journal holds beyond the stream was never acknowledged.
//!
//! | module | role |
//! |---|---|
//! | `message` | what a stream's messages are, and events from them |
//! | `map_stream` | the stream of a map: fencing, putting, reading |
//! | `publisher` | the events of an open map on their way to the stream |
//! | `takeover` | from catalog, snapshot and stream to an open map |
//! | `takeovers` | how soon the same map is taken over again |
//! | `owned` | a map that this server serves |
//! | `catalog`, `members`, `snapshots` | who serves what, who is alive, maps as objects |
//! | `tasks` | the work that servers give to workers |
//! | `bucket` | a key as its bucket's leader has it |
//! | `connect` | what servers share, opened |
//! | `synced` | whether NATS syncs before it acknowledges |
//!
//! Nothing outside knows NATS.

mod bucket;
mod catalog;
mod connect;
mod map_stream;
mod members;
mod message;
mod owned;
mod publisher;
mod snapshots;
mod synced;
mod takeover;
mod takeovers;
mod tasks;

use std::collections::BTreeMap;
use std::fmt;
use std::sync::Arc;
use std::time::SystemTime;

use async_nats::jetstream::context::Context;
use async_trait::async_trait;
use tokio::sync::watch;
use tokio::time::Instant;

use self::catalog::{Catalog, Entry};
use self::connect::Shared;
pub use self::connect::{ReplicationError, ReplicationOptions};
use self::members::Members;
use self::owned::Owned;
use self::snapshots::Snapshots;
use self::takeovers::Takeovers;
use self::tasks::Tasks;
pub use self::tasks::{ClaimedTask, WorkerLink};
use super::encoding::encode_event;
use super::{
    Damage, Durability, Epoch, EventReader, FileStore, Flushed, Position, Store, StoreError,
    TaskQueue, sequence_of, wait_durable,
};
use crate::sync::Mutex;
use covis_map::{Event, Map};

/// How often a claim is tried while others change the entry.
const CLAIMS: u32 = 8;

/// Maps that several servers share. An accepted event survives the loss of this machine once
/// [`Store::follow`] reports it.
pub struct ReplicatedStore {
    /// What this server wrote itself.
    local: FileStore,
    context: Context,
    catalog: Catalog,
    snapshots: Snapshots,
    members: Members,
    takeovers: Takeovers,
    tasks: Tasks,
    replicas: usize,
    /// Whether NATS syncs what it acknowledges.
    syncs: bool,
    /// Most bytes of events in a message.
    most: usize,
    maps: Mutex<BTreeMap<String, Arc<Owned>>>,
}

impl fmt::Debug for ReplicatedStore {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("ReplicatedStore").field("me", self.members.me()).finish_non_exhaustive()
    }
}

impl ReplicatedStore {
    /// Connects, and takes part; waits a while for NATS, which may start at the same time. `local` is
    /// this server's own store.
    ///
    /// # Errors
    /// [`ReplicationError`].
    pub async fn open(
        local: FileStore,
        options: ReplicationOptions,
    ) -> Result<Self, ReplicationError> {
        let Shared { context, most, catalog, snapshots, members, tasks } =
            Shared::open(&options).await?;
        let (replicas, syncs) = (options.replicas, !options.accept_unsynced);
        let takeovers = Takeovers::new(&members.me().server, members.lease_time());
        Ok(Self {
            local,
            context,
            catalog,
            snapshots,
            members,
            takeovers,
            tasks,
            replicas,
            syncs,
            most,
            maps: Mutex::default(),
        })
    }

    /// The queue of tasks between the servers and their workers.
    pub fn tasks(&self) -> Arc<dyn TaskQueue> {
        Arc::new(self.tasks.clone())
    }

    /// A map that this server serves.
    fn owned(&self, map: &str) -> Result<Arc<Owned>, StoreError> {
        let owned = self.maps.lock().get(map).cloned();
        owned.ok_or_else(|| StoreError::OwnedElsewhere { map: map.to_owned(), owner: None })
    }

    /// Refuses to take maps without a lease.
    fn check_lease(&self, map: &str) -> Result<(), StoreError> {
        if self.members.lease().borrow().holds {
            return Ok(());
        }
        Err(StoreError::OwnedElsewhere { map: map.to_owned(), owner: None })
    }
}

#[async_trait]
impl Store for ReplicatedStore {
    fn now(&self) -> SystemTime {
        self.local.now()
    }

    /// None: a map is opened when it is asked for.
    async fn list_maps(&self) -> Result<Vec<String>, StoreError> {
        Ok(Vec::new())
    }

    async fn create_map(&self, map: &str, snapshot: Option<Arc<Map>>) -> Result<Epoch, StoreError> {
        self.check_lease(map)?;
        let begins: Vec<u64> = snapshot.iter().map(|map| sequence_of(map.revision())).collect();
        let (name, owner) = (map.to_owned(), Some(self.members.me().clone()));
        let entry =
            Entry { name, uid: new_uid(), owner, snapshots: begins, stream_was_lost: false };
        if let Some(content) = snapshot {
            let revision = sequence_of(content.revision());
            self.snapshots.put(map, &entry.uid, revision, content).await?;
        }
        // From here on the map exists. Without an event or a snapshot it is removed by whoever opens it.
        if self.catalog.create(entry).await?.is_none() {
            // Another server made it a moment ago: whoever asks again is led there.
            return Err(StoreError::OwnedElsewhere { map: map.to_owned(), owner: None });
        }
        self.take_over(map, true).await
    }

    async fn delete_map(&self, map: &str) -> Result<(), StoreError> {
        let owned = self.owned(map)?;
        owned.check()?;
        let known = owned.known().await.clone();
        // The entry goes first: from here on the map does not exist.
        if !self.catalog.remove(&known).await? {
            return Err(StoreError::OwnedElsewhere { map: map.to_owned(), owner: None });
        }
        owned.stop();
        self.maps.lock().remove(map);
        self.takeovers.forget(map);
        if let Err(error) = map_stream::delete(&self.context, map, &known.entry.uid).await {
            tracing::warn!(map, %error, "the stream of a deleted map is left");
        }
        for revision in &known.entry.snapshots {
            self.snapshots.remove(&known.entry.uid, *revision).await;
        }
        if let Err(error) = self.local.delete_map(map).await {
            tracing::warn!(map, %error, "files of a deleted map are left");
        }
        Ok(())
    }

    async fn claim(&self, map: &str) -> Result<(), StoreError> {
        self.check_lease(map)?;
        let mut is_counted = false;
        for _ in 0..CLAIMS {
            let Some(known) = self.catalog.get(map).await? else {
                return Err(StoreError::UnknownMap { map: map.to_owned() });
            };
            let is_mine = known.entry.owner.as_ref() == Some(self.members.me());
            if let Some(owner) = &known.entry.owner
                && !is_mine
                && self.members.is_alive(owner)
            {
                let owner = Some(owner.address.clone());
                return Err(StoreError::OwnedElsewhere { map: map.to_owned(), owner });
            }
            if !is_counted {
                self.takeovers.begin(map, Instant::now())?;
                is_counted = true;
            }
            if is_mine {
                return Ok(());
            }
            let owner = Some(self.members.me().clone());
            let entry = Entry { owner, ..known.entry.clone() };
            if self.catalog.replace(&known, entry).await?.is_some() {
                return Ok(());
            }
        }
        Err(StoreError::OwnedElsewhere { map: map.to_owned(), owner: None })
    }

    async fn acquire(&self, map: &str) -> Result<Epoch, StoreError> {
        self.check_lease(map)?;
        self.take_over(map, false).await
    }

    async fn append(
        &self,
        map: &str,
        epoch: Epoch,
        expected_sequence: u64,
        batch: Vec<Arc<Event>>,
    ) -> Result<Position, StoreError> {
        let owned = self.owned(map)?;
        owned.check()?;
        let encoded = |event: &Arc<Event>| {
            let mut bytes = Vec::new();
            encode_event(event, &mut bytes);
            (sequence_of(event.revision), bytes)
        };
        let events: Vec<_> = batch.iter().map(encoded).collect();
        owned.publisher.wait_for_room().await;
        let position = self.local.append(map, epoch, expected_sequence, batch).await?;
        // Nothing is awaited in between: what the own journal has goes to the stream too.
        let waiting = owned.publisher.push(events) as u64;
        let waiting_bytes = position.waiting_bytes.max(waiting);
        Ok(Position { durable: false, waiting_bytes, ..position })
    }

    async fn follow(&self, map: &str) -> Result<watch::Receiver<Flushed>, StoreError> {
        Ok(self.owned(map)?.flushed())
    }

    async fn read(&self, map: &str, from: u64) -> Result<Vec<Arc<Event>>, StoreError> {
        self.local.read(map, from).await
    }

    async fn reader(
        &self,
        map: &str,
        from: u64,
        through: u64,
    ) -> Result<Box<dyn EventReader>, StoreError> {
        self.local.reader(map, from, through).await
    }

    async fn put_snapshot(
        &self,
        map: &str,
        epoch: Epoch,
        snapshot: Arc<Map>,
    ) -> Result<(), StoreError> {
        let owned = self.owned(map)?;
        let revision = sequence_of(snapshot.revision());
        self.local.put_snapshot(map, epoch, Arc::clone(&snapshot)).await?;
        // A snapshot must not hold events that the stream may refuse.
        wait_durable(owned.flushed(), revision).await?;
        let mut known = owned.known().await;
        if known.entry.snapshots.last().is_some_and(|&newest| newest >= revision) {
            return Ok(());
        }
        self.snapshots.put(map, &known.entry.uid, revision, snapshot).await?;
        let mut snapshots = known.entry.snapshots.clone();
        snapshots.push(revision);
        let kept = snapshots.split_off(snapshots.len().saturating_sub(2));
        let entry = Entry { snapshots: kept, ..known.entry.clone() };
        match self.catalog.replace(&known, entry).await? {
            Some(replaced) => *known = replaced,
            None => {
                return Err(StoreError::OwnedElsewhere { map: map.to_owned(), owner: None });
            }
        }
        for old in snapshots {
            self.snapshots.remove(&known.entry.uid, old).await;
        }
        Ok(())
    }

    async fn get_snapshot(&self, map: &str) -> Result<Option<Arc<Map>>, StoreError> {
        self.local.get_snapshot(map).await
    }

    /// What this server's own disk keeps: after a takeover it begins with the snapshot of the takeover.
    async fn replayable_from(&self, map: &str) -> Result<Vec<u64>, StoreError> {
        self.local.replayable_from(map).await
    }

    async fn snapshot_at(&self, map: &str, sequence: u64) -> Result<Option<Arc<Map>>, StoreError> {
        self.local.snapshot_at(map, sequence).await
    }

    async fn damage(&self, map: &str) -> Result<Vec<Damage>, StoreError> {
        self.local.damage(map).await
    }

    async fn truncate(&self, map: &str, epoch: Epoch, before: u64) -> Result<(), StoreError> {
        let owned = self.owned(map)?;
        self.local.truncate(map, epoch, before).await?;
        let oldest = owned.known().await.entry.snapshots.first().copied().unwrap_or(0);
        // Behind the older snapshot that is kept the stream must have everything.
        let before = before.min(oldest.saturating_add(1));
        if let Some(message) = owned.publisher.message_of(before) {
            owned.stream.purge(message).await?;
            owned.publisher.purged(message);
        }
        Ok(())
    }

    async fn close(&self) {
        let maps: Vec<_> = std::mem::take(&mut *self.maps.lock()).into_values().collect();
        self.local.close().await;
        for owned in maps {
            owned.give_away(&self.catalog).await;
        }
        self.members.leave().await;
    }

    fn durability(&self) -> Durability {
        Durability::Replicated
    }
}

/// A call of NATS failed: the same call may succeed later.
fn unavailable(map: &str, what: &str, cause: &dyn fmt::Display) -> StoreError {
    StoreError::Unavailable { map: map.to_owned(), cause: format!("{what}: {cause}") }
}

/// Random, and of letters that names of streams and keys take.
fn new_uid() -> String {
    let mut bytes = [0_u8; 16];
    // Without randomness of the system the process has no TLS either.
    let filled = ring::rand::SecureRandom::fill(&ring::rand::SystemRandom::new(), &mut bytes);
    if filled.is_err() {
        tracing::error!("the system has no randomness");
    }
    bytes.iter().map(|byte| format!("{byte:02x}")).collect()
}
