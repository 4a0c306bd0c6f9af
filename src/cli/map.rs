//! `covis map`: lists, shows, edits, deletes and exports the maps of a server.
//!
//! Everything goes through [`crate::client`]. An export is written chunk by chunk; a file that
//! stands in its way is replaced only once the new one is complete.

use std::io::Write;
use std::path::{Path, PathBuf};

use anyhow::{Context, bail};
use fs_err as fs;
use serde::Serialize;

use super::config::Config;
use super::connect::connect;
use super::edit;
use super::output::print;
use crate::client::MapExport;
use crate::wire::v1;

/// Lists, shows, edits, deletes and exports the maps of a server.
#[derive(Debug, clap::Args)]
pub(super) struct Args {
    #[command(subcommand)]
    action: Action,
    /// Print JSON instead of text.
    #[arg(long, global = true)]
    json: bool,
}

#[derive(Debug, clap::Subcommand)]
enum Action {
    /// List all maps.
    List,
    /// Show one map: counts, clients, bounds.
    Show {
        /// The map.
        name: String,
    },
    /// Change or remove what a map holds.
    Edit(edit::Args),
    /// Delete a map with its journal.
    Delete {
        /// The map.
        name: String,
    },
    /// Write a map to files.
    Export {
        /// The map.
        name: String,
        /// What to write.
        #[arg(long)]
        format: Format,
        /// The file; a folder where there are several (COLMAP's three, TUM with several clients).
        #[arg(long, value_name = "PATH")]
        out: PathBuf,
    },
}

#[derive(Clone, Copy, Debug, clap::ValueEnum)]
enum Format {
    /// COLMAP sparse model as text.
    ColmapText,
    /// COLMAP sparse model in binary.
    ColmapBinary,
    /// TUM trajectories.
    Tum,
    /// Pose graph: keyframes and their constraints.
    G2o,
    /// Landmarks and trajectories for viewers.
    Ply,
}

impl From<Format> for v1::MapFormat {
    fn from(format: Format) -> Self {
        match format {
            Format::ColmapText => Self::ColmapText,
            Format::ColmapBinary => Self::ColmapBinary,
            Format::Tum => Self::Tum,
            Format::G2o => Self::G2o,
            Format::Ply => Self::Ply,
        }
    }
}

/// A map in `--json`.
#[derive(Debug, Serialize)]
struct Document {
    map: String,
    display_name: String,
    state: &'static str,
    uid: String,
    revision: i64,
    cameras: i64,
    keyframes: i64,
    landmarks: i64,
    positioned_landmarks: i64,
    observations: i64,
    constraints: i64,
    switched_off_constraints: i64,
    size_bytes: i64,
    clients: Vec<ClientDocument>,
    #[serde(skip_serializing_if = "Option::is_none")]
    landmark_bounds: Option<[[f64; 3]; 2]>,
    #[serde(flatten, skip_serializing_if = "Option::is_none")]
    digests: Option<Digests>,
}

/// What `show` adds: SHA-256 in hex, as `GetMapResponse` describes them.
#[derive(Debug, Serialize)]
struct Digests {
    keyframe_ids_digest: String,
    state_hash: String,
}

#[derive(Debug, Serialize)]
struct ClientDocument {
    client: String,
    epoch: i64,
    next_sequence: i64,
}

/// Files of an export in `--json`.
#[derive(Debug, Serialize)]
struct Exported {
    map: String,
    revision: i64,
    files: Vec<PathBuf>,
}

/// Lists, shows, edits, deletes and exports the maps of a server.
/// Fails for a server that is not there, a map that it does not have, a file that cannot be
/// written.
pub(super) fn run(args: Args, config: &Config) -> anyhow::Result<()> {
    let runtime = tokio::runtime::Runtime::new().context("the async runtime")?;
    runtime.block_on(act(args, config))
}

async fn act(args: Args, config: &Config) -> anyhow::Result<()> {
    let client = connect(config).await?;
    match args.action {
        Action::List => {
            let maps: Vec<Document> =
                client.list_maps().await?.into_iter().map(Document::from).collect();
            let text = if args.json { serde_json::to_string(&maps)? } else { table(&maps) };
            print(text)?;
        }
        Action::Show { name } => {
            let (map, digests) = client.get_map_digests(&name).await?;
            let digests = Some(Digests {
                keyframe_ids_digest: hex(&digests.keyframe_ids_digest),
                state_hash: hex(&digests.state_hash),
            });
            let map = Document { digests, ..Document::from(map) };
            let text = if args.json { serde_json::to_string(&map)? } else { details(&map) };
            print(text)?;
        }
        Action::Edit(edit) => edit::run(edit, &client, args.json).await?,
        Action::Delete { name } => {
            client.delete_map(&name).await?;
            let json = || serde_json::json!({ "map": name, "deleted": true }).to_string();
            print(if args.json { json() } else { format!("map {name} is deleted") })?;
        }
        Action::Export { name, format, out } => {
            let export = client.export_map(&name, format.into()).await?;
            let revision = export.header().revision;
            let files = write(export, &out).await?;
            if args.json {
                print(serde_json::to_string(&Exported { map: name, revision, files })?)?;
            } else {
                for file in files {
                    print(file.display())?;
                }
            }
        }
    }
    Ok(())
}

/// Writes the files of an export and returns their paths. An export of one file goes to `out`
/// itself, unless that is a folder; one of several into the folder `out`.
pub(super) async fn write(mut export: MapExport, out: &Path) -> anyhow::Result<Vec<PathBuf>> {
    let paths = export.header().paths.clone();
    let is_folder = paths.len() != 1 || out.is_dir();
    if paths.is_empty() {
        bail!("the map holds nothing to export in this format");
    }
    let target = |path: &str| if is_folder { out.join(path) } else { out.to_owned() };
    let mut open: Option<(PathBuf, fs::File)> = None;
    while let Some(chunk) = export.next().await? {
        let path = target(&chunk.path);
        let partial = partial(&path);
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
            file.sync_all()?;
            fs::rename(&partial, &path)?;
        } else {
            open = Some((path, file));
        }
    }
    Ok(paths.iter().map(|path| target(path)).collect())
}

/// Where a file stands until it is complete.
fn partial(path: &Path) -> PathBuf {
    let mut name = path.as_os_str().to_owned();
    name.push(".partial");
    PathBuf::from(name)
}

impl From<v1::Map> for Document {
    fn from(map: v1::Map) -> Self {
        let counts = map.counts.unwrap_or_default();
        let state = match map.state() {
            v1::MapState::Open => "open",
            v1::MapState::Frozen => "frozen",
            v1::MapState::Poisoned => "poisoned",
            v1::MapState::Unspecified => "unknown",
        };
        let corner = |v: Option<v1::Vector3>| v.map(|v| [v.x, v.y, v.z]);
        let bounds = map.landmark_bounds;
        Self {
            map: map.map_id,
            display_name: map.display_name,
            state,
            uid: map.uid,
            revision: map.revision,
            cameras: counts.camera_count,
            keyframes: counts.keyframe_count,
            landmarks: counts.landmark_count,
            positioned_landmarks: counts.positioned_landmark_count,
            observations: counts.observation_count,
            constraints: counts.constraint_count,
            switched_off_constraints: counts.switched_off_constraint_count,
            size_bytes: counts.size_bytes,
            clients: map
                .clients
                .into_iter()
                .map(|c| ClientDocument {
                    client: c.client_id,
                    epoch: c.epoch,
                    next_sequence: c.next_sequence,
                })
                .collect(),
            landmark_bounds: bounds.and_then(|b| Some([corner(b.min)?, corner(b.max)?])),
            digests: None,
        }
    }
}

fn hex(bytes: &[u8]) -> String {
    bytes.iter().map(|byte| format!("{byte:02x}")).collect()
}

fn table(maps: &[Document]) -> String {
    if maps.is_empty() {
        return "no maps".to_owned();
    }
    let width = maps.iter().map(|m| m.map.len()).max().unwrap_or(0).max(3);
    let mut text = format!(
        "{:<width$}  {:>9}  {:>9}  {:>12}  {:>9}  {:>8}",
        "map", "keyframes", "landmarks", "observations", "revision", "state"
    );
    for m in maps {
        text.push_str(&format!(
            "\n{:<width$}  {:>9}  {:>9}  {:>12}  {:>9}  {:>8}",
            m.map, m.keyframes, m.landmarks, m.observations, m.revision, m.state
        ));
    }
    text
}

fn details(map: &Document) -> String {
    let constraints = match map.switched_off_constraints {
        0 => map.constraints.to_string(),
        off => format!("{} ({off} found false)", map.constraints),
    };
    let mut rows = vec![
        ("map", map.map.clone()),
        ("state", map.state.to_owned()),
        ("revision", map.revision.to_string()),
        ("cameras", map.cameras.to_string()),
        ("keyframes", map.keyframes.to_string()),
        ("landmarks", format!("{} ({} with a position)", map.landmarks, map.positioned_landmarks)),
        ("observations", map.observations.to_string()),
        ("constraints", constraints),
        ("memory", format!("{} KiB", map.size_bytes.div_euclid(1024))),
    ];
    if let Some([min, max]) = map.landmark_bounds {
        let corner = |c: [f64; 3]| format!("({:.3}, {:.3}, {:.3})", c[0], c[1], c[2]);
        rows.push(("bounds (m)", format!("{} to {}", corner(min), corner(max))));
    }
    if let Some(digests) = &map.digests {
        rows.push(("state hash", digests.state_hash.clone()));
    }
    for c in &map.clients {
        let text = format!("{}, epoch {}, goes on at {}", c.client, c.epoch, c.next_sequence);
        rows.push(("client", text));
    }
    let lines: Vec<String> =
        rows.into_iter().map(|(name, value)| format!("{name:<13} {value}")).collect();
    lines.join("\n")
}
