//! A filesystem in memory that forgets: what was not synced is gone when the power is lost.
//!
//! For programs that no library can be loaded into. The kernel sends each call below the folder to this
//! process (`fuse`), which plays it on the model of `power::model`. A write is in the model before the
//! program's call returns, so that kill -9 alone takes nothing.
//!
//! What is durable:
//! - bytes and length of a file: with its fsync or fdatasync, or at each write through a descriptor that
//!   was opened with O_SYNC or O_DSYNC;
//! - the name of a file that was created or renamed: with the sync of that file, as are then the names of
//!   the folders above (ext4, XFS and btrfs do this), or with the fsync of the folder;
//! - a removal: with the fsync of the folder, or when a later file of the same name is synced.
//!
//! This is less than ext4 keeps, which commits changes of names in their order. Times, owners and modes
//! are not kept.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::process::Command;
use std::sync::{Arc, Mutex};
use std::thread::JoinHandle;

use covis_solvers::testing::skip;

use super::fuse::{self, Answer, Errno, Request};
use crate::power::model::{Disk, Id, Survival};

/// A folder on a disk that forgets. Whoever uses it must have ended before it is dropped.
pub(super) struct ForgetfulDisk {
    folder: PathBuf,
    disk: Arc<Mutex<Disk>>,
    /// Ends when the folder is unmounted.
    server: Option<JoinHandle<()>>,
}

impl ForgetfulDisk {
    /// Mounts an empty one; `None` where the system refuses that, which is said.
    pub(super) fn mount(folder: PathBuf) -> Option<Self> {
        fs_err::create_dir_all(&folder).unwrap();
        let disk = Arc::new(Mutex::new(Disk::new()));
        match serve(&folder, &disk) {
            Ok(server) => Some(Self { folder, disk, server: Some(server) }),
            Err(why) => {
                skip(&format!("no filesystem of its own can be mounted ({why})"));
                None
            }
        }
    }

    /// The power is lost: nobody may have anything open. Returns how many paths are not as they were.
    pub(super) fn lose_power(&mut self, survival: Survival<'_>) -> usize {
        let ended = Command::new("umount").arg(&self.folder).output().unwrap();
        assert!(ended.status.success(), "{}", String::from_utf8_lossy(&ended.stderr));
        self.server.take().unwrap().join().unwrap();
        let mut disk = self.disk.lock().unwrap();
        let after = disk.lose_power(survival);
        let (was, is) = (disk.contents(), after.contents());
        *disk = after;
        drop(disk);
        self.server = Some(serve(&self.folder, &self.disk).unwrap());
        let changed = was.iter().filter(|(path, bytes)| is.get(*path) != Some(bytes)).count();
        changed + is.keys().filter(|path| !was.contains_key(*path)).count()
    }

    /// Removes a folder of the root for good.
    pub(super) fn take_away(&self, name: &str) {
        fs_err::remove_dir_all(self.folder.join(name)).unwrap();
        std::fs::File::open(&self.folder).unwrap().sync_all().unwrap();
    }
}

impl Drop for ForgetfulDisk {
    fn drop(&mut self) {
        if self.server.is_some() {
            // Where somebody still runs there the folder goes now and the rest with the last user.
            let _ended = Command::new("umount").arg("--lazy").arg(&self.folder).output();
        }
    }
}

/// Mounts the disk and answers the kernel's calls until it is unmounted.
fn serve(folder: &Path, disk: &Arc<Mutex<Disk>>) -> Result<JoinHandle<()>, String> {
    let kernel = fuse::mount(folder)?;
    let mut calls = Calls { disk: Arc::clone(disk), listings: BTreeMap::new() };
    Ok(std::thread::spawn(move || fuse::serve(kernel, |request| calls.play(request))))
}

/// The kernel's calls, played on a disk.
struct Calls {
    disk: Arc<Mutex<Disk>>,
    /// What folders held when they were opened, by their handles.
    listings: BTreeMap<u64, Vec<(String, Id, bool)>>,
}

/// The root is inode 1, and the first of the model.
fn id_of(inode: u64) -> Id {
    usize::try_from(inode).unwrap() - 1
}

fn inode_of(id: Id) -> u64 {
    u64::try_from(id).unwrap() + 1
}

/// Size of a file; `None` of a folder.
fn size(disk: &Disk, id: Id) -> Option<u64> {
    disk.bytes(id).map(|bytes| u64::try_from(bytes.len()).unwrap())
}

fn entry(disk: &Disk, id: Id) -> Answer {
    Answer::entry(inode_of(id), size(disk, id))
}

fn named(disk: &Disk, folder: Id, name: &str) -> Result<Id, Errno> {
    let names = disk.names(folder).ok_or(Errno::NoFolder)?;
    names.get(name).copied().ok_or(Errno::Missing)
}

fn check_empty(disk: &Disk, id: Id) -> Result<(), Errno> {
    let names = disk.names(id).ok_or(Errno::NoFolder)?;
    if names.is_empty() { Ok(()) } else { Err(Errno::Full) }
}

impl Calls {
    fn play(&mut self, request: Request<'_>) -> Result<Answer, Errno> {
        let shared = Arc::clone(&self.disk);
        let disk = &mut *shared.lock().unwrap();
        let id = id_of(request.inode);
        match request.call {
            fuse::Call::Lookup { name } => Ok(entry(disk, named(disk, id, name)?)),
            fuse::Call::Attributes { cut } => {
                if let Some(length) = cut {
                    disk.cut(id, usize::try_from(length).unwrap());
                }
                Ok(Answer::attributes(request.inode, size(disk, id)))
            }
            fuse::Call::CreateFolder { name } => {
                let id = disk.add_folder(id, name.to_owned());
                Ok(entry(disk, id))
            }
            fuse::Call::CreateFile { name } => {
                let id = disk.add_file(id, name.to_owned());
                Ok(entry(disk, id).opened(0))
            }
            fuse::Call::Remove { name, folder } => {
                let removed = named(disk, id, name)?;
                if folder {
                    check_empty(disk, removed)?;
                }
                disk.change(vec![(id, name.to_owned(), None)]);
                Ok(Answer::default())
            }
            fuse::Call::Rename { name, folder, to } => {
                let (moved, folder) = (named(disk, id, name)?, id_of(folder));
                let replaced = named(disk, folder, to).ok();
                if replaced == Some(moved) {
                    return Ok(Answer::default());
                }
                if let Some(old) = replaced.filter(|&old| disk.names(old).is_some()) {
                    check_empty(disk, old)?;
                }
                let from = (id, name.to_owned(), None);
                disk.change(vec![from, (folder, to.to_owned(), Some(moved))]);
                Ok(Answer::default())
            }
            fuse::Call::Link { inode, name } => {
                disk.change(vec![(id, name.to_owned(), Some(id_of(inode)))]);
                Ok(entry(disk, id_of(inode)))
            }
            fuse::Call::Read { offset, most } => {
                let bytes = disk.bytes(id).ok_or(Errno::Missing)?;
                let start = usize::try_from(offset).unwrap().min(bytes.len());
                Ok(Answer::bytes(&bytes[start..bytes.len().min(start + most)]))
            }
            fuse::Call::Write { offset, bytes, syncs } => {
                disk.write(id, usize::try_from(offset).unwrap(), bytes);
                if syncs {
                    disk.sync_with_names(id);
                }
                Ok(Answer::written(bytes.len()))
            }
            fuse::Call::Sync => {
                disk.sync_with_names(id);
                Ok(Answer::default())
            }
            fuse::Call::OpenFolder => {
                let names = disk.names(id).ok_or(Errno::NoFolder)?.iter();
                let listing = names.map(|(name, &id)| (name.clone(), id, disk.names(id).is_some()));
                let handle = self.listings.last_key_value().map_or(1, |(last, _)| last + 1);
                self.listings.insert(handle, listing.collect());
                Ok(Answer::default().opened(handle))
            }
            fuse::Call::List { handle, offset, most } => {
                let mut answer = Answer::default();
                let from = usize::try_from(offset).unwrap();
                for (at, (name, id, folder)) in self.listings[&handle].iter().enumerate().skip(from)
                {
                    if !answer.list(name, inode_of(*id), *folder, at + 1, most) {
                        break;
                    }
                }
                Ok(answer)
            }
            fuse::Call::CloseFolder { handle } => {
                self.listings.remove(&handle);
                Ok(Answer::default())
            }
        }
    }
}
