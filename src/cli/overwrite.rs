//! `--force`: what a command writes replaces nothing that is there, unless the user says so. Files that are
//! written as a whole.
//!
//! Looked at before the work, which may take long. Reports in HTML are no results: they are replaced.

use std::io::{self, Write};
use std::path::{Path, PathBuf};

use anyhow::bail;
use fs_err as fs;

/// Whether files are replaced.
#[derive(Clone, Copy, Debug, Default, clap::Args)]
pub(super) struct Overwrite {
    /// Replace files that are there.
    #[arg(long)]
    force: bool,
}

impl Overwrite {
    /// Fails where `out` is a file, or a folder that is not empty. A pipe or a device is written into.
    pub(super) fn allow(self, out: &Path) -> anyhow::Result<()> {
        let Ok(there) = fs::symlink_metadata(out) else { return Ok(()) };
        if self.force {
            return Ok(());
        }
        if there.is_file() {
            bail!("{}: exists; --force replaces it", out.display());
        }
        if there.is_dir() && fs::read_dir(out)?.next().is_some() {
            bail!("{}: is not empty; --force replaces what is in it", out.display());
        }
        Ok(())
    }
}

/// Where a file is until it is complete.
pub(super) fn partial(path: &Path) -> PathBuf {
    let mut name = path.as_os_str().to_owned();
    name.push(".partial");
    PathBuf::from(name)
}

/// Writes a file as a whole or not at all, also where the disk is full or the program is killed.
pub(super) fn write_whole(path: &Path, bytes: &[u8]) -> io::Result<()> {
    let partial = partial(path);
    let mut file = fs::File::create(&partial)?;
    let written = file.write_all(bytes).and_then(|()| file.sync_all());
    written.and_then(|()| fs::rename(&partial, path)).inspect_err(|_error| {
        // What is left of it is of no use; that it cannot be removed changes nothing.
        let _removed = fs::remove_file(&partial);
    })
}
