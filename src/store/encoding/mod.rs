//! Events and maps as bytes: the messages of `proto/covis/storage/v1`.
//!
//! Encoding is exact: a decoded value has the bits of the encoded one. Decoding refuses what it does
//! not know, because an event read in part is another event: a value whose own encoding is shorter
//! than what was read held a field of a later version. Nothing here knows files or checksums, and
//! nothing outside this folder names a generated type.

mod change;
mod entities;
mod event;
mod identity;
mod snapshot;

pub(super) use event::{decode_event, encode_event};
pub(super) use identity::{decode_identity, encode_identity};
pub(super) use snapshot::{decode_map, encode_map};

/// Generated from `proto/covis/storage/v1`.
mod v1 {
    #![allow(missing_docs, reason = "the comments stand in the proto files")]
    #![allow(clippy::all, reason = "generated code")]
    #![allow(clippy::allow_attributes_without_reason, reason = "generated code")]
    #![allow(unreachable_pub, reason = "generated code")]
    include!(concat!(env!("OUT_DIR"), "/covis.storage.v1.rs"));
}

/// Why bytes are no event or no map.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum EncodingError {
    /// The bytes are no message.
    #[error("not a message: {0}")]
    Message(String),
    /// A field that must be there is not.
    #[error("{0} is missing")]
    Missing(&'static str),
    /// A field has a value that it cannot have.
    #[error("{0} has a value that is not known")]
    Invalid(&'static str),
    /// The message holds fields that this version does not know.
    #[error("written by a later version: it holds fields that are not known here")]
    Later,
    /// The parts of a map do not fit each other.
    #[error("the parts do not fit: {0}")]
    Map(#[from] crate::map::MapError),
    /// The decoded map is another one than was encoded.
    #[error("the decoded map has another state hash than was written")]
    Hash,
    /// The stream of parts cannot be read or written.
    #[error("{0}")]
    Stream(String),
}

/// A field that must be there.
fn required<T>(value: Option<T>, name: &'static str) -> Result<T, EncodingError> {
    value.ok_or(EncodingError::Missing(name))
}

/// Decodes a message and refuses unknown fields.
fn decode<M: prost::Message + Default>(bytes: &[u8]) -> Result<M, EncodingError> {
    let message = M::decode(bytes).map_err(|error| EncodingError::Message(error.to_string()))?;
    if message.encoded_len() == bytes.len() { Ok(message) } else { Err(EncodingError::Later) }
}

#[cfg(test)]
pub(in crate::store) mod tests;
