//! What maps' streams hold, read by a client of NATS of the test's own: the proof that never two servers
//! wrote.

use std::collections::BTreeMap;

use async_nats::jetstream::consumer::pull::OrderedConfig;
use async_nats::jetstream::context::Context;
use futures_util::{StreamExt, TryStreamExt};

/// A message as its headers tell.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) enum Message {
    /// A server took the map over.
    Owner,
    /// Events of these revisions, written under the epoch of an owner.
    Events { epoch: u64, first: u64, last: u64 },
}

/// A connection, and the name of the only map's stream.
async fn stream_of_map(nats: &str) -> (Context, String) {
    let client = async_nats::connect(nats.split(',').collect::<Vec<_>>()).await.unwrap();
    let context = async_nats::jetstream::new(client);
    let names: Vec<String> = context.stream_names().try_collect().await.unwrap();
    let maps: Vec<_> = names.iter().filter(|name| name.starts_with("covis_map_")).collect();
    let [map] = maps[..] else { panic!("one map is expected: {names:?}") };
    let map = map.clone();
    (context, map)
}

/// Deletes the stream of the only map, as NATS may lose it.
pub(super) async fn lose_stream(nats: &str) {
    let (context, map) = stream_of_map(nats).await;
    assert!(context.delete_stream(map).await.unwrap().success);
}

/// The messages of a map's stream by sequence.
pub(super) async fn messages(nats: &str) -> BTreeMap<u64, Message> {
    let (context, map) = stream_of_map(nats).await;
    let stream = context.get_stream(map).await.unwrap();
    let state = &stream.cached_info().state;
    if state.messages == 0 {
        return BTreeMap::new();
    }
    let last = state.last_sequence;
    let consumer = stream.create_consumer(OrderedConfig::default()).await.unwrap();
    let mut reading = consumer.messages().await.unwrap();
    let mut all = BTreeMap::new();
    while all.last_key_value().is_none_or(|(&sequence, _)| sequence < last) {
        let message = reading.next().await.unwrap().unwrap();
        let sequence = message.info().unwrap().stream_sequence;
        let headers = message.headers.clone().unwrap();
        let number = |name: &str| headers.get(name).unwrap().as_str().parse::<u64>().unwrap();
        let message = match headers.get("Covis-Kind").unwrap().as_str() {
            "owner" => Message::Owner,
            _ => Message::Events {
                epoch: number("Covis-Epoch"),
                first: number("Covis-First"),
                last: number("Covis-Last"),
            },
        };
        all.insert(sequence, message);
    }
    all
}

/// Proves that whoever wrote owned the map at that moment, and that every revision was written once.
/// Returns how often the map was taken over.
pub(super) fn prove_one_writer(messages: &BTreeMap<u64, Message>) -> usize {
    let (mut owner, mut next, mut owners) = (None, 1, 0);
    for (&sequence, message) in messages {
        match message {
            Message::Owner => {
                owner = Some(sequence);
                owners += 1;
            }
            Message::Events { epoch, first, last } => {
                assert_eq!(
                    Some(*epoch),
                    owner,
                    "message {sequence} is of a server that lost the map"
                );
                assert_eq!(
                    *first, next,
                    "message {sequence} does not go on where the one before ends"
                );
                next = last + 1;
            }
        }
    }
    owners
}

/// The entries of tasks by key.
async fn tasks(nats: &str) -> BTreeMap<String, serde_json::Value> {
    let client = async_nats::connect(nats.split(',').collect::<Vec<_>>()).await.unwrap();
    let context = async_nats::jetstream::new(client);
    let bucket = context.get_key_value("covis_tasks").await.unwrap();
    let keys: Vec<String> = bucket.keys().await.unwrap().try_collect().await.unwrap();
    let mut entries = BTreeMap::new();
    for key in keys {
        if let Some(bytes) = bucket.get(&key).await.unwrap() {
            entries.insert(key, serde_json::from_slice(&bytes).unwrap());
        }
    }
    entries
}

/// Whether a task's result is there.
pub(super) async fn has_result(nats: &str) -> bool {
    tasks(nats).await.values().any(|entry| entry["result"].is_string())
}

/// Whether there are tasks, done or not.
pub(super) async fn has_tasks(nats: &str) -> bool {
    !tasks(nats).await.is_empty()
}
