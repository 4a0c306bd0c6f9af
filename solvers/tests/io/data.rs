//! Where the real data lie, on machines that have them.

use std::path::{Path, PathBuf};

/// The path of a data file or folder, or `None` with one line where the data are absent.
pub(crate) fn data(relative: &str) -> Option<PathBuf> {
    let root = std::env::var_os("COVIS_TEST_DATA").map_or_else(
        || Path::new(env!("CARGO_MANIFEST_DIR")).join("../../shared/data"),
        PathBuf::from,
    );
    let path = root.join(relative);
    if !path.exists() {
        println!("skipped: no data");
        return None;
    }
    Some(path)
}
