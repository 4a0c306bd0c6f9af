//! `covis map import`, and the formats of files.
//!
//! Files are read piece by piece while they are sent; their names decide their format, unless an argument
//! does. Only the server reads their content.

use std::io::Read;
use std::path::{Path, PathBuf};

use anyhow::{Context, bail};
use covis_solvers::io::colmap::ColmapEncoding;
use covis_solvers::io::trajectory::{Trajectory, TrajectoryFormat};
use fs_err as fs;
use tokio::sync::mpsc;
use tokio_stream::wrappers::ReceiverStream;

use super::super::formats::extension;
use super::super::output::show;
use super::super::progress::Working;
use super::document::{Document, details};
use crate::client::{Client, ClientError};
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
    /// KITTI's poses, without times.
    Kitti,
    /// Trajectories as EuRoC's ground truth; the body is the camera.
    Euroc,
    /// Pose graph as the server solves it: relative poses that keyframes measure, and constraints that
    /// are not switched off. `covis solve pose-graph` finds the same poses.
    G2o,
    /// Landmarks and trajectories for viewers; cannot be imported.
    Ply,
    /// All of the map, to move it to another server.
    Covis,
}

impl From<Format> for v1::MapFormat {
    fn from(format: Format) -> Self {
        match format {
            Format::ColmapText => Self::ColmapText,
            Format::ColmapBinary => Self::ColmapBinary,
            // What the server makes and reads; the files are converted here.
            Format::Tum | Format::Kitti | Format::Euroc => Self::Tum,
            Format::G2o => Self::G2o,
            Format::Ply => Self::Ply,
            Format::Covis => Self::Covis,
        }
    }
}

impl Format {
    /// The format that the extension of a file's name says.
    fn of_name(path: &Path) -> Option<Self> {
        match path.extension()?.to_str()? {
            "covis" => Some(Self::Covis),
            "g2o" => Some(Self::G2o),
            "tum" | "txt" => Some(Self::Tum),
            "kitti" => Some(Self::Kitti),
            "csv" => Some(Self::Euroc),
            "ply" => Some(Self::Ply),
            _ => None,
        }
    }

    /// The format of an export to `out`: the given one, or that of its name, where a name without extension
    /// is a COLMAP folder.
    pub(super) fn of_export(given: Option<Self>, out: &Path) -> anyhow::Result<Self> {
        let is_folder = out.extension().is_none();
        let told = || if is_folder { Some(Self::ColmapBinary) } else { Self::of_name(out) };
        given.or_else(told).with_context(|| unclear(out))
    }

    /// The form of trajectories that is not the server's own.
    fn trajectories(self) -> Option<TrajectoryFormat> {
        match self {
            Self::Kitti => Some(TrajectoryFormat::Kitti),
            Self::Euroc => Some(TrajectoryFormat::Euroc),
            Self::ColmapText
            | Self::ColmapBinary
            | Self::Tum
            | Self::G2o
            | Self::Ply
            | Self::Covis => None,
        }
    }

    /// Writes trajectories that the server exported in this format, where it is not the server's own, and
    /// returns the paths of the files.
    pub(in crate::cli) fn finish(self, files: Vec<PathBuf>) -> anyhow::Result<Vec<PathBuf>> {
        let Some(format) = self.trajectories() else { return Ok(files) };
        let convert = |file: PathBuf| {
            let trajectory = Trajectory::read(&file)?;
            let is_tum = file.extension().is_some_and(|extension| extension == "tum");
            let out = if is_tum { file.with_extension(extension(format)) } else { file.clone() };
            trajectory.write_as(&out, format)?;
            if is_tum {
                fs::remove_file(&file)?;
            }
            Ok(out)
        };
        files.into_iter().map(convert).collect()
    }
}

/// What an import sends besides the files.
#[derive(Debug, clap::Args)]
pub(super) struct ImportArgs {
    /// The new map.
    name: String,
    /// The file; a folder for COLMAP, and for trajectories of several clients.
    path: PathBuf,
    /// Format of the files [default: detected from their names].
    #[arg(long)]
    format: Option<Format>,
    /// Owner of the imported entities, if the format has no clients.
    #[arg(long, default_value = "import", value_name = "NAME")]
    client: String,
    /// Skip the lines of a g2o file that covis does not read, and say how many of each tag. Without this
    /// flag such a line is an error.
    #[arg(long)]
    skip_unknown: bool,
}

/// Creates a map from files and prints it.
pub(super) async fn import(client: &Client, args: ImportArgs, json: bool) -> anyhow::Result<()> {
    let ImportArgs { name, path, format, client: client_id, skip_unknown } = args;
    let (format, files) = find(&path, format)?;
    let header = v1::ImportMapHeader {
        map_id: name,
        format: v1::MapFormat::from(format).into(),
        client_id,
        skip_unknown,
        ..v1::ImportMapHeader::default()
    };
    let working = Working::new(format_args!("importing {}", path.display()));
    let answer = upload(files, format.trajectories(), async |chunks| {
        client.import_map(header, chunks).await
    });
    let (answer, warnings) = answer.await?;
    drop(working);
    for warning in warnings {
        tracing::warn!("{}", warning.description);
    }
    let map = Document::from(answer);
    show(json, &map, || details(&map))
}

/// The files to send, by their names in the upload.
pub(in crate::cli) type Files = Vec<(String, PathBuf)>;

fn unclear(path: &Path) -> String {
    format!("{}: the format does not follow from the name; set it with --format", path.display())
}

/// The format of a path, and its files.
fn find(path: &Path, format: Option<Format>) -> anyhow::Result<(Format, Files)> {
    if path.is_dir() {
        return in_folder(path, format);
    }
    let format = format.or_else(|| Format::of_name(path)).with_context(|| unclear(path))?;
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
        Format::ColmapBinary => ColmapEncoding::Binary.file_names().map(str::to_owned).into(),
        Format::ColmapText => ColmapEncoding::Text.file_names().map(str::to_owned).into(),
        Format::Covis => vec!["map.covis".to_owned()],
        Format::G2o => vec!["graph.g2o".to_owned()],
        Format::Ply => vec!["map.ply".to_owned()],
        Format::Tum | Format::Kitti | Format::Euroc => {
            let ending = format!(".{}", told.trajectories().map_or("tum", extension));
            let mut names = Vec::new();
            for entry in fs::read_dir(folder)? {
                let name = entry?.file_name().to_string_lossy().into_owned();
                names.extend(Some(name).filter(|name| name.ends_with(&ending)));
            }
            names.sort_unstable();
            names
        }
    };
    if names.is_empty() {
        bail!("{}: there is nothing that can be imported", folder.display());
    }
    Ok((told, names.into_iter().map(|name| (name.clone(), folder.join(name))).collect()))
}

/// Sends files by `call`, which gets their chunks. Trajectories in a format of their own become the
/// server's form on the way.
pub(in crate::cli) async fn upload<T>(
    files: Files,
    format: Option<TrajectoryFormat>,
    call: impl AsyncFnOnce(ReceiverStream<v1::FileChunk>) -> Result<T, ClientError>,
) -> anyhow::Result<T> {
    let (sender, chunks) = mpsc::channel(2);
    let reading = tokio::task::spawn_blocking(move || {
        files.iter().try_for_each(|(path, file)| match format {
            None => send(path, fs::File::open(file)?, &sender),
            Some(_) => {
                let (trajectory, _) = Trajectory::read_any(file, format)?;
                let name = Path::new(path).with_extension("tum");
                send(&name.to_string_lossy(), &trajectory.to_bytes()[..], &sender)
            }
        })
    });
    let answer = call(ReceiverStream::new(chunks)).await;
    // A file that cannot be read is the cause of what the server says of it.
    reading.await.context("the files were not read to their end")??;
    Ok(answer?)
}

/// Sends a file in chunks. Ends early where nobody takes them any more; the call's answer then says
/// why.
fn send(
    path: &str,
    mut file: impl Read,
    chunks: &mpsc::Sender<v1::FileChunk>,
) -> anyhow::Result<()> {
    let read = |file: &mut dyn Read| -> std::io::Result<Vec<u8>> {
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
