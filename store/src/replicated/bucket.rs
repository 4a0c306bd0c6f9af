//! Reading a key of a bucket from its leader: a follower may not have the newest value yet.
//!
//! It writes nothing.

use async_nats::jetstream::kv;
use async_nats::jetstream::stream::{LastRawMessageError, LastRawMessageErrorKind};
use bytes::Bytes;

/// Marks a deleted key.
const OPERATION: &str = "KV-Operation";

/// The value of a key and its revision; `None` where the key was never there or is deleted.
///
/// # Errors
/// What NATS answered.
pub(super) async fn latest(
    bucket: &kv::Store,
    key: &str,
) -> Result<Option<(Bytes, u64)>, LastRawMessageError> {
    let subject = format!("{}{key}", bucket.prefix);
    let message = match bucket.stream.get_last_raw_message_by_subject(&subject).await {
        Ok(message) => message,
        Err(error) if error.kind() == LastRawMessageErrorKind::NoMessageFound => return Ok(None),
        Err(error) => return Err(error),
    };
    let is_put = |operation: &async_nats::HeaderValue| operation.as_str() == "PUT";
    if !message.headers.get(OPERATION).is_none_or(is_put) {
        return Ok(None);
    }
    Ok(Some((message.payload, message.sequence)))
}
