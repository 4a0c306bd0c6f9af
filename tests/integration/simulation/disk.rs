//! A simulated disk: what was written and what was synced are two things, and any operation may be
//! the last.
//!
//! A process that crashes leaves the page cache; a loss of power leaves what was synced and, of the
//! rest, none, all or some. A sync that fails leaves the pages in the cache, marked as clean: a later
//! sync does not write them, as on Linux. Names of a folder are written apart from contents, by the
//! sync of the folder.
//!
//! Every operation that changes something has a number. [`Faults`] says at which number the machine
//! stops, and how often operations fail; a seed decides. The disk runs the store's work in place, so
//! that one thread and one clock drive everything. It knows nothing of maps or journals.

use std::io::{self, ErrorKind};
use std::ops::Range;
use std::path::{Component, Path, PathBuf};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, SystemTime, UNIX_EPOCH};

use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

use super::nodes::{Crash, FileNode, FolderNode, NameChange, Node};
use covis::store::{Disk, DiskFile};

/// What goes wrong from now on.
#[derive(Clone, Debug, Default)]
pub(crate) struct Faults {
    /// The machine stops at this operation, which is done in part at most.
    pub(crate) stop_at: Option<u64>,
    /// Share of the writes that fail, in one of a million.
    pub(crate) failing_writes: u32,
    /// Share of the syncs that fail, in one of a million.
    pub(crate) failing_syncs: u32,
    /// Operations for which the disk is full.
    pub(crate) full: Range<u64>,
    /// Operations for which no descriptor is left.
    pub(crate) no_descriptors: Range<u64>,
    /// The longest that a piece of the store's work takes.
    pub(crate) slowest: Duration,
}

#[derive(Debug)]
struct World {
    nodes: Vec<Node>,
    faults: Faults,
    rng: ChaCha8Rng,
    /// The tick of the run. The clock of a host that has just started is no measure: it begins with
    /// the real time since its last life.
    tick: u64,
    /// Operations so far, with their ticks.
    log: Vec<(u64, &'static str)>,
    stopped: bool,
    /// Handles of earlier processes are of no use.
    process: u64,
}

/// The disk. Clones share it.
#[derive(Clone, Debug)]
pub(crate) struct SimDisk(Arc<Mutex<World>>);

fn error(kind: ErrorKind) -> io::Error {
    io::Error::new(kind, "staged by the simulation")
}

impl SimDisk {
    pub(crate) fn new(seed: u64) -> Self {
        Self(Arc::new(Mutex::new(World {
            nodes: vec![Node::Folder(FolderNode::default())],
            faults: Faults::default(),
            rng: ChaCha8Rng::seed_from_u64(seed),
            tick: 0,
            log: Vec::new(),
            stopped: false,
            process: 0,
        })))
    }

    /// What goes wrong from now on.
    pub(crate) fn set(&self, faults: Faults) {
        self.world().faults = faults;
    }

    /// Sets the time, ticks since the beginning of the run.
    pub(crate) fn set_tick(&self, tick: u64) {
        self.world().tick = tick;
    }

    /// Operations so far.
    pub(crate) fn operations(&self) -> u64 {
        self.world().count()
    }

    /// The operations, each with its tick: equal for runs that are equal.
    pub(crate) fn log(&self) -> Vec<(u64, &'static str)> {
        self.world().log.clone()
    }

    /// Whether the machine has stopped.
    pub(crate) fn has_stopped(&self) -> bool {
        self.world().stopped
    }

    /// The disk as the next process finds it.
    pub(crate) fn crash(&self, crash: Crash) {
        let mut guard = self.world();
        let World { nodes, rng, .. } = &mut *guard;
        for node in nodes {
            match node {
                Node::File(file) => file.crash(crash, rng),
                Node::Folder(folder) => folder.crash(crash, rng),
            }
        }
        guard.stopped = false;
        guard.process += 1;
        guard.faults = Faults::default();
    }

    fn world(&self) -> MutexGuard<'_, World> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// What an operation is, for the faults that may hit it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Kind {
    /// Needs a descriptor.
    Open,
    /// Needs a descriptor and space.
    Create,
    Write,
    Sync,
    /// Changes names only.
    Names,
}

impl World {
    fn find(&self, path: &Path) -> io::Result<usize> {
        path.components().filter(|c| *c != Component::RootDir).try_fold(0, |node, part| {
            let name = part.as_os_str().to_str().ok_or_else(|| error(ErrorKind::InvalidInput))?;
            let found = match &self.nodes[node] {
                Node::Folder(folder) => folder.names.get(name).copied(),
                Node::File(_) => None,
            };
            found.ok_or_else(|| error(ErrorKind::NotFound))
        })
    }

    fn file(&mut self, node: usize) -> io::Result<&mut FileNode> {
        match &mut self.nodes[node] {
            Node::File(file) => Ok(file),
            Node::Folder(_) => Err(error(ErrorKind::IsADirectory)),
        }
    }

    fn folder(&mut self, path: &Path) -> io::Result<&mut FolderNode> {
        let node = self.find(path)?;
        match &mut self.nodes[node] {
            Node::Folder(folder) => Ok(folder),
            Node::File(_) => Err(error(ErrorKind::NotADirectory)),
        }
    }

    fn add(&mut self, path: &Path, node: Node) -> io::Result<usize> {
        let (parent, name) = split(path)?;
        let id = self.nodes.len();
        let folder = self.folder(parent)?;
        if folder.names.contains_key(&name) {
            return Err(error(ErrorKind::AlreadyExists));
        }
        folder.change(NameChange::Add(name, id));
        self.nodes.push(node);
        Ok(id)
    }

    fn alive(&self) -> io::Result<()> {
        if self.stopped { Err(error(ErrorKind::BrokenPipe)) } else { Ok(()) }
    }

    /// An operation that changes nothing, which still may need a descriptor.
    fn looks(&self) -> io::Result<()> {
        self.alive()?;
        if self.faults.no_descriptors.contains(&self.count()) {
            // EMFILE, which has no kind of its own.
            return Err(io::Error::from_raw_os_error(24));
        }
        Ok(())
    }

    /// Counts an operation and says whether it fails; `Err` with `true` where it is done in part.
    fn operation(&mut self, kind: Kind, what: &'static str) -> io::Result<()> {
        self.alive()?;
        let number = self.count();
        self.log.push((self.tick, what));
        if self.faults.stop_at.is_some_and(|at| number >= at) {
            self.stopped = true;
            return Err(error(ErrorKind::BrokenPipe));
        }
        let takes_space = matches!(kind, Kind::Create | Kind::Write);
        if takes_space && self.faults.full.contains(&number) {
            return Err(error(ErrorKind::StorageFull));
        }
        let takes_descriptor = matches!(kind, Kind::Create | Kind::Open);
        if takes_descriptor && self.faults.no_descriptors.contains(&number) {
            return Err(io::Error::from_raw_os_error(24));
        }
        let share = match kind {
            Kind::Sync => self.faults.failing_syncs,
            Kind::Create | Kind::Write | Kind::Names => self.faults.failing_writes,
            Kind::Open => 0,
        };
        if share > 0 && self.rng.random_range(0..1_000_000) < share {
            // EIO.
            return Err(io::Error::from_raw_os_error(5));
        }
        Ok(())
    }

    fn count(&self) -> u64 {
        self.log.len() as u64
    }
}

fn split(path: &Path) -> io::Result<(&Path, String)> {
    let parent = path.parent().ok_or_else(|| error(ErrorKind::InvalidInput))?;
    let name = path.file_name().and_then(|name| name.to_str());
    Ok((parent, name.ok_or_else(|| error(ErrorKind::InvalidInput))?.to_owned()))
}

impl Disk for SimDisk {
    /// In place, in a task of its own: before or after a wait, so that calls are cut off on either side
    /// of what they do.
    fn spawn(&self, work: Box<dyn FnOnce() + Send>) {
        let (before, after) = {
            let mut world = self.world();
            let slowest = u64::try_from(world.faults.slowest.as_micros()).unwrap_or(u64::MAX);
            let mut wait = || Duration::from_micros(world.rng.random_range(0..=slowest));
            (wait(), wait())
        };
        tokio::spawn(async move {
            tokio::time::sleep(before).await;
            work();
            tokio::time::sleep(after).await;
        });
    }

    fn now(&self) -> SystemTime {
        // Rises with every operation.
        UNIX_EPOCH + Duration::from_secs(1_700_000_000) + Duration::from_micros(self.operations())
    }

    fn create_folder(&self, path: &Path) -> io::Result<()> {
        let mut world = self.world();
        if world.find(path).is_ok() {
            return world.alive();
        }
        world.operation(Kind::Names, "create folder")?;
        let mut at = PathBuf::from("/");
        for part in path.components().filter(|c| *c != Component::RootDir) {
            at.push(part);
            if world.find(&at).is_err() {
                world.add(&at, Node::Folder(FolderNode::default()))?;
            }
        }
        Ok(())
    }

    fn list(&self, path: &Path) -> io::Result<Vec<String>> {
        let mut world = self.world();
        world.looks()?;
        Ok(world.folder(path)?.names.keys().cloned().collect())
    }

    fn read(&self, path: &Path) -> io::Result<Vec<u8>> {
        let mut world = self.world();
        world.looks()?;
        let node = world.find(path)?;
        Ok(world.file(node)?.data.clone())
    }

    fn create(&self, path: &Path) -> io::Result<Box<dyn DiskFile>> {
        let mut world = self.world();
        world.operation(Kind::Create, "create")?;
        let node = world.add(path, Node::File(FileNode::default()))?;
        let process = world.process;
        Ok(Box::new(SimFile { disk: self.clone(), node, process }))
    }

    fn open(&self, path: &Path) -> io::Result<Box<dyn DiskFile>> {
        let mut world = self.world();
        world.operation(Kind::Open, "open")?;
        let node = world.find(path)?;
        world.file(node)?;
        let process = world.process;
        Ok(Box::new(SimFile { disk: self.clone(), node, process }))
    }

    fn overwrite(&self, path: &Path, bytes: &[u8]) -> io::Result<()> {
        let mut world = self.world();
        let done = world.operation(Kind::Create, "overwrite");
        if done.as_ref().is_err_and(|e| e.kind() != ErrorKind::BrokenPipe) {
            return done;
        }
        let node = match world.find(path) {
            Ok(node) => node,
            Err(_) => world.add(path, Node::File(FileNode::default()))?,
        };
        let count = if done.is_ok() { bytes.len() } else { bytes.len() / 2 };
        world.file(node)?.write(0, &bytes[..count]);
        done
    }

    fn rename(&self, from: &Path, to: &Path) -> io::Result<()> {
        let mut world = self.world();
        world.operation(Kind::Names, "rename")?;
        let node = world.find(from)?;
        let ((from, old), (to, new)) = (split(from)?, split(to)?);
        if from == to {
            world.folder(from)?.change(NameChange::Rename(old, new, node));
        } else {
            world.folder(from)?.change(NameChange::Remove(old));
            world.folder(to)?.change(NameChange::Add(new, node));
        }
        Ok(())
    }

    fn remove(&self, path: &Path) -> io::Result<()> {
        let mut world = self.world();
        world.operation(Kind::Names, "remove")?;
        world.find(path)?;
        let (parent, name) = split(path)?;
        world.folder(parent)?.change(NameChange::Remove(name));
        Ok(())
    }

    fn remove_folder(&self, path: &Path) -> io::Result<()> {
        self.remove(path)
    }

    fn sync_folder(&self, path: &Path) -> io::Result<()> {
        let mut world = self.world();
        world.operation(Kind::Sync, "sync folder")?;
        world.folder(path)?.sync();
        Ok(())
    }
}

#[derive(Debug)]
struct SimFile {
    disk: SimDisk,
    node: usize,
    process: u64,
}

impl SimFile {
    /// The file, once the operation was counted.
    fn with(
        &self,
        kind: Kind,
        what: &'static str,
        action: impl FnOnce(&mut FileNode, Outcome),
    ) -> io::Result<()> {
        let mut world = self.disk.world();
        if world.process != self.process {
            return Err(error(ErrorKind::BrokenPipe));
        }
        let done = world.operation(kind, what);
        let outcome = match &done {
            Ok(()) => Outcome::Done,
            Err(_) if world.stopped => Outcome::Stopped,
            Err(_) => Outcome::Failed,
        };
        action(world.file(self.node)?, outcome);
        done
    }
}

/// How an operation on a file ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Outcome {
    Done,
    Failed,
    /// The machine stopped in the middle of it.
    Stopped,
}

impl DiskFile for SimFile {
    fn append(&mut self, bytes: &[u8]) -> io::Result<()> {
        self.with(Kind::Write, "append", |file, outcome| {
            // One that does not succeed is done in part.
            let is_done = outcome == Outcome::Done;
            let count = if is_done { bytes.len() } else { bytes.len() * 2 / 3 };
            file.write(file.data.len(), &bytes[..count]);
        })
    }

    fn sync(&mut self) -> io::Result<()> {
        self.with(Kind::Sync, "sync", |file, outcome| match outcome {
            Outcome::Done => file.sync(),
            // The pages count as clean: no later sync writes them.
            Outcome::Failed => file.dirty.clear(),
            Outcome::Stopped => {}
        })
    }

    fn truncate(&mut self, length: u64) -> io::Result<()> {
        // It takes no space.
        self.with(Kind::Names, "truncate", |file, outcome| {
            if outcome == Outcome::Done {
                file.truncate(usize::try_from(length).unwrap_or(usize::MAX));
            }
        })
    }
}
