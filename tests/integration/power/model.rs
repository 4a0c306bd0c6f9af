//! A folder as a disk has it: what was synced apart from what was only written.
//!
//! Bytes survive a loss of power once their file was synced, a name once the folder that holds it was.
//! Of the rest nothing, everything or any part may survive, torn in sectors. After a sync that failed
//! the bytes it was for stay readable and are never written by a later sync: only writing them again
//! brings them to the disk (as Linux does since the pages count as clean). A rename is one change.

use std::collections::BTreeMap;
use std::ops::Range;
use std::path::Path;

use rand::RngExt;
use rand_chacha::ChaCha8Rng;

/// A disk writes a sector whole or not at all.
const SECTOR: usize = 512;

/// A file or folder, whatever its names are.
type Id = usize;
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

    fn change(&mut self, entries: Vec<(Id, String, Option<Id>)>) {
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
        let id = self.nodes.len();
        self.nodes.push(node);
        self.change(vec![(folder, name, Some(id))]);
        id
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
mod tests {
    use rand::SeedableRng;

    use super::*;

    fn bytes(disk: &Disk, path: &str) -> Option<Vec<u8>> {
        disk.contents().get(path).cloned().flatten()
    }

    fn lost_power(disk: &Disk) -> Disk {
        disk.lose_power(Survival::Nothing)
    }

    #[test]
    fn bytes_and_names_survive_by_syncs_of_their_own() {
        let mut disk = Disk::new();
        let file = disk.create_file("a");
        disk.write(file, 0, b"one");
        disk.sync(file);
        assert_eq!(bytes(&lost_power(&disk), "a"), None, "the name was not synced");
        disk.sync(ROOT);
        disk.write(file, 3, b"two");
        assert_eq!(bytes(&lost_power(&disk), "a"), Some(b"one".to_vec()));
        let all = disk.lose_power(Survival::Everything);
        assert_eq!(bytes(&all, "a"), Some(b"onetwo".to_vec()));
        disk.cut(file, 1);
        disk.sync(file);
        assert_eq!(bytes(&lost_power(&disk), "a"), Some(b"o".to_vec()));
    }

    #[test]
    fn a_rename_is_one_change() {
        let mut disk = Disk::new();
        disk.create_folder("x");
        let file = disk.create_file("x/map");
        disk.sync(disk.find("x").unwrap());
        disk.sync(file);
        disk.sync(ROOT);
        disk.rename("x", "x.deleted");
        let names = |disk: &Disk| disk.contents().into_keys().collect::<Vec<_>>();
        assert_eq!(names(&lost_power(&disk)), ["x", "x/map"]);
        disk.sync(ROOT);
        disk.remove("x.deleted/map");
        assert_eq!(names(&lost_power(&disk)), ["x.deleted", "x.deleted/map"]);
        for seed in 0..20 {
            let mut rng = ChaCha8Rng::seed_from_u64(seed);
            disk.rename("x.deleted", "y");
            let left = names(&disk.lose_power(Survival::Random(&mut rng)));
            assert!(left.contains(&"y".to_owned()) != left.contains(&"x.deleted".to_owned()));
            disk.rename("y", "x.deleted");
        }
    }

    #[test]
    fn a_failed_sync_is_mended_by_writing_again_only() {
        let mut disk = Disk::new();
        let file = disk.create_file("a");
        disk.sync(ROOT);
        disk.write(file, 0, b"one");
        disk.sync(file);
        disk.write(file, 3, b"two");
        disk.fail_sync(file);
        disk.sync(file);
        assert_eq!(bytes(&lost_power(&disk), "a"), Some(b"one".to_vec()));
        disk.write(file, 6, b"end");
        disk.sync(file);
        assert_eq!(bytes(&lost_power(&disk), "a"), Some(b"one\0\0\0end".to_vec()));
        disk.write(file, 3, b"two");
        disk.sync(file);
        assert_eq!(bytes(&lost_power(&disk), "a"), Some(b"onetwoend".to_vec()));
    }

    #[test]
    fn what_survives_is_told_by_the_seed() {
        let mut disk = Disk::new();
        let file = disk.create_file("a");
        disk.sync(ROOT);
        for part in 0..8_u8 {
            disk.write(file, usize::from(part) * 1000, &[part + 1; 1000]);
        }
        let left = |seed| {
            let mut rng = ChaCha8Rng::seed_from_u64(seed);
            bytes(&disk.lose_power(Survival::Random(&mut rng)), "a").unwrap()
        };
        assert_eq!(left(7), left(7));
        let kinds: std::collections::BTreeSet<Vec<u8>> = (0..50).map(left).collect();
        assert!(kinds.len() > 40, "{} of 50 seeds differ", kinds.len());
    }
}
