//! Copies a data directory while a server may be writing to it, and proves that the copy opens.
//!
//! A journal only grows at its end and a snapshot is written once, so that files copied in the right
//! order make a map as it was at some moment: first the mark, which may not be ahead of the journal,
//! then the snapshots, then the journal. The server may remove files meanwhile; what was copied is
//! looked at as `doctor` does, and a map that lacks something is copied again. The copy is a data
//! directory of its own: to restore it is to serve it. Everything here blocks.

use std::io::ErrorKind;
use std::path::Path;

use super::disk::{Disk, RealDisk};
use super::doctor::{MapCheckup, check_up_map, name_ambiguous};
use super::folders::{self, Folder};
use super::{MARK, create_root, file_error};
use crate::store::StoreError;

/// How often a map is copied before it is given up: each time the server was in the middle of
/// replacing its files.
const TRIES: usize = 5;

/// Copies every map of a data directory to `copy`, which must be missing or empty. Blocks.
///
/// Each map holds at least what was durable when its copy began. The answer tells what each copy is
/// like; one that is damaged is so in the original.
///
/// # Errors
/// [`StoreError::NotEmpty`] where `copy` holds anything, [`StoreError::File`].
pub fn back_up(directory: &Path, copy: &Path) -> Result<Vec<MapCheckup>, StoreError> {
    let maps = directory.join("maps");
    let folders = RealDisk.list(&maps).map_err(|e| file_error("cannot list", &maps, &e))?;
    match RealDisk.list(copy) {
        Ok(names) if !names.is_empty() => {
            return Err(StoreError::NotEmpty { path: copy.display().to_string() });
        }
        Ok(_) | Err(_) => {}
    }
    create_root(&RealDisk, copy)?;
    let mut checkups = Vec::new();
    for name in folders {
        match folders::look(&RealDisk, &maps, &name) {
            Folder::Map { .. } | Folder::Later(_) | Folder::Nameless(_) | Folder::Unknown(_) => {
                checkups.extend(copy_map(&maps, &copy.join("maps"), &name)?);
            }
            // What an unfinished creation or deletion left.
            Folder::Leftover => {}
            Folder::Stray(reason) => {
                let folder = maps.join(&name);
                tracing::warn!(folder = %folder.display(), reason, "not a map, it is not copied");
            }
        }
    }
    name_ambiguous(checkups.iter_mut());
    let folder = copy.join("maps");
    RealDisk.sync_folder(&folder).map_err(|e| file_error("cannot sync", &folder, &e))?;
    Ok(checkups)
}

/// Copies a map; `None` where it was deleted meanwhile, or was never quite created. One of a later
/// version is copied as it is.
fn copy_map(maps: &Path, copy: &Path, name: &str) -> Result<Option<MapCheckup>, StoreError> {
    let (from, to) = (&maps.join(name), &copy.join(name));
    let mut tries = 1;
    loop {
        let is_whole = copy_files(from, to)?;
        let now = folders::look(&RealDisk, maps, name);
        let is_gone = RealDisk.list(from).is_err() || now == Folder::Leftover;
        let checkup = if is_gone { None } else { check_up_map(copy, name) };
        let is_done = match &checkup {
            None => is_gone || tries == TRIES,
            Some(checkup) => {
                let is_later = matches!(now, Folder::Later(_));
                is_later || tries == TRIES || (is_whole && !checkup.is_damaged())
            }
        };
        if is_done && checkup.is_some() {
            return Ok(checkup);
        }
        RealDisk.remove_folder(to).map_err(|e| file_error("cannot remove", to, &e))?;
        if is_done {
            return Ok(None);
        }
        tries += 1;
    }
}

/// Copies the files of a map once; whether none went away meanwhile.
fn copy_files(from: &Path, to: &Path) -> Result<bool, StoreError> {
    RealDisk.create_folder(to).map_err(|e| file_error("cannot create", to, &e))?;
    let mark = RealDisk.read(&from.join(MARK)).ok();
    let mut is_whole = true;
    let has = |extension: &'static str| {
        move |name: &String| Path::new(name).extension().is_some_and(|e| e == extension)
    };
    for wanted in ["snap", "log"] {
        let Ok(names) = RealDisk.list(from) else { return Ok(false) };
        for name in names.iter().filter(|name| has(wanted)(name)) {
            is_whole &= copy_file(&from.join(name), &to.join(name))?;
        }
    }
    // Files of a later version, perhaps.
    if let Ok(names) = RealDisk.list(from) {
        let known = |name: &&String| {
            *name == MARK
                || *name == "map"
                || ["snap", "log", "tmp", "bad"].iter().any(|e| has(e)(name))
        };
        for name in names.iter().filter(|name| !known(name)) {
            if RealDisk.list(&from.join(name)).is_ok() {
                let folder = from.join(name);
                tracing::warn!(folder = %folder.display(), "a folder inside a map is not copied");
            } else {
                is_whole &= copy_file(&from.join(name), &to.join(name))?;
            }
        }
    }
    if let Some(mark) = mark {
        put(&to.join(MARK), &mark)?;
    }
    is_whole &= copy_file(&from.join("map"), &to.join("map"))?;
    RealDisk.sync_folder(to).map_err(|e| file_error("cannot sync", to, &e))?;
    Ok(is_whole)
}

/// Copies a file; whether it was still there.
fn copy_file(from: &Path, to: &Path) -> Result<bool, StoreError> {
    match RealDisk.read(from) {
        Ok(bytes) => put(to, &bytes).map(|()| true),
        Err(error) if error.kind() == ErrorKind::NotFound => Ok(false),
        Err(error) => Err(file_error("cannot read", from, &error)),
    }
}

fn put(path: &Path, bytes: &[u8]) -> Result<(), StoreError> {
    let failed = |error| file_error("cannot write", path, &error);
    let mut file = RealDisk.create(path).map_err(failed)?;
    file.append(bytes).and_then(|()| file.sync()).map_err(failed)
}
