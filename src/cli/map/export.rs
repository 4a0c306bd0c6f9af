//! `covis map export`: writes the files of an export, chunk by chunk.
//!
//! A file that is there is replaced only where the user says so, and once the new one is complete. The server decides what the
//! files hold.

use std::io::Write;
use std::path::{Path, PathBuf};

use anyhow::bail;
use fs_err as fs;
use serde::Serialize;

use super::super::output::show;
use super::super::overwrite::{Overwrite, partial};
use super::super::progress::Working;
use super::files::Format;
use crate::client::{Client, ClientError, MapExport};
use crate::wire::v1;

/// Files of an export in `--json`.
#[derive(Debug, Serialize)]
struct Exported<'a> {
    map: String,
    revision: i64,
    files: &'a [PathBuf],
}

/// Paths below each other.
pub(in crate::cli) fn path_lines(files: &[PathBuf]) -> String {
    files.iter().map(|file| file.display().to_string()).collect::<Vec<_>>().join("\n")
}

/// Exports a map and prints the paths of the files.
pub(super) async fn export(
    client: &Client,
    (name, format, all_landmarks): (String, Format, bool),
    (out, overwrite): (&Path, Overwrite),
    json: bool,
) -> anyhow::Result<()> {
    let working = Working::new(format_args!("exporting map {name}"));
    let map_id = name.clone();
    let request =
        v1::ExportMapRequest { map_id, format: v1::MapFormat::from(format).into(), all_landmarks };
    let export = client.export_map_with(request).await?;
    let revision = export.header().revision;
    let files = format.finish(write(export, out, overwrite).await?)?;
    drop(working);
    show(json, &Exported { map: name, revision, files: &files }, || path_lines(&files))
}

/// Writes the files of an export and returns their paths. An export of one file goes to `out`
/// itself, unless that is a folder; one of several into the folder `out`.
pub(in crate::cli) async fn write(
    mut export: MapExport,
    out: &Path,
    overwrite: Overwrite,
) -> anyhow::Result<Vec<PathBuf>> {
    let paths = export.header().paths.clone();
    if paths.is_empty() {
        bail!("the map holds nothing to export in this format");
    }
    write_files(&paths, async || export.next().await, out, overwrite).await
}

/// Writes files whose chunks come in order, as [`write`] does, and returns their paths.
pub(in crate::cli) async fn write_files(
    paths: &[String],
    mut next: impl AsyncFnMut() -> Result<Option<v1::FileChunk>, ClientError>,
    out: &Path,
    overwrite: Overwrite,
) -> anyhow::Result<Vec<PathBuf>> {
    let is_folder = paths.len() != 1 || out.is_dir();
    let target = |path: &str| if is_folder { out.join(path) } else { out.to_owned() };
    paths.iter().try_for_each(|path| overwrite.allow(&target(path)))?;
    let mut open: Option<(PathBuf, fs::File)> = None;
    while let Some(chunk) = next().await? {
        let path = target(&chunk.path);
        // A pipe or a device is written into, never replaced.
        let is_replaced = fs::symlink_metadata(&path).map_or(true, |there| there.is_file());
        let partial = if is_replaced { partial(&path) } else { path.clone() };
        let mut file = match open.take() {
            Some((_, file)) => file,
            None => {
                if let Some(folder) = path.parent().filter(|f| !f.as_os_str().is_empty()) {
                    fs::create_dir_all(folder)?;
                }
                fs::File::create(&partial)?
            }
        };
        file.write_all(&chunk.data)?;
        if chunk.last_chunk {
            if is_replaced {
                file.sync_all()?;
                fs::rename(&partial, &path)?;
            }
        } else {
            open = Some((path, file));
        }
    }
    Ok(paths.iter().map(|path| target(path)).collect())
}
