//! A folder as a disk has it: what was synced apart from what was only written.
//!
//! Bytes survive a loss of power once their file was synced, a name once the folder that holds it was.
//! Of the rest nothing, everything or any part may survive, torn in sectors. After a sync that failed
//! the bytes it was for stay readable and are never written by a later sync: only writing them again
//! brings them to the disk (as Linux does since the pages count as clean). A rename is one change.

use std::collections::{BTreeMap, BTreeSet};
use std::ops::Range;
use std::path::Path;

use rand::RngExt;
use rand_chacha::ChaCha8Rng;

/// A disk writes a sector whole or not at all.
const SECTOR: usize = 512;

/// A file or folder, whatever its names are.
pub(crate) type Id = usize;
/// The root, which is durable.
const ROOT: Id = 0;

/// What is left of what was not synced.
#[derive(Debug)]
pub(crate) enum Survival<'a> {
    Nothing,
    Everything,
    Random(&'a mut ChaCha8Rng),
}

/// The model of one folder.
#[derive(Clone, Debug)]
pub(crate) struct Disk {
    nodes: Vec<Node>,
    /// Changes of names whose folders were not synced since.
    names: Vec<Rename>,
}

#[derive(Clone, Debug)]
enum Node {
    File(File),
    Folder { now: BTreeMap<String, Id>, synced: BTreeMap<String, Id> },
}

#[derive(Clone, Debug, Default)]
struct File {
    now: Vec<u8>,
    synced: Vec<u8>,
    /// Since the last sync that succeeded.
    edits: Vec<Edit>,
    /// Bytes of `now` that a failed sync left behind.
    lost: Vec<Range<usize>>,
}

#[derive(Clone, Debug)]
enum Edit {
    Write { at: usize, bytes: Vec<u8> },
    Cut { length: usize },
}

/// One change of names; it is durable when the folder that it was last made in is synced.
#[derive(Clone, Debug)]
struct Rename {
    folder: Id,
    entries: Vec<(Id, String, Option<Id>)>,
}

impl Disk {
    /// An empty folder.
    pub(crate) fn new() -> Self {
        Self { nodes: vec![Node::folder()], names: Vec::new() }
    }

    pub(crate) fn find(&self, path: &str) -> Option<Id> {
        path.split('/').filter(|part| !part.is_empty()).try_fold(ROOT, |id, part| {
            match &self.nodes[id] {
                Node::Folder { now, .. } => now.get(part).copied(),
                Node::File(_) => None,
            }
        })
    }

    /// The folder that holds a path, and the path's last name.
    fn place(&self, path: &str) -> (Id, String) {
        let (folder, name) = path.rsplit_once('/').unwrap_or(("", path));
        (self.find(folder).unwrap_or_else(|| panic!("no folder of {path}")), name.to_owned())
    }

    /// What a folder holds; `None` where it is a file.
    pub(crate) fn names(&self, id: Id) -> Option<&BTreeMap<String, Id>> {
        match &self.nodes[id] {
            Node::Folder { now, .. } => Some(now),
            Node::File(_) => None,
        }
    }

    /// What a file holds; `None` where it is a folder.
    pub(crate) fn bytes(&self, id: Id) -> Option<&[u8]> {
        match &self.nodes[id] {
            Node::File(file) => Some(&file.now),
            Node::Folder { .. } => None,
        }
    }

    fn names_of(&mut self, folder: Id) -> &mut BTreeMap<String, Id> {
        match &mut self.nodes[folder] {
            Node::Folder { now, .. } => now,
            Node::File(_) => panic!("a file has no names"),
        }
    }

    fn file(&mut self, id: Id) -> &mut File {
        match &mut self.nodes[id] {
            Node::File(file) => file,
            Node::Folder { .. } => panic!("a folder has no bytes"),
        }
    }

    /// One change of names: what each entry names from now on, or that it is gone.
    pub(crate) fn change(&mut self, entries: Vec<(Id, String, Option<Id>)>) {
        for (folder, name, id) in &entries {
            let names = self.names_of(*folder);
            match id {
                Some(id) => names.insert(name.clone(), *id),
                None => names.remove(name),
            };
        }
        let folder = entries.last().expect("a change").0;
        self.names.push(Rename { folder, entries });
    }

    fn create(&mut self, path: &str, node: Node) -> Id {
        let (folder, name) = self.place(path);
        self.add(folder, name, node)
    }

    fn add(&mut self, folder: Id, name: String, node: Node) -> Id {
        let id = self.nodes.len();
        self.nodes.push(node);
        self.change(vec![(folder, name, Some(id))]);
        id
    }

    pub(crate) fn add_file(&mut self, folder: Id, name: String) -> Id {
        self.add(folder, name, Node::File(File::default()))
    }

    pub(crate) fn add_folder(&mut self, folder: Id, name: String) -> Id {
        self.add(folder, name, Node::folder())
    }

    pub(crate) fn create_file(&mut self, path: &str) -> Id {
        self.create(path, Node::File(File::default()))
    }

    pub(crate) fn create_folder(&mut self, path: &str) {
        self.create(path, Node::folder());
    }

    pub(crate) fn remove(&mut self, path: &str) {
        let (folder, name) = self.place(path);
        self.change(vec![(folder, name, None)]);
    }

    pub(crate) fn rename(&mut self, from: &str, to: &str) {
        let id = self.find(from).unwrap_or_else(|| panic!("no {from}"));
        let (from, to) = (self.place(from), self.place(to));
        self.change(vec![(from.0, from.1, None), (to.0, to.1, Some(id))]);
    }

    pub(crate) fn link(&mut self, from: &str, to: &str) {
        let id = self.find(from).unwrap_or_else(|| panic!("no {from}"));
        let (folder, name) = self.place(to);
        self.change(vec![(folder, name, Some(id))]);
    }

    pub(crate) fn write(&mut self, id: Id, at: usize, bytes: &[u8]) {
        let file = self.file(id);
        write_over(&mut file.now, at, bytes);
        file.lost = without(&file.lost, &(at..at + bytes.len()));
        file.edits.push(Edit::Write { at, bytes: bytes.to_vec() });
    }

    pub(crate) fn cut(&mut self, id: Id, length: usize) {
        let file = self.file(id);
        file.now.resize(length, 0);
        file.lost = without(&file.lost, &(length..usize::MAX));
        file.edits.push(Edit::Cut { length });
    }

    /// A sync of a file or folder that succeeded.
    pub(crate) fn sync(&mut self, id: Id) {
        match &mut self.nodes[id] {
            Node::File(file) => file.sync(),
            Node::Folder { .. } => {
                let pending = std::mem::take(&mut self.names);
                for change in pending {
                    if change.folder == id { self.settle(&change) } else { self.names.push(change) }
                }
            }
        }
    }

    /// A sync that brings the names of the file and of the folders above along, as filesystems with a
    /// journal of their metadata do; with them what happened to the same names before.
    pub(crate) fn sync_with_names(&mut self, id: Id) {
        self.sync(id);
        let mut wanted = BTreeSet::from([id]);
        while let Some(folder) = self.holder(&wanted) {
            wanted.insert(folder);
        }
        let (mut touched, mut chosen) = (BTreeSet::new(), BTreeSet::new());
        for (index, change) in self.names.iter().enumerate().rev() {
            let is_meant = |(folder, name, named): &(Id, String, Option<Id>)| {
                named.is_some_and(|id| wanted.contains(&id))
                    || touched.contains(&(*folder, name.clone()))
            };
            if change.entries.iter().any(is_meant) {
                chosen.insert(index);
                let entries = change.entries.iter();
                touched.extend(entries.map(|(folder, name, _)| (*folder, name.clone())));
            }
        }
        for (index, change) in std::mem::take(&mut self.names).into_iter().enumerate() {
            if chosen.contains(&index) { self.settle(&change) } else { self.names.push(change) }
        }
    }

    /// A folder that holds one of these and is none of them.
    fn holder(&self, ids: &BTreeSet<Id>) -> Option<Id> {
        (0..self.nodes.len()).filter(|id| !ids.contains(id)).find(|&id| {
            self.names(id).is_some_and(|names| names.values().any(|held| ids.contains(held)))
        })
    }

    /// A sync that failed.
    pub(crate) fn fail_sync(&mut self, id: Id) {
        let Node::File(file) = &mut self.nodes[id] else { return };
        for edit in &file.edits {
            if let Edit::Write { at, bytes } = edit {
                let end = (at + bytes.len()).min(file.now.len());
                if *at < end {
                    file.lost = without(&file.lost, &(*at..end));
                    file.lost.push(*at..end);
                }
            }
        }
    }

    fn settle(&mut self, change: &Rename) {
        for (folder, name, id) in &change.entries {
            if let Node::Folder { synced, .. } = &mut self.nodes[*folder] {
                match id {
                    Some(id) => synced.insert(name.clone(), *id),
                    None => synced.remove(name),
                };
            }
        }
    }

    /// What a loss of power leaves: a folder of which all is durable.
    pub(crate) fn lose_power(&self, mut survival: Survival<'_>) -> Self {
        let mut left = self.clone();
        for change in std::mem::take(&mut left.names) {
            if survival.keeps() {
                left.settle(&change);
            }
        }
        for node in &mut left.nodes {
            match node {
                Node::Folder { now, synced } => now.clone_from(synced),
                Node::File(file) => {
                    let bytes = file.left(&mut survival);
                    *file = File { now: bytes.clone(), synced: bytes, ..File::default() };
                }
            }
        }
        left
    }

    /// Every path below the root, with the bytes of files.
    pub(crate) fn contents(&self) -> BTreeMap<String, Option<Vec<u8>>> {
        let mut found = BTreeMap::new();
        self.walk(ROOT, "", &mut found);
        found
    }

    fn walk(&self, id: Id, path: &str, found: &mut BTreeMap<String, Option<Vec<u8>>>) {
        let Node::Folder { now, .. } = &self.nodes[id] else { return };
        for (name, &id) in now {
            let path = if path.is_empty() { name.clone() } else { format!("{path}/{name}") };
            let bytes = match &self.nodes[id] {
                Node::File(file) => Some(file.now.clone()),
                Node::Folder { .. } => None,
            };
            found.insert(path.clone(), bytes);
            self.walk(id, &path, found);
        }
    }

    /// Writes what there is now into a folder that is made anew.
    pub(crate) fn write_to(&self, folder: &Path) {
        let _missing = fs_err::remove_dir_all(folder);
        fs_err::create_dir_all(folder).unwrap();
        for (path, bytes) in self.contents() {
            match bytes {
                Some(bytes) => fs_err::write(folder.join(path), bytes).unwrap(),
                None => fs_err::create_dir(folder.join(path)).unwrap(),
            }
        }
    }
}

impl Node {
    fn folder() -> Self {
        Self::Folder { now: BTreeMap::new(), synced: BTreeMap::new() }
    }
}

impl File {
    fn sync(&mut self) {
        // A file is not copied for what was added to it.
        if self.lost.is_empty() {
            for edit in self.edits.drain(..) {
                match edit {
                    Edit::Write { at, bytes } => write_over(&mut self.synced, at, &bytes),
                    Edit::Cut { length } => self.synced.resize(length, 0),
                }
            }
            return;
        }
        let mut durable = self.now.clone();
        self.edits.clear();
        for range in &self.lost {
            for at in range.clone() {
                durable[at] = self.synced.get(at).copied().unwrap_or(0);
            }
            let bytes = self.now[range.clone()].to_vec();
            self.edits.push(Edit::Write { at: range.start, bytes });
        }
        // A length may be on the disk without its bytes; the shorter file is the other possibility.
        if let Some(end) = self.lost.iter().find(|range| range.end == self.now.len()) {
            durable.truncate(end.start.max(self.synced.len().min(end.end)));
        }
        self.synced = durable;
    }

    fn left(&self, survival: &mut Survival<'_>) -> Vec<u8> {
        let mut bytes = self.synced.clone();
        match survival {
            Survival::Nothing => {}
            Survival::Everything => bytes.clone_from(&self.now),
            Survival::Random(rng) => {
                for edit in &self.edits {
                    match edit {
                        Edit::Cut { length } if rng.random_bool(0.5) => bytes.resize(*length, 0),
                        Edit::Cut { .. } => {}
                        Edit::Write { at, bytes: new } => tear(&mut bytes, *at, new, rng),
                    }
                }
            }
        }
        bytes
    }
}

impl Survival<'_> {
    fn keeps(&mut self) -> bool {
        match self {
            Self::Nothing => false,
            Self::Everything => true,
            Self::Random(rng) => rng.random_bool(0.5),
        }
    }
}

/// A write of which nothing, all, the beginning, some sectors or the length alone is left.
fn tear(file: &mut Vec<u8>, at: usize, new: &[u8], rng: &mut ChaCha8Rng) {
    match rng.random_range(0..5) {
        0 => {}
        1 => write_over(file, at, new),
        2 => write_over(file, at, &new[..rng.random_range(0..=new.len())]),
        3 => {
            let (mut start, end) = (at, at + new.len());
            while start < end {
                let stop = ((start / SECTOR + 1) * SECTOR).min(end);
                if rng.random_bool(0.5) {
                    write_over(file, start, &new[start - at..stop - at]);
                }
                start = stop;
            }
        }
        _ => {
            let length = file.len().max(at + new.len());
            file.resize(length, 0);
        }
    }
}

fn write_over(file: &mut Vec<u8>, at: usize, bytes: &[u8]) {
    let length = file.len().max(at + bytes.len());
    file.resize(length, 0);
    file[at..at + bytes.len()].copy_from_slice(bytes);
}

/// `ranges` without `cut`.
fn without(ranges: &[Range<usize>], cut: &Range<usize>) -> Vec<Range<usize>> {
    let parts = |r: &Range<usize>| {
        [r.start..r.end.min(cut.start).max(r.start), r.start.max(cut.end).min(r.end)..r.end]
    };
    ranges.iter().flat_map(parts).filter(|range| !range.is_empty()).collect()
}

#[cfg(test)]
mod tests;
