//! `covis map create`, `set`, `rename` and `show --policy`: a map's name and policy.
//!
//! `policy.rs` reads and writes the file of a policy; the server checks its ranges.

use std::path::PathBuf;

use anyhow::bail;

use super::super::output::show;
use super::super::policy::{Policy, PolicyFile};
use super::document::{Document, details};
use crate::client::Client;
use crate::wire::v1;

/// Arguments of `covis map create`.
#[derive(Debug, clap::Args)]
pub(super) struct CreateArgs {
    /// The new map: a-z, 0-9, '_' and '-'.
    name: String,
    /// Free text for people.
    #[arg(long, value_name = "TEXT", default_value = "")]
    display_name: String,
    /// File (TOML) with fields of the map's policy; the others have the server's defaults.
    #[arg(long, value_name = "FILE")]
    policy: Option<PathBuf>,
}

/// Arguments of `covis map set`.
#[derive(Debug, clap::Args)]
pub(super) struct SetArgs {
    /// The map.
    name: String,
    /// File (TOML) with the fields of the policy that are to change; `covis map show NAME --policy`
    /// prints one.
    #[arg(long, value_name = "FILE", required_unless_present = "reset")]
    policy: Option<PathBuf>,
    /// A field of the policy that is to have the server's default, such as `gauge` or
    /// `limits.max_keyframe_count`.
    #[arg(long, value_name = "FIELD")]
    reset: Vec<String>,
}

/// Creates an empty map and prints it.
pub(super) async fn create(client: &Client, args: CreateArgs, json: bool) -> anyhow::Result<()> {
    let file = args.policy.as_deref().map(PolicyFile::read).transpose()?;
    let request = v1::CreateMapRequest {
        map_id: args.name,
        display_name: args.display_name,
        policy: file.as_ref().map(|file| file.policy.to_wire()),
    };
    let map = client.create_map_with(request).await;
    let map = Document::from(map.map_err(|error| blame(file.as_ref(), error.into()))?);
    show(json, &map, || details(&map))
}

/// Changes the policy of a map and prints it.
pub(super) async fn set(client: &Client, args: SetArgs, json: bool) -> anyhow::Result<()> {
    let file = args.policy.as_deref().map(PolicyFile::read).transpose()?;
    let mut paths: Vec<String> = file.iter().flat_map(PolicyFile::paths).collect();
    if let Some(path) = args.policy.as_deref().filter(|_| paths.is_empty()) {
        bail!("{}: it names no field of a policy", path.display());
    }
    paths.extend(args.reset.iter().map(|field| format!("policy.{field}")));
    let request = v1::UpdateMapRequest {
        map_id: args.name,
        policy: file.as_ref().map(|file| file.policy.to_wire()),
        update_mask: Some(prost_types::FieldMask { paths }),
        ..v1::UpdateMapRequest::default()
    };
    let map = client.update_map(request).await;
    let map = map.map_err(|error| blame(file.as_ref(), error.into()))?;
    let policy = Policy::of_wire(&map.policy.unwrap_or_default());
    let text = policy.to_toml()?;
    show(json, &policy, || text.trim_end().to_owned())
}

/// Gives a map another display name.
pub(super) async fn rename(
    client: &Client,
    name: String,
    display_name: String,
    json: bool,
) -> anyhow::Result<()> {
    let request = v1::UpdateMapRequest {
        map_id: name,
        display_name,
        update_mask: Some(prost_types::FieldMask { paths: vec!["display_name".to_owned()] }),
        ..v1::UpdateMapRequest::default()
    };
    let map = Document::from(client.update_map(request).await?);
    show(json, &map, || details(&map))
}

/// Prints the policy of a map, as `set` takes it.
pub(super) async fn show_policy(client: &Client, name: &str, json: bool) -> anyhow::Result<()> {
    let policy = Policy::of_wire(&client.get_map(name).await?.policy.unwrap_or_default());
    let text = policy.to_toml()?;
    show(json, &policy, || text.trim_end().to_owned())
}

fn blame(file: Option<&PolicyFile>, error: anyhow::Error) -> anyhow::Error {
    match file {
        Some(file) => file.blame(error),
        None => error,
    }
}
