//! One event as bytes: revision and cause, the change by `change.rs`; and the name of the map that a
//! folder holds. Where the bytes are kept, and their checksums, are not known here.

use prost::Message;

use super::change::{decode_change, encode_change};
use super::{EncodingError, append, decode, encode, required, v1};
use crate::map::{Cause, ClientIndex, Digest, Event};

/// Appends the bytes of an event to `out`.
pub(in crate::store) fn encode_event(event: &Event, out: &mut Vec<u8>) {
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

/// The event of `bytes`.
///
/// # Errors
/// [`EncodingError`] where they are no event, or one of a later version.
pub(in crate::store) fn decode_event(bytes: &[u8]) -> Result<Event, EncodingError> {
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
pub(in crate::store) fn encode_identity(name: &str) -> Vec<u8> {
    encode(&v1::MapIdentity { name: name.to_owned() })
}

/// The map's name in an identity of any later version: its field 1 stays the name forever.
pub(in crate::store) fn decode_later_identity(bytes: &[u8]) -> Result<String, EncodingError> {
    let identity = v1::MapIdentity::decode(bytes);
    identity
        .map(|identity| identity.name)
        .map_err(|error| EncodingError::Message(error.to_string()))
}

/// The map's name.
pub(in crate::store) fn decode_identity(bytes: &[u8]) -> Result<String, EncodingError> {
    decode::<v1::MapIdentity>(bytes).map(|identity| identity.name)
}
