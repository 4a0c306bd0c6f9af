//! Failures of the disk as the store reports them: which are temporary, and what callers read.
//!
//! An error inside this folder names the file, for the log. What leaves the store names the map and
//! what is wrong: a caller must learn nothing about the server's folders.

use std::io::{self, ErrorKind};
use std::path::Path;

use crate::StoreError;

/// `EMFILE` and `ENFILE`: the standard library has no error kind for them.
#[cfg(unix)]
const NO_DESCRIPTORS: [i32; 2] = [24, 23];
/// `ERROR_TOO_MANY_OPEN_FILES`.
#[cfg(windows)]
const NO_DESCRIPTORS: [i32; 1] = [4];
#[cfg(not(any(unix, windows)))]
const NO_DESCRIPTORS: [i32; 0] = [];

/// Whether an error is temporary: space, descriptors or memory are used up and may become free
/// again.
pub(super) fn passes(error: &io::Error) -> bool {
    let used_up = [ErrorKind::StorageFull, ErrorKind::QuotaExceeded, ErrorKind::OutOfMemory];
    used_up.contains(&error.kind()) || lacks_descriptors(error)
}

/// Whether no file could be opened, so that the operation did nothing.
pub(super) fn lacks_descriptors(error: &io::Error) -> bool {
    error.raw_os_error().is_some_and(|number| NO_DESCRIPTORS.contains(&number))
}

pub(super) fn file_error(action: &'static str, path: &Path, error: &io::Error) -> StoreError {
    StoreError::File {
        action,
        path: path.display().to_string(),
        message: error.to_string(),
        passes: passes(error),
    }
}

/// Turns a failure that names a file into the error that a caller gets; the file is only logged.
pub(super) fn of_map(map: &str, error: StoreError) -> StoreError {
    let map = map.to_owned();
    if let StoreError::Later { file, reason, .. } = error {
        return StoreError::Later { map, file, reason };
    }
    if let StoreError::File { .. } | StoreError::Content { .. } = &error {
        tracing::warn!(map, %error, "a call on the store failed");
    }
    if let StoreError::File { action, message, passes, .. } = error {
        let cause = format!("{action} its files: {message}");
        return if passes {
            StoreError::Unavailable { map, cause }
        } else {
            StoreError::Failed { map, cause }
        };
    }
    if let StoreError::Content { message, .. } = error {
        return StoreError::Failed { map, cause: message };
    }
    error
}
