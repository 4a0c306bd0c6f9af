//! Journals and snapshots as files in a data directory; decision 0011 gives the reasons.
//!
//! ```text
//! DIR/LOCK                      held by the one server that uses it
//! DIR/maps/UID/map              the map's name; a client's text never becomes a path
//! DIR/maps/UID/SEQUENCE.log     journal, from this sequence on
//! DIR/maps/UID/SEQUENCE.snap    the map at this sequence; the newest two are kept
//! DIR/maps/UID/durable          how far the journal was synced when it was idle last
//! DIR/maps/UID/*.bad            damaged files that were set aside, kept for people
//! DIR/jobs/UID/                 a job, or what was uploaded for one; see `jobs`
//! DIR/set-aside/UID.bad         maps of which nothing could be brought back
//! DIR/set-aside/UID             maps that made room for another one of the same name
//! ```
//!
//! Each map has its own files, so that damage stays in one map. Everything goes through the trait
//! [`disk::Disk`], with which the tests simulate crashes and faults at every operation; it also
//! runs all blocking work.
//!
//! | module | role |
//! |---|---|
//! | `disk`, `lock` | the file system; one server per directory |
//! | `failure` | which failures are temporary, and what callers read of them |
//! | `store` | what every store does, for the maps of a directory |
//! | `folders`, `changes` | what the folders in `maps/` are; creating and deleting maps |
//! | `record`, `sealed` | the bytes of journals, and of files that are written once |
//! | `jobs`, `job_copies` | the folders of jobs; copies of them without a server |
//! | `load` | opening a map's folder |
//! | `read` | reading events and snapshots, whole or a piece at a time |
//! | `journal`, `writer` | a map's journal: order, groups, the mark; writing them, healing, making durable what was found |
//! | `doctor` | looking at a directory without a server, repairing it |
//! | `backup` | copying a directory while a server writes to it |

mod backup;
mod changes;
mod disk;
mod doctor;
mod failure;
mod folders;
#[cfg(any(test, feature = "fuzzing"))]
pub(crate) mod fuzzing;
mod job_copies;
mod jobs;
mod journal;
mod load;
mod lock;
mod read;
mod record;
mod sealed;
mod store;
mod writer;

pub use self::backup::back_up;
pub use self::doctor::{LostEvent, MapCheckup, Repair, check_up};
#[cfg(feature = "cluster")]
pub(super) use self::folders::uid_of;
pub use self::job_copies::{JobCheckup, check_up_jobs};
pub(super) use self::jobs::JobFolders;

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::UNIX_EPOCH;

use sha2::{Digest as _, Sha256};
use tokio::sync::oneshot;

use self::disk::RealDisk;
pub use self::disk::{Disk, DiskFile};
use self::failure::{file_error, of_map};
use self::journal::Journal;
use self::lock::DirectoryLock;
use self::record::Uid;
use super::{Damage, Epoch, JobFiles, StoreError, StoreMeters};
use crate::sync::Mutex;

/// Sizes of files.
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

/// Maps in a data directory. An accepted event survives a loss of power once [`Store::follow`](super::Store::follow)
/// reports it.
#[derive(Debug)]
pub struct FileStore {
    inner: Arc<Inner>,
}

/// State for work that may outlive its caller.
#[derive(Debug)]
struct Inner {
    disk: Arc<dyn Disk>,
    root: PathBuf,
    options: FileStoreOptions,
    meters: Arc<StoreMeters>,
    maps: Mutex<BTreeMap<String, Entry>>,
    /// Maps are created and deleted one at a time.
    changing: Arc<tokio::sync::Mutex<()>>,
    last_epoch: AtomicU64,
    lock: Mutex<Option<DirectoryLock>>,
}

/// The state of a name.
#[derive(Debug)]
enum Entry {
    /// A map.
    Map(Arc<Journal>),
    /// A new map whose creator has not received the answer.
    Unclaimed(Arc<Journal>),
    /// Files that a failed creation could not remove; the next creation removes them first.
    Leftover(PathBuf),
    /// A map whose files stay as they are, and why.
    Refused(StoreError),
}

impl FileStore {
    /// Opens a data directory and creates it if it is missing.
    ///
    /// # Errors
    /// [`StoreError::InUse`] if another server uses it, [`StoreError::File`].
    pub async fn open(directory: &Path, options: FileStoreOptions) -> Result<Self, StoreError> {
        let root = directory.to_owned();
        blocking(&RealDisk, move || {
            create_root(&RealDisk, &root)?;
            let lock = DirectoryLock::take(&root)?;
            let store = Self::on(Arc::new(RealDisk), root, options)?;
            *store.inner.lock.lock() = Some(lock);
            Ok(store)
        })
        .await
    }

    /// Opens a directory of `disk`, which nobody else uses. Blocks.
    ///
    /// # Errors
    /// [`StoreError::File`].
    pub fn on(
        disk: Arc<dyn Disk>,
        root: PathBuf,
        options: FileStoreOptions,
    ) -> Result<Self, StoreError> {
        create_root(&*disk, &root)?;
        let (mut maps, meters) = (BTreeMap::new(), Arc::default());
        for (name, claim) in folders::at_start(&*disk, &root.join("maps"))? {
            let entry = match claim {
                Ok((uid, path)) => {
                    let disk = Arc::clone(&disk);
                    Entry::Map(Arc::new(Journal::new(&name, uid, path, disk, options, &meters)))
                }
                Err(error) => Entry::Refused(error),
            };
            maps.insert(name, entry);
        }
        // A deletion whose process was killed before its sync is valid from here on, so that it
        // must be durable.
        let folder = root.join("maps");
        disk.sync_folder(&folder).map_err(|error| file_error("cannot sync", &folder, &error))?;
        let inner = Inner {
            disk,
            root,
            options,
            meters,
            maps: Mutex::new(maps),
            changing: Arc::default(),
            last_epoch: AtomicU64::new(0),
            lock: Mutex::default(),
        };
        Ok(Self { inner: Arc::new(inner) })
    }

    /// The meters of the store.
    pub fn meters(&self) -> Arc<StoreMeters> {
        Arc::clone(&self.inner.meters)
    }

    /// The files of jobs in the same directory.
    pub fn job_files(&self) -> JobFiles {
        let disk = Arc::clone(&self.inner.disk);
        JobFiles::on_disk(JobFolders::new(disk, &self.inner.root))
    }

    /// The journal of a map, after its folder was read.
    async fn journal(&self, map: &str) -> Result<Arc<Journal>, StoreError> {
        let journal = self.inner.find(map)?;
        if journal.state().loaded {
            return Ok(journal);
        }
        let exclusive = Arc::clone(&journal.exclusive).lock_owned().await;
        if !journal.state().loaded {
            let loading = Arc::clone(&journal);
            let runtime = tokio::runtime::Handle::current();
            let loaded = blocking(&*self.inner.disk, move || {
                let _exclusive = exclusive;
                let Journal { disk, folder, uid, .. } = &*loading;
                let found = load::load(&**disk, folder, uid)?;
                loading.loaded(found);
                if let Some(delay) = loading.flush() {
                    let _entered = runtime.enter();
                    Journal::start_flush(loading, Some(delay));
                }
                Ok(())
            });
            loaded.await.map_err(|error| of_map(map, error))?;
        }
        Ok(journal)
    }
}

impl Inner {
    /// The journal of a map, whether its folder was read or not.
    fn find(&self, map: &str) -> Result<Arc<Journal>, StoreError> {
        match self.maps.lock().get(map) {
            Some(Entry::Map(journal)) => Ok(Arc::clone(journal)),
            Some(Entry::Refused(error)) => Err(error.clone()),
            Some(Entry::Unclaimed(_) | Entry::Leftover(_)) | None => {
                Err(StoreError::UnknownMap { map: map.to_owned() })
            }
        }
    }

    fn next_epoch(&self) -> Epoch {
        Epoch(self.last_epoch.fetch_add(1, Ordering::AcqRel) + 1)
    }

    /// The uid of a map that is about to be created: no text of a client, and never used before.
    fn new_uid(&self, map: &str) -> Uid {
        let since = self.disk.now().duration_since(UNIX_EPOCH).unwrap_or_default();
        let mut hash = Sha256::new();
        hash.update(since.as_nanos().to_le_bytes());
        hash.update(self.last_epoch.load(Ordering::Acquire).to_le_bytes());
        hash.update(map.as_bytes());
        let mut uid = Uid::default();
        uid.iter_mut().zip(hash.finalize()).for_each(|(byte, hashed)| *byte = hashed);
        uid
    }
}

/// Creates the data directory if it is missing, so that it survives a loss of power.
fn create_root(disk: &dyn Disk, root: &Path) -> Result<(), StoreError> {
    let failed = |error| file_error("cannot create", root, &error);
    let missing = root.ancestors().take_while(|folder| disk.list(folder).is_err()).count();
    disk.create_folder(&root.join("maps")).map_err(failed)?;
    // The parent folder contains the name. If the parent cannot be opened, the name existed before.
    for folder in root.ancestors().skip(1).take(missing.max(1)) {
        let folder = if folder.as_os_str().is_empty() { Path::new(".") } else { folder };
        match disk.sync_folder(folder) {
            Err(error) if error.kind() == std::io::ErrorKind::PermissionDenied => {}
            synced => synced.map_err(failed)?,
        }
    }
    disk.sync_folder(root).map_err(failed)
}

/// The folder for what no server reads.
const SET_ASIDE: &str = "set-aside";

/// The name of a journal's mark.
const MARK: &str = "durable";

/// Runs blocking work where the disk runs it. Work that has begun runs to its end, even if nobody
/// waits.
async fn blocking<T: Send + 'static>(
    disk: &dyn Disk,
    work: impl FnOnce() -> Result<T, StoreError> + Send + 'static,
) -> Result<T, StoreError> {
    let (answer, answered) = oneshot::channel();
    disk.spawn(Box::new(move || {
        // The caller may have stopped waiting.
        let _gone = answer.send(work());
    }));
    answered.await.unwrap_or_else(|_panicked| {
        Err(StoreError::File {
            action: "cannot finish work on",
            path: "the store".to_owned(),
            message: "the work panicked, or the server stops".to_owned(),
            passes: false,
        })
    })
}

/// The damage of a file of which nothing can be used.
fn whole_file(path: &Path) -> Damage {
    Damage::of_bytes(path.display().to_string(), 0, None)
}

/// The name of the journal file that begins with `first`; names sort as their sequences.
fn journal_name(first: u64) -> String {
    format!("{first:020}.log")
}

fn snapshot_name(sequence: u64) -> String {
    format!("{sequence:020}.snap")
}

/// The sequence in the name of a journal file or a snapshot.
fn sequence_in(name: &str, extension: &str) -> Option<u64> {
    let digits = name.strip_suffix(extension)?;
    let is_ours = digits.len() == 20 && digits.bytes().all(|byte| byte.is_ascii_digit());
    if is_ours { digits.parse().ok() } else { None }
}

#[cfg(test)]
mod tests;
