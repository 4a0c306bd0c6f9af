//! Journals and snapshots as files in a data directory; why so is in decision 0011.
//!
//! ```text
//! DIR/LOCK                      held by the one server that uses it
//! DIR/maps/UID/map              the map's name; a client's text never becomes a path
//! DIR/maps/UID/SEQUENCE.log     journal, from this sequence on
//! DIR/maps/UID/SEQUENCE.snap    the map at this sequence; the newest two are kept
//! DIR/maps/UID/durable          how far the journal was synced when it was idle last
//! DIR/maps/UID/*.bad            damaged files that were set aside, kept for people
//! DIR/set-aside/UID.bad         maps of which nothing could be brought back
//! ```
//!
//! Each map has its own files, so that damage stays in one map. Blocking work runs on tokio's
//! blocking threads. Everything goes through the trait [`disk::Disk`], by which the tests stage
//! crashes and faults at every operation.
//!
//! | module | role |
//! |---|---|
//! | `disk`, `lock` | the file system; one server a directory |
//! | `record`, `sealed` | the bytes of journals, and of files that are written once |
//! | `load`, `read` | opening a map's folder, reading events and snapshots |
//! | `journal` | a map's writer: groups, the mark, failures |
//! | `doctor` | looking at a directory without a server, repairing it |
//! | `backup` | copying a directory while a server writes to it |

mod backup;
mod disk;
mod doctor;
#[cfg(any(test, feature = "fuzzing"))]
pub(in crate::store) mod fuzzing;
mod journal;
mod load;
mod lock;
mod read;
mod reader;
mod record;
mod sealed;

pub use self::backup::back_up;
pub use self::doctor::{MapCheckup, check_up};

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::{SystemTime, UNIX_EPOCH};

use async_trait::async_trait;
use sha2::{Digest as _, Sha256};
use tokio::sync::watch;

use self::disk::{Disk, RealDisk};
use self::journal::Journal;
use self::lock::DirectoryLock;
use self::record::Uid;
use super::encoding::{decode_identity, encode_identity};
use super::{
    Damage, Durability, Epoch, EventReader, Flushed, Position, Store, StoreError, StoreMeters,
    sequence_of,
};
use crate::map::{Event, Map};

/// How files are cut.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct FileStoreOptions {
    /// A journal file of this size is followed by another one (64 MiB).
    pub segment_bytes: u64,
    /// A snapshot is due once the journal has grown by this (64 MiB).
    pub snapshot_bytes: u64,
}

impl Default for FileStoreOptions {
    fn default() -> Self {
        Self { segment_bytes: 64 << 20, snapshot_bytes: 64 << 20 }
    }
}

/// Maps in a data directory. What it accepts survives a loss of power once
/// [`Store::follow`] says so.
#[derive(Debug)]
pub struct FileStore {
    disk: Arc<dyn Disk>,
    root: PathBuf,
    options: FileStoreOptions,
    meters: Arc<StoreMeters>,
    maps: Mutex<BTreeMap<String, Arc<Journal>>>,
    /// Maps are created and deleted one at a time.
    changing: tokio::sync::Mutex<()>,
    last_epoch: AtomicU64,
    lock: Mutex<Option<DirectoryLock>>,
}

impl FileStore {
    /// Opens a data directory and creates it where it is missing.
    ///
    /// # Errors
    /// [`StoreError::InUse`] where another server uses it, [`StoreError::File`].
    pub async fn open(directory: &Path, options: FileStoreOptions) -> Result<Self, StoreError> {
        let root = directory.to_owned();
        blocking(move || {
            create_root(&RealDisk, &root)?;
            let lock = DirectoryLock::take(&root)?;
            Self::on(Arc::new(RealDisk), root, options, Some(lock))
        })
        .await
    }

    /// Opens a directory of `disk`. Blocks.
    fn on(
        disk: Arc<dyn Disk>,
        root: PathBuf,
        options: FileStoreOptions,
        lock: Option<DirectoryLock>,
    ) -> Result<Self, StoreError> {
        create_root(&*disk, &root)?;
        let folder = root.join("maps");
        let (mut maps, meters) = (BTreeMap::new(), Arc::default());
        let listed = disk.list(&folder).map_err(|e| file_error("cannot list", &folder, &e))?;
        for name in listed {
            let path = folder.join(&name);
            if let Some((name, uid)) = identity(&*disk, &path)? {
                let journal = Journal::new(&name, uid, path, Arc::clone(&disk), options, &meters);
                maps.insert(name, Arc::new(journal));
            }
        }
        Ok(Self {
            disk,
            root,
            options,
            meters,
            maps: Mutex::new(maps),
            changing: tokio::sync::Mutex::new(()),
            last_epoch: AtomicU64::new(0),
            lock: Mutex::new(lock),
        })
    }

    /// What it counts.
    #[must_use]
    pub fn meters(&self) -> Arc<StoreMeters> {
        Arc::clone(&self.meters)
    }

    fn maps(&self) -> MutexGuard<'_, BTreeMap<String, Arc<Journal>>> {
        self.maps.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// The journal of a map, its folder read.
    async fn journal(&self, map: &str) -> Result<Arc<Journal>, StoreError> {
        let journal = self.maps().get(map).cloned();
        let journal = journal.ok_or_else(|| StoreError::UnknownMap { map: map.to_owned() })?;
        if journal.state().loaded {
            return Ok(journal);
        }
        let _exclusive = journal.exclusive.lock().await;
        if !journal.state().loaded {
            let loading = Arc::clone(&journal);
            blocking(move || {
                let Journal { disk, folder, uid, .. } = &*loading;
                load::load(&**disk, folder, uid).map(|found| loading.loaded(found))
            })
            .await?;
        }
        drop(_exclusive);
        Ok(journal)
    }

    fn next_epoch(&self) -> Epoch {
        Epoch(self.last_epoch.fetch_add(1, Ordering::AcqRel) + 1)
    }

    /// The folder of a map that is about to be created: no text of a client, and never used before.
    fn new_folder(&self, map: &str) -> (Uid, PathBuf) {
        let since = SystemTime::now().duration_since(UNIX_EPOCH).unwrap_or_default();
        let mut hash = Sha256::new();
        hash.update(since.as_nanos().to_le_bytes());
        hash.update(self.last_epoch.load(Ordering::Acquire).to_le_bytes());
        hash.update(map.as_bytes());
        let mut uid = Uid::default();
        uid.iter_mut().zip(hash.finalize()).for_each(|(byte, hashed)| *byte = hashed);
        let name: String = uid.iter().map(|byte| format!("{byte:02x}")).collect();
        (uid, self.root.join("maps").join(name))
    }
}

/// Creates the data directory where it is missing, so that it is still there after a loss of power.
fn create_root(disk: &dyn Disk, root: &Path) -> Result<(), StoreError> {
    let failed = |error| file_error("cannot create", root, &error);
    let missing = root.ancestors().take_while(|folder| disk.list(folder).is_err()).count();
    disk.create_folder(&root.join("maps")).map_err(failed)?;
    // The folder above holds the name; where it may not be opened, the name is older than this.
    for folder in root.ancestors().skip(1).take(missing.max(1)) {
        let folder = if folder.as_os_str().is_empty() { Path::new(".") } else { folder };
        match disk.sync_folder(folder) {
            Err(error) if error.kind() == std::io::ErrorKind::PermissionDenied => {}
            synced => synced.map_err(failed)?,
        }
    }
    disk.sync_folder(root).map_err(failed)
}

/// The map of a folder; what an unfinished creation or deletion left is removed. A folder whose name
/// is lost is told and left alone: it is no reason to keep the other maps from opening.
fn identity(disk: &dyn Disk, folder: &Path) -> Result<Option<(String, Uid)>, StoreError> {
    let path = folder.join("map");
    let names = disk.list(folder).map_err(|e| file_error("cannot list", folder, &e))?;
    let unfinished = names.iter().all(|name| name.ends_with(".tmp"));
    if folder.extension().is_some() || unfinished {
        disk.remove_folder(folder).map_err(|e| file_error("cannot remove", folder, &e))?;
        return Ok(None);
    }
    let read = || -> Result<(String, Uid), String> {
        let mut file = disk.stream(&path).map_err(|error| error.to_string())?;
        let (label, body) = sealed::read_identity(&mut file).map_err(|error| error.to_string())?;
        Ok((decode_identity(&body).map_err(|error| error.to_string())?, label.uid))
    };
    match read() {
        Ok(identity) => Ok(Some(identity)),
        Err(reason) => {
            tracing::error!(file = %path.display(), reason, "a map has lost its name, it is not opened");
            Ok(None)
        }
    }
}

#[async_trait]
impl Store for FileStore {
    async fn list_maps(&self) -> Result<Vec<String>, StoreError> {
        Ok(self.maps().keys().cloned().collect())
    }

    async fn create_map(&self, map: &str) -> Result<Epoch, StoreError> {
        let _changing = self.changing.lock().await;
        if self.maps().contains_key(map) {
            return Err(StoreError::MapExists { map: map.to_owned() });
        }
        let epoch = self.next_epoch();
        let (uid, folder) = self.new_folder(map);
        let (disk, name) = (Arc::clone(&self.disk), map.to_owned());
        let (options, meters) = (self.options, &self.meters);
        let journal = Journal::new(map, uid, folder.clone(), Arc::clone(&disk), options, meters);
        let maps = self.root.join("maps");
        blocking(move || {
            let failed = |error| file_error("cannot create", &folder, &error);
            disk.create_folder(&folder).map_err(failed)?;
            let path = folder.join("map");
            let written = sealed::write_identity(&*disk, &path, &uid, &encode_identity(&name))
                .and_then(|()| disk.sync_folder(&maps).map_err(failed));
            if written.is_err() {
                // What is left of it is no map, or one without events; both go at the next opening.
                let _left = disk.remove_folder(&folder);
            }
            written
        })
        .await?;
        journal.loaded(load::Found::default());
        journal.state().epoch = epoch;
        self.maps().insert(map.to_owned(), Arc::new(journal));
        Ok(epoch)
    }

    async fn delete_map(&self, map: &str) -> Result<(), StoreError> {
        let _changing = self.changing.lock().await;
        let journal = self.maps().get(map).cloned();
        let journal = journal.ok_or_else(|| StoreError::UnknownMap { map: map.to_owned() })?;
        let maps = self.root.join("maps");
        let deleting = Arc::clone(&journal);
        blocking(move || {
            let Journal { disk, folder, .. } = &*deleting;
            let gone = folder.with_extension("deleted");
            disk.rename(folder, &gone)
                .and_then(|()| disk.sync_folder(&maps))
                .map_err(|error| file_error("cannot delete", folder, &error))?;
            deleting.stop("the map was deleted".to_owned());
            // The map is gone by now; what is left of its files goes at the next opening.
            if let Err(error) = disk.remove_folder(&gone) {
                tracing::warn!(%error, "files of a deleted map are left");
            }
            Ok(())
        })
        .await?;
        self.maps().remove(map);
        Ok(())
    }

    async fn acquire(&self, map: &str) -> Result<Epoch, StoreError> {
        let journal = self.journal(map).await?;
        let epoch = self.next_epoch();
        let mut state = journal.state();
        // Two calls may meet here in either order; the newer epoch wins.
        state.epoch = state.epoch.max(epoch);
        Ok(epoch)
    }

    async fn append(
        &self,
        map: &str,
        epoch: Epoch,
        expected_sequence: u64,
        batch: Vec<Arc<Event>>,
    ) -> Result<Position, StoreError> {
        let journal = self.journal(map).await?;
        journal.wait_for_room().await;
        let (position, starts) = journal.accept(epoch, expected_sequence, batch)?;
        if starts {
            tokio::task::spawn_blocking(move || journal.flush());
        }
        Ok(position)
    }

    async fn follow(&self, map: &str) -> Result<watch::Receiver<Flushed>, StoreError> {
        Ok(self.journal(map).await?.follow())
    }

    async fn read(&self, map: &str, from: u64) -> Result<Vec<Arc<Event>>, StoreError> {
        let journal = self.journal(map).await?;
        let (dropped, last) = {
            let state = journal.state();
            (state.dropped, state.last)
        };
        if from < dropped {
            return Err(StoreError::Truncated { map: map.to_owned(), through: dropped });
        }
        if let Some(events) = journal.recent(from) {
            return Ok(events);
        }
        // A journal that stopped still reads what it has.
        let _stopped = journal.settle().await;
        blocking(move || read::events(&journal, from, last)).await
    }

    async fn reader(
        &self,
        map: &str,
        from: u64,
        through: u64,
    ) -> Result<Box<dyn EventReader>, StoreError> {
        Ok(Box::new(reader::Reader::new(self.journal(map).await?, from, through)))
    }

    async fn put_snapshot(
        &self,
        map: &str,
        epoch: Epoch,
        snapshot: Arc<Map>,
    ) -> Result<(), StoreError> {
        let journal = self.journal(map).await?;
        let sequence = sequence_of(snapshot.revision());
        let _exclusive = journal.exclusive.lock().await;
        {
            let state = journal.state();
            journal.check_epoch(&state, epoch)?;
            if sequence > state.last {
                let (map, expected) = (map.to_owned(), state.last);
                return Err(StoreError::SequenceMismatch { map, expected, actual: sequence });
            }
            if state.snapshots.last().is_some_and(|&newest| newest >= sequence) {
                return Ok(());
            }
        }
        // A snapshot must not hold what a crash could still take from the journal.
        journal.settle().await?;
        let journal = Arc::clone(&journal);
        blocking(move || read::put_snapshot(&journal, &snapshot)).await
    }

    async fn get_snapshot(&self, map: &str) -> Result<Option<Arc<Map>>, StoreError> {
        let journal = self.journal(map).await?;
        blocking(move || read::newest_snapshot(&journal)).await
    }

    async fn damage(&self, map: &str) -> Result<Vec<Damage>, StoreError> {
        Ok(self.journal(map).await?.state().damage.clone())
    }

    async fn truncate(&self, map: &str, epoch: Epoch, before: u64) -> Result<(), StoreError> {
        let journal = self.journal(map).await?;
        let through = before.saturating_sub(1);
        {
            let mut state = journal.state();
            journal.check_epoch(&state, epoch)?;
            if through <= state.dropped {
                return Ok(());
            }
            if state.snapshots.last().is_none_or(|&newest| newest < through) {
                return Err(StoreError::NoSnapshot { map: map.to_owned(), before });
            }
            state.dropped = through.min(state.last);
        }
        blocking(move || {
            let dropped = journal.drop_before(before);
            dropped.map_err(|error| file_error("cannot drop files of", &journal.folder, &error))
        })
        .await
    }

    async fn close(&self) {
        let maps: Vec<Arc<Journal>> = self.maps().values().cloned().collect();
        for journal in maps {
            // No snapshot is being written from here on.
            let _exclusive = journal.exclusive.lock().await;
            // A journal that failed has told so.
            let _failed = journal.settle().await;
            let closing = Arc::clone(&journal);
            let closed = blocking(move || {
                closing.close();
                Ok(())
            });
            if let Err(error) = closed.await {
                tracing::warn!(map = journal.name, %error, "a journal was not closed");
            }
        }
        *self.lock.lock().unwrap_or_else(PoisonError::into_inner) = None;
    }

    fn durability(&self) -> Durability {
        Durability::Disk
    }
}

/// The name of a journal's mark.
const MARK: &str = "durable";

/// Runs blocking work on a thread for it.
async fn blocking<T: Send + 'static>(
    work: impl FnOnce() -> Result<T, StoreError> + Send + 'static,
) -> Result<T, StoreError> {
    match tokio::task::spawn_blocking(work).await {
        Ok(result) => result,
        Err(error) => Err(StoreError::File {
            action: "cannot finish work on",
            path: "the store".to_owned(),
            message: error.to_string(),
        }),
    }
}

fn file_error(action: &'static str, path: &Path, error: &std::io::Error) -> StoreError {
    StoreError::File { action, path: path.display().to_string(), message: error.to_string() }
}

/// The name of the journal file that begins with `first`; names sort as their sequences.
fn journal_name(first: u64) -> String {
    format!("{first:020}.log")
}

fn snapshot_name(sequence: u64) -> String {
    format!("{sequence:020}.snap")
}

/// The sequence in a name that such a function made.
fn sequence_in(name: &str, extension: &str) -> Option<u64> {
    let digits = name.strip_suffix(extension)?;
    let is_ours = digits.len() == 20 && digits.bytes().all(|byte| byte.is_ascii_digit());
    if is_ours { digits.parse().ok() } else { None }
}

#[cfg(test)]
mod tests;
