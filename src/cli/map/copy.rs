//! `covis map snapshot` and `covis map restore`: a map as it is, or was, as another map.
//!
//! The server copies and replays; here a revision is distinguished from a time.

use prost_types::Timestamp;
use serde::Serialize;

use super::super::output::show;
use super::super::progress::Working;
use super::document::Document;
use crate::client::Client;
use crate::wire::v1;
use v1::copy_map_request::At;

/// Arguments of `covis map snapshot`.
#[derive(Debug, clap::Args)]
pub(super) struct SnapshotArgs {
    /// The map.
    map: String,
    /// The new map.
    new: String,
}

/// Arguments of `covis map restore`.
#[derive(Debug, clap::Args)]
pub(super) struct RestoreArgs {
    /// The map; it stays as it is.
    map: String,
    /// The new map.
    new: String,
    /// The state of the map to restore: a revision, or a time such as 2026-03-01T12:00:00Z (RFC 3339).
    #[arg(long, value_name = "REVISION|TIME", value_parser = moment)]
    at: At,
}

fn moment(text: &str) -> Result<At, String> {
    if let Ok(revision) = text.parse() {
        return Ok(At::Revision(revision));
    }
    let must = "a revision is needed, or a time such as 2026-03-01T12:00:00Z";
    // The parser takes dates without a time and times without a zone too, which name no moment.
    let has_zone = text.ends_with(['Z', 'z'])
        || text
            .get(text.len().saturating_sub(6)..)
            .is_some_and(|zone| zone.starts_with(['+', '-']));
    let time = text.contains(['T', 't', ' ']) && has_zone;
    let time = time.then(|| text.parse::<Timestamp>().ok()).flatten();
    time.map(At::Time).ok_or_else(|| must.to_owned())
}

#[derive(Debug, Serialize)]
struct Copied {
    source: String,
    /// The revision of the source that the new map shows.
    revision: i64,
    /// When the source came to that revision (RFC 3339).
    time: Option<String>,
    new: Document,
}

/// Copies a map as it is now; the copy is frozen.
pub(super) async fn snapshot(
    client: &Client,
    SnapshotArgs { map, new }: SnapshotArgs,
    json: bool,
) -> anyhow::Result<()> {
    let state = v1::MapState::Frozen.into();
    copy(client, v1::CopyMapRequest { source_map_id: map, new_map_id: new, at: None, state }, json)
        .await
}

/// Copies a map as it was.
pub(super) async fn restore(client: &Client, args: RestoreArgs, json: bool) -> anyhow::Result<()> {
    let RestoreArgs { map, new, at } = args;
    let state = v1::MapState::Open.into();
    let request = v1::CopyMapRequest { source_map_id: map, new_map_id: new, at: Some(at), state };
    copy(client, request, json).await
}

async fn copy(client: &Client, request: v1::CopyMapRequest, json: bool) -> anyhow::Result<()> {
    let source = request.source_map_id.clone();
    let working = Working::new(format_args!("copying {source}"));
    let answer = client.copy_map(request).await?;
    drop(working);
    let copied = Copied {
        source,
        revision: answer.revision,
        time: answer.time.map(|time| time.to_string()),
        new: answer.map.unwrap_or_default().into(),
    };
    show(json, &copied, || {
        let Copied { source, revision, time, new } = &copied;
        let time = time.as_deref().map(|time| format!(", of {time}")).unwrap_or_default();
        format!("map {} ({}) shows map {source} at revision {revision}{time}", new.map, new.state)
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_moment_is_a_revision_or_a_time_with_a_zone() {
        assert_eq!(moment("12"), Ok(At::Revision(12)));
        let time = |seconds, nanos| Ok(At::Time(Timestamp { seconds, nanos }));
        assert_eq!(moment("1970-01-02T00:00:01.5Z"), time(86_401, 500_000_000));
        assert_eq!(moment("1970-01-02T02:00:00+02:00"), time(86_400, 0));
        for text in
            ["", "yesterday", "1970-01-02", "1970-01-02T00:00:01", "1970-13-02T00:00:01Z", "é"]
        {
            assert!(moment(text).unwrap_err().contains("revision"), "{text}");
        }
    }
}
