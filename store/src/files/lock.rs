//! One server per data directory: a lock on a file in it, which the system releases when the
//! process ends. It guards the whole directory: single maps have no lock.

use std::fs::TryLockError;
use std::io::Write;
use std::path::Path;

use super::file_error;
use crate::StoreError;

/// Held as long as the store is open.
#[derive(Debug)]
pub(super) struct DirectoryLock {
    file: fs_err::File,
}

impl Drop for DirectoryLock {
    /// A process that is just being started holds a copy of the file until it runs its program, and the
    /// system keeps the lock with the copy: so it is given up, not only closed.
    fn drop(&mut self) {
        // Where this fails, the lock goes with the last copy.
        let _unlocked = self.file.file().unlock();
    }
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
        Ok(Self { file })
    }
}

#[cfg(test)]
mod tests {
    use super::DirectoryLock;

    #[test]
    fn a_directory_is_free_although_a_process_that_starts_has_a_copy_of_its_lock() {
        let directory = tempfile::tempdir().unwrap();
        let lock = DirectoryLock::take(directory.path()).unwrap();
        let copy = lock.file.file().try_clone().unwrap();
        DirectoryLock::take(directory.path()).unwrap_err();
        drop(lock);
        DirectoryLock::take(directory.path()).unwrap();
        drop(copy);
    }
}
