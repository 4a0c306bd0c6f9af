//! Whole files in, whole files out, with the path in every error.

use std::path::Path;

use super::IoError;

/// The file's bytes.
pub(super) fn read(path: &Path) -> Result<Vec<u8>, IoError> {
    fs_err::read(path).map_err(|source| IoError::Read { path: path.to_owned(), source })
}

/// Writes `bytes`, replacing a file that is there.
pub(super) fn write(path: &Path, bytes: &[u8]) -> Result<(), IoError> {
    fs_err::write(path, bytes).map_err(|source| IoError::Write { path: path.to_owned(), source })
}

/// Makes a folder with all its parents.
pub(super) fn create_folder(path: &Path) -> Result<(), IoError> {
    fs_err::create_dir_all(path).map_err(|source| IoError::Write { path: path.to_owned(), source })
}
