//! The folders of jobs without a server: copied with a data directory, and looked at.
//!
//! A job's record is written anew when its state changes, after the files that it names. So the record is
//! copied first, then the files, and the folder again where the record has changed meanwhile. Looking reads
//! every byte and changes nothing: a server leaves a damaged file as it is, and so does a repair. Everything
//! here blocks.

use std::io;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use super::backup::{TRIES, copy_file};
use super::disk::{Disk, RealDisk};
use super::file_error;
use super::folders::uid_of;
use super::jobs::{JobFolders, file_of, name_of_file};
use crate::StoreError;
use crate::job_files::{FoundRecord, JobFile, JobFileError, JobFiles, JobUid};

/// The result of looking at the files of a job or of an upload.
#[derive(Clone, Debug, Default, PartialEq, Eq, serde::Serialize)]
pub struct JobCheckup {
    /// The job's name; `None` for an upload that no job has taken, and where the name is lost.
    pub job: Option<String>,
    /// Its folder.
    pub folder: PathBuf,
    /// Files that cannot be read, with the reasons.
    pub damage: Vec<String>,
}

/// Reads every file of the jobs in a data directory, in the order of the folders' names. Without a folder
/// of jobs there are none. Blocks.
///
/// # Errors
/// [`StoreError::File`] where the folder is there and cannot be listed.
pub fn check_up_jobs(directory: &Path) -> Result<Vec<JobCheckup>, StoreError> {
    let root = directory.join("jobs");
    let jobs = JobFiles::on_disk(JobFolders::new(Arc::new(RealDisk), directory));
    let mut checkups = Vec::new();
    for (name, uid) in folders(&root)? {
        let folder = root.join(name);
        let files = files(&folder);
        // What a creation or a deletion left; a server removes it.
        if !files.contains(&JobFile::Record) && !files.contains(&JobFile::Upload) {
            continue;
        }
        let mut checkup = JobCheckup { folder, ..JobCheckup::default() };
        for file in files {
            if let Err(error) = look(&jobs, &uid, file, &mut checkup) {
                checkup.damage.push(format!("{}: {error}", name_of_file(file)));
            }
        }
        checkups.push(checkup);
    }
    Ok(checkups)
}

/// Reads a file; of a record its name too.
fn look(
    jobs: &JobFiles,
    uid: &JobUid,
    file: JobFile,
    checkup: &mut JobCheckup,
) -> Result<(), JobFileError> {
    if file != JobFile::Record {
        return jobs.read(uid, file, |body| io::copy(body, &mut io::sink()).map(drop));
    }
    // A record of a later version is left to that version.
    checkup.job = Some(match jobs.read_record(uid)? {
        FoundRecord::Job(record) => record.job_id,
        FoundRecord::Later { job_id, .. } => job_id,
    });
    Ok(())
}

/// Copies the jobs of a data directory to that of `copy`. Blocks.
pub(super) fn copy_jobs(directory: &Path, copy: &Path) -> Result<(), StoreError> {
    let (from, to) = (directory.join("jobs"), copy.join("jobs"));
    let all = folders(&from)?;
    if all.is_empty() {
        return Ok(());
    }
    RealDisk.create_folder(&to).map_err(|e| file_error("cannot create", &to, &e))?;
    for (name, _) in all {
        copy_job(&from.join(&name), &to.join(&name))?;
    }
    RealDisk.sync_folder(&to).map_err(|e| file_error("cannot sync", &to, &e))
}

/// Copies a job; nothing of one that is gone before that is done.
fn copy_job(from: &Path, to: &Path) -> Result<(), StoreError> {
    let (record, upload) = (name_of_file(JobFile::Record), name_of_file(JobFile::Upload));
    let head = |folder: &Path| {
        let read = |name: &str| RealDisk.read(&folder.join(name)).ok();
        read(&record).or_else(|| read(&upload))
    };
    for _ in 0..TRIES {
        RealDisk.create_folder(to).map_err(|e| file_error("cannot create", to, &e))?;
        let before = head(from);
        for file in files(from) {
            let name = name_of_file(file);
            copy_file(&from.join(&name), &to.join(&name))?;
        }
        if before.is_some() && head(from) == before && head(to) == before {
            return RealDisk.sync_folder(to).map_err(|e| file_error("cannot sync", to, &e));
        }
        RealDisk.remove_folder(to).map_err(|e| file_error("cannot remove", to, &e))?;
        if before.is_none() {
            return Ok(());
        }
    }
    let text = "the job changed during each try";
    Err(file_error("cannot copy", from, &io::Error::other(text)))
}

/// The folders that may be jobs.
fn folders(root: &Path) -> Result<Vec<(String, JobUid)>, StoreError> {
    match RealDisk.list(root) {
        Ok(names) => {
            let ours = names.into_iter().filter_map(|name| uid_of(&name).map(|uid| (name, uid)));
            let mut ours: Vec<_> = ours.collect();
            ours.sort_unstable();
            Ok(ours)
        }
        Err(error) if error.kind() == io::ErrorKind::NotFound => Ok(Vec::new()),
        Err(error) => Err(file_error("cannot list", root, &error)),
    }
}

/// The files of a job; none of a folder that is gone.
fn files(folder: &Path) -> Vec<JobFile> {
    let names = RealDisk.list(folder).unwrap_or_default();
    let mut files: Vec<JobFile> = names.iter().filter_map(|name| file_of(name)).collect();
    files.sort_unstable();
    files
}
