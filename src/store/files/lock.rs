//! One server per data directory: a lock on a file in it, which the system releases when the
//! process ends. It guards the whole directory: single maps have no lock.

use std::fs::TryLockError;
use std::io::Write;
use std::path::Path;

use super::file_error;
use crate::store::StoreError;

/// Held as long as the store is open.
#[derive(Debug)]
pub(super) struct DirectoryLock {
    _file: fs_err::File,
}

impl DirectoryLock {
    /// Takes the lock.
    ///
    /// # Errors
    /// [`StoreError::InUse`] if another process holds it.
    pub(super) fn take(directory: &Path) -> Result<Self, StoreError> {
        let path = directory.join("LOCK");
        let failed = |error| file_error("cannot lock", &path, &error);
        let mut options = fs_err::OpenOptions::new();
        let opened = options.read(true).write(true).create(true).truncate(false).open(&path);
        let mut file = opened.map_err(failed)?;
        match file.file().try_lock() {
            Ok(()) => {}
            Err(TryLockError::WouldBlock) => {
                let holder = fs_err::read_to_string(&path).unwrap_or_default();
                let holder = holder.trim();
                return Err(StoreError::InUse {
                    path: directory.display().to_string(),
                    holder: if holder.is_empty() { "unknown" } else { holder }.to_owned(),
                });
            }
            Err(TryLockError::Error(error)) => return Err(failed(error)),
        }
        // The process id is only for people; the system keeps the lock itself.
        file.set_len(0).and_then(|()| writeln!(file, "{}", std::process::id())).map_err(failed)?;
        Ok(Self { _file: file })
    }
}
