//! `covis map merge` and `covis map unmerge`: merges two maps, and separates them again.
//!
//! The server aligns the maps; nothing is decided here.

use serde::Serialize;

use super::super::output::show;
use super::document::Document;
use crate::client::Client;
use crate::wire::v1;

/// Arguments of `covis map merge`.
#[derive(Debug, clap::Args)]
pub(super) struct Args {
    /// The map to merge into.
    target: String,
    /// The map to merge; afterwards its name refers to the target.
    source: String,
    /// A new name for a client of the source, if the target already has a client of that name.
    #[arg(long, value_name = "CLIENT=NEW", value_parser = pair)]
    rename: Vec<(String, String)>,
}

fn pair(text: &str) -> Result<(String, String), String> {
    let pair = text.split_once('=').ok_or("CLIENT=NEW is needed")?;
    Ok((pair.0.to_owned(), pair.1.to_owned()))
}

#[derive(Debug, Serialize)]
struct Merged {
    target: Document,
    source: String,
    /// Position, m, and quaternion (x, y, z, w) of the source's world frame in the target's.
    target_from_source: [f64; 7],
    /// Length in the target of the source's unit of length.
    scale: f64,
    closures: i64,
}

#[derive(Debug, Serialize)]
struct Undone {
    map: Document,
    source: Document,
}

/// Merges two maps.
pub(super) async fn merge(client: &Client, args: Args, json: bool) -> anyhow::Result<()> {
    let renamed = |(client_id, new_client_id)| v1::RenamedClient { client_id, new_client_id };
    let request = v1::MergeMapsRequest {
        target_map_id: args.target,
        source_map_id: args.source.clone(),
        renamed_clients: args.rename.into_iter().map(renamed).collect(),
        ..v1::MergeMapsRequest::default()
    };
    let answer = client.merge_maps(request).await?;
    let pose = answer.target_from_source.unwrap_or_default();
    let (t, q) = (pose.translation.unwrap_or_default(), pose.rotation.unwrap_or_default());
    let merged = Merged {
        target: answer.map.unwrap_or_default().into(),
        source: args.source,
        target_from_source: [t.x, t.y, t.z, q.x, q.y, q.z, q.w],
        // An earlier server does not say.
        scale: if answer.scale == 0.0 { 1.0 } else { answer.scale },
        closures: answer.closure_count,
    };
    show(json, &merged, || {
        let Merged { target, source, scale, closures, .. } = &merged;
        let scaled = if *scale == 1.0 { String::new() } else { format!(", scaled by {scale:.4}") };
        format!(
            "map {source} is part of map {} now, {closures} loop closures connect them\n\
             it lies at ({:.3}, {:.3}, {:.3}) m, turned by {:.2} degrees{scaled}",
            target.map,
            t.x,
            t.y,
            t.z,
            2.0 * q.w.abs().min(1.0).acos().to_degrees()
        )
    })
}

/// Takes a map out of the one that it was merged into.
pub(super) async fn undo(
    client: &Client,
    map: String,
    source: String,
    json: bool,
) -> anyhow::Result<()> {
    let request = v1::UndoMergeRequest { map_id: map, source_map_id: source };
    let answer = client.undo_merge(request).await?;
    let undone = Undone {
        map: answer.map.unwrap_or_default().into(),
        source: answer.source.unwrap_or_default().into(),
    };
    show(json, &undone, || format!("map {} is a map of its own again", undone.source.map))
}
