//! A disk in memory that loses power, tears writes and fails on demand.
//!
//! The contents of files and the names in folders exist twice: as they are now, and as they were
//! last synced. A crash stops every operation. [`FaultyDisk::after`] is the disk that the next
//! start finds after a loss of power, with none, all or some of what was not synced.
//! [`FaultyDisk::killed`] is the disk after only the process ended: everything written is there,
//! but no more of it is synced. After a failed sync the bytes are readable but never synced, unless
//! they are written again.

use std::collections::BTreeMap;
use std::io::{self, ErrorKind};
use std::path::{Component, Path};
use std::sync::{Arc, Mutex, MutexGuard};

use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

use crate::files::disk::{Disk, DiskFile};

#[derive(Clone, Debug)]
enum Node {
    /// `clean` bytes were in the file when a sync failed: the system treats them as written.
    File {
        data: Vec<u8>,
        synced: Vec<u8>,
        clean: usize,
    },
    Folder {
        names: BTreeMap<String, usize>,
        synced: BTreeMap<String, usize>,
    },
}

/// What survives of unsynced data.
#[derive(Clone, Copy, Debug)]
pub(super) enum Survives {
    Nothing,
    Everything,
    /// Some files and names, ends of files cut or with holes, by this seed.
    Some(u64),
}

/// A resource that is used up until it is released.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Shortage {
    Space,
    Descriptors,
}

/// The fault of one operation.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Fault {
    /// Power is lost: at most a part of this operation is done, and no later operation.
    Crash,
    /// The disk is full: only a part of a write is done.
    NoSpace,
    /// The operation fails, later ones work again.
    Broken,
}

#[derive(Clone, Debug)]
struct World {
    nodes: Vec<Node>,
    /// The kinds of the operations so far that change something.
    log: Vec<&'static str>,
    fault: Option<(usize, Fault)>,
    dead: bool,
    lack: Option<Shortage>,
}

/// The disk. Clones share it.
#[derive(Clone, Debug)]
pub(super) struct FaultyDisk(Arc<Mutex<World>>);

fn folder() -> Node {
    Node::Folder { names: BTreeMap::new(), synced: BTreeMap::new() }
}

fn error(kind: ErrorKind) -> io::Error {
    io::Error::new(kind, "staged by a test")
}

impl FaultyDisk {
    pub(super) fn new() -> Self {
        let world =
            World { nodes: vec![folder()], log: Vec::new(), fault: None, dead: false, lack: None };
        Self(Arc::new(Mutex::new(world)))
    }

    /// Injects a fault at the operation with this number, from 0.
    pub(super) fn stage(&self, operation: usize, fault: Fault) {
        self.world().fault = Some((operation, fault));
    }

    /// Sets which resource is used up from now on, if any.
    pub(super) fn lack(&self, lack: Option<Shortage>) {
        self.world().lack = lack;
    }

    /// The disk after the process was killed.
    pub(super) fn killed(&self) -> Self {
        let mut world = self.world().clone();
        (world.log, world.fault, world.dead) = (Vec::new(), None, false);
        Self(Arc::new(Mutex::new(world)))
    }

    /// The operations so far.
    pub(super) fn log(&self) -> Vec<&'static str> {
        self.world().log.clone()
    }

    /// The disk after a loss of power.
    pub(super) fn after(&self, survives: Survives) -> Self {
        let mut world = self.world().clone();
        let mut rng = ChaCha8Rng::seed_from_u64(match survives {
            Survives::Some(seed) => seed,
            Survives::Nothing | Survives::Everything => 0,
        });
        for node in &mut world.nodes {
            match (node, survives) {
                (Node::File { data, synced, .. }, Survives::Nothing) => data.clone_from(synced),
                (Node::Folder { names, synced }, Survives::Nothing) => names.clone_from(synced),
                (Node::File { data, synced, .. }, Survives::Everything) => synced.clone_from(data),
                (Node::Folder { names, synced }, Survives::Everything) => synced.clone_from(names),
                (Node::File { data, synced, .. }, Survives::Some(_)) => {
                    *data = torn(data, synced, &mut rng);
                    synced.clone_from(data);
                }
                (Node::Folder { names, synced }, Survives::Some(_)) => {
                    for name in names.keys().chain(synced.keys()).cloned().collect::<Vec<_>>() {
                        let from = if rng.random() { &*names } else { &*synced };
                        match from.get(&name).copied() {
                            Some(node) => names.insert(name, node),
                            None => names.remove(&name),
                        };
                    }
                    synced.clone_from(names);
                }
            }
        }
        (world.log, world.fault, world.dead) = (Vec::new(), None, false);
        Self(Arc::new(Mutex::new(world)))
    }

    /// Every file with its path.
    pub(super) fn files(&self) -> Vec<(String, Vec<u8>)> {
        let world = self.world();
        let mut found = Vec::new();
        let mut open = vec![(String::new(), 0)];
        while let Some((path, node)) = open.pop() {
            match &world.nodes[node] {
                Node::File { data, .. } => found.push((path, data.clone())),
                Node::Folder { names, .. } => {
                    open.extend(names.iter().map(|(name, &node)| (format!("{path}/{name}"), node)));
                }
            }
        }
        found.sort();
        found
    }

    /// A copy of the disk with one file changed.
    pub(super) fn with_file(&self, path: &str, change: impl FnOnce(&mut Vec<u8>)) -> Self {
        let mut world = self.after(Survives::Everything).world().clone();
        let node = world.find(Path::new(path)).unwrap();
        if let Node::File { data, synced, .. } = &mut world.nodes[node] {
            change(data);
            synced.clone_from(data);
        }
        Self(Arc::new(Mutex::new(world)))
    }

    fn world(&self) -> MutexGuard<'_, World> {
        self.0.lock().unwrap()
    }
}

/// A file of which some unsynced writes arrived.
fn torn(data: &[u8], synced: &[u8], rng: &mut ChaCha8Rng) -> Vec<u8> {
    if !data.starts_with(synced) {
        return if rng.random() { data } else { synced }.to_vec();
    }
    let mut kept = data[..rng.random_range(synced.len()..=data.len())].to_vec();
    // A page that was not written although a later one was.
    if rng.random() && kept.len() > synced.len() {
        let start = rng.random_range(synced.len()..kept.len());
        let end = rng.random_range(start..kept.len());
        kept[start..end].fill(0);
    }
    kept
}

impl World {
    fn find(&self, path: &Path) -> io::Result<usize> {
        path.components().filter(|c| *c != Component::RootDir).try_fold(0, |node, part| {
            let name = part.as_os_str().to_str().unwrap();
            let found = match &self.nodes[node] {
                Node::Folder { names, .. } => names.get(name).copied(),
                Node::File { .. } => None,
            };
            found.ok_or_else(|| error(ErrorKind::NotFound))
        })
    }

    fn names(&mut self, path: &Path) -> io::Result<&mut BTreeMap<String, usize>> {
        let node = self.find(path)?;
        match &mut self.nodes[node] {
            Node::Folder { names, .. } => Ok(names),
            Node::File { .. } => Err(error(ErrorKind::NotADirectory)),
        }
    }

    fn add(&mut self, path: &Path, node: Node) -> io::Result<usize> {
        let id = self.nodes.len();
        let name = path.file_name().unwrap().to_str().unwrap().to_owned();
        let names = self.names(path.parent().unwrap())?;
        if names.contains_key(&name) {
            return Err(error(ErrorKind::AlreadyExists));
        }
        names.insert(name, id);
        self.nodes.push(node);
        Ok(id)
    }

    /// Counts an operation; a write that fails in part gets a share of its bytes first.
    fn operation(&mut self, what: &'static str, write: Option<(usize, &[u8])>) -> io::Result<()> {
        if self.dead {
            return Err(error(ErrorKind::BrokenPipe));
        }
        let number = self.log.len();
        self.log.push(what);
        let lacking = match self.lack {
            Some(Shortage::Space) => {
                ["create folder", "create", "append", "overwrite"].contains(&what)
            }
            Some(Shortage::Descriptors) => ["create", "overwrite", "sync folder"].contains(&what),
            None => false,
        };
        if lacking {
            self.part(write);
            return Err(self.lacks());
        }
        let Some((_, fault)) = self.fault.filter(|&(at, _)| at == number) else { return Ok(()) };
        self.part(write);
        self.dead = fault == Fault::Crash;
        Err(error(if fault == Fault::NoSpace { ErrorKind::StorageFull } else { ErrorKind::Other }))
    }

    /// Writes a share of the bytes.
    fn part(&mut self, write: Option<(usize, &[u8])>) {
        if let Some((node, bytes)) = write
            && let Node::File { data, .. } = &mut self.nodes[node]
        {
            data.extend_from_slice(&bytes[..bytes.len() * 2 / 3]);
        }
    }

    fn lacks(&self) -> io::Error {
        match self.lack {
            Some(Shortage::Descriptors) => io::Error::from_raw_os_error(24),
            Some(Shortage::Space) | None => error(ErrorKind::StorageFull),
        }
    }

    fn alive(&self) -> io::Result<()> {
        if self.lack == Some(Shortage::Descriptors) {
            return Err(self.lacks());
        }
        if self.dead { Err(error(ErrorKind::BrokenPipe)) } else { Ok(()) }
    }
}

impl Disk for FaultyDisk {
    fn create_folder(&self, path: &Path) -> io::Result<()> {
        let mut world = self.world();
        world.operation("create folder", None)?;
        let mut at = std::path::PathBuf::from("/");
        for part in path.components().filter(|c| *c != Component::RootDir) {
            at.push(part);
            if world.find(&at).is_err() {
                world.add(&at, folder())?;
            }
        }
        Ok(())
    }

    fn list(&self, path: &Path) -> io::Result<Vec<String>> {
        let mut world = self.world();
        world.alive()?;
        Ok(world.names(path)?.keys().cloned().collect())
    }

    fn read(&self, path: &Path) -> io::Result<Vec<u8>> {
        let world = self.world();
        world.alive()?;
        match &world.nodes[world.find(path)?] {
            Node::File { data, .. } => Ok(data.clone()),
            Node::Folder { .. } => Err(error(ErrorKind::IsADirectory)),
        }
    }

    fn create(&self, path: &Path) -> io::Result<Box<dyn DiskFile>> {
        let mut world = self.world();
        world.operation("create", None)?;
        let node =
            world.add(path, Node::File { data: Vec::new(), synced: Vec::new(), clean: 0 })?;
        Ok(Box::new(FaultyFile { disk: self.clone(), node }))
    }

    fn open(&self, path: &Path) -> io::Result<Box<dyn DiskFile>> {
        let world = self.world();
        world.alive()?;
        let node = world.find(path)?;
        Ok(Box::new(FaultyFile { disk: self.clone(), node }))
    }

    fn overwrite(&self, path: &Path, bytes: &[u8]) -> io::Result<()> {
        let mut world = self.world();
        let done = world.operation("overwrite", None);
        let node = match world.find(path) {
            Ok(node) => node,
            Err(_) => {
                world.add(path, Node::File { data: Vec::new(), synced: Vec::new(), clean: 0 })?
            }
        };
        let count = if done.is_ok() { bytes.len() } else { bytes.len() / 2 };
        if let Node::File { data, .. } = &mut world.nodes[node] {
            data.resize(data.len().max(count), 0);
            data[..count].copy_from_slice(&bytes[..count]);
        }
        done
    }

    fn rename(&self, from: &Path, to: &Path) -> io::Result<()> {
        let mut world = self.world();
        world.operation("rename", None)?;
        let node = world.find(from)?;
        let name = |path: &Path| path.file_name().unwrap().to_str().unwrap().to_owned();
        world.names(from.parent().unwrap())?.remove(&name(from));
        world.names(to.parent().unwrap())?.insert(name(to), node);
        Ok(())
    }

    fn remove(&self, path: &Path) -> io::Result<()> {
        let mut world = self.world();
        world.operation("remove", None)?;
        world.find(path)?;
        let name = path.file_name().unwrap().to_str().unwrap();
        world.names(path.parent().unwrap())?.remove(name);
        Ok(())
    }

    fn remove_folder(&self, path: &Path) -> io::Result<()> {
        self.remove(path)
    }

    fn sync_folder(&self, path: &Path) -> io::Result<()> {
        let mut world = self.world();
        world.operation("sync folder", None)?;
        let node = world.find(path)?;
        if let Node::Folder { names, synced } = &mut world.nodes[node] {
            synced.clone_from(names);
        }
        Ok(())
    }
}

#[derive(Debug)]
struct FaultyFile {
    disk: FaultyDisk,
    node: usize,
}

impl DiskFile for FaultyFile {
    fn append(&mut self, bytes: &[u8]) -> io::Result<()> {
        let mut world = self.disk.world();
        world.operation("append", Some((self.node, bytes)))?;
        if let Node::File { data, .. } = &mut world.nodes[self.node] {
            data.extend_from_slice(bytes);
        }
        Ok(())
    }

    fn sync(&mut self) -> io::Result<()> {
        let mut world = self.disk.world();
        let done = world.operation("sync", None);
        let dead = world.dead;
        if let Node::File { data, synced, clean } = &mut world.nodes[self.node] {
            if done.is_ok() {
                let mut arrived = data.clone();
                let never = synced.len()..(*clean).min(data.len());
                arrived.get_mut(never).unwrap_or_default().fill(0);
                *synced = arrived;
            } else if !dead {
                *clean = data.len();
            }
        }
        done
    }

    fn truncate(&mut self, length: u64) -> io::Result<()> {
        let mut world = self.disk.world();
        world.operation("truncate", None)?;
        if let Node::File { data, clean, .. } = &mut world.nodes[self.node] {
            data.truncate(usize::try_from(length).unwrap());
            *clean = data.len().min(*clean);
        }
        Ok(())
    }
}
