//! Reading and writing whole files, errors with the path.
//!
//! It must not interpret bytes, except that compressed files and those without a line feed at the ends
//! of lines are recognized and refused.

use std::fs;
use std::io;
use std::path::Path;

use super::IoError;

/// What compressed files begin with, the format's name, and what unpacks them.
const COMPRESSED: [(&[u8], &str, &str); 4] = [
    (b"BZh", "bzip2", "bunzip2"),
    (b"\x1f\x8b", "gzip", "gunzip"),
    (b"\xfd7zXZ\0", "xz", "unxz"),
    (b"\x28\xb5\x2f\xfd", "zstd", "unzstd"),
];

/// The file's bytes.
pub(super) fn read(path: &Path) -> Result<Vec<u8>, IoError> {
    fs::read(path).map_err(|source| IoError::Read { path: path.to_owned(), source })
}

/// Refuses what is compressed, which no text that is read here begins like.
pub(super) fn check_plain(bytes: &[u8], path: &Path) -> Result<(), IoError> {
    match compression(bytes) {
        Some((kind, with)) => Err(IoError::Compressed { path: path.to_owned(), kind, with }),
        None => Ok(()),
    }
}

/// Refuses what [`check_plain`] does, and lines that end in CR alone.
pub(super) fn check_lines(bytes: &[u8], path: &Path) -> Result<(), IoError> {
    check_plain(bytes, path)?;
    let is_one_line = !bytes.contains(&b'\n');
    if is_one_line && bytes.trim_ascii_end().contains(&b'\r') {
        return Err(IoError::LineEnds { path: path.to_owned() });
    }
    Ok(())
}

/// The format of the compression and what unpacks it, where the bytes are compressed.
pub(super) fn compression(bytes: &[u8]) -> Option<(&'static str, &'static str)> {
    let found = COMPRESSED.iter().find(|(head, ..)| bytes.starts_with(head));
    found.map(|&(_, kind, with)| (kind, with))
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
