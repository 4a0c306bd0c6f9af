//! What can go wrong in a store. Causes are kept as text: one failure ends many streams and calls,
//! so that an error is `Clone`, which those of the system are not.

use std::fmt;

use super::Epoch;

/// A refused or failed call; the journal is as it was.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[allow(missing_docs, reason = "the messages say what the fields are")]
pub enum StoreError {
    /// There is no such map.
    #[error("map {map:?} does not exist")]
    UnknownMap { map: String },
    /// The map is there already.
    #[error("map {map:?} exists already")]
    MapExists { map: String },
    /// A newer writer owns the map.
    #[error("map {map:?}: epoch {epoch} is fenced by epoch {newest}")]
    Fenced { map: String, epoch: Epoch, newest: Epoch },
    /// Another server serves the map, or is about to: this one may not.
    #[error("map {map:?} is served by another server{}", at(owner.as_deref()))]
    OwnedElsewhere {
        map: String,
        /// Where clients reach it, as a URL, as far as it is known.
        owner: Option<String>,
    },
    /// The event could not be read again as it is, so it is not written: a bug, or a value that no reader
    /// accepts. Nothing was changed.
    #[error("map {map:?}: event {sequence} ({kind}) could not be read again: {reason}")]
    NotReadable {
        map: String,
        sequence: u64,
        /// [`Change::name`](covis_map::Change::name).
        kind: &'static str,
        reason: String,
    },
    /// An event of the journal does not fit the map before it. What precedes it can be read.
    #[error("map {map:?} takes no changes: event {sequence} ({kind}) does not fit: {reason}")]
    Unfit {
        map: String,
        sequence: u64,
        /// [`Change::name`](covis_map::Change::name).
        kind: &'static str,
        reason: String,
    },
    /// The journal does not stand where the caller thinks, or an event is not numbered in order.
    #[error("map {map:?}: the journal needs sequence {expected}, the caller gave {actual}")]
    SequenceMismatch { map: String, expected: u64, actual: u64 },
    /// Events were dropped behind a snapshot.
    #[error("map {map:?}: events up to sequence {through} are only in the snapshot")]
    Truncated {
        map: String,
        /// The last dropped sequence.
        through: u64,
    },
    /// Events are to be dropped that no snapshot holds.
    #[error("map {map:?}: no snapshot holds the events before sequence {before}")]
    NoSnapshot {
        map: String,
        /// The first sequence that would stay.
        before: u64,
    },
    /// A file of the store could not be read or written.
    #[error("{action} {path}: {message}")]
    File {
        action: &'static str,
        path: String,
        message: String,
        /// Whether it may pass by itself: no space, no descriptors or no memory was left.
        passes: bool,
    },
    /// A file does not hold what it should.
    #[error("{path}: {message}")]
    Content { path: String, message: String },
    /// Another process keeps its maps in the directory.
    #[error("{path} is in use by another server (process {holder})")]
    InUse {
        path: String,
        /// Its process id, as far as it is known.
        holder: String,
    },
    /// A folder to copy to has something in it.
    #[error("{path} is not empty")]
    NotEmpty { path: String },
    /// There is no space, no descriptor or no memory just now. Nothing was changed; the same call
    /// succeeds once there is.
    #[error("map {map:?}: the store is out of resources for now: {cause}")]
    Unavailable {
        map: String,
        /// What the system said, without the server's paths.
        cause: String,
    },
    /// The disk failed this call, or a file does not hold what it should. The log names the file.
    #[error("map {map:?}: {cause}")]
    Failed {
        map: String,
        /// What is wrong, without the server's paths.
        cause: String,
    },
    /// A later version wrote a file of the map; its files stay as they are.
    #[error("map {map:?} takes no changes: {file} was written by a later version: {reason}")]
    Later {
        map: String,
        /// The file's name inside the map's folder.
        file: String,
        /// Which version, or what is not known here.
        reason: String,
    },
    /// Several folders claim to be the map; they stay as they are until a person has chosen.
    #[error("map {map:?} takes no changes: the folders {} all claim to be it", folders.join(", "))]
    Ambiguous {
        map: String,
        /// Their names in `maps/`.
        folders: Vec<String>,
    },
    /// An fsync failed, or a write in a way that leaves unknown what is on disk: nothing more is
    /// acknowledged until the store is opened again and has looked.
    #[error("the journal of map {map:?} stopped at sequence {durable}: {cause}")]
    Stopped {
        map: String,
        /// The last sequence that is on disk for certain.
        durable: u64,
        cause: String,
    },
    /// Acknowledged events are lost; what is left can be read.
    #[error("map {map:?} takes no changes: {damage}")]
    Damaged { map: String, damage: Damage },
}

fn at(owner: Option<&str>) -> String {
    owner.map_or_else(String::new, |owner| format!(", at {owner}"))
}

/// A damaged part of a map's files.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Damage {
    /// The file, inside the data directory.
    pub file: String,
    /// The first byte that cannot be read.
    pub offset: u64,
    /// The first and last sequence that are lost; `None` where a snapshot or a later file still has
    /// everything.
    pub lost: Option<(u64, u64)>,
    /// The event that cannot be read although its bytes are intact; `None` where the bytes are not.
    pub unreadable: Option<Box<UnreadableEvent>>,
}

/// An event whose bytes are those that were written, and which this version cannot read or apply.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct UnreadableEvent {
    /// Its sequence in the journal.
    pub sequence: u64,
    /// [`Change::name`](covis_map::Change::name), or `unknown`.
    pub kind: &'static str,
    /// What is wrong with it.
    pub reason: String,
    /// Whether a later version wrote it.
    pub is_later: bool,
}

impl Damage {
    /// Damage of a part of a file in which bytes are not those that were written.
    #[must_use]
    pub(super) fn of_bytes(file: String, offset: u64, lost: Option<(u64, u64)>) -> Self {
        Self { file, offset, lost, unreadable: None }
    }
}

impl fmt::Display for Damage {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { file, offset, lost, unreadable } = self;
        if let Some(UnreadableEvent { sequence, kind, reason, .. }) = unreadable.as_deref() {
            write!(
                f,
                "{file} at byte {offset}: event {sequence} ({kind}) cannot be read: {reason}"
            )?;
            return match lost {
                Some((first, last)) if first < last => {
                    write!(f, "; events {first} to {last} are not in the map")
                }
                Some(_) => write!(f, "; it is not in the map"),
                None => write!(f, "; a snapshot holds what it changed"),
            };
        }
        match lost {
            Some((first, last)) => {
                write!(f, "{file} is damaged at byte {offset}: events {first} to {last} are lost")
            }
            None => write!(f, "{file} is damaged at byte {offset}, nothing is lost"),
        }
    }
}
