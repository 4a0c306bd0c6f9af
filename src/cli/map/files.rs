//! `covis map import`, and the formats of files.
//!
//! Files are read piece by piece while they are sent; which format they have is told by their names,
//! unless an argument says it. What is in them is read by the server alone.

use std::io::Read;
use std::path::{Path, PathBuf};

use anyhow::{Context, bail};
use fs_err as fs;
use tokio::sync::mpsc;
use tokio_stream::wrappers::ReceiverStream;

use super::super::output::show;
use super::document::{Document, details};
use crate::client::Client;
use crate::wire::v1;

/// Bytes of a file in one message.
const CHUNK_BYTES: usize = 1 << 18;

#[derive(Clone, Copy, Debug, clap::ValueEnum)]
pub(in crate::cli) enum Format {
    /// COLMAP sparse model as text.
    ColmapText,
    /// COLMAP sparse model in binary.
    ColmapBinary,
    /// TUM trajectories.
    Tum,
    /// Pose graph as the server solves it: relative poses that keyframes measure, and constraints that
    /// are not switched off. `covis solve pose-graph` finds the same poses.
    G2o,
    /// Landmarks and trajectories for viewers; is not imported.
    Ply,
    /// All of the map, to move it to another server.
    Covis,
}

impl From<Format> for v1::MapFormat {
    fn from(format: Format) -> Self {
        match format {
            Format::ColmapText => Self::ColmapText,
            Format::ColmapBinary => Self::ColmapBinary,
            Format::Tum => Self::Tum,
            Format::G2o => Self::G2o,
            Format::Ply => Self::Ply,
            Format::Covis => Self::Covis,
        }
    }
}

/// What an import sends besides the files.
#[derive(Debug, clap::Args)]
pub(super) struct ImportArgs {
    /// The new map.
    name: String,
    /// The file; a folder for COLMAP, and for TUM with several clients.
    path: PathBuf,
    /// What the files are. Default: told by their names.
    #[arg(long)]
    format: Option<Format>,
    /// Owner of what comes from a format without clients.
    #[arg(long, default_value = "import", value_name = "NAME")]
    client: String,
}

/// Creates a map from files and prints it.
pub(super) async fn import(client: &Client, args: ImportArgs, json: bool) -> anyhow::Result<()> {
    let ImportArgs { name, path, format, client: client_id } = args;
    let (format, files) = find(&path, format)?;
    let header = v1::ImportMapHeader {
        map_id: name,
        format: v1::MapFormat::from(format).into(),
        client_id,
        ..v1::ImportMapHeader::default()
    };
    let (sender, chunks) = mpsc::channel(2);
    let reading = tokio::task::spawn_blocking(move || {
        files.iter().try_for_each(|(path, file)| send(path, file, &sender))
    });
    let answer = client.import_map(header, ReceiverStream::new(chunks)).await;
    // A file that cannot be read is the cause of what the server says of it.
    reading.await.context("the files were not read to their end")??;
    let map = Document::from(answer?);
    show(json, &map, || details(&map))
}

/// The files to send, by their names in the upload.
type Files = Vec<(String, PathBuf)>;

/// The format of a path, and its files.
fn find(path: &Path, format: Option<Format>) -> anyhow::Result<(Format, Files)> {
    if path.is_dir() {
        return in_folder(path, format);
    }
    let extension = path.extension().and_then(|e| e.to_str());
    let told = match extension {
        Some("covis") => Some(Format::Covis),
        Some("g2o") => Some(Format::G2o),
        Some("tum" | "txt") => Some(Format::Tum),
        Some(_) | None => None,
    };
    let Some(format) = format.or(told) else {
        bail!("{}: the name does not tell the format, --format does", path.display());
    };
    let name = path.file_name().unwrap_or_default().to_string_lossy().into_owned();
    Ok((format, vec![(name, path.to_owned())]))
}

fn in_folder(folder: &Path, format: Option<Format>) -> anyhow::Result<(Format, Files)> {
    let has = |name: &str| folder.join(name).is_file();
    let told = match format {
        Some(format) => format,
        None if has("cameras.bin") => Format::ColmapBinary,
        None if has("cameras.txt") => Format::ColmapText,
        None if has("map.covis") => Format::Covis,
        None if has("graph.g2o") => Format::G2o,
        None => Format::Tum,
    };
    let names: Vec<String> = match told {
        Format::ColmapBinary => {
            ["cameras.bin", "images.bin", "points3D.bin"].map(str::to_owned).into()
        }
        Format::ColmapText => {
            ["cameras.txt", "images.txt", "points3D.txt"].map(str::to_owned).into()
        }
        Format::Covis => vec!["map.covis".to_owned()],
        Format::G2o => vec!["graph.g2o".to_owned()],
        Format::Ply => vec!["map.ply".to_owned()],
        Format::Tum => {
            let mut names = Vec::new();
            for entry in fs::read_dir(folder)? {
                let name = entry?.file_name().to_string_lossy().into_owned();
                names.extend(Some(name).filter(|name| name.ends_with(".tum")));
            }
            names.sort();
            names
        }
    };
    if names.is_empty() {
        bail!("{}: there is nothing that can be imported", folder.display());
    }
    Ok((told, names.into_iter().map(|name| (name.clone(), folder.join(name))).collect()))
}

/// Sends a file in chunks. Ends early where nobody takes them any more; the call's answer then says
/// why.
pub(in crate::cli) fn send(
    path: &str,
    file: &Path,
    chunks: &mpsc::Sender<v1::FileChunk>,
) -> anyhow::Result<()> {
    let mut file = fs::File::open(file)?;
    let read = |file: &mut fs::File| -> std::io::Result<Vec<u8>> {
        let mut data = Vec::new();
        file.take(CHUNK_BYTES as u64).read_to_end(&mut data)?;
        Ok(data)
    };
    let (mut offset, mut data) = (0, read(&mut file)?);
    loop {
        // The next piece tells whether this one is the last.
        let next = if data.len() < CHUNK_BYTES { Vec::new() } else { read(&mut file)? };
        let length = i64::try_from(data.len())?;
        let last_chunk = next.is_empty();
        let chunk = v1::FileChunk { path: path.to_owned(), offset, data, last_chunk };
        if chunks.blocking_send(chunk).is_err() || last_chunk {
            return Ok(());
        }
        (offset, data) = (offset + length, next);
    }
}
