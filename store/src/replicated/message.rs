//! The messages of a map's stream, and how a reader puts events together from them.
//!
//! | header | of | value |
//! |---|---|---|
//! | `Covis-Kind` | every message | `owner` or `events` |
//! | `Covis-Epoch` | events | sequence of the owner message of the server that wrote it |
//! | `Covis-First`, `Covis-Last` | events | revisions of the first and the last event |
//! | `Covis-Part` | part of a large event | `i/n`, from 1 |
//!
//! The payload of `owner` is JSON: who took the map over, and its address. The payload of `events` is one
//! event after another, each behind its length (u32, little-endian); an event that is larger than a
//! message comes in parts, one after another. Parts that another owner's message interrupts are the
//! unfinished write of a server that lost the map: they were never acknowledged and count for nothing.

use std::sync::Arc;

use async_nats::HeaderMap;
use bytes::Bytes;
use serde::{Deserialize, Serialize};

use crate::encoding::decode_event;
use crate::sequence_of;
use covis_map::Event;

pub(super) const KIND: &str = "Covis-Kind";
pub(super) const EPOCH: &str = "Covis-Epoch";
pub(super) const FIRST: &str = "Covis-First";
pub(super) const LAST: &str = "Covis-Last";
const PART: &str = "Covis-Part";
const OWNER: &str = "owner";
const EVENTS: &str = "events";

/// Bytes before each event of a payload.
pub(super) const LENGTH: usize = 4;
/// A longer event is damage: the embedded journal takes none either.
const LONGEST_EVENT: usize = 1 << 30;

/// A server that serves a map.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub(super) struct Owner {
    /// Random at each start of a server.
    pub(super) server: String,
    /// Where clients reach it, as a URL.
    pub(super) address: String,
}

/// A message with events that is to be published.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct Outgoing {
    pub(super) first: u64,
    pub(super) last: u64,
    /// Which part of how many; (1, 1) for whole events.
    part: (u32, u32),
    pub(super) payload: Bytes,
}

impl Outgoing {
    /// The headers under an epoch.
    pub(super) fn headers(&self, epoch: u64) -> HeaderMap {
        let mut headers = HeaderMap::new();
        headers.insert(KIND, EVENTS);
        headers.insert(EPOCH, epoch.to_string());
        headers.insert(FIRST, self.first.to_string());
        headers.insert(LAST, self.last.to_string());
        let (part, parts) = self.part;
        if parts > 1 {
            headers.insert(PART, format!("{part}/{parts}"));
        }
        headers
    }

    /// Whether its events are in the stream once it is.
    pub(super) fn is_whole(&self) -> bool {
        self.part.0 == self.part.1
    }

    /// Whether a message of the stream is this one, written under `epoch`.
    pub(super) fn is(&self, epoch: u64, headers: &HeaderMap, payload: &[u8]) -> bool {
        number(headers, EPOCH) == Some(epoch)
            && number(headers, FIRST) == Some(self.first)
            && number(headers, LAST) == Some(self.last)
            && part_of(headers) == Some(self.part)
            && payload == self.payload
    }
}

/// The headers of the message by which an owner takes a map over.
pub(super) fn owner_headers() -> HeaderMap {
    let mut headers = HeaderMap::new();
    headers.insert(KIND, OWNER);
    headers
}

/// Packs encoded events with rising revisions into messages of at most about `most` bytes.
pub(super) fn pack(events: impl Iterator<Item = (u64, Vec<u8>)>, most: usize) -> Vec<Outgoing> {
    let mut packed: Vec<Outgoing> = Vec::new();
    let mut open: Option<(u64, u64, Vec<u8>)> = None;
    let close = |open: &mut Option<(u64, u64, Vec<u8>)>, packed: &mut Vec<Outgoing>| {
        if let Some((first, last, bytes)) = open.take() {
            packed.push(Outgoing { first, last, part: (1, 1), payload: bytes.into() });
        }
    };
    for (revision, event) in events {
        let length = u32::try_from(event.len()).unwrap_or(u32::MAX).to_le_bytes();
        if LENGTH + event.len() > most {
            close(&mut open, &mut packed);
            let bytes = Bytes::from([&length[..], &event].concat());
            let parts = u32::try_from(bytes.len().div_ceil(most)).unwrap_or(u32::MAX);
            for part in 1..=parts {
                let start = (part as usize - 1) * most;
                let payload = bytes.slice(start..bytes.len().min(start + most));
                packed.push(Outgoing {
                    first: revision,
                    last: revision,
                    part: (part, parts),
                    payload,
                });
            }
            continue;
        }
        if open.as_ref().is_some_and(|(.., bytes)| bytes.len() + LENGTH + event.len() > most) {
            close(&mut open, &mut packed);
        }
        let (_, last, bytes) = open.get_or_insert_with(|| (revision, revision, Vec::new()));
        *last = revision;
        bytes.extend_from_slice(&length);
        bytes.extend_from_slice(&event);
    }
    close(&mut open, &mut packed);
    packed
}

/// An event and where it ends in the stream.
#[derive(Clone, Debug)]
pub(super) struct AssembledEvent {
    pub(super) event: Arc<Event>,
    /// The bytes that were published.
    pub(super) encoded: Vec<u8>,
    /// Sequence in the stream of the message that completes it.
    pub(super) at: u64,
}

/// Puts events together from the messages of a stream, in order.
#[derive(Debug, Default)]
pub(super) struct Reading {
    /// The sequence of the last owner message; `None` where it was purged.
    epoch: Option<u64>,
    /// Parts of an event that is not complete: its revision, the next part, the bytes so far.
    parts: Option<(u64, u32, Vec<u8>)>,
    pub(super) events: Vec<AssembledEvent>,
}

impl Reading {
    /// Takes the next message.
    ///
    /// # Errors
    /// What is wrong with it.
    pub(super) fn take(
        &mut self,
        sequence: u64,
        headers: &HeaderMap,
        payload: &[u8],
    ) -> Result<(), String> {
        match headers.get(KIND).map(|kind| kind.as_str()) {
            Some(OWNER) => {
                (self.epoch, self.parts) = (Some(sequence), None);
                return Ok(());
            }
            Some(EVENTS) => {}
            _ => return Err("it is not a message of covis, or it is of a later version".to_owned()),
        }
        let epoch = number(headers, EPOCH).ok_or("it has no epoch")?;
        if *self.epoch.get_or_insert(epoch) != epoch {
            return Err("a server wrote that did not own the map".to_owned());
        }
        let first = number(headers, FIRST).ok_or("it has no first revision")?;
        let last = number(headers, LAST).ok_or("it has no last revision")?;
        let (part, parts) = part_of(headers).ok_or("its part cannot be read")?;
        if parts == 1 {
            self.parts = None;
            return self.take_events(sequence, first, last, payload);
        }
        if part == 1 {
            self.parts = Some((first, 1, Vec::new()));
        }
        match &mut self.parts {
            Some((revision, next, bytes)) if (*revision, *next) == (first, part) => {
                if bytes.len() + payload.len() > LONGEST_EVENT {
                    return Err("an event is longer than any can be".to_owned());
                }
                bytes.extend_from_slice(payload);
                *next += 1;
            }
            // What is left of it was purged: a snapshot holds it.
            None if self.events.is_empty() => return Ok(()),
            _ => return Err("a part of an event is missing".to_owned()),
        }
        if part == parts
            && let Some((.., bytes)) = self.parts.take()
        {
            return self.take_events(sequence, first, last, &bytes);
        }
        Ok(())
    }

    fn take_events(
        &mut self,
        at: u64,
        first: u64,
        last: u64,
        mut bytes: &[u8],
    ) -> Result<(), String> {
        let mut expected = first;
        while let Some((length, rest)) = bytes.split_first_chunk::<LENGTH>() {
            let length = u32::from_le_bytes(*length) as usize;
            let encoded = rest.get(..length).ok_or("an event ends too early")?;
            let event = decode_event(encoded).map_err(|error| error.to_string())?;
            let revision = sequence_of(event.revision);
            let before = self.events.last().map(|found| sequence_of(found.event.revision));
            if revision != expected || before.is_some_and(|before| before + 1 != revision) {
                return Err(format!("revision {revision} does not follow"));
            }
            let encoded = encoded.to_vec();
            self.events.push(AssembledEvent { event: Arc::new(event), encoded, at });
            expected += 1;
            bytes = &rest[length..];
        }
        if !bytes.is_empty() || expected != last.saturating_add(1) {
            return Err("its events are not those of its header".to_owned());
        }
        Ok(())
    }
}

fn number(headers: &HeaderMap, name: &str) -> Option<u64> {
    headers.get(name)?.as_str().parse().ok()
}

/// Which part of how many a message is.
fn part_of(headers: &HeaderMap) -> Option<(u32, u32)> {
    let Some(text) = headers.get(PART) else { return Some((1, 1)) };
    let (part, parts) = text.as_str().split_once('/')?;
    let (part, parts) = (part.parse().ok()?, parts.parse().ok()?);
    (1 <= part && part <= parts).then_some((part, parts))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::encoding::encode_event;
    use covis_map::{Change, MapPolicy};

    fn event(revision: i64, name: &str) -> (u64, Vec<u8>) {
        let change = Change::Created {
            policy: MapPolicy::default(),
            create_time_ns: 1,
            display_name: name.to_owned(),
        };
        let mut bytes = Vec::new();
        encode_event(&Event { revision, time_ns: revision, cause: None, change }, &mut bytes);
        (sequence_of(revision), bytes)
    }

    fn read(messages: &[Outgoing], epoch: u64, reading: &mut Reading) -> Result<(), String> {
        for (sequence, message) in (epoch + 1..).zip(messages) {
            reading.take(sequence, &message.headers(epoch), &message.payload)?;
        }
        Ok(())
    }

    fn revisions(reading: &Reading) -> Vec<i64> {
        reading.events.iter().map(|found| found.event.revision).collect()
    }

    #[test]
    fn events_come_back_whole_however_they_were_packed() {
        let long = "x".repeat(5000);
        let events = [event(1, "a"), event(2, &long), event(3, "b"), event(4, "c")];
        for most in [64, 600, 1 << 20] {
            let packed = pack(events.iter().cloned(), most);
            let mut reading = Reading::default();
            reading.take(1, &owner_headers(), b"{}").unwrap();
            read(&packed, 1, &mut reading).unwrap();
            assert_eq!(revisions(&reading), [1, 2, 3, 4], "at most {most} bytes");
            let bytes: Vec<_> = reading.events.iter().map(|found| &found.encoded).collect();
            assert_eq!(bytes, events.iter().map(|(_, bytes)| bytes).collect::<Vec<_>>());
        }
    }

    #[test]
    fn an_unfinished_event_of_a_former_owner_counts_for_nothing() {
        let mut packed = pack([event(2, &"x".repeat(900))].into_iter(), 300);
        packed.pop();
        let mut reading = Reading::default();
        reading.take(1, &owner_headers(), b"{}").unwrap();
        read(&pack([event(1, "a")].into_iter(), 9000), 1, &mut reading).unwrap();
        read(&packed, 1, &mut reading).unwrap();
        reading.take(9, &owner_headers(), b"{}").unwrap();
        read(&pack([event(2, "b")].into_iter(), 9000), 9, &mut reading).unwrap();
        assert_eq!(revisions(&reading), [1, 2]);
    }

    #[test]
    fn a_message_of_a_server_that_is_not_the_owner_is_found() {
        let mut reading = Reading::default();
        reading.take(1, &owner_headers(), b"{}").unwrap();
        reading.take(2, &owner_headers(), b"{}").unwrap();
        let late = pack([event(1, "a")].into_iter(), 9000);
        let found = read(&late, 1, &mut reading).unwrap_err();
        assert_eq!(found, "a server wrote that did not own the map");
    }

    #[test]
    fn a_gap_between_revisions_is_found() {
        let mut reading = Reading::default();
        let packed = pack([event(1, "a"), event(3, "b")].into_iter(), 9000);
        assert_eq!(read(&packed, 1, &mut reading).unwrap_err(), "revision 3 does not follow");
    }
}
