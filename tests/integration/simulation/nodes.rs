//! Files and folders of the simulated disk: each twice, as it is and as it was last synced.
//!
//! A file is what the page cache holds (`data`) and what the platter holds (`synced`). A folder is its
//! names, as they are and as they were synced. [`Crash`] says what the next process finds.

use std::collections::BTreeMap;
use std::ops::Range;

use rand::RngExt;
use rand_chacha::ChaCha8Rng;

/// How a machine stops.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Crash {
    /// The process is killed: the page cache stays.
    Process,
    /// The power goes: nothing stays that was not synced.
    PowerNothing,
    /// The power goes: all stays, as if it had been synced.
    PowerAll,
    /// The power goes: of what was not synced some stays, in any order.
    PowerSome,
}

#[derive(Clone, Debug)]
pub(super) enum Node {
    File(FileNode),
    Folder(FolderNode),
}

#[derive(Clone, Debug, Default)]
pub(super) struct FileNode {
    pub(super) data: Vec<u8>,
    synced: Vec<u8>,
    /// Parts of `data` that a sync writes.
    pub(super) dirty: Vec<Range<usize>>,
}

#[derive(Clone, Debug, Default)]
pub(super) struct FolderNode {
    pub(super) names: BTreeMap<String, usize>,
    synced: BTreeMap<String, usize>,
    /// What a sync of the folder makes durable, in order.
    changes: Vec<NameChange>,
}

#[derive(Clone, Debug)]
pub(super) enum NameChange {
    Add(String, usize),
    Remove(String),
    /// Also within one journal transaction of a file system: both or neither.
    Rename(String, String, usize),
}

impl FileNode {
    pub(super) fn write(&mut self, at: usize, bytes: &[u8]) {
        let end = at + bytes.len();
        if self.data.len() < end {
            self.data.resize(end, 0);
        }
        self.data[at..end].copy_from_slice(bytes);
        self.dirty.push(at..end);
    }

    pub(super) fn truncate(&mut self, length: usize) {
        self.data.truncate(length);
        self.dirty.push(length..length);
    }

    /// Makes durable what is dirty, and the length.
    pub(super) fn sync(&mut self) {
        let dirty = std::mem::take(&mut self.dirty);
        if !dirty.is_empty() {
            self.synced.resize(self.data.len(), 0);
        }
        for range in dirty {
            let end = range.end.min(self.data.len());
            let start = range.start.min(end);
            self.synced[start..end].copy_from_slice(&self.data[start..end]);
        }
    }

    pub(super) fn crash(&mut self, crash: Crash, rng: &mut ChaCha8Rng) {
        match crash {
            Crash::Process => return,
            Crash::PowerNothing => {}
            Crash::PowerAll => self.sync(),
            Crash::PowerSome => {
                // Pages reach the disk in any order, the length too.
                let dirty = std::mem::take(&mut self.dirty);
                for range in dirty {
                    let end = range.end.min(self.data.len());
                    let start = range.start.min(end);
                    if rng.random() {
                        continue;
                    }
                    let kept = rng.random_range(start..=end);
                    if self.synced.len() < kept || range.is_empty() {
                        self.synced.resize(kept.max(start), 0);
                    }
                    let written = start..kept.min(self.synced.len());
                    self.synced[written.clone()].copy_from_slice(&self.data[written]);
                }
            }
        }
        self.dirty.clear();
        self.data.clone_from(&self.synced);
    }
}

impl FolderNode {
    pub(super) fn change(&mut self, change: NameChange) {
        apply(&mut self.names, &change);
        self.changes.push(change);
    }

    pub(super) fn sync(&mut self) {
        for change in std::mem::take(&mut self.changes) {
            apply(&mut self.synced, &change);
        }
    }

    pub(super) fn crash(&mut self, crash: Crash, rng: &mut ChaCha8Rng) {
        match crash {
            Crash::Process => return,
            Crash::PowerNothing => {}
            Crash::PowerAll => self.sync(),
            Crash::PowerSome => {
                for change in std::mem::take(&mut self.changes) {
                    if rng.random() {
                        apply(&mut self.synced, &change);
                    }
                }
            }
        }
        self.changes.clear();
        self.names.clone_from(&self.synced);
    }
}

fn apply(names: &mut BTreeMap<String, usize>, change: &NameChange) {
    match change {
        NameChange::Add(name, node) => {
            names.insert(name.clone(), *node);
        }
        NameChange::Remove(name) => {
            names.remove(name);
        }
        NameChange::Rename(from, to, node) => {
            names.remove(from);
            names.insert(to.clone(), *node);
        }
    }
}
