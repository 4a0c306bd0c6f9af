//! Imports: a map from the files of a format, as they are uploaded.
//!
//! A file of covis is read while it comes, and only the map that it holds is in memory; the files of
//! other formats are kept until all are there, because they refer to each other. The account of the
//! new map bounds both. A map exists once everything was read and checked, and not before: a call
//! that ends early leaves nothing. `upload.rs` takes the files, `models.rs` and
//! `graph.rs` make items of other formats.

mod graph;
mod models;
mod upload;

use tonic::Streaming;

use self::upload::{Import, Pipe, files, one_file, pipe};
use super::access::Caller;
use super::context::Context;
use super::convert::map::{
    ServerLimits, display_name, kept_display_name, policy, to_limits, to_policy,
};
use super::convert::{Path, convert, ids};
use super::engine::{EngineError, ImportRoom, ImportedAs};
use super::error::ServiceError;
use super::export::{Format, read_format};
use super::names::is_name;
use crate::map::{Map, MapPolicy, Reason};
use crate::store::{MapFileError, read_map_file};
use crate::wire::v1;

/// The owner of what is imported from a format without clients.
const DEFAULT_CLIENT: &str = "import";

/// What an import makes.
struct Header {
    name: String,
    imported: ImportedAs,
    format: Format,
    client: String,
    skip_unknown: bool,
}

/// A file of an upload.
struct File {
    path: String,
    bytes: Vec<u8>,
}

/// Reads an upload to its end and creates the map.
pub(super) async fn import(
    context: &Context,
    caller: &Caller,
    inbound: Streaming<v1::ImportMapRequest>,
) -> Result<v1::ImportMapResponse, ServiceError> {
    let limits = context.limits();
    let mut upload = Import::new(context, inbound);
    let header = header(upload.header().await?, caller, &limits)?;
    let Header { name, imported, format, client, skip_unknown } = header;
    let room = context.maps.begin_import(&name).await?;
    let mut warnings = Vec::new();
    let (content, room, imported) = match format {
        Format::Covis => {
            let (content, kept, room) = own(&mut upload, room, &limits).await?;
            let policy = imported.policy.unwrap_or(kept);
            if !content.keeps_anchor(&policy) {
                let text = "the file has positions that were measured from another anchor";
                let at = "policy.geodetic_anchor";
                return Err(ServiceError::field(at, Reason::Inconsistent, text));
            }
            (content, room, ImportedAs { policy: Some(policy), ..imported })
        }
        Format::Colmap(_) | Format::Tum | Format::G2o | Format::Ply => {
            let (files, room) = files(&mut upload, room).await?;
            let policy = match imported.policy {
                Some(policy) => policy,
                None => convert(|out| policy(None, &limits, out))?,
            };
            let built = move || models::build(format, &files, &client, skip_unknown, policy, room);
            let built = Context::blocking(built).await?;
            warnings = built.warnings;
            (built.map, built.room, imported)
        }
    };
    let info = context.maps.import(room, &name, content, imported).await?;
    Ok(v1::ImportMapResponse { map: Some(context.map_message(info).await?), warnings })
}

fn header(
    message: v1::ImportMapHeader,
    caller: &Caller,
    limits: &ServerLimits,
) -> Result<Header, ServiceError> {
    let header = convert(|out| {
        let map_id = ids::map_id(&message.map_id, out);
        let name = display_name(&message.display_name, out);
        let client = match message.client_id.as_str() {
            "" => Some(DEFAULT_CLIENT.to_owned()),
            client => ids::name(Path::root("client_id"), client, out),
        };
        let at = Path::root("format");
        let format = match read_format(at, message.format, out) {
            Some(Format::Ply) => {
                out.report(at, Reason::OutOfRange, "PLY holds points only and is not imported")
            }
            format => format,
        };
        let kept = match (message.policy, format) {
            (None, Some(Format::Covis) | None) => Some(None),
            (Some(wanted), Some(Format::Covis) | None) => {
                policy(Some(&wanted), limits, out).map(Some)
            }
            // Poses of other programs are estimates and no odometry.
            (wanted, Some(Format::Colmap(_) | Format::Tum | Format::G2o | Format::Ply)) => {
                let wanted = wanted.unwrap_or_default();
                let odometry = wanted.odometry.or(Some(false));
                let wanted = v1::MapPolicy { odometry, ..wanted };
                policy(Some(&wanted), limits, out).map(Some)
            }
        };
        let (map_id, display_name) = (map_id?, Some(name?).filter(|name| !name.is_empty()));
        Some(Header {
            name: caller.engine_name(&map_id),
            imported: ImportedAs { display_name, policy: kept?, frozen: None },
            format: format?,
            client: client?,
            skip_unknown: message.skip_unknown,
        })
    })?;
    Ok(header)
}

/// Reads a file of covis while it comes. The policy is that of the map in it.
async fn own(
    upload: &mut Import<'_>,
    mut room: ImportRoom,
    limits: &ServerLimits,
) -> Result<(Map, MapPolicy, ImportRoom), ServiceError> {
    let (sender, mut input) = pipe();
    let reading = tokio::task::spawn_blocking(move || {
        let mut full = None;
        let read = read_map_file(&mut input, &mut |usage| match room.reach(usage) {
            Ok(()) => true,
            Err(error) => {
                full = Some(error);
                false
            }
        });
        // What is left in the pipe is not read any more, which ends the upload.
        drop::<Pipe>(input);
        (read, full, room)
    });
    let sent = one_file(upload, sender).await;
    let (read, full, room) = match reading.await {
        Ok(read) => read,
        Err(error) if error.is_panic() => {
            return Err(ServiceError::Panicked { message: error.to_string() });
        }
        Err(_canceled) => return Err(EngineError::ShuttingDown.into()),
    };
    let path = sent?;
    if let Some(full) = full {
        return Err(full.into());
    }
    let map = read.map_err(|error| unreadable(&path, &error))?;
    clients_are_named(&map, &path)?;
    let policy = kept_policy(&map, &path, limits)?;
    Ok((map, policy, room))
}

/// The error for a file that is no map.
fn unreadable(path: &str, error: &MapFileError) -> ServiceError {
    let reason = match error {
        MapFileError::Damaged { .. } | MapFileError::Stopped => Reason::Inconsistent,
        MapFileError::Later { .. } => Reason::UnknownValue,
    };
    ServiceError::field("chunk.data", reason, format!("{path}: {error}"))
}

/// The store takes any text for the name of a client; the wire does not.
fn clients_are_named(map: &Map, path: &str) -> Result<(), ServiceError> {
    let bad = map.clients().iter().find(|client| !is_name(&client.name));
    bad.map_or(Ok(()), |client| {
        let text = format!("{path}: {:?} is not the name of a client", client.name);
        Err(ServiceError::field("chunk.data", Reason::OutOfRange, text))
    })
}

/// The policy of an imported map, checked with its name as what a client sends. Its limits are never
/// above those of this server.
fn kept_policy(map: &Map, path: &str, limits: &ServerLimits) -> Result<MapPolicy, ServiceError> {
    let MapPolicy { max_queued_items, .. } = *map.policy();
    let mut message = to_policy(map.policy(), limits.queued_items);
    message.limits = Some(v1::MapLimits {
        max_queued_item_count: None,
        ..to_limits(&map.policy().limits, limits.queued_items)
    });
    let checked = convert(|out| {
        kept_display_name(map.display_name(), out)?;
        policy(Some(&message), limits, out)
    });
    let checked = checked.map_err(|rejection| {
        ServiceError::field("chunk.data", Reason::Inconsistent, format!("{path}: {rejection}"))
    })?;
    let max_queued_items = max_queued_items.map(|items| items.clamp(1, 65_536));
    let limits = map.policy().limits.lower(&checked.limits);
    Ok(MapPolicy { max_queued_items, limits, ..*map.policy() })
}
