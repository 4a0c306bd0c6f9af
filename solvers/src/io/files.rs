//! Reading and writing whole files, errors with the path.
//!
//! It must not interpret bytes, except that compressed files are recognized and refused.

use std::fs;
use std::io;
use std::path::Path;

use super::IoError;

/// What compressed files begin with, and what unpacks them.
const COMPRESSED: [(&[u8], &str); 4] = [
    (b"BZh", "bunzip2"),
    (b"\x1f\x8b", "gunzip"),
    (b"\xfd7zXZ\0", "unxz"),
    (b"\x28\xb5\x2f\xfd", "unzstd"),
];

/// The file's bytes.
pub(super) fn read(path: &Path) -> Result<Vec<u8>, IoError> {
    fs::read(path).map_err(|source| IoError::Read { path: path.to_owned(), source })
}

/// Refuses what is compressed, which no text that is read here begins like.
pub(super) fn check_plain(bytes: &[u8], path: &Path) -> Result<(), IoError> {
    match COMPRESSED.iter().find(|(head, _)| bytes.starts_with(head)) {
        Some(&(_, with)) => Err(IoError::Compressed { path: path.to_owned(), with }),
        None => Ok(()),
    }
}

/// Writes `bytes`, replacing a file that is there: what stood there stays as it was until all is
/// written, also where the disk is full. What is no regular file (a pipe, a device, a link) is
/// written into.
pub(super) fn write(path: &Path, bytes: &[u8]) -> Result<(), IoError> {
    let is_replaced = fs::symlink_metadata(path).map_or(true, |there| there.is_file());
    let written = if is_replaced { replace(path, bytes) } else { fs::write(path, bytes) };
    written.map_err(|source| IoError::Write { path: path.to_owned(), source })
}

fn replace(path: &Path, bytes: &[u8]) -> io::Result<()> {
    let mut partial = path.as_os_str().to_owned();
    partial.push(".partial");
    let written = fs::write(&partial, bytes).and_then(|()| fs::rename(&partial, path));
    if written.is_err() {
        // The error that is told is that of writing.
        let _left = fs::remove_file(&partial);
    }
    written
}

/// Makes a folder with all its parents.
pub(super) fn create_folder(path: &Path) -> Result<(), IoError> {
    fs::create_dir_all(path).map_err(|source| IoError::Write { path: path.to_owned(), source })
}
