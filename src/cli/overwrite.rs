//! `--force`: what a command writes replaces nothing that is there, unless the user says so.
//!
//! Looked at before the work, which may take long. Reports in HTML are no results: they are replaced.

use std::path::Path;

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
