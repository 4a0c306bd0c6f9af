//! The name of the map that a folder holds.

use prost::Message;

use super::{EncodingError, decode, v1};

/// The bytes of an identity.
pub(in crate::store) fn encode_identity(name: &str) -> Vec<u8> {
    v1::MapIdentity { name: name.to_owned() }.encode_to_vec()
}

/// The map's name.
pub(in crate::store) fn decode_identity(bytes: &[u8]) -> Result<String, EncodingError> {
    decode::<v1::MapIdentity>(bytes).map(|identity| identity.name)
}
