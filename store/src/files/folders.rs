//! The kinds of folders in `maps/`: maps, leftovers of covis, and foreign entries.
//!
//! The server's start, `doctor` and `backup` use the same rules. A folder is a map's if its name is
//! a uid and the identity in it has the same uid. Only leftovers of covis are ever removed: folders
//! called `UID.deleted`, and those whose creation did not reach the first event. Everything else
//! stays as it is, and prevents nothing.

use std::collections::BTreeMap;
use std::io::ErrorKind;
use std::path::{Path, PathBuf};

use super::disk::Disk;
use super::failure::passes;
use super::record::{Header, Uid, read_header, scan};
use super::sealed::{self, SealError};
use super::{file_error, journal_name};
use crate::StoreError;
use crate::encoding::{EncodingError, decode_identity, decode_later_identity};

/// The kind of a folder.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) enum Folder {
    /// A map that was created, or may have been.
    Map { name: String, uid: Uid },
    /// A map whose name was written by a later version.
    Later(StoreError),
    /// A map whose name cannot be read, and why.
    Nameless(String),
    /// Cannot be determined now, for lack of descriptors or memory.
    Unknown(StoreError),
    /// The leftover of a creation or deletion that did not finish.
    Leftover,
    /// Not a folder of covis, and why.
    Stray(&'static str),
}

/// The uid in a folder's name.
pub(crate) fn uid_of(name: &str) -> Option<Uid> {
    let mut uid = Uid::default();
    let is_hex = |byte: u8| byte.is_ascii_digit() || (b'a'..=b'f').contains(&byte);
    if name.len() != 2 * uid.len() || !name.bytes().all(is_hex) {
        return None;
    }
    for (index, byte) in uid.iter_mut().enumerate() {
        *byte = u8::from_str_radix(name.get(2 * index..2 * index + 2)?, 16).ok()?;
    }
    Some(uid)
}

/// The name of the folder of a uid.
pub(super) fn name_of(uid: &Uid) -> String {
    uid.iter().map(|byte| format!("{byte:02x}")).collect()
}

/// Determines the kind of an entry of `maps/`. Changes nothing. Blocks.
pub(super) fn look(disk: &dyn Disk, maps: &Path, entry: &str) -> Folder {
    if entry.strip_suffix(".deleted").is_some_and(|name| uid_of(name).is_some()) {
        return Folder::Leftover;
    }
    let Some(uid) = uid_of(entry) else {
        return Folder::Stray("covis creates no folder of this name");
    };
    let folder = maps.join(entry);
    let names = match disk.list(&folder) {
        Ok(names) => names,
        Err(error) if error.kind() == ErrorKind::NotADirectory => {
            return Folder::Stray("it is not a folder");
        }
        Err(error) if passes(&error) => {
            return Folder::Unknown(file_error("cannot list", &folder, &error));
        }
        Err(error) => return Folder::Nameless(error.to_string()),
    };
    if names.iter().all(|name| name.ends_with(".tmp")) {
        return Folder::Leftover;
    }
    let path = folder.join("map");
    let read = match disk.stream(&path) {
        Ok(mut file) => sealed::read_identity(&mut file),
        Err(error) => Err(SealError::Disk(error)),
    };
    match read {
        Ok((label, _)) if label.uid != uid => {
            Folder::Stray("it holds what belongs to another folder")
        }
        Ok((_, (version, body))) => named(disk, &folder, &names, uid, version, &body),
        Err(SealError::Disk(error)) if passes(&error) => {
            Folder::Unknown(file_error("cannot read", &path, &error))
        }
        Err(error) => Folder::Nameless(error.to_string()),
    }
}

fn named(
    disk: &dyn Disk,
    folder: &Path,
    names: &[String],
    uid: Uid,
    version: u32,
    body: &[u8],
) -> Folder {
    let reason = if version == super::record::VERSION {
        match decode_identity(body) {
            Ok(_) if is_unfinished(disk, folder, names, &uid) => return Folder::Leftover,
            Ok(name) => return Folder::Map { name, uid },
            Err(error @ EncodingError::Later) => error.to_string(),
            Err(error) => return Folder::Nameless(error.to_string()),
        }
    } else {
        format!(
            "it has version {version}, and this covis reads up to version {}",
            super::record::VERSION
        )
    };
    match decode_later_identity(body) {
        Ok(map) if !map.is_empty() => {
            Folder::Later(StoreError::Later { map, file: "map".to_owned(), reason })
        }
        Ok(_) | Err(_) => Folder::Nameless(reason),
    }
}

/// Whether a map never had an event, because its creation was not answered. A mark, a snapshot or
/// any other file shows that it had one; a journal that cannot be read proves nothing.
fn is_unfinished(disk: &dyn Disk, folder: &Path, names: &[String], uid: &Uid) -> bool {
    let first = journal_name(1);
    let is_early = |name: &String| name == "map" || *name == first || name.ends_with(".tmp");
    if !names.iter().all(is_early) {
        return false;
    }
    if !names.contains(&first) {
        return true;
    }
    let Ok(bytes) = disk.read(&folder.join(&first)) else { return false };
    let is_later = matches!(read_header(&bytes, uid), Header::Later(_));
    !is_later && scan(&bytes, uid, 1).records.is_empty()
}

/// A map at the start: its files, or why it accepts no calls.
pub(super) type Claim = Result<(Uid, PathBuf), StoreError>;

/// The maps of a directory by name. Removes leftovers and reports foreign entries. Blocks.
///
/// # Errors
/// [`StoreError::File`] if `maps/` cannot be listed, or a folder in it cannot be read for now: the
/// name of its map would look free.
pub(super) fn at_start(
    disk: &dyn Disk,
    maps: &Path,
) -> Result<BTreeMap<String, Claim>, StoreError> {
    let entries = disk.list(maps).map_err(|e| file_error("cannot list", maps, &e))?;
    let mut claims: BTreeMap<String, Vec<(String, Claim)>> = BTreeMap::new();
    for entry in entries {
        let path = maps.join(&entry);
        let folder = path.display();
        match look(disk, maps, &entry) {
            Folder::Map { name, uid } => {
                claims.entry(name).or_default().push((entry, Ok((uid, path))));
            }
            Folder::Later(error) => {
                tracing::error!(%folder, %error, "a map is not opened");
                if let StoreError::Later { map, .. } = &error {
                    claims.entry(map.clone()).or_default().push((entry, Err(error)));
                }
            }
            Folder::Unknown(error) => return Err(error),
            Folder::Nameless(reason) => {
                tracing::error!(%folder, reason, "a map's name cannot be read, it is not opened");
            }
            Folder::Stray(reason) => tracing::warn!(%folder, reason, "not a map, it is left alone"),
            Folder::Leftover => {
                if let Err(error) = discard(disk, &path) {
                    tracing::warn!(%folder, %error, "the remains of a map could not be removed");
                }
            }
        }
    }
    Ok(claims.into_iter().map(|(name, claims)| (name.clone(), one(maps, name, claims))).collect())
}

/// The only claim to a name; an error if there are several.
fn one(maps: &Path, map: String, mut claims: Vec<(String, Claim)>) -> Claim {
    if let [_] = &claims[..]
        && let Some((_, claim)) = claims.pop()
    {
        return claim;
    }
    let folders: Vec<String> = claims.into_iter().map(|(folder, _)| folder).collect();
    let error = StoreError::Ambiguous { map, folders };
    tracing::error!(folder = %maps.display(), %error, "a map is not opened");
    Err(error)
}

/// An unused name in `folder` for what is set aside there: `name`, or with a number. Blocks.
pub(super) fn unused_name(
    disk: &dyn Disk,
    folder: &Path,
    name: &str,
    ending: &str,
) -> std::io::Result<PathBuf> {
    let taken = disk.list(folder)?;
    let mut free = format!("{name}{ending}");
    let mut count = 1;
    while taken.contains(&free) {
        count += 1;
        free = format!("{name}.{count}{ending}");
    }
    Ok(folder.join(free))
}

/// Removes the folder of a map that is no longer needed, so that a crash cannot leave part of it as
/// a map. Blocks.
pub(super) fn discard(disk: &dyn Disk, folder: &Path) -> std::io::Result<()> {
    let gone = folder.with_extension("deleted");
    if folder != gone {
        disk.rename(folder, &gone)?;
        disk.sync_folder(gone.parent().unwrap_or(&gone))?;
    }
    disk.remove_folder(&gone)
}
