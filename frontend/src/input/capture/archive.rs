//! A zip archive as the files of a capture: entries are read where they are, nothing is unpacked to disk.
//!
//! So a name never becomes a path, and a link in an archive is only a short file. What an entry says of
//! its length is not trusted: reading stops at a limit. All files of an archive may be in one folder, which
//! is then left out of their names.

use std::collections::BTreeSet;
use std::fmt;
use std::io::{self, BufReader, Read, Seek};
use std::ops::Bound;
use std::path::Path;

use zip::ZipArchive;

use super::error::CaptureError;

/// What archives made on a Mac have beside the files.
const RESOURCE_FORKS: &str = "__MACOSX/";

/// Where the bytes of an archive come from.
trait Source: Read + Seek + Send {}

impl<T: Read + Seek + Send> Source for T {}

/// An archive, opened.
pub(super) struct Archive {
    entries: ZipArchive<Box<dyn Source>>,
    /// The folder that was entered, with its `/`; empty where none was.
    folder: String,
    /// Names of the files without that folder, and of folders, which end in `/`.
    names: BTreeSet<String>,
}

impl fmt::Debug for Archive {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { folder, names, .. } = self;
        f.debug_struct("Archive").field("folder", folder).field("names", names).finish()
    }
}

impl Archive {
    /// Opens a file. Fails for what is no zip archive or is cut off.
    pub(super) fn open(path: &Path) -> Result<Self, CaptureError> {
        let file = std::fs::File::open(path)
            .map_err(|source| CaptureError::Read { path: path.to_owned(), source })?;
        Self::read_from(BufReader::new(file), path)
    }

    /// The archive in `bytes`; `path` names it in errors.
    pub(super) fn read_from(
        bytes: impl Read + Seek + Send + 'static,
        path: &Path,
    ) -> Result<Self, CaptureError> {
        let source: Box<dyn Source> = Box::new(bytes);
        let entries = ZipArchive::new(source).map_err(|error| CaptureError::Archive {
            path: path.to_owned(),
            problem: error.to_string(),
        })?;
        let names = entries.file_names().filter(|name| !name.starts_with(RESOURCE_FORKS));
        let names: BTreeSet<String> = names.map(str::to_owned).collect();
        Ok(Self { entries, folder: String::new(), names })
    }

    /// Takes the files of the one folder that all are in, where there is one.
    pub(super) fn enter_common_folder(&mut self) {
        let folder = common_folder(&self.names);
        let inside = self.names.iter().filter_map(|name| name.strip_prefix(&folder));
        self.names = inside.filter(|name| !name.is_empty()).map(str::to_owned).collect();
        self.folder.push_str(&folder);
    }

    /// Whether there is such a file or folder.
    pub(super) fn has(&self, name: &str) -> bool {
        self.names.contains(name) || self.below(&format!("{name}/")).next().is_some()
    }

    /// The names of the files right in a folder.
    pub(super) fn names(&self, folder: &str) -> Vec<String> {
        let folder = format!("{folder}/");
        let inside = self.below(&folder).filter_map(|name| name.strip_prefix(&folder));
        inside.filter(|name| !name.is_empty() && !name.contains('/')).map(str::to_owned).collect()
    }

    /// At most `limit` bytes of a file. Fails for what is not there, is encrypted, is compressed by another
    /// method than deflate, or does not have its checksum.
    pub(super) fn read(&mut self, name: &str, limit: u64) -> io::Result<Vec<u8>> {
        let entry = self.entries.by_name(&format!("{}{name}", self.folder))?;
        let mut bytes = Vec::new();
        entry.take(limit).read_to_end(&mut bytes)?;
        Ok(bytes)
    }

    fn below<'a>(&'a self, folder: &'a str) -> impl Iterator<Item = &'a String> {
        let from = self.names.range::<str, _>((Bound::Included(folder), Bound::Unbounded));
        from.take_while(move |name| name.starts_with(folder))
    }
}

/// The folder, with its `/`, that all files are in; empty where there is none.
fn common_folder(names: &BTreeSet<String>) -> String {
    let folder = names.first().and_then(|name| name.split_inclusive('/').next());
    match folder.filter(|folder| folder.ends_with('/')) {
        Some(folder) if names.iter().all(|name| name.starts_with(folder)) => folder.to_owned(),
        Some(_) | None => String::new(),
    }
}
