//! Copies the maps and jobs of a data directory while a server may be writing to it, and proves that the copy opens.
//!
//! A journal only grows at its end and a snapshot is written once. Files that are copied in the
//! right order are therefore a map as it was at some moment: first the mark, which must not be
//! ahead of the journal, then the snapshots, then the journal. The server may remove files
//! meanwhile; the copy is checked as `doctor` does, and a map with missing files is copied again. A map
//! that is gone before it was copied may have become part of one that was copied already: then all are
//! copied again. Maps that are new at the end are copied too.
//! The copy is a complete data directory: to restore it, serve it. Everything here blocks.

use std::collections::BTreeSet;
use std::io::ErrorKind;
use std::path::Path;

use super::disk::{Disk, RealDisk};
use super::doctor::{MapCheckup, check_up_map, name_ambiguous};
use super::folders::{self, Folder};
use super::job_copies::copy_jobs;
use super::{MARK, create_root, file_error};
use crate::StoreError;

/// How often the copy of a map is tried, and that of all. A try fails when the server replaces the map's
/// files meanwhile, or takes the map away.
pub(super) const TRIES: usize = 5;

/// Copies every map and job of a data directory to `copy`, which must be missing or empty. Blocks.
///
/// Each map holds at least what was durable when its copy began. Returns a checkup of each copy; a
/// copy is damaged only if the original is.
///
/// # Errors
/// [`StoreError::NotEmpty`] if `copy` is not empty, [`StoreError::File`], also where maps go away faster
/// than they are copied.
pub fn back_up(directory: &Path, copy: &Path) -> Result<Vec<MapCheckup>, StoreError> {
    back_up_while(directory, copy, || ())
}

/// As [`back_up`]; calls `listed` each time after the maps were listed.
pub(super) fn back_up_while(
    directory: &Path,
    copy: &Path,
    mut listed: impl FnMut(),
) -> Result<Vec<MapCheckup>, StoreError> {
    let maps = directory.join("maps");
    RealDisk.list(&maps).map_err(|e| file_error("cannot list", &maps, &e))?;
    match RealDisk.list(copy) {
        Ok(names) if !names.is_empty() => {
            return Err(StoreError::NotEmpty { path: copy.display().to_string() });
        }
        Ok(_) | Err(_) => {}
    }
    create_root(&RealDisk, copy)?;
    // Before the maps: a job that a record shows as running is done again where its map lacks its result.
    copy_jobs(directory, copy)?;
    let folder = copy.join("maps");
    for _ in 0..TRIES {
        if let Some(mut checkups) = copy_maps(&maps, &folder, &mut listed)? {
            name_ambiguous(checkups.iter_mut());
            RealDisk.sync_folder(&folder).map_err(|e| file_error("cannot sync", &folder, &e))?;
            return Ok(checkups);
        }
        RealDisk.remove_folder(&folder).map_err(|e| file_error("cannot remove", &folder, &e))?;
        RealDisk.create_folder(&folder).map_err(|e| file_error("cannot create", &folder, &e))?;
    }
    let text = "maps were deleted or merged during each try";
    Err(file_error("cannot copy", &maps, &std::io::Error::other(text)))
}

/// Copies every map; `None` if one was gone before it was copied.
fn copy_maps(
    maps: &Path,
    copy: &Path,
    listed: &mut impl FnMut(),
) -> Result<Option<Vec<MapCheckup>>, StoreError> {
    let (mut seen, mut checkups) = (BTreeSet::new(), Vec::new());
    loop {
        let folders = RealDisk.list(maps).map_err(|e| file_error("cannot list", maps, &e))?;
        listed();
        let new: Vec<String> = folders.into_iter().filter(|name| !seen.contains(name)).collect();
        if new.is_empty() {
            return Ok(Some(checkups));
        }
        for name in new {
            let folder = maps.join(&name);
            match folders::look(&RealDisk, maps, &name) {
                _ if RealDisk.list(maps).is_ok_and(|now| !now.contains(&name)) => return Ok(None),
                Folder::Map { .. }
                | Folder::Later(_)
                | Folder::Nameless(_)
                | Folder::Unknown(_) => match copy_map(maps, copy, &name)? {
                    Some(checkup) => checkups.push(checkup),
                    None if RealDisk.list(&folder).is_err() => return Ok(None),
                    // Its creation never finished.
                    None => {}
                },
                // Left by an unfinished creation or deletion.
                Folder::Leftover => {}
                Folder::Stray(reason) => {
                    tracing::warn!(folder = %folder.display(), reason, "not a map, it is not copied");
                }
            }
            seen.insert(name);
        }
    }
}

/// Copies a map; `None` if it was deleted meanwhile, or its creation never finished. A map of a
/// later version is copied as it is.
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

/// Copies the files of a map once; returns whether none was removed meanwhile.
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
    // The folder may have files of a later version.
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

/// Copies a file; returns whether it still existed.
pub(super) fn copy_file(from: &Path, to: &Path) -> Result<bool, StoreError> {
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
