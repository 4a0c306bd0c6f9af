//! A machine with one disk: servers that run on it, die, and lose what they did not sync.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use rand_chacha::ChaCha8Rng;

use super::model::{Disk, Survival};
use super::trace::{Stage, library, play};
use crate::cli_support::{Port, Running, Workspace};

/// A data directory on a disk that forgets, and the servers that ran on it.
pub(super) struct Machine {
    pub(super) workspace: Workspace,
    pub(super) stage: Stage,
    library: PathBuf,
    disk: Disk,
    folder: PathBuf,
    /// Folders that were made, and servers that were started so far.
    folders: u32,
    starts: u32,
    trace: Option<PathBuf>,
}

impl Machine {
    /// A new machine; `None` where the library cannot be built.
    pub(super) fn new() -> Option<Self> {
        let library = library()?.to_owned();
        let workspace = Workspace::new();
        let stage = Stage::new(&workspace.path("stage"));
        let mut machine = Self {
            folder: PathBuf::new(),
            disk: Disk::new(),
            workspace,
            stage,
            library,
            folders: 0,
            starts: 0,
            trace: None,
        };
        machine.replace(Disk::new());
        Some(machine)
    }

    /// Another disk, of which all is durable.
    pub(super) fn replace(&mut self, disk: Disk) {
        let old = std::mem::take(&mut self.folder);
        if !old.as_os_str().is_empty() {
            fs_err::remove_dir_all(old).unwrap();
        }
        self.folders += 1;
        let folder = self.workspace.path(&format!("disk-{}", self.folders));
        disk.write_to(&folder);
        self.folder = folder.canonicalize().unwrap();
        (self.disk, self.trace) = (disk, None);
    }

    /// A server on the disk as it is now.
    pub(super) fn start(&mut self) -> Running {
        self.catch_up();
        self.starts += 1;
        let trace = self.workspace.path(&format!("trace-{}", self.starts));
        let mut command = self.workspace.command();
        command
            .env("LD_PRELOAD", &self.library)
            .env("COVIS_TEST_DISK_ROOT", &self.folder)
            .env("COVIS_TEST_DISK_TRACE", &trace)
            .env("COVIS_TEST_DISK_STAGE", self.workspace.path("stage"));
        let running = Running::spawn(command, Port::reserve(), &self.folder, &[]);
        self.trace = Some(trace);
        running
    }

    /// Plays what the last server did; it must have ended. Returns the number of changes, and of
    /// paths that the disk has otherwise than the trace says.
    pub(super) fn catch_up(&mut self) -> (usize, usize) {
        let Some(trace) = self.trace.take() else { return (0, 0) };
        let count = play(&fs_err::read(&trace).unwrap(), &mut self.disk);
        fs_err::remove_file(trace).unwrap();
        (count, adopt(&mut self.disk, &read(&self.folder)))
    }

    /// The power goes after the last server ended: the disk has what survived.
    pub(super) fn lose_power(&mut self, survival: Survival<'_>) {
        self.catch_up();
        self.replace(self.disk.lose_power(survival));
    }

    /// As [`Machine::lose_power`] with a part that a seed chooses: nothing, all, or any.
    pub(super) fn lose_some(&mut self, rng: &mut ChaCha8Rng) {
        use rand::RngExt;
        match rng.random_range(0..4) {
            0 => self.lose_power(Survival::Nothing),
            1 => self.lose_power(Survival::Everything),
            _ => self.lose_power(Survival::Random(rng)),
        }
    }

    /// A copy of the disk as it is now, for a look that changes nothing.
    pub(super) fn copy(&mut self) -> PathBuf {
        self.catch_up();
        let path = self.workspace.path("copy");
        self.disk.write_to(&path);
        path
    }
}

type Contents = BTreeMap<String, Option<Vec<u8>>>;

fn read(folder: &Path) -> Contents {
    let mut found = Contents::new();
    let mut folders = vec![String::new()];
    while let Some(inside) = folders.pop() {
        for entry in fs_err::read_dir(folder.join(&inside)).unwrap() {
            let entry = entry.unwrap();
            let name = entry.file_name().into_string().unwrap();
            let path = if inside.is_empty() { name } else { format!("{inside}/{name}") };
            if entry.file_type().unwrap().is_dir() {
                folders.push(path.clone());
                found.insert(path, None);
            } else {
                found.insert(path, Some(fs_err::read(entry.path()).unwrap()));
            }
        }
    }
    found
}

/// Takes over what a kill left without a record: the last change. Returns how many paths differed.
fn adopt(disk: &mut Disk, real: &Contents) -> usize {
    let known = disk.contents();
    let added: Vec<&String> = real.keys().filter(|path| !known.contains_key(*path)).collect();
    let removed: Vec<&String> = known.keys().filter(|path| !real.contains_key(*path)).collect();
    let changed = |path: &&String| known.get(*path).is_some_and(|bytes| *bytes != real[*path]);
    let changed: Vec<&String> = real.keys().filter(changed).collect();
    if let (Some(from), Some(to)) = (removed.first(), added.first()) {
        disk.rename(from, to);
        assert_eq!(disk.contents(), *real, "more than one change is in no record");
        return 1;
    }
    for path in removed.iter().rev() {
        disk.remove(path);
    }
    for path in &added {
        match &real[*path] {
            Some(bytes) => {
                let id = disk.create_file(path);
                disk.write(id, 0, bytes);
            }
            None => disk.create_folder(path),
        }
    }
    for path in &changed {
        let (id, bytes) = (disk.find(path).unwrap(), real[*path].as_ref().unwrap());
        let old = known[*path].as_ref().unwrap();
        let same = old.iter().zip(bytes).take_while(|(a, b)| a == b).count();
        if bytes.len() < old.len() {
            disk.cut(id, bytes.len());
        }
        disk.write(id, same.min(bytes.len()), &bytes[same.min(bytes.len())..]);
    }
    added.len() + removed.len() + changed.len()
}
