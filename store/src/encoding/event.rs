//! One event as bytes: revision and cause, the change by `change.rs`; and the name of the map that a
//! folder holds. Where the bytes are kept, and their checksums, are not known here.

use prost::Message;

use super::change::{decode_change, encode_change, name_of};
use super::{EncodingError, append, decode, decode_known, encode, required, v1};
use covis_map::{Cause, Change, ClientIndex, Digest, Event};

/// An event in a line, for people.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct EventOutline {
    /// Its revision.
    pub revision: i64,
    /// [`Change::name`], or `unknown`.
    pub kind: &'static str,
    /// Unix time in nanoseconds by the server's clock; 0 where it was not recorded.
    pub time_ns: i64,
    /// The client's position in the map, and the sequence of the item that caused it; `None` for the
    /// server's own events.
    pub cause: Option<(u32, i64)>,
}

/// Appends the bytes of an event to `out`.
pub(crate) fn encode_event(event: &Event, out: &mut Vec<u8>) {
    let Event { revision, time_ns, cause, change } = event;
    let cause = cause.map(|Cause { client, epoch, sequence, digest }| v1::Cause {
        client: client.0,
        epoch,
        sequence,
        digest: digest.to_vec(),
    });
    let change = Some(encode_change(change));
    let message = v1::Event { revision: *revision, cause, time_ns: *time_ns, change };
    append(&message, out);
}

/// Appends the bytes of an event to `out` and reads them again: what is journaled can be read.
///
/// Decoding and encoding once more gives the same bytes exactly if decoding gave the same event.
///
/// # Errors
/// [`EncodingError`] where they would not be read as the same event; `out` is then as it was.
pub(crate) fn encode_readable(event: &Event, out: &mut Vec<u8>) -> Result<(), EncodingError> {
    let start = out.len();
    encode_event(event, out);
    if !is_read_again(&event.change) {
        return Ok(());
    }
    let mut again = Vec::new();
    let read = decode_event(&out[start..]).map(|decoded| encode_event(&decoded, &mut again));
    let same = match read {
        Ok(()) if again == out[start..] => return Ok(()),
        Ok(()) => Err(EncodingError::Different { part: "the values of the event" }),
        Err(error) => Err(error),
    };
    out.truncate(start);
    same
}

/// Whether an event is read again before it is journaled. A client's keyframes and what belongs to them are
/// most of a journal, and their values passed the checks of items: they are read again by tests, simulations
/// and fuzz targets only (decision 0044).
fn is_read_again(change: &Change) -> bool {
    let is_item = matches!(
        change,
        Change::KeyframeAdded { .. }
            | Change::LandmarksAdded { .. }
            | Change::ObservationsAdded { .. }
            | Change::ItemRepeated
    );
    cfg!(debug_assertions) || !is_item
}

/// What bytes that are no event of ours were meant to be: the kind of change, the time, and the item that
/// caused it, as far as they can be read.
pub(crate) fn outline(bytes: &[u8]) -> EventOutline {
    let read = decode_known::<v1::Event>(bytes).unwrap_or_default();
    let cause = read.cause.map(|cause| (cause.client, cause.sequence));
    EventOutline {
        revision: read.revision,
        kind: read.change.as_ref().map_or("unknown", name_of),
        time_ns: read.time_ns,
        cause,
    }
}

/// The event of `bytes`.
///
/// # Errors
/// [`EncodingError`] where they are no event, or one of a later version.
pub(crate) fn decode_event(bytes: &[u8]) -> Result<Event, EncodingError> {
    let v1::Event { revision, cause, time_ns, change } = decode(bytes)?;
    let cause = cause.map(decode_cause).transpose()?;
    let change = decode_change(required(change, "the change")?)?;
    Ok(Event { revision, time_ns, cause, change })
}

fn decode_cause(cause: v1::Cause) -> Result<Cause, EncodingError> {
    let v1::Cause { client, epoch, sequence, digest } = cause;
    Ok(Cause { client: ClientIndex(client), epoch, sequence, digest: decode_digest(&digest)? })
}

pub(super) fn decode_digest(bytes: &[u8]) -> Result<Digest, EncodingError> {
    Digest::try_from(bytes).map_err(|_length| EncodingError::Invalid("a digest"))
}

/// The bytes of an identity.
pub(crate) fn encode_identity(name: &str) -> Vec<u8> {
    encode(&v1::MapIdentity { name: name.to_owned() })
}

/// The map's name in an identity of any later version: its field 1 stays the name forever.
pub(crate) fn decode_later_identity(bytes: &[u8]) -> Result<String, EncodingError> {
    let identity = v1::MapIdentity::decode(bytes);
    identity
        .map(|identity| identity.name)
        .map_err(|error| EncodingError::Message(error.to_string()))
}

/// The map's name.
pub(crate) fn decode_identity(bytes: &[u8]) -> Result<String, EncodingError> {
    decode::<v1::MapIdentity>(bytes).map(|identity| identity.name)
}
