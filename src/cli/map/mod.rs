//! `covis map`: lists, shows, changes, moves and deletes the maps of a server.
//!
//! Everything goes through [`crate::client`]. `document.rs` prints a map, `export.rs` and `files.rs`
//! move maps to and from files, `constraints.rs` lists what ties keyframes, `closures.rs` where loops were
//! found, `edit.rs` changes what a map holds, `settings.rs` its name and policy, `merge.rs` makes one of two
//! maps, `copy.rs` one as it is or was.

mod closures;
mod constraints;
mod copy;
mod document;
mod edit;
mod export;
mod files;
mod merge;
mod settings;

use std::path::PathBuf;

use self::document::{Document, details, table};
use self::files::{Format, ImportArgs};
use super::config::Config;
use super::connect::with_client;
use super::output::show;
use super::overwrite::Overwrite;
use crate::client::Client;
use crate::wire::v1;

pub(in crate::cli) use export::{path_lines, write, write_files};
pub(in crate::cli) use files::{Files, Format as MapFormat, upload};

/// Lists, shows, changes, moves and deletes the maps of a server.
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
    #[command(visible_alias = "ls")]
    List,
    /// Show one map: counts, clients, bounds.
    Show {
        /// The map.
        name: String,
        /// Print only its policy, as TOML that `covis map set --policy` takes.
        #[arg(long)]
        policy: bool,
    },
    /// Create an empty map.
    Create(settings::CreateArgs),
    /// Change the policy of a map, and print it.
    Set(settings::SetArgs),
    /// Change the display name of a map. Its id never changes.
    Rename {
        /// The map.
        name: String,
        /// Free text for people.
        display_name: String,
    },
    /// List where keyframes looked like earlier ones: the loop closures that the server added, and why
    /// others were refused.
    Closures {
        /// Name of the map.
        name: String,
    },
    /// List the constraints of a map, and which of them are switched off.
    Constraints {
        /// The map.
        name: String,
    },
    /// Freeze a map: it can be read but not changed until you unfreeze it.
    Freeze {
        /// The map.
        name: String,
    },
    /// Unfreeze a map, so that it can be changed again.
    Unfreeze {
        /// The map.
        name: String,
    },
    /// Change or remove content of a map.
    Edit(edit::Args),
    /// Merge a map into another one that shows the same places.
    Merge(merge::Args),
    /// Take a map out of the one that it was merged into.
    Unmerge {
        /// The map that the other one is part of.
        target: String,
        /// The map to take out.
        source: String,
    },
    /// Copy a map as it is now into a new, frozen map.
    Snapshot(copy::SnapshotArgs),
    /// Restore an earlier state of a map from its journal, into a new map.
    Restore(copy::RestoreArgs),
    /// Delete a map with its journal.
    #[command(visible_alias = "rm")]
    Delete {
        /// The map.
        name: String,
    },
    /// Write a map to files.
    Export {
        /// The map.
        name: String,
        /// Format of the files [default: by the name of PATH; a name without extension is a COLMAP folder].
        #[arg(long)]
        format: Option<Format>,
        /// The file to write, or a folder if there are several (COLMAP's three, trajectories of several
        /// clients).
        #[arg(long, value_name = "PATH")]
        out: PathBuf,
        #[command(flatten)]
        overwrite: Overwrite,
        /// COLMAP: also write the points that fewer than two keyframes observe. COLMAP's bundle adjustment
        /// refuses such points.
        #[arg(long)]
        all_points: bool,
    },
    /// Create a map from files: an export of covis, COLMAP, g2o, or a trajectory.
    Import(ImportArgs),
}

/// Does what the arguments say.
/// Fails for a server that is not there, a map that it does not have, a file that cannot be read or
/// written.
pub(super) fn run(args: Args, config: &Config) -> anyhow::Result<()> {
    with_client(config, async |client| act(args, client).await)
}

/// The client of something, and its id.
type Key = (String, i64);

fn key(keyframe: Option<v1::KeyframeRef>) -> Option<Key> {
    keyframe.map(|keyframe| (keyframe.client_id, keyframe.id))
}

fn named((client, id): &Key) -> String {
    format!("{client}/{id}")
}

async fn act(Args { action, json }: Args, client: Client) -> anyhow::Result<()> {
    match action {
        Action::List => {
            let maps: Vec<Document> =
                client.list_maps().await?.into_iter().map(Document::from).collect();
            show(json, &maps, || table(&maps))
        }
        Action::Show { name, policy: true } => settings::show_policy(&client, &name, json).await,
        Action::Show { name, policy: false } => {
            let (map, digests) = client.get_map_digests(&name).await?;
            let map = Document::with_digests(map, &digests);
            show(json, &map, || details(&map))
        }
        Action::Closures { name } => closures::closures(&client, name, json).await,
        Action::Constraints { name } => constraints::constraints(&client, name, json).await,
        Action::Freeze { name } => set_frozen(&client, name, true, json).await,
        Action::Unfreeze { name } => set_frozen(&client, name, false, json).await,
        Action::Delete { name } => {
            client.delete_map(&name).await?;
            let document = serde_json::json!({ "map": name, "deleted": true });
            show(json, &document, || format!("map {name} is deleted"))
        }
        Action::Export { name, format, out, overwrite, all_points } => {
            let format = Format::of_export(format, &out)?;
            export::export(&client, (name, format, all_points), (&out, overwrite), json).await
        }
        Action::Import(args) => files::import(&client, args, json).await,
        Action::Create(args) => settings::create(&client, args, json).await,
        Action::Set(args) => settings::set(&client, args, json).await,
        Action::Rename { name, display_name } => {
            settings::rename(&client, name, display_name, json).await
        }
        Action::Snapshot(args) => copy::snapshot(&client, args, json).await,
        Action::Restore(args) => copy::restore(&client, args, json).await,
        Action::Merge(args) => merge::merge(&client, args, json).await,
        Action::Unmerge { target, source } => merge::undo(&client, target, source, json).await,
        Action::Edit(edit) => edit::run(edit, &client, json).await,
    }
}

/// Freezes a map or opens it again.
async fn set_frozen(
    client: &Client,
    name: String,
    is_frozen: bool,
    json: bool,
) -> anyhow::Result<()> {
    let state = if is_frozen { v1::MapState::Frozen } else { v1::MapState::Open };
    let request = v1::UpdateMapRequest {
        map_id: name,
        state: state.into(),
        update_mask: Some(prost_types::FieldMask { paths: vec!["state".to_owned()] }),
        ..v1::UpdateMapRequest::default()
    };
    let map = Document::from(client.update_map(request).await?);
    show(json, &map, || format!("map {} is {}", map.map, map.state))
}
