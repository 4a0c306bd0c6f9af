//! The folders of jobs in a data directory.
//!
//! ```text
//! DIR/jobs/UID/job              the record of the job, written anew at each change of its state
//! DIR/jobs/UID/upload           what was uploaded; a folder without it and without `job` is a leftover
//! DIR/jobs/UID/NUMBER.in        a file that was uploaded
//! DIR/jobs/UID/NUMBER.out       a file that the job made
//! DIR/jobs/UID/NUMBER.part      a part of its work that need not be done again
//! DIR/jobs/UID/NUMBER.state     a solve on its way
//! ```
//!
//! Each file is sealed: complete and durable under its name, or absent. No text of a client becomes a
//! path. What has other names is left alone. Everything here blocks.

use std::io::{self, BufRead, ErrorKind, Write};
use std::path::{Path, PathBuf};
use std::sync::Arc;

use super::disk::Disk;
use super::file_error;
use super::folders::{discard, name_of, uid_of};
use super::sealed::{self, Kind, Label, SealError, unseal};
use crate::StoreError;
use crate::job_files::{JobFile, JobFileError, JobFolder, JobUid};

/// The folders of jobs.
#[derive(Clone, Debug)]
pub(crate) struct JobFolders {
    disk: Arc<dyn Disk>,
    root: PathBuf,
}

impl JobFolders {
    /// Those of the data directory `root`.
    pub(super) fn new(disk: Arc<dyn Disk>, root: &Path) -> Self {
        Self { disk, root: root.join("jobs") }
    }

    /// Every folder that may be a job or an upload. Removes what creations and deletions left that did
    /// not finish.
    pub(crate) fn list(&self) -> Result<Vec<JobFolder>, StoreError> {
        let failed = |error| file_error("cannot create", &self.root, &error);
        self.disk.create_folder(&self.root).map_err(failed)?;
        let names = self.disk.list(&self.root);
        let names = names.map_err(|error| file_error("cannot list", &self.root, &error))?;
        let mut folders = Vec::new();
        for name in names {
            let path = self.root.join(&name);
            let folder = path.display();
            if name.strip_suffix(".deleted").is_some_and(|name| uid_of(name).is_some()) {
                self.discard(&path);
                continue;
            }
            let files = uid_of(&name).map(|uid| (uid, self.disk.list(&path)));
            let Some((uid, Ok(names))) = files else {
                tracing::warn!(%folder, "not a job, it is left alone");
                continue;
            };
            let mut files = Vec::new();
            for name in &names {
                match file_of(name) {
                    Some(file) => files.push(file),
                    None if name.ends_with(".tmp") => {
                        // A failed removal only leaves a file that nobody reads.
                        let _left = self.disk.remove(&path.join(name));
                    }
                    None => {
                        tracing::warn!(%folder, name, "not a file of a job, it is left alone");
                    }
                }
            }
            if files.contains(&JobFile::Record) || files.contains(&JobFile::Upload) {
                folders.push(JobFolder { uid, files });
            } else if names.iter().all(|name| file_of(name).is_some() || name.ends_with(".tmp")) {
                self.discard(&path);
            }
        }
        self.disk.sync_folder(&self.root).map_err(failed)?;
        Ok(folders)
    }

    fn discard(&self, path: &Path) {
        if let Err(error) = discard(&*self.disk, path) {
            let folder = path.display();
            tracing::warn!(%folder, %error, "the remains of a job could not be removed");
        }
    }

    /// Writes a file of a job; returns its size in bytes.
    pub(crate) fn write(
        &self,
        uid: &JobUid,
        file: JobFile,
        body: impl FnOnce(&mut dyn Write) -> io::Result<()>,
    ) -> Result<u64, StoreError> {
        let folder = self.root.join(name_of(uid));
        if self.disk.list(&folder).is_err() {
            let failed = |error| file_error("cannot create", &folder, &error);
            self.disk.create_folder(&folder).map_err(failed)?;
            self.disk.sync_folder(&self.root).map_err(failed)?;
        }
        let path = folder.join(name_of_file(file));
        let label = Label { uid: *uid, sequence: 0 };
        sealed::write(&*self.disk, &path, (kind_of(file), &label), body)
    }

    /// Reads a file of a job.
    pub(crate) fn read<T>(
        &self,
        uid: &JobUid,
        file: JobFile,
        read: impl FnOnce(&mut dyn BufRead) -> io::Result<T>,
    ) -> Result<T, JobFileError> {
        let path = self.root.join(name_of(uid)).join(name_of_file(file));
        let name = path.display().to_string();
        let stream = self.disk.stream(&path);
        let mut stream = stream.map_err(|error| {
            if error.kind() == ErrorKind::NotFound {
                return JobFileError::Missing;
            }
            JobFileError::Store(file_error("cannot read", &path, &error))
        })?;
        match unseal(kind_of(file), &mut stream, |_label, body| Ok(read(body)?)) {
            Ok((label, _)) if label.uid != *uid => {
                let reason = "it belongs to another folder".to_owned();
                Err(JobFileError::Damaged { file: name, reason })
            }
            Ok((_, value)) => Ok(value),
            Err(SealError::Disk(error)) => {
                Err(JobFileError::Store(file_error("cannot read", &path, &error)))
            }
            Err(SealError::Later(reason)) => Err(JobFileError::Later { file: name, reason }),
            Err(SealError::Damaged(reason)) => Err(JobFileError::Damaged { file: name, reason }),
        }
    }

    /// Removes the files of a job but those that `keep` says.
    pub(crate) fn retain(
        &self,
        uid: &JobUid,
        keep: impl Fn(JobFile) -> bool,
    ) -> Result<(), StoreError> {
        let folder = self.root.join(name_of(uid));
        let names = self.disk.list(&folder);
        let names = names.map_err(|error| file_error("cannot list", &folder, &error))?;
        for name in names.iter().filter(|name| file_of(name).is_some_and(|file| !keep(file))) {
            let path = folder.join(name);
            self.disk.remove(&path).map_err(|e| file_error("cannot remove", &path, &e))?;
        }
        Ok(())
    }

    /// Removes a job with all its files: either it is gone for good, or it is as it was.
    pub(crate) fn remove(&self, uid: &JobUid) -> Result<(), StoreError> {
        let path = self.root.join(name_of(uid));
        match discard(&*self.disk, &path) {
            Err(error) if error.kind() == ErrorKind::NotFound => Ok(()),
            // The rename is what counts: the next start removes the rest.
            Err(error) if self.disk.list(&path).is_ok() => {
                Err(file_error("cannot remove", &path, &error))
            }
            Ok(()) | Err(_) => Ok(()),
        }
    }
}

fn kind_of(file: JobFile) -> Kind {
    if file == JobFile::Record { Kind::Job } else { Kind::JobData }
}

pub(super) fn name_of_file(file: JobFile) -> String {
    match file {
        JobFile::Record => "job".to_owned(),
        JobFile::Upload => "upload".to_owned(),
        JobFile::Input(number) => format!("{number:010}.in"),
        JobFile::Output(number) => format!("{number:010}.out"),
        JobFile::Part(number) => format!("{number:010}.part"),
        JobFile::Checkpoint(number) => format!("{number:010}.state"),
    }
}

pub(super) fn file_of(name: &str) -> Option<JobFile> {
    let numbered = || {
        let (digits, extension) = name.split_once('.')?;
        let is_ours = digits.len() == 10 && digits.bytes().all(|byte| byte.is_ascii_digit());
        let number = digits.parse().ok().filter(|_| is_ours)?;
        match extension {
            "in" => Some(JobFile::Input(number)),
            "out" => Some(JobFile::Output(number)),
            "part" => Some(JobFile::Part(number)),
            "state" => Some(JobFile::Checkpoint(number)),
            _ => None,
        }
    };
    match name {
        "job" => Some(JobFile::Record),
        "upload" => Some(JobFile::Upload),
        _ => numbered(),
    }
}
