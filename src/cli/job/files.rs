//! The files of a problem, and how they are sent.
//!
//! A file is sent under its name, a folder's files under their paths below it, so that the server learns
//! nothing else of the machine. What is in them is read by the server alone.

use std::path::Path;

use anyhow::bail;
use covis_solvers::io::colmap::ColmapEncoding;
use covis_solvers::io::natural_cmp;
use fs_err as fs;

use super::super::map::{self, Files};
use crate::client::Client;
use crate::wire::v1;

/// Endings of problem files in a folder.
const ENDINGS: [&str; 3] = ["bal", "g2o", "txt"];
/// Folders inside each other that are looked through.
const DEPTH: usize = 8;

/// The files of a problem: the file itself, or the problems of a folder and of those in it.
pub(super) fn find(path: &Path) -> anyhow::Result<Files> {
    if !path.is_dir() {
        let name = path.file_name().unwrap_or_default().to_string_lossy().into_owned();
        return Ok(vec![(name, path.to_owned())]);
    }
    let mut files = Vec::new();
    collect(path, "", DEPTH, &mut files)?;
    if files.is_empty() {
        bail!("{}: no COLMAP model and no .bal, .g2o or .txt file is in it", path.display());
    }
    Ok(files)
}

fn collect(folder: &Path, below: &str, depth: usize, files: &mut Files) -> anyhow::Result<()> {
    let mut names = Vec::new();
    for entry in fs::read_dir(folder)? {
        names.push(entry?.file_name().to_string_lossy().into_owned());
    }
    names.sort_by(|a, b| natural_cmp(a, b));
    let path = |name: &str| format!("{below}{name}");
    let model = ColmapEncoding::of_folder(folder);
    if let Some(model) = model {
        files.extend(model.file_names().map(|name| (path(name), folder.join(name))));
    }
    for name in names {
        let file = folder.join(&name);
        if file.is_dir() && depth > 0 {
            collect(&file, &format!("{below}{name}/"), depth - 1, files)?;
            continue;
        }
        let ending = Path::new(&name).extension().and_then(|ending| ending.to_str());
        let is_problem = ending.is_some_and(|ending| ENDINGS.contains(&ending));
        // What else lies beside a model is no problem of its own.
        if is_problem && model.is_none() && file.is_file() {
            files.push((path(&name), file));
        }
    }
    Ok(())
}

/// Sends files; returns the id of the upload.
pub(super) async fn upload(client: &Client, files: Files) -> anyhow::Result<String> {
    let mut size_bytes = 0;
    for (_, file) in &files {
        size_bytes += i64::try_from(fs::metadata(file)?.len())?;
    }
    let header = v1::UploadJobFilesHeader { size_bytes };
    let answer =
        map::upload(files, None, async |chunks| client.upload_job_files(header, chunks).await);
    Ok(answer.await?.upload_id)
}
