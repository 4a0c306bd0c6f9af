//! Events and maps as bytes: the messages of `proto/covis/storage/v1`.
//!
//! Encoding is exact: a decoded value has the bits of the encoded one. Decoding refuses what it does
//! not know, because an event read in part is another event: a value whose own encoding is shorter
//! than what was read held a field of a later version. Nothing here knows files or checksums, and
//! nothing outside this folder names a generated type.

mod change;
mod clients;
mod comparison;
mod entities;
mod event;
mod jobs;
mod joined;
mod merging;
mod places;
mod snapshot;

pub(super) use comparison::compare_map;
pub use event::EventOutline;
#[cfg(any(test, feature = "cluster", feature = "fuzzing"))]
pub(super) use event::encode_event;
pub(super) use event::{
    decode_event, decode_identity, decode_later_identity, encode_identity, encode_readable, outline,
};
pub(super) use jobs::{
    decode_checkpoint, decode_job, decode_later_job, decode_upload, encode_checkpoint, encode_job,
    encode_upload,
};
pub(super) use joined::{PartsReader, decode_map};
pub(super) use snapshot::{Parts, encode_map};

use std::sync::LazyLock;

use super::{StoreError, sequence_of};
use covis_client::decoding::Shapes;
use covis_map::Event;

/// Generated from `proto/covis/storage/v1`.
mod v1 {
    #![allow(missing_docs, reason = "the comments stand in the proto files")]
    #![allow(clippy::all, reason = "generated code")]
    #![allow(clippy::allow_attributes_without_reason, reason = "generated code")]
    #![allow(unreachable_pub, reason = "generated code")]
    include!("generated/covis.storage.v1.rs");

    /// The encoded `FileDescriptorSet` of the package.
    pub const FILE_DESCRIPTOR_SET: &[u8] = include_bytes!("generated/covis.storage.v1.bin");
}

static SHAPES: LazyLock<Shapes> = LazyLock::new(|| Shapes::of(v1::FILE_DESCRIPTOR_SET));

/// Why bytes are no event or no map.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[allow(missing_docs, reason = "the messages say what the fields are")]
pub enum EncodingError {
    /// The bytes are no message.
    #[error("not a message: {0}")]
    Message(String),
    /// A field that must be there is not.
    #[error("{0} is missing")]
    Missing(&'static str),
    /// A field has a value that it cannot have.
    #[error("{0} has an unknown value")]
    Invalid(&'static str),
    /// The message holds fields that this version does not know.
    #[error("written by a later version: it holds unknown fields")]
    Later,
    /// The parts of a map do not fit each other.
    #[error("the parts do not fit: {0}")]
    Map(#[from] covis_map::MapError),
    /// The decoded map is another one than was encoded.
    #[error("the decoded map has another state hash than was written")]
    Hash,
    /// What is read is not what was written.
    #[error("{part} are not what was written")]
    Different {
        /// In the plural.
        part: &'static str,
    },
    /// The stream of parts cannot be read or written.
    #[error("{0}")]
    Stream(String),
}

impl EncodingError {
    /// The refusal of an event of a map that could not be read again.
    pub(super) fn not_readable(self, map: &str, event: &Event) -> StoreError {
        StoreError::NotReadable {
            map: map.to_owned(),
            sequence: sequence_of(event.revision),
            kind: event.change.name(),
            reason: self.to_string(),
        }
    }
}

/// A field that must be there.
fn required<T>(value: Option<T>, name: &'static str) -> Result<T, EncodingError> {
    value.ok_or(EncodingError::Missing(name))
}

/// Events, and parts of maps, that take as much memory as they can.
#[cfg(any(test, feature = "fuzzing"))]
pub(super) fn densest(length: usize) -> [Vec<Vec<u8>>; 2] {
    use prost::Name as _;
    let of = |name: String| SHAPES.densest(&name, length);
    [of(v1::Event::full_name()), of(v1::MapPart::full_name())]
}

/// Appends the bytes of a message to `out`.
///
/// Into a slice of its length: a vector looks at its capacity with each byte of a number, and journals
/// append up to a third less in a second (decision 0011).
fn append(message: &impl prost::Message, out: &mut Vec<u8>) {
    let start = out.len();
    out.resize(start + message.encoded_len(), 0);
    message.encode_raw(&mut &mut out[start..]);
}

/// The bytes of a message.
fn encode(message: &impl prost::Message) -> Vec<u8> {
    let mut bytes = Vec::new();
    append(message, &mut bytes);
    bytes
}

/// Decodes a message without the fields that are not known here, and refuses what takes more memory
/// than its bytes are worth.
fn decode_known<M: prost::Name + Default>(bytes: &[u8]) -> Result<M, EncodingError> {
    let dense = SHAPES.check(&M::full_name(), bytes);
    dense.map_err(|error| EncodingError::Message(error.to_string()))?;
    M::decode(bytes).map_err(|error| EncodingError::Message(error.to_string()))
}

/// Decodes a message and refuses unknown fields, and what no event or map of ours looks like: more
/// memory than its bytes are worth.
fn decode<M: prost::Name + Default>(bytes: &[u8]) -> Result<M, EncodingError> {
    let message: M = decode_known(bytes)?;
    if message.encoded_len() == bytes.len() { Ok(message) } else { Err(EncodingError::Later) }
}

#[cfg(test)]
pub(crate) mod tests;
