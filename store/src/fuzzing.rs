//! What the fuzz targets run of the store: journal files, a map's folder, snapshots, files of maps,
//! events.
//!
//! Built for tests and with the feature `fuzzing` only. Each function takes any bytes and panics
//! where a promise is broken: what was read comes back bit for bit, what was mended needs no
//! mending, a map that events led to survives its snapshot. Damage is no finding, only a panic is.

use super::encoding::{decode_event, decode_map, densest, encode_event, encode_map};
use super::files::fuzzing as files;
use super::map_file::{MapFileWriter, read_map_file, with_checksums};
use covis_map::{Event, Map};

pub use super::files::fuzzing::journal_folder;

/// Events that one input folds into a map: what a map holds is bounded by its limits, not by the
/// size of what once came in.
pub const MOST_EVENTS: usize = 256;

/// The event after its journey through the encoding; the same bits, or a panic.
#[must_use]
pub fn journey(event: &Event) -> Event {
    let mut bytes = Vec::new();
    encode_event(event, &mut bytes);
    let decoded = match decode_event(&bytes) {
        Ok(decoded) => decoded,
        Err(error) => panic!("an event does not decode: {error}: {event:?}"),
    };
    let mut again = Vec::new();
    encode_event(&decoded, &mut again);
    assert!(bytes == again, "an event comes back as another: {event:?}, {decoded:?}");
    decoded
}

/// The map goes through a snapshot's parts and comes back with its state.
pub fn map_journey(map: &Map) {
    let mut bytes = Vec::new();
    if let Err(error) = encode_map(map, &mut bytes) {
        panic!("a map does not encode: {error}");
    }
    match decode_map(&mut &bytes[..]) {
        Ok(decoded) => {
            assert_eq!(decoded.state_hash(), map.state_hash());
            let neighbors = |map: &Map| {
                let of = |&keyframe| map.covisibility().neighbors(keyframe).collect::<Vec<_>>();
                map.keyframes().keys().map(of).collect::<Vec<_>>()
            };
            let (again, before) = (neighbors(&decoded), neighbors(map));
            assert_eq!(again, before, "covisibility from scratch is another");
        }
        Err(error) => panic!("a map does not decode: {error}"),
    }
}

/// Folds events of any payloads, the revisions put right so that more of them fit.
pub(super) fn fold(map: &mut Map, events: impl Iterator<Item = Event>) {
    for mut event in events.take(MOST_EVENTS) {
        event.revision = map.revision().saturating_add(1);
        // Refused events are as good as taken ones: neither may panic.
        let _refused = map.apply(&journey(&event));
    }
    map_journey(map);
}

/// A journal file: `0` and its bytes as they are, or `1` and payloads, each behind its length (two
/// bytes) and its step in the sequence (one), which get headers and checksums.
pub fn journal(input: &[u8]) {
    let Some((&kind, rest)) = input.split_first() else { return };
    let (bytes, uid, first) = if kind & 1 == 0 {
        (rest.to_vec(), files::uid_of(rest), files::first_of(rest))
    } else {
        let uid = [kind; 16];
        (files::built(&uid, 1, rest), uid, 1)
    };
    let payloads = files::payloads(&bytes, &uid, first);
    if kind & 1 == 0 {
        assert!(payloads.iter().map(|payload| payload.len()).sum::<usize>() <= bytes.len());
    }
    let mut map = Map::new();
    fold(&mut map, payloads.iter().filter_map(|payload| decode_event(payload).ok()));
}

/// Inputs of `journal` and of `snapshot` that take as much memory as `length` bytes can.
#[must_use]
pub fn largest(length: usize) -> [Vec<Vec<u8>>; 2] {
    let [events, parts] = densest(length.saturating_sub(16));
    let payload = |event: Vec<u8>| [&[1, u8::MAX, u8::MAX, 1][..], &event].concat();
    let part = |part: Vec<u8>| [&[2][..], &(part.len() as u64).to_le_bytes(), &part].concat();
    [events.into_iter().map(payload).collect(), parts.into_iter().map(part).collect()]
}

/// A sealed snapshot: `0` and the file as it is; `1` and a body to seal; `2` and parts to compress
/// and seal; `3` and an identity's body to seal.
pub fn snapshot(input: &[u8]) {
    let Some((&kind, rest)) = input.split_first() else { return };
    let bytes = match kind & 3 {
        0 => rest.to_vec(),
        1 => files::sealed_snapshot(rest, false),
        2 => files::sealed_snapshot(rest, true),
        _ => return files::identity(rest),
    };
    if let Some(map) = files::unsealed(&bytes) {
        map_journey(&map);
    }
}

/// A file of a map that somebody uploads: `0` and the file as it is, or another byte and parts, each
/// behind its length (eight bytes), which get head and checksums.
pub fn map_file(input: &[u8]) {
    let Some((&kind, rest)) = input.split_first() else { return };
    // The inputs of `largest` have a 2 there.
    let bytes = if kind == 0 { rest.to_vec() } else { with_checksums(rest) };
    let Ok(map) = read_map_file(&mut &bytes[..], &mut |_| true) else { return };
    assert_eq!(map.check_sound(), Ok(()));
    let mut again = Vec::new();
    assert!(!MapFileWriter::default().put(&map, usize::MAX, &mut again));
    match read_map_file(&mut &again[..], &mut |_| true) {
        Ok(read) => assert_eq!(read.state_hash(), map.state_hash()),
        Err(error) => panic!("a map that was read cannot be read again: {error}"),
    }
    map_journey(&map);
}

#[cfg(test)]
mod seeds;
