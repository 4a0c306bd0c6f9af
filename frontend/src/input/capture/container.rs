//! The files of a capture: those of a folder, or of a zip archive.
//!
//! Names are relative, with `/` between their parts; what would lead out of the folder is refused.
//! Files are read whole and bounded.

use std::fs::File;
use std::io::Read;
use std::path::{Component, Path, PathBuf};

use super::MAX_FILE_BYTES;
use super::archive::Archive;
use super::error::{CaptureError, Place};

/// Where the files of a capture are.
#[derive(Debug)]
pub(super) struct Container {
    root: PathBuf,
    /// Set where the root is an archive.
    archive: Option<Archive>,
}

impl Container {
    /// The files of a folder.
    pub(super) fn folder(root: &Path) -> Self {
        Self { root: root.to_owned(), archive: None }
    }

    /// The files of an archive. Fails where it is none.
    pub(super) fn archive(path: &Path) -> Result<Self, CaptureError> {
        Ok(Self { root: path.to_owned(), archive: Some(Archive::open(path)?) })
    }

    /// Takes the files of the one folder that all files of an archive are in, where there is one.
    pub(super) fn enter_common_folder(&mut self) {
        if let Some(archive) = &mut self.archive {
            archive.enter_common_folder();
        }
    }

    /// How a file is called in messages.
    pub(super) fn path(&self, name: &str) -> PathBuf {
        self.root.join(name)
    }

    /// Whether there is such a file or folder.
    pub(super) fn has(&self, name: &str) -> bool {
        match &self.archive {
            Some(archive) => archive.has(name),
            None => self.root.join(name).exists(),
        }
    }

    /// The names of the files right in a folder, without it; nothing where there is no such folder.
    pub(super) fn names(&self, folder: &str) -> Result<Vec<String>, CaptureError> {
        if let Some(archive) = &self.archive {
            return Ok(archive.names(folder));
        }
        let path = self.path(folder);
        if !path.is_dir() {
            return Ok(Vec::new());
        }
        let failed = |source| CaptureError::Read { path: path.clone(), source };
        let mut names = Vec::new();
        for entry in std::fs::read_dir(&path).map_err(failed)? {
            // A name that is not UTF-8 is none of a layout's.
            names.extend(entry.map_err(failed)?.file_name().into_string().ok());
        }
        Ok(names)
    }

    /// A file's bytes.
    pub(super) fn read(&mut self, name: &str) -> Result<Vec<u8>, CaptureError> {
        let path = self.path(name);
        let limit = MAX_FILE_BYTES + 1;
        let read = match &mut self.archive {
            Some(archive) => archive.read(name, limit),
            None => File::open(&path).and_then(|file| {
                let mut bytes = Vec::new();
                file.take(limit).read_to_end(&mut bytes)?;
                Ok(bytes)
            }),
        };
        let bytes = read.map_err(|source| CaptureError::Read { path: path.clone(), source })?;
        if bytes.len() as u64 > MAX_FILE_BYTES {
            return Err(CaptureError::TooLong { path });
        }
        Ok(bytes)
    }
}

/// A name that a file gives, as a name of the container. Refuses what leads out of it.
pub(super) fn inside(named: &str, file: &Path) -> Result<String, CaptureError> {
    let mut parts = Vec::new();
    for part in Path::new(named).components() {
        match part {
            Component::Normal(part) => parts.push(part.to_string_lossy()),
            Component::CurDir => {}
            Component::ParentDir | Component::RootDir | Component::Prefix(_) => {
                let frame = Some(named.chars().take(80).collect());
                let place = Place { path: file.to_owned(), frame };
                return Err(CaptureError::Outside { place });
            }
        }
    }
    Ok(parts.join("/"))
}
