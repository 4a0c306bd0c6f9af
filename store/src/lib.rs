//! The store of a covis server: the journal of every map, its snapshots, and the files of jobs.
//!
//! It knows maps and their events (`covis-map`) and what a solve leaves behind (`covis-solvers`); of
//! `covis-client` it takes the check of a message's size in memory, and nothing else. It knows nothing of
//! gRPC, of the engine or of the caller. All files are written here, and only here is NATS known.
//!
//! A writer acquires a map and gets an [`Epoch`]; from then on writes of earlier epochs are refused. Event
//! number n of a map has sequence n, which is its revision; an append says how far the writer believes the
//! journal to be, so that two writers can never interleave. An append is accepted in order and at once;
//! [`Store::follow`] reports when it has become durable, so that a writer need not wait for one fsync an
//! event. No type of a particular database shows through.
//!
//! | module | role |
//! |---|---|
//! | `memory` | every rule, nothing durable |
//! | `files` | journals and snapshots as files (decision 0011) |
//! | `replicated` | the same and a stream on several machines (decision 0037), behind the feature `cluster` |
//! | `encoding` | events and maps as bytes |
//! | `job_files` | records of jobs, uploads and results |
//! | `tasks` | work that other processes do |
//! | `map_file` | a map as a file that can be moved to another server |
//! | `reader` | a journal, a piece at a time |
//! | `error`, `meters` | what can go wrong; what a store counts |
//! | [`meter`] | counters, gauges and histograms as plain atomics, for the store and the server |
//! | [`sync`] | a mutex without poisoning |

use std::fmt;
use std::sync::Arc;
use std::time::SystemTime;

use async_trait::async_trait;
use tokio::sync::watch;

use covis_map::{Event, Map};

mod encoding;
mod error;
mod files;
#[cfg(any(test, feature = "fuzzing"))]
pub mod fuzzing;
mod job_files;
mod map_file;
mod memory;
pub mod meter;
mod meters;
mod reader;
#[cfg(feature = "cluster")]
mod replicated;
pub mod sync;
mod tasks;

pub use encoding::{EncodingError, EventOutline};
pub use error::{Damage, StoreError, UnreadableEvent};
pub use files::{
    Disk, DiskFile, FileStore, FileStoreOptions, JobCheckup, LostEvent, MapCheckup, Repair,
    back_up, check_up, check_up_jobs,
};
pub use job_files::{
    FoundRecord, JobFile, JobFileError, JobFiles, JobFolder, JobRecord, JobUid, JobUpload,
};
pub use map_file::{MAP_FILE, MapFileError, MapFileWriter, read_map_file};
pub use memory::MemoryStore;
pub use meters::StoreMeters;
pub use reader::{EventReader, Piece};
#[cfg(feature = "cluster")]
pub use replicated::{
    ClaimedTask, ReplicatedStore, ReplicationError, ReplicationOptions, WorkerLink,
};
pub use tasks::{TaskError, TaskQueue, TaskState};

/// Counts the writers that a map has had; a newer one fences the older ones.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct Epoch(pub u64);

impl fmt::Display for Epoch {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.0.fmt(f)
    }
}

/// What the store withstands.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Durability {
    /// Nothing: a restart loses it.
    Memory,
    /// Loss of power, once an append is durable.
    Disk,
    /// Loss of power, and loss of machines as long as most of them are left.
    Replicated,
}

/// How far a journal reaches after an append.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Position {
    /// The sequence of the last event.
    pub sequence: u64,
    /// Whether the events survive what [`Durability`] promises already; else [`Store::follow`]
    /// tells when they do.
    pub durable: bool,
    /// Whether the journal has grown so much since the last snapshot that another one would pay.
    pub snapshot_due: bool,
    /// Bytes of the map's events that wait for a write to disk; 0 where nothing is durable.
    pub waiting_bytes: u64,
}

/// How far a journal is durable.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Flushed {
    /// The last durable sequence; never falls.
    pub through: u64,
    /// Why nothing more will become durable.
    pub failed: Option<StoreError>,
    /// What the store has run out of for now: what was accepted becomes durable once there is some.
    pub unavailable: Option<StoreError>,
}

impl Flushed {
    /// Where another server may have the map: this one has no lease for now, and may go on with the map
    /// later.
    pub fn lapsed(&self) -> Option<&StoreError> {
        let is_lapse = |error: &&StoreError| matches!(error, StoreError::OwnedElsewhere { .. });
        self.unavailable.as_ref().filter(is_lapse)
    }

    /// Why nothing more becomes durable, for good or for now.
    pub fn trouble(&self) -> Option<&StoreError> {
        self.failed.as_ref().or(self.unavailable.as_ref())
    }
}

/// Waits until the event with a sequence is durable.
///
/// # Errors
/// Why it does not become durable, or not soon.
async fn wait_durable(
    mut flushed: watch::Receiver<Flushed>,
    sequence: u64,
) -> Result<(), StoreError> {
    let reached = flushed.wait_for(|f| f.through >= sequence || f.trouble().is_some()).await;
    // Whoever tells how far it is still does.
    reached.ok().and_then(|flushed| flushed.trouble().cloned()).map_or(Ok(()), Err)
}

/// The sequence of a revision; a negative revision is no sequence at all and reads as 0.
fn sequence_of(revision: i64) -> u64 {
    u64::try_from(revision).unwrap_or(0)
}

/// Those of the sequences, with 0 for the beginning of the journal, behind which no event was dropped.
fn whole_behind(dropped: u64, snapshots: impl Iterator<Item = u64>) -> Vec<u64> {
    std::iter::once(0).chain(snapshots).filter(|&sequence| sequence >= dropped).collect()
}

/// Keeps the journals and snapshots of many maps.
#[async_trait]
pub trait Store: Send + Sync + 'static {
    /// The time that events are stamped with: the system's, but where a simulation owns it.
    fn now(&self) -> SystemTime {
        SystemTime::now()
    }

    /// The names of the maps, sorted.
    ///
    /// # Errors
    /// [`StoreError`] when the store cannot be read.
    async fn list_maps(&self) -> Result<Vec<String>, StoreError>;

    /// Creates a map and acquires it. With an empty journal it is gone after a restart as long as it has
    /// no event, and where the call is dropped before it answers, the name stays free. One that begins
    /// with a snapshot, at its revision, is durable when the call answers; a crash before that leaves no
    /// map.
    ///
    /// # Errors
    /// [`StoreError::MapExists`], [`StoreError::Unavailable`].
    async fn create_map(&self, map: &str, snapshot: Option<Arc<Map>>) -> Result<Epoch, StoreError>;

    /// Deletes a map with its journal and snapshot, also where nobody waits for the answer any more.
    /// Where it fails either nothing has changed, or the map's journal has stopped; then the same call
    /// finishes it.
    ///
    /// # Errors
    /// [`StoreError::UnknownMap`], [`StoreError::Unavailable`].
    async fn delete_map(&self, map: &str) -> Result<(), StoreError>;

    /// Makes a map that is not open here this server's, where several servers share maps and no other
    /// one serves it; then it can be acquired. A store of one server has listed all its maps.
    ///
    /// # Errors
    /// [`StoreError::UnknownMap`], [`StoreError::OwnedElsewhere`], [`StoreError::Unavailable`].
    async fn claim(&self, map: &str) -> Result<(), StoreError> {
        Err(StoreError::UnknownMap { map: map.to_owned() })
    }

    /// Makes the caller the map's writer: appends of every earlier epoch fail from now on.
    ///
    /// # Errors
    /// [`StoreError::UnknownMap`].
    async fn acquire(&self, map: &str) -> Result<Epoch, StoreError>;

    /// Accepts events behind `expected_sequence`, the sequence of the journal's last event (0 for an
    /// empty journal): all of them or none, in order. They become durable in order too.
    ///
    /// # Errors
    /// [`StoreError::UnknownMap`], [`StoreError::Fenced`] after a newer writer acquired the map,
    /// [`StoreError::SequenceMismatch`] when the journal does not end at `expected_sequence` or an
    /// event's revision is not its sequence, [`StoreError::Unavailable`] while the disk has no room,
    /// [`StoreError::Stopped`] after a failed fsync, [`StoreError::Damaged`] where the map can only be
    /// read.
    async fn append(
        &self,
        map: &str,
        epoch: Epoch,
        expected_sequence: u64,
        batch: Vec<Arc<Event>>,
    ) -> Result<Position, StoreError>;

    /// Follows how far the map's journal is durable. The channel is closed where nothing ever is.
    ///
    /// # Errors
    /// [`StoreError::UnknownMap`].
    async fn follow(&self, map: &str) -> Result<watch::Receiver<Flushed>, StoreError>;

    /// The events with sequence greater than `from`; 0 reads from the first. Of a damaged journal,
    /// those up to the damage.
    ///
    /// # Errors
    /// [`StoreError::UnknownMap`], [`StoreError::Truncated`] when some of them are gone.
    async fn read(&self, map: &str, from: u64) -> Result<Vec<Arc<Event>>, StoreError>;

    /// Reads the events with sequence greater than `from` and up to `through` a piece at a time, so
    /// that nobody holds all of them. A writer never waits for a reader.
    ///
    /// # Errors
    /// As [`Store::read`], here or at a later piece.
    async fn reader(
        &self,
        map: &str,
        from: u64,
        through: u64,
    ) -> Result<Box<dyn EventReader>, StoreError> {
        Ok(reader::whole(self.read(map, from).await?, through))
    }

    /// Keeps the map as a snapshot at its revision, unless a later one is kept already. The one
    /// before it stays as well. Returns once it is on disk and was read back.
    ///
    /// # Errors
    /// [`StoreError::UnknownMap`], [`StoreError::Fenced`], and [`StoreError::SequenceMismatch`] when
    /// the snapshot is past the journal's end.
    async fn put_snapshot(
        &self,
        map: &str,
        epoch: Epoch,
        snapshot: Arc<Map>,
    ) -> Result<(), StoreError>;

    /// The latest snapshot that can be read.
    ///
    /// # Errors
    /// [`StoreError::UnknownMap`].
    async fn get_snapshot(&self, map: &str) -> Result<Option<Arc<Map>>, StoreError>;

    /// The sequences from which the map's later states can be replayed, rising: those of the snapshots that
    /// are kept with all events after them, and 0 where the journal begins with the first event. Empty
    /// where nothing was kept yet.
    ///
    /// # Errors
    /// [`StoreError::UnknownMap`].
    async fn replayable_from(&self, map: &str) -> Result<Vec<u64>, StoreError>;

    /// The snapshot at a sequence; `None` where it is not kept any more, or does not open.
    ///
    /// # Errors
    /// [`StoreError::UnknownMap`].
    async fn snapshot_at(&self, map: &str, sequence: u64) -> Result<Option<Arc<Map>>, StoreError>;

    /// What is damaged in the map's files; a map with lost events takes no appends.
    ///
    /// # Errors
    /// [`StoreError::UnknownMap`].
    async fn damage(&self, map: &str) -> Result<Vec<Damage>, StoreError>;

    /// Drops the events with sequence below `before`, which a snapshot must hold.
    ///
    /// # Errors
    /// [`StoreError::UnknownMap`], [`StoreError::Fenced`], and [`StoreError::NoSnapshot`] when no
    /// snapshot holds the last of them.
    async fn truncate(&self, map: &str, epoch: Epoch, before: u64) -> Result<(), StoreError>;

    /// Waits until all that was accepted is durable, and lets go of what another process may need.
    /// Nothing is accepted afterwards.
    async fn close(&self);

    /// What the store withstands.
    fn durability(&self) -> Durability;
}

#[cfg(test)]
mod tests;
