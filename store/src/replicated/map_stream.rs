//! A map's stream: one a map, with one subject.
//!
//! Every message is published with the sequence that the stream must end at, so that the stream itself
//! refuses a writer that does not know its end. A server takes a map over by an owner message at the end;
//! from then on the server that had the map before is refused. A message whose answer was lost is looked up:
//! it arrived, or somebody else's did.

use std::time::Duration;

use async_nats::jetstream::ErrorCode;
use async_nats::jetstream::consumer::DeliverPolicy;
use async_nats::jetstream::consumer::pull::OrderedConfig;
use async_nats::jetstream::context::{Context, GetStreamErrorKind, PublishErrorKind};
use async_nats::jetstream::message::PublishMessage;
use async_nats::jetstream::stream::{self, DiscardPolicy, RetentionPolicy, StorageType, Stream};
use futures_util::StreamExt;

use super::message::{Outgoing, Owner, Reading, owner_headers};
use super::unavailable;
use crate::StoreError;

/// How long the next message of a stream may take while it is read.
const LONGEST_READ: Duration = Duration::from_secs(10);
/// How often a takeover is tried while the former owner still writes.
const FENCES: u32 = 16;

/// Why a message is not known to be in the stream.
#[derive(Debug)]
pub(super) enum PutError {
    /// Another server took the map over, or the map is gone.
    Fenced,
    /// It may be there or not: the same message can be put again.
    Unknown { cause: String },
}

/// The stream of one map.
#[derive(Clone, Debug)]
pub(super) struct MapStream {
    context: Context,
    stream: Stream,
    subject: String,
    map: String,
}

impl MapStream {
    /// Whether a map has a stream.
    ///
    /// # Errors
    /// [`StoreError::Unavailable`].
    pub(super) async fn exists(
        context: &Context,
        map: &str,
        uid: &str,
    ) -> Result<bool, StoreError> {
        match context.get_stream(name_of(uid)).await {
            Ok(_) => Ok(true),
            Err(error) if is_not_found(&error) => Ok(false),
            Err(error) => Err(unavailable(map, "the map's stream", &error)),
        }
    }

    /// Opens the stream of a map, and makes it where it is missing.
    ///
    /// # Errors
    /// [`StoreError::Unavailable`].
    pub(super) async fn open(
        context: &Context,
        map: &str,
        uid: &str,
        replicas: usize,
    ) -> Result<Self, StoreError> {
        let subject = format!("covis.map.{uid}");
        let config = stream::Config {
            name: name_of(uid),
            subjects: vec![subject.clone()],
            description: Some(format!("journal of map {map}")),
            retention: RetentionPolicy::Limits,
            discard: DiscardPolicy::New,
            storage: StorageType::File,
            num_replicas: replicas,
            ..stream::Config::default()
        };
        let stream = context.get_or_create_stream(config).await;
        let stream = stream.map_err(|error| unavailable(map, "the map's stream", &error))?;
        Ok(Self { context: context.clone(), stream, subject, map: map.to_owned() })
    }

    /// Takes the map over: from here on every other server's messages are refused. Returns the
    /// sequence of the owner message, which is the new epoch.
    ///
    /// # Errors
    /// [`StoreError::Unavailable`].
    pub(super) async fn fence(&self, owner: &Owner) -> Result<u64, StoreError> {
        let failed =
            |what: &dyn std::fmt::Display| unavailable(&self.map, "the map's stream", what);
        let payload = serde_json::to_vec(owner).map_err(|error| failed(&error))?;
        for _ in 0..FENCES {
            let info = self.stream.get_info().await.map_err(|error| failed(&error))?;
            let message = PublishMessage::build()
                .headers(owner_headers())
                .payload(payload.clone().into())
                .expected_last_sequence(info.state.last_sequence);
            let sent = self.context.send_publish(self.subject.clone(), message).await;
            match sent.map_err(|error| failed(&error))?.await {
                Ok(ack) => return Ok(ack.sequence),
                Err(error) if error.kind() == PublishErrorKind::WrongLastSequence => {}
                Err(error) => return Err(failed(&error)),
            }
        }
        Err(failed(&"another server writes all the time"))
    }

    /// All events of the stream up to the message `through`.
    ///
    /// # Errors
    /// [`StoreError::Unavailable`], and [`StoreError::Content`] for messages that do not fit.
    pub(super) async fn read(&self, through: u64) -> Result<Reading, StoreError> {
        let failed =
            |what: &dyn std::fmt::Display| unavailable(&self.map, "the map's stream", what);
        let config =
            OrderedConfig { deliver_policy: DeliverPolicy::All, ..OrderedConfig::default() };
        let consumer = self.stream.create_consumer(config).await.map_err(|e| failed(&e))?;
        let mut messages = consumer.messages().await.map_err(|error| failed(&error))?;
        let mut reading = Reading::default();
        loop {
            let next = tokio::time::timeout(LONGEST_READ, messages.next()).await;
            let message = next.map_err(|_elapsed| failed(&"it is read too slowly"))?;
            let message = message.ok_or_else(|| failed(&"it ended early"))?;
            let message = message.map_err(|error| failed(&error))?;
            let sequence = message.info().map_err(|error| failed(&error))?.stream_sequence;
            let headers = message.headers.clone().unwrap_or_default();
            reading.take(sequence, &headers, &message.payload).map_err(|what| {
                let path = format!(
                    "message {sequence} of stream {}",
                    self.stream.cached_info().config.name
                );
                StoreError::Content { path, message: what }
            })?;
            if sequence >= through {
                return Ok(reading);
            }
        }
    }

    /// Puts a message behind `last`, the sequence of the stream's last message; returns its own.
    ///
    /// # Errors
    /// [`PutError`].
    pub(super) async fn put(
        &self,
        last: u64,
        epoch: u64,
        message: &Outgoing,
    ) -> Result<u64, PutError> {
        let unknown =
            |error: &dyn std::fmt::Display| PutError::Unknown { cause: error.to_string() };
        let publish = PublishMessage::build()
            .headers(message.headers(epoch))
            .payload(message.payload.clone())
            .expected_last_sequence(last);
        let sent = self.context.send_publish(self.subject.clone(), publish).await;
        match sent.map_err(|error| unknown(&error))?.await {
            Ok(ack) => Ok(ack.sequence),
            Err(error) if error.kind() == PublishErrorKind::WrongLastSequence => {
                self.look_up(last + 1, epoch, message).await
            }
            Err(error) if error.kind() == PublishErrorKind::StreamNotFound => {
                // So it is also while the stream has no leader.
                match self.context.get_stream(&self.stream.cached_info().config.name).await {
                    Err(gone) if is_not_found(&gone) => Err(PutError::Fenced),
                    Ok(_) | Err(_) => Err(unknown(&error)),
                }
            }
            Err(error) => Err(unknown(&error)),
        }
    }

    /// Whether the message at `sequence` is this one, sent earlier.
    async fn look_up(
        &self,
        sequence: u64,
        epoch: u64,
        message: &Outgoing,
    ) -> Result<u64, PutError> {
        match self.stream.get_raw_message(sequence).await {
            Ok(found) if message.is(epoch, &found.headers, &found.payload) => Ok(sequence),
            Ok(_) => Err(PutError::Fenced),
            Err(error) => Err(PutError::Unknown { cause: error.to_string() }),
        }
    }

    /// Drops the messages before `sequence`.
    ///
    /// # Errors
    /// [`StoreError::Unavailable`].
    pub(super) async fn purge(&self, sequence: u64) -> Result<(), StoreError> {
        let purged = self.stream.purge().sequence(sequence).await;
        purged.map_err(|error| unavailable(&self.map, "the map's stream", &error))?;
        Ok(())
    }
}

/// Deletes the stream of a map, if there is one.
///
/// # Errors
/// [`StoreError::Unavailable`].
pub(super) async fn delete(context: &Context, map: &str, uid: &str) -> Result<(), StoreError> {
    match context.delete_stream(name_of(uid)).await {
        Ok(_) => Ok(()),
        Err(error) => match MapStream::exists(context, map, uid).await {
            Ok(false) => Ok(()),
            Ok(true) | Err(_) => Err(unavailable(map, "the map's stream", &error)),
        },
    }
}

fn name_of(uid: &str) -> String {
    format!("covis_map_{uid}")
}

fn is_not_found(error: &async_nats::jetstream::context::GetStreamError) -> bool {
    match error.kind() {
        GetStreamErrorKind::JetStream(error) => error.error_code() == ErrorCode::STREAM_NOT_FOUND,
        GetStreamErrorKind::EmptyName
        | GetStreamErrorKind::Request
        | GetStreamErrorKind::InvalidStreamName => false,
    }
}
