//! The name of the map that a folder holds.

use prost::Message;

use super::{EncodingError, decode, v1};

/// The bytes of an identity.
pub(in crate::store) fn encode_identity(name: &str) -> Vec<u8> {
    v1::MapIdentity { name: name.to_owned() }.encode_to_vec()
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
